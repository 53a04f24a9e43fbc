"""Helium in a box with two small holes, measured for five hours: gas that fills a tenth of the air and more.

Measured at NIST in 2009 (the `NIST_He_2009` tables of the validation of the Fire Dynamics Simulator, repository
firemodels/fds, `Validation/NIST_He_2009`, case 14400_LC_ULV; works of the US government, free to use with
acknowledgement): a box of acrylic sheets, 1.5 x 1.5 x 0.75 m inside, 13 mm thick, with holes of 2.15 cm square in the
middle of one side from 2.54 and 70.31 cm above the floor; 3.54 L/min of helium for 14,400 s from a burner of 3.2 cm
square, 21 cm above the middle of the floor. Sensors stand at (0.375, 0.375) m. The table starts 60 s before
the release, as its first reading and the start of the decay show.

The holes are smaller than a cell. Each is an opening over the cells that it touches, with a loss coefficient. The
flow rate through a hole of area A is Q = C_d A √(2 dp/rho), so the loss coefficient of an opening of area B is
(B/(C_d A))². C_d depends on the depth of the hole over its width, here 0.6 (see `discharge`): 0.654, where a hole in a
thin sheet has 0.596. Until 2026 this case had 0.6. Outside is still air at hydrostatic pressure, so that light gas
flows out above and air flows in below; the flow through the holes is computed, not given.

The source adds the helium's volume, and the loss at a hole is that of the gas that leaves. Density does not act on the
inertia of the air within the box.

Linden's well-mixed box (1999, doi:10.1146/annurev.fluid.31.1.201) has a closed form. In the Boussinesq approximation
the outflow has the volume fraction x = (Q/(C_d A √(g' H)))^(2/3), where g' x is the reduced gravity. With the helium's
own volume, which only leaves, and with the density of the outflow through the upper hole, x is 8 % lower.

An opening of whole cells is wider than its hole, and helium diffuses out against the inflow through the whole opening.
In a box of mixed gas this adds a tenth to the outflow on cells of 7.5 cm, and less on finer cells.
"""

from collections.abc import Mapping
from functools import partial
from math import ceil, floor, sqrt
from typing import NamedTuple

import numpy as np
from scipy.optimize import root_scalar

from taichi_plume.scenario.species import AIR_MOLAR_MASS, GAS_CONSTANT, PRESSURE, TEMPERATURE
from taichi_plume.validation.case import Comparison, Curve, Keys
from taichi_plume.validation.experiment import Condition, Experiment, Lines, Mean, Range, Results
from taichi_plume.validation.searches import probed

SIZE = (1.5, 1.5, 0.75)  # m
SIDE, LOW, HIGH = 0.0215, 0.0254, 0.7031  # m: side of a hole; lower edges of both holes above the floor
DEPTH = 0.013  # m, of the holes
FLOW = 3.54e-3 / 60.0  # m³/s
HELIUM = 4.0026e-3  # kg/mol, IUPAC
DIFFUSIVITY = 7.0e-5  # m²/s in air, at 25 °C
RELEASE, END = 14_400.0, 18_000.0  # s
GRAVITY = 9.81  # m/s²
HEIGHTS = (0.093, 0.185, 0.276, 0.372, 0.466, 0.559, 0.650)  # m, of the measuring sensors
MEASURED: Mapping[int, tuple[float, ...]] = {
    600: (0.23, 0.43, 0.85, 1.56, 2.38, 3.17, 3.60),
    3_600: (5.59, 6.58, 7.66, 9.15, 10.29, 11.18, 11.45),
    14_340: (9.16, 10.80, 12.37, 14.37, 15.76, 16.70, 16.95),
    18_000: (5.42, 6.09, 6.58, 7.21, 7.60, 7.99, 8.17),
}
"""Helium in per cent of the volume at HEIGHTS, by seconds since the release began."""
FULL = 14_340  # s: before the release ends
WHEN = {
    600: "after 10 min",
    3_600: "after 1 h",
    FULL: "after 4 h",
    18_000: "1 h after the end of the release",
}
MEAN, RISE = "mean of seven heights [%]", "least rise from height to height [%]"
EXPECTED = {
    f"{MEAN}, {WHEN[FULL]}": Range(
        *(round(part * float(np.mean(MEASURED[FULL])), 2) for part in (0.85, 1.15))
    ),
    f"{RISE}, {WHEN[FULL]}": Range(least=0.0),
}
LIGHTER = 1.0 - HELIUM / AIR_MOLAR_MASS
"""Density of air less that of helium, over that of air."""


def discharge(depth: float) -> float:
    """Return the discharge coefficient of a sharp-edged hole in a wide wall; depth: over the hole's width, at most 1.4.

    Loss coefficient 1/C_d² by Rennels & Hudson 2012, Pipe Flow, doi:10.1002/9781118275276 (thick-edged orifice).
    """
    thin = (1.0 - 0.5 * (depth / 1.4) ** 2.5 - 0.5 * (depth / 1.4) ** 3) ** 4.5
    return 1.0 / sqrt(0.183 + thin * 1.622**2 + (1.0 - thin) * 1.387)


