"""Scores of gas maps over time: errors, correlation and negative log predictive density against the true gas.

The truth is the gas in the cells of a map, averaged over the time since the robots started: a map that does not forget
tends to this mean. When a snapshot ends (or every `trials.PERIOD` without snapshots) each trial of a map gets:

    error_ppm        mean of |estimate - truth| over the cells with an estimate that a robot can measure;
    correlation      correlation of estimate and truth over these cells;
    peak_distance_m  from the largest estimate to the nearest source that is there at the time;
    nlpd             mean of ½ ln(2π v) + (r - m)² / 2v over the readings r since the previous score, with the estimate
                     m of that time and the variance v of a reading: the map's forecast of these readings. NaN without
                     variance

Maps of the wind are scored alike, against the mean wind since the start at the height of the anemometers:

    error_m_s            mean of |estimate - truth| over the cells with an estimate that a robot can reach
    direction_error_deg  mean angle between estimate and truth over these cells, weighted by the true speed
"""

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from taichi_plume.agents.groups import sensor_heights
from taichi_plume.grid.series import Series
from taichi_plume.scoring import trials as scores
from taichi_plume.time_loop import Every, TimeLoop

LOOKS = 1.0  # s, time between samples of the true gas and the readings
NAMES = ("error_ppm", "correlation", "peak_distance_m", "nlpd")
WIND_NAMES = ("error_m_s", "direction_error_deg")


class MapSeries:
    """Scores of one gas map over time, as means over the trials of each group (see `scores.map_rows`).

    rows: see the properties. last: (names, trials), scores of all trials at the last of the times.
    """

    names: ClassVar[tuple[str, ...]] = NAMES
    quantity: ClassVar[str] = "gas"
    true: ClassVar[Callable[..., np.ndarray]] = staticmethod(scores.true_gas)
    STATE = ("sum", "looks", "ended", "rows", "last", "expected", "surprise")

    def __init__(self, sim: TimeLoop, number: int):
        self.map = sim.maps[number]
        self.cell, self.period = self.map.cell, self.map.window or scores.PERIOD
        trials, nx, ny, *components = np.shape(self.map.estimate())
        self.shape, self.levels = (nx, ny), self.map.levels
        self.scenario = sim.scenario
        groups = sim.swarm.groups if sim.swarm.count else []
        self.extent = (sim.grid.extent[0], sim.grid.extent[1])
        self.measurable = scores.measurable(sim, self.cell, self.shape, self.levels)
        self.heights = sensor_heights(groups)
        trial = [np.repeat(group.row + np.arange(group.trials), group.count) for group in groups]
        self.trial = np.concatenate([[], *trial]).astype(int)
        beams = sim.scenario.maps[number].takes_beams
        at_point = [not (beams and group.model.sensors.nose.law == "line") for group in groups]
        self.at_point = np.repeat(np.array(at_point, bool), [group.size for group in groups])
        self.parts = [rows for _, rows in scores.map_rows(sim)]
        self.sum, self.looks, self.ended = np.zeros((nx, ny, *components)), 0, 0
        self.rows = Series(
            len(self.names) * (1 + len(self.parts))
        )  # per name: score of the first trial, then means of the groups
        self.last = np.full((len(self.names), trials), np.nan)
        self.expected: list[np.ndarray] = []  # mean and variance of a `Prediction`, once there is one
        self.surprise = np.zeros((2, trials))  # sum and number of the readings since the last score

    @property
    def truth(self) -> np.ndarray:
        """Time average of the true gas [ppm], (nx, ny) or (nx, ny, nz), or of the wind [m/s], (nx, ny, 2)."""
        return self.sum / max(1, self.looks)

    @property
    def time(self) -> list[float]:
        """Times of the scores [s]."""
        return self.rows.times.tolist()

    def first(self, name: str) -> np.ndarray:
        """Return the scores called `name` of the first trial, (times,)."""
        return self._of(name)[:, 0]

    def means(self, name: str) -> np.ndarray:
        """Return the mean of the scores called `name` over each group's trials with a score, (times, groups)."""
        return self._of(name)[:, 1:]

    def _of(self, name: str) -> np.ndarray:
        shape = len(self.rows), len(self.names), 1 + len(self.parts)
        return self.rows.values.reshape(shape)[:, self.names.index(name)]

    def sample(self, sim: TimeLoop, truth: np.ndarray) -> None:
        """Add the truth, the gas above the background [ppm] (nx, ny) or the wind, and the robots' readings.

        At the end of a snapshot, score the map.
        """
        self.sum += truth
        self.looks += 1
        if self.expected and len(self.trial):
            now = sim.swarm.snapshot()
            expects = scores.Prediction(
                self.expected[0], self.expected[1], self.cell, self.extent, self.levels
            )
            place = now["believed_position"]
            if self.levels:
                place = np.column_stack([place, self.heights + now.get("altitude", 0.0)])
            reading = np.where(self.at_point, now["above_ppm"], np.nan)  # a beam is not at a point
            self._add_surprise(expects.surprise(self.trial, place, reading))
        if int((sim.t + 1e-6) / self.period) > self.ended:
            self.ended = int((sim.t + 1e-6) / self.period)
            self._score(sim.t)

    def _add_surprise(self, surprise: np.ndarray) -> None:
        """Add the surprise (negative log likelihood) of each robot's reading to its trial; NaN does not count."""
        known = np.isfinite(surprise)
        for row, values in zip(self.surprise, (np.where(known, surprise, 0.0), known), strict=True):
            row += np.bincount(self.trial, values, len(row))

    def _score(self, t: float) -> None:
        self.last = self._scores(t)
        row = [
            [values[0], *(scores.mean_of_known(values[part]) for part in self.parts)] for values in self.last
        ]
        self.rows.append((t, np.ravel(row)))

    def _scores(self, t: float) -> np.ndarray:
        """Return the scores at time t [s], (names, trials), and predict the readings until the next ones."""
        estimate = np.asarray(self.map.estimate())
        score = scores.map_score(estimate, np.where(self.measurable, self.truth, np.nan))
        sources = scores.present(self.scenario, t, dim=3 if self.levels else 2)
        peak = scores.peak_distance(estimate, self.cell, sources, self.levels)
        found = np.stack([score.mae, score.correlation, peak, scores.mean_of(*self.surprise)])
        self.surprise = np.zeros_like(self.surprise)
        expects = scores.Prediction.of(self.map, self.extent)
        self.expected = [expects.mean, expects.variance] if expects else []
        return found


