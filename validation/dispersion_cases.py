"""Convection-diffusion of gas on the grid: moments of puffs, Taylor dispersion, shapes in solid-body rotation."""

from functools import partial
from math import ceil, pi, sqrt

import numpy as np

from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.prescribed_wind import PrescribedWind
from taichi_plume.validation.case import SECOND_ORDER, Answer, Case, Curve, Expected
from taichi_plume.validation.flow_cases import Errors, rms
from taichi_plume.validation.setups import ethanol, gas_on, uniform

SHORT = {"koren": 0.4, "weno5": 0.2}
"""Courant numbers by convection scheme; with Heun's method short waves of weno5 are unstable from 0.4 on."""


def ride(gas: EulerianSolver, span: float, longest: float) -> None:
    """Advance the gas by `span` [s] in a steady wind, in equal steps of at most `longest` [s]."""
    steps = ceil(span / longest - 1e-9)
    for _ in range(steps):
        gas.advance(0.0, span / steps)


def concentrations(gas: EulerianSolver) -> np.ndarray:
    """Return the concentrations of the cells [kg/m³] in f64."""
    return gas.grid.read(gas.c).astype(float)


def around(x: np.ndarray, middle: float | np.ndarray, period: float) -> np.ndarray:
    """Return x - middle by the shortest way in a domain of this period."""
    return (x - middle + 0.5 * period) % period - 0.5 * period


# ---------------------------------------------------------------- moments of puffs


def gaussian_puff(n: int, dim: int = 2, speed: float = 0.0) -> Errors:
    """Return errors of a puff of unit mass that spreads and drifts in a box 1 m wide, n cells per metre.

    c = (2 pi s²)^(-dim/2) exp(-|x - x0 - U t|²/(2 s²)), s² = s0² + 2 D t.
    """
    diffusivity, s0, end = 5e-4, 0.06, 4.0
    start = np.full(dim, 0.5) - speed * end / 2 * np.eye(dim)[0]

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        variance = s0**2 + 2.0 * diffusivity * t
        offset = x - start - speed * t * np.eye(dim)[0]
        return np.exp(-(offset**2).sum(-1) / (2.0 * variance)) / (2.0 * pi * variance) ** (dim / 2)

    grid = Grid((n,) * dim, 1.0 / n)
    gas = gas_on(grid, uniform(grid, speed), species=ethanol(diffusivity))
    gas.start_from(lambda x: exact(x, 0.0))
    gas.advance(0.0, end)
    points, reference = grid.centers(), exact(grid.centers(), end)
    c = grid.inner(gas.c.to_numpy()).astype(float)
    mass = c.sum() * grid.cell_volume
    along = points[..., 0]
    mean = (c * along).sum() / c.sum()
    variance = (c * (along - mean) ** 2).sum() / c.sum()
    return {
        "c / c_max, rms": rms(c - reference) / float(reference.max()),
        "mass": float(abs(mass - 1.0)),
        "variance along x": float(abs(variance / (s0**2 + 2.0 * diffusivity * end) - 1.0)),
    }


