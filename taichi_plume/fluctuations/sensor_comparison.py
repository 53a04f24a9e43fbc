"""Whiffs that gas sensors resolve: the sensor models of robots measure the time series of fixed points.

A sensor keeps a whiff if the reading rises through the threshold between the starts of this whiff and the next whiff: a
robot that compares readings with the threshold then counts the whiff. For this the reading must reach the threshold in
the whiff, and must have fallen below the threshold in the blank before. The threshold of readings is the threshold of
the air times the sensor's reading of 1 ppm of this gas. A kept whiff counts once, however often noise crosses the
threshold; `rises` counts all crossings.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.fluctuations.durations import stretches
from taichi_plume.scenario.metal_oxides import MOX_MODELS
from taichi_plume.scenario.sensors import GasSensor, IdealGasSensor, MoxSensor, PidSensor

SLOW, FAST = 12.0, 0.05  # s
MOST_POINTS = 100  # most points at which the sensors measure
MOST_NUMBERS = 2e8  # most samples times sensors
MOST_TICKS = 200_000


class NamedSensor(NamedTuple):
    """Gas sensor model with a name that describes its kind and lag."""

    name: str
    model: GasSensor


class SensorWhiffs(NamedTuple):
    """Number of whiffs, of those that a gas sensor detects (`seen`), and of its rises through `threshold` [ppm]."""

    sensor: NamedSensor
    whiffs: int
    seen: int
    rises: int
    threshold: float

    @property
    def share(self) -> float:
        """Fraction of the whiffs that the gas sensor detects; NaN if there are no whiffs."""
        return self.seen / self.whiffs if self.whiffs else float("nan")


class SensorComparison(NamedTuple):
    """Comparison of gas sensors: counts of whiffs; true gas (n,) and readings (sensors, n) at the first point [ppm].

    stored: readings of one sensor at all points, (n, points) [ppm], if any were asked for.
    """

    sensors: list[SensorWhiffs]
    step: float
    true: np.ndarray
    readings: np.ndarray
    stored: np.ndarray | None = None

    def in_words(self) -> str:
        """Return the shares of whiffs that the slow and the fast sensor keep, in words."""
        slow, fast = self.sensors[:2]
        return (
            f"of {slow.whiffs:,} whiff{'s' * (slow.whiffs != 1)} a metal oxide of 12 s keeps {slow.share:.0%}, "
            f"a detector of 50 ms {fast.share:.0%}"
        )


def compared_sensors(others: Sequence[GasSensor] = ()) -> list[NamedSensor]:
    """Return gas sensors to compare: a slow metal oxide, a fast photo-ionisation detector, defaults, and `others`."""
    known: list[GasSensor] = [
        MoxSensor(kind="mox", rise_time=SLOW, decay_time=SLOW),
        PidSensor(kind="pid", rise_time=FAST, decay_time=FAST, period=FAST / 5),
        *(MoxSensor.model_validate({"kind": "mox", "model": name}) for name in MOX_MODELS),
        PidSensor(kind="pid"),
        IdealGasSensor(kind="ideal"),
    ]
    return [NamedSensor(_name(sensor), sensor) for sensor in (*known, *others)]


def default_mox(several: Sequence[NamedSensor]) -> int:
    """Return the index of the metal oxide with the default model and lag among gas sensors."""
    model = MoxSensor(kind="mox").model
    return next(
        n
        for n, (_, sensor) in enumerate(several)
        if isinstance(sensor, MoxSensor) and sensor.model == model and sensor.rise_time is None
    )


def _name(sensor: GasSensor) -> str:
    signal = sensor.signal
    what = {"mox": "metal oxide", "pid": "photo-ionisation detector", "ideal": "ideal sensor"}[sensor.kind]  # type: ignore[attr-defined]
    if isinstance(sensor, MoxSensor):
        what += f" {sensor.model}"
    if signal.rise == signal.decay:
        lag = f"{_time(signal.rise)}" if signal.rise else "no lag"
    else:
        lag = f"{_time(signal.rise)} up, {_time(signal.decay)} down"
    return f"{what}, {lag}, read every {_time(sensor.period)}"


def _time(seconds: float) -> str:
    return f"{seconds * 1e3:g} ms" if seconds < 1.0 else f"{seconds:g} s"


class _Gas(NamedTuple):
    """Gas species with the attributes that sensor models need."""

    name: str
    ppm_per_density: float = 1.0


def readings(
    sensors: Sequence[GasSensor],
    gas: str,
    step: float,
    ppm: np.ndarray,
    seed: int = 0,
    background: float = 0.0,
) -> Iterator[np.ndarray]:
    """Yield the readings of gas sensors, (sensors, points) [ppm], at each sample of given concentrations of one gas.

    ppm: concentrations (n, points), `step` [s] apart, the time step of the sensors; the air before is clean. The
    sensors are on robots that stand at the points. background: of the gas in clean air [ppm], above which
    concentrations and readings count. Starts Taichi unless it is running.
    """
    from taichi_plume.agents.sensors import Sensors as Measuring
    from taichi_plume.agents.swarm import Swarm
    from taichi_plume.engine import program, ti
    from taichi_plume.fluctuations.still_air import Floor, Records
    from taichi_plume.scenario.algorithms import Casting
    from taichi_plume.scenario.robots import Group
    from taichi_plume.scenario.sensors import Sensors
    from taichi_plume.scenario.starts import StartAt

    program.ensure_started()
    points = ppm.shape[1]
    start = StartAt(kind="positions", positions=((0.0, 0.0),))
    groups = [
        Group(
            name=f"sensor {n}",
            count=points,
            start=start,
            algorithm=Casting(kind="casting"),
            sensors=Sensors.model_validate({"gas": sensor.model_copy(update={"ahead": 0.0})}),
        )
        for n, sensor in enumerate(sensors)
    ]
    places = np.zeros((points * len(groups), 2))
    places[:, 0] = np.tile(np.arange(points), len(groups))
    still = places, np.zeros(len(places)), Floor(), np.empty((0, 2)), seed
    swarm = Swarm(groups, *still, background=background > 0.0)
    species: Any = (_Gas(gas),)
    measuring = Measuring(swarm, 2, step, species, background=(background,) if background else ())
    air: Any = Records(ti.field(ti.f32, points), species)
    for n, values in enumerate(ppm):
        air.level.from_numpy(values + np.float32(background))
        measuring.measure(air, air, n + 1, (n + 1) * step)
        yield swarm.reading.to_numpy()[: len(places)].reshape(len(groups), points)


def compare_sensors(
    several: Sequence[NamedSensor],
    gas: str,
    step: float,
    ppm: np.ndarray,
    threshold: float,
    seed: int = 0,
    store: int | None = None,
    background: float = 0.0,
) -> SensorComparison:
    """Simulate gas sensors on time series (n, points) [ppm], `step` [s] apart; count the whiffs that each detects.

    A sensor detects a whiff if its reading rises above the threshold [ppm] during the whiff or the blank after it.
    Whiffs that the ends of the record cut do not count. store: index of a sensor whose readings at all points are
    returned as well. background: see `readings`.
    """
    models = [sensor.model for sensor in several]
    least = np.array(
        [model.reads(gas, background + threshold) - model.reads(gas, background) for model in models]
    )
    above = np.zeros((len(models), ppm.shape[1]), bool)
    rises = np.zeros((len(ppm), *above.shape), bool)
    first = np.zeros((len(ppm), len(models)), np.float32)
    stored = None if store is None else np.zeros(ppm.shape, np.float32)
    for n, found in enumerate(readings(models, gas, step, ppm, seed, background)):
        now = (found > least[:, None]) & (least[:, None] > 0.0)
        rises[n] = now & ~above
        above, first[n] = now, found[:, 0]
        if stored is not None:
            stored[n] = found[store]
    whiffs, seen, total = 0, np.zeros(len(models), int), np.zeros(len(models), int)
    for point in range(ppm.shape[1]):
        begins, end = _windows(ppm[:, point] > threshold)
        if len(begins):
            counts = np.add.reduceat(rises[:end, :, point].astype(int), begins, axis=0)
            whiffs += len(begins)
            seen += (counts > 0).sum(axis=0)
            total += counts.sum(axis=0)
    rows = zip(several, seen.tolist(), total.tolist(), least.tolist(), strict=True)
    return SensorComparison(
        [SensorWhiffs(sensor, whiffs, *row) for sensor, *row in rows], step, ppm[:, 0], first.T, stored
    )


def _windows(present: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the first sample of each complete whiff, and the end index of the last window (whiff and blank after)."""
    cuts = stretches(present)
    begins = cuts[:-1]
    whole = begins[present[begins] & (begins > 0) & (cuts[1:] < len(present))]
    return whole, int(begins[-1]) if present[-1] and len(begins) > 1 else len(present)
