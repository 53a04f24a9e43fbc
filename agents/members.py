"""Members: robots that an algorithm drives, or that have a kind of sensor, numbered from 0 on."""

from collections.abc import Sequence

import numpy as np
import taichi as ti
from taichi.lang import impl

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.kernels import Field, Template
from taichi_plume.grid.rng import stream_id
from taichi_plume.grid.transfer import uploader


class OfGroup:
    """Number, or row of numbers, shared by the robots of a group: in kernels ``x[n]`` or ``x[n, k]``, like a field over
    the robots n, but from a table with a row per group, which stays in the cache.

    group: field of the row of each robot; None with a single group.
    """

    def __init__(self, table: Field, group: Field):
        self.table, self.group = table, group

    def __getitem__(self, at: object) -> Field:
        n, *rest = at if isinstance(at, tuple) else (at,)
        row = 0 if self.group is None else impl.subscript(None, self.group, n)
        return impl.subscript(None, self.table, row, *rest)


def group_rows(sizes: Sequence[int]) -> Field:
    """Return a field of the group number of each robot, for groups of these sizes; None with a single group."""
    if len(sizes) < 2:
        return None
    rows = np.repeat(np.arange(len(sizes)), sizes)
    field = ti.field(ti.i32, max(1, len(rows)))
    uploader(field)(rows if len(rows) else 0)
    return field


@ti.data_oriented
class Members:
    """Robots of several groups of a swarm, all trials: member n is robot `robot[n]` of the swarm.

    numbers: numbers of the groups, by their position in the scenario. number[n]: number of the robot among all robots
    of all possible trials of its group. Random streams count by this number, so that a trial draws the same alone and
    among others.
    """

    def __init__(self, swarm: Swarm, numbers: Sequence[int]):
        self.swarm, self.numbers = swarm, tuple(numbers)
        self.size = sum(group.size for group in self.groups)
        self.robot = ti.field(ti.i32, max(1, self.size))
        self.number = ti.field(ti.i32, max(1, self.size))
        self.row = group_rows([group.size for group in self.groups])
        if self.size:
            robots = [np.arange(group.start, group.start + group.size) for group in self.groups]
            numbered = [group.first + np.arange(group.size) for group in self.groups]
            uploader(self.robot, self.number)(np.concatenate(robots), np.concatenate(numbered))

    @property
    def groups(self) -> list[GroupRange]:
        """The groups with their present numbers, which a reset may change."""
        return [self.swarm.groups[number] for number in self.numbers]

    def streams(self, name: str) -> np.ndarray:
        """Return the keys of the random stream `name` of each group, u32."""
        return np.array([stream_id(f"group {number}/{name}") for number in self.numbers], np.uint32)


@ti.func
def sensor_place(swarm: Template, dim: Template, i, height):
    """Return the position of a sensor above the middle of robot i, a point of the grid's dimension.

    height [m]: over the lower end of the body, which for robots on the floor is over the floor.
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
