"""An office with displacement ventilation and 27 gas sensors: layers of gas, rise times and fluctuations.

Measured: Burgués, Hernandez, Lilienthal & Marco 2018, "3D Gas Distribution with and without Artificial Airflow"
(doi:10.3390/proceedings2130911, data set Orebro3DSEN). The office is 5.94 x 4.56 m and about 2.6 m high. A duct
supplies clean air slowly at the floor, and air leaves at the ceiling. A beaker of liquid evaporates on a table or, with
a bubbler, on the floor. 27 calibrated metal oxides in three layers, at 0.45, 1.2 and 2.23 m, record ppm at 2 Hz for two
hours. The files are `orebro/exp01.csv.gz` and so on. MEASURED has the statistics of six experiments.

Statistics, the same for the measurement and for ours. The release begins when the mean of all sensors, averaged over
2 minutes, passes 5 % of its largest value, and ends when it last has 90 %:

- Layers, in the last 30 minutes of the release: mean of the 9 sensors of a height over that of all 27. The largest
  sensor over the mean of all.
- Rise time τ: fit of c (1 - exp(-t/τ)) to the mean of all sensors in the first hour. Perfect mixing gives V/Q.
- Fluctuations in the last 30 minutes, in blocks of 10 minutes without their linear trend: the standard deviation over
  the mean, and the first lag at which the autocorrelation is below 1/e. Both are medians over sensors and blocks.

One set of assumptions for all six, fixed before the runs. Not published, or not seen by us, are the flow rate, the
places of supply, exhaust and fans, the heat, the liquid and its rate:

- Supply: 3.5 air changes per hour, in the middle of the measured 2.8 to 4.8, through 1.2 x 0.3 m at the floor of the
  wall x = 0. The exhaust of 0.45 x 0.45 m is in the ceiling, at the far end.
- Heat: a person of 75 W, and two computers of 60 W on tables at both long walls. All heat leaves with the air: walls
  are adiabatic, so that the air warms by 2.4 K between supply and exhaust. Radiation between walls is neglected.
- The supply has the temperature at which the room starts. It blows 20 minutes before the release.
- The vapour, counted as ethanol's, has no weight: 36 ppm weigh as much as 6 mK of cold. Then experiments in the same
  air share a run. Releases are constant; their rate gives the measured mean, so that noise is in proportion.
- Sensors: 27 `tgs2620` with its lag (3 s up, 16 s down) and noise. x of 1, 3 and 5 m and y of 0.76, 2.28 and 3.8 m.
- Fans: our scenarios have fans in walls only, which would bring clean air. Nearest is the downwash of a hovering
  rotor 1.6 m above the floor, a vertical jet with a given momentum flux. This is 0.07 N for the DC fan (12 cm, 2.3
  m/s) and 0.2 N for the tower fan (6 x 70 cm, 2 m/s). The rotor is 60 cm wide, four cells, as far from a jet only
  its momentum flux counts. The real jets were horizontal.

Expected, set before the runs, on cells of 15 cm: each layer within 0.2 of the measured ratio, the rise time within a
factor of 4/3, and the largest sensor over the mean within a factor of 1.5 of the measured ones. The fluctuations and
their time agree within a factor of two. Conditions with half and twice the supply, and no and twice the heat, are not
judged. The unknown whose change leaves the smallest deviation of the layers explains most of what is missed.
"""

from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d
from scipy.optimize import curve_fit
from scipy.signal import correlate, detrend

from taichi_plume.fluctuations.sensor_comparison import readings
from taichi_plume.scenario.metal_oxides import MoxSensor
from taichi_plume.validation.case import Comparison, Keys
from taichi_plume.validation.experiment import Condition, Experiment, Lines, Mean, Range, Results, over_airs
from taichi_plume.validation.published_data import data_file
from taichi_plume.validation.searches import probed

DOI = "10.3390/proceedings2130911"

STEP = 0.5  # s: between samples
MINUTE = round(60.0 / STEP)  # samples
SMOOTHED, ONSET, END = 2 * MINUTE, 0.05, 0.9  # samples; of the largest value
HOUR, LATE, BLOCK = 60 * MINUTE, 30 * MINUTE, 10 * MINUTE  # samples

