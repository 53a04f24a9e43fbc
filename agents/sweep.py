"""Sweep (coverage search): lanes to and fro over the whole floor, shared between the robots of a team.

Systematic search to which Turduev, Cabrita, Kırtay, Gazi & Marques, Autonomous Agents and Multi-Agent Systems 28 (2014)
72-100, compare swarms; gas is not used. Each robot has a block of neighbouring lanes, in the order in which the robots
start across the lanes, and starts at the nearest corner of its block.

TRANSIT  drive to the start of the first lane
SWEEP    along lane after lane, around obstacles and back; a lane that ends in an obstacle ends at the next free point
DONE     stand at the end, unless the sweep is to be repeated backwards
"""

from typing import cast

import numpy as np

from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.decisions import Decision, way_point
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.potential import NEAR, Potential
from taichi_plume.engine import ti
from taichi_plume.scenario import algorithms

TRANSIT, SWEEP, DONE = range(3)

AHEAD = 0.3  # m along the lane from the robot to its present goal


class Sweep(KernelAlgorithm):
    """Sweep (coverage) search algorithm, for each team separately. tick: control period [s]."""

    STATE: tuple[str, ...] = ("potential", "next", "order")
    STATE_NAMES: tuple[str, ...] = ("TRANSIT", "SWEEP", "DONE")
    DECISIONS: tuple[Decision, ...] = way_point()

    def _allocate(self) -> None:
        self.potential = Potential(self.members, self.p)
        ways = self._ways()
        table = np.zeros((self.size, max(map(len, ways)), 2))
        for row, way in zip(table, ways, strict=True):
            row[: len(way)] = way
        self.way = ti.filled_vectors(table)  # way points [m]
        self.length = ti.filled([len(way) for way in ways])  # number of way points
        self.next = ti.field(ti.i32, self.size)  # number of the present way point
        self.order = ti.filled(np.ones(self.size, int))  # +1: forwards, -1: back

    def numbers(self, group: GroupRange, model: algorithms.Sweep) -> Numbers:
        return {**Potential.numbers(self.swarm, group, model.speed, model.avoidance), "repeat": model.repeat}

    @property
    def way_point(self) -> np.ndarray:
        """Point to which each robot drives, the end of its lane, (size, 2) [m]."""
        return self.way.values[np.arange(self.size), self.next.values]

    def _ways(self) -> list[np.ndarray]:
        """Return the way points (k, 2) [m] of every robot, along its lanes."""
        low, high = np.array(self.swarm.clearance.low), np.array(self.swarm.clearance.high)
        ways = []
        for group in self.members.groups:
            model = cast(algorithms.Sweep, group.model.algorithm)
            axis, number = model.lanes(high - low, group.count)
            room = group.model.body.radius + model.avoidance
            for team in self.swarm.start[group.slice].reshape(group.trials, group.count, 2):
                ways += [low + way for way in lanes(team - low, high - low, axis, number, room)]
        return ways

    @ti.func
    def _step(self, n, tick, t, dt):
        i = self.robot[n]
        end = self.potential.clear(n, self.way[n, self.next[n]])
        if self.swarm.state[i] != DONE and self.potential.is_over(n, end, NEAR):
            self._proceed(n)
        if self.swarm.state[i] == DONE:
            self.potential.stand(n)
        else:
            self.potential.drive(n, self.potential.clear(n, self._goal(n)), dt)

    @ti.func
    def _goal(self, n):
        """Return the point to which robot n drives: its way point or, on a lane, at most AHEAD along the lane."""
        goal = self.way[n, self.next[n]]
        if self.swarm.state[self.robot[n]] == SWEEP:
            begin = self.way[n, self.next[n] - self.order[n]]
            length = (goal - begin).norm()
            along = (goal - begin) / length
            way = (self.swarm.believed_position[self.robot[n]] - begin).dot(along) + AHEAD
            goal = begin + ti.math.clamp(way, 0.0, length) * along
        return goal

    @ti.func
    def _proceed(self, n):
        """Switch robot n to its next way point; at the last one the robot stops or sweeps back."""
        following = self.next[n] + self.order[n]
        state = SWEEP
        if following < 0 or following == self.length[n]:
            self.order[n] = -self.order[n]
            following = self.next[n] + self.order[n]
            state = ti.select(self.p.repeat[n] == 1, SWEEP, DONE)
        self.swarm.state[self.robot[n]] = state
        self.next[n] = following
        self.potential.set_out(n)


def lanes(team: np.ndarray, size: np.ndarray, axis: int, number: int, room: float) -> list[np.ndarray]:
    """Return the way points (k, 2) [m] of each robot of a team that starts at `team` (robots, 2) [m].

    size: extent of the floor, from the origin on [m]. axis, number: direction and number of the lanes. room: distance
    from a lane's ends to the walls [m].
    """
    across = (np.arange(number) + 0.5) * size[1 - axis] / number
    ends = np.array([room, size[axis] - room])
    ways: list[np.ndarray] = [np.empty((0, 2))] * len(team)
    order = np.argsort(team[:, 1 - axis], kind="stable")
    for robot, block in zip(order, np.array_split(across, len(team)), strict=True):
        if abs(block[-1] - team[robot, 1 - axis]) < abs(block[0] - team[robot, 1 - axis]):
            block = block[::-1]
        first = int(abs(ends - team[robot, axis]).argmin())
        way = np.empty((len(block), 2, 2))  # lane, end, axis
        way[:, :, 1 - axis] = block[:, None]
        way[0::2, :, axis] = ends[[first, 1 - first]]
        way[1::2, :, axis] = ends[[1 - first, first]]
        ways[robot] = way.reshape(-1, 2)
    return ways
