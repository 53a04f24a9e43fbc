"""Heat and buoyancy (Boussinesq): conduction, the heated cavity and a turbulent thermal plume."""

from functools import partial
from math import pi

import numpy as np

from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.heat import HeatSolver
from taichi_plume.validation.case import SECOND_ORDER, Answer, Case, Comparison, Curve, Expected
from taichi_plume.validation.flow_cases import Errors, laminar_flow, rms, settle, velocities
from taichi_plume.validation.setups import cfd, flow_on, samples

POWER, RADIUS = 60.0, 0.08  # W, m: heat source of the plume
WIDTH, TALL = 1.8, 1.5  # m, of the box around the plume; its height over its width
ABOVE_FLOOR = 0.2  # m: middle of the source
HEIGHTS = (1.4, 1.8, 2.2)  # m above the source; lower, cells of 5 cm resolve no eddies of the plume
SETTLED, AVERAGED, SAMPLE = 20.0, 40.0, 0.1  # s
SEEDS = (0, 1)  # of the realisations; the mean of a single realisation varies by 5 %
EDGE = 0.02  # velocity at the edge of the plume over that on the axis
ENTRAINMENT = 0.153  # Q/(F^(1/3) z^(5/3)) in a plume, measured by Rouse, Yih & Humphreys 1952
WARM_AND_COLD = [{"face": "x-", "temperature": 300.5}, {"face": "x+", "temperature": 299.5}]


def heated(gravity: tuple[float, float] = (0.0, 0.0), **heat: object) -> dict[str, object]:
    """Return the keys of `wind.buoyancy` for air at 300 K; heat: keys of walls and heaters."""
    return {"gravity": gravity, "heat": {"reference": 300.0, **heat}}


def heat_of(flow: FlowSolver) -> HeatSolver:
    """Return the heat solver of a flow that computes temperature."""
    assert flow.heat is not None
    return flow.heat


def conduction(n: int) -> Errors:
    """Return errors of heat conduction between a warm and a cold wall, 1 m apart with n cells, early and at the end.

    theta/dT = 1/2 - x - sum_k sin(2 pi k x) exp(-(2 pi k)² alpha t)/(pi k); linear in the steady state.
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
    """Return errors of natural convection in a square cavity, 1 m wide, with a warm and a cold side.

    Floor and ceiling are adiabatic. Relative errors of the mean Nusselt number and, in alpha/L, of the largest u on the
    vertical and v on the horizontal line through the middle, at Pr 0.71. Times are in units of L/sqrt(g beta dT L).
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
        "Nusselt number, computed": nusselt,
    }


def peak(profile: np.ndarray) -> float:
    """Return the maximum of the parabola through a profile's largest value and its neighbours."""
    k = int(profile[1:-1].argmax()) + 1
    before, top, after = profile[k - 1 : k + 2]
    return float(top - (after - before) ** 2 / (8.0 * (after - 2.0 * top + before)))


def plume_flow(n: int, **keys: object) -> tuple[np.ndarray, FlowSolver]:
    """Return the mean upward velocity [m/s] on the horizontal faces of n² by 1.5 n cells with a plume, and the flow.

    The box has open sides and an open ceiling. The mean is over time and SEEDS. keys: further keys of `buoyancy.heat`.
    """
    middle = (0.5 * WIDTH, 0.5 * WIDTH, ABOVE_FLOOR)
    heat = {"heaters": [{"position": middle, "radius": RADIUS, "power": POWER}]} | keys
    still = [{"kind": "outlet", "face": face} for face in ("x-", "x+", "y-", "y+", "z+")]
    wind = cfd(still, buoyancy={"heat": heat})
    shape, count = (n, n, round(TALL * n)), round(AVERAGED / SAMPLE)
    mean = np.zeros(shape)
    for seed in SEEDS:
        flow = flow_on(wind, shape, WIDTH / n, seed)
        for _ in samples(flow, 0.0, SAMPLE, round(SETTLED / SAMPLE)):
            pass  # in the steps of a run: still air allows a first one in which the heater would make a large bubble
        for _ in samples(flow, SETTLED, SAMPLE, count):
            mean += flow.grid.read(flow.u[2])
    return mean / (count * len(SEEDS)), flow


