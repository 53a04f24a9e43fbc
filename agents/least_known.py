"""Where to measure next: robots go to the cells of their gas map where a measurement gains most (active sensing).

The map is made of the readings of the whole team, shared at any range of messages. Way points are cells that the robot
can reach, `apart` from itself, from the way points of its team mates, and from a way point that it has given up. The
criterion decides among them.

weight       Marjovi & Marques, ICRA 2014, propose to send robots by the overall weights of their map, Σ W U of eq 6,
             "to the regions with less recent information"; the details are ours. Candidates are the least known `share`
             of all cells; the robot takes the nearest. Readings are not used.

The others take the cell c with the largest gain over its cost, G_c / (L_c + way_scale), L_c: length of the shortest way
around obstacles (Dijkstra). Unknown cells have an infinite gain. With mean m, covariance Σ and noise σ² of a reading:

variance     G_c = Σ_cc
upper_bound  G_c = m_c + κ √Σ_cc, at least 0: Srinivas, Krause, Kakade & Seeger, IEEE Trans. Inf. Theory 58 (2012)
             3250-3265, doi:10.1109/TIT.2011.2182033
information  G_c = Σ_j Σ_jc² / (Σ_cc + σ²): reduction of the map's summed variance by a reading in c. Cohn, Ghahramani &
             Jordan, J. Artif. Intell. Res. 4 (1996) 129-145, doi:10.1613/jair.295. For at most CANDIDATES cells, those
             with the largest Σ_cc over the cost within each of as many parts of the list of cells.

Gongora et al., Sensors 23 (2023) 5387, doi:10.3390/s23125387, plan gas mapping on a Markov random field by information
over several steps; ours looks one way point ahead. Dividing by the way is ours.

DRIVE  to the way point by `potential`; then, or if others are in the way, to the next one
"""

from typing import Any

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.decisions import Decision, way_point
from taichi_plume.agents.gas_map import Floor, GasMap
from taichi_plume.agents.mapping import KINDS
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.potential import NEAR, Potential
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.swarm import GroupRange
from taichi_plume.engine import ti
from taichi_plume.grid.grid import centers
from taichi_plume.scenario import algorithms

CANDIDATES = 64  # cells whose information is computed
TIE = 1e-6  # fraction of the largest weight: cells that count as equally known


