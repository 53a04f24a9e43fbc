"""Flows with exact solutions. Each function solves one at a resolution and returns its errors by norm.

Steps are as long as those of runs: of the default Courant number.
"""

from collections.abc import Callable
from math import ceil, pi, sqrt
from typing import Any

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.state import State
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.patches import periodic_axes

Errors = dict[str, float]
STEADY = 2e-5  # largest change of u, over its maximum, within the time that counts
SMALL_COURANT = 0.2
SMALL_STEPS = ", small steps"
"""What the norms of an error at SMALL_COURANT end with."""


def laminar_wind(viscosity: float, openings: list[dict], **more: Any) -> CfdWind:
    """One of constant viscosity [m²/s]."""
    told = {"viscosity": viscosity, "turbulence": {"kind": "none"}, "openings": openings}
    return CfdWind.model_validate({"kind": "cfd", **told, **more})


def in_empty_box(wind: CfdWind, shape: tuple[int, ...], dx: float) -> FlowSolver:
    """Its flow, with air everywhere."""
    grid = Grid(shape, dx, periodic=periodic_axes(wind.openings, len(shape)))
    return FlowSolver(wind, grid, Air.everywhere(grid))


def laminar_flow(
    shape: tuple[int, ...], dx: float, viscosity: float, openings: list[dict], **more: Any
) -> FlowSolver:
    """A flow of constant viscosity [m²/s] in an empty box."""
    return in_empty_box(laminar_wind(viscosity, openings, **more), shape, dx)


def at_both_steps(flow: FlowSolver, wind: CfdWind, errors: Callable[[], Errors]) -> Errors:
    """What `errors` finds of the flow of `wind` with steps as they are, and begun anew with small ones."""
    found, state = errors(), State(flow)
    state.clear()
    flow.begin(wind.model_copy(update={"courant": SMALL_COURANT}), 0.0, 0)
    return found | {norm + SMALL_STEPS: error for norm, error in errors().items()}


def advance(flow: FlowSolver, end: float, begin: float = 0.0) -> None:
    """Step a flow from `begin` to `end` [s]."""
    t = begin
    while end - t > 1e-9 * end:
        dt = (end - t) / ceil((end - t) / flow.stable_dt())
        flow.advance(t, dt)
        t += dt


def settle(flow: FlowSolver, span: float, longest: float) -> float:
    """Advance until u changes by less than STEADY within `span` [s], or for `longest` [s]. Returns the time."""
    t, before = 0.0, velocities(flow)
    while t < longest:
        advance(flow, t + span, t)
        t += span
        now = velocities(flow)
        change = max(float(np.abs(a - b).max()) for a, b in zip(now, before, strict=True))
        if change < STEADY * flow.max_speed:
            return t
        before = now
    raise RuntimeError(f"u still changed by {change:.1e} m/s in {span:g} s at t = {longest:g} s")


def velocities(flow: FlowSolver) -> list[np.ndarray]:
    """Face velocities [m/s] per axis, on the lower faces of the inner cells."""
    return [flow.grid.inner(field.to_numpy()).astype(float) for field in flow.u]


def faces(grid: Grid, d: int) -> np.ndarray:
    """Centres [m] of the lower d-faces of the inner cells, shape (*shape, dim)."""
    points = grid.centers()
    points[..., d] -= 0.5 * grid.dx
    return points


def rms(*errors: np.ndarray) -> float:
    """Root mean square of the length of a vector, given its components."""
    return sqrt(sum(float(np.mean(e**2)) for e in errors))


def periodic(axes: str) -> list[dict]:
    """Periodic openings along these axes."""
    return [{"kind": "periodic", "axis": axis} for axis in axes]


# ---------------------------------------------------------------- without walls


