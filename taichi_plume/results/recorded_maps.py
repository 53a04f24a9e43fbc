"""Gas maps from recorded readings, by the same mapping algorithms that robots run online.

During a run a map forgets old readings, to follow the gas. For a map of a log, the model's `times` (window, memory and
the like) are chosen so that no reading is forgotten, unless the model sets one of them.
"""

from dataclasses import dataclass
from math import ceil, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.files.readings import Readings, ReadingsError

if TYPE_CHECKING:
    from taichi_plume.agents.gas_map import GasMap as OnlineMap
    from taichi_plume.scenario.maps import Map

MOST_WINDOWS = 100_000  # of a log: six days of 5 s each; more is a clock that jumped
FINEST = 6  # significant decimals of a time [s]: a Unix time in double precision has no more
FORGOTTEN = 1e-3  # fraction of its weight below which a reading counts as forgotten


@dataclass(frozen=True)
class GasMap:
    """Gas map, arrays (nx, ny): estimate [ppm], weight, variance [ppm²] or None. cell: edge of its cells [m].

    estimate and variance are NaN where nothing is known. scores:

        kind, readings, left_out    kind of map; readings in the map; readings that are no number or off the floor
        forgotten                   readings in the map with less than FORGOTTEN of their weight left at the end
        chosen_for_the_log          parameters chosen so that nothing is forgotten (see `of_log`)
        known_fraction              share of the cells that have an estimate
        peak                        x_m, y_m and ppm of the largest estimate; to_source_m, if sources are known
        forecast_error_ppm          mean of eq 8 (see agents/snapshots), from 30 s after the first reading on; or None
        forecast                    time_s and error_ppm of each forecast snapshot
        nlpd, nlpd_median           negative log predictive density of the readings of each snapshot, or PERIOD, by the
                                    map before (see scoring/maps); None without a variance
    """

    cell: float
    estimate: np.ndarray
    weight: np.ndarray
    variance: np.ndarray | None
    scores: dict[str, Any]


def map_of(
    readings: Readings, model: "Map", size: tuple[float, float], sources: np.ndarray | None = None
) -> GasMap:
    """Return a gas map of recorded readings. size: of the floor [m]; sources: true positions (m, 2) [m], for scores.

    Needs a started Taichi. Snapshots end at multiples of the window since t = 0, or since the first reading if the
    window was chosen for the log. The last snapshot is mapped, but its forecast is not scored. Raises ReadingsError.
    """
    from taichi_plume.scoring.trials import PERIOD, forecast_error, peak_distance
    from taichi_plume.time_loop import Uncertain

    fault = model.grid_error("--map", size)
    if fault:
        raise ReadingsError(fault)
    counted = _counted(readings, size)
    _check_clock(readings, model.window or PERIOD)
    model, chosen = of_log(model, readings, size)
    window = model.window or PERIOD
    begin = readings.t[0]
    if "window" not in chosen:
        begin = window * np.floor((begin + 0.5 * 10.0**-FINEST) / window)
    t = np.round(readings.t - begin, FINEST)
    gas_map, dt, nlpd = _made(readings, t, model, size)
    errors = [(time, error) for time, error in gas_map.errors if time <= t[-1] + 10.0**-FINEST]
    estimate, weight = np.asarray(gas_map.estimate()), np.asarray(gas_map.weight())
    settled = float(forecast_error(errors, 1, t[0])[0])
    left = gas_map.remembered(t[counted], readings.place[counted], dt)
    peak = _peak(estimate[0], gas_map.cell)
    if sources is not None:
        peak["to_source_m"] = float(peak_distance(estimate, gas_map.cell, sources)[0])
    scores = {
        "kind": model.kind,
        "readings": int(counted.sum()),
        "forgotten": None if np.isnan(left).any() else int((left < FORGOTTEN).sum()),
        "left_out": int((~counted).sum()),
        "chosen_for_the_log": chosen,
        "known_fraction": float(np.isfinite(estimate).mean()),
        "peak": peak,
        "forecast_error_ppm": settled if isfinite(settled) else None,
        "forecast": {
            "time_s": [float(time + begin) for time, _ in errors],
            "error_ppm": [float(error[0]) for _, error in errors],
        },
        "nlpd": float(nlpd.mean()) if nlpd.size else None,
        "nlpd_median": float(np.median(nlpd)) if nlpd.size else None,
    }
    variance = np.asarray(gas_map.variance())[0] if isinstance(gas_map, Uncertain) else None
    return GasMap(gas_map.cell, estimate[0], weight[0], variance, scores)


