"""Gas map as a Gaussian Markov random field whose links obstacles cut.

Monroy, Blanco & Gonzalez-Jimenez, Autonomous Robots 2016. The map minimises

    Σ_links λ_p (m_i - m_j)²  +  Σ_readings λ_o(s) (m_k - z)²,      λ_o(s) = λ_o max(0, 1 - s / memory)

    Links join cells that share an edge, unless an obstacle stands between their centres; k is the cell in which a
    reading z of age s was taken. Hence H m = g, with H_ii = λ_p links_i + Σ λ_o, H_ij = -λ_p, g_i = Σ λ_o z, and the
    variance is the diagonal of H⁻¹. Cells that no chain of links joins to a reading are unknown.

Column by column, H is block tridiagonal, with diagonal matrices between blocks. Forward elimination, which stores the
inverses P of the blocks, gives the mean; backward substitution gives the diagonal blocks of the inverse: G_i = P_i +
(λ_p P_i R_i) G_i+1 (λ_p R_i P_i), where R_i holds the links from column i to the next. The solution is exact, for all
trials at once. The cost is constant in time: readings are summed by cell and window, and dropped once their weight is
zero.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from taichi_plume.agents.gas_map import Floor, GasMap, Readers, cell_of, counts, window_of, windows
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.grid.grid import centers
from taichi_plume.grid.kernels import Template

LOOKS = 16  # parts of the line between two centres; the ends of the parts are checked for obstacles

Links = tuple[np.ndarray, np.ndarray]
"""Whether neighbour cells are joined, along x (nx - 1, ny) and y (nx, ny - 1)."""
Window = list[Any]
"""End [s] of a time window, and of the cells with readings: flat indices, then the sums of `MarkovField`."""


class MarkovField(GasMap):
    """Base class of maps by Gaussian Markov random fields, solved on request.

    Stores the sums of the readings by cell and time window: their number, then SUMS - 1 sums of values. `_collect` adds
    the present readings; `_solve` returns the arrays that follow from the sums, among them mean and variance.
    """

    STATE = ("errors", "sums", "ended", "past", "_solved")
    SUMS: ClassVar[int] = 2

    def __init__(self, model: Any, floor: Floor):
        super().__init__(model.cell, floor)
        self.sums = tuple(ti.field(ti.f32, (floor.trials, *self.shape)) for _ in range(self.SUMS))
        free = floor.obstacle_distance(centers(self.shape, model.cell)) > 0
        # a reading in a cell whose centre lies in an obstacle counts for the nearest free cell
        self.counted_in = np.arange(free.size).reshape(self.shape)
        if free.any():
            nearest: Any = distance_transform_edt(~free, return_distances=False, return_indices=True)
            self.counted_in = np.ravel_multi_index(tuple(nearest), self.shape)
        self.links = links(self.shape, model.cell, floor.obstacle_distance)
        self.region = regions(self.links)
        self.model = model
        self.noise = 1.0 / model.lambda_observation  # variance of a reading [square of its unit]
        self.ended = 0  # number of ended windows
        self.past: list[Window] = []
        self._solved: list[np.ndarray] | None = None

    def update(self, swarm: Readers, t: float, dt: float) -> None:
        """Add the robots' readings at time t [s]; a time window ends when t reaches a multiple of its length."""
        before, now = windows(t, self.model.window, dt)
        self._end_windows(before)  # no readings since the windows ended
        self._collect(swarm)
        self._end_windows(now)

    def _collect(self, swarm: Readers) -> None:
        raise NotImplementedError

    def _solve(self) -> list[np.ndarray]:
        raise NotImplementedError

    def solution(self) -> list[np.ndarray]:
        """Return the solution of `_solve` at the end of the last window."""
        if self._solved is None:
            self._solved = self._solve()
        return self._solved

    def estimate(self) -> np.ndarray:
        """Return the mean of the map at the end of the last window, (trials, nx, ny, ...); NaN in unknown cells."""
        return self.solution()[0]

    def variance(self) -> np.ndarray:
        """Return the variance of the mean, (trials, nx, ny, ...); NaN in unknown cells."""
        return self.solution()[1]

    def remembered(self, t: np.ndarray, place: np.ndarray, dt: float) -> np.ndarray:
        return np.minimum(self._share((window_of(t, self.model.window, dt) + 1.0) * self.model.window), 1.0)

    def _end_windows(self, number: int) -> None:
        """Close time windows until `number` have ended: store the readings of the running one, and drop faded ones."""
        if number <= self.ended:
            return
        time = (self.ended + 1) * self.model.window
        self.ended = number
        self._solved = None
        sums = [self._moved(field.values) for field in self.sums]
        cells = np.flatnonzero(sums[0])
        if len(cells):
            self.past.append([time, cells, *(values[cells] for values in sums)])
            for field in self.sums:
                field.fill(0.0)
        if self.model.memory is None:
            self._merge()
        else:
            self.past = [window for window in self.past if self._share(window[0]) > 0.0]

    def _moved(self, values: np.ndarray) -> np.ndarray:
        """Return flat cell sums of `values` (trials, nx, ny), blocked cells added to the nearest free cells."""
        trials, cells = len(values), self.counted_in.size
        into = np.arange(trials)[:, None] * cells + self.counted_in.ravel()
        return np.bincount(into.ravel(), values.ravel(), minlength=trials * cells)

    def _merge(self) -> None:
        """Merge the readings of all past windows into one window, as readings without `memory` do not fade."""
        if len(self.past) > 1:
            sums = self._information()
            cells = np.flatnonzero(sums[0])
            self.past = [[self.past[-1][0], cells, *(values.ravel()[cells] for values in sums)]]

    def _share(self, time: float | np.ndarray) -> np.ndarray:
        """Return the remaining weight, from 1 to 0, of readings whose window ended at `time` [s]."""
        if self.model.memory is None:
            return np.ones_like(time)
        return np.maximum(1.0 - (self.ended * self.model.window - time) / self.model.memory, 0.0)

    def _information(self) -> list[np.ndarray]:
        """Return number and sums of the readings in each cell, weighted by age, (trials, nx, ny) each."""
        sums = [np.zeros(field.shape) for field in self.sums]
        for time, cells, *values in self.past:
            share = self._share(time)
            for total, value in zip(sums, values, strict=True):
                total.ravel()[cells] += share * value
        return sums

    def _known(self, count: np.ndarray) -> np.ndarray:
        """Return the mask (trials, nx, ny) of cells that a chain of links joins to a reading; count: their number."""
        number = np.arange(len(count))[:, None, None] * (self.region.max() + 1) + self.region
        return (np.bincount(number.ravel(), count.ravel()) > 0)[number]


