"""Where the groups of a scenario lie in the swarm."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor

import numpy as np

from taichi_plume.grid.rng import generator
from taichi_plume.scenario.robots import Group


@dataclass(frozen=True)
class GroupRange:
    """Where a group lies in the swarm: robot i of trial k has index start + k count + i.

    number: of the group in the scenario, from 0 on; its random streams are named by it, as names may repeat. row: of
    its first trial in the swarm's `members`.
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
        """Robots of all trials."""
        return self.count * self.trials

    @property
    def first(self) -> int:
        """Number of its first robot among all trials there could be: random streams count by it."""
        return self.model.first_trial * self.count

    def speed(self, wanted: float | None) -> float:
        """What is wanted, or else the body's largest [m/s]."""
        return self.model.body.max_speed if wanted is None else wanted

    def waits(self, tick: float) -> int:
        """Number of ticks [s] before that in which its robots set off: get their first command."""
        return floor(self.model.begin / tick + 1e-6)

    def generators(self, seed: int, name: str) -> list[np.random.Generator]:
        """What is drawn once for the robots of each trial, the same for a trial alone and among others."""
        first = self.model.first_trial
        return [
            generator(seed, f"group {self.number}/{name} of trial {first + k}") for k in range(self.trials)
        ]

    @property
    def slice(self) -> slice:
        """The group's part of an array over the swarm."""
        return slice(self.start, self.start + self.size)


def ranges(groups: Sequence[Group], rivals: bool) -> list[GroupRange]:
    """The groups one after the other; those of rivals have trials of their own."""
    result, start, row = [], 0, 0
    for number, group in enumerate(groups):
        result.append(GroupRange(number, group.name, start, group.count, group.trials, group, row))
        start += result[-1].size
        row += group.trials if rivals else 0
    return result