def of_log(model: "Map", readings: Readings, size: tuple[float, float]) -> tuple["Map", dict[str, Any]]:
    """Return a mapping model whose parameters let no recorded reading be forgotten, and these parameters.

    A model that sets one of its `times` is returned unchanged, with {}. size: of the floor [m].
    """
    if model.model_fields_set & set(model.times):
        return model, {}
    chosen = model.of_log(float(np.round(readings.t[-1] - readings.t[0], FINEST)), size)
    return model.model_copy(update=chosen), chosen


def _made(
    readings: Readings, t: np.ndarray, model: "Map", size: tuple[float, float]
) -> tuple["OnlineMap", float, np.ndarray]:
    """Map readings taken at times t [s]; return map, time step [s], finite negative log densities of the readings."""
    from taichi_plume.agents.gas_map import Floor
    from taichi_plume.agents.mapping import mappers
    from taichi_plume.agents.recorded_readings import RecordedTeam
    from taichi_plume.scoring.trials import PERIOD, Prediction

    times, starts, robots = np.unique(t, return_index=True, return_counts=True)
    most, window = int(robots.max()), model.window or PERIOD
    team = RecordedTeam(most)
    dt = window / ceil(np.bincount(_number(t, window)).max() / most)  # maps have room for so many readings
    gas_map = mappers([model], Floor(size, 1, most, dt))[0]

    def take_in(first: int, last: int, time: float) -> None:
        rows = slice(first, last)
        team.show(readings.place[rows], readings.wind[rows], readings.reading[rows])
        gas_map.update(team, time, dt)

    period = gas_map.window or PERIOD
    prediction, ended, surprises = None, 0, [np.empty(0)]
    for time, number, first, count in zip(times, _number(times, period), starts, robots, strict=True):
        last = first + count
        if number > ended:
            ended = number
            take_in(0, 0, ended * period)
            prediction = Prediction.of(gas_map, size)
        if prediction:
            surprises.append(prediction.surprise(0, readings.place[first:last], readings.reading[first:last]))
        take_in(first, last, float(time))
    if model.window is not None:
        take_in(0, 0, float(_number(times[-1], window) + 1) * window)
    nlpd = np.concatenate(surprises)
    return gas_map, dt, nlpd[np.isfinite(nlpd)]


def _number(t: np.ndarray, window: float) -> np.ndarray:
    """Return the index, from 0, of the time window that contains t [s]; a window includes its end, not its start."""
    return np.maximum(np.ceil(t / window - 1e-9), 1.0).astype(int) - 1


def _counted(readings: Readings, size: tuple[float, float]) -> np.ndarray:
    """Return a mask (n,) of the finite readings on a floor of this size [m]. Raises ReadingsError if there are none."""
    known = np.isfinite(readings.reading)
    if not known.any():
        raise ReadingsError(f"none of the {len(known)} readings is a number")
    counted = ((readings.place >= 0.0) & (readings.place <= size)).all(axis=1) & known
    if not counted.any():
        low, high = readings.place[known].min(axis=0), readings.place[known].max(axis=0)
        raise ReadingsError(
            f"no reading lies on the floor of {size[0]:g} x {size[1]:g} m from the origin on; they reach from "
            f"({low[0]:g}, {low[1]:g}) to ({high[0]:g}, {high[1]:g}) m from there, see --origin"
        )
    return counted


def _check_clock(readings: Readings, window: float) -> None:
    t = readings.t - readings.t[0]
    if t[-1] / window <= MOST_WINDOWS:
        return
    n = int(np.diff(t).argmax()) + 1
    raise ReadingsError(
        f"row {readings.row[n]}: t = {readings.t[n]:.10g} s is {t[n] - t[n - 1]:.3g} s after the time before it: a map "
        f"takes {MOST_WINDOWS} windows of {window:g} s; correct the clock or cut the log"
    )


def _peak(estimate: np.ndarray, cell: float) -> dict[str, float | None]:
    """Return position [m] and value [ppm] of a map's largest estimate; None if unknown or not above zero."""
    known = np.isfinite(estimate).any()
    if not known or np.nanmax(estimate) <= 0.0:
        return {"x_m": None, "y_m": None, "ppm": 0.0 if known else None}
    i, j = np.unravel_index(np.nanargmax(estimate), estimate.shape)
    return {"x_m": (float(i) + 0.5) * cell, "y_m": (float(j) + 0.5) * cell, "ppm": float(estimate[i, j])}