class MarkovMap(MarkovField):
    """Gas map with mean [ppm] and variance [ppm²] in each cell by a Gaussian Markov random field."""

    def weight(self) -> np.ndarray:
        """Return the confidence of the map, 1 / variance [1/ppm²], (trials, nx, ny); 0 in unknown cells."""
        return np.nan_to_num(1.0 / self.variance(), nan=0.0)

    def covariance(self, trial: int, cells: np.ndarray) -> np.ndarray:
        """Return columns of the covariance H⁻¹ [ppm²] of a trial's map, (nx ny, k), for k known cells (indices)."""
        count = self._information()[0]
        known = self._known(count)[trial]
        precision = self.model.lambda_observation * count[trial] + ~known
        H = diags_array(precision.ravel()) + laplacian(self.links, self.model.lambda_prior)
        units = np.zeros((known.size, len(cells)))
        units[cells, np.arange(len(cells))] = 1.0
        return splu(H.tocsc()).solve(units) * known.ravel()[:, None]

    def _collect(self, swarm: Readers) -> None:
        _collect(swarm.members, swarm.team_size, swarm.believed_position, swarm.reading, self.extent, self.cell,
                 self.shape, *self.sums)  # fmt: skip

    def _solve(self) -> list[np.ndarray]:
        count, total = self._information()
        known = self._known(count)
        precision = self.model.lambda_observation * count + ~known  # otherwise H would be singular
        mean, variance = _solve(
            precision, self.model.lambda_observation * total, self.links, self.model.lambda_prior
        )
        return [np.where(known, mean, np.nan), np.where(known, variance, np.nan)]