HEIGHTS = (0.45, 1.2, 2.23)  # m
SENSORS = np.array([(x, y, z) for x in (1.0, 3.0, 5.0) for y in (0.76, 2.28, 3.8) for z in HEIGHTS])
ANEMOMETER = (3.0, 2.28, 1.3)  # m
MOX = MoxSensor(kind="mox", model="tgs2620")
SIZE = (5.94, 4.56, 2.6)  # m
CHANGES = 3.5  # air changes per hour
DUCT, EXHAUST = (1.2, 0.3), (0.45, 0.45)  # m
PERSON, COMPUTER = 75.0, 60.0  # W
SUPPLIED = 293.15  # K
CELL = 0.15  # m
WARM_UP = 1200.0  # s
TRACER = 1e-6  # kg/s: concentrations are scaled to the measured mean afterwards


class Fan(NamedTuple):
    """Rotor in place of a fan: its momentum flux [N], position x, y, height [m] and radius [m]."""

    thrust: float
    position: tuple[float, float, float] = (1.2, 2.28, 1.6)
    radius: float = 0.3


STILL = None
DC_FAN, TOWER_FAN = Fan(0.07), Fan(0.2)


class Setup(NamedTuple):
    """Setup of an experiment: position of the source [m], and the fan that moves the air."""

    source: tuple[float, float, float]
    fan: Fan | None = STILL


TABLE, FLOOR = (2.70, 0.50, 0.90), (2.70, 2.70, 0.0)
SETUPS = {
    1: Setup(TABLE),
    2: Setup(TABLE),
    5: Setup(FLOOR),
    6: Setup(TABLE, DC_FAN),
    8: Setup(TABLE, TOWER_FAN),
    9: Setup(TABLE, TOWER_FAN),
}
"""Setups by the number of the experiment. Of 3, 4, 7 and 10 the position of the source is not known to us."""


class Statistics(NamedTuple):
    """Statistics of a record, see above: layers, rise time [min], time to 1/e [s], mean of the sensors [ppm].

    largest: mean of the largest sensor over the mean of all. fluctuation: standard deviation over the mean.
    """

    low: float
    middle: float
    high: float
    largest: float
    rise: float
    fluctuation: float
    time: float
    mean: float


MEASURED = {
    1: Statistics(0.385, 1.36, 1.26, 2.64, 13.1, 0.119, 13.5, 0.776),
    2: Statistics(0.578, 1.26, 1.17, 2.33, 14.5, 0.0821, 17.5, 1.11),
    5: Statistics(1.26, 0.851, 0.894, 5.65, 20.7, 0.0525, 16.5, 30.1),
    6: Statistics(0.483, 1.39, 1.13, 3.02, 12.5, 0.0591, 12.0, 9.29),
    8: Statistics(0.767, 1.19, 1.04, 2.30, 17.5, 0.0354, 10.0, 4.94),
    9: Statistics(0.756, 1.19, 1.05, 2.15, 13.3, 0.0214, 16.0, 36.2),
}
"""Statistics of the published records by the number of the experiment, as `statistics` computes them."""
WIND = {1: "0.03", 2: "0.06", 5: "0.012", 6: "0.03", 8: "0.07", 9: "0.68"}
"""Mean wind in the middle of the room, as measured [m/s]."""


def statistics(ppm: np.ndarray) -> Statistics:
    """Return the statistics of a record of all sensors (n, 27) [ppm], in the order of SENSORS, every STEP."""
    mean = ppm.mean(axis=1)
    smooth = uniform_filter1d(mean, SMOOTHED, mode="nearest")
    onset = int(np.argmax(smooth > ONSET * smooth.max()))
    end = int(np.flatnonzero(smooth > END * smooth.max())[-1]) + 1
    late = ppm[end - LATE : end]
    by_sensor = late.mean(axis=0)
    low, middle, high = by_sensor.reshape(-1, len(HEIGHTS)).mean(axis=0) / by_sensor.mean()
    fluctuation, time = fluctuations(late)
    return Statistics(
        low,
        middle,
        high,
        by_sensor.max() / by_sensor.mean(),
        rise_time(mean[onset : min(onset + HOUR, end)]) / 60.0,
        float(np.median(fluctuation)),
        float(np.median(time)),
        by_sensor.mean(),
    )


