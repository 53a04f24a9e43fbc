"""Scores of trials and maps: success rate with confidence intervals, path lengths, errors against the true gas."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil, exp, inf, nan, sqrt

import numpy as np
from scipy.special import ndtri, stdtrit

from taichi_plume.agents.gas_map import cell_centers
from taichi_plume.agents.groups import GroupRange
from taichi_plume.grid import fields
from taichi_plume.grid.grid import block_mean
from taichi_plume.scenario.maps import Levels
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring.declarations import (
    OUTCOMES,
    Json,
    Snapshot,
    by_trial,
    declared_outcomes,
    nearest_source,
)
from taichi_plume.time_loop import Mapper, TimeLoop, Uncertain

SENSORS = 0.1  # m, default height of sensors
SAMPLES = 4  # largest number of samples per axis of a map cell
HEIGHTS = 2  # largest number of samples over the height of a layer
PERIOD = 5.0  # s, time between scores of a map that has no snapshots
SUMS = ("acquisitions", "hits", "bumps", "pushes", "pinned_s")
"""Columns of robots that are summed over a team; pushes and pinned_s exist only where obstacles move."""
LEAST_VALUES = 3  # least number of independent values for an interval of their mean
SETTLED = 30.0  # s after `begin`: forecasts count from then on, as in Marjovi & Marques


@dataclass(frozen=True)
class MapScore:
    """Errors of a gas map against the true gas, per trial over the cells with an estimate; NaN without such cells.

    mae [ppm], correlation (Pearson; NaN where one of the two is constant), known: fraction of the cells.
    """

    mae: np.ndarray
    correlation: np.ndarray
    known: np.ndarray


def true_gas(sim: TimeLoop, cell: float, shape: tuple[int, int], levels: Levels | None = None) -> np.ndarray:
    """Return the mean true concentration above the background [ppm] of each map cell at the height of the gas sensors,
    (nx, ny), or over the height of each layer, (nx, ny, nz).
    """
    if levels is None:
        return _gas_at(sim, cell, shape, sensor_height(sim))
    m = min(HEIGHTS, max(1, ceil(levels.layer / sim.grid.dx - 1e-9)))
    heights = np.minimum(
        levels.low + (np.arange(levels.count * m) + 0.5) * levels.layer / m, sim.grid.extent[2]
    )
    sections = np.stack([_gas_at(sim, cell, shape, z) for z in heights], axis=-1)
    return block_mean(sections, (1, 1, m))


def _gas_at(sim: TimeLoop, cell: float, shape: tuple[int, int], height: float) -> np.ndarray:
    points, n = _points(sim, cell, shape, height)
    ppm = fields.excess_at(sim.gas, points, sim.t).sum(axis=-1)
    return block_mean(ppm, n)


def true_wind(sim: TimeLoop, cell: float, shape: tuple[int, int]) -> np.ndarray:
    """Return the mean true wind along x and y [m/s] of each map cell at the height of the first group's anemometers,
    (nx, ny, 2).
    """
    groups = sim.scenario.robots
    height = groups[0].sensors.wind.height if groups else min(SENSORS, sim.grid.extent[-1])
    points, n = _points(sim, cell, shape, height)
    return block_mean(fields.velocity_at(sim.wind, points, sim.t)[..., :2], (n, n, 1))


def _points(sim: TimeLoop, cell: float, shape: tuple[int, int], height: float) -> tuple[np.ndarray, int]:
    """Return n x n points per map cell at a height [m], (nx n, ny n, dim) [m], and n."""
    n = min(SAMPLES, max(1, ceil(cell / sim.grid.dx - 1e-9)))
    axes = [(np.arange(count * n) + 0.5) * cell / n for count in shape]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    points = np.minimum(points, sim.grid.extent[:2])  # the last cell may extend beyond the edge
    if sim.grid.dim == 3:
        points = np.concatenate([points, np.full((*points.shape[:2], 1), height)], axis=-1)
    return points, n


def measurable(
    sim: TimeLoop, cell: float, shape: tuple[int, int], levels: Levels | None = None
) -> np.ndarray:
    """Return a mask (nx, ny) or (nx, ny, nz) of map cells whose centre robots can reach: in the arena, outside of fixed
    obstacles.
    """
    clearance, place = sim.swarm.clearance, cell_centers(shape, cell, levels)
    if levels is None:
        return clearance.distance_at(place) > 0.0
    inside = ((place[..., :2] > clearance.low) & (place[..., :2] < clearance.high)).all(axis=-1)
    return inside & (place[..., 2] < sim.grid.extent[2]) & (clearance.solid_distance_at(place) > 0.0)


def sensor_height(sim: TimeLoop) -> float:
    """Return the height of the first group's gas sensors [m]; without robots, the default height of sensors."""
    groups = sim.scenario.robots
    return groups[0].sensors.nose.height if groups else min(SENSORS, sim.grid.extent[-1])


