"""Lid-driven cavity: steady flow in a square box, 1 m wide, whose lid slides along x with 1 m/s.

Reference: streamfunction and Newton's method on 256² and 512² nodes, extrapolated; estimated error 3e-6 (Re 100),
5e-5 (400), 1.6e-4 (1000). The extrema agree with Botella & Peyret 1998 and Marchi et al. 2009 to 1e-5. The nodes are
those of Ghia, Ghia & Shin 1982, whose values have errors of up to 0.007 (u) and 0.018 (v), besides two misprints.
"""

from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.case import Case, Expected
from taichi_plume.validation.flow_cases import (
    Errors,
    at_both_steps,
    both_steps,
    laminar_wind,
    settle,
    velocities,
)
from taichi_plume.validation.setups import flow_on

# 128 y, and u(0.5, y) at Re 100, 400, 1000
U = np.array([
    (128, 1.00000, 1.00000, 1.00000),
    (125, 0.84348, 0.76031, 0.66400),
    (124, 0.79161, 0.68676, 0.58040),
    (123, 0.74071, 0.62022, 0.51721),
    (122, 0.69118, 0.56174, 0.47247),
    (109, 0.23644, 0.29200, 0.33718),
    (94, 0.00415, 0.16254, 0.18864),
    (79, -0.13881, 0.02102, 0.05700),
    (64, -0.20915, -0.11505, -0.06206),
    (58, -0.21398, -0.17145, -0.10818),
    (36, -0.15765, -0.32872, -0.28043),
    (22, -0.10173, -0.24375, -0.38858),
    (13, -0.06441, -0.14614, -0.30037),
    (9, -0.04663, -0.10332, -0.22293),
    (8, -0.04198, -0.09260, -0.20233),
    (7, -0.03722, -0.08181, -0.18125),
    (0, 0.00000, 0.00000, 0.00000),
])  # fmt: skip

# 128 x, and v(x, 0.5)
V = np.array([
    (128, 0.00000, 0.00000, 0.00000),
    (124, -0.06229, -0.12537, -0.22834),
    (123, -0.07790, -0.16141, -0.29338),
    (122, -0.09334, -0.19809, -0.35513),
    (121, -0.10851, -0.23467, -0.41030),
    (116, -0.17716, -0.38984, -0.52643),
    (110, -0.23371, -0.45383, -0.42640),
    (103, -0.25354, -0.38563, -0.32020),
    (64, 0.05754, 0.05206, 0.02580),
    (30, 0.17956, 0.30345, 0.32539),
    (29, 0.17936, 0.30383, 0.33404),
    (20, 0.16480, 0.28352, 0.37693),
    (12, 0.12638, 0.23166, 0.33299),
    (10, 0.11178, 0.21100, 0.30996),
    (9, 0.10360, 0.19881, 0.29630),
    (8, 0.09481, 0.18513, 0.28072),
    (0, 0.00000, 0.00000, 0.00000),
])  # fmt: skip

COLUMN = {100: 1, 400: 2, 1000: 3}


def cavity(n: int, reynolds: int) -> Errors:
    """Return the largest errors of u(0.5, y) and v(x, 0.5) at the tables' nodes; n (even) cells per side."""
    lid = {"kind": "wall", "face": "y+", "velocity": (1.0, 0.0)}
    wind = laminar_wind(1.0 / reynolds, [lid])

    def errors(flow: FlowSolver) -> Errors:
        settle(flow, 2.0, 200.0)
        u, v = velocities(flow)
        return {
            "u(0.5, y), largest": error(u[n // 2], U, COLUMN[reynolds], 1.0),
            "v(x, 0.5), largest": error(v[:, n // 2], V, COLUMN[reynolds], 0.0),
        }

    return at_both_steps(wind, partial(flow_on, shape=(n, n), dx=1.0 / n), errors)


def error(profile: np.ndarray, table: np.ndarray, column: int, end: float) -> float:
    """Return the largest difference of a profile at cell centres (0 at 0, `end` at 1) from a column of a table."""
    places = (np.arange(len(profile)) + 0.5) / len(profile)
    spline = CubicSpline([0.0, *places, 1.0], [0.0, *profile, end])
    return float(np.abs(spline(table[:, 0] / 128.0) - table[:, column]).max())


def _cavity(reynolds: int, fine: tuple[int, ...]) -> Case:
    return Case(
        f"cavity_{reynolds}",
        f"steady flow in a box with a sliding lid, Re {reynolds}",
        "streamfunction and Newton, see cavity.py",
        partial(cavity, reynolds=reynolds),
        evidence="exact",
        coarse=() if reynolds == 400 else (32,),
        fine=fine,
        expected=both_steps({"u(0.5, y), largest": Expected(tolerance=0.005, at=fine[-1])}),
    )


CASES = (_cavity(100, (32, 64)), _cavity(400, (64, 128)), _cavity(1000, (64, 128)))