def rise_time(c: np.ndarray) -> float:
    """Return the time constant τ [s] of c (1 - exp(-t/τ)) fitted to a record (n,) every STEP."""
    t = STEP * np.arange(len(c))
    fitted, _ = curve_fit(lambda t, c, tau: c * -np.expm1(-t / tau), t, c, p0=(c[-1], 0.3 * t[-1]))
    return float(fitted[1])


def fluctuations(ppm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return c'/C and the time to 1/e [s] of records (n, sensors), by block and sensor; (blocks, sensors) each."""
    size = min(BLOCK, len(ppm))
    blocks = ppm[: len(ppm) // size * size].reshape(-1, size, ppm.shape[1])
    rest = detrend(blocks, axis=1)
    lag = np.array([[decorrelation(series) for series in block.T] for block in rest])
    return rest.std(axis=1) / blocks.mean(axis=1), lag


def decorrelation(series: np.ndarray) -> float:
    """Return the first lag [s] at which the autocorrelation of a series (n,) every STEP is below 1/e."""
    correlation = correlate(series, series, method="fft")[len(series) - 1 :]
    return STEP * float(np.argmax(correlation < correlation[0] / np.e))


def record(number: int) -> np.ndarray:
    """Return the record of an experiment (n, 27) [ppm] in the order of SENSORS. Raises MissingDataError."""
    return (
        pd.read_csv(data_file(f"orebro/exp{number:02d}.csv.gz", f"doi:{DOI}")).filter(regex="^C_").to_numpy()
    )


def scenario(
    sources: Mapping[str, tuple[float, float, float]],
    fan: Fan | None = STILL,
    cell: float = CELL,
    seed: int = 1,
    supply: float = 1.0,
    heat: float = 1.0,
    minutes: float = 61.0,
) -> Keys:
    """Return the scenario of the office with sources by the name of their vapour, and a probe at each sensor.

    supply, heat: factors of the assumed flow rate and heat. minutes: duration after the release.
    """
    length, width, height = (round(side / cell) * cell for side in SIZE)
    flow = supply * CHANGES / 3600.0 * length * width * height
    vapour = {"molar_mass": 0.0461, "diffusivity": 1.2e-5}
    radius = 1.5 * cell  # three cells across
    desk = 0.75 + radius
    heaters = [
        {"position": position, "power": heat * power, "radius": radius}
        for power, position in (
            (PERSON, (4.0, 3.0, 0.8)),
            (COMPUTER, (1.2, 0.45, desk)),
            (COMPUTER, (4.5, width - 0.45, desk)),
        )
    ]
    warmth: Keys = {"reference": SUPPLIED, "heaters": heaters}
    rotor = {
        "name": "fan",
        "count": 1,
        "algorithm": {"kind": "casting", "speed": 0.0},
        "reach": 0.0,
        "wake": True,
    }
    if fan is not None:
        *place, altitude = fan.position
        rotor |= {
            "start": {"kind": "positions", "positions": [place], "altitude": altitude},
            "body": {
                "kind": "drone",
                "mass": fan.thrust / 9.81,
                "rotors": 1,
                "arm": 0.0,
                "rotor_radius": fan.radius,
                "radius": fan.radius,
            },
        }
    return {
        "name": "orebro_office",
        "seed": seed,
        "duration": 60.0 * minutes,
        "warm_up": WARM_UP,
        "tick": STEP,
        "domain": {"size": (length, width, height), "spacing": cell},
        "wind": {
            "kind": "cfd",
            "openings": [
                {
                    "kind": "inlet",
                    "face": "x-",
                    "center": (2.28, 0.5 * DUCT[1]),
                    "size": DUCT,
                    "speed": flow / (DUCT[0] * DUCT[1]),
                },
                {"kind": "outlet", "face": "z+", "center": (5.1, 2.28), "size": EXHAUST},
            ],
            "buoyancy": {"solutal": False, "heat": warmth},
        },
        "obstacles": [
            {"kind": "box", "center": (3.0, y, 0.675), "size": (4.5, 0.7, 0.15)} for y in (0.35, width - 0.35)
        ],
        "gas": {
            "kind": "mixture",
            "parts": [
                {
                    "kind": "eulerian",
                    "species": {"name": name} | vapour,
                    "sources": [{"position": source, "rate": TRACER, "radius": 0.05, "start": 0.0}],
                }
                for name, source in sources.items()
            ],
        },
        "probes": {
            "every": STEP,
            "points": [
                {"kind": "point", "name": str(n), "at": tuple(point)}
                for n, point in enumerate((*SENSORS.tolist(), ANEMOMETER))
            ],
        },
    } | ({"robots": [rotor]} if fan is not None else {})


class Run(NamedTuple):
    """Gas at the sensors by source (n, 27) [ppm] every STEP, mean horizontal wind at ANEMOMETER [m/s], temperature.

    warmth: mean temperature of each layer in the last 30 minutes, above that of the supply [K].
    """

    ppm: dict[tuple[float, float, float], np.ndarray]
    wind: float
    warmth: np.ndarray


@cache
def run(
    sources: tuple[tuple[float, float, float], ...],
    fan: Fan | None = STILL,
    cell: float = CELL,
    seed: int = 1,
    supply: float = 1.0,
    heat: float = 1.0,
) -> Run:
    """Run the office with releases at several places and return the gas of each; Taichi must have been started."""
    names = {f"source_{n}": source for n, source in enumerate(sources)}
    keys = scenario(names, fan, cell, seed, supply, heat)
    _, times, table = probed(keys)

    def of(name: str) -> np.ndarray:
        return table[name].to_numpy().reshape(len(times), -1)

    late = slice(-LATE, None)
    u, v = (of(f"wind_{axis}")[late, -1] for axis in "xy")
    warmth = of("temperature")[late, :-1].mean(axis=0).reshape(-1, len(HEIGHTS)).mean(axis=0)
    ppm = {source: of(f"{name}_ppm")[:, :-1] for name, source in names.items()}
    return Run(ppm, float(np.hypot(u, v).mean()), warmth - SUPPLIED)


def measured_by_sensors(ppm: np.ndarray, mean: float) -> np.ndarray:
    """Return what MOX at each point reads in gas (n, 27), scaled such that its mean in the last minutes is `mean`."""
    gas = (ppm * (mean / ppm[-LATE:].mean())).astype(np.float32)
    return np.stack([np.array(found[0]) for found in readings([MOX], "ethanol", STEP, gas)])


def of_layers(share: np.ndarray) -> Lines:
    """Return a picture of the layers over time, as means of minutes; share: readings over the final mean (n, 27)."""
    minutes = len(share) // MINUTE
    layers = share[: minutes * MINUTE].reshape(minutes, MINUTE, -1, len(HEIGHTS)).mean(axis=(1, 2))
    return Lines(
        "time since the release [min]",
        "mean of a layer over the final mean of all sensors",
        np.arange(minutes) + 0.5,
        {f"{height:g} m": layer for height, layer in zip(HEIGHTS, layers.T, strict=True)},
    )


def compared(
    airs: int,
    numbers: Sequence[int],
    cell: float = CELL,
    supply: float = 1.0,
    heat: float = 1.0,
) -> Results:
    """Return the statistics of experiments with the same fan in several flow realisations, and their deviations."""
    setups = [SETUPS[number] for number in numbers]
    (fan,) = {setup.fan for setup in setups}
    sources = tuple(dict.fromkeys(setup.source for setup in setups))
    values: dict[str, list[float]] = {}
    pictures: dict[str, Lines] = {}
    for seed in range(1, airs + 1):
        found = run(sources, fan, cell, seed, supply, heat)
        layers, rises = [], []
        for number, setup in zip(numbers, setups, strict=True):
            measured = MEASURED[number]
            read = measured_by_sensors(found.ppm[setup.source], measured.mean)
            ours = statistics(read)
            for field, name in NAMES.items():
                values.setdefault(f"{name}, exp. {number}", []).append(getattr(ours, field))
            layers += np.subtract(ours[:3], measured[:3]).tolist()
            rises.append(np.log(ours.rise / measured.rise))
            if (cell, supply, heat) == (CELL, 1.0, 1.0):
                pictures[f"layers, exp. {number}"] = of_layers(read / measured.mean)
        values.setdefault(LAYERS, []).append(float(np.sqrt(np.mean(np.square(layers)))))
        values.setdefault(RISES, []).append(float(np.exp(np.sqrt(np.mean(np.square(rises))))))
        values.setdefault("wind in the middle [m/s]", []).append(found.wind)
        for height, kelvin in zip(HEIGHTS, found.warmth, strict=True):
            values.setdefault(f"warmer than the supply at {height:g} m [K]", []).append(float(kelvin))
    return {name: over_airs(numbers) for name, numbers in values.items()} | pictures


def of_records(_: int) -> Results:
    """Return the statistics of the published records, which MEASURED has; raises MissingDataError."""
    found = {number: statistics(record(number)) for number in MEASURED}
    return {
        f"{name}, exp. {number}": Mean(float(getattr(part, field)), None, None, 1)
        for number, part in found.items()
        for field, name in NAMES.items()
    }


NAMES = {
    "low": "low layer",
    "middle": "middle layer",
    "high": "high layer",
    "largest": "largest sensor over the mean",
    "rise": "rise time [min]",
    "fluctuation": "c'/C",
    "time": "time to 1/e [s]",
}
"""Names of the compared statistics by field."""
LAYERS, RISES = "deviation of the layers, rms", "deviation of the rise times, factor"
FACTORS = {"largest": 1.5, "rise": 4.0 / 3.0, "fluctuation": 2.0, "time": 2.0}
WITHIN = 0.2  # of the layers


def published(numbers: Sequence[int]) -> dict[str, str]:
    """Return the measured values of experiments, by the names of our quantities."""
    table = {
        f"{name}, exp. {number}": f"{getattr(MEASURED[number], field):.3g}"
        for number in numbers
        for field, name in NAMES.items()
    }
    return table | {"wind in the middle [m/s]": ", ".join(dict.fromkeys(WIND[number] for number in numbers))}


def expected(numbers: Sequence[int]) -> dict[str, Range]:
    """Return the expected ranges of the quantities of experiments."""
    ranges = {}
    for number in numbers:
        for field, name in NAMES.items():
            value, factor = getattr(MEASURED[number], field), FACTORS.get(field)
            ends = (value - WITHIN, value + WITHIN) if factor is None else (value / factor, value * factor)
            ranges[f"{name}, exp. {number}"] = Range(*(float(f"{end:.3g}") for end in ends))
    return ranges


def exactly(numbers: Sequence[int]) -> dict[str, Range]:
    """Return ranges of 1 % around the statistics of MEASURED."""
    return {
        f"{name}, exp. {number}": Range(
            0.99 * getattr(MEASURED[number], field), 1.01 * getattr(MEASURED[number], field)
        )
        for number in numbers
        for field, name in NAMES.items()
    }


UNMOVED, DC, TOWER = (1, 2, 5), (6,), (8, 9)
DISCUSSION = (
    "25 of 42 bounds are met. Reproduced is the room with the tower fan: layers of 0.93, 1.08 and 0.99 of the mean, "
    "where 0.76, 1.19 and 1.05 were measured, and a rise time of 14 minutes (17.5 and 13). Reproduced are also the "
    "layers above a source on the floor without a fan: 1.09, 0.97 and 0.94 (1.26, 0.85 and 0.89). With the DC fan the "
    "high layer and the rise time agree, but its vertical jet mixes the low layer too much: 0.78 instead of 0.48. The "
    "measured wind of 0.68 m/s in experiment 9 is that of a horizontal jet, which we do not have.\n\n"
    "Not reproduced are the layers of a source on the table without a fan (experiments 1 and 2). Ours are 0.11, 1.04 "
    "and 1.85, so that the vapour collects under the ceiling; measured are 0.39 to 0.58, 1.26 to 1.36 and 1.17 to "
    "1.26. The rise time of 7.5 minutes is too short (13 to 14.5), as only the upper layer fills. The room is too "
    "strongly stratified: the air at 0.45 m is 0.1 K and at 2.23 m 2.4 K warmer than the supply.\n\n"
    "The unknown that explains most of it is the heat. The layers of experiments 1, 2 and 5 deviate by 0.38 (rms), and "
    "without heat by 0.23; the rise times by a factor of 1.8, and without heat of 1.3. No other change comes as "
    "close: twice the supply gives 0.32 and 2.8, half the supply 0.50 and 1.6, twice the heat 0.40 and 1.9. The "
    "measured low and high layers of experiments 1 and 2 lie between those without heat (0.79 and 0.93) and those with "
    "it; the middle layer is that without heat, 1.28. So less heat is one explanation. Walls that exchange heat are "
    "another, not tried here: radiation warms the floor of real rooms and, with it, the low air. Neither was "
    "fitted.\n\n"
    "Fluctuations: c'/C of 0.18 to 0.20 at the table is 1.7 and 2.2 times the measured value, for the source on the "
    "floor 0.06 agrees with 0.05. The time to 1/e is 20 to 33 s in all runs, where 10 to 17.5 s was measured. "
    "Cells of 15 cm carry no eddies below half a metre; also, the published sensors may be quicker than ours with its "
    "16 s. The largest sensor above the source on the floor reads 2.6 times the mean, where 5.7 was measured: a cell "
    "dilutes the vapour near the source, and the weight of the vapour, which we neglect, may hold it down. Each "
    "condition is a single air, so that differences of a few per cent mean nothing. "
    "Coarse cells are not the reason for the layers: cells of 20 cm give the same high layer, 1.82, and the same "
    "deviation, 0.38, but a rise time of 9.8 minutes. Finer cells were not run."
)
PLAIN = "no fan|DC fan|tower fan"
LAYER = (
    0.62 / 3.0
)  # calibrated sensors of a layer deviate by 0.62 in ln c (`sensor_records`); a layer has nine
CASES = (
    Experiment(
        "orebro_office",
        "layers of gas, rise times and fluctuations in an office with displacement ventilation",
        f"Burgués et al. 2018, doi:{DOI}",
        (
            *(
                Condition(name, partial(compared, numbers=numbers), published(numbers), expected(numbers))
                for name, numbers in (("no fan", UNMOVED), ("DC fan", DC), ("tower fan", TOWER))
            ),
            *(
                Condition(f"no fan, {words}", partial(compared, numbers=UNMOVED, **keys), published(UNMOVED))
                for words, keys in (
                    ("half the supply", {"supply": 0.5}),
                    ("twice the supply", {"supply": 2.0}),
                    ("no heat", {"heat": 0.0}),
                    ("twice the heat", {"heat": 2.0}),
                    ("cells of 20 cm", {"cell": 0.2}),
                )
            ),
        ),
        trials=1,
        test_trials=0,
        evidence="measured",
        compared=(
            Comparison("mean concentration", "(low|middle|high) layer, .*", PLAIN, sigma=LAYER),
            Comparison("concentration fluctuation", "c'/C, .*", PLAIN),
            Comparison("velocity", r"wind in the middle \[m/s\]", PLAIN),
        ),
        discussion=DISCUSSION,
    ),
    Experiment(
        "orebro_records",
        "statistics of the published records of the office",
        f"Burgués et al. 2018, doi:{DOI}",
        (Condition("records", of_records, expected=exactly(UNMOVED + DC + TOWER)),),
        trials=1,
        test_trials=0,
        evidence="measured",
        compared="the records themselves; `orebro_office` is beside them",
    ),
)
