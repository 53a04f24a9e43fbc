"""Noise and lag of metal-oxide sensors recorded by others in a room, beside the noise and lag of our models.

Burgués, Hernandez, Lilienthal & Marco 2018 (doi:10.3390/proceedings2130911) recorded an evaporating liquid in an office
at Örebro with 27 sensors, each calibrated in a laboratory: the data set Orebro3DSEN, six records of 99 to 127 minutes
at 2 Hz, read from `orebro/exp01.csv.gz` and so on (see `published_data`). The data set names neither the TGS model at
each position nor the processing of the readings. It names the load resistor of 68 kOhm and the converter, of an Arduino
Mega, with 10 bits.

Bounds that follow for any gas, as a first-order lag approaches its goal exponentially, are:

- The signal y = ln(R_air/R) = b ln(1 + c/c0) falls at most to clean air. A fall from y1 to y2 within w shows a decay
  time of at most w/ln(y1/y2), from which b cancels. If the lag acted on R instead, y is 1 - (1 + c/c0)^-b here.
- A rise gives no such bound, since the goal may be anything.
- A digit of the converter is at least 4/1024 of ln R, where the sensor has the resistance of the load; for R_air of the
  TGS 26xx it is at most 0.013.

Expected, set after a look at records 01 and 05 alone, and before any reading of our sensors was computed:

- Noise of ln R, in digits of 4/1024 each: 0.0015 to 0.006, a factor of two about our default of 0.003.
- In at most 5 % of the sensor records gas falls faster than every TGS model allows with its default decay time.
- Our default sensor in the recorded gas falls at least half as steeply as recorded, as a second equal lag would; it
  keeps 0.5 to 1.1 of the fluctuation intensity c'/C, and its correlation time is at most twice as long.

The statistics of fluctuations are those of `orebro_office`, with linear trends removed; first, a moving mean of ten
minutes was, which gave 0.96 of c'/C and 1.4 times the time.

Added after the first run, and not judged: numbers of sensors that are faster in any record, drift as a random walk, and
differences between sensors. The ratio of rises to falls became a median, as its mean depends on a few sensors.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import median_abs_deviation

from taichi_plume.fluctuations.sensor_comparison import readings
from taichi_plume.scenario.metal_oxides import MOX_MODELS
from taichi_plume.scenario.sensors import MoxSensor
from taichi_plume.validation import orebro_office
from taichi_plume.validation.case import Comparison, Keys
from taichi_plume.validation.experiment import (
    CORRELATION,
    Condition,
    Experiment,
    Lines,
    Mean,
    Range,
    Results,
    over_airs,
)
from taichi_plume.validation.orebro_office import DOI

RECORDS = (1, 2, 5, 6, 8, 9)
GAS = "ethanol"
STEP = 0.5  # s
QUIET = 240.0  # s from the start, before gas arrives
SMOOTHING = 30.0  # s: slower changes in clean air are drift
WINDOW = 5.0  # s, of falls and rises
CORRELATED = 2.0  # s, over which noise in clean air is alike in records 01 and 05
LEAST = 1.0  # ppm before a fall, after a rise
STRONG, WEAK = 20.0, 5.0  # deviations in clean air: least level before and after a fall
LAYERS = 3
NORMAL = 0.6745  # median absolute deviation over standard deviation
DIGIT = 4.0 / 1024.0  # of ln R
TGS = tuple(name for name in MOX_MODELS if name.startswith("tgs"))
DEFAULT = MoxSensor(kind="mox")
OURS = {sensor.model: sensor for sensor in (DEFAULT, MoxSensor(kind="mox", model="tgs2620"))}


class Record(NamedTuple):
    """Record of sensors: gas (n, sensors) [ppm], the mean and the deviation in clean air (sensors,)."""

    ppm: np.ndarray
    clear: np.ndarray
    deviation: np.ndarray

    @staticmethod
    def of(ppm: np.ndarray) -> "Record":
        """Return the record of readings (n, sensors) [ppm], STEP apart, that begin in clean air."""
        quiet = ppm[: round(QUIET / STEP)]
        return Record(ppm - quiet.mean(axis=0), quiet.mean(axis=0), quiet.std(axis=0))

    @property
    def quiet(self) -> np.ndarray:
        """Readings in clean air over their mean [ppm]."""
        return self.ppm[: round(QUIET / STEP)]


@cache
def records(count: int) -> tuple[Record, ...]:
    """Return the first records; raises MissingDataError without their files."""
    return tuple(Record.of(orebro_office.record(number)) for number in RECORDS[:count])


@cache
def our_records(count: int) -> dict[str, tuple[Record, ...]]:
    """Return the records of our sensors in the recorded gas, by model. Taichi must have been started."""
    found: dict[str, list[Record]] = {name: [] for name in OURS}
    for record in records(count):
        gas = np.maximum(record.ppm, 0.0).astype(np.float32)
        measured = np.stack([np.array(now) for now in readings(list(OURS.values()), GAS, STEP, gas)], axis=1)
        for name, ppm in zip(OURS, measured, strict=True):
            found[name].append(Record.of(ppm.astype(float)))
    return {name: tuple(parts) for name, parts in found.items()}


# ---------------------------------------------------------------- statistics of a record, (sensors,) each


def noise(record: Record) -> np.ndarray:
    """Return the standard deviation of the changes in clean air that are faster than SMOOTHING [ppm]."""
    quiet = record.quiet
    return (quiet - uniform_filter1d(quiet, round(SMOOTHING / STEP), axis=0)).std(axis=0)


def digit(record: Record) -> np.ndarray:
    """Return the gas [ppm] per digit of the converter in clean air; NaN if the readings show too few digits.

    Levels are values that last for 2 s, since readings between them are interpolated.
    """
    found = []
    for series in record.quiet.T:
        starts = np.flatnonzero(np.diff(series, prepend=np.nan) != 0.0)
        lasting = np.diff(starts, append=len(series)) >= round(2.0 / STEP)
        steps = np.abs(np.diff(series[starts[lasting]]))
        steps = steps[steps > 0.004]  # above rounding to 0.001 ppm
        found.append(np.median(steps) if len(steps) > 4 else np.nan)
    return np.array(found)


def drift(record: Record) -> np.ndarray:
    """Return the random walk [ppm per root hour] whose minute means vary as much as those in clean air, without noise.

    A random walk of variance q t has within a time T a variance of q T/6 about its mean; the average over minutes, and
    what counts as noise, make it smaller.
    """
    minute = round(60.0 / STEP)
    quiet = record.quiet
    means = quiet[: len(quiet) // minute * minute].reshape(-1, minute, quiet.shape[1]).mean(axis=1)
    white = noise(record) ** 2 / (60.0 / CORRELATED)
    walk = np.maximum(means.var(axis=0) - white, 0.0)
    return np.sqrt(6.0 * walk / (QUIET / 3600.0))


def steepest(record: Record, signal: Callable[[np.ndarray], np.ndarray], rise: bool = False) -> np.ndarray:
    """Return the largest rate of ln y within WINDOW [1/s] in falls or rises of strong gas; NaN without any.

    signal: y as a function of gas [ppm] over clean air.
    """
    width = round(WINDOW / STEP)
    before, after = record.ppm[:-width], record.ppm[width:]
    low, high = (before, after) if rise else (after, before)
    valid = (
        (high > np.maximum(LEAST, STRONG * record.deviation)) & (low > WEAK * record.deviation) & (low > 0.0)
    )
    rate = np.full(low.shape, -np.inf)
    rate[valid] = np.log(signal(high[valid]) / signal(low[valid])) / WINDOW
    best = rate.max(axis=0)
    return np.where(best > 0.0, best, np.nan)


def fluctuation(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Return c'/C and the time of the autocorrelation to 1/e [s] in the second half; NaN without strong gas.

    Medians over the blocks of `orebro_office.fluctuations`.
    """
    gas = record.ppm[len(record.ppm) // 2 :]
    strong = gas.mean(axis=0) > np.maximum(0.3, STRONG * record.deviation)
    intensity, time = (np.median(part, axis=0) for part in orebro_office.fluctuations(gas))
    return np.where(strong, intensity, np.nan), np.where(strong, time, np.nan)


def logarithm(ppm: np.ndarray, model: str) -> np.ndarray:
    """Return ln(R_air/R) of a model in GAS, in units of its exponent b."""
    return np.log1p(ppm / _curve(model)[0])


def conductive(ppm: np.ndarray, model: str) -> np.ndarray:
    """Return 1 - R/R_air of a model in GAS."""
    c0, b = _curve(model)
    return -np.expm1(-b * np.log1p(ppm / c0))


def _curve(model: str) -> tuple[float, float]:
    return MOX_MODELS[model].curve(GAS) or (MOX_MODELS[model].c0, MOX_MODELS[model].b)


# ---------------------------------------------------------------- conditions


def clean_air(count: int) -> Results:
    """Return the noise and drift in clean air."""
    several = records(count)
    airs = _airs(several)
    noises = np.concatenate([noise(record) for record in several])
    per_digit = DIGIT / np.concatenate([digit(record) for record in several])
    drifts = np.concatenate([drift(record) for record in several])
    quantities: Keys = {
        NOISE: over_airs(per_digit * noises, airs),
        "drift of ln R, at least [per root hour]": over_airs(per_digit * drifts, airs),
        "noise [ppm]": over_airs(noises, airs),
        "zero of a sensor, rms [ppm]": over_airs([float(np.sqrt((r.clear**2).mean())) for r in several]),
    }
    for name in (DEFAULT.model, *TGS):
        c0, b = _curve(name)
        quantities[f"{name}: noise, ours [ppm]"] = Mean(DEFAULT.noise * c0 / b, None, None, 1)
    return quantities


def falls(count: int) -> Results:
    """Return the sensors that fall faster than our models allow, and how much steeper rises are than falls."""
    several = records(count)
    quantities: Keys = {}
    longest = {}
    for words, signal in (("ln R lags", logarithm), ("R lags", conductive)):
        every = np.ones((len(several), len(several[0].clear)))
        for name in (DEFAULT.model, *TGS):
            rate = np.stack([steepest(record, partial(signal, model=name)) for record in several])
            faster = np.where(np.isnan(rate), np.nan, rate * MOX_MODELS[name].decay > 1.0)
            every *= faster if name in TGS else 1.0
            once = float((np.nansum(faster, axis=0) > 0).mean())
            quantities[f"{words}: share of sensors faster than {name} allows, in any record"] = Mean(
                once, None, None, faster.shape[1]
            )
            longest[words, name] = np.sort(1.0 / np.nanmax(rate, axis=0))
        quantities[f"{words}: {EVERY}"] = over_airs(every.ravel(), _airs(several), share=True)
    ratios = [steepest(r, np.asarray, rise=True) / steepest(r, np.asarray) for r in several]
    quantities[RISE_OVER_FALL] = over_airs([float(np.nanmedian(ratio)) for ratio in ratios])
    quantities["longest decay time that the falls of a sensor allow"] = Lines(
        "sensors",
        "decay time [s]",
        np.arange(1.0, len(several[0].clear) + 1.0),
        {f"{words}, {name}": longest[words, name] for words in ("ln R lags", "R lags") for name in OURS},
    )
    return quantities


def differences(count: int) -> Results:
    """Return how far sensors of a layer differ in the second half, and how much of this all records share."""
    logs = []
    for record in records(count):
        mean = np.maximum(record.ppm[len(record.ppm) // 2 :].mean(axis=0), 1e-3)
        by_layer = np.log(mean).reshape(-1, LAYERS)  # the last index of a sensor is its layer
        logs.append((by_layer - np.median(by_layer, axis=0)).ravel())
    pairs = np.corrcoef(logs)[np.triu_indices(len(logs), 1)]
    shared = median_abs_deviation(np.mean(logs, axis=0), scale=NORMAL)
    return {
        "deviation of ln c in a layer": over_airs(
            [float(median_abs_deviation(log, scale=NORMAL)) for log in logs]
        ),
        "deviation of the mean of ln c over the records": Mean(float(shared), None, None, len(logs[0])),
        "correlation of ln c between records": over_airs(pairs, limits=CORRELATION),
    }


def _airs(several: Sequence[Record]) -> np.ndarray:
    """Return the index of the record of each sensor, record by record."""
    return np.repeat(np.arange(len(several)), len(several[0].clear))


def in_recorded_gas(count: int) -> Results:
    """Return how our sensors change the recorded gas: steepest falls, fluctuation intensity, correlation time."""
    several = records(count)
    airs = _airs(several)
    falling = np.concatenate([steepest(r, np.asarray) for r in several])
    parts = [fluctuation(r) for r in several]
    intensity, time = (np.concatenate(part) for part in zip(*parts, strict=True))
    quantities: Keys = {
        "c'/C, recorded": over_airs(intensity, airs),
        "time to 1/e, recorded [s]": over_airs(time, airs),
    }
    for name, ours in our_records(count).items():
        slower = np.concatenate([steepest(r, np.asarray) for r in ours])
        rising = np.concatenate([steepest(r, np.asarray, rise=True) for r in ours])
        parts = [fluctuation(r) for r in ours]
        our_intensity, our_time = (np.concatenate(part) for part in zip(*parts, strict=True))
        quantities |= {
            f"{name}: {STEEPNESS}": over_airs(slower / falling, airs),
            f"{name}: {INTENSITY}": over_airs(our_intensity / intensity, airs),
            f"{name}: {TIME}": over_airs(our_time / time, airs),
            f"{name}: {RISE_OVER_FALL}": over_airs(
                [float(np.nanmedian((rising / slower)[airs == n])) for n in range(len(several))]
            ),
        }
    return quantities


NOISE = "noise of ln R, at least"
EVERY = "share of records faster than every TGS allows"
RISE_OVER_FALL = "steepest rise over steepest fall of ln c, median"
STEEPNESS = "steepest fall, ours over recorded"
INTENSITY = "c'/C, ours over recorded"
TIME = "time to 1/e, ours over recorded"
DISCUSSION = (
    "Noise agrees: at least 0.0028 of ln R, 0.7 digits of a converter of 10 bits, where ours is 0.003. In ppm it "
    "is 0.03; of our models the TGS 2620 comes nearest (0.018). Minute means wander more than white noise allows. "
    "As a random walk of ln R this is 0.018 in the root of an hour. Our `drift` is 0 by default; the 0.02 that "
    "its description names is of the same size.\n\n"
    "Not met: in 9 of 139 sensor records, of 6 sensors, the reading falls faster within 5 s than the default "
    "decay time of any TGS allows; over 10 s it is 3 records of 1 sensor. In some record 21 of the 27 sensors "
    "fall faster than our TGS 2620 recovers (15.7 s), 20 than our TGS 822 (20 s), 13 than the TGS 2602 and 9 than "
    "the TGS 2600 (both 18.75 s), 6 than the TGS 2610, 2611 and 2612 (6.35 s), and 5 than the MiCS-5524 (8 s). "
    "Noise does not explain it: with gas of at least 20 instead of 5 deviations after the fall, 18 are faster "
    "than the TGS 2620; over 10 s 14 are. So at most 6 of the 27 can be a TGS 2620 as we model it. The data set "
    "does not say which sensor is which model, nor how readings were processed. So no default is changed.\n\n"
    "One difference is known: the time constants of the TGS 26xx are those of GADEN, whose lag acts on R, ours on "
    "ln R. In strong gas a lag of R recovers faster in ln R, and rises more slowly. With such a lag 19 sensors "
    "are still faster than the TGS 2620, 6 than the TGS 2600 and 1 than the MiCS-5524. Another may be that a film "
    "recovers faster after a short whiff than after minutes of gas, for which `slow_share` has a second time "
    "constant. Neither was examined.\n\n"
    "The steepest rise of ln c is 1.0 to 2.2 times the steepest fall, in the median of the sensors of five "
    "records; in the sixth, with the fastest air, it is 13 times. Our MiCS-5524 makes 1.5 to 3.7 of the former. "
    "In the recorded gas, which a real sensor has already smoothed, it falls 0.57 times as steeply, where an "
    "equal lag would give about half, and keeps 0.93 of the intensity; the correlation time becomes 1.3 times as "
    "long.\n\n"
    "Sensors of a layer differ by a standard deviation of 0.6 in ln c, a factor of 1.9, though each was "
    "calibrated. Records share this pattern (correlation 0.76), for sources at two positions and three kinds of "
    "ventilation, so most of it belongs to the sensors or to the room, not to the plume. It bounds the error of a "
    "calibrated reading from above; ours has none by default.\n\n"
    "Vuka et al. 2016 measured a deviation of 11.6 to 14.6 digits 2 m behind a source, 6.7 to 8.0 in faster wind, "
    "and 0.9 without gas: signals of 13 to 16 and 7 to 9 times the noise. Those of `bouts_distance` are 97 and 56 "
    "times the default noise. The amount of gas is not published, so neither the noise nor the gas can be called "
    "wrong."
)

CASES = (
    Experiment(
        "sensor_records",
        "noise and lag of 27 metal oxides in an office, recorded by others, beside those of our models",
        f"Burgués et al. 2018, doi:{DOI}",
        (
            Condition("clean air", clean_air, expected={NOISE: Range(0.0015, 0.006)}),
            Condition("falls and rises", falls, expected={f"ln R lags: {EVERY}": Range(most=0.05)}),
            Condition("differences between sensors", differences),
            Condition(
                "our sensors in the recorded gas",
                in_recorded_gas,
                expected={
                    f"{DEFAULT.model}: {STEEPNESS}": Range(least=0.5),
                    f"{DEFAULT.model}: {INTENSITY}": Range(0.5, 1.1),
                    f"{DEFAULT.model}: {TIME}": Range(most=2.0),
                },
            ),
        ),
        evidence="measured",
        compared=(Comparison("concentration fluctuation", ".*: c'/C, ours over recorded", measured=1.0),),
        trials=len(RECORDS),
        test_trials=0,
        discussion=DISCUSSION,
    ),
)
