"""Channel and duct flow (Poiseuille, Couette; no-slip walls) against series. n cells span the (short) width, 1 m."""

from functools import partial
from math import pi

import numpy as np

from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.case import SECOND_ORDER, Case, Expected
from taichi_plume.validation.flow_cases import Errors, advance, laminar_flow, periodic, rms, settle

TERMS = 2 * np.arange(200) + 1  # odd numbers
STEPS = 50  # over which a pressure is averaged

# b/a: u_max nu/(G a²) and u_mean nu/(G a²) of
# u = 16 G a²/(nu pi³) sum (-1)^((k-1)/2) [1 - cosh(k pi z/2a)/cosh(k pi b/2a)] cos(k pi y/2a)/k³ over odd k
DUCT = {1: (0.294685, 0.140577), 6: (0.499917, 0.298320)}


def across(flow: FlowSolver) -> tuple[np.ndarray, np.ndarray]:
    """Return y [m] and velocity u(y) [m/s] along x in the middle of a plane channel."""
    u = flow.grid.inner(flow.u[0].to_numpy()).astype(float)
    return flow.grid.centers()[0, :, 1], u[len(u) // 2]


def poiseuille(n: int) -> Errors:
    """Return errors of developed flow, mean speed U, Re 10: u = 6 U y (1 - y), pressure gradient -12 nu U.

    Air enters evenly at x = 0 and leaves at x = 4; the profile is sampled in the middle. The pressure is a mean over
    steps: rounding of velocities in single precision moves that of a single step by some 1e-5 of its gradient.
    """
    viscosity = 0.1
    openings = [{"kind": "inlet", "face": "x-", "speed": 1.0}, {"kind": "outlet", "face": "x+"}]
    flow = laminar_flow((4 * n, n), 1.0 / n, viscosity, openings)
    settle(flow, 1.0, 20.0)
    y, u = across(flow)
    p = np.zeros(4 * n)
    for _ in range(STEPS):
        flow.advance(0.0, flow.stable_dt())  # nothing depends on the time
        p += flow.grid.inner(flow.p.to_numpy()).mean(axis=1, dtype=float) / STEPS
    fall = (p[2 * n - n // 4] - p[2 * n + n // 4]) / (2 * (n // 4) / n)
    return {
        "u / u_max, largest": float(np.abs(u - 6.0 * y * (1.0 - y)).max() / 1.5),
        "pressure gradient": float(abs(fall / (12.0 * viscosity) - 1.0)),
    }


def poiseuille_start(n: int) -> Errors:
    """Return errors of air at rest that a constant force G per mass sets in motion, at t = 0.1 H²/nu.

    u = G/(2 nu) y (1 - y) - 4 G/(pi³ nu) sum sin(k pi y) exp(-k² pi² nu t)/k³ over odd k. Here G = 8 nu, u_max = 1.
    """
    end = 0.1
    flow = laminar_flow((4, n), 1.0 / n, 1.0, periodic("x"), acceleration=(8.0, 0.0))
    advance(flow, end)
    y, u = across(flow)
    k = TERMS[:, None]
    rest = np.sum(np.sin(k * pi * y) * np.exp(-((k * pi) ** 2) * end) / k**3, axis=0)
    return {"u, rms": rms(u - 4.0 * y * (1.0 - y) + 32.0 / pi**3 * rest)}


def couette_start(n: int) -> Errors:
    """Return errors of air at rest beside a wall that starts to slide with 1 m/s, at t = 0.1 H²/nu.

    u = y + 2/pi sum (-1)^k/k sin(k pi y) exp(-k² pi² nu t).
    """
    end = 0.1
    wall = {"kind": "wall", "face": "y+", "velocity": (1.0, 0.0)}
    flow = laminar_flow((4, n), 1.0 / n, 1.0, [*periodic("x"), wall])
    advance(flow, end)
    y, u = across(flow)
    k = np.arange(1, 200)[:, None]
    series = np.sum((-1.0) ** k / k * np.sin(k * pi * y) * np.exp(-((k * pi) ** 2) * end), axis=0)
    return {"u, rms": rms(u - y - 2.0 / pi * series)}


def duct(n: int, aspect: int) -> Errors:
    """Return errors of steady flow along a duct with sides of 1 and `aspect` m, driven by a force G per mass.

    A quarter of the duct is solved, with slip on the planes of symmetry. a = 0.5 m, half the short side.
    """
    symmetric = [{"kind": "slip", "face": face} for face in ("x+", "y+")]
    force = 8.0
    flow = laminar_flow(
        (aspect * n // 2, n // 2, 4), 1.0 / n, 1.0, periodic("z") + symmetric, acceleration=(0.0, 0.0, force)
    )
    settle(flow, 0.1, 3.0)
    u = flow.grid.inner(flow.u[2].to_numpy()).astype(float)[:, :, 0]
    fastest, mean = DUCT[aspect]
    ratio = on_the_axis(u) / u.mean()
    return {
        "u_max / u_mean": float(abs(ratio / (fastest / mean) - 1.0)),
        "u_mean": float(abs(u.mean() / (mean * force * 0.5**2) - 1.0)),
    }


def on_the_axis(u: np.ndarray) -> float:
    """Return a profile's value at the upper end of its axes, on a plane of symmetry, by fourth-order extrapolation."""
    for _ in range(u.ndim):
        u = (9.0 * u[-1] - u[-2]) / 8.0
    return float(u)


HALF_A_PERCENT = Expected(tolerance=0.005, at=32)  # of laminar profiles, cells across the duct


def _duct(aspect: int) -> Case:
    return Case(
        f"duct_{aspect}",
        f"steady flow along a duct with sides 1 : {aspect}",
        "Fourier series",
        partial(duct, aspect=aspect),
        evidence="exact",
        coarse=(16,) if aspect == 1 else (),
        fine=(16, 32),
        expected={"u_max / u_mean": HALF_A_PERCENT, "u_mean": HALF_A_PERCENT},
    )


CASES = (
    Case(
        "poiseuille",
        "developed flow in a channel, Re 10",
        "parabola",
        poiseuille,
        evidence="exact",
        coarse=(8, 16),
        fine=(16, 32),
        expected={
            "u / u_max, largest": Expected(order=1.9, tolerance=0.005, at=32),
            "pressure gradient": Expected(order=1.75, tolerance=0.005, at=32),
        },
    ),
    Case(
        "poiseuille_start",
        "a force sets the air of a channel in motion",
        "Fourier series",
        poiseuille_start,
        evidence="exact",
        coarse=(32, 64),
        fine=(32, 64),
        expected={"u, rms": SECOND_ORDER},
    ),
    Case(
        "couette_start",
        "a wall starts to slide",
        "Fourier series",
        couette_start,
        evidence="exact",
        coarse=(8, 16),
        fine=(32, 64),
        expected={"u, rms": SECOND_ORDER},
    ),
    _duct(1),
    _duct(6),
)
