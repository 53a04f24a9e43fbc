"""Groups of a scenario and their ranges of robots in the swarm."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor

import numpy as np

from taichi_plume.grid.rng import generator
from taichi_plume.scenario.robots import Group


@dataclass(frozen=True)
class GroupRange:
    """Range of a group in the swarm: robot i of trial k has index start + k count + i.

    number: number of the group in the scenario, from 0 on; part of the names of random streams, as group names may
    repeat. row: row of the first trial in the swarm's `members`.
    """

    number: int
    name: str
    start: int
    count: int
    trials: int
    model: Group
    row: int = 0

    @property
    def size(self) -> int:
        """Number of robots of all trials."""
        return self.count * self.trials

    @property
    def first(self) -> int:
        """Number of the first robot among all possible trials, the counter of random streams."""
        return self.model.first_trial * self.count

    def speed(self, given: float | None) -> float:
        """Return the given speed, or else the body's largest [m/s]."""
        return self.model.body.max_speed if given is None else given

    def waits(self, tick: float) -> int:
        """Return the number of ticks before the robots get their first command; tick: control period [s]."""
        return floor(self.model.begin / tick + 1e-6)

    def generators(self, seed: int, name: str) -> list[np.random.Generator]:
        """Return a random generator per trial, the same for a trial alone and among others."""
        first = self.model.first_trial
        return [
            generator(seed, f"group {self.number}/{name} of trial {first + k}") for k in range(self.trials)
        ]

    @property
    def slice(self) -> slice:
        """The group's part of an array over the swarm."""
        return slice(self.start, self.start + self.size)


def ranges(groups: Sequence[Group], rivals: bool) -> list[GroupRange]:
    """Return the ranges of the groups, one after the other; groups of rivals have trials of their own."""
    result, start, row = [], 0, 0
    for number, group in enumerate(groups):
        result.append(GroupRange(number, group.name, start, group.count, group.trials, group, row))
        start += result[-1].size
        row += group.trials if rivals else 0
    return result
