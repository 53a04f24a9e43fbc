"""SPIRAL and E. coli without air flow: random SPIRAL along several arms, and indices of a known noise.

Random SPIRAL uses no gas readings, so that its two published rows depend on geometry and timing alone: on the arms,
which the paper chose by the size of the area without giving their lengths. On a smooth field with noise,
PI = 1/(0.3 m + d) exp(s N(0, 1)) at a distance d from the dish, the number of acquisitions shows how much the
indices in the paper's room can have varied. s is the standard deviation of their logarithm, drawn independently for
each acquisition.
"""

from functools import cache
from typing import Any

import numpy as np

from taichi_plume.assembly.assemble import assemble
from taichi_plume.engine import ti
from taichi_plume.grid.rng import normal4, stream_id
from taichi_plume.scoring.trials import mean_with_interval
from taichi_plume.validation.case import Keys
from taichi_plume.validation.experiment import Lines, Mean, Results
from taichi_plume.validation.searches import outcomes, scenario_of
from taichi_plume.validation.spiral_room import ALGORITHMS, DISTANCES, SOURCE, TABLE_2, at, floor, momo

LONGEST = 4 * 3600.0  # s, in which all robots find the dish
ARMS: dict[str, tuple[float, ...]] = {  # m, each in proportion to the area
    "0.35 m {1, 1, 2, 2, 3, 3}": (0.35, 0.35, 0.7, 0.7, 1.05, 1.05),
    "0.4 m {1, 1, 2, 2, 3, 3}": (0.4, 0.4, 0.8, 0.8, 1.2, 1.2),
    "0.45 m {1, 1, 2, 2, 3, 3}": (0.45, 0.45, 0.9, 0.9, 1.35, 1.35),
    "0.5, 0.5, 0.75, 0.75, 1, 1 m": (0.5, 0.5, 0.75, 0.75, 1.0, 1.0),
}
SPREADS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6)
NEAR = 0.3  # m, within which the field is flat
FAR = 2.0  # m, beyond which indices are averaged to the minimum, as in the paper
NOISY = ("SPIRAL", "E. coli 3 s")


class NoisyIndex:
    """Stand-in for the sensors: proximity indices with a known noise, constant during an acquisition.

    spread: standard deviation of the index' logarithm, per robot.
    """

    STATE = ()

    def __init__(self, swarm: Any, spread: np.ndarray):
        self.swarm, self.count = swarm, swarm.count
        self.spread = ti.filled(spread)

    def measure(self, gas: Any, wind: Any, tick: int, t: float) -> None:
        """Set the readings of all robots to noisy indices at their positions."""
        self._measure()

    @ti.kernel
    def _measure(self):
        for i in range(self.count):
            apart = self.swarm.position[i] - ti.Vector(SOURCE)
            g = normal4(
                self.swarm.key[None],
                ti.u32(ti.static(stream_id("noisy index"))),
                i,
                self.swarm.acquisitions[i],
                0,
            )
            # a constant record has no peak, so that its mean counts twice
            self.swarm.reading[i] = 0.5 / (NEAR + apart.norm()) * ti.exp(self.spread[i] * g[0])


def _minimum() -> float:
    """Return the mean proximity index beyond FAR from the dish, over the arena."""
    x, y = np.meshgrid(np.arange(1.0, 4.0, 0.01), np.arange(0.85, 2.95, 0.01))
    d = np.hypot(x - SOURCE[0], y - SOURCE[1])
    return float((1.0 / (NEAR + d[d > FAR])).mean())


def searched_on_floor(groups: list[Keys], spreads: list[float]) -> list[dict[str, np.ndarray]]:
    """Return the outcomes of searches by groups of rivals, each with indices of its own noise."""
    sim = assemble(scenario_of(floor(groups, LONGEST) | {"rivals": True}))
    sim.sensors = NoisyIndex(sim.swarm, np.repeat(spreads, [g.size for g in sim.swarm.groups]))
    sim.run()
    columns = outcomes(sim)
    return [{name: np.array(values) for name, values in columns[g["name"]].items()} for g in groups]


def chi_square(published: list[tuple[float, int]], samples: list[np.ndarray]) -> float:
    """Return the chi-square of published means of n trials against our samples, with standard errors for n trials."""
    return sum(
        (mean - values.mean()) ** 2 / (values.var(ddof=1) / n)
        for (mean, n), values in zip(published, samples, strict=True)
    )


def arms(trials: int) -> Results:
    """Return acquisitions, time per acquisition and chi-square of both published means, for each set of arm lengths."""
    random = ALGORITHMS["random SPIRAL"]
    groups = [
        momo(f"{name} {d}", trials, at(d), random | {"arms": list(lengths)})
        for name, lengths in ARMS.items()
        for d in DISTANCES
    ]
    columns = searched_on_floor(groups, [0.0] * len(groups))
    results: dict[str, Mean] = {}
    for k, name in enumerate(ARMS):
        both = columns[2 * k : 2 * k + 2]
        steps = [sample["acquisitions"] for sample in both]
        published = [TABLE_2["random SPIRAL", d].acquisitions for d in DISTANCES]
        for d, values in zip(DISTANCES, steps, strict=True):
            results[f"{name}: acquisitions, {d} cm"] = Mean(**mean_with_interval(values))
        chi = chi_square([(sample.mean, sample.n) for sample in published], steps)
        results[f"{name}: chi-square, of 2"] = Mean(chi, None, None, trials)
        each = sum(sample["time_s"].sum() for sample in both) / sum(values.sum() for values in steps)
        results[f"{name}: time per acquisition [s]"] = Mean(float(each), None, None, 2 * trials)
    return results


@cache
def noisy(trials: int) -> dict[tuple[str, int, float], np.ndarray]:
    """Return the acquisitions of each algorithm from each distance at each spread of the indices."""
    algorithms = ALGORITHMS | {"SPIRAL": ALGORITHMS["SPIRAL"] | {"minimum_ppm": _minimum()}}
    cases = [(name, d, s) for name in NOISY for d in DISTANCES for s in SPREADS]
    groups = [momo(f"{name} {d} {s}", trials, at(d), algorithms[name]) for name, d, s in cases]
    columns = searched_on_floor(groups, [s for *_, s in cases])
    return {case: sample["acquisitions"] for case, sample in zip(cases, columns, strict=True)}


def noise(trials: int) -> Results:
    """Return the number of acquisitions over the spread of the indices, with the published values as lines."""
    counts, x = noisy(trials), np.array(SPREADS)
    rows: Keys = {}
    for d in DISTANCES:
        lines = {}
        for name in NOISY:
            lines[name] = np.array([counts[name, d, s].mean() for s in SPREADS])
            lines[f"{name}, published"] = np.full(len(x), TABLE_2[name, d].acquisitions.mean)
            for s in (0.0, 0.2, 0.4, 0.6):
                rows[f"{name}, {d} cm, spread {s:g}"] = Mean(**mean_with_interval(counts[name, d, s]))
        rows[f"acquisitions from {d} cm"] = Lines("standard deviation of ln(index)", "acquisitions", x, lines)
    return rows