DISCHARGE = discharge(DEPTH / SIDE)


def opening(edge: float, cell: float) -> Keys:
    """Return the opening, as keys, over the cells that a hole touches; `edge`: lower edge of the hole [m]."""
    lows, highs = zip(*(_touched(a, a + SIDE, cell) for a in (0.5 * SIZE[1], edge)), strict=True)
    size = tuple(high - low for low, high in zip(lows, highs, strict=True))
    return {
        "kind": "honeycomb",
        "face": "x-",
        "center": tuple(0.5 * (low + high) for low, high in zip(lows, highs, strict=True)),
        "size": size,
        "loss_coefficient": (size[0] * size[1] / (DISCHARGE * SIDE**2)) ** 2,
    }


def _touched(low: float, high: float, cell: float) -> tuple[float, float]:
    """Return the bounds [m] of the cells that the interval from low to high [m] touches."""
    return floor(low / cell + 1e-6) * cell, ceil(high / cell - 1e-6) * cell


def scenario(cell: float, seconds: float) -> Keys:
    """Return the scenario of the box with cells of `cell` [m], as keys of a YAML file."""
    rate = FLOW * HELIUM * PRESSURE / (GAS_CONSTANT * TEMPERATURE)
    place = (0.375, 0.375)
    return {
        "name": "helium_box",
        "seed": 1,
        "duration": seconds,
        "tick": 1.0,
        "domain": {"size": SIZE, "spacing": cell},
        "wind": {"kind": "cfd", "buoyancy": {}, "openings": [opening(edge, cell) for edge in (LOW, HIGH)]},
        "gas": {
            "kind": "eulerian",
            "species": {"name": "helium", "molar_mass": HELIUM, "diffusivity": DIFFUSIVITY},
            "sources": [
                {"position": (0.75, 0.75, 0.21), "rate": rate, "radius": 0.016, "stop": RELEASE},
            ],
        },
        "probes": {
            "every": 60.0,
            "points": [
                {"kind": "point", "name": f"{z:g}", "at": (*place, z)} for z in HEIGHTS
            ],
        },
    }  # fmt: skip


class Readings(NamedTuple):
    """Readings of the probes: times (n,) [s], helium (n, HEIGHTS) [%], and mean of the box at the end [%]."""

    times: np.ndarray
    percent: np.ndarray
    box: float


def readings(cell: float, seconds: float) -> Readings:
    """Run the scenario with cells of `cell` [m] and return its readings. Taichi must have been started."""
    sim, times, table = probed(scenario(cell, seconds))
    volume = float(np.prod(SIZE))
    (gas,) = sim.gas.gases
    box = 1e-4 * gas.species.ppm_per_density * gas.budget()["in_domain_kg"] / volume
    percent = 1e-4 * table["helium_ppm"].to_numpy().reshape(-1, len(HEIGHTS))
    return Readings(times, percent, float(box))


def mixed(one_density: bool) -> float:
    """Return the steady fraction of helium in Linden's well-mixed box; one_density: by the Boussinesq approximation."""
    height, passed = HIGH - LOW, DISCHARGE * SIDE**2
    if one_density:
        return (FLOW / (passed * sqrt(LIGHTER * GRAVITY * height))) ** (2.0 / 3.0)

    def missing(x: float) -> float:
        """Return the driving pressure less the losses of both holes, over the density of air [m²/s²]."""
        out = FLOW / x
        taken = (out - FLOW) ** 2 + out**2 * (1.0 - LIGHTER * x)
        return LIGHTER * x * GRAVITY * height - 0.5 * taken / passed**2

    return float(root_scalar(missing, bracket=(1e-6, 0.9)).root)


def asked(percent: np.ndarray) -> float:
    """Return the discharge coefficient of the holes that explains steady measurements at HEIGHTS [%].

    The weight of the column drives the flow. The outflow has the uppermost fraction, and carries the helium's volume.
    """
    head = LIGHTER * 1e-2 * float(percent.mean()) * GRAVITY * (HIGH - LOW)
    last = 1e-2 * float(percent[-1])
    out = FLOW / last
    return sqrt(0.5 * ((out - FLOW) ** 2 + out**2 * (1.0 - LIGHTER * last)) / head) / SIDE**2


def alone(value: float) -> Mean:
    """Return a number of a single run or of a closed form as a Mean without interval."""
    return Mean(value, None, None, 1)


