"""Gas tomography: the Markov random field of `gmrf` from open-path lasers, whose readings are integrals along beams.

The map minimises the energy of `gmrf`, with the observation of a beam b instead of that of a cell:

    Σ_links λ_p (m_i - m_j)²  +  Σ_readings λ_o(s) (Σ_c l_bc m_c - z_b)²

l_bc is the length [m] of beam b in cell c, z_b the integral of the gas along it [ppm m]; a reading at a point has
l_bc = 1 in its cell. Hence H = λ_p L + Σ λ_o l_b l_bᵀ with the Laplacian L of the links, and g = Σ λ_o l_b z_b. H is
dense and is inverted by Cholesky's method; mean and variance are exact.

Integrals along beams of a robot's laser as sums over the cells: Arain, Hernandez Bennetts, Schaffernicht & Lilienthal,
"Sniffing out fugitive methane emissions", Int. J. Robotics Research 2021, doi:10.1177/0278364920954907. Smoothing
by links that obstacles cut, and the variance, are those of `gmrf`; the combination is ours.

Beams start at the believed pose of the robot and have the measured length. On a map of the floor the gas counts as
equal at all heights: a tilted beam has its whole length in the cells below it. On a map with layers a beam that leaves
the layers does not count.
"""

from typing import Any, Protocol

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import csr_array

from taichi_plume.agents.gas_map import Floor, Readers
from taichi_plume.agents.gmrf import MarkovMap, laplacian
from taichi_plume.engine.fields import Field

SHORTEST = 1e-3  # m, least length of a beam that counts


class Lasers(Protocol):
    """Protocol of the open-path lasers of some robots, see `LineSensors`; index n is that of the laser."""

    members: Any
    gives_mean: np.ndarray
    beam_start: Field  # m
    beam_way: Field  # m
    beam_is_new: Field