def puff_moments(n: int, convection: str) -> Answer:
    """Return errors of the moments of a puff that spreads and drifts askew in a periodic box of n² cells, 1 m wide.

    Mass, mean, variance, skewness and kurtosis along x; exact: 1, x0 + U t, s0² + 2 D t, 0, 3.
    """
    velocity, diffusivity, s0, end = np.array([0.1, 0.05]), 5e-4, 0.07, 3.0
    grid = Grid((n, n), 1.0 / n, periodic=(True, True))
    wind = PrescribedWind(lambda x: np.broadcast_to(velocity, x.shape), grid)
    gas = gas_on(grid, wind, convection=convection, species=ethanol(diffusivity))

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        variance = s0**2 + 2.0 * diffusivity * t
        offset = around(x, 0.5 + velocity * t, 1.0)
        return np.exp(-(offset**2).sum(axis=-1) / (2.0 * variance)) / (2.0 * pi * variance)

    gas.start_from(lambda x: exact(x, 0.0))
    ride(gas, end, SHORT[convection] * grid.dx / velocity.sum())
    c, points = concentrations(gas), grid.centers()
    offset = around(points[..., 0], 0.5 + velocity[0] * end, 1.0)
    mean = (c * offset).sum() / c.sum()
    m2, m3, m4 = (((c * (offset - mean) ** k).sum() / c.sum()) for k in (2, 3, 4))
    variance = s0**2 + 2.0 * diffusivity * end
    reference = exact(points, end)
    row = int((0.5 + velocity[1] * end) % 1.0 * n)
    order = np.argsort(offset[:, row])
    return {
        "mass": float(abs(c.sum() * grid.cell_volume - 1.0)),
        "mean / s": float(abs(mean) / sqrt(variance)),
        "variance": float(abs(m2 / variance - 1.0)),
        "skewness": float(abs(m3 / m2**1.5)),
        "kurtosis / 3": float(abs(m4 / (3.0 * m2**2) - 1.0)),
        "c / c_max, rms": rms(c - reference) / float(reference.max()),
        "along x": Curve(
            "x - x0 - U t [m]", "c [kg/m³]", offset[order, row], c[order, row], reference[order, row]
        ),
    }


def shear(n: int, convection: str) -> Answer:
    """Return errors of a puff in the shear flow u = G y, in a box 2 m long and 1 m high, n cells per metre.

    s_yy = s0² + 2 D t, s_xy = G (s0² t + D t²), s_xx = s_yy + G² (s0² t² + 2/3 D t³).
    """
    rate, diffusivity, s0, end, looks = 0.5, 2e-4, 0.05, 4.0, 8
    grid = Grid((2 * n, n), 1.0 / n)

    def velocity(x: np.ndarray) -> np.ndarray:
        return np.stack([rate * (x[..., 1] - 0.5), np.zeros(x.shape[:-1])], axis=-1)

    wind = PrescribedWind(velocity, grid)
    gas = gas_on(grid, wind, convection=convection, species=ethanol(diffusivity))
    x, y = np.moveaxis(grid.centers() - (1.0, 0.5), -1, 0)
    gas.start_from(lambda _: np.exp(-(x**2 + y**2) / (2.0 * s0**2)))
    moments = []
    for look in range(looks + 1):
        if look:
            ride(gas, end / looks, SHORT[convection] * grid.dx / (0.5 * rate))
        c = concentrations(gas)
        moments.append([(c * product).sum() / c.sum() for product in (x * x, x * y, y * y)])
    t = np.linspace(0.0, end, looks + 1)
    yy = s0**2 + 2.0 * diffusivity * t
    xy = rate * (s0**2 * t + diffusivity * t**2)
    xx = yy + rate**2 * (s0**2 * t**2 + diffusivity * t**3 * 2.0 / 3.0)
    answer: dict[str, float | Curve] = {}
    for name, values, exact in zip(("xx", "xy", "yy"), np.transpose(moments), (xx, xy, yy), strict=True):
        answer[f"sigma_{name}"] = float(abs(values[-1] / exact[-1] - 1.0))
        answer[f"sigma_{name} over time"] = Curve("t [s]", f"sigma_{name} [m²]", t, values, exact)
    return answer


