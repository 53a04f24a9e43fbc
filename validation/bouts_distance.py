"""Bouts of a metal oxide and the deviation of its signal against the distance from the source, in two published setups.

Tunnel: Schmuker, Bahr & Huerta 2016 (doi:10.1016/j.snb.2016.05.098) count bouts in the records of Vergara et al. 2013
(doi:10.1016/j.snb.2013.05.027): a tunnel of 2.5 x 1.2 x 0.4 m, wind of 0.1 m/s, boards 0.25 to 1.45 m behind the source
on its axis, 3 minutes of gas. The mean count falls with the distance on a line with R² = 0.91.

Hall: measurements of Vuka et al. 2016 in a hall at Örebro, records of 100 s at 100 Hz. The standard deviation of the
signal of a metal oxide is given in counts of the converter; without gas it is 0.9. In wind of 0.13 to 0.26 m/s it is
11.6 to 14.6 at 2 m, 5.1 to 5.7 at 3 m and 4.5 to 4.7 at 4 m. In wind of 0.28 to 0.43 m/s it is 6.7 to 8.0, 5.1 to 6.0
and 1.8 to 2.4. The deviation of the wind is 0.3 to 0.5 of its mean.

Ours: puffs in the turbulent air of a large-eddy simulation in 3-D, a metal oxide (`mics5524` with its defaults) at each
distance. Release rates, the size of eddies and, in the tunnel, the turbulence intensity are not published and are our
choice. Their sensors and gases were others, so that only ratios between distances are compared.

Expected, set before any run:

- The rank correlation of bouts with the distance is at most -0.6 on average over the airs, and that of the deviation.
- In at least 80 % of the airs the farthest point has fewer bouts and a smaller deviation than the nearest.
- In the tunnel a line through the mean counts has R² >= 0.8.
- In the hall the deviation at 3 m over that at 2 m is 0.3 to 0.9; published are 0.41 and, in the fast wind, 0.76.
- In the hall the deviation at 4 m over that at 2 m is 0.2 to 0.6; published are 0.35 and, in the fast wind, 0.29.

Added after the first run, and not judged: the deviation of the gas itself, and the same air with a twentieth of the
gas, where the logarithmic response of the metal oxide is nearly linear.
"""

from collections.abc import Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.stats import spearmanr

from taichi_plume.fluctuations import bouts
from taichi_plume.fluctuations.sensor_comparison import readings
from taichi_plume.scenario.sensors import MoxSensor
from taichi_plume.validation.case import Comparison, Keys
from taichi_plume.validation.experiment import (
    Condition,
    Experiment,
    Lines,
    Mean,
    Range,
    Results,
    over_airs,
    resampled,
)
from taichi_plume.validation.searches import probed

STEP = 0.1  # s: the tick, between samples
SETTLING = bouts.SETTLING  # s
WEAK = 0.05  # times the gas
GAS = "ethanol"
SENSOR = MoxSensor(kind="mox")


class Setup(NamedTuple):
    """Setup: size [m]; cell [m]; source [m]; distances from it along x [m]; wind [m/s], its intensity and eddies [m].

    rate: of the source; width: of puffs at the source [m]; seconds: length of a record after SETTLING.
    """

    size: tuple[float, float, float]
    cell: float
    source: tuple[float, float, float]
    distances: tuple[float, ...]
    speed: float
    intensity: float
    length: float
    rate: str
    width: float
    seconds: float


TUNNEL = Setup(
    (2.4, 1.2, 0.4), 0.04, (0.4, 0.6, 0.2), (0.25, 0.5, 0.98, 1.18, 1.4, 1.45), 0.1, 0.2, 0.2, "20 ug/s", 0.01, 180.0
)  # fmt: skip
HALL = Setup(
    (5.6, 3.0, 2.0), 0.1, (0.8, 1.5, 1.0), (2.0, 3.0, 4.0), 0.2, 0.35, 0.8, "1 mg/s", 0.03, 100.0
)  # fmt: skip
SETUPS = {
    "tunnel, 0.1 m/s": TUNNEL,
    "hall, 0.2 m/s": HALL,
    "hall, 0.35 m/s": HALL._replace(speed=0.35),
}


def scenario(setup: Setup, seed: int) -> Keys:
    """Return the scenario: a box with turbulent wind along x, a source of puffs, a probe at each distance."""
    x, y, z = setup.source
    inlet = {
        "speed": setup.speed,
        "turbulence_intensity": setup.intensity,
        "turbulence_length": setup.length,
    }
    return {
        "name": "bouts_distance",
        "seed": seed,
        "duration": SETTLING + setup.seconds,
        "warm_up": 2.0 * setup.size[0] / setup.speed,
        "tick": STEP,
        "domain": {"size": setup.size, "spacing": setup.cell},
        "wind": {
            "kind": "cfd",
            "openings": [
                {"kind": "honeycomb", "face": "x-"} | inlet,
                {"kind": "honeycomb", "face": "x+"},
            ],
        },
        "gas": {
            "kind": "puffs",
            "species": GAS,
            "sources": [{"position": setup.source, "rate": setup.rate, "radius": 0.01}],
            "release_rate": 20.0,
            "initial_size": setup.width,
        },
        "probes": {
            "every": STEP,
            "points": [{"kind": "point", "name": f"{d:g}", "at": (x + d, y, z)} for d in setup.distances],
        },
    }