def map_rows(sim: TimeLoop) -> list[tuple[tuple[str, ...], slice]]:
    """Return the names of the groups that share a map, and the map's trials (axis 0) that belong to them.

    Rivals make a map each; other groups make one together, in trial k those that have so many trials.
    """
    groups = sim.swarm.groups if sim.swarm.count else []
    if sim.scenario.rivals:
        rows = [((group.name,), slice(group.row, group.row + group.trials)) for group in groups]
    else:
        trials = max((group.trials for group in groups), default=1)
        rows = [(tuple(group.name for group in groups), slice(0, trials))]
    return rows or [((), slice(0, 1))]


def map_score(estimate: np.ndarray, truth: np.ndarray) -> MapScore:
    """Return the score of estimates (trials, nx, ny, ...) [ppm], NaN where unknown, against the truth (nx, ny, ...)
    [ppm].

    Cells where the truth is NaN do not count.
    """
    counted = np.isfinite(truth)
    trials = len(estimate)
    mae, correlation, known = np.full(trials, np.nan), np.full(trials, np.nan), np.zeros(trials)
    for k in range(trials):
        cells = np.isfinite(estimate[k]) & counted
        known[k] = cells.sum() / max(1, counted.sum())
        if not cells.any():
            continue
        a, b = estimate[k][cells].astype(float), truth[cells].astype(float)
        mae[k] = np.abs(a - b).mean()
        if len(a) > 1 and a.std() > 0 and b.std() > 0:
            correlation[k] = np.corrcoef(a, b)[0, 1]
    return MapScore(mae, correlation, known)