def taylor_dispersion(n: int, convection: str = "koren") -> Answer:
    """Return the error of Taylor dispersion in Poiseuille flow between plates n cells apart: K = D (1 + 2/105 Pe²).

    Pe = U h/D with the mean speed U and half the distance h of the plates (Taylor 1953 for pipes; Wooding 1960 for
    plates, whose 8/945 (u_max h/D)² is the same: u_max = 3/2 U). K is half the growth rate of the variance,
    after diffusion across has damped the initial condition: exp(-pi² D t/h²) = 4e-4.
    """
    half, mean, peclet, length = 0.5, 1.0, 10.0, 20.0
    diffusivity = mean * half / peclet
    grid = Grid((round(length * n), n), 2.0 * half / n, periodic=(True, False))

    def velocity(x: np.ndarray) -> np.ndarray:
        profile = 1.5 * mean * (1.0 - (x[..., 1] / half - 1.0) ** 2)
        return np.stack([profile, np.zeros(x.shape[:-1])], axis=-1)

    wind = PrescribedWind(velocity, grid)
    gas = gas_on(grid, wind, convection=convection, species=ethanol(diffusivity))
    start, s0 = 6.0, 0.5
    x = (np.arange(grid.shape[0]) + 0.5) * grid.dx
    gas.start_from(lambda points: np.exp(-((points[..., 0] - start) ** 2) / (2.0 * s0**2)))
    settled, end, looks = 0.8 * half**2 / diffusivity, 1.6 * half**2 / diffusivity, 8
    times, variances = np.linspace(0.0, end, looks + 1), []
    for look, t in enumerate(times):
        if look:
            ride(gas, end / looks, SHORT[convection] * grid.dx / (1.5 * mean))
        c = concentrations(gas).mean(axis=1)
        offset = around(x, start + mean * t, length)
        middle = (c * offset).sum() / c.sum()
        variances.append((c * (offset - middle) ** 2).sum() / c.sum())
    late = times >= settled - 1e-9
    coefficient = 0.5 * np.polyfit(times[late], np.array(variances)[late], 1)[0]
    exact = diffusivity * (1.0 + 2.0 / 105.0 * peclet**2)
    line = variances[-1] + 2.0 * exact * (times - times[-1])
    return {
        "K": float(abs(coefficient / exact - 1.0)),
        "variance over time": Curve(
            "t [s]", "variance along the channel [m²]", times, np.array(variances), line
        ),
    }


# ---------------------------------------------------------------- solid-body rotation


def turned(n: int, convection: str, start: np.ndarray) -> EulerianSolver:
    """Return the gas with initial values `start` after one solid-body rotation, in a box 1 m wide of n² cells."""
    grid = Grid((n, n), 1.0 / n)
    wind = PrescribedWind(lambda x: np.stack([0.5 - x[..., 1], x[..., 0] - 0.5], axis=-1), grid)
    gas = gas_on(grid, wind, convection=convection, species=ethanol(0.0))
    gas.start_from(lambda _: start)
    ride(gas, 2.0 * pi, SHORT[convection] * grid.dx)  # the sum of |u| is 1 m/s in the corners
    return gas


def turning_puff(n: int, convection: str) -> Answer:
    """Return errors of a Gaussian puff after one solid-body rotation; the exact solution is the initial puff."""
    points = Grid((n, n), 1.0 / n).centers()
    before = np.exp(-((points - (0.5, 0.75)) ** 2).sum(axis=-1) / (2.0 * 0.05**2))
    after = concentrations(turned(n, convection, before))
    x, row = points[:, 0, 0], round(0.75 * n)
    return {
        "c, rms": rms(after - before),
        "c, largest": float(np.abs(after - before).max()),
        "below 0": max(0.0, -float(after.min())),
        "across": Curve("x [m]", "c", x, after[:, row], before[:, row]),
    }


def slotted_disc(n: int, convection: str) -> Answer:
    """Return errors of a slotted disc after one solid-body rotation (Zalesak 1979), in L1 norm over the disc's area."""
    fine = Grid((4 * n, 4 * n), 0.25 / n).centers() - (0.5, 0.75)
    shape = (np.hypot(fine[..., 0], fine[..., 1]) < 0.15) & ~(
        (np.abs(fine[..., 0]) < 0.025) & (fine[..., 1] < 0.1)
    )
    before = shape.reshape(n, 4, n, 4).mean(axis=(1, 3))
    gas = turned(n, convection, before)
    after = concentrations(gas)
    budget, released = gas.budget(), before.sum() / n**2
    x, row = (np.arange(n) + 0.5) / n, round(0.75 * n)
    return {
        "c, L1": float(np.abs(after - before).sum() / before.sum()),
        "below 0": max(0.0, -float(after.min())),
        "above 1": max(0.0, float(after.max()) - 1.0),
        "mass": float(abs((budget["in_domain_kg"] + budget["outflow_kg"]) / released - 1.0)),
        "across": Curve("x [m]", "c", x, after[:, row], before[:, row]),
    }