class WindSeries(MapSeries):
    """Scores of one wind map over time."""

    names: ClassVar[tuple[str, ...]] = WIND_NAMES
    quantity: ClassVar[str] = "wind"
    true: ClassVar[Callable[..., np.ndarray]] = staticmethod(scores.true_wind)

    def _scores(self, t: float) -> np.ndarray:
        truth = np.where(self.measurable[..., None], self.truth, np.nan)
        return np.stack(scores.wind_score(np.asarray(self.map.estimate()), truth)[:2])


class MapScores:
    """Recorder of the scores of a run's maps, a `MapSeries` each. Add `observer()` to the simulation's observers."""

    STATE = ("series",)

    def __init__(self, sim: TimeLoop):
        kinds = {kind.quantity: kind for kind in (MapSeries, WindSeries)}
        self.series = [kinds[model.measures](sim, n) for n, model in enumerate(sim.scenario.maps)]

    def observer(self) -> Every:
        """Return the observer, to be called before others that need the scores of the same time."""
        return Every(LOOKS, self.sample)

    def sample(self, sim: TimeLoop) -> None:
        truths: dict[tuple, np.ndarray] = {}  # maps often share their cells
        for series in self.series:
            cells = (type(series), series.cell, series.shape, *([series.levels] if series.levels else []))
            if cells not in truths:
                truths[cells] = series.true(sim, *cells[1:])
            series.sample(sim, truths[cells])
