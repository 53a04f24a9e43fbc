"""How the gas maps of a run fare over time, by what only the simulation knows.

The truth is the gas in the cells of a map, averaged over the time since the robots started: a map that does not forget
tends to it. Each time a snap ends (or `scores.PERIOD` has gone by, where a map has none) every trial of a map gets

    error_ppm        mean of |estimate - truth| over the cells it knows and a robot can measure
    correlation      of both over these cells
    peak_distance_m  from the largest estimate to the nearest source
    nlpd             mean of ½ ln(2π v) + (r - m)² / 2v over the readings r since the last time, with the estimate m of
                     then and the variance v of a reading about it: what the map made of them before it had taken them
                     in. NaN without variance
"""

import numpy as np

from taichi_plume import scores
from taichi_plume.simulation import Every, Simulation

LOOKS = 1.0  # s, between looks at the true gas and at the readings
NAMES = ("error_ppm", "correlation", "peak_distance_m", "nlpd")


class MapSeries:
    """The scores of one map: `time` [s], and in `values` a list of (trials,) by name."""

    def __init__(self, sim: Simulation, number: int):
        self.map = sim.maps[number]
        self.cell, self.period = self.map.cell, self.map.window or scores.PERIOD
        self.shape: tuple[int, int] = np.shape(self.map.estimate())[1:]
        self.sources = np.array([source.position[:2] for _, source in sim.scenario.sources]).reshape(-1, 2)
        groups = sim.swarm.groups if sim.swarm.count else []
        self.extent = (sim.grid.extent[0], sim.grid.extent[1])
        self.measurable = scores.measurable(sim, self.cell, self.shape)
        self.trial = np.concatenate(
            [[], *(np.repeat(g.row + np.arange(g.trials), g.count) for g in groups)]
        ).astype(int)
        self.sum, self.looks, self.rows = np.zeros(self.shape), 0, 0
        self.time: list[float] = []
        self.values: dict[str, list[np.ndarray]] = {name: [] for name in NAMES}
        self.prediction: scores.Prediction | None = None
        self.surprises: list[np.ndarray] = []  # of each robot's reading, at each look since then

    @property
    def truth(self) -> np.ndarray:
        """Mean of the true gas [ppm], (nx, ny)."""
        return self.sum / max(1, self.looks)

    def sample(self, sim: Simulation, gas: np.ndarray) -> None:
        """Take in the true gas [ppm], (nx, ny), and the readings and, where a snap has ended, score the map."""
        self.sum += gas
        self.looks += 1
        if self.prediction and len(self.trial):
            now = sim.swarm.snapshot()
            told = self.prediction.surprise(self.trial, now["believed_position"], now["reading_ppm"])
            self.surprises.append(told)
        if int((sim.t + 1e-6) / self.period) > self.rows:
            self.rows = int((sim.t + 1e-6) / self.period)
            self._score(sim.t)

    def _score(self, t: float) -> None:
        estimate = np.asarray(self.map.estimate())
        score = scores.map_score(estimate, np.where(self.measurable, self.truth, np.nan))
        peak = scores.peak_distance(estimate, self.cell, self.sources)
        self.time.append(t)
        values = score.mae, score.correlation, peak, self._nlpd(len(estimate))
        for name, value in zip(NAMES, values, strict=True):
            self.values[name].append(value)
        self.surprises = []
        self.prediction = scores.Prediction.of(self.map, self.extent)

    def _nlpd(self, trials: int) -> np.ndarray:
        """Mean surprise of each trial since the last time, (trials,)."""
        if not self.surprises:
            return np.full(trials, np.nan)
        all_of_them = np.array(self.surprises)
        told = np.isfinite(all_of_them)
        total = np.where(told, all_of_them, 0.0).sum(axis=0)
        return scores.mean_of(
            np.bincount(self.trial, total, trials), np.bincount(self.trial, told.sum(axis=0), trials)
        )


class MapScores:
    """The scores of all maps of a run, a `MapSeries` each. Add `observer()` to the simulation's."""

    STATE = ("series",)

    def __init__(self, sim: Simulation):
        self.series = [MapSeries(sim, n) for n in range(len(sim.maps))]

    def observer(self) -> Every:
        """What the simulation has to call, before whoever wants the scores of the same time."""
        return Every(LOOKS, self.sample)

    def sample(self, sim: Simulation) -> None:
        """Look at every map."""
        gas: dict[tuple, np.ndarray] = {}  # maps often share their cells
        for series in self.series:
            cells = (series.cell, series.shape)
            if cells not in gas:
                gas[cells] = scores.true_gas(sim, *cells)
            series.sample(sim, gas[cells])