# ---------------------------------------------------------------- the table

NONE = Expected(tolerance=0.0)
EXACT = Expected(tolerance=1e-6)  # accuracy of f32 sums over many cells, or better


def _of_scheme(convection: str) -> tuple[Case, ...]:
    """Return the validation cases of a convection scheme.

    At the top of a puff the Koren limiter is of first order. So its moments of third and fourth order, and the rotating
    puff without diffusion, are reported but not judged.
    """
    fifth = convection == "weno5"
    return (
        Case(
            f"puff_moments_{convection}",
            f"moments of a puff that drifts and spreads, {convection}",
            "moments of a Gaussian",
            partial(puff_moments, convection=convection),
            evidence="exact",
            coarse=(48, 96),
            fine=(48, 96, 192),
            expected={"mass": EXACT}
            | dict.fromkeys(("mean / s", "variance"), EXACT if fifth else SECOND_ORDER)
            | ({"skewness": SECOND_ORDER, "kurtosis / 3": SECOND_ORDER} if fifth else {}),
        ),
        Case(
            f"shear_{convection}",
            f"a puff in a shear flow, {convection}",
            "moments of advection and diffusion",
            partial(shear, convection=convection),
            evidence="exact",
            coarse=(48, 96),
            fine=(48, 96),
            expected={
                "sigma_xx": SECOND_ORDER,
                "sigma_xy": EXACT if fifth else SECOND_ORDER,
                "sigma_yy": EXACT,  # central differences are exact for the variance of a puff on any grid
            },
        ),
        Case(
            f"turning_puff_{convection}",
            f"a Gaussian puff, turned once, {convection}",
            "the initial puff",
            partial(turning_puff, convection=convection),
            evidence="exact",
            coarse=(32, 64),
            fine=(32, 64, 128),
            expected={"below 0": NONE} | ({"c, rms": SECOND_ORDER} if fifth else {}),
        ),
        Case(
            f"slotted_disc_{convection}",
            f"a disc with a slot, turned once, {convection}",
            "the initial disc; Zalesak 1979, doi:10.1016/0021-9991(79)90051-2",
            partial(slotted_disc, convection=convection),
            evidence="exact",
            coarse=(50, 100),
            fine=(50, 100),
            expected={
                # a scheme of order p spreads a jump over h^(p/(p + 1)): exponent 2/3 with a limiter; the slot is narrow
                "c, L1": Expected(order=0.6),
                "below 0": EXACT,
                "mass": EXACT,
            }
            | ({} if fifth else {"above 1": EXACT}),
        ),
    )


def _puff(dim: int, speed: float) -> Case:
    return Case(
        f"puff_{'drifting' if speed else 'at_rest'}_{dim}d",
        "a puff of gas that spreads and drifts" if speed else "a puff of gas that spreads",
        "Gaussian solution",
        partial(gaussian_puff, dim=dim, speed=speed),
        evidence="exact",
        coarse=(24, 48),
        fine=(32, 64, 128)[: 5 - dim],
        expected={
            "c / c_max, rms": SECOND_ORDER,
            "mass": Expected(tolerance=1e-5),
            # at rest the scheme is exact for the variance of a puff on any grid
            "variance along x": SECOND_ORDER if speed else Expected(tolerance=1e-5),
        },
    )


CASES = (
    *(_puff(dim, speed) for dim in (2, 3) for speed in (0.0, 0.05)),
    *_of_scheme("koren"),
    *_of_scheme("weno5"),
    Case(
        "taylor_dispersion",
        "a cloud in laminar flow between plates, Pe 10",
        "K = D (1 + 2/105 Pe²), Wooding 1960",
        taylor_dispersion,
        evidence="exact",
        coarse=(8, 16),
        fine=(16, 32),
        # the second-order error of the diffusion across dominates: h² = 0.4 % on 16 cells
        expected={"K": Expected(tolerance=0.005, at=16)},
    ),
)
