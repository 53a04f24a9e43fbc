"""Groups of a scenario and their ranges of robots in the swarm."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor

import numpy as np

from taichi_plume.grid.rng import generator
from taichi_plume.scenario.robots import Group


@dataclass(frozen=True)
class GroupRange:
    """Range of a group's robots in the swarm: robot i of trial k has index start + k count + i.

    number: index of the group in the scenario, used in the names of random streams, as group names may repeat. count:
    robots per trial. row: row of the group's first trial in the swarm's table `members`.
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
        """Number of the group's robots in all trials together."""
        return self.count * self.trials

    @property
    def first(self) -> int:
        """Index of the group's first robot among all possible trials, the first counter of its random streams."""
        return self.model.first_trial * self.count

    def speed(self, given: float | None) -> float:
        """Return the speed `given` [m/s] or, if None, the largest speed of the group's robots."""
        return self.model.body.max_speed if given is None else given

    def waits(self, tick: float) -> int:
        """Return the number of control periods before the group's robots get a command; tick: control period [s]."""
        return floor(self.model.begin / tick + 1e-6)

    def generators(self, seed: int, name: str) -> list[np.random.Generator]:
        """Return one random generator per trial, called `name`; a trial draws the same alone and among others."""
        first = self.model.first_trial
        return [
            generator(seed, f"group {self.number}/{name} of trial {first + k}") for k in range(self.trials)
        ]

    @property
    def slice(self) -> slice:
        """Slice that selects the group's robots in an array over the swarm."""
        return slice(self.start, self.start + self.size)


def sensor_heights(groups: Sequence[GroupRange]) -> np.ndarray:
    """Return the height of each robot's first gas sensor above the lower end of its body [m], (robots,)."""
    heights = [np.full(group.size, group.model.sensors.nose.height) for group in groups]
    return np.concatenate([[], *heights])


def ranges(groups: Sequence[Group], rivals: bool) -> list[GroupRange]:
    """Return the ranges of the groups in the swarm, in order. rivals: whether each group has trials of its own."""
    result, start, row = [], 0, 0
    for number, group in enumerate(groups):
        result.append(GroupRange(number, group.name, start, group.count, group.trials, group, row))
        start += result[-1].size
        row += group.trials if rivals else 0
    return result
