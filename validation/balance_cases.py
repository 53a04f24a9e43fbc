"""Conservation of mass: in computed flows uniform gas stays uniform, and no gas is lost."""

from functools import partial
from math import ceil

import numpy as np

from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.arena import ARENA, arena
from taichi_plume.validation.case import Answer, Case, Curve, Expected
from taichi_plume.validation.dispersion_cases import EXACT, NONE, concentrations, ride
from taichi_plume.validation.flow_cases import periodic
from taichi_plume.validation.setups import cfd, gas_on


def well_mixed(n: int, dim: int) -> Answer:
    """Return errors of initially uniform gas in a periodic flow past obstacles: frozen, then unsteady.

    The room is that of `arena`, n cells long, periodic, driven by a body force. The pressure tolerance is tighter than
    usual: the remaining divergence adds up along the path of the air, to 6e-5 with the usual tolerance in 3-D.
    """
    grid, air = arena((n, 3 * n // 4, n // 8)[:dim], True, periodic=(True, True, False)[:dim])
    wind = cfd(periodic("xy"), acceleration=(0.3, 0.05, 0.0)[:dim], tolerance=1e-6)
    flow = FlowSolver(wind, grid, air)
    gas = gas_on(grid, flow, air)
    gas.start_from(lambda x: np.ones(x.shape[:-1]))
    t = 0.0
    while t < 4.0:
        dt = min(0.05, flow.stable_dt(t))
        flow.advance(t, dt)
        t += dt
    ride(gas, 2.0, flow.stable_dt())
    answer = {"c, steady flow": float(np.abs(concentrations(gas)[~air.solid] - 1.0).max())}
    while t < 6.0:
        dt = min(0.05, flow.stable_dt(t))
        flow.advance(t, dt)
        gas.advance(t, dt)
        t += dt
    return answer | {"c, unsteady flow": float(np.abs(concentrations(gas)[~air.solid] - 1.0).max())}


def mass_budget(n: int, dim: int, end: float) -> Answer:
    """Return the mass balance of a source in the odour arena with cut cells, gusts and openings; n cells along x.

    Norms at `end` [s]: mass emitted less mass in the room and outflow, over mass emitted; concentrations below 0.
    """
    grid, air = arena((n, 3 * n // 4, n // 8)[:dim], True)
    gusts = {"turbulence_intensity": 0.08, "turbulence_length": 0.15}
    flow = FlowSolver(cfd([ARENA[0] | gusts, ARENA[1]]), grid, air)
    source = {"position": (1.7, 2.0, 0.1)[:dim], "rate": 2e-5, "radius": 0.05}
    gas = gas_on(grid, flow, air, sources=[source])
    t, least, rows = 0.0, 0.0, [(0.0, 0.0, 0.0)]
    while end - t > 1e-9 * end:
        dt = (end - t) / ceil((end - t) / flow.stable_dt(t))
        flow.advance(t, dt)
        gas.advance(t, dt)
        t += dt
        if t - rows[-1][0] >= 0.01 * end or t >= end:
            least = min(least, gas.least())
            budget = gas.budget()
            rows.append((t, budget["emitted_kg"], budget["in_domain_kg"] + budget["outflow_kg"]))
    times, emitted, mass = np.transpose(rows)
    return {
        "mass": float(np.abs(mass[1:] / emitted[1:] - 1.0).max()),
        "below 0": max(0.0, -least),
        "unaccounted for": Curve(
            "t [s]", "mass over the mass emitted", times[1:], mass[1:] / emitted[1:], np.ones(len(times) - 1)
        ),
    }


def _well_mixed(dim: int) -> Case:
    return Case(
        f"well_mixed_{dim}d",
        "uniform gas in turbulent air between obstacles",
        "stays uniform",
        partial(well_mixed, dim=dim),
        evidence="exact",
        coarse=(40,) if dim == 2 else (20,),
        fine=(40, 80) if dim == 2 else (20, 40),
        expected={norm: Expected(tolerance=1e-5) for norm in ("c, steady flow", "c, unsteady flow")},
    )


def _mass_budget(name: str, dim: int, end: float, coarse: tuple[int, ...], fine: int) -> Case:
    return Case(
        f"mass_budget_{name}",
        f"a source in the arena with gusts, obstacles and openings, {end:g} s in {dim}-D",
        "conservation of mass",
        partial(mass_budget, dim=dim, end=end),
        evidence="exact",
        coarse=coarse,
        fine=(fine // 2, fine),
        expected={"mass": EXACT, "below 0": NONE},
    )


CASES = (
    _well_mixed(2),
    _well_mixed(3),
    _mass_budget("2d", 2, 10.0, (40,), 80),
    _mass_budget("3d", 3, 4.0, (20,), 40),
    _mass_budget("300_s", 2, 300.0, (), 80),
)
