"""Boundary conditions in time: inflow turbulence and its decay, Stokes' second problem."""

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from math import pi, sqrt

import numpy as np

from taichi_plume.validation.case import Answer, Case, Curve, Expected
from taichi_plume.validation.channel_cases import across
from taichi_plume.validation.flow_cases import Errors, laminar_flow, periodic, rms
from taichi_plume.validation.setups import advance, cfd, flow_on

SPEED, INTENSITY = 0.5, 0.1  # m/s; over the speed
DUCT, BEHIND = 4.0, 0.2  # m: length of the duct; distance at which the intensity is judged
SETTLED, SAMPLED = 8.0, 40.0  # s
EXPONENT, DISSIPATION = 1.2, 0.7  # decay behind grids (1.0 to 1.4); epsilon L/u'³ (0.5 to 0.9)
CARRIED = 4.0  # cells: shortest integral length on the grid


def virtual_origin(length: float) -> float:
    """Return x0 [m] of the decay u'² ~ (x + x0)^-n behind the inlet, from dk/dt = -DISSIPATION u'³/L; length: L [m]."""
    return 1.5 * EXPONENT * length / (DISSIPATION * INTENSITY)


def integral_length(planes: Sequence[np.ndarray], apart: float) -> float:
    """Return the integral length [m] of velocities sampled `apart` [m], up to the first zero of the correlation."""
    values = np.array(planes).reshape(len(planes), -1)
    values -= values.mean()
    lagged = np.array(
        [(values[: len(values) - n] * values[n:]).mean() for n in range(min(200, len(values) // 2))]
    )
    known = lagged[: int(np.argmax(lagged < 0.0)) or len(lagged)] / lagged[0]
    return apart * float(known.sum() - 0.5)


def inflow_turbulence(n: int, length: float) -> Answer:
    """Return errors of inflow turbulence with integral length `length` [m] in a periodic duct, n cells per metre."""
    inlet = {"turbulence_intensity": INTENSITY, "turbulence_length": length, "speed": SPEED}
    openings = [{"kind": "inlet", "face": "x-"} | inlet, {"kind": "outlet", "face": "x+"}, *periodic("yz")]
    flow = flow_on(cfd(openings), (round(DUCT * n), n, n), 1.0 / n)
    grid, t, dt = flow.grid, SETTLED, 0.8 / (n * SPEED)
    advance(flow, t)
    count = round(SAMPLED / dt)
    total, squares = np.zeros((3, *grid.shape)), np.zeros((3, *grid.shape))
    at_inlet, inflows = [], []
    for _ in range(count):
        advance(flow, t + dt, t)
        t += dt
        u = np.array([grid.read(field) for field in flow.u], float)
        total += u
        squares += u**2
        at_inlet.append(u[0, 0])
        inflows.append(u[0, 0].mean())
    # variance along the duct, which includes fluctuations of the inflow rate
    energy = squares.mean(axis=(2, 3)) / count - (total.mean(axis=(2, 3)) / count) ** 2
    x = np.arange(len(energy[0])) / n
    mean = energy.mean(axis=0)
    behind, far = round(BEHIND * n), round(3.0 * n)
    scale = max(length, CARRIED / n)
    deviation = INTENSITY * SPEED
    beyond = x + virtual_origin(scale)
    law = (beyond[behind:] / beyond[behind]) ** (-0.5 * EXPONENT)
    fitted = slice(behind, far + 1)
    exponent, _ = np.polyfit(np.log(beyond[fitted]), np.log(mean[fitted]), 1)
    return {
        "intensity at the inlet": float(abs(sqrt(mean[0]) / deviation - 1.0)),
        "its components, largest": float(np.abs(np.sqrt(energy[:, 0]) / deviation - 1.0).max()),
        "intensity at 0.2 m": float(abs(sqrt(mean[behind]) / deviation - 1.0)),
        "integral length at the inlet": float(abs(integral_length(at_inlet, dt * SPEED) / scale - 1.0)),
        "flow rate": float(np.abs(np.array(inflows) / SPEED - 1.0).max()),
        "exponent of the decay": -float(exponent),
        "u' at 3 m over 0.2 m": float(sqrt(mean[far] / mean[behind])),
        "turbulence behind the inlet": Curve(
            "x [m]", "u'/U", x[behind:], np.sqrt(mean[behind:]) / SPEED, law * sqrt(mean[behind]) / SPEED
        ),
    }


def oscillating_wall(n: int) -> Errors:
    """Return errors of air between a wall at rest and a wall that slides with V = sin wt, 1 m apart with n cells.

    u = V y + sum b_k sin k pi y, db_k/dt = -k² pi² b_k + 2 (-1)^k/(k pi) dV/dt; Stokes layer sqrt(2 nu/w) = 0.3 m.
    """
    rate = 2.0 / 0.3**2
    knots = np.linspace(0.0, 2.0 * pi / rate, 401)
    steps = [{"at": a, "velocity": (float(np.sin(rate * b)), 0.0)} for a, b in pairwise(knots)]
    wall = {"kind": "wall", "face": "y+", "velocity": (0.0, 0.0), "ramp": knots[1], "schedule": steps}
    flow = laminar_flow((4, n), 1.0 / n, 1.0, [*periodic("x"), wall])
    end = float(knots[-1])
    advance(flow, end)
    y, u = across(flow)
    k = np.arange(1, 200)[:, None]
    decay = (k * pi) ** 2
    answer = decay * np.cos(rate * end) + rate * np.sin(rate * end) - decay * np.exp(-decay * end)
    parts = 2.0 * (-1.0) ** k / (k * pi) * rate * answer / (decay**2 + rate**2) * np.sin(k * pi * y)
    return {"u, rms": rms(u - np.sin(rate * end) * y - parts.sum(axis=0))}


def _turbulence(length: float) -> Case:
    return Case(
        f"inflow_turbulence_{100 * length:.0f}_cm",
        f"intensity 10 % and length {100 * length:.0f} cm at the inlet and behind it",
        "as prescribed; decay behind grids, Comte-Bellot & Corrsin 1966, doi:10.1017/S0022112066000338",
        partial(inflow_turbulence, length=length),
        evidence="exact",
        coarse=(20,) if length == 0.2 else (),
        fine=(25,),
        # intensities over 40 s have a standard error of 1.5 %
        expected={
            "intensity at the inlet": Expected(tolerance=0.04),
            "its components, largest": Expected(tolerance=0.06),
            "intensity at 0.2 m": Expected(tolerance=0.05),
            "integral length at the inlet": Expected(tolerance=0.2),
            "flow rate": Expected(tolerance=1e-5),
        },
    )


CASES = (
    _turbulence(0.1),
    _turbulence(0.2),
    Case(
        "oscillating_wall",
        "a wall slides to and fro",
        "Stokes' second problem between two walls",
        oscillating_wall,
        evidence="exact",
        coarse=(16, 32),
        fine=(32, 64),
        expected={"u, rms": Expected(order=1.7, tolerance=3e-4, at=32)},
    ),
)