class BeamMap(MarkovMap):
    """Gas map with mean [ppm] and variance [ppm²] in each cell from lasers and other gas sensors.

    running: readings of the running window, by time step: trial, start and way of the beam [m], factor of its lengths,
    reading. past: end [s] of a window and of its lengths rows, flat cells, values; then the readings. settled: sums
    l lᵀ, l z and l of all readings without `memory`.
    """

    STATE = ("errors", "running", "ended", "past", "settled", "_solved")

    def __init__(self, model: Any, floor: Floor):
        super().__init__(model, floor)
        assert floor.lasers is not None
        self.lasers: Lasers = floor.lasers
        self.robot = self.lasers.members.robot.to_numpy()
        self.running: list[list[np.ndarray]] = []
        self.settled: list[np.ndarray] = []
        self.low, self.high, self.edges = np.zeros(2), np.array(floor.extent), np.full(2, model.cell)
        if self.levels:
            low, layer, _ = self.levels
            self.low, self.high = np.append(self.low, low), np.append(self.high, self.levels.high)
            self.edges = np.append(self.edges, layer)
            self.heights = np.asarray(floor.sensor_height, float)

    def _collect(self, swarm: Readers) -> None:
        members, size = swarm.members.to_numpy(), swarm.team_size.to_numpy()
        trial, number = np.nonzero(np.arange(members.shape[1]) < size[:, None])
        robot = members[trial, number]
        start, reading = (
            swarm.believed_position.to_numpy().astype(float),
            swarm.reading.to_numpy().astype(float),
        )
        if self.levels:
            altitude = swarm.altitude.to_numpy() if swarm.flies else 0.0
            start = np.column_stack([start, self.heights + altitude])
        dim = len(self.low)
        way, factor = np.zeros_like(start), np.ones(len(start))
        beam = self.lasers.beam_way.to_numpy().astype(float)
        length = np.linalg.norm(beam, axis=-1)
        start[self.robot] = self.lasers.beam_start.to_numpy()[:, :dim]
        way[self.robot], factor[self.robot] = beam[:, :dim], length
        reading[self.robot] *= np.where(self.lasers.gives_mean, length, 1.0)
        counted = np.isfinite(reading) & ((start >= self.low) & (start <= self.high)).all(axis=-1)
        if self.levels:  # the integral has the gas beyond the layers too
            end = start[:, 2] + way[:, 2]
            counted &= (end > self.low[2] - SHORTEST) & (end < self.high[2] + SHORTEST)
        counted[self.robot] &= (self.lasers.beam_is_new.to_numpy() == 1) & (length > SHORTEST)
        trial, robot = trial[counted[robot]], robot[counted[robot]]
        if len(robot):
            self.running.append([trial, start[robot], way[robot], factor[robot], reading[robot]])

    def _end_windows(self, number: int) -> None:
        if number <= self.ended:
            return
        time = (self.ended + 1) * self.model.window
        self.ended = number
        self._solved = None
        if self.running:
            trial, start, way, factor, reading = map(np.concatenate, zip(*self.running, strict=True))
            row, cell, share = cell_shares(start - self.low, way, self.counted_in.shape, self.edges)
            cell = self.counted_in.ravel()[cell] + trial[row] * self.counted_in.size
            self.past.append([time, row, cell, share * factor[row], reading])
            self.running = []
        if self.model.memory is None and self.past:
            sums = [self._sums(trial) for trial in range(self.trials)]
            self.settled, self.past = [np.stack(values) for values in zip(*sums, strict=True)], []
        elif self.model.memory is not None:
            self.past = [window for window in self.past if self._share(window[0]) > 0.0]

    def _sums(self, trial: int) -> list[np.ndarray]:
        """Return sums over the readings of a trial, weighted by age: l lᵀ (n, n), l z and l (n,), of n cells."""
        n = self.counted_in.size
        parts = [(np.empty(0, int), np.empty(0, int), np.empty(0), np.empty(0))]
        first = 0
        for time, row, cell, value, reading in self.past:
            own = cell // n == trial
            root = np.sqrt(self._share(time))
            parts.append((first + row[own], cell[own] % n, root * value[own], root * reading))
            first += len(reading)
        row, cell, value, reading = map(np.concatenate, zip(*parts, strict=True))
        beams = csr_array((value, (row, cell)), shape=(first, n))
        sums = [(beams.T @ beams).toarray(), beams.T @ reading, beams.sum(axis=0)]
        if self.settled:
            sums = [new + settled[trial] for new, settled in zip(sums, self.settled, strict=True)]
        return sums

    def _solve(self) -> list[np.ndarray]:
        lambda_observation = self.model.lambda_observation
        smooth = laplacian(self.links, self.prior).toarray()
        mean, variance = np.full((2, self.trials, *self.region.shape), np.nan)
        for k in range(self.trials):
            gram, moment, length = self._sums(k)
            known = np.isin(self.region, self.region[length.reshape(self.region.shape) > 0])
            H = lambda_observation * gram + smooth + np.diag(~known.ravel())
            inverse, _ = dpotri(dpotrf(H, lower=True, overwrite_a=True)[0], lower=True, overwrite_c=True)
            inverse += np.tril(inverse, -1).T
            mean[k][known] = (inverse @ (lambda_observation * moment)).reshape(known.shape)[known]
            variance[k][known] = np.diag(inverse).reshape(known.shape)[known]
        return [mean, variance]


def cell_shares(
    start: np.ndarray, way: np.ndarray, shape: tuple[int, ...], edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which part of each beam lies in which cell: numbers of beams, flat cells, and fractions, (m,) each.

    start, way: starts of the beams and vectors to their ends (n, dim) [m]; edges: of the cells, by axis (dim,) [m].
    """
    crossings = [np.zeros((len(start), 1)), np.ones((len(start), 1))]
    for axis, count in enumerate(shape):
        plane = np.arange(1, count) * edges[axis]
        along = np.where(way[:, axis] == 0.0, np.inf, way[:, axis])[:, None]
        crossings.append(np.clip((plane - start[:, axis, None]) / along, 0.0, 1.0))
    s = np.sort(np.concatenate(crossings, axis=1), axis=1)
    share = np.diff(s, axis=1)
    beam, part = np.nonzero(share > 1e-9)
    middle = 0.5 * (s[beam, part] + s[beam, part + 1])
    at = np.floor((start[beam] + middle[:, None] * way[beam]) / edges).astype(int)
    at = np.clip(at, 0, np.array(shape) - 1)
    flat = np.asarray(np.ravel_multi_index(tuple(at.T), shape))
    return beam, flat, share[beam, part]
