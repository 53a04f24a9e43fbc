"""Whiffs and blanks in turbulent air: gas on the grid of a large-eddy simulation and puffs in the same air, in 2-D.

Eddies much longer than the width of a plume move it like a random walk, so that a sensor loses gas and meets it again.
Durations are those of first returns, p(T) ~ T^-3/2 (Celani, Villermaux & Vergassola 2014,
doi:10.1103/PhysRevX.4.041015). The law holds in a range of durations only, set before any run:

- from the passage time of the smallest well-resolved eddies, of 16 cells (docs/air.md): on shorter times the plume's
  edge is smooth, not a random walk. A puff of 5 cm passes in half of that time.
- to half of the time of the largest eddies, length over speed: on longer times the position of the plume decorrelates.

To have a decade in between, the inflow eddies are 10 m long, 400 cells, in a domain as wide. At the sensors the plume
wanders by one to two and a half times its width: whiffs of a narrower plume end as it passes, a wider plume seldom
leaves the sensors. Each sensor is in gas for 5 to 60 % of the time.

The flow is two-dimensional, as 400³ cells are too many. Its eddies are advected and move the gas as the inflow eddies
do, but do not break up into smaller ones, for which there is little time between source and sensors. In 3-D in a box of
1.2 m, eddies between 1.2 m and 10 m are missing, and exponents are about 2. A layer of eight cells, periodic along z,
has the wide eddies; its plume wanders by 1.6 to 2.7 times its width, but exponents are 1.0 (0.8 to 1.2 in one run of
300 s), as its edge lacks eddies of the plume's size.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from taichi_plume.fluctuations.durations import (
    CELANI,
    Exponent,
    Spells,
    density,
    exponent,
    halfway,
    pooled,
    spells,
)
from taichi_plume.fluctuations.sensor_comparison import FAST, SLOW, compare_sensors, compared_sensors
from taichi_plume.validation.case import Answer, Case, Curve, Expected, Keys
from taichi_plume.validation.searches import probed

U, LENGTH, INTENSITY = 0.5, 10.0, 0.08  # m/s; m; over the speed
CELL = 0.025  # m, edge of a grid cell
WIDTH, ROWS = 10.0, 4  # m: of the domain; sources side by side in it
SOURCE, RADIUS = 0.25, 0.15  # m: downstream of the inlet
DISTANCES = (1.5, 2.0, 2.5)  # m: from the sources
ACROSS = np.linspace(-0.8, 0.8, 17)  # m: of sensors from the axis
STEP = 0.035  # s: the tick, a single step of the flow
FLOW = 300.0  # s: duration of the flow of a seed
FIRST = 16.0 * CELL / U  # s
LAST = 10.0 * FIRST
PRESENT = (0.05, 0.6)  # share of time with gas of chosen sensors
LEVEL = 0.5  # threshold over the largest mean on the line
GASES = {"grid": "acetone", "puffs": "ethanol"}
KINDS = ("whiffs", "blanks")


class Variant(NamedTuple):
    """Definition of durations: threshold over the largest mean on the line, and start of the fitted decade [s]."""

    level: float = LEVEL
    first: float = FIRST


VARIANTS = {
    "half the threshold": Variant(level=0.5 * LEVEL),
    "twice the threshold": Variant(level=2.0 * LEVEL),
    "a decade from 0.53 s": Variant(first=FIRST / 1.5),
    "a decade from 1.2 s": Variant(first=FIRST * 1.5),
}


def scenario(seed: int, seconds: float) -> Keys:
    """Return the scenario: wind with long eddies, four sources of two gases side by side, lines of probes downwind."""
    rows = (np.arange(ROWS) + 0.5) * WIDTH / ROWS
    length = SOURCE + max(DISTANCES) + 0.75
    inlet = {"speed": U, "turbulence_intensity": INTENSITY, "turbulence_length": LENGTH}
    sources = [{"position": (SOURCE, float(y)), "rate": "10 mg/s", "radius": RADIUS} for y in rows]
    lines = [
        {
            "kind": "line",
            "name": f"{x:g}-{n}",
            "start": (SOURCE + x, float(y + ACROSS[0])),
            "end": (SOURCE + x, float(y + ACROSS[-1])),
            "count": len(ACROSS),
        }
        for x in DISTANCES
        for n, y in enumerate(rows)
    ]
    return {
        "name": "turbulent_whiffs",
        "seed": seed,
        "duration": seconds,
        "warm_up": 2.0 * length / U,
        "tick": STEP,
        "domain": {"size": (length, WIDTH), "spacing": CELL, "depth": 1.0},
        "wind": {
            "kind": "cfd",
            "openings": [
                {"kind": "inlet", "face": "x-"} | inlet,
                {"kind": "outlet", "face": "x+"},
                {"kind": "periodic", "axis": "y"},
            ],
        },
        "gas": {
            "kind": "mixture",
            "parts": [
                {"kind": "eulerian", "species": GASES["grid"], "sources": sources},
                {
                    "kind": "puffs",
                    "species": GASES["puffs"],
                    "sources": sources,
                    "release_rate": 200,
                    "initial_size": 0.03,
                    "handover": False,
                },
            ],
        },
        "probes": {"every": STEP, "points": lines},
    }


class Records(NamedTuple):
    """Readings of the probes of one flow: times (n,) [s], gas by kind, (n, distances, rows, sensors) [ppm]."""

    times: np.ndarray
    ppm: Mapping[str, np.ndarray]


def records(seed: int, seconds: float) -> Records:
    """Run the scenario and return the readings of its probes. Taichi must have been started."""
    _, times, table = probed(scenario(seed, seconds))
    shape = (-1, len(DISTANCES), ROWS, len(ACROSS))
    ppm = {kind: table[f"{gas}_ppm"].to_numpy().reshape(shape) for kind, gas in GASES.items()}
    return Records(times, ppm)


def thresholds(c: np.ndarray, level: float) -> np.ndarray:
    """Return the gas threshold of each line [ppm]: `level` times the largest mean of c, (n, distances, rows, m)."""
    return level * c.mean(axis=(0, 2)).max(axis=-1)


def chosen(present: np.ndarray) -> np.ndarray:
    """Return a mask of the sensors that are in gas for a fraction of time within PRESENT; present: (n, ...)."""
    share = present.mean(axis=0)
    return (share > PRESENT[0]) & (share < PRESENT[1])


def durations(flows: Sequence[Records], kind: str, level: float) -> dict[str, Spells]:
    """Return durations of whiffs and blanks at all chosen sensors of all flows, one flow after the other."""
    spells_by_kind: dict[str, list[Spells]] = {name: [] for name in KINDS}
    for number, flow in enumerate(flows):
        c = flow.ppm[kind]
        present = c > thresholds(c, level)[:, None, None]
        series, sensors = present.reshape(len(c), -1), np.flatnonzero(chosen(present))
        for sensor in sensors:
            for name, part in zip(KINDS, spells(flow.times, series[:, sensor]), strict=True):
                spells_by_kind[name].append(part._replace(begin=part.begin + number * FLOW))
    return {name: pooled(parts) for name, parts in spells_by_kind.items()}


def fitted(found: Spells, first: float = FIRST) -> Exponent | None:
    """Return the exponent of durations over a decade from `first` [s] on, with ends between possible durations."""
    return exponent(found, halfway(first - 0.5 * STEP, STEP), halfway(10.0 * first, STEP))


def turbulent_whiffs(n: int) -> Answer:
    """Return exponents of durations from n seconds of gas, in flows of 300 s with seeds 1, 2 ...; all sensors."""
    flows = [records(1 + k, FLOW) for k in range(max(1, round(n / FLOW)))]
    answer: dict[str, float | Curve] = {}
    for kind in GASES:
        for name, found in durations(flows, kind, LEVEL).items():
            law, what = fitted(found), f"{name}, {kind}"
            if law is None:
                raise ValueError(f"{what}: too few durations in the decade to fit an exponent")
            answer[f"{what}: exponent off 3/2"] = abs(law.value - CELANI)
            answer[f"{what}: half of its 95 % interval"] = 0.5 * (law.high - law.low)
            answer[f"{what}: exponent"] = law.value
            answer[f"{what}: counted in the decade"] = float(law.count)
            answer[f"{what}: how long they last"] = _picture(found, law)
        answer |= _robustness(flows, kind) | _plume(flows, kind)
    for kind in GASES:
        answer |= _sensors(flows, kind)
    return answer


def _robustness(flows: Sequence[Records], kind: str) -> dict[str, float]:
    """Return exponents of durations with other thresholds, over other decades, and of each flow alone."""
    exponents: dict[str, float] = {}
    for words, variant in VARIANTS.items():
        for name, found in durations(flows, kind, variant.level).items():
            law = fitted(found, variant.first)
            exponents[f"{name}, {kind}: exponent, {words}"] = law.value if law else np.nan
    for number, flow in enumerate(flows if len(flows) > 1 else ()):
        for name, found in durations([flow], kind, LEVEL).items():
            law = fitted(found)
            exponents[f"{name}, {kind}: exponent, seed {number + 1}"] = law.value if law else np.nan
    return exponents


def _plume(flows: Sequence[Records], kind: str) -> dict[str, float]:
    """Return the standard deviation of the plume's centre over the plume's instantaneous width, by distance."""
    c = np.concatenate([flow.ppm[kind] for flow in flows])
    held = np.where(c > 0.05 * c.max(axis=-1, keepdims=True), c, 0.0)
    mass = held.sum(axis=-1) + 1e-12
    centre = (held * ACROSS).sum(axis=-1) / mass
    width = np.sqrt(np.maximum((held * ACROSS**2).sum(axis=-1) / mass - centre**2, 0.0))
    ratio = centre.std(axis=0).mean(axis=-1) / width.mean(axis=(0, 2))
    return {f"wander over width, {kind}, {x:g} m": float(r) for x, r in zip(DISTANCES, ratio, strict=True)}


def _sensors(flows: Sequence[Records], kind: str) -> dict[str, float | Curve]:
    """Return fractions of whiffs that a slow and a fast gas sensor resolve, and readings at a point."""
    gas, several = GASES[kind], compared_sensors()[:2]
    whiffs, counts = 0, np.zeros(len(several))
    answer: dict[str, float | Curve] = {}
    for flow in flows:
        c = flow.ppm[kind]
        for at, least in enumerate(thresholds(c, LEVEL)):
            line = c[:, at].reshape(len(c), -1)
            line = line[:, chosen(line > least)]
            found = compare_sensors(several, gas, STEP, line, float(least))
            whiffs += found.sensors[0].whiffs
            counts += [sensor.seen for sensor in found.sensors]
            if not answer:
                window = slice(0, round(60.0 / STEP))
                peak = found.true[window].max()
                for words, reading in zip(("12 s", "50 ms"), found.readings, strict=True):
                    answer[f"a sensor of {words}, {kind}"] = Curve(
                        "t [s]",
                        "reading, against the gas, over its peak",
                        flow.times[window],
                        reading[window] / max(reading[window].max(), 1e-12),
                        found.true[window] / peak,
                    )
    for words, count in zip(
        (f"metal oxide of {SLOW:g} s", f"detector of {1e3 * FAST:g} ms"), counts, strict=True
    ):
        answer[f"whiffs kept by a {words}, {kind}"] = float(count / max(whiffs, 1))
    return answer


def _picture(found: Spells, law: Exponent) -> Curve:
    """Return the density of durations with T^-3/2 and the fitted power law, normalised to the count in the decade."""
    middle, rate, _ = density(found.lasted, STEP)
    share = law.count / len(found.lasted)

    def line(a: float) -> np.ndarray:
        return share * middle**-a * (1.0 - a) / (law.last ** (1.0 - a) - law.first ** (1.0 - a))

    return Curve("T [s]", "density of T [1/s]", middle, rate, line(CELANI), True, True, fit=line(law.value))


CASES = (
    Case(
        "turbulent_whiffs",
        "durations of whiffs and blanks at sensors, gas on the grid and puffs in air with eddies (2-D)",
        "Celani et al. 2014, doi:10.1103/PhysRevX.4.041015",
        turbulent_whiffs,
        evidence="law",
        coarse=(),
        fine=(600,),
        expected={
            f"{name}, {kind}: {norm}": Expected(tolerance=tolerance)
            for kind in GASES
            for name in KINDS
            for norm, tolerance in (("exponent off 3/2", 0.2), ("half of its 95 % interval", 0.15))
        },
    ),
)
