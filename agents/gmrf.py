"""Gas map as a Gaussian Markov random field whose links obstacles cut.

Monroy, Blanco & Gonzalez-Jimenez, Autonomous Robots 2016. The map minimises

    Σ_links λ_p (m_i - m_j)²  +  Σ_readings λ_o(s) (m_k - z)²,      λ_o(s) = λ_o max(0, 1 - s / memory)

    Links join cells that share an edge, unless an obstacle stands between their centres; k is the cell in which a
    reading z of age s was taken. Hence H m = g, with H_ii = λ_p links_i + Σ λ_o, H_ij = -λ_p, g_i = Σ λ_o z, and the
    variance is the diagonal of H⁻¹. Cells that no chain of links joins to a reading are unknown.

Column by column, H is block tridiagonal, with diagonal matrices between blocks. Forward elimination, which stores the
inverses P of the blocks, gives the mean; backward substitution gives the diagonal blocks of the inverse: G_i = P_i +
(λ_p P_i R_i) G_i+1 (λ_p R_i P_i), where R_i holds the links from column i to the next. The solution is exact, for all
trials at once. A map with layers has links over the height too, with the weight λ_p (cell / layer)²: ours. The cost is
constant in time: readings are summed by cell and window, and dropped once their weight is zero.
"""

from collections.abc import Callable, Sequence
from math import prod
from typing import Any, ClassVar

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from taichi_plume.agents.gas_map import Floor, GasMap, Readers, cell_of, counts, window_of, windows
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template

LOOKS = 16  # parts of the line between two centres; the ends of the parts are checked for obstacles

Links = tuple[np.ndarray, ...]
"""Whether neighbour cells are joined, along x (nx - 1, ny, ...), y (nx, ny - 1, ...), and z."""
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
        levels = model.levels(floor.room)
        super().__init__(model.cell, floor, levels)
        self.sums = tuple(ti.field(ti.f32, (self.rows, *self.shape)) for _ in range(self.SUMS))
        distance = floor.solid_distance if levels else floor.obstacle_distance
        free = distance(self.places()) > 0
        # a reading in a cell whose centre lies in an obstacle counts for the nearest free cell
        self.counted_in = np.arange(free.size).reshape(free.shape)
        if free.any():
            edges = (model.cell, model.cell, levels.layer) if levels else None
            nearest: Any = distance_transform_edt(~free, edges, return_distances=False, return_indices=True)
            self.counted_in = np.ravel_multi_index(tuple(nearest), free.shape)
        self.links = links(self.places(), distance)
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
        sums = [self._moved(self.by_trial(field.values)) for field in self.sums]
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
        """Return flat cell sums of `values` (trials, nx, ny, ...), blocked cells added to the nearest free cells."""
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
        """Return number and sums of the readings in each cell, weighted by age, (trials, nx, ny, ...) each."""
        sums = [np.zeros((self.trials, *self.region.shape)) for _ in self.sums]
        for time, cells, *values in self.past:
            share = self._share(time)
            for total, value in zip(sums, values, strict=True):
                total.ravel()[cells] += share * value
        return sums

    def _known(self, count: np.ndarray) -> np.ndarray:
        """Return the mask (trials, nx, ny, ...) of cells that links join to a reading; count: number of readings."""
        number = (np.arange(len(count)) * (self.region.max() + 1)).reshape(-1, *[1] * self.region.ndim)
        number = number + self.region
        return (np.bincount(number.ravel(), count.ravel()) > 0)[number]


class MarkovMap(MarkovField):
    """Gas map with mean [ppm] and variance [ppm²] in each cell by a Gaussian Markov random field.

    prior: weights of the links along each axis [1/ppm²].
    """

    def __init__(self, model: Any, floor: Floor):
        super().__init__(model, floor)
        self.prior = [model.lambda_prior] * 2
        if self.levels:
            self.prior.append(model.lambda_prior * (model.cell / self.levels.layer) ** 2)

    def weight(self) -> np.ndarray:
        """Return the confidence of the map, 1 / variance [1/ppm²], (trials, nx, ny); 0 in unknown cells."""
        return np.nan_to_num(1.0 / self.variance(), nan=0.0)

    def covariance(self, trial: int, cells: np.ndarray) -> np.ndarray:
        """Return columns of the covariance H⁻¹ [ppm²] of a trial's map, (nx ny, k), for k known cells (indices)."""
        count = self._information()[0]
        known = self._known(count)[trial]
        precision = self.model.lambda_observation * count[trial] + ~known
        H = diags_array(precision.ravel()) + laplacian(self.links, self.prior)
        units = np.zeros((known.size, len(cells)))
        units[cells, np.arange(len(cells))] = 1.0
        return splu(H.tocsc()).solve(units) * known.ravel()[:, None]

    def _collect(self, swarm: Readers) -> None:
        if self.levels:
            self._collect_in_layers(swarm, *self.sums)
        else:
            _collect(swarm.members, swarm.team_size, swarm.believed_position, swarm.reading, self.extent, self.cell,
                     self.shape, *self.sums)  # fmt: skip

    @ti.kernel
    def _collect_in_layers(self, swarm: Template, count: Template, total: Template):
        """Add each trial's valid readings to the number and the sum of readings in their cells over the height."""
        ti.loop_config(serialize=ti.static(runs_serially(swarm.team_size.shape[0])))
        for k in range(swarm.team_size.shape[0]):
            for m in range(swarm.team_size[k]):
                i = swarm.members[k, m]
                z = self.height(swarm, i)
                if counts(swarm.reading[i], swarm.believed_position[i], self.extent) and self.on_layers(z):
                    I, row = cell_of(swarm.believed_position[i], self.cell, self.shape), self.row(k, z)
                    count[row, I[0], I[1]] += 1.0
                    total[row, I[0], I[1]] += swarm.reading[i]

    def _solve(self) -> list[np.ndarray]:
        count, total = self._information()
        known = self._known(count)
        precision = self.model.lambda_observation * count + ~known  # otherwise H would be singular
        mean, variance = _solve(precision, self.model.lambda_observation * total, self.links, self.prior)
        return [np.where(known, mean, np.nan), np.where(known, variance, np.nan)]