def links(
    cells: tuple[int, int], cell: float, obstacle_distance: Callable[[np.ndarray], np.ndarray]
) -> Links:
    """Return whether the line between neighbour cells is free of obstacles, along x (nx - 1, ny) and y (nx, ny - 1)."""
    place = centers(cells, cell)
    share = np.linspace(0.0, 1.0, LOOKS + 1)[:, None, None, None]
    along_x = (1 - share) * place[:-1] + share * place[1:]
    along_y = (1 - share) * place[:, :-1] + share * place[:, 1:]
    return obstacle_distance(along_x).min(axis=0) > 0, obstacle_distance(along_y).min(axis=0) > 0


def regions(joined: Links) -> np.ndarray:
    """Return a region number for each cell, (nx, ny), equal for cells that a chain of links joins."""
    nx, ny = joined[1].shape[0], joined[0].shape[1]
    return connected_components(_linked(joined), directed=False)[1].reshape(nx, ny)


def laplacian(joined: Links, weight: float) -> coo_array:
    """Return the sparse matrix (nx ny, nx ny) of the energy of links with this weight each."""
    ends = _linked(joined)
    both = weight * (ends + ends.T)
    return (diags_array(both.sum(axis=0)) - both).tocoo()


def _linked(joined: Links) -> coo_array:
    """Return a sparse matrix (nx ny, nx ny) with a one for each link, from the lower to the upper cell."""
    nx, ny = joined[1].shape[0], joined[0].shape[1]
    cell = np.arange(nx * ny).reshape(nx, ny)
    ends = (
        np.concatenate([cell[:-1][joined[0]], cell[:, :-1][joined[1]]]),
        np.concatenate([cell[1:][joined[0]], cell[:, 1:][joined[1]]]),
    )
    return coo_array((np.ones(len(ends[0])), ends), shape=(nx * ny, nx * ny))


def _solve(
    precision: np.ndarray, g: np.ndarray, links: Links, lambda_prior: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return H⁻¹ g and the diagonal of H⁻¹, (trials, nx, ny) each. H: matrix of the links, each with weight
    `lambda_prior`, plus `precision` on the diagonal.
    """
    trials, nx, ny = precision.shape
    if ny > nx:  # the blocks are as large as a column
        flipped = (links[1].T, links[0].T)
        x, v = _solve(precision.swapaxes(1, 2), g.swapaxes(1, 2), flipped, lambda_prior)
        return x.swapaxes(1, 2), v.swapaxes(1, 2)
    across, within = lambda_prior * links[0], lambda_prior * links[1]
    diagonal = precision.copy()
    diagonal[:, :-1] += across
    diagonal[:, 1:] += across
    diagonal[:, :, :-1] += within
    diagonal[:, :, 1:] += within
    row = np.arange(ny)
    P, y = np.empty((nx, trials, ny, ny)), g.copy()
    for i in range(nx):
        block = np.zeros((trials, ny, ny))
        block[:, row, row] = diagonal[:, i]
        block[:, row[:-1], row[1:]] = block[:, row[1:], row[:-1]] = -within[i]
        if i > 0:
            block -= across[i - 1][:, None] * P[i - 1] * across[i - 1]
            y[:, i] += across[i - 1] * _times(P[i - 1], y[:, i - 1])
        P[i] = np.linalg.inv(block)
    x, variance = np.empty_like(g), np.empty_like(g)
    G = P[-1]
    x[:, -1], variance[:, -1] = _times(G, y[:, -1]), G[:, row, row]
    for i in range(nx - 2, -1, -1):
        x[:, i] = _times(P[i], y[:, i] + across[i] * x[:, i + 1])
        joined = P[i] * across[i]
        G = P[i] + joined @ G @ joined.swapaxes(1, 2)
        variance[:, i] = G[:, row, row]
    return x, variance


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return the matrix-vector product of each trial: (trials, n, n) times (trials, n)."""
    return (matrix @ vector[..., None])[..., 0]


@ti.kernel
def _collect(
    members: Template, team_size: Template, position: Template, reading: Template, extent: ti.math.vec2, cell: float,
    shape: Template, count: Template, total: Template,
):  # fmt: skip
    """Add each trial's valid readings to the number and the sum of readings in their cells."""
    ti.loop_config(serialize=ti.static(runs_serially(team_size.shape[0])))
    for k in range(team_size.shape[0]):
        for m in range(team_size[k]):
            robot = members[k, m]
            if counts(reading[robot], position[robot], extent):
                I = cell_of(position[robot], cell, shape)
                count[k, I[0], I[1]] += 1.0
                total[k, I[0], I[1]] += reading[robot]
