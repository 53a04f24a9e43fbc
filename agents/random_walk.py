"""Random walk: straight legs in random directions, whatever is smelt. What search algorithms are compared with.

WALK  turn by a random angle and drive a leg
BUMP  something is in the way: another random angle, and a new leg
"""

from math import pi, radians
from typing import cast

import taichi as ti

from taichi_plume.agents.few import few
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.legs import DRIVE, Legs
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario import algorithms

WALK, BUMP = range(2)


@ti.data_oriented
class RandomWalk:
    """The random walk. tick: control period [s]."""

    PER_GROUP: bool = False
    STATE: tuple[str, ...] = ("legs",)
    STATE_NAMES: tuple[str, ...] = ("WALK", "BUMP")

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        self.swarm, self.size = swarm, members.size
        self.robot, self.number = members.robot, members.number
        self.p = Parameters(members, self.numbers, stream="random walk")
        self.legs = Legs(members, self.p)
        self.begin()

    def numbers(self, group: GroupRange) -> Numbers:
        """Those of a group that kernels read."""
        model = cast(algorithms.RandomWalk, group.model.algorithm)
        return {
            **Legs.numbers(group, model.speed),
            "leg": model.leg,  # m
            "scatter": model.leg_spread,
            "turn": radians(model.turn_angle_deg),
        }

    def begin(self) -> None:
        self.p.begin()

    def act(self, tick: int, t: float, dt: float) -> None:
        self._act(tick, dt)

    @ti.kernel
    def _act(self, tick: int, dt: float):
        ti.loop_config(serialize=ti.static(few(self.size)))
        for n in range(self.size):
            i = self.robot[n]
            if self.swarm.blocked[i] == 1 and self.legs.phase[n] == DRIVE:
                self._set_out(n, tick, BUMP)
            if not self.legs.advance(n, dt):
                self._set_out(n, tick, WALK)
                self.legs.advance(n, dt)

    @ti.func
    def _set_out(self, n, tick, state):
        u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 0)
        most = ti.select(state == BUMP, pi, self.p.turn[n])
        length = self.p.leg[n] * (1.0 + self.p.scatter[n] * (2.0 * u[1] - 1.0))
        self.swarm.state[self.robot[n]] = state
        self.legs.set_out(n, most * (2.0 * u[0] - 1.0), length, 1.0)