def filled(trials: int, cell: float, seconds: float) -> Results:
    """Return helium at the times of MEASURED up to `seconds`; `trials` has no effect, as there is a single air."""
    run = readings(cell, seconds)
    z, cells, last = np.array(HEIGHTS), f"cells of {100 * cell:g} cm", min(seconds, RELEASE)
    rows: Keys = {}
    for t, measured in MEASURED.items():
        if t > seconds:
            break
        percent = run.percent[int(np.abs(run.times - t).argmin())]
        rows |= {f"{name}, {WHEN[t]}": alone(x) for name, x in summary(percent).items()}
        rows[f"helium {WHEN[t]}, {cells}"] = Curve("height [m]", "helium [%]", z, percent, np.array(measured))
        if t == FULL:
            rows |= {f"at {h:.3f} m [%]": alone(float(x)) for h, x in zip(HEIGHTS, percent, strict=True)}
    if seconds <= RELEASE:
        rows["in the box in the end over released"] = alone(
            run.box * float(np.prod(SIZE)) / (100.0 * FLOW * last)
        )
    rows[f"helium over time, {cells}"] = Lines(
        "time [h]",
        "helium [%]",
        run.times / 3600.0,
        {f"{h:.3f} m": run.percent[:, k] for k, h in enumerate(HEIGHTS)},
    )
    return rows


def summary(percent: np.ndarray) -> dict[str, float]:
    """Return mean, least rise between heights and ratio of lowest to highest of helium at HEIGHTS [%], by name."""
    return {
        MEAN: float(percent.mean()),
        RISE: float(np.diff(percent).min()),
        "lowest over highest": float(percent[0] / percent[-1]),
    }


def boxes(trials: int) -> Results:
    """Return the closed-form results of Linden's well-mixed box; `trials` has no effect."""
    return {
        "one density [%]": alone(100.0 * mixed(True)),
        "with the helium's volume and both densities [%]": alone(100.0 * mixed(False)),
        "one density over both": alone(mixed(True) / mixed(False)),
        "discharge coefficient by what was measured after 4 h": alone(asked(np.array(MEASURED[FULL]))),
    }


def published(seconds: float) -> dict[str, str]:
    """Return the measured values up to `seconds` as texts, named as in `filled`."""
    values = {
        f"{name}, {WHEN[t]}": f"{value:.2f}"
        for t, measured in MEASURED.items()
        if t <= seconds
        for name, value in summary(np.array(measured)).items()
    }
    if seconds >= FULL:
        values |= {f"at {z:.3f} m [%]": f"{x:g}" for z, x in zip(HEIGHTS, MEASURED[FULL], strict=True)}
    return values


DISCUSSION = (
    "Reproduced: light gas flows out through the upper opening and draws in air through the lower one. The flow "
    "between two such holes of a mixed box is within 3 % of the closed form with both densities (a test), so the "
    "hydrostatic pressure and the loss at openings are right. All heights are in the right order.\n\n"
    "Not reproduced: the mean after 4 h, 16.0 % where 13.7 % was measured, 17 % too much where 15 % is allowed. It was "
    "18.0 % with one density for all air, helium without volume and C_d = 0.6. The helium's volume and the density in "
    "the holes lower it to 16.7 %, C_d = 0.654 to 16.0 %; the measured box requires 0.75. The profile is too even, "
    "the lowest over the highest 0.81 instead of 0.54: a plume of one cell's width entrains too much air. Less helium "
    "is then at the upper hole, and more must be in the box for the same outflow. After 10 min, when the holes hardly "
    "matter, that ratio is 0.56, 0.33 and 0.22 on cells of 7.5, 5 and 3.75 cm; 0.06 was measured. Without a "
    "turbulence model it is 0.52 instead of 0.56, so the model is not the cause.\n\n"
    "So a vapour of some per mille is computed well. For tens of per cent of helium expect an error of some 10 %, and "
    "use cells well below the plume's width."
)
RUNS = ((0.075, END), (0.05, 3_600.0), (0.0375, 600.0))
"""Cells [m] and simulated time [s] of runs of a few minutes each."""

CASES = (
    Experiment(
        "helium_box",
        "helium in a box with two small holes, a tenth of the air and more",
        "measured at NIST 2009, tables in firemodels/fds; Linden 1999, doi:10.1146/annurev.fluid.31.1.201",
        (
            *(
                Condition(
                    f"cells of {100 * cell:g} cm",
                    partial(filled, cell=cell, seconds=seconds),
                    published=published(seconds),
                    expected=EXPECTED if seconds >= FULL else {},
                )
                for cell, seconds in RUNS
            ),
            Condition("Linden's box, mixed well", boxes),
        ),
        evidence="measured",
        compared=(
            Comparison("mean concentration", "helium after 10 min, cells of 3.75 cm"),
            Comparison("mean concentration", "helium after 1 h, cells of 5 cm"),
            Comparison("mean concentration", "helium after 4 h, .*"),
            Comparison("mean concentration", "helium 1 h after the end of the release, .*"),
        ),
        trials=1,
        test_trials=0,
        discussion=DISCUSSION,
    ),
)