def taylor_green(n: int, dim: int = 2) -> Errors:
    """Decaying vortices in a 2 pi box of n² cells; in 3-D extruded over a few cells.

    u = sin x cos y F, v = -cos x sin y F, F = exp(-2 nu t).
    """
    viscosity, end = 0.01, 1.0

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        decay = np.exp(-2.0 * viscosity * t)
        u = np.zeros_like(x)
        u[..., 0] = np.sin(x[..., 0]) * np.cos(x[..., 1]) * decay
        u[..., 1] = -np.cos(x[..., 0]) * np.sin(x[..., 1]) * decay
        return u

    def errors() -> Errors:
        flow.start_from(lambda x: exact(x, 0.0))
        energy = sum(float(np.mean(u**2)) for u in velocities(flow))
        advance(flow, end)
        found = velocities(flow)
        wrong = rms(*(found[d] - exact(faces(flow.grid, d), end)[..., d] for d in range(dim)))
        rate = np.log(sum(float(np.mean(u**2)) for u in found) / energy) / end
        return {"u, rms": wrong, "decay of the energy": float(abs(rate / (-4.0 * viscosity) - 1.0))}

    wind = laminar_wind(viscosity, periodic("xyz"[:dim]))
    flow = in_empty_box(wind, (n, n, 4)[:dim], 2.0 * pi / n)
    return at_both_steps(flow, wind, errors)


def kovasznay(n: int, reynolds: float = 40.0) -> Errors:
    """Steady flow behind a grid of rods, from x = -0.5 to 1 and one period in y, with n cells per unit.

    u = 1 - exp(l x) cos 2 pi y, v = l/(2 pi) exp(l x) sin 2 pi y, l = Re/2 - sqrt(Re²/4 + 4 pi²). Its velocity is
    prescribed where x ends.
    """
    rate = reynolds / 2.0 - sqrt(reynolds**2 / 4.0 + 4.0 * pi**2)
    left, length = -0.5, 1.5

    def exact(x: np.ndarray) -> np.ndarray:
        grown, phase = np.exp(rate * (x[..., 0] + left)), 2.0 * pi * x[..., 1]
        return np.stack([1.0 - grown * np.cos(phase), rate / (2.0 * pi) * grown * np.sin(phase)], axis=-1)

    ends = [{"kind": "wall", "face": face, "velocity": (0.0, 0.0)} for face in ("x-", "x+")]
    flow = laminar_flow((round(length * n), n), 1.0 / n, 1.0 / reynolds, periodic("y") + ends)
    grid, target = flow.grid, np.zeros((2, flow.grid.padded[1], 2), np.float32)
    for side in range(2):
        for d, shift in enumerate((0.5, 0.0)):  # v lives on the corners of the boundary's cells
            y = (np.arange(grid.padded[1]) - grid.ghost + shift) * grid.dx
            target[side, :, d] = exact(np.stack([np.full_like(y, side * length), y], axis=-1))[:, d]
    flow.boundaries.target[0].from_numpy(target)
    flow.start_from(exact)
    settle(flow, 0.5, 20.0)
    found = velocities(flow)
    return {"u, rms": rms(*(found[d] - exact(faces(grid, d))[..., d] for d in range(2)))}


def drifting(n: int) -> Errors:
    """Vortices of n cells that a wind ten times as fast carries on without viscosity: over one of their wavelengths
    where n is 8, over (n/8)² in general. They only move.
    """
    distance = (n / 8) ** 2
    k = 2.0 * pi

    def vortices(x: np.ndarray) -> np.ndarray:
        u = np.sin(k * x[..., 0]) * np.cos(k * x[..., 1])
        v = -np.cos(k * x[..., 0]) * np.sin(k * x[..., 1])
        return np.stack([1.0 + 0.1 * u, 0.1 * v], axis=-1)

    def energy() -> float:
        return sum(float(((u - u.mean()) ** 2).mean()) for u in velocities(flow))

    def errors() -> Errors:
        flow.start_from(vortices)
        before, largest, t = energy(), 0.0, 0.0
        while distance - t > 1e-9:
            advance(flow, t + distance / 8, t)
            t += distance / 8
            largest = max(largest, energy() / before)
        return {"energy lost": 1.0 - energy() / before, "growth": max(0.0, largest - 1.0)}

    wind = laminar_wind(1e-9, periodic("xy"))
    flow = in_empty_box(wind, (2 * n, 2 * n), 1.0 / n)
    return at_both_steps(flow, wind, errors)
