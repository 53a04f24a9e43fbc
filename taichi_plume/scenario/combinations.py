"""Warnings about combinations of a scenario's values that are allowed but probably not meant.

A warning is a line and cheap to compute; uncertain ones keep a wide margin, so that they are seldom wrong.
"""

from collections.abc import Iterator
from math import hypot, sqrt
from typing import NamedTuple

import numpy as np

from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.gases import AnySource, PureGas
from taichi_plume.scenario.plume_tracking import PlumeTracking
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.search_algorithm import Listening
from taichi_plume.scenario.sensors import MoxSensor, TdlasSensor
from taichi_plume.scenario.species import PRESSURE
from taichi_plume.scenario.starts import StartArea
from taichi_plume.scenario.windows import Region
from taichi_plume.scenario.winds import FrozenWind

SLOW = 0.1  # of the fastest air of a computed flow: seldom slower at a source
PEAK = 3.0  # standard deviations of noise: exceeded every few minutes
AT_THE_END = 0.05  # of the room: a source this near to the outlet makes hardly a plume
MISSED_MEAN = 20
"""Cells downwind of a small source within which the grid's mean is too low, in a wind of 10 % intensity (air.md)."""
FEWEST_ACROSS = 3  # cells of an opening that blows, and of a heater
FEWEST_ACROSS_BODY = 3  # cells of an obstacle: with 3 there is hardly a recirculation behind a cylinder
TRUSTED_ACROSS_BODY = 8  # cells: with more, the drag of a cylinder is within 20 % of that with 32
FEWEST = 6  # cells across a room whose flow is computed
JET = 0.25  # growth of a jet's half width with the distance: beyond, the air recirculates


class Course(NamedTuple):
    """Common flow direction of all air in a room, as a unit vector, and its largest speed [m/s]."""

    along: np.ndarray
    speed: float


def course(context: Context) -> Course | None:
    """Return direction and top speed of air that all flows one way: uniform wind, or face to face; otherwise None."""
    scenario, dim = context.scenario, context.domain.dim
    uniform, speed = scenario.wind.uniform, scenario.wind.top_speed(scenario)
    if not speed:
        return None
    if uniform is not None:
        return Course(uniform.frame[0], speed)
    ways: set[tuple[int, int]] = set()
    blown = [
        opening.blows and (opening.follows_pressure or opening.inflow(0.0, context.domain) > 0)
        for opening in scenario.openings
    ]
    for opening, inward in zip(scenario.openings, blown, strict=True):
        region = opening.region
        if region is None or opening.changes:
            return None
        if opening.passes:
            comes_in = inward if opening.blows else not any(blown)  # outflow balances the other openings
            ways.add((region.axis, 1 if comes_in == (region.side == 0) else -1))
    if len(ways) != 1:
        return None
    ((axis, sign),) = ways
    return Course(sign * np.eye(dim)[axis], speed)


def warnings(context: Context) -> Iterator[str]:
    """Yield all warnings about combinations of values in a scenario without errors."""
    where = course(context)
    yield from _air(context, where)
    yield from _narrow(context)
    for path, source, gas in _emitters(context):
        yield from _source(path, source, gas, context, where)
    yield from _concentrations(context)
    for n, group in enumerate(context.scenario.robots):
        yield from _group(f"robots[{n}]", group, context, where)


# ---------------------------------------------------------------- air


def _air(context: Context, where: Course | None) -> Iterator[str]:
    scenario, domain, wind = context.scenario, context.domain, context.scenario.wind
    computed = wind.computed
    if computed is not None:
        driven = computed.top_speed(scenario) or any(computed.acceleration or ()) or computed.buoyancy
        if not (driven or computed.initial or any(group.wake for group in scenario.robots)):
            yield "wind: nothing moves the air; add an inlet and an outlet to wind.openings, or use kind: synthetic"
        if min(domain.shape) < FEWEST:
            across = "xyz"[domain.shape.index(min(domain.shape))]
            cells, most = min(domain.shape), min(domain.extent) / 10
            yield f"domain.spacing: makes only {cells} cells along {across}, too few; use at most {most:.2g} m"
    if where is None:
        return
    crossing = float(np.abs(where.along) @ domain.extent) / where.speed
    whole = scenario.warm_up + scenario.duration
    if whole < crossing:
        yield (
            f"duration: with the warm-up it is {whole:g} s, but the air takes at least {crossing:.3g} s through the "
            "room; raise one of them"
        )
    if isinstance(wind, FrozenWind) and wind.after < crossing <= whole:
        yield (
            f"wind.after: {wind.after:g} s is less than the {crossing:.3g} s or more that the air takes through the "
            "room; raise it"
        )