class LeastKnown(KernelAlgorithm):
    """Search algorithm that drives a group to where its map gains most. tick: control period [s]."""

    PER_GROUP: bool = True  # has a single map
    STATE: tuple[str, ...] = ("potential", "map", "goal")
    STATE_NAMES: tuple[str, ...] = ("DRIVE",)
    DECISIONS: tuple[Decision, ...] = way_point("goal")

    def _allocate(self) -> None:
        swarm, group = self.swarm, self.members.groups[0]
        self.count, self.trials, self.row = group.count, group.trials, group.row
        self.potential = Potential(self.members, self.p)
        floor = Floor(swarm.clearance.high, swarm.trials, swarm.members.shape[1], self.tick)
        self.map: GasMap = KINDS[self.model.map.kind](self.model.map, floor)
        self.asks = ti.field(ti.i32, self.size)  # whether the robot needs another way point
        # the first way points [m] are the start positions, so that all robots ask for new ones
        start = swarm.start[group.slice]
        self.goal = ti.filled_vectors(start)
        self.share, self.apart = self.model.share, self.model.apart
        self.room = group.model.body.radius + self.model.avoidance
        place = centers(self.map.shape, self.map.cell)
        self.free = swarm.clearance.distance_at(place) >= self.room
        self.places = place[self.free]  # (cells, 2) [m]
        region = self._floor()
        self.region = region[self._node(self.places)]
        self.home = region[self._node(start)].reshape(self.trials, self.count)
        self.graph = None if self.model.criterion == "weight" else _ways(self.passable, self.step)

    def numbers(self, group: GroupRange, model: algorithms.LeastKnown) -> Numbers:
        return Potential.numbers(self.swarm, group, model.speed, model.avoidance)

    def act(self, tick: int, t: float, dt: float) -> None:
        self.map.update(self.swarm, t, dt)
        self._ask()
        asks = self.asks.values.reshape(self.trials, self.count)
        if asks.any() and len(self.places):
            goal = self.goal.to_numpy().reshape(self.trials, self.count, 2)
            believed = self.swarm.believed_position.values
            place = believed[self.members.groups[0].slice].reshape(goal.shape)
            rows = slice(self.row, self.row + self.trials)
            if self.graph is None:
                weight = self.map.weight()[rows, self.free]
                for k in np.flatnonzero(asks.any(axis=1)):
                    self._choose(weight[k], place[k], goal[k], asks[k], self.home[k])
            else:
                gain = self._gain(rows)
                for k, robot in np.argwhere(asks).tolist():
                    self._choose_gain(k, robot, gain[k], place[k, robot], goal[k])
            self._set_out(goal.reshape(-1, 2))
        self._drive(dt)

    def _floor(self) -> np.ndarray:
        """Cover the floor with nodes, closer than any wall that robots cannot pass; return their region indices (n,),
        equal for nodes between which robots can drive.
        """
        clearance, self.step = self.swarm.clearance, self.room / 2
        nodes = [np.arange(a, b, self.step) for a, b in zip(clearance.low, clearance.high, strict=True)]
        free = clearance.distance_at(np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1))
        self.passable = free >= self.room
        labelled: Any = ndimage.label(self.passable)
        region = labelled[0]
        nearest: Any = ndimage.distance_transform_edt(
            region == 0, return_distances=False, return_indices=True
        )
        self.nearest = np.ravel_multi_index(tuple(nearest), region.shape)
        return region.ravel()

    def _node(self, points: np.ndarray) -> np.ndarray:
        """Return the index (n,) of the passable node nearest to each point (n, 2) [m]."""
        at = np.rint((points - np.array(self.swarm.clearance.low)) / self.step).astype(int)
        at = np.clip(at, 0, np.array(self.nearest.shape) - 1)
        return self.nearest[at[:, 0], at[:, 1]]

    def _gain(self, rows: slice) -> np.ndarray:
        """Return the gain of a measurement in each free cell by the map of each trial, (trials, cells); inf in unknown
        cells. For `information` that of the variance, which chooses the candidates.
        """
        uncertain: Any = self.map
        variance = uncertain.variance()[rows, self.free]
        gain = variance
        if self.model.criterion == "upper_bound":
            mean = self.map.estimate()[rows, self.free]
            gain = np.maximum(mean + self.model.kappa * np.sqrt(variance), 0.0)
        return np.where(np.isfinite(variance), gain, np.inf)

    def _choose_gain(
        self, trial: int, robot: int, gain: np.ndarray, place: np.ndarray, goal: np.ndarray
    ) -> None:
        """Write a robot's way point to `goal` (count, 2) [m]: the cell with the largest gain (cells,) over the cost."""
        there = np.flatnonzero(self.region == self.home[trial, robot])
        if not len(there):
            return
        start = self._node(place[None])[0]
        length = dijkstra(self.graph, indices=start)[self._node(self.places[there])]
        cost = np.where(np.isfinite(length), length, np.linalg.norm(self.places[there] - place, axis=-1))
        near, gain = self._near(robot, there, place, goal), gain[there]
        if self.model.criterion == "information" and np.isfinite(gain).all():
            parts = np.array_split(
                np.flatnonzero(~near) if (~near).any() else np.arange(len(there)), CANDIDATES
            )
            rate = gain / (cost + self.model.way_scale)
            best = np.array([part[rate[part].argmax()] for part in parts if len(part)])
            there, cost, near = there[best], cost[best], near[best]
            gain = self._information(self.row + trial, np.flatnonzero(self.free)[there])
        rank = np.lexsort((cost, -gain / (cost + self.model.way_scale), near))
        goal[robot] = self.places[there[rank[0]]]

    def _information(self, trial: int, cells: np.ndarray) -> np.ndarray:
        """Return the reduction of the map's summed variance [ppm²] by a reading in each of some cells (k,)."""
        field: Any = self.map
        columns = field.covariance(trial, cells)
        return (columns**2).sum(axis=0) / (columns[cells, np.arange(len(cells))] + field.noise)

    def _near(self, robot: Any, there: np.ndarray, place: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Return which of the cells `there` are too near to a robot at `place` [m] and to the way points to avoid."""
        given_up = np.linalg.norm(goal[robot] - place) > NEAR
        avoided = goal if given_up else np.delete(goal, robot, axis=0)
        near = (np.linalg.norm(self.places[there, None] - avoided, axis=-1) < self.apart).any(axis=1)
        return near | (np.linalg.norm(self.places[there] - place, axis=-1) < self.apart)

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
            near = self._near(robot, there, place[robot], goal)
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


def _ways(passable: np.ndarray, step: float) -> csr_array:
    """Return the lengths [m] between passable nodes, `step` [m] apart, and their eight neighbours, a sparse matrix."""
    node = np.arange(passable.size).reshape(passable.shape)
    ends, lengths = [], []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        a = (slice(None, -dx or None), slice(max(0, -dy), -dy if dy > 0 else None))
        b = (slice(dx, None), slice(max(0, dy), dy if dy < 0 else None))
        both = passable[a] & passable[b]
        ends.append(np.stack([node[a][both], node[b][both]]))
        lengths.append(np.full(ends[-1].shape[1], step * np.hypot(dx, dy)))
    i, j = np.concatenate(ends, axis=1)
    length, size = np.concatenate(lengths), passable.size
    return csr_array(coo_array((np.tile(length, 2), (np.append(i, j), np.append(j, i))), shape=(size, size)))