class Found(NamedTuple):
    """Results by air and distance, (airs, distances): bouts per minute; deviation and mean of the signal; gas [ppm].

    ppm, ppm_deviation: mean and standard deviation of the gas.
    """

    count: np.ndarray
    deviation: np.ndarray
    mean: np.ndarray
    ppm: np.ndarray
    ppm_deviation: np.ndarray


def found_in(ppm: Sequence[np.ndarray]) -> Found:
    """Return the results of a metal oxide in the gas of each air, (n, distances) [ppm] every STEP."""
    airs, points = len(ppm), ppm[0].shape[1]
    gas = np.concatenate(ppm, axis=1).astype(np.float32)
    measured = np.stack([np.array(found[0]) for found in readings([SENSOR], GAS, STEP, gas)])
    counted, _ = bouts.bouts_of_sensor(SENSOR, STEP, measured)
    settled = slice(round(SETTLING / STEP), None)
    mean = bouts.signal(SENSOR, measured[settled]).mean(axis=0)
    gas = gas[settled].astype(float)
    parts = counted.per_min, counted.deviation, mean, gas.mean(axis=0), gas.std(axis=0)
    return Found(*(part.reshape(airs, points) for part in parts))


@cache
def results(setup: Setup, airs: int) -> tuple[Found, Found]:
    """Return the results in `airs` flow realisations, and those with WEAK times the gas.

    Taichi must have been started.
    """
    ppm, sim = [], None
    for seed in range(1, airs + 1):
        sim, times, table = probed(scenario(setup, seed), sim)
        ppm.append(table[f"{GAS}_ppm"].to_numpy().reshape(len(times), -1))
    return found_in(ppm), found_in([WEAK * gas for gas in ppm])


def rank_correlation(values: np.ndarray, distances: Sequence[float]) -> np.ndarray:
    """Return the rank correlation of values with the distance in each air; 0 for constant values (airs, distances)."""
    return np.array([spearmanr(row, distances).statistic if np.ptp(row) > 0.0 else 0.0 for row in values])


def line_fit(count: np.ndarray, distances: Sequence[float]) -> Mean:
    """Return R² of a line through the mean counts (airs, distances), with an interval by a bootstrap over airs."""
    x = np.array(distances) - np.mean(distances)

    def statistic(chosen: np.ndarray, axis: int = -1) -> np.ndarray:
        mean = count[chosen].mean(axis=-2)
        apart = mean - mean.mean(axis=-1, keepdims=True)
        total = (apart**2).sum(axis=-1) * (x**2).sum()
        return (apart @ x) ** 2 / np.maximum(total, 1e-300)

    return resampled([np.arange(len(count))], statistic)


def compared(airs: int, name: str) -> Results:
    """Return the results of a setup: correlations with the distance, ratios between distances, values at each."""
    setup = SETUPS[name]
    d = setup.distances
    found, weak = results(setup, airs)
    quantities: Keys = {}
    for words, values in (
        ("bouts", found.count),
        ("deviation", found.deviation),
        ("mean signal", found.mean),
    ):
        quantities[f"{words}: rank correlation with the distance"] = over_airs(rank_correlation(values, d))
        fewer = (values[:, -1] < values[:, 0]).astype(float)
        quantities[f"{words}: less at the farthest than at the nearest point"] = over_airs(fewer, share=True)
    quantities["line through the mean counts: R²"] = line_fit(found.count, d)
    for n, x in enumerate(d[1:], 1):
        ratio = found.deviation[:, n] / found.deviation[:, 0]
        quantities[f"deviation at {x:g} m over that at {d[0]:g} m"] = over_airs(ratio)
    slope = np.polyfit(np.log(d), np.log(found.deviation.T), 1)[0]
    quantities["deviation as a power of the distance"] = over_airs(slope)
    ratio = found.ppm_deviation[:, -1] / found.ppm_deviation[:, 0]
    quantities[f"deviation of the gas at {d[-1]:g} m over that at {d[0]:g} m"] = over_airs(ratio)
    ratio = weak.deviation[:, -1] / weak.deviation[:, 0]
    less = "a twentieth of the gas"
    quantities[f"{less}: deviation at {d[-1]:g} m over that at {d[0]:g} m"] = over_airs(ratio)
    quantities[f"{less}: rank correlation of bouts with the distance"] = over_airs(
        rank_correlation(weak.count, d)
    )
    for n in (0, -1):
        quantities[f"{less}: bouts per minute at {d[n]:g} m"] = over_airs(weak.count[:, n])
    for n, x in enumerate(d):
        quantities[f"bouts per minute at {x:g} m"] = over_airs(found.count[:, n])
        quantities[f"deviation of ln R at {x:g} m"] = over_airs(found.deviation[:, n])
        quantities[f"mean gas at {x:g} m [ppm]"] = over_airs(found.ppm[:, n])
    shares = {
        "bouts per minute": found.count,
        "deviation of the signal": found.deviation,
        "mean signal": found.mean,
    }
    lines = {words: values.mean(axis=0) / values[:, 0].mean() for words, values in shares.items()}
    quantities[f"over the nearest point: {name}"] = Lines(
        "distance from the source [m]", "value over that at the nearest point", np.array(d), lines | of_vuka(name)
    )  # fmt: skip
    return quantities


