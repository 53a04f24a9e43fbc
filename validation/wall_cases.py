"""Wall functions: turbulent boundary layers and channel flow below the resolution. n is cells per metre."""

import numpy as np

from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.case import Answer, Case, Curve, Expected
from taichi_plume.validation.flow_cases import periodic
from taichi_plume.validation.setups import Openings, advance, cfd, flow_on, samples

VISCOSITY = 1.56e-5  # m²/s
HALF = 0.5  # m, half the height of the channel
OVER_A_FLOOR = (
    {"kind": "inlet", "face": "x-", "speed": 0.5},
    {"kind": "outlet", "face": "x+"},
    *({"kind": "slip", "face": face} for face in ("y-", "y+", "z+")),
)


def _flow(shape: tuple[int, ...], n: int, openings: Openings, **keys: object) -> FlowSolver:
    return flow_on(cfd(openings, viscosity=VISCOSITY, **keys), shape, 1.0 / n)


def _mean_profile(flow: FlowSolver, start: float, end: float, parts: int, at: int | slice) -> np.ndarray:
    """Return the mean of u along x over the height [m/s] from `start` to `end` [s], at faces `at` along x."""
    result, step = np.zeros(flow.grid.shape[-1]), (end - start) / parts
    for _ in samples(flow, start, step, parts):
        u = flow.grid.read(flow.u[0])[at].astype(float)
        result = result + u.reshape(-1, u.shape[-1]).mean(axis=0) / parts
    return result


def floor(n: int, turbulence: str = "smagorinsky") -> Answer:
    """Return errors of a boundary layer in uniform wind of 0.5 m/s along a floor, 2 m behind the inlet.

    Turbulent and laminar plates have 0.90 to 1.00 of the outer wind at 5 cm, and displacement thicknesses of 10.2
    (Schlichting's 0.0463 x/Re^0.2 from the edge on) and 13.6 mm (Blasius).
    """
    flow = _flow((3 * n, 4, n), n, OVER_A_FLOOR, turbulence={"kind": turbulence})
    advance(flow, 8.0)
    u = _mean_profile(flow, 8.0, 12.0, 20, 2 * n)
    z = (np.arange(n) + 0.5) / n
    outer = u[(z > 0.35) & (z < 0.65)].mean()
    displaced = float((1.0 - u / outer)[z < 0.5].sum() / n)
    return {
        "u at 5 cm / 0.95 of the outer wind": float(abs(np.interp(0.05, z, u) / (0.95 * outer) - 1.0)),
        "displacement / 11 mm": abs(displaced / 0.011 - 1.0),
    }


def power_law_mean(x: float, speed: float, heights: np.ndarray) -> np.ndarray:
    """Return the mean over each cell of u/U = (z/delta)^(1/7), the turbulent layer on a smooth plate.

    delta = 0.37 x Re_x^(-1/5) at distance x [m] from the edge, in wind of U = `speed` [m/s] (Prandtl; Schlichting &
    Gersten 2017). heights: cell faces above the plate [m], ascending.
    """
    delta = 0.37 * x * (speed * x / VISCOSITY) ** -0.2
    inside = np.minimum(heights, delta)
    flow_rate = 7.0 / 8.0 * inside * (inside / delta) ** (1.0 / 7.0) + (heights - inside)
    return np.diff(flow_rate) / np.diff(heights)


def floor_layer(n: int) -> Answer:
    """Return errors of the layer along a floor in uniform wind of 0.5 m/s: mean u of the lowest cell at 1, 2 and 3 m.

    The layer is thinner than two cells, and a cell stores the mean of u. Linear interpolation between cell centres cuts
    the bend of the profile: at 5 cm, a cell face for n = 20, the interpolated exact means are 0.03 to 0.06 below the
    law itself. Both are reported.
    """
    flow = _flow((4 * n, 4, n), n, OVER_A_FLOOR)
    advance(flow, 12.0)
    sides = np.arange(n + 1) / n
    z = 0.5 * (sides[1:] + sides[:-1])
    answer: dict[str, float] = {}
    for x in (1, 2, 3):
        u = flow.grid.read(flow.u[0])[x * n].astype(float).mean(axis=0)
        outer = u[(z > 0.15) & (z < 0.5)].mean()
        law = power_law_mean(x, outer, sides)
        answer[f"mean of the lowest cell at {x} m"] = float(abs(u[0] / outer - law[0]))
        answer[f"read at 5 cm at {x} m, over the outer wind"] = float(np.interp(0.05, z, u) / outer)
        answer[f"the law's means, read at 5 cm at {x} m"] = float(np.interp(0.05, z, law))
    return answer


