"""Members: the robots that an algorithm drives, or that have a kind of sensor, with indices from 0 on."""

from collections.abc import Sequence

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import stream_id


class OfGroup:
    """View in kernels of a table with one row per group, indexed like a field over robots: ``x[n]`` or ``x[n, k]``.

    All robots of a group share a row, so the table stays in the cache. group: field with each robot's row; None if
    single.
    """

    def __init__(self, table: Field, group: Field | None):
        self.table, self.group = table, group

    def __getitem__(self, at: object) -> Field:
        n, *rest = at if isinstance(at, tuple) else (at,)
        row = 0 if self.group is None else self.group[n]
        return self.table[(row, *rest)]


def group_rows(sizes: Sequence[int]) -> Field | None:
    """Return a field with the group index of each robot, for groups of these sizes; None with fewer than two groups."""
    if len(sizes) < 2:
        return None
    return ti.filled(np.repeat(np.arange(len(sizes)), sizes))


class Members:
    """Robots of several groups of a swarm, in all trials: member n is robot `robot[n]` of the swarm.

    numbers: indices of the groups in the scenario. number[n]: index of robot n among all robots of all possible trials
    of its group. Random streams count by this index, so that a trial draws the same alone and among others.
    """

    def __init__(self, swarm: Swarm, numbers: Sequence[int]):
        self.swarm, self.numbers = swarm, tuple(numbers)
        self.groups: list[GroupRange] = [swarm.groups[number] for number in self.numbers]
        self.size = sum(group.size for group in self.groups)
        self.robot = ti.filled([g.start + n for g in self.groups for n in range(g.size)], ti.i32)
        self.number = ti.filled([g.first + n for g in self.groups for n in range(g.size)], ti.i32)
        self.row = group_rows([group.size for group in self.groups])

    def streams(self, name: str) -> np.ndarray:
        """Return the key (u32) of each group's random stream called `name`."""
        return np.array([stream_id(f"group {number}/{name}") for number in self.numbers], np.uint32)


@ti.func
def sensor_place(swarm: Template, dim: Template, i, height):
    """Return the position [m] of a sensor on the axis of robot i, a vector with the dimension `dim` of the grid.

    height [m]: above the lower end of the body, which is the floor for ground robots and `altitude` for drones.
    """
    p = swarm.position[i]
    x = ti.Vector.zero(ti.f32, dim)
    x[0] = p[0]
    x[1] = p[1]
    if ti.static(dim == 3):
        x[2] = height
        if ti.static(swarm.flies):
            x[2] += swarm.altitude[i]
    return x