def _narrow(context: Context) -> Iterator[str]:
    """Yield warnings of openings, heaters and obstacles that span too few grid cells of a computed flow."""
    scenario, dx = context.scenario, context.domain.spacing
    for n, opening in enumerate(scenario.openings):
        if opening.blows and opening.region is not None and opening.region.center is not None:
            width = 2.0 * min(opening.region.rectangle(context.domain.extent)[1])
            if width < FEWEST_ACROSS * dx * (1 - 1e-6):
                yield (
                    f"wind.openings[{n}]: is {width:g} m wide, {width / dx:.2g} cells, too few for its jet; use a "
                    f"domain.spacing of {width / 6:.2g} m or less"
                )
    for n, heater in enumerate(scenario.heat.heaters if scenario.heat else ()):
        width = 2.0 * heater.radius
        if width < FEWEST_ACROSS * dx * (1 - 1e-6):
            yield (
                f"wind.buoyancy.heat.heaters[{n}].radius: the heater is {width:g} m wide, {width / dx:.2g} cells, too "
                f"few; use a domain.spacing of {width / FEWEST_ACROSS:.2g} m or less, or a wider heater"
            )
    widths = [
        (obstacle.width, n)
        for n, obstacle in enumerate(scenario.obstacles)
        if 0.5 * dx < obstacle.width < FEWEST_ACROSS_BODY * dx * (1 - 1e-6)  # thinner ones: see `unresolved`
    ]
    if widths and scenario.wind.computed is not None:
        width, n = min(widths)
        others = f" ({len(widths) - 1} more are narrow too)" if len(widths) > 1 else ""
        yield (
            f"obstacles[{n}]: the obstacle is {width:g} m wide, {width / dx:.2g} cells{others}, too few for drag and "
            f"wake; use a domain.spacing of {width / TRUSTED_ACROSS_BODY:.2g} m or less where they matter"
        )


# ---------------------------------------------------------------- sources


def _emitters(context: Context) -> list[tuple[str, AnySource, PureGas]]:
    """Return (path, source, its gas) for every gas source of the scenario."""
    gases = dict(context.scenario.gases)
    return [(path, source, gases[path.rpartition(".")[0]]) for path, source in context.scenario.sources]


def _source(
    path: str, source: AnySource, gas: PureGas, context: Context, where: Course | None
) -> Iterator[str]:
    """Yield warnings of a gas source that is too small for the grid, close to the outlet, or beside all jets."""
    scenario, domain = context.scenario, context.domain
    if gas.on_grid and source.radius < 0.5 * domain.spacing * (1 - 1e-6):
        yield (
            f"{path}.radius: {source.radius:g} m is less than half a cell of {domain.spacing:g} m, so the mean is too "
            f"low within about {MISSED_MEAN * domain.spacing:.2g} m; lower domain.spacing, or use kind: puffs"
        )
    if where is None:
        return
    corner = np.where(where.along > 0, domain.extent, 0.0)  # the outlet of the air
    left = float(where.along @ (corner - source.position))
    if left < AT_THE_END * float(np.abs(where.along) @ domain.extent):
        yield f"{path}.position: is {left:.2g} m from the outlet of the air; move the source upwind"
    elif scenario.openings and not any(
        _in_jet(opening.region, np.array(source.position), context)
        for opening in scenario.openings
        if opening.blows and opening.region is not None
    ):
        yield f"{path}.position: lies beside the jets of all openings; put it into a jet for a plume"


def _in_jet(region: Region, point: np.ndarray, context: Context) -> bool:
    """Return whether a point [m] lies inside the expected, widening jet of an opening at this region of a face."""
    center, half = map(np.array, region.rectangle(context.domain.extent))
    away = abs(point[region.axis] - region.level(context.domain.extent))
    apart = np.abs(point[region.along(context.domain.dim)] - center)
    return bool((apart <= 1.2 * half + JET * away).all())


