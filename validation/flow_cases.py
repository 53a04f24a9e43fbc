"""Flow solver against exact solutions without walls: Taylor-Green, Kovasznay, Ethier-Steinman.

Each function solves a flow at a resolution and returns its errors by norm. Time steps have the default Courant number
(CFL), as in runs.
"""

from collections.abc import Callable
from functools import partial
from math import ceil, pi, prod, sqrt

import numpy as np

from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.case import SECOND_ORDER, Case, Expected
from taichi_plume.validation.setups import Openings, advance, cfd, flow_on

Errors = dict[str, float]
STEADY = 2e-5  # rms change of u over its maximum within `span`, for a flow that counts as steady
SMALL_COURANT = 0.1  # at 0.2 the errors of the steps and of the cells cancel in Taylor-Green vortices
SMALL_STEPS = ", small steps"
"""Suffix of the norms of an error at SMALL_COURANT."""
A, D, SIZE = pi / 4, pi / 2, 1.0  # parameters of Ethier and Steinman's vortices


def laminar_wind(viscosity: float, openings: Openings, **keys: object) -> CfdWind:
    """Return a wind of constant viscosity [m²/s]."""
    return cfd(openings, viscosity=viscosity, turbulence={"kind": "none"}, **keys)


def laminar_flow(
    shape: tuple[int, ...], dx: float, viscosity: float, openings: Openings, **keys: object
) -> FlowSolver:
    """Return a flow of constant viscosity [m²/s] in an empty box."""
    return flow_on(laminar_wind(viscosity, openings, **keys), shape, dx)


def at_both_steps(
    wind: CfdWind, flow_of: Callable[[CfdWind], FlowSolver], errors: Callable[[FlowSolver], Errors]
) -> Errors:
    """Return the errors of a flow at the default Courant number, and at SMALL_COURANT."""
    usual = errors(flow_of(wind))
    small = errors(flow_of(wind.model_copy(update={"courant": SMALL_COURANT})))
    return usual | {norm + SMALL_STEPS: error for norm, error in small.items()}


def both_steps(expected: dict[str, Expected]) -> dict[str, Expected]:
    """Return the bounds of errors, repeated for the norms at SMALL_COURANT."""
    return expected | {norm + SMALL_STEPS: bound for norm, bound in expected.items()}


def settle(flow: FlowSolver, span: float, longest: float) -> float:
    """Advance a flow until u changes by less than STEADY within `span` [s], or for `longest` [s]; return the time.

    The change is the rms over the cells: where the limiter of convection switches on and off, a few cells never settle.
    """
    t, before = 0.0, velocities(flow)
    while t < longest:
        advance(flow, t + span, t)
        t += span
        now = velocities(flow)
        change = rms(*(a - b for a, b in zip(now, before, strict=True)))
        if change < STEADY * flow.max_speed:
            return t
        before = now
    raise RuntimeError(f"u still changed by {change:.1e} m/s (rms) in {span:g} s at t = {longest:g} s")


def velocities(flow: FlowSolver) -> list[np.ndarray]:
    """Return face velocities [m/s] per axis, on the lower faces of the inner cells."""
    return [flow.grid.inner(field.to_numpy()).astype(float) for field in flow.u]


def faces(grid: Grid, d: int) -> np.ndarray:
    """Return the centres [m] of the lower faces across axis d of the inner cells, (*shape, dim)."""
    points = grid.centers()
    points[..., d] -= 0.5 * grid.dx
    return points


def rms(*errors: np.ndarray) -> float:
    """Return the root mean square of vectors' lengths, given their components."""
    return sqrt(sum(float(np.mean(e**2)) for e in errors))


def periodic(axes: str) -> list[dict]:
    """Return the openings that make these axes periodic."""
    return [{"kind": "periodic", "axis": axis} for axis in axes]


def taylor_green(n: int, dim: int = 2) -> Errors:
    """Return errors of Taylor-Green vortices in a 2 pi box of n² cells; in 3-D extruded over a few cells.

    u = sin x cos y F, v = -cos x sin y F, F = exp(-2 nu t).
    """
    viscosity, end = 0.01, 1.0

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        decay = np.exp(-2.0 * viscosity * t)
        u = np.zeros_like(x)
        u[..., 0] = np.sin(x[..., 0]) * np.cos(x[..., 1]) * decay
        u[..., 1] = -np.cos(x[..., 0]) * np.sin(x[..., 1]) * decay
        return u

    def errors(flow: FlowSolver) -> Errors:
        flow.start_from(lambda x: exact(x, 0.0))
        energy = sum(float(np.mean(u**2)) for u in velocities(flow))
        advance(flow, end)
        computed = velocities(flow)
        wrong = rms(*(computed[d] - exact(faces(flow.grid, d), end)[..., d] for d in range(dim)))
        rate = np.log(sum(float(np.mean(u**2)) for u in computed) / energy) / end
        return {"u, rms": wrong, "decay of the energy": float(abs(rate / (-4.0 * viscosity) - 1.0))}

    wind = laminar_wind(viscosity, periodic("xyz"[:dim]))
    return at_both_steps(wind, partial(flow_on, shape=(n, n, 4)[:dim], dx=2.0 * pi / n), errors)