def wind_score(estimate: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return error [m/s], direction error [deg] and known fraction (trials,) of wind maps (trials, nx, ny, 2) [m/s].

    truth: (nx, ny, 2) [m/s], NaN in cells that do not count. The error is the mean of |estimate - truth| over the known
    cells; the direction error the mean angle between the two, weighted by the true speed. NaN without such cells.
    """
    cells = np.isfinite(truth[..., 0]) & np.isfinite(estimate[..., 0])
    a, b = np.where(cells[..., None], estimate, 0.0), np.where(cells[..., None], truth, 0.0)
    angle = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=-1))
    speed, number = np.linalg.norm(b, axis=-1), cells.sum(axis=(1, 2))
    error = mean_of(np.linalg.norm(a - b, axis=-1).sum(axis=(1, 2)), number)
    whole = speed.sum(axis=(1, 2))
    direction = np.degrees((np.abs(angle) * speed).sum(axis=(1, 2)) / np.where(whole > 0, whole, np.nan))
    return error, direction, number / max(1, np.isfinite(truth[..., 0]).sum())


def peak_distance(
    estimate: np.ndarray, cell: float, sources: np.ndarray, levels: Levels | None = None
) -> np.ndarray:
    """Return the distance (trials,) [m] from each map's peak to the nearest source; estimate (trials, nx, ny), with
    layers (trials, nx, ny, nz).

    sources: (m, 2) or, with layers, (m, 3) [m]. NaN for a map without gas, or without sources.
    """
    places = cell_centers(estimate.shape[1:], cell, levels)
    estimate = np.nan_to_num(estimate).reshape(len(estimate), -1)
    place = places.reshape(-1, places.shape[-1])[estimate.argmax(axis=1)]
    apart = np.linalg.norm(place[:, None] - sources, axis=-1).min(axis=1, initial=np.inf)
    return np.where((estimate.max(axis=1) > 0.0) & np.isfinite(apart), apart, np.nan)


@dataclass(frozen=True)
class Prediction:
    """Prediction of readings by a gas map: mean [ppm] and variance [ppm²] in each cell, (trials, nx, ny, ...).

    cell: edge of the cells; extent: size of the floor [m]; levels: layers of the map.
    """

    mean: np.ndarray
    variance: np.ndarray
    cell: float
    extent: tuple[float, float]
    levels: Levels | None = None

    @classmethod
    def of(cls, gas_map: Mapper, extent: tuple[float, float]) -> "Prediction | None":
        """Return the prediction by a map on a floor of this extent [m]; None for a map without variance."""
        if not isinstance(gas_map, Uncertain):
            return None
        variance = np.asarray(gas_map.variance(), float) + gas_map.noise
        return cls(np.asarray(gas_map.estimate(), float), variance, gas_map.cell, extent, gas_map.levels)

    def surprise(self, trial: np.ndarray | int, place: np.ndarray, reading: np.ndarray) -> np.ndarray:
        """Return the negative log likelihood (normal density) of readings (n,) [ppm] at points (n, 2) [m] in trials;
        with layers points are (n, 3).

        trial: indices (n,), or one for all. NaN for readings off the floor or not finite, and where nothing was known.
        """
        low, high, edges = 0.0, self.extent, self.cell
        if self.levels:
            low, high = np.array([0.0, 0.0, self.levels.low]), (*high, self.levels.high)
            edges = np.array([edges, edges, self.levels.layer])
        on = ((place >= low) & (place <= high)).all(axis=1) & np.isfinite(reading)
        cell = np.where(on[:, None], (place - low) / edges, 0.0).astype(int)
        at = trial, *np.minimum(cell, np.array(self.mean.shape[1:]) - 1).T
        mean, variance = self.mean[at], self.variance[at]
        counted = on & np.isfinite(mean) & (variance > 0)
        v = np.where(counted, variance, 1.0)
        off = np.where(counted, reading - mean, 0.0)
        return np.where(counted, 0.5 * np.log(2 * np.pi * v) + off**2 / (2 * v), np.nan)


def forecast_error(errors: Iterable[tuple[float, np.ndarray]], trials: int, begin: float = 0.0) -> np.ndarray:
    """Return the mean of a map's forecast errors (eq 8, see agents/snapshots) of each trial, (trials,) [ppm].

    errors: (time [s], errors of the trials). Forecasts count from SETTLED after `begin` [s] on; NaN without such.
    """
    late = [error for t, error in errors if t > begin + SETTLED + 1e-6]
    table = np.array(late, float).reshape(-1, trials)
    known = np.isfinite(table)
    return mean_of(np.where(known, table, 0.0).sum(axis=0), known.sum(axis=0))


def mean_of_known(values: np.ndarray) -> float:
    """Return the mean of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else nan


def mean_of(total: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return total / count, NaN where the count is 0."""
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def trial_outcomes(sim: TimeLoop, group: GroupRange, snapshot: Snapshot) -> Json:
    """Return the results of each trial of a group, as columns.

    Sources count where they are at the time of the event: when a robot found one, when a robot declared one, at the end
    for others. group, trial; success; found: robots that found a source; of the first of these robots time_s, since the
    group set off, path_m and overhead: path over the straight distance to the nearest source; of the whole team
    team_path_m, acquisitions, hits, bumps and, where obstacles move, pushes and pinned_s; final_distance_m: of the
    robot that ended nearest to a source; and the columns of `declared_outcomes`.
    """

    def table(key: str) -> np.ndarray:
        return by_trial(group, snapshot[key])

    flies = sim.grid.dim == 3 and group.model.body.flies
    found = table("found").astype(bool)
    sources = sim.scenario.targets_at(np.where(found, table("found_time"), sim.t))

    def nearest(places: np.ndarray, altitude: np.ndarray | float) -> np.ndarray:
        if flies:
            middle = np.broadcast_to(altitude + 0.5 * group.model.body.height, places.shape[:-1])
            places = np.concatenate([places, middle[..., None]], axis=-1)
        return nearest_source(places, sources)

    time = np.where(found, table("found_time"), np.inf)
    path = table("path_length")
    success = found.any(axis=1)
    first = (np.arange(group.trials), time.argmin(axis=1))
    begin, end = (group.model.start_altitude, table("altitude")) if flies else (0.0, 0.0)
    straight = nearest(table("start"), begin)[first]
    ended = nearest(table("position"), end)

    def of_the_first(values: np.ndarray) -> list[float]:
        return np.where(success, values, np.nan).tolist()

    return {
        "group": [group.name] * group.trials,
        "trial": list(range(group.trials)),
        "success": success.tolist(),
        "found": found.sum(axis=1).tolist(),
        "time_s": of_the_first(time[first] - group.model.begin),
        "path_m": of_the_first(path[first]),
        "overhead": of_the_first(path[first] / np.maximum(straight, 1e-9)),
        "team_path_m": path.sum(axis=1).tolist(),
        **{name: table(name).sum(axis=1).tolist() for name in SUMS if name in snapshot},
        "final_distance_m": ended.min(axis=1).tolist(),
        **declared_outcomes(group, snapshot, sim.scenario.targets_at, sim.scenario.rates),
    }


def trials_differ_by(group: GroupRange, snapshot: Snapshot) -> str | None:
    """Return the cause of differences between trials: "starts and chance", "chance", "nothing"; None for one trial.

    Wind and gas are the same in all trials. Chance: random draws of sensors, odometry, messages, algorithms. With
    "nothing" all trials have ended the same, to the bit.
    """

    def alike(values: np.ndarray) -> bool:
        of_trials = by_trial(group, values).reshape(group.trials, -1)
        return np.array_equal(of_trials, np.broadcast_to(of_trials[:1], of_trials.shape), equal_nan=True)

    if group.trials == 1:
        return None
    if all(alike(np.asarray(values, float)) for values in snapshot.values()):
        return "nothing"
    given = group.model.start.heading_deg is not None
    return "chance" if given and alike(np.asarray(snapshot["start"], float)) else "starts and chance"


def no_search(sim: TimeLoop, group: GroupRange, success: Iterable[bool] = ()) -> str | None:
    """Return the reason why no robot of a group could find a source; None if robots could, or have in a trial."""
    if any(success):
        return None
    starts = [source.on[0] for _, gas in sim.scenario.gases if gas.searched for source in gas.sources]
    if sim.tick <= 0 or (group.model.begin > 0 and sim.t <= group.model.begin):
        return "the robots had not started"
    if not starts:
        return "there is no source"
    if not min(starts) < sim.t:
        return "no source had started"
    return None if group.model.reach > 0 else "reach is 0"


def end(sim: TimeLoop, group: GroupRange) -> float:
    """Return the duration [s] that counts for trials of a group in which no source was found.

    A run that stopped because no robot searched any more counts with its full duration.
    """
    whole = sim.tick >= sim.last_tick or (sim.swarm.count > 0 and sim.swarm.all_over())
    return group.model.time(sim.scenario.duration if whole else sim.t)


def present(scenario: Scenario, t: float, dim: int = 2) -> np.ndarray:
    """Return the positions of the sources to be found at time t [s], on the floor (m, 2) or in space (m, 3) [m]."""
    places = scenario.targets_at(t)[:, :dim]
    return places[np.isfinite(places[:, 0])]


def trial_summary(trials: Json, duration: float, searched: bool = True) -> Json:
    """Return means and 95 % confidence intervals of the columns of `trial_outcomes`, by name.

    success_rate: Wilson's interval. The others over successful trials, see `mean_with_interval`; and
    time_with_failures_s, of all trials, where a failure counts as `duration` [s]. Of groups that may declare:
    declared_rate, reached_rate and neither_rate, the fractions of each outcome, and false_declarations, of all trials;
    declared_time_s and localisation_error_m, of those with a declaration. searched: false if no source could be found;
    then no trial counts.
    """
    if not searched:
        trials = {name: values[:0] for name, values in trials.items()}
    success = np.array(trials["success"], bool)
    summary: Json = {"success_rate": share_with_interval(int(success.sum()), len(success))}
    for name in ("time_s", "path_m", "overhead", "acquisitions", "hits", "bumps"):
        most = duration if name == "time_s" else inf
        summary[name] = mean_with_interval(np.array(trials[name], float)[success], most=most)
    late = np.where(success, trials["time_s"], duration)
    summary["time_with_failures_s"] = mean_with_interval(late, most=duration)
    speaks = np.isfinite(np.array(trials["declarations"], float))
    outcomes = np.array(trials["outcome"])[speaks]
    for name in OUTCOMES:
        summary[f"{name}_rate"] = share_with_interval(int((outcomes == name).sum()), len(outcomes))
    for name in ("declared_time_s", "localisation_error_m", "false_declarations"):
        values = np.array(trials[name], float)
        most = duration if name == "declared_time_s" else inf
        summary[name] = mean_with_interval(values[np.isfinite(values)], most=most)
    return summary


def share_with_interval(k: int, n: int) -> Json:
    """Return k/n and Wilson's interval of 95 % confidence (Wilson 1927, doi:10.1080/01621459.1927.10502953).

    `scipy.stats` has it too, but takes 0.3 s to import.
    """
    if not n:
        return {"mean": None, "low": None, "high": None, "n": 0}
    z2 = float(ndtri(0.975)) ** 2
    middle = (k + z2 / 2) / (n + z2)
    half = sqrt(z2 * (k * (n - k) / n + z2 / 4)) / (n + z2)
    return {"mean": k / n, "low": max(0.0, middle - half), "high": min(1.0, middle + half), "n": n}


def mean_with_interval(values: np.ndarray, least: float = 0.0, most: float = inf) -> Json:
    """Return mean, interval of 95 % confidence (see `interval_within`) and number of values (n,) >= 0.

    least, most: range of the quantity. No interval (NaN) for fewer than LEAST_VALUES; None without values.
    """
    n = len(values)
    if not n:
        return {"mean": None, "low": None, "high": None, "n": 0}
    mean = float(values.mean())
    error = float(values.std(ddof=1)) / sqrt(n) if n > 1 else nan
    low, high = interval_within(mean, error, n, *range_with(values, least, most))
    return {"mean": mean, "low": low, "high": high, "n": n}


def range_with(values: np.ndarray, least: float, most: float) -> tuple[float, float]:
    """Return the range of a quantity, without a limit that any of the values (n,) exceeds."""
    return least if values.min() >= least else -inf, most if values.max() <= most else inf


def interval_within(mean: float, error: float, n: int, least: float, most: float) -> tuple[float, float]:
    """Return Student's interval of 95 % confidence of a mean of n values, within the range of the quantity.

    error: standard error of the mean. Between -inf and inf the interval is mean ± t error. With one limit it is
    symmetric in log(mean - least), with two in the logit of the mean's place between them: the delta method, with
    Student's t (Agresti 2013, Categorical Data Analysis, sections 3.1 and 16.1). NaN for fewer than LEAST_VALUES.
    """
    if n < LEAST_VALUES:
        return nan, nan
    half = float(stdtrit(n - 1, 0.975)) * error
    above, below = mean - least, most - mean
    if half == 0.0 or min(above, below) <= 0.0 or (above, below) == (inf, inf):
        return mean - half, mean + half
    if below == inf:
        wide = exp(min(half / above, 600.0))
        return least + above / wide, least + above * wide
    if above == inf:
        wide = exp(min(half / below, 600.0))
        return most - below * wide, most - below / wide
    wide = exp(min(half / above + half / below, 600.0))  # of the logit: 1 / above + 1 / below
    ends = (above / (above + below * by) for by in (wide, 1.0 / wide))
    low, high = (least + (most - least) * end for end in ends)
    return low, high
