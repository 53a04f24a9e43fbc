"""Least known: robots go where a map of gas knows least, so that it stays fresh everywhere.

Marjovi & Marques, ICRA 2014, propose to send robots by the overall weights of their map, Σ W U of eq 6, "to the regions
with less recent information"; how is our choice. The map is a `TimeSeriesMap` of the readings of the whole team, which
share them whatever the range of their messages. A robot that needs a way point takes, of the least known `share` of all
cells where robots can be, the nearest that is `apart` from itself and from the way points of its team mates. What it
smells plays no part.

DRIVE  to the way point by `potential`; there, or where others are in the way, the next one
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_plume import algorithms
from taichi_plume.agents.potential import NEAR, Potential
from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.agents.time_series import TimeSeriesMap

TIE = 1e-6  # of the largest weight: cells as little known as each other


@ti.data_oriented
class LeastKnown:
    """Map-driven ways of the robots of one group, each trial for itself. tick: control period [s]."""

    STATE_NAMES: tuple[str, ...] = ("DRIVE",)

    def __init__(self, swarm: Swarm, group: GroupRange, tick: float):
        model = group.model.algorithm
        assert isinstance(model, algorithms.LeastKnown)
        self.swarm, self.start, self.size = swarm, group.start, group.size
        self.count, self.trials = group.count, group.trials
        self.share, self.apart = model.share, model.apart
        self.potential = Potential(swarm, group, model.speed, model.avoidance)
        self.map = TimeSeriesMap(model.map, swarm.clearance.high, swarm.trials)
        axes = [(np.arange(n) + 0.5) * self.map.cell for n in self.map.shape]
        centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        self.free = swarm.clearance.distance_at(centers) >= self.potential.room
        self.places = centers[self.free]  # (cells, 2) [m]
        self.goal: Any = ti.Vector.field(2, ti.f32, self.size)  # way points [m]
        self.asks = ti.field(ti.i32, self.size)  # whether the robot needs another one
        self.goal.from_numpy(swarm.start[group.slice])

    def act(self, tick: int, t: float, dt: float) -> None:
        """Command the next dt [s]."""
        self.map.update(self.swarm, t, dt)
        self._ask()
        asks = self.asks.to_numpy().reshape(self.trials, self.count)
        if asks.any() and len(self.places):
            goal = self.goal.to_numpy().reshape(self.trials, self.count, 2)
            believed = self.swarm.believed_position.to_numpy()[self.start : self.start + self.size]
            weight = self.map.weight()[:, self.free]
            for k in np.flatnonzero(asks.any(axis=1)):
                self._choose(weight[k], believed.reshape(goal.shape)[k], goal[k], asks[k])
            self.goal.from_numpy(goal.reshape(-1, 2))
            self._begin()
        self._drive(dt)

    def _choose(self, weight: np.ndarray, place: np.ndarray, goal: np.ndarray, asks: np.ndarray) -> None:
        """Give the robots of a trial that ask another way point in `goal`; weight: of the cells they can get to."""
        least = np.quantile(weight, self.share)
        known = weight > least + TIE * weight.max()
        for robot in np.flatnonzero(asks):
            distance = np.linalg.norm(self.places - place[robot], axis=-1)
            mates = np.delete(goal, robot, axis=0)
            near = (np.linalg.norm(self.places[:, None] - mates, axis=-1) < self.apart).any(axis=1)
            near |= distance < self.apart
            rank = np.lexsort((distance, known, near))  # the last counts most
            goal[robot] = self.places[rank[0]]

    @ti.kernel
    def _ask(self):
        for n in range(self.size):
            self.asks[n] = self.potential.is_over(n, self.potential.clear(self.goal[n]), NEAR)

    @ti.kernel
    def _begin(self):
        for n in range(self.size):
            if self.asks[n]:
                self.potential.begin(n)

    @ti.kernel
    def _drive(self, dt: float):
        for n in range(self.size):
            self.potential.drive(n, self.potential.clear(self.goal[n]), dt)
