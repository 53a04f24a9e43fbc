"""Vortices in a box with exact solutions, which the air enters and leaves through all of its faces."""

from functools import partial
from math import ceil, pi

import numpy as np

from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.flow_cases import (
    Errors,
    at_both_steps,
    faces,
    in_empty_box,
    laminar_wind,
    rms,
    velocities,
)

A, D, SIZE = pi / 4, pi / 2, 1.0


def ethier_steinman(n: int, viscosity: float, end: float = 0.25) -> Errors:
    """Vortices of all three components in a box of 1 m with n³ cells, prescribed on its faces at every step.

    u = -a (exp(a x) sin(a y + d z) + exp(a z) cos(a x + d y)) F and its cyclic permutations, F = exp(-nu d² t).
    """

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        result = np.empty_like(x)
        for c in range(3):
            p, q, r = (x[..., (c + k) % 3] for k in range(3))
            swirl = np.exp(A * p) * np.sin(A * q + D * r) + np.exp(A * r) * np.cos(A * p + D * q)
            result[..., c] = -A * swirl * np.exp(-viscosity * D**2 * t)
        return result

    def errors() -> Errors:
        blow(flow, partial(exact, t=0.0))
        flow.start_from(lambda x: exact(x, 0.0))
        t = 0.0
        while end - t > 1e-9:
            dt = (end - t) / ceil((end - t) / flow.stable_dt())
            blow(flow, partial(exact, t=t + dt))
            flow.advance(t, dt)
            t += dt
        found = velocities(flow)
        return {"u, rms": rms(*(found[d] - exact(faces(flow.grid, d), end)[..., d] for d in range(3)))}

    walls = [
        {"kind": "wall", "face": f"{axis}{side}", "velocity": (0.0,) * 3} for axis in "xyz" for side in "-+"
    ]
    wind: CfdWind = laminar_wind(viscosity, walls)
    flow = in_empty_box(wind, (n, n, n), SIZE / n)
    return at_both_steps(flow, wind, errors)


def blow(flow: FlowSolver, velocity) -> None:
    """Prescribe the velocity on all faces of the domain, with no net flux."""
    grid = flow.grid
    targets = []
    for d in range(grid.dim):
        target = np.zeros((*flow.boundaries.sides[d], grid.dim))
        for c in range(grid.dim):
            axes = [
                (np.arange(n) - grid.ghost + (0.0 if c == a else 0.5)) * grid.dx
                for a, n in enumerate(grid.padded)
            ]
            axes[d] = np.array([0.0, SIZE])
            target[..., c] = velocity(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))[..., c]
        targets.append(target)
    out = 0.0
    for d, target in enumerate(targets):
        inner = tuple(slice(None) if a == d else slice(*cells) for a, cells in enumerate(grid.cells))
        low, high = np.moveaxis(target[inner][..., d], d, 0)
        out += (high - low).sum()
    for d, target in enumerate(targets):
        side = np.array([-1.0, 1.0]).reshape([2 if a == d else 1 for a in range(grid.dim)])
        target[..., d] -= side * out / grid.boundary_faces
        flow.boundaries.target[d].from_numpy(target.astype(np.float32))
