"""Robots in a row: those of the groups that one algorithm drives, or that have one kind of sensor."""

from collections.abc import Callable, Sequence

import numpy as np
import taichi as ti

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import stream_id
from taichi_plume.grid.transfer import uploader


@ti.data_oriented
class Members:
    """The robots of some groups of a swarm, all trials: the n-th is robot `robot[n]` of the swarm.

    numbers: of the groups, by their place in the scenario. number[n] counts the robot among all robots of all trials
    that its group could have: random streams count by it, so that a trial draws the same alone and among others.
    """

    def __init__(self, swarm: Swarm, numbers: Sequence[int]):
        self.swarm, self.numbers = swarm, tuple(numbers)
        self.size = sum(group.size for group in self.groups)
        self.robot = ti.field(ti.i32, max(1, self.size))
        self.number = ti.field(ti.i32, max(1, self.size))
        if self.size:
            robots = [np.arange(group.start, group.start + group.size) for group in self.groups]
            numbered = [group.first + np.arange(group.size) for group in self.groups]
            uploader(self.robot, self.number)(np.concatenate(robots), np.concatenate(numbered))

    @property
    def groups(self) -> list[GroupRange]:
        """The groups as they are now: a reset may change their numbers."""
        return [self.swarm.groups[number] for number in self.numbers]

    def each(self, value: Callable[[GroupRange], float | np.ndarray]) -> np.ndarray:
        """A number per robot (size,), from one per group or an array over the group's robots; f64."""
        values = [np.broadcast_to(np.asarray(value(group), float), (group.size,)) for group in self.groups]
        return np.concatenate(values) if values else np.zeros(1)

    def streams(self, name: str) -> np.ndarray:
        """Keys of the random stream `name` of each robot's group (size,), u32."""
        values = [np.full(g.size, stream_id(f"group {g.number}/{name}"), np.uint32) for g in self.groups]
        return np.concatenate(values) if values else np.zeros(1, np.uint32)


@ti.func
def sensor_place(swarm: Template, dim: Template, i, height):
    """Where a sensor above the middle of robot i is: a point of the domain's dimension."""
    p = swarm.position[i]
    x = ti.Vector.zero(ti.f32, dim)
    x[0] = p[0]
    x[1] = p[1]
    if ti.static(dim == 3):
        x[2] = height
    return x
