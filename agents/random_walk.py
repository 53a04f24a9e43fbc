"""Random walk: straight legs in random directions, whatever is smelt. What search algorithms are compared with.

WALK  turn by a random angle and drive a leg
BUMP  something is in the way: another random angle, and a new leg
"""

from math import pi, radians

import taichi as ti

from taichi_plume.agents.legs import DRIVE, Legs
from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.grid.rng import stream_id, uniform4
from taichi_plume.scenario import algorithms

WALK, BUMP = range(2)


@ti.data_oriented
class RandomWalk:
    """A random walk of the robots of one group. tick: control period [s]."""

    STATE_NAMES: tuple[str, ...] = ("WALK", "BUMP")

    def __init__(self, swarm: Swarm, group: GroupRange, tick: float):
        model = group.model.algorithm
        assert isinstance(model, algorithms.RandomWalk)
        self.swarm, self.start, self.size, self.first = swarm, group.start, group.size, group.first
        self.seed, self.stream = swarm.seed, stream_id(f"group {group.number}/random walk")
        self.legs = Legs(swarm, group, model.speed)
        self.leg, self.scatter = model.leg, model.leg_spread
        self.turn = radians(model.turn_angle_deg)

    def act(self, tick: int, t: float, dt: float) -> None:
        """Command the next dt [s]."""
        self._act(tick, dt)

    @ti.kernel
    def _act(self, tick: int, dt: float):
        for n in range(self.size):
            i = self.start + n
            if self.swarm.blocked[i] == 1 and self.legs.phase[n] == DRIVE:
                self._set_out(n, tick, BUMP)
            if not self.legs.advance(n, dt):
                self._set_out(n, tick, WALK)
                self.legs.advance(n, dt)

    @ti.func
    def _set_out(self, n, tick, state):
        u = uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, tick, 0)
        most = ti.select(state == BUMP, pi, self.turn)
        length = self.leg * (1.0 + self.scatter * (2.0 * u[1] - 1.0))
        self.swarm.state[self.start + n] = state
        self.legs.begin(n, most * (2.0 * u[0] - 1.0), length, 1.0)