def links(place: np.ndarray, obstacle_distance: Callable[[np.ndarray], np.ndarray]) -> Links:
    """Return whether the line between neighbour cells is free of obstacles, by axis: along x (nx - 1, ny, ...), y
    (nx, ny - 1, ...), and z. place: centres of the cells (nx, ny, ..., dim) [m].
    """
    share = np.linspace(0.0, 1.0, LOOKS + 1).reshape(-1, *[1] * place.ndim)
    ends = [
        (np.moveaxis(place, axis, 0)[:-1], np.moveaxis(place, axis, 0)[1:]) for axis in range(place.ndim - 1)
    ]
    distances = [obstacle_distance((1 - share) * low + share * high).min(axis=0) for low, high in ends]
    return tuple(np.moveaxis(values > 0, 0, axis) for axis, values in enumerate(distances))


def regions(joined: Links) -> np.ndarray:
    """Return a region number for each cell, (nx, ny, ...), equal for cells that a chain of links joins."""
    graph = _linked(joined, [1.0] * len(joined))
    return connected_components(graph, directed=False)[1].reshape(_cells(joined))


def laplacian(joined: Links, weights: Sequence[float]) -> csr_array:
    """Return the sparse matrix (n, n) of the energy of links of n cells; weights: of the links along each axis."""
    ends = _linked(joined, weights)
    both = csr_array(ends + ends.T)
    return csr_array(diags_array(both.sum(axis=0)) - both)


def _cells(joined: Links) -> tuple[int, ...]:
    """Return the number of cells along each axis."""
    return joined[0].shape[0] + 1, *joined[0].shape[1:]


def _linked(joined: Links, weights: Sequence[float]) -> csr_array:
    """Return a sparse matrix (n, n) with the weight of each link, from the lower to the upper one of n cells."""
    cell = np.arange(prod(_cells(joined))).reshape(_cells(joined))
    parts = []
    for axis, (links, weight) in enumerate(zip(joined, weights, strict=True)):
        along = np.moveaxis(cell, axis, 0)
        open = np.moveaxis(links, axis, 0)
        parts.append(np.stack([along[:-1][open], along[1:][open], np.full(open.sum(), weight)]))
    low, high, value = np.concatenate(parts, axis=1)
    return csr_array(coo_array((value, (low.astype(int), high.astype(int))), shape=(cell.size, cell.size)))


def _solve(
    precision: np.ndarray, g: np.ndarray, links: Links, weights: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return H⁻¹ g and the diagonal of H⁻¹, (trials, nx, ny, ...) each. H: matrix of the links, with the weights of
    each axis, plus `precision` on the diagonal.
    """
    longest = int(np.argmax(precision.shape[1:]))  # blocks are as large as a section across the longest axis
    precision, g = (np.moveaxis(values, 1 + longest, 1) for values in (precision, g))
    linked = [weight * np.moveaxis(each, longest, 0) for weight, each in zip(weights, links, strict=True)]
    linked.insert(0, linked.pop(longest))
    trials, nx, *section = precision.shape
    ny = prod(section)
    diagonal = precision.copy()
    for axis, each in enumerate(linked):
        values = np.moveaxis(diagonal, 1 + axis, 1)
        values[:, :-1] += np.moveaxis(each, axis, 0)
        values[:, 1:] += np.moveaxis(each, axis, 0)
    row = np.arange(ny)
    number = row.reshape(section)
    pairs = [
        (np.moveaxis(number, axis, 0)[:-1], np.moveaxis(number, axis, 0)[1:]) for axis in range(len(section))
    ]
    across = linked[0].reshape(nx - 1, ny)
    within = [-np.moveaxis(each, 1 + axis, 1) for axis, each in enumerate(linked[1:])]
    shape, g, diagonal = g.shape, g.reshape(trials, nx, ny), diagonal.reshape(trials, nx, ny)
    P, y = np.empty((nx, trials, ny, ny)), g.copy()
    for i in range(nx):
        block = np.zeros((trials, ny, ny))
        block[:, row, row] = diagonal[:, i]
        for (low, high), each in zip(pairs, within, strict=True):
            block[:, low, high] = block[:, high, low] = each[i]
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
    x, variance = (np.moveaxis(values.reshape(shape), 1, 1 + longest) for values in (x, variance))
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
