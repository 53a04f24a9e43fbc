"""Beliefs: posterior probability of the source's position for each robot, and the rule for declaring the source.

Beliefs of any algorithm that offers `Believer` are recorded, written and scored. Algorithms with a belief on a grid
of cells keep it in `Beliefs`; all of them declare by `Declaring`.
"""

from typing import Protocol, runtime_checkable

import numpy as np
import taichi as ti

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.scenario.belief_algorithms import Declares

LEAST = 1e-12  # probability that counts as none
APART = 2.0  # in spreads of a sure belief: least distance of two distinct positions


@runtime_checkable
class Believer(Protocol):
    """Protocol of algorithms whose robots have beliefs of the source's position."""

    members: Members
    """Robots of the algorithm, see `Members`."""
    belief_cell: float
    """Edge of the maps' cells [m]."""
    belief_low: np.ndarray
    """Lower corner of the first cell (2,) [m]."""

    def beliefs(self) -> np.ndarray:
        """Return probabilities of the source's position, (robots, nx, ny), in the order of `members`; each map sums
        to 1.
        """
        ...


@ti.data_oriented
class Beliefs:
    """Beliefs of robots: probabilities `p[n, a, b]` of the cells of the search area, uniform at first. cell: edge of
    the square cells [m]. low: lower corner of the search area; extent: size of the search area [m].
    """

    STATE: tuple[str, ...] = ("p",)

    def __init__(self, members: Members, cell: float):
        clearance = members.swarm.clearance
        self.cell, self.low = cell, clearance.low
        self.extent = tuple(clearance.high[d] - clearance.low[d] for d in range(2))
        self.cells = tuple(max(1, round(length / cell)) for length in self.extent)
        self.even = 1.0 / (self.cells[0] * self.cells[1])
        self.p = ti.field(ti.f32, (members.size, *self.cells))

    @ti.func
    def middle(self, a, b):
        """Return the centre of cell (a, b), relative to the lower corner of the search area [m]."""
        return self.cell * (ti.Vector([a, b]) + 0.5)

    @ti.func
    def is_within(self, r, reach):
        """Return whether the whole cell is within `reach` [m]; r: vector to its centre [m]."""
        half = 0.5 * self.cell
        return (ti.abs(r[0]) + half) ** 2 + (ti.abs(r[1]) + half) ** 2 <= reach**2

    @ti.func
    def normalize(self, n, total):
        """Divide the probabilities of robot n by their sum `total`; if nothing is left, make them uniform."""
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                self.p[n, a, b] = ti.select(total > LEAST, self.p[n, a, b] / ti.max(total, LEAST), self.even)

    @ti.func
    def mean(self, n):
        """Return the expected position of the source, relative to the lower corner of the search area [m]."""
        mean = ti.Vector([0.0, 0.0])
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                mean += self.p[n, a, b] * self.middle(a, b)
        return mean

    @ti.func
    def spread(self, n, mean):
        """Return the root mean square distance of the source from `mean` [m], with each cell evenly filled."""
        square = self.cell**2 / 6.0
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                square += self.p[n, a, b] * (self.middle(a, b) - mean).norm_sqr()
        return ti.sqrt(square)


@ti.data_oriented
class Declaring:
    """Declaration of the source when the spread of a belief, the root of its variance, is below `declare_spread`.

    The declared position is the mean of the belief. Of all positions the mean has the least mean square error, and it
    does not depend on the cells; a small spread excludes a distant second peak, while the most probable cell would jump
    in a flat belief. A robot that continues its search does not learn whether its declaration was right: it declares
    again only when its belief is sure of another position, `APART` spreads from the last position.

    The rule is that of Ojeda, Monroy & Gonzalez-Jimenez (2023, doi:10.48550/arXiv.2304.08879), a bound on the
    variance. parameters: with the `numbers` of these models.
    """

    STATE: tuple[str, ...] = ("said", "spoke")

    def __init__(self, members: Members, parameters: Parameters):
        self.swarm, self.robot, self.p = members.swarm, members.robot, parameters
        self.said = ti.Vector.field(2, ti.f32, max(1, members.size))  # the last declaration [m]
        self.spoke = ti.field(ti.i32, max(1, members.size))

    @staticmethod
    def numbers(model: Declares, group: GroupRange) -> Numbers:
        """Return the numbers of a group. `ends_at`: distance at which a robot would have found the source, so that a
        continued search rules out the positions around the robot; 0 where searches end by declaring.
        """
        return {
            "declare_spread": float(model.declare_spread or 0.0),
            "ends_at": float(group.model.reach if group.model.found == "reached" else 0.0),
        }

    @ti.func
    def consider(self, n, place, spread, t):
        """Declare `place` [m] at time t [s] if the belief of robot n, of that spread [m], is sure enough."""
        sure = self.p.declare_spread[n]
        if spread < sure and (self.spoke[n] == 0 or (place - self.said[n]).norm() > APART * sure):
            self.said[n], self.spoke[n] = place, 1
            self.swarm.declare(self.robot[n], place, t)
