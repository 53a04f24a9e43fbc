"""A search algorithm of the user's own, in NumPy: a class in a Python file that a scenario names.

    class Upwind:
        def act(self, robots):
            robots.turn_to(np.arctan2(-robots.wind[:, 1], -robots.wind[:, 0]))
            robots.speed[:] = 0.1

It is made once per group, with the scenario's `parameters` as keywords, and called each tick with all robots of all
trials of the group; what it keeps from tick to tick are its own attributes.
"""

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.files.own_class import OwnAlgorithmError, told


class Robots:
    """What an algorithm may know of its robots, and what it tells them, as arrays over the n robots.

    Read: `reading` [ppm]; `wind` (n, 2) [m/s], zero where it is not `wind_known`; `position` (n, 2) [m], `heading`
    [rad] and `path_length` [m], with errors where the group has `odometry`; `blocked`, the bumper; `trial` and
    `robot`, numbers of each; `t`, `dt` [s].
    Write: `speed` [m/s]; `turn_rate` [rad/s]; `state`, whole numbers that index the algorithm's STATE_NAMES.
    """

    def __init__(self, trial: np.ndarray, robot: np.ndarray):
        n = len(trial)
        self.trial, self.robot = trial, robot
        self.t, self.dt = 0.0, 0.0
        self.reading, self.heading, self.path_length = np.zeros((3, n), np.float32)
        self.wind, self.position = np.zeros((2, n, 2), np.float32)
        self.wind_known, self.blocked = np.zeros((2, n), bool)
        self.speed, self.turn_rate = np.zeros((2, n))
        self.state = np.zeros(n, int)

    def turn_to(self, course: Any) -> None:
        """Command the turn rate that brings each heading to `course` [rad] in a tick, or as soon as the body can."""
        off = np.asarray(course) - self.heading
        self.turn_rate = (off - 2 * np.pi * np.round(off / (2 * np.pi))) / self.dt


@ti.data_oriented
class OwnAlgorithm:
    """Runs a class of the user's, `own`, for one group. Raises OwnAlgorithmError where it fails."""

    def __init__(self, swarm: Swarm, group: GroupRange, own: type, parameters: Mapping[str, Any]):
        self.swarm, self.start, self.size = swarm, group.start, group.size
        self.path = Path(inspect.getsourcefile(own) or "?")
        number = np.arange(group.size)
        self.robots = Robots(group.model.first_trial + number // group.count, number % group.count)
        try:
            self.algorithm = own(**parameters)
        except Exception as error:
            raise OwnAlgorithmError(told(error, self.path)) from error
        self.STATE_NAMES = tuple(getattr(self.algorithm, "STATE_NAMES", ("SEARCH",)))

    def act(self, tick: int, t: float, dt: float) -> None:
        """Show the robots to the user's algorithm and carry out what it wants."""
        known = np.empty((self.size, 9), np.float32)
        self._show(known)
        robots = self.robots
        robots.t, robots.dt = t, dt
        robots.reading, robots.heading, robots.path_length = known[:, 0], known[:, 1], known[:, 2]
        robots.wind, robots.position = known[:, 3:5], known[:, 5:7]
        robots.wind_known, robots.blocked = known[:, 7] > 0, known[:, 8] > 0
        try:
            self.algorithm.act(robots)
        except Exception as error:
            raise OwnAlgorithmError(told(error, self.path)) from error
        commands = np.empty((self.size, 3), np.float32)
        for n, name in enumerate(("speed", "turn_rate", "state")):
            commands[:, n] = self._checked(name)
        self._command(commands)

    def _checked(self, name: str) -> np.ndarray:
        """What the algorithm wrote, if it is a finite number for every robot."""
        where = f"{self.path}, act of {type(self.algorithm).__name__}: robots.{name}"
        try:
            values = np.broadcast_to(np.asarray(getattr(self.robots, name), float), self.size)
        except (TypeError, ValueError):
            shape = np.shape(getattr(self.robots, name))
            raise OwnAlgorithmError(f"{where} has the shape {shape}, not ({self.size},)") from None
        if not np.isfinite(values).all():
            n = int(np.flatnonzero(~np.isfinite(values))[0])
            raise OwnAlgorithmError(f"{where}[{n}] is {values[n]}, not a finite number")
        if name == "state" and not np.isin(values, np.arange(len(self.STATE_NAMES))).all():
            raise OwnAlgorithmError(f"{where} must be whole numbers from 0 to {len(self.STATE_NAMES) - 1}")
        return values

    @ti.kernel
    def _show(self, known: ti.types.ndarray()):
        for n in range(self.size):
            i = self.start + n
            known[n, 0] = self.swarm.reading[i]
            known[n, 1] = self.swarm.believed_heading[i]
            known[n, 2] = self.swarm.odometer[i]
            for d in ti.static(range(2)):
                known[n, 3 + d] = self.swarm.wind[i][d]
                known[n, 5 + d] = self.swarm.believed_position[i][d]
            known[n, 7] = self.swarm.wind_known[i]
            known[n, 8] = self.swarm.blocked[i]

    @ti.kernel
    def _command(self, commands: ti.types.ndarray()):
        for n in range(self.size):
            i = self.start + n
            self.swarm.speed_command[i] = commands[n, 0]
            self.swarm.turn_rate_command[i] = commands[n, 1]
            self.swarm.state[i] = ti.cast(commands[n, 2], ti.i32)