MEASURED = {"hall, 0.2 m/s": (13.1, 5.4, 4.6), "hall, 0.35 m/s": (7.35, 5.55, 2.1)}
"""Middle of the measured range of the deviation at 2, 3 and 4 m [counts], see above."""


def of_vuka(name: str) -> dict[str, np.ndarray]:
    """Return the measured deviations over that at the nearest point, by name; none for the tunnel."""
    return {"deviation, measured": np.divide(MEASURED[name], MEASURED[name][0])} if name in MEASURED else {}


COMMON = {
    f"{words}: {quantity}": bounds
    for words in ("bouts", "deviation")
    for quantity, bounds in (
        ("rank correlation with the distance", Range(-1.0, -0.6)),
        ("less at the farthest than at the nearest point", Range(least=0.8)),
    )
}
LINE, THIRD, FOURTH = (
    "line through the mean counts: R²", "deviation at 3 m over that at 2 m", "deviation at 4 m over that at 2 m",
)  # fmt: skip
POWER = "deviation as a power of the distance"
EXPECTED = {
    name: COMMON
    | ({THIRD: Range(0.3, 0.9), FOURTH: Range(0.2, 0.6)} if name in MEASURED else {LINE: Range(least=0.8)})
    for name in SETUPS
}
PUBLISHED = {
    "tunnel, 0.1 m/s": {LINE: "0.91"},
    "hall, 0.2 m/s": {THIRD: "0.35 to 0.49", FOURTH: "0.31 to 0.41", POWER: "-1.55"},
    "hall, 0.35 m/s": {THIRD: "0.64 to 0.90", FOURTH: "0.23 to 0.36", POWER: "-1.73"},
}

DISCUSSION = (
    "Reproduced in the tunnel: bouts become rarer with the distance, from 15.7 a minute at 0.25 m to 11.6 at 1.45 "
    "m. A line through the mean counts has R² = 0.93, where 0.91 is published, and the deviation of the signal "
    "halves. With a twentieth of the gas the counts fall from 14.3 to 4.6: near the source they hardly depend on "
    "the amount of gas, farther away bouts sink below the threshold, which is set by the noise.\n\n"
    "Not reproduced in the hall: the deviation falls with the distance, but less steeply than measured. At 4 m it "
    "is 0.67 and 0.68 of that at 2 m, where 0.35 and 0.29 are published. Bouts do not fall: 9 a minute at all "
    "distances in the slow wind, 12 in the fast wind. Five bounds are not met. One reason is the release rate, "
    "which is not published. The deviation of the gas itself at 4 m is 0.38 and 0.41 of that at 2 m, but the "
    "response of the metal oxide is logarithmic and compresses gas of a few ppm. With a twentieth of the gas the "
    "response is nearly linear: the deviation at 4 m is 0.45 and 0.51 of that at 2 m, and bouts fall from 5.6 to "
    "4.1 and from 6.5 to 4.2 a minute, with rank correlations of -0.75 and -0.77. The bounds were set for the "
    "first amount and are kept.\n\n"
    "Other differences were not examined. The walls of our box may confine the plume; the turbulence intensity at "
    "the sensors is 0.25, where 0.3 to 0.5 was measured; a record of 100 s has only 15 to 20 bouts, so that "
    "intervals are wide. The mean signal falls in every air here, as the wind is steady and the sensors stand on "
    "the axis: this case does not show that bouts order distances better than the mean does."
)

CASES = (
    Experiment(
        "bouts_distance",
        "bouts of a metal oxide and the deviation of its signal fall with the distance from the source (3-D puffs)",
        "Schmuker et al. 2016, doi:10.1016/j.snb.2016.05.098; Vuka et al. 2016, measurements in a hall",
        tuple(
            Condition(name, partial(compared, name=name), PUBLISHED[name], EXPECTED[name]) for name in SETUPS
        ),
        evidence="published",
        compared=(Comparison("concentration fluctuation", "deviation at [34] m .*", "hall.*"),),
        trials=5,
        test_trials=0,
        discussion=DISCUSSION,
    ),
)
