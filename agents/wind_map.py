"""Wind over the floor as a Gaussian Markov random field with mass conservation, from the robots' anemometers.

Monroy, Jaimez & Gonzalez-Jimenez, "Online estimation of 2D wind maps for olfactory robots", ISOEN 2017,
doi:10.1109/ISOEN.2017.7968883: a wind v minimises the sum of four energies, of readings, of differences between
neighbours (regularisation), of mass conservation (div v = 0), and of the flow through obstacles.

    Σ_readings λ_o(s) |v_k - z|²  +  Σ_neighbours λ_p (Δv)²  +  Σ_cells λ_m (Δx u + Δy v)²,     v n = 0 on walls

k is the cell in which a reading z of age s was taken; Δx u + Δy v is the outflow of a cell over its edge. Ours: the
unknowns are the normal velocities of the faces between the cells (staggered grid), so that the outflow of a cell has no
checkerboard mode and walls thinner than a cell count. Faces on walls are left out: the velocity there is exactly zero.
The wind of a cell is the mean of its opposite faces. Neighbours are opposite faces of a cell, and faces side by side
that no wall separates. A precision TINY λ_p of each face about zero holds faces that nothing else determines.

Column by column the matrix is block tridiagonal, see `solve_columns`. Cells that no chain of links joins to a reading
are unknown. Readings fade as those of the gas map `gmrf`.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, vstack
from scipy.sparse.linalg import spsolve

from taichi_plume.agents.gas_map import Floor, Readers, cell_of, nowhere
from taichi_plume.agents.gmrf import Links, MarkovField, links, regions
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.grid.grid import centers
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario import maps as models

TINY = 1e-6  # of lambda_prior: precision of each face about zero


class WindField:
    """Random field of the wind on the cells of a floor with walls; `solve` estimates the wind from readings.

    joined: links between neighbour cells, see `gmrf.links`; free: (nx, ny) cells with air at their centres; edges: air
    passes the edge, by side x-, x+ (ny,) and y-, y+ (nx,). prior, mass, observation: precisions λ_p, λ_m, λ_o [s²/m²].
    """

    def __init__(
        self,
        joined: Links,
        free: np.ndarray,
        edges: list[np.ndarray],
        prior: float,
        mass: float,
        observation: float,
    ):
        self.shape, self.observation = free.shape, observation
        self.turned = free.shape[1] > free.shape[0]  # blocks are as large as a column
        if self.turned:
            joined, free, edges = (joined[1].T, joined[0].T), free.T, edges[2:] + edges[:2]
        nx, ny = free.shape
        self.block = 2 * ny + 1
        column = np.arange(nx + 1)[:, None] * self.block
        u, v = column + np.arange(ny), column[:-1] + ny + np.arange(ny + 1)
        self.u, self.v = (
            (u[:-1], u[1:]),
            (v[:, :-1], v[:, 1:]),
        )  # numbers of the lower and upper faces of the cells
        self.free = free
        self.is_open = np.zeros((nx + 1) * self.block, bool)
        self.is_open[u[1:-1][joined[0]]] = True
        self.is_open[v[:, 1:-1][joined[1]]] = True
        for face, air, edge in zip(
            (u[0], u[-1], v[:, 0], v[:, -1]), (free[0], free[-1], free[:, 0], free[:, -1]), edges, strict=True
        ):
            self.is_open[face[air & edge]] = True
        beside = np.pad(joined[1], ((1, 1), (0, 0)))  # links of the cells before and after each face
        above = np.pad(joined[0], ((0, 0), (1, 1)))
        pairs = [
            np.stack([self.u[1][free], self.u[0][free]]),
            np.stack([self.v[1][free], self.v[0][free]]),
            self._both_open(u[:, 1:], u[:, :-1], beside[1:] | beside[:-1]),
            self._both_open(v[1:], v[:-1], above[:, 1:] | above[:, :-1]),
        ]
        differences = np.concatenate(pairs, axis=1)
        size = len(self.is_open)
        smooth = _rows(differences, (1.0, -1.0), size)
        outflow = _rows(np.stack([*self.u, *self.v])[:, free], (-1.0, 1.0, -1.0, 1.0), size)
        terms = vstack([np.sqrt(prior) * smooth, np.sqrt(mass) * outflow])
        self.matrix = csr_array(terms.T @ terms + TINY * prior * diags_array(np.ones(size)))

    def _both_open(self, a: np.ndarray, b: np.ndarray, together: np.ndarray) -> np.ndarray:
        return np.stack([a, b])[:, together & self.is_open[a] & self.is_open[b]]

    def solve(self, count: np.ndarray, total: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean [m/s] and variance [m²/s²] of the wind in each cell, (nx, ny, 2) each; NaN in unknown cells.

        count: (nx, ny) readings in each cell, weighted by age; total: (nx, ny, 2) their sum [m/s]; known: (nx, ny).
        """
        matrix, g, asked, known = self._equations(count, total, known)
        x, within, beyond = solve_columns(matrix, g, self.block)
        x, own = x * asked, within[:, np.arange(self.block), np.arange(self.block)].ravel() * asked
        variance = np.empty((*self.free.shape, 2))
        for axis, (low, high) in enumerate((self.u, self.v)):
            blocks = (beyond, within)[axis][np.arange(len(low))[:, None], low % self.block, high % self.block]
            both = blocks * asked[low] * asked[high]
            variance[..., axis] = 0.25 * (own[low] + own[high] + 2.0 * both)
        return self._of_cells(x, known), self._unturned(np.where(known[..., None], variance, np.nan))

    def mean(self, count: np.ndarray, total: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Return the mean wind alone, as `solve` does, in less time."""
        matrix, g, asked, known = self._equations(count, total, known)
        return self._of_cells(asked * spsolve(matrix.tocsc(), g), known)

    def _of_cells(self, x: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Return the wind (nx, ny, 2) of the cells from the velocities x of the faces; NaN in unknown cells."""
        mean = np.stack([0.5 * (x[low] + x[high]) for low, high in (self.u, self.v)], axis=-1)
        return self._unturned(np.where(known[..., None], mean, np.nan))

    def _unturned(self, values: np.ndarray) -> np.ndarray:
        return values.swapaxes(0, 1)[..., ::-1].copy() if self.turned else values

    def _equations(
        self, count: np.ndarray, total: np.ndarray, known: np.ndarray
    ) -> tuple[csr_array, np.ndarray, np.ndarray, np.ndarray]:
        """Return H, g, the faces that are asked for, and the known cells, turned as the field is."""
        if self.turned:
            count, total, known = count.T, total.swapaxes(0, 1)[..., ::-1], known.T
        asked = np.zeros(len(self.is_open), bool)
        for faces in (*self.u, *self.v):
            asked[faces[known & self.free]] = True
        asked &= self.is_open
        half = 0.5 * self.observation
        g = np.zeros(len(asked))
        parts = [self.matrix]
        for axis, (low, high) in enumerate((self.u, self.v)):
            np.add.at(g, low, half * total[..., axis])
            np.add.at(g, high, half * total[..., axis])
            cells = count > 0
            weight = np.sqrt(self.observation * count[cells])
            reads = _rows(np.stack([low[cells], high[cells]]), (0.5, 0.5), len(g), weight)
            parts.append(csr_array(reads.T @ reads))
        keep = diags_array(asked.astype(float))
        matrix = csr_array(keep @ sum(parts[1:], parts[0]) @ keep + diags_array((~asked).astype(float)))
        return matrix, g * asked, asked, known


class WindMap(MarkovField):
    """Map of the wind with mean [m/s] and variance [m²/s²] of both components, (trials, nx, ny, 2) each."""

    SUMS: ClassVar[int] = 3

    def __init__(self, model: models.WindMap, floor: Floor):
        super().__init__(model, floor)
        free = floor.obstacle_distance(centers(self.shape, model.cell)) > 0
        edges = open_edges(self.shape, model.cell, floor.edge)
        weights = model.lambda_prior, model.lambda_mass, model.lambda_observation
        self.field = WindField(self.links, free, edges, *weights)

    def weight(self) -> np.ndarray:
        """Return the confidence of the map, 1 / variance [s²/m²] of the larger one, (trials, nx, ny)."""
        return np.nan_to_num(1.0 / self.variance().max(axis=-1), nan=0.0)

    def _collect(self, swarm: Readers) -> None:
        _collect(swarm.members, swarm.team_size, swarm.believed_position, swarm.wind, swarm.wind_known, self.extent,
                 self.cell, self.shape, *self.sums)  # fmt: skip

    def _solve(self) -> list[np.ndarray]:
        count, *total = self._information()
        known = self._known(count)
        solved = [
            self.field.solve(*trial) if trial[0].any() else (np.full((*self.shape, 2), np.nan),) * 2
            for trial in zip(count, np.stack(total, axis=-1), known, strict=True)
        ]
        return [np.stack(values) for values in zip(*solved, strict=True)]


class FloorWind:
    """Random field of the wind over a floor, for readings at points.

    size: of the floor, from the origin on [m]; cell: edge of the cells [m]. obstacle_distance, edge: see `Floor`; by
    default the floor has neither obstacles nor walls.
    """

    def __init__(
        self,
        size: tuple[float, float],
        cell: float,
        obstacle_distance: Callable[[np.ndarray], np.ndarray] = nowhere,
        edge: "Callable[[int, int, np.ndarray, float], np.ndarray] | None" = None,
        prior: float = models.WIND_PRIOR,
        mass: float = models.WIND_MASS,
        observation: float = models.WIND_OBSERVATION,
    ):
        self.cell, self.shape = cell, (max(1, round(size[0] / cell)), max(1, round(size[1] / cell)))
        places = centers(self.shape, cell)
        joined = links(places, obstacle_distance)
        self.free, self.region = obstacle_distance(places) > 0, regions(joined)
        self.field = WindField(
            joined, self.free, open_edges(self.shape, cell, edge), prior, mass, observation
        )

    def solve(self, place: np.ndarray, wind: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean [m/s] and variance [m²/s²] of the wind in the cells, (nx, ny, 2); NaN in unknown cells.

        place: (n, 2) [m] and wind: (n, 2) [m/s] of the readings.
        """
        return self.field.solve(*self._gathered(place, wind))

    def mean(self, place: np.ndarray, wind: np.ndarray) -> np.ndarray:
        """Return the mean wind alone, as `solve` does, in less time."""
        return self.field.mean(*self._gathered(place, wind))

    def _gathered(self, place: np.ndarray, wind: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return number and sum of the readings in each cell, and the cells joined to these."""
        at = tuple(np.clip((np.asarray(place) / self.cell).astype(int), 0, np.array(self.shape) - 1).T)
        count, total = np.zeros(self.shape), np.zeros((*self.shape, 2))
        np.add.at(count, at, 1.0)
        np.add.at(total, at, wind)
        known = np.isin(self.region, self.region[(count > 0) & self.free]) & self.free
        return count * self.free, total * self.free[..., None], known


def open_edges(shape: tuple[int, int], cell: float, edge: Any) -> list[np.ndarray]:
    """Return where air passes the edges of a floor, by side x-, x+ (ny,) and y-, y+ (nx,); edge: see `Floor`."""
    sides = [(axis, side) for axis in (0, 1) for side in (0, 1)]
    along = [(np.arange(shape[1 - axis]) + 0.5) * cell for axis, _ in sides]
    if edge is None:
        return [np.ones(len(place), bool) for place in along]
    return [edge(axis, side, place, cell) for (axis, side), place in zip(sides, along, strict=True)]


def solve_columns(matrix: csr_array, g: np.ndarray, block: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return H⁻¹ g, and of H⁻¹ the diagonal blocks (n, block, block) and those beside them (n - 1, block, block).

    matrix: H, symmetric, positive definite and block tridiagonal. Block Gaussian elimination: with D_i and U_i on and
    beside the diagonal, P_i = (D_i - U_i-1ᵀ P_i-1 U_i-1)⁻¹; backward, G_i,i+1 = -P_i U_i G_i+1 and
    G_i = P_i - G_i,i+1 U_iᵀ P_i.
    """
    n = len(g) // block
    cut = [slice(i * block, (i + 1) * block) for i in range(n)]
    U = [matrix[cut[i], cut[i + 1]] for i in range(n - 1)]
    y = g.reshape(n, block).copy()
    P = np.empty((n, block, block))
    for i in range(n):
        D = matrix[cut[i], cut[i]].toarray()
        if i > 0:
            D -= U[i - 1].T @ (P[i - 1] @ U[i - 1])
            y[i] -= U[i - 1].T @ (P[i - 1] @ y[i - 1])
        P[i] = np.linalg.inv(D)
    x, beyond = np.empty_like(y), np.empty((n - 1, block, block))
    x[-1] = P[-1] @ y[-1]
    for i in range(n - 2, -1, -1):
        x[i] = P[i] @ (y[i] - U[i] @ x[i + 1])
        beyond[i] = -P[i] @ (U[i] @ P[i + 1])  # P[i + 1] already holds G_i+1
        P[i] -= beyond[i] @ (U[i].T @ P[i])
    return x.ravel(), P, beyond


def _rows(
    columns: np.ndarray, values: tuple[float, ...], size: int, weight: np.ndarray | float = 1.0
) -> csr_array:
    """Return a sparse matrix with a row for each column of `columns` (k, rows), and `values` (k,) times weight."""
    k, rows = columns.shape
    row = np.broadcast_to(np.arange(rows), (k, rows))
    entries = np.array(values)[:, None] * np.broadcast_to(weight, rows)
    return csr_array(coo_array((entries.ravel(), (row.ravel(), columns.ravel())), shape=(rows, size)))


@ti.kernel
def _collect(
    members: Template, team_size: Template, position: Template, wind: Template, wind_known: Template,
    extent: ti.math.vec2, cell: float, shape: Template, count: Template, along: Template, across: Template,
):  # fmt: skip
    """Add each trial's measured winds to the number and the sums of both components in their cells."""
    ti.loop_config(serialize=ti.static(runs_serially(team_size.shape[0])))
    for k in range(team_size.shape[0]):
        for m in range(team_size[k]):
            robot = members[k, m]
            p = position[robot]
            if wind_known[robot] == 1 and (p >= 0.0).all() and (p <= extent).all():
                I = cell_of(p, cell, shape)
                count[k, I[0], I[1]] += 1.0
                along[k, I[0], I[1]] += wind[robot][0]
                across[k, I[0], I[1]] += wind[robot][1]
