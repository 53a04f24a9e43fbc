"""Scores of beliefs, the robots' posterior probability of the source position, against the true sources.

Algorithms that implement `agents.beliefs.Believer` are scored. Per trial, the mean over its robots:

    peak_distance_m      from the most probable cell to the nearest source
    mean_distance_m      from the expected position to the nearest source
    expected_distance_m  distance to the nearest source (mean over the belief)
    entropy_bits         entropy of the belief (- sum p log2 p)
    within_reach         probability of the positions within the group's reach of a true source

Sources count where they are at the time. The distances and the probability are NaN while there is no source.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichi_plume.agents.beliefs import Believer, Estimator
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.source_posterior import Estimate
from taichi_plume.grid.series import Series
from taichi_plume.scoring import trials as scores
from taichi_plume.scoring.declarations import OF_BELIEFS, Json
from taichi_plume.scoring.trials import mean_of_known
from taichi_plume.time_loop import Every, TimeLoop


@dataclass(frozen=True)
class GroupBeliefs:
    """Beliefs of a group: p (trials, robots, nx, ny), on cells of edge `cell` [m] from corner `low` (2,) [m] on.

    prior: (nx, ny), sum 1; None without the key `prior`.
    """

    group: GroupRange
    cell: float
    low: np.ndarray
    p: np.ndarray
    prior: np.ndarray | None = None

    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates of the cells' centres along x and along y [m]."""
        x, y = (self.low[d] + (np.arange(n) + 0.5) * self.cell for d, n in enumerate(self.p.shape[2:]))
        return x, y

    def scores(self, sources: np.ndarray) -> np.ndarray:
        """Return the scores OF_BELIEFS of each trial, (5, trials), means over its robots; sources: (m, 2) [m]."""
        places = np.stack(np.meshgrid(*self.axes(), indexing="ij"), axis=-1)
        square = self.group.model.capture == "square"
        away = _nearest(places, sources)
        within = _nearest(places, sources, square) <= self.group.model.reach
        scores = np.empty((len(OF_BELIEFS), len(self.p)))
        for k, of_trial in enumerate(self.p):  # needs the memory of one trial
            p = of_trial.astype(float)
            peak = places.reshape(-1, 2)[p.reshape(len(p), -1).argmax(axis=-1)]
            mean = np.einsum("rxy,xyd->rd", p, places)
            bits = -(p * np.log2(np.where(p > 0.0, p, 1.0))).sum(axis=(1, 2))
            each = [_nearest(peak, sources), _nearest(mean, sources), np.einsum("rxy,xy->r", p, away)]
            scores[:, k] = np.mean([*each, bits, np.einsum("rxy,xy->r", p, within.astype(float))], axis=1)
        if not len(sources):
            scores[[0, 1, 2, 4]] = np.nan
        return scores


def _nearest(places: np.ndarray, sources: np.ndarray, square: bool = False) -> np.ndarray:
    """Return the distance of points (..., 2) to the nearest source [m], 0 without sources; square: maximum norm."""
    if not len(sources):
        return np.zeros(places.shape[:-1])
    apart = np.linalg.norm(places[..., None, :] - sources, ord=np.inf if square else None, axis=-1)
    return apart.min(axis=-1)


def believers(sim: TimeLoop) -> list[Believer]:
    """Return the search algorithms of a run that keep beliefs."""
    return [team.algorithm for team in sim.teams if isinstance(team.algorithm, Believer)]


def beliefs(sim: TimeLoop) -> list[GroupBeliefs]:
    """Return the current beliefs of each group that keeps beliefs, in the order of the scenario."""
    parts = []
    for believer in believers(sim):
        belief, begin = np.asarray(believer.beliefs()), 0
        for group in believer.members.groups:
            p = belief[begin : begin + group.size].reshape(group.trials, group.count, *belief.shape[1:])
            low, prior = np.asarray(believer.belief_low, float), sim.swarm.priors.get(group.number)
            weights = prior.on(low, believer.belief_cell, p.shape[2:]) if prior else None
            prior = None if weights is None else weights / weights.sum()
            parts.append(GroupBeliefs(group, believer.belief_cell, low, p, prior))
            begin += group.size
    return sorted(parts, key=lambda belief: belief.group.number)


def estimates(sim: TimeLoop, group: GroupRange) -> list[list[Estimate]] | None:
    """Return the estimated sources of each robot of a group; None if its algorithm estimates no sources."""
    for believer in believers(sim):
        if isinstance(believer, Estimator):
            begin = 0
            for other in believer.members.groups:
                if other.number == group.number:
                    return believer.estimates()[begin : begin + group.size]
                begin += other.size
    return None