def flow_rates(mean: np.ndarray, dx: float) -> tuple[np.ndarray, np.ndarray]:
    """Return heights of the horizontal faces above the source [m], and flow rates of the plume through them [m³/s].

    The plume ends at the ring in which the mean velocity falls below EDGE times that on the axis.
    """
    place = (np.arange(mean.shape[0]) + 0.5) * dx - 0.5 * mean.shape[0] * dx
    ring = (np.hypot(place[:, None], place) / dx).astype(int).ravel()  # one cell wide
    count = np.bincount(ring)
    rates = []
    for plane in np.moveaxis(mean, 2, 0):
        sums = np.bincount(ring, plane.ravel())
        profile = sums / count
        beyond = profile < EDGE * profile[0]
        rates.append(sums[: np.argmax(beyond) if beyond.any() else None].sum() * dx**2)
    return np.arange(mean.shape[2]) * dx - ABOVE_FLOOR, np.array(rates)


def thermal_plume(n: int, **keys: object) -> Answer:
    """Return errors of a turbulent thermal plume: Q = C F^(1/3) z^(5/3), F = g beta P/(rho c_p), z from the source.

    Morton, Taylor & Turner 1956 derived the law for a point source; C as measured by Rouse, Yih & Humphreys 1952
    (Tellus 4, 201). In the theory a wide source above which air rises from rest has the same origin.
    C = (6 a/5) (9 a/10)^(1/3) pi^(2/3) for top-hat profiles: C = 0.153 means an entrainment coefficient a of 0.12.
    The exponent is that of a fit over HEIGHTS. If the plume grows from an origin z0 instead, it is 5/3 z/(z - z0).
    """
    mean, flow = plume_flow(n, **keys)
    heat = heat_of(flow)
    height, rate = flow_rates(mean, flow.grid.dx)
    beta = 1.0 / heat.reference
    law = ENTRAINMENT * (9.81 * beta * POWER / heat.capacity) ** (1.0 / 3.0)
    rates = np.interp(HEIGHTS, height, rate)
    above = (height >= 0.3) & (height <= HEIGHTS[-1] + 1e-6)
    judged = (height > HEIGHTS[0] - 1e-6) & (height < HEIGHTS[-1] + 1e-6)
    exponent = float(np.polyfit(np.log(height[judged]), np.log(rate[judged]), 1)[0])
    return {
        **{
            f"flow rate at {z:g} m": abs(q / (law * z ** (5.0 / 3.0)) - 1.0)
            for z, q in zip(HEIGHTS, rates, strict=True)
        },
        "exponent from 5/3": abs(exponent - 5.0 / 3.0),
        **{f"Q at {z:g} m [m³/s]": float(q) for z, q in zip(HEIGHTS, rates, strict=True)},
        "exponent": exponent,
        "flow rate of the plume": Curve(
            "height [m]",
            "flow rate [m³/s]",
            height[above],
            rate[above],
            law * height[above] ** (5.0 / 3.0),
            log_x=True,
            log_y=True,
        ),
    }


def _heated_cavity(rayleigh: float, fine: tuple[int, ...], **reference: float) -> Case:
    return Case(
        f"heated_cavity_{rayleigh:.0e}".replace("+0", ""),
        f"steady flow between a warm and a cold wall, Ra {rayleigh:g}",
        "de Vahl Davis 1983, doi:10.1002/fld.1650030305",
        partial(heated_cavity, rayleigh=rayleigh, **reference),
        evidence="exact",
        compared=(Comparison("temperature", "Nusselt number, computed", measured=reference["flux"]),),
        coarse=(24,) if rayleigh > 1e4 else (),
        fine=fine,
        expected={
            norm: Expected(tolerance=0.015, at=fine[-1]) for norm in ("Nusselt number", "u_max", "v_max")
        },
    )


CASES = (
    Case(
        "conduction",
        "still air between a warm and a cold wall",
        "Fourier series; linear profile",
        conduction,
        evidence="exact",
        coarse=(16, 32),
        fine=(32, 64),
        expected={
            "theta / dT on the way, rms": SECOND_ORDER,
            "theta / dT in the end, largest": Expected(tolerance=5e-5),
        },
    ),
    _heated_cavity(1e4, (32, 64), flux=2.243, u_max=16.178, v_max=19.617),
    _heated_cavity(1e5, (32, 64), flux=4.519, u_max=34.73, v_max=68.59),
    Case(
        "thermal_plume",
        "flow rate of a turbulent plume over a warm ball in still air, cells of 5 and 3 cm",
        "Morton, Taylor & Turner 1956, doi:10.1098/rspa.1956.0011",
        thermal_plume,
        evidence="law",
        compared=(Comparison("temperature", "flow rate of the plume"),),
        coarse=(36,),
        fine=(36, 60),
        expected={
            **{f"flow rate at {z:g} m": Expected(tolerance=0.2) for z in HEIGHTS},
            "exponent from 5/3": Expected(tolerance=0.15),
        },
    ),
)
