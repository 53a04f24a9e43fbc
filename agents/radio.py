"""What the robots of a team tell each other: short messages that reach those in range, unless they are lost.

A robot says a value and the place it belongs to; with them go the time and where it believes to be. Of each team mate
the others keep what they heard last.
"""

from typing import Any

import taichi as ti

from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.grid.rng import stream_id, uniform4

NEVER = -1.0  # s, time of a message that has not come
UNLIMITED = 1e9  # m


@ti.data_oriented
class Radio:
    """Messages between the robots of each trial of one group.

    `value`, `place`, `sender` [m] and `time` [s] of [n, m]: what robot n of the group heard last from robot m of its
    team; ask `has_heard` before.
    """

    def __init__(self, swarm: Swarm, group: GroupRange):
        model = group.model.communication
        self.swarm, self.start, self.size, self.count = swarm, group.start, group.size, group.count
        self.seed, self.first = swarm.seed, group.first
        self.stream = stream_id(f"group {group.number}/radio")
        self.range = UNLIMITED if model.range is None else model.range
        self.loss = model.loss
        shape = (group.size, group.count)
        self.value = ti.field(ti.f32, shape)
        self.place: Any = ti.Vector.field(2, ti.f32, shape)
        self.sender: Any = ti.Vector.field(2, ti.f32, shape)
        self.time = ti.field(ti.f32, shape)
        self.time.fill(NEVER)
        self.speaks = ti.field(ti.i32, group.size)  # whether the robot says something in this tick
        self.said_value = ti.field(ti.f32, group.size)
        self.said_place: Any = ti.Vector.field(2, ti.f32, group.size)

    @ti.func
    def say(self, n, value, place):
        """Robot n tells its team; it goes out with the next `deliver`."""
        self.speaks[n], self.said_value[n], self.said_place[n] = 1, value, place

    @ti.func
    def has_heard(self, n, m):
        """Whether robot n knows of a message from robot m of its team."""
        return self.time[n, m] >= 0.0

    @ti.func
    def forget(self, n):
        """Robot n no longer knows what it heard."""
        for m in range(self.count):
            self.time[n, m] = NEVER

    def deliver(self, tick: int, t: float) -> None:
        """Bring what was said in this tick, at time t [s], to those in range."""
        self._deliver(tick, t)
        self.speaks.fill(0)

    @ti.kernel
    def _deliver(self, tick: int, t: float):
        for n, m in self.value:
            other = n - n % self.count + m
            if other != n and self.speaks[other] == 1:
                apart = self.swarm.position[self.start + n] - self.swarm.position[self.start + other]
                near = apart.norm() <= self.range
                u = uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, tick, m)
                if near and u[0] > self.loss:
                    self.value[n, m], self.place[n, m] = self.said_value[other], self.said_place[other]
                    self.sender[n, m] = self.swarm.believed_position[self.start + other]
                    self.time[n, m] = t