def estimate_scores(terms: Sequence[Estimate], places: np.ndarray, rates: np.ndarray) -> dict[str, float]:
    """Return scores of a robot's estimates against the true sources: places (m, 2) [m] and rates (m,) [kg/s].

    Estimates and sources are matched so that the sum of their distances is smallest (optimal assignment).
    place_error_m: mean distance of the pairs; log_error: mean of |ln(q / q_true)|; coverage: fraction of the true rates
    within the intervals of 90 %; missing: true sources less estimates. NaN without pairs or without known rates.
    """
    from scipy.optimize import linear_sum_assignment  # takes 0.2 s to import

    apart = np.linalg.norm(np.array([each.place for each in terms]).reshape(-1, 1, 2) - places, axis=-1)
    rows, columns = linear_sum_assignment(apart)
    pairs = [(terms[k], rates[m]) for k, m in zip(rows, columns, strict=True) if rates[m] > 0.0]
    return {
        "place_error_m": mean_of_known(apart[rows, columns]),
        "log_error": mean_of_known(np.array([abs(np.log(term.rate / rate)) for term, rate in pairs])),
        "coverage": mean_of_known(np.array([float(term.low <= rate <= term.high) for term, rate in pairs])),
        "missing": float(len(places) - len(terms)),
    }


def _as_json(term: Estimate) -> Json:
    return {
        "x": float(term.place[0]),
        "y": float(term.place[1]),
        "spread_m": term.spread,
        "rate_kg_s": term.rate,
        "rate_low_kg_s": term.low,
        "rate_high_kg_s": term.high,
        "probability": term.probability,
    }


class BeliefScores:
    """Recorder of the belief scores of a run over time. Add `observer()` to the simulation's observers.

    rows: scores OF_BELIEFS of each group in the order of `beliefs`, means over its trials.
    """

    STATE = ("rows",)

    def __init__(self, sim: TimeLoop):
        self.groups = sum(len(believer.members.groups) for believer in believers(sim))
        self.rows = Series(len(OF_BELIEFS) * self.groups)

    def observer(self) -> Every:
        return Every(scores.PERIOD, self.sample)

    def now(self, sim: TimeLoop) -> list[tuple[GroupBeliefs, np.ndarray]]:
        """Return the current beliefs of each group with their scores (5, trials)."""
        on = scores.present(sim.scenario, sim.t)
        return [(belief, belief.scores(on)) for belief in beliefs(sim)]

    def sample(self, sim: TimeLoop) -> None:
        """Append the current scores to `rows`."""
        if self.groups:
            rows = [values.mean(axis=1) for _, values in self.now(sim)]
            self.rows.append((sim.t, np.ravel(rows)))

    def _source_terms(self, sim: TimeLoop, belief: GroupBeliefs) -> Json:
        """Return the estimated sources of each robot, and their scores; nothing for beliefs of the place alone."""
        terms = estimates(sim, belief.group)
        if terms is None:
            return {}
        places, rates = sim.scenario.targets_at(sim.t)[:, :2], sim.scenario.rates
        there = np.isfinite(places[:, 0])
        scored = [estimate_scores(each, places[there], rates[there]) for each in terms]
        names = scored[0]
        return {
            "sources": [[_as_json(source) for source in each] for each in terms],
            "source_scores": {name: mean_of_known(np.array([s[name] for s in scored])) for name in names},
            "source_scores_per_robot": {name: [s[name] for s in scored] for name in names},
        }

    def entries(self, sim: TimeLoop) -> list[Json]:
        """Return an entry per group for result.json: mean scores, scores of each trial, and means over time."""
        rows = []
        table = self.rows.values.reshape(len(self.rows), self.groups, len(OF_BELIEFS))
        for k, (belief, values) in enumerate(self.now(sim)):
            rows.append(
                {
                    "group": belief.group.name,
                    "algorithm": belief.group.model.algorithm.kind,
                    "cell_m": belief.cell,
                    **dict(zip(OF_BELIEFS, values.mean(axis=1).tolist(), strict=True)),
                    **self._source_terms(sim, belief),
                    "per_trial": dict(zip(OF_BELIEFS, values.tolist(), strict=True)),
                    "over_time": {
                        "time_s": self.rows.times.tolist(),
                        **{name: table[:, k, c].tolist() for c, name in enumerate(OF_BELIEFS)},
                    },
                }
            )
        return rows