def log_layer(n: int, reynolds: float = 1000.0) -> Answer:
    """Return errors of turbulent channel flow, walls 1 m apart: u+ = ln(y+)/0.41 + 5.2; `reynolds`: Re_tau.

    A body force drives the flow, and the turbulence sustains itself. u is averaged over 8 times HALF/u_tau after 10
    such times, and compared with the law's mean over each cell.
    """
    u_tau = reynolds * VISCOSITY / HALF
    turnover = HALF / u_tau
    flow = _flow((2 * n, n, n), n, periodic("xy"), acceleration=(u_tau**2 / HALF, 0.0, 0.0))

    def law(y: np.ndarray) -> np.ndarray:
        return u_tau * (np.log(y * u_tau / VISCOSITY) / 0.41 + 5.2)

    def stirred(x: np.ndarray) -> np.ndarray:
        """Return the law plus waves of amplitude u_tau as initial velocity."""
        u = np.zeros_like(x)
        u[..., 0] = law(np.clip(np.minimum(x[..., 2], 1.0 - x[..., 2]), 0.01, None))
        rng = np.random.default_rng(0)
        for _ in range(40):
            waves, phase = rng.integers(1, 6, 3), rng.uniform(0.0, 2.0 * np.pi, 2)
            wave = np.sin(np.pi * waves[0] * x[..., 0] + phase[0])
            wave *= np.sin(2.0 * np.pi * waves[1] * x[..., 1] + phase[1]) * np.sin(
                np.pi * waves[2] * x[..., 2]
            )
            u += 0.5 * u_tau * rng.standard_normal(3) * wave[..., None]
        return u

    flow.start_from(stirred)
    advance(flow, 10.0 * turnover)
    u = _mean_profile(flow, 10.0 * turnover, 18.0 * turnover, 200, slice(None))
    u, y = 0.5 * (u + u[::-1])[: n // 2], (np.arange(n // 2) + 0.5) / n
    sides = np.arange(n // 2 + 1) / n
    whole = sides * (law(np.maximum(sides, 1e-9)) - u_tau / 0.41)  # the law's integral from the wall
    expected = np.diff(whole) * n
    return {
        "u / law, first cell": float(abs(u[0] / expected[0] - 1.0)),
        "u / law, largest": float(np.abs(u / expected - 1.0).max()),
        "mean flow in a channel": Curve(
            "y+", "u+", y * u_tau / VISCOSITY, u / u_tau, expected / u_tau, log_x=True
        ),
    }


CASES = (
    Case(
        "floor",
        "even wind along a floor whose friction is below the cells",
        "flat plates: Blasius 1908; Schlichting & Gersten 2017, doi:10.1007/978-3-662-52919-5",
        floor,
        evidence="law",
        coarse=(20,),
        fine=(20, 40),
        expected={
            "u at 5 cm / 0.95 of the outer wind": Expected(tolerance=0.053),
            "displacement / 11 mm": Expected(tolerance=0.36),
        },
    ),
    Case(
        "floor_layer",
        "growth of the layer along a floor, thinner than two cells, over 3 m",
        "1/7-power law of a turbulent flat plate; Schlichting & Gersten 2017, doi:10.1007/978-3-662-52919-5",
        floor_layer,
        evidence="law",
        coarse=(10, 20),
        fine=(10, 13, 20),
        expected={f"mean of the lowest cell at {x} m": Expected(tolerance=0.04) for x in (1, 2, 3)},
    ),
    Case(
        "log_layer",
        "a turbulent channel whose walls are below the cells, Re_tau 1000",
        "law of the wall",
        log_layer,
        evidence="law",
        coarse=(16,),
        fine=(16, 24),
        expected={
            "u / law, first cell": Expected(tolerance=0.1),
            "u / law, largest": Expected(tolerance=0.1),
        },
    ),
)