def peak(gas: PureGas, source: AnySource, context: Context, slow: bool = True) -> float | None:
    """Return about the largest concentration [ppm] of a gas at its source; None if it cannot be estimated.

    slow: whether to assume the slowest expected air; otherwise the fastest.
    """
    scenario = context.scenario
    dish, rate = vars(source).get("dish"), vars(source).get("rate")
    if dish is not None:
        liquid = gas.vapour.antoine or gas.vapour.vapour_pressure
        if not (slow and liquid):
            return None
        return 1e6 * gas.vapour.saturation(dish.temperature, dish.temperature) / PRESSURE
    speed = scenario.wind.top_speed(scenario)
    known = scenario.wind.uniform is not None or course(context) is not None
    if not rate or not speed or not known:
        return None
    if scenario.wind.uniform is None and slow:
        speed *= SLOW
    flow = speed * (gas.begins_in(source.radius, context.domain) or 0.0)
    return rate / flow * gas.vapour.ppm_per_density if flow else None


def _peaks(context: Context) -> list[float] | None:
    """Return about the largest concentration [ppm] at each source; None if that of any source is unknown."""
    peaks = [peak(gas, source, context) for _, source, gas in _emitters(context)]
    known = [ppm for ppm in peaks if ppm is not None]
    return known if known and len(known) == len(peaks) else None


def _concentrations(context: Context) -> Iterator[str]:
    """Yield warnings of concentrations above pure gas, and of a colour scale that starts above those that occur."""
    recording = context.scenario.recording
    for path, source, gas in _emitters(context):
        least = peak(gas, source, context, slow=False)
        if least is not None and least > 1e6:
            yield f"{path}.rate: makes about {least:.2g} ppm at the source, more than pure gas; check its unit"
    peaks = _peaks(context)
    if peaks and recording.range_ppm[0] > sum(peaks):
        yield (
            f"recording.range_ppm: starts at {recording.range_ppm[0]:g} ppm, more than at the source, about "
            f"{sum(peaks):.2g} ppm; lower it"
        )
    algorithms = [group.algorithm for group in context.scenario.robots]
    least = min((a.threshold_ppm for a in algorithms if isinstance(a, PlumeTracking)), default=None)
    if least is not None and recording.range_ppm[0] > least:
        yield (
            f"recording.range_ppm: starts at {recording.range_ppm[0]:g} ppm, but robots follow gas from {least:g} ppm "
            "on; lower it"
        )


# ---------------------------------------------------------------- robots


def _group(path: str, group: Group, context: Context, where: Course | None) -> Iterator[str]:
    """Yield warnings of a group of robots: search time, sensors, start, time step; path: of the group."""
    if group.begin >= context.scenario.duration:
        yield f"{path}.begin: {group.begin:g} s is not before the end at {context.scenario.duration:g} s; lower it"
        return
    yield from _smells(path, group, context)
    yield from _starts(path, group, context, where)
    scenario, algorithm = context.scenario, group.algorithm
    step = group.body.max_speed * scenario.tick
    if 0 < group.reach < step:
        yield (
            f"{path}.reach: {group.reach:g} m is less than the {step:g} m that a robot drives in a tick: it may miss a "
            "source; lower tick"
        )
    if isinstance(algorithm, Listening) and algorithm.settle + algorithm.acquisition >= group.time(
        scenario.duration
    ):
        yield (
            f"{path}.algorithm.acquisition: {algorithm.acquisition:g} s and {algorithm.settle:g} s to settle are "
            f"longer than {_time(group, context)}; lower them"
        )
    fastest, least = scenario.wind.top_speed(scenario), group.sensors.wind.least
    if isinstance(algorithm, PlumeTracking) and fastest and least >= fastest:
        yield (
            f"{path}.sensors.wind: measures no wind below {least:g} m/s, but the air moves with {fastest:.2g} m/s at "
            f"most, and {algorithm.kind} needs its direction; use another kind or a lower threshold"
        )


def _time(group: Group, context: Context) -> str:
    """Return in words how long a group of robots may search."""
    duration = context.scenario.duration
    return f"the {group.time(duration):g} s after begin" if group.begin else f"the duration of {duration:g} s"


