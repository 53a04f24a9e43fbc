"""Random walk: straight path segments in random directions, without readings: the baseline of search algorithms.

WALK  turn by a random angle and drive a path segment
BUMP  after a collision: another random angle and a new segment
"""

from math import pi, radians

from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.path_segments import DRIVE, Legs
from taichi_plume.engine import ti
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario import algorithms

WALK, BUMP = range(2)


class RandomWalk(KernelAlgorithm):
    """Random-walk search algorithm, which ignores gas and wind. tick: control period [s]."""

    STREAM = "random walk"
    STATE: tuple[str, ...] = ("legs",)
    STATE_NAMES: tuple[str, ...] = ("WALK", "BUMP")
    DECISIONS: tuple[Decision, ...] = (
        Decision("course", "rad", "direction of the path segment", "legs.course"),
        Decision("segment_m", "m", "length of the path segment", "legs.length"),
    )

    def _allocate(self) -> None:
        self.legs = Legs(self.members, self.p)

    def numbers(self, group: GroupRange, model: algorithms.RandomWalk) -> Numbers:
        return {
            **Legs.numbers(group, model.speed),
            "leg": model.leg,  # m
            "scatter": model.leg_spread,
            "turn": radians(model.turn_angle_deg),
        }

    @ti.func
    def _step(self, n, tick, t, dt):
        if self.swarm.blocked[self.robot[n]] == 1 and self.legs.phase[n] == DRIVE:
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
