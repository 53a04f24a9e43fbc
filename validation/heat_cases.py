"""Warm air with known answers. Each function solves a case at a resolution and returns its errors by norm."""

from math import pi
from typing import Any

import numpy as np

from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.heat import HeatSolver
from taichi_plume.validation.flow_cases import Errors, laminar_flow, rms, settle, velocities

WARM_AND_COLD = [{"face": "x-", "temperature": 300.5}, {"face": "x+", "temperature": 299.5}]


def heated(gravity: tuple[float, float] = (0.0, 0.0), **heat: Any) -> dict[str, Any]:
    """Buoyancy of air at 300 K, with walls and heaters as in a scenario."""
    return {"gravity": gravity, "heat": {"reference": 300.0, **heat}}


def heat_of(flow: FlowSolver) -> HeatSolver:
    """The temperature of a flow that has one."""
    assert flow.heat is not None
    return flow.heat


def conduction(n: int) -> Errors:
    """Air at rest between a warm and a cold wall, 1 m apart, after the time in which warmth spreads half as far.

    theta/dT = 1/2 - x - sum_k sin(2 pi k x) exp(-(2 pi k)² alpha t)/(pi k), the linear profile in the end.
    """
    diffusivity = 1e-3
    warm = heated(walls=WARM_AND_COLD, diffusivity=diffusivity)
    heat = heat_of(laminar_flow((n, 3), 1.0 / n, 1e-6, [{"kind": "periodic", "axis": "y"}], buoyancy=warm))
    x = (np.arange(n) + 0.5) / n
    k = np.arange(1, 60)[:, None]
    end = 0.02 / diffusivity
    heat.advance(0.0, end)
    decay = np.exp(-((2.0 * pi * k) ** 2) * diffusivity * end)
    exact = 0.5 - x - (np.sin(2.0 * pi * k * x) * decay / (pi * k)).sum(axis=0)
    early = rms(heat.grid.read(heat.theta)[:, 1] - exact)
    heat.advance(end, 1.0 / diffusivity)
    late = np.abs(heat.grid.read(heat.theta)[:, 1] - (0.5 - x)).max()
    return {"theta / dT on the way, rms": early, "theta / dT in the end, largest": float(late)}


def heated_cavity(n: int, rayleigh: float, flux: float, u_max: float, v_max: float) -> Errors:
    """Steady flow in a square box, 1 m wide, with a warm and a cold side and an adiabatic floor and ceiling.

    Relative errors of the mean Nusselt number and, in alpha/L, of the largest u on the vertical and v on the horizontal
    line through the middle, at Pr 0.71. Times are in units of L/sqrt(g beta dT L).
    """
    prandtl = 0.71
    diffusivity = (rayleigh * prandtl) ** -0.5
    warm = heated((0.0, -300.0), walls=WARM_AND_COLD, diffusivity=diffusivity)  # g beta dT = 1 m/s²
    flow = laminar_flow((n, n), 1.0 / n, prandtl * diffusivity, [], buoyancy=warm)
    heat = heat_of(flow)
    settle(flow, 2.0, 400.0)
    u, v = velocities(flow)
    theta = heat.grid.read(heat.theta).astype(float)
    across = v[:, n // 2]
    up = u[n // 2]
    nusselt = float(((0.5 - theta[0]) * 2.0 * n).mean())
    return {
        "Nusselt number": abs(nusselt / flux - 1.0),
        "u_max": abs(peak(up) / diffusivity / u_max - 1.0),
        "v_max": abs(peak(across) / diffusivity / v_max - 1.0),
    }


def peak(profile: np.ndarray) -> float:
    """Maximum of a parabola through the largest value and its neighbours."""
    k = int(profile[1:-1].argmax()) + 1
    before, top, after = profile[k - 1 : k + 2]
    return float(top - (after - before) ** 2 / (8.0 * (after - 2.0 * top + before)))