def kovasznay(n: int, reynolds: float = 40.0) -> Errors:
    """Return errors of Kovasznay flow behind a grid of rods, x from -0.5 to 1, a period in y, n cells per unit.

    u = 1 - exp(l x) cos 2 pi y, v = l/(2 pi) exp(l x) sin 2 pi y, l = Re/2 - sqrt(Re²/4 + 4 pi²). The velocity is
    prescribed at both ends of x (Dirichlet).
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
        for d, shift in enumerate((0.5, 0.0)):  # v is stored at the corners of the boundary cells
            y = (np.arange(grid.padded[1]) - grid.ghost + shift) * grid.dx
            target[side, :, d] = exact(np.stack([np.full_like(y, side * length), y], axis=-1))[:, d]
    flow.boundaries.target[0].from_numpy(target)
    flow.start_from(exact)
    settle(flow, 0.5, 20.0)
    computed = velocities(flow)
    return {"u, rms": rms(*(computed[d] - exact(faces(grid, d))[..., d] for d in range(2)))}


def drifting(n: int) -> Errors:
    """Return energy errors of inviscid vortices, n cells in size, that a wind ten times as fast carries.

    They are carried over (n/8)² wavelengths. Exact solution: translation without change.
    """
    distance = (n / 8) ** 2
    k = 2.0 * pi

    def vortices(x: np.ndarray) -> np.ndarray:
        u = np.sin(k * x[..., 0]) * np.cos(k * x[..., 1])
        v = -np.cos(k * x[..., 0]) * np.sin(k * x[..., 1])
        return np.stack([1.0 + 0.1 * u, 0.1 * v], axis=-1)

    def energy(flow: FlowSolver) -> float:
        return sum(float(((u - u.mean()) ** 2).mean()) for u in velocities(flow))

    def errors(flow: FlowSolver) -> Errors:
        flow.start_from(vortices)
        before, largest, t = energy(flow), 0.0, 0.0
        while distance - t > 1e-9:
            advance(flow, t + distance / 8, t)
            t += distance / 8
            largest = max(largest, energy(flow) / before)
        return {"energy lost": 1.0 - energy(flow) / before, "growth": max(0.0, largest - 1.0)}

    wind = laminar_wind(1e-9, periodic("xy"))
    return at_both_steps(wind, partial(flow_on, shape=(2 * n, 2 * n), dx=1.0 / n), errors)


def ethier_steinman(n: int, viscosity: float, end: float = 0.25) -> Errors:
    """Return errors of Ethier-Steinman vortices in a box of 1 m with n³ cells, prescribed on the faces at every step.

    u = -a (exp(a x) sin(a y + d z) + exp(a z) cos(a x + d y)) F and its cyclic permutations, F = exp(-nu d² t).
    """

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        result = np.empty_like(x)
        for c in range(3):
            p, q, r = (x[..., (c + k) % 3] for k in range(3))
            swirl = np.exp(A * p) * np.sin(A * q + D * r) + np.exp(A * r) * np.cos(A * p + D * q)
            result[..., c] = -A * swirl * np.exp(-viscosity * D**2 * t)
        return result

    def errors(flow: FlowSolver) -> Errors:
        blow(flow, partial(exact, t=0.0))
        flow.start_from(lambda x: exact(x, 0.0))
        t = 0.0
        while end - t > 1e-9:
            dt = (end - t) / ceil((end - t) / flow.stable_dt())
            blow(flow, partial(exact, t=t + dt))
            flow.advance(t, dt)
            t += dt
        computed = velocities(flow)
        return {"u, rms": rms(*(computed[d] - exact(faces(flow.grid, d), end)[..., d] for d in range(3)))}

    walls = [
        {"kind": "wall", "face": f"{axis}{side}", "velocity": (0.0,) * 3} for axis in "xyz" for side in "-+"
    ]
    wind = laminar_wind(viscosity, walls)
    return at_both_steps(wind, partial(flow_on, shape=(n, n, n), dx=SIZE / n), errors)


def blow(flow: FlowSolver, velocity: Callable[[np.ndarray], np.ndarray]) -> None:
    """Prescribe a velocity, a function of points [m], on all faces of the domain, without net flux."""
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
        target[..., d] -= side * out / sum(2 * prod(grid.shape) // n for n in grid.shape)
        flow.boundaries.target[d].from_numpy(target.astype(np.float32))


CASES = (
    Case(
        "taylor_green_2d",
        "decaying vortices, periodic",
        "Taylor & Green 1937, doi:10.1098/rspa.1937.0036",
        taylor_green,
        evidence="exact",
        coarse=(32, 64),
        fine=(32, 64, 128),
        expected=both_steps({"u, rms": SECOND_ORDER, "decay of the energy": SECOND_ORDER}),
    ),
    Case(
        "taylor_green_3d",
        "decaying vortices, extruded over four cells",
        "Taylor & Green 1937, doi:10.1098/rspa.1937.0036",
        partial(taylor_green, dim=3),
        evidence="exact",
        coarse=(),
        fine=(32, 64),
        expected=both_steps({"u, rms": SECOND_ORDER, "decay of the energy": SECOND_ORDER}),
    ),
    Case(
        "kovasznay",
        "steady flow behind a grid of rods, Re 40",
        "Kovasznay 1948, doi:10.1017/S0305004100023999",
        kovasznay,
        evidence="exact",
        coarse=(16, 32),
        fine=(32, 64),
        expected={"u, rms": SECOND_ORDER},
    ),
    Case(
        "drifting_vortices",
        "vortices that drift with the wind, without viscosity",
        "they only move",
        drifting,
        evidence="exact",
        coarse=(8, 16),
        fine=(8, 16, 32),
        expected=both_steps(
            {"energy lost": Expected(tolerance=0.05, at=16), "growth": Expected(tolerance=1e-5)}
        ),
    ),
    Case(
        "ethier_steinman",
        "vortices that go through a box, viscosity 0.05",
        "Ethier & Steinman 1994, doi:10.1002/fld.1650190502",
        partial(ethier_steinman, viscosity=0.05),
        evidence="exact",
        coarse=(8, 16),
        fine=(8, 16, 32),
        expected=both_steps({"u, rms": SECOND_ORDER}),
    ),
)