def _smells(path: str, group: Group, context: Context) -> Iterator[str]:
    """Yield warnings of detection thresholds that sensor noise alone crosses, or that no reading reaches."""
    sensor, threshold = group.sensors.nose, group.algorithm.threshold
    if not threshold:
        return
    key = f"{path}.algorithm.threshold_ppm"
    if isinstance(sensor, TdlasSensor):
        if sensor.gives == "integral":
            yield f"{key}: {threshold:g} counts in ppm m, the unit of the laser; or use sensors.gas.gives: mean"
        return
    gases = context.scenario.backgrounds
    if isinstance(sensor, MoxSensor) and sensor.gives != "ppm":
        yield from _uncalibrated(key, threshold, sensor, context)
        return
    clean = sum(sensor.reads(name, ppm) for name, ppm in gases.items())  # about, in the background
    if isinstance(sensor, MoxSensor):
        c0, b = sensor.reading_curve
        per_ln_r = (c0 + clean) / b  # ppm, in clean air
        noise = hypot(sensor.noise / sqrt(sensor.averaged), sensor.reading_noise) * per_ln_r
    else:
        noise = sensor.noise_ppm / sqrt(sensor.averaged)
        if threshold + clean < sensor.detection_limit_ppm:
            limit = sensor.detection_limit_ppm
            yield f"{key}: {threshold:g} ppm is below sensors.gas.detection_limit_ppm: {limit:g} ppm; raise it"
    if threshold < PEAK * noise:
        yield (
            f"{key}: {threshold:g} ppm is crossed by the sensor's noise alone, {noise:.2g} ppm; raise it above "
            f"{PEAK * noise:.2g} ppm, or average more samples"
        )
    peaks = _peaks(context)
    if peaks:
        most = max(
            sensor.reads(name, ppm + sum(peaks)) - sensor.reads(name, ppm) for name, ppm in gases.items()
        )
        if threshold > most:
            yield f"{key}: {threshold:g} ppm is more than a reading at the source, about {most:.2g} ppm; lower it"


def _uncalibrated(key: str, threshold: float, sensor: MoxSensor, context: Context) -> Iterator[str]:
    """Yield warnings of a detection threshold for ratios or ranks that none reaches, or that noise alone crosses."""
    if sensor.gives == "rank":
        if threshold >= 1.0:
            yield f"{key}: {threshold:g} is never reached by sensors.gas.gives: rank, which is from 0 to 1; lower it"
        return
    noise = hypot(sensor.noise / sqrt(sensor.averaged), sensor.reading_noise)
    if threshold < PEAK * noise:
        least = PEAK * noise
        yield f"{key}: {threshold:g} is crossed by the noise of the ratio, {noise:.2g}; raise it above {least:.2g}"
    peak = sum(_peaks(context) or ())
    most = max((sensor.reads(name, peak) for name in context.scenario.backgrounds), default=0.0)
    if peak and threshold > most:
        yield f"{key}: {threshold:g} is more than the ratio at the source, about {most:.2g}; lower it"


def _starts(path: str, group: Group, context: Context, where: Course | None) -> Iterator[str]:
    """Yield warnings of robots that cannot reach a source in time, or all start upwind of every source."""
    scenario, floor = context.scenario, context.scenario.floor
    ends = [
        point[-scenario.domain.dim :][:2]
        for _, gas in scenario.gases
        if gas.searched
        for source in gas.sources
        for motion in [vars(source).get("motion")]
        for point in (source.position, *(motion.path if motion else ()))
    ]
    sources = np.array(ends)
    if not len(sources) or not group.reach:
        return
    outside = np.maximum(floor.low - sources, np.maximum(sources - floor.high, 0.0))
    away = np.linalg.norm(outside, axis=1).min()
    if away > group.reach:
        yield (
            f"{path}.reach: {group.reach:g} m is too little for the nearest source, {away:.3g} m outside the arena; "
            "enlarge one of them"
        )
        return
    places = group.places(floor)
    if isinstance(group.start, StartArea):
        low, high = group.start.low, group.start.high
        places = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
        apart = np.linalg.norm(sources - np.clip(sources, low, high), axis=1)
    elif places is None:
        return
    else:
        apart = np.linalg.norm(places[:, None] - sources, axis=-1)
    way = float(apart.min()) - group.reach
    speed = group.algorithm.own_speed
    speed = group.body.max_speed if speed is None else min(speed, group.body.max_speed)
    most = speed * group.time(scenario.duration)
    if speed and way > most and (group.algorithm.searches or not scenario.maps):
        yield (
            f"{path}: the robots start {way:.3g} m or more from where a source counts as found, but drive at most "
            f"{most:.3g} m in {_time(group, context)}; start them nearer, or raise duration"
        )
    if where is not None and isinstance(group.algorithm, PlumeTracking):
        along = where.along[:2]
        if (places @ along).max() < (sources @ along).min() - group.reach:
            yield f"{path}.start: all robots start upwind of every source; start them downwind"
