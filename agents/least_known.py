"""Map-driven paths: robots go to the least known parts of the floor, so that a gas map stays fresh everywhere.

Marjovi & Marques, ICRA 2014, propose to send robots by the overall weights of their map, Σ W U of eq 6, "to the regions
with less recent information"; the details are our choice. The map is a `TimeSeriesMap` of the readings of the whole
team, shared at any range of messages. Candidates for a way point are the least known `share` of all cells that the
robot can reach. The robot takes the nearest candidate that is `apart` from itself, from the way points of its team
mates, and from a way point that it has given up. Readings are not used.

DRIVE  to the way point by `potential`; then, or if others are in the way, to the next one
"""

from typing import Any

import numpy as np
from scipy import ndimage

from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.decisions import Decision, way_point
from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.potential import NEAR, Potential
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.swarm import GroupRange
from taichi_plume.agents.time_series import TimeSeriesMap
from taichi_plume.engine import ti
from taichi_plume.grid.grid import centers
from taichi_plume.scenario import algorithms

TIE = 1e-6  # fraction of the largest weight: cells that count as equally known


class LeastKnown(KernelAlgorithm):
    """Search algorithm that drives a group to the least known parts of its map. tick: control period [s]."""

    PER_GROUP: bool = True  # has a single map
    STATE: tuple[str, ...] = ("potential", "map", "goal")
    STATE_NAMES: tuple[str, ...] = ("DRIVE",)
    DECISIONS: tuple[Decision, ...] = way_point("goal")

    def _allocate(self) -> None:
        swarm, group = self.swarm, self.members.groups[0]
        self.count, self.trials, self.row = group.count, group.trials, group.row
        self.potential = Potential(self.members, self.p)
        floor = Floor(swarm.clearance.high, swarm.trials, swarm.members.shape[1], self.tick)
        self.map = TimeSeriesMap(self.model.map, floor)
        self.asks = ti.field(ti.i32, self.size)  # whether the robot needs another way point
        # the first way points [m] are the start positions, so that all robots ask for new ones
        start = swarm.start[group.slice]
        self.goal = ti.filled_vectors(start)
        self.share, self.apart = self.model.share, self.model.apart
        self.room = group.model.body.radius + self.model.avoidance
        place = centers(self.map.shape, self.map.cell)
        self.free = swarm.clearance.distance_at(place) >= self.room
        self.places = place[self.free]  # (cells, 2) [m]
        self.region = self._regions(self.places)
        self.home = self._regions(start).reshape(self.trials, self.count)

    def numbers(self, group: GroupRange, model: algorithms.LeastKnown) -> Numbers:
        return Potential.numbers(self.swarm, group, model.speed, model.avoidance)

    def act(self, tick: int, t: float, dt: float) -> None:
        self.map.update(self.swarm, t, dt)
        self._ask()
        asks = self.asks.values.reshape(self.trials, self.count)
        goal = self.goal.to_numpy().reshape(self.trials, self.count, 2)
        if asks.any() and len(self.places):
            believed = self.swarm.believed_position.values
            place = believed[self.members.groups[0].slice].reshape(goal.shape)
            weight = self.map.weight()[self.row : self.row + self.trials, self.free]
            for k in np.flatnonzero(asks.any(axis=1)):
                self._choose(weight[k], place[k], goal[k], asks[k], self.home[k])
            self._set_out(goal.reshape(-1, 2))
        self._drive(dt)

    def _regions(self, points: np.ndarray) -> np.ndarray:
        """Return region indices (n,) of points (n, 2) [m], equal for points between which robots can drive."""
        clearance, step = self.swarm.clearance, self.room / 2
        nodes = [np.arange(a, b, step) for a, b in zip(clearance.low, clearance.high, strict=True)]
        free = clearance.distance_at(np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1))
        labelled: Any = ndimage.label(free >= self.room)
        region = labelled[0]
        nearest: Any = ndimage.distance_transform_edt(
            region == 0, return_distances=False, return_indices=True
        )
        at = np.rint((points - np.array(clearance.low)) / step).astype(int)
        at = np.clip(at, 0, np.array(region.shape) - 1)
        return region[tuple(nearest)][at[:, 0], at[:, 1]]

    def _choose(
        self, weight: np.ndarray, place: np.ndarray, goal: np.ndarray, asks: np.ndarray, region: np.ndarray
    ) -> None:
        """Write new way points to `goal` (count, 2) [m] for those robots of a trial that ask for one.

        weight: map weight of each free cell (cells,). place: believed positions of the robots (count, 2) [m]. asks:
        whether each robot needs a way point (count,). region: region that each robot can reach (count,).
        """
        for robot in np.flatnonzero(asks):
            there = np.flatnonzero(self.region == region[robot])
            if not len(there):
                continue
            least = np.quantile(weight[there], self.share)
            known = weight[there] > least + TIE * weight.max()
            distance = np.linalg.norm(self.places[there] - place[robot], axis=-1)
            given_up = np.linalg.norm(goal[robot] - place[robot]) > NEAR
            avoided = goal if given_up else np.delete(goal, robot, axis=0)
            near = (np.linalg.norm(self.places[there, None] - avoided, axis=-1) < self.apart).any(axis=1)
            near |= distance < self.apart
            rank = np.lexsort((distance, known, near))  # the last key is the primary key
            goal[robot] = self.places[there[rank[0]]]

    @ti.kernel
    def _ask(self):
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            self.asks[n] = self.potential.is_over(n, self.potential.clear(n, self.goal[n]), NEAR)

    @ti.kernel
    def _set_out(self, goal: ti.types.ndarray()):
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            self.goal[n] = ti.Vector([goal[n, 0], goal[n, 1]])
            if self.asks[n]:
                self.potential.set_out(n)

    @ti.kernel
    def _drive(self, dt: float):
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            self.potential.drive(n, self.potential.clear(n, self.goal[n]), dt)
