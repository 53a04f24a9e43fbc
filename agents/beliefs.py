"""Beliefs: posterior probability of the source's position for each robot, and the rule for declaring the source.

Beliefs of any algorithm with the protocol `Believer` are recorded, written and scored. Algorithms with a belief on a
grid of cells keep it in `Beliefs`. All algorithms with beliefs declare by `Declaring`.
"""

from typing import Protocol, runtime_checkable

import numpy as np

from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.priors import prior_weights
from taichi_plume.agents.source_posterior import Estimate
from taichi_plume.engine import ti
from taichi_plume.scenario.belief_algorithms import Declares

LEAST = 1e-12  # total probability that counts as zero
APART = 2.0  # least distance of two distinct positions, as a multiple of `declare_spread`


@runtime_checkable
class Believer(Protocol):
    """Protocol of search algorithms whose robots keep a belief (posterior) of the source's position."""

    members: Members
    """Robots of the algorithm, see `Members`."""
    belief_cell: float
    """Edge length of the belief maps' cells [m]."""
    belief_low: np.ndarray
    """Lower corner (2,) [m] of the belief maps."""

    def beliefs(self) -> np.ndarray:
        """Return the source's probability in each map cell, (robots, nx, ny); the cells of each robot sum to 1."""
        ...


@runtime_checkable
class Estimator(Believer, Protocol):
    """Protocol of search algorithms whose belief has the strengths of the sources, too."""

    def estimates(self) -> list[list[Estimate]]:
        """Return the estimated sources of each robot, the surest first."""
        ...


class Beliefs:
    """Grid beliefs: `p[n, a, b]` is the probability of the source in cell (a, b) by robot n, the prior at first. cell:
    edge of the square cells [m]. low, extent: lower corner and size of the search area [m]. even * weight[a, b]: prior.
    """

    STATE: tuple[str, ...] = ("p",)

    def __init__(self, members: Members, cell: float):
        clearance = members.swarm.clearance
        self.cell, self.low = cell, clearance.low
        self.extent = tuple(clearance.high[d] - clearance.low[d] for d in range(2))
        self.cells = tuple(max(1, round(length / cell)) for length in self.extent)
        self.even = 1.0 / (self.cells[0] * self.cells[1])
        weights = prior_weights(members, cell)
        self.weight = ti.filled(weights, ti.f32)
        self.p = ti.filled(np.tile(self.even * weights, (members.size, 1, 1)))

    @ti.func
    def middle(self, a, b):
        """Return the centre of cell (a, b) relative to the lower corner of the search area, (2,) [m]."""
        return self.cell * (ti.Vector([a, b]) + 0.5)

    @ti.func
    def is_within(self, r, reach):
        """Return whether a whole cell lies within `reach` [m] of the origin; r: centre of the cell (2,) [m]."""
        half = 0.5 * self.cell
        return (ti.abs(r[0]) + half) ** 2 + (ti.abs(r[1]) + half) ** 2 <= reach**2

    @ti.func
    def normalize(self, n, total):
        """Divide the probabilities of robot n by their sum `total`; return to the prior if the sum is almost zero."""
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                prior = self.even * self.weight[a, b]
                self.p[n, a, b] = ti.select(total > LEAST, self.p[n, a, b] / ti.max(total, LEAST), prior)

    @ti.func
    def mean(self, n):
        """Return the expected source position by robot n, from the lower corner of the search area (2,) [m]."""
        mean = ti.Vector([0.0, 0.0])
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                mean += self.p[n, a, b] * self.middle(a, b)
        return mean

    @ti.func
    def spread(self, n, mean):
        """Return the root mean square distance of the source from `mean` [m] by robot n's belief."""
        square = self.cell**2 / 6.0
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                square += self.p[n, a, b] * (self.middle(a, b) - mean).norm_sqr()
        return ti.sqrt(square)

    @ti.func
    def entropy(self, n):
        """Return the entropy of robot n's belief [nat]."""
        total = 0.0
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                total -= self.p[n, a, b] * ti.log(ti.max(self.p[n, a, b], LEAST))
        return total


SPREAD = Decision(
    "belief_spread_m", "m", "root mean square distance of the source from its mean", "declaring.spread"
)
"""Decision quantity of algorithms whose part `declaring` decides on declarations."""


class Declaring:
    """Rule that lets a robot declare the source when the spread (standard deviation) of its belief is small.

    The limit is `declare_spread`, the declared position the mean of the belief. The mean has the least mean square
    error and does not depend on the cells; a small spread excludes a distant second peak, while the most probable cell
    would jump in a flat belief. A robot that continues its search does not learn whether its declaration was right: it
    declares again only when its belief is sure of another position, `APART` times the limit from the last one. The rule
    is that of Ojeda, Monroy & Gonzalez-Jimenez (2023, doi:10.48550/arXiv.2304.08879), a bound on the variance.
    parameters: must include the entries of `Declaring.numbers`.
    """

    STATE: tuple[str, ...] = ("said", "spoke", "spread")

    def __init__(self, members: Members, parameters: Parameters):
        self.swarm, self.robot, self.p = members.swarm, members.robot, parameters
        self.said = ti.vector_field(2, ti.f32, max(1, members.size))  # the last declaration [m]
        self.spoke = ti.field(ti.i32, max(1, members.size))
        self.spread = ti.filled(np.full(max(1, members.size), np.nan), ti.f32)  # of the last decision [m]

    @staticmethod
    def numbers(model: Declares, group: GroupRange) -> Numbers:
        """Return a group's limit `declare_spread` [m] and `ends_at` [m]: distance at which a robot would have found the
        source, so that a continued search rules out the positions around it; 0 where searches end by declaring.
        """
        return {
            "declare_spread": float(model.declare_spread or 0.0),
            "ends_at": float(group.model.reach if group.model.found == "reached" else 0.0),
        }

    @ti.func
    def consider(self, n, place, spread, t):
        """Declare a source at `place` [m], time t [s], if `spread` [m], that of robot n's belief, is small enough."""
        self.spread[n] = spread
        sure = self.p.declare_spread[n]
        if spread < sure and (self.spoke[n] == 0 or (place - self.said[n]).norm() > APART * sure):
            self.said[n], self.spoke[n] = place, 1
            self.swarm.declare(self.robot[n], place, t)
