"""Direct solution of the Poisson equation in a box with obstacles by the capacitance matrix method.

A are the equations to solve, B the equations of the empty box. They differ in the K cells of air beside obstacles: only
these rows of C = A - B are not empty. The difference counts as sources s in these cells:

    x = B^-1 (b - s),   M s = C B^-1 b,   M = 1 + C B^-1

M is the capacitance matrix (Buzbee, Dorr, George & Golub 1971, doi:10.1137/0708066; O'Leary & Widlund 1979, Math.
Comp. 33, 849-879). In closed-off cells x continues harmonically, unseen by the air.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import prod, sqrt

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from taichi_plume.engine.fields import Field
from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.clusters import ClusterMatrix, clusters
from taichi_plume.solvers.direct import Balance, FastTransforms, angles, eigenvalues
from taichi_plume.solvers.poisson import OpenFractions

ENTRIES = 1 << 25  # entries of the Green's function that are computed at a time


@dataclass(frozen=True)
class Changes:
    """Empty box that is closest to given open fractions, and the difference C = A - B of the equations in the air.

    kinds: closed, free, periodic, closed-free or free-closed per axis of the grid. near: numbers (axis 0 fastest) of
    the K cells whose equations differ; reach: numbers of the cells in these equations; matrix: C, (K, len(reach)). air:
    cells that are not closed off; part: number of the connected part of the air per such cell; floating: parts that no
    free face of the domain touches. There phi is added to one cell's equation, or A would be singular.
    """

    kinds: tuple[str, ...]
    near: np.ndarray
    reach: np.ndarray
    matrix: sp.csr_array
    air: np.ndarray
    part: np.ndarray
    floating: np.ndarray

    @staticmethod
    def of(fractions: OpenFractions, grid: Grid) -> "Changes":
        """Return the changes from a box each of whose sides is free or closed like most of its faces with air."""
        faces = [_faces(fractions, d) for d in range(grid.dim)]
        total = int(np.prod(fractions.shape))
        air = np.zeros(total + 1, bool)  # the last entry stands for the outside
        for a, ends in faces:
            air[ends[a > 0]] = True
        air[-1] = False
        kinds, more = [], []
        for d, (a, ends) in enumerate(faces):
            sides, box = [], np.ones(len(a), np.float32)
            for outside in (1, 0):  # of the domain's lower and upper side
                side = np.flatnonzero(ends[:, outside] < 0)
                meets = a[side[air[ends[side, 1 - outside]]]]
                sides.append("free" if 2 * np.count_nonzero(meets) > len(meets) else "closed")
                box[side] = 2.0 if sides[-1] == "free" else 0.0
            kind = sides[0] if sides[0] == sides[1] else "-".join(sides)
            kinds.append("periodic" if fractions.periodic[d] else kind)
            more.append(a - box)
        a, ends, more = (np.concatenate(x) for x in ([f[0] for f in faces], [f[1] for f in faces], more))
        changed = np.flatnonzero((np.abs(more) > 1e-6) & (ends[:, 0] != ends[:, 1]) & air[ends].any(axis=1))
        # without changes, the transforms leave out the mean, which cannot be solved for
        part, floating = _parts(ends[a > 0] if len(changed) else ends[:0], air[:-1])
        first = np.zeros(len(floating), int)
        first[part[::-1]] = np.flatnonzero(air)[::-1]
        pins = first[floating] if len(changed) else first[:0]
        rows, columns, values = [pins], [pins], [np.ones(len(pins))]
        for own in (0, 1):
            mine = changed[air[ends[changed, own]]]
            inner = mine[ends[mine, 1 - own] >= 0]
            rows += [ends[mine, own], ends[inner, own]]
            columns += [ends[mine, own], ends[inner, 1 - own]]
            values += [more[mine], -more[inner]]
        near, row = np.unique(np.concatenate(rows), return_inverse=True)
        reach, column = np.unique(np.concatenate(columns), return_inverse=True)
        matrix = sp.csr_array((np.concatenate(values), (row, column)), shape=(len(near), len(reach)))
        return Changes(tuple(kinds), near, reach, matrix, air[:-1], part, floating)


def _faces(fractions: OpenFractions, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the open fraction of all faces across axis d (n,), and their upper and lower cells (n, 2), -1 outside."""
    number = np.arange(int(np.prod(fractions.shape)), dtype=np.int32).reshape(fractions.shape, order="F")
    inner = [slice(1, 1 + n) for n in fractions.shape]
    if fractions.periodic[d]:
        above, below = number, np.roll(number, 1, axis=d)
    else:
        inner[d] = slice(1, 2 + fractions.shape[d])
        beyond = np.full_like(np.take(number, [0], axis=d), -1)
        above, below = (np.concatenate(x, axis=d) for x in ((number, beyond), (beyond, number)))
    return fractions.a[d][tuple(inner)].ravel(), np.stack([above.ravel(), below.ravel()], axis=1)


def _parts(ends: np.ndarray, air: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the connected part to which each cell of `air` belongs, and whether each part touches no free face.

    ends: cells above and below each open face, (n, 2), -1 outside.
    """
    inside = (ends >= 0).all(axis=1)
    links = ends[inside]
    graph = sp.csr_array((np.ones(len(links), np.int8), links.T), shape=(len(air), len(air)))
    count, component = connected_components(graph, directed=False)
    floating = np.zeros(count, bool)
    floating[component[air]] = True
    floating[component[ends[~inside].max(axis=1)]] = False
    return component[air], floating


class GreensFunction:
    """Green's function: solutions of the Poisson equation in the empty box for unit sources in single cells.

    Along each axis a solution depends on the distance and, as ends mirror, on the distance from the mirror image.
    """

    def __init__(self, kinds: Sequence[str], shape: Sequence[int]):
        # cells in a line along the last (shortest) axis share two of three steps
        self.order = sorted(range(len(kinds)), key=lambda d: -shape[d])
        self.kinds = [kinds[d] for d in self.order]
        lines = [eigenvalues(angles(kinds[d], shape[d])) for d in self.order]
        total = np.asarray(sum(np.meshgrid(*lines, indexing="ij")))
        table = np.divide(1.0, total, out=np.zeros_like(total), where=total > 1e-12)
        if len(self.kinds) == 2:
            table, self.kinds = table[..., None], [*self.kinds, "periodic"]
        for axis, kind in enumerate(self.kinds):
            n = table.shape[axis]
            steps = np.arange(n if kind == "periodic" else 2 * n)
            waves = np.cos(np.outer(steps, angles(kind, n))) / n
            if kind in ("closed", "free"):  # the square of this mode sums to n, not to n / 2
                waves[:, 0 if kind == "closed" else -1] *= 0.5
            table = np.moveaxis(np.tensordot(waves, table, axes=(1, axis)), 0, axis)
        self.length, self.height = table.shape[1:]
        self.lines = np.ascontiguousarray(table).reshape(-1, self.height)

    def __call__(self, cells: np.ndarray, sources: np.ndarray) -> np.ndarray:
        """Return the solutions in `cells` (P, dim) for unit sources in cells `sources` (Q, dim): (P, Q)."""
        (i, row, p), (j, column, q) = (_in_lines(x[:, self.order]) for x in (cells, sources))
        steps = [_images(kind, i[:, d], j[:, d]) for d, kind in enumerate(self.kinds[:2])]
        between = np.asarray(
            sum(s * t * self.lines[m * self.length + n] for (s, m), (t, n) in product(*steps))
        )
        first = (row[:, None] * len(j) + column) * self.height
        return np.asarray(sum(s * between.reshape(-1)[first + m] for s, m in _images(self.kinds[2], p, q)))

    def apply(self, matrix: sp.csr_array, cells: np.ndarray, sources: np.ndarray) -> np.ndarray:
        """Return matrix (Q, P) times Green's function from `sources` (Q, dim) to `cells` (P, dim): (Q, Q)."""
        result = np.empty((len(sources), len(sources)))
        by_line = np.lexsort(sources[:, self.order[::-1]].T)
        blocks = -(-len(sources) * len(cells) * self.height // ENTRIES)
        for rows in np.array_split(by_line, blocks):
            block = matrix[rows]
            columns = np.unique(block.indices)
            result[rows] = block[:, columns] @ self(cells[columns], sources)
        return result


def _in_lines(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the lines along the third axis that hold cells (n, 2), and each cell's line and position in its line."""
    cells = cells.astype(np.int32)
    lines, line = np.unique(cells[:, :2], axis=0, return_inverse=True)
    return lines, line.astype(np.int32), cells[:, 2] if cells.shape[1] > 2 else np.zeros_like(cells[:, 0])


def _images(kind: str, i: np.ndarray, j: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Return pairs of sign and distances from i to j, (len(i), len(j)): for the source at j and, unless the axis is
    periodic, for the mirror image of the source, whose sign is -1 at a free face.
    """
    direct = [(1, np.abs(i[:, None] - j))]
    return direct if kind == "periodic" else [*direct, (-1 if kind[0] == "f" else 1, i[:, None] + j + 1)]


class Window:
    """Transforms between modes and selected cells only, by matrices over the rows and layers that have such cells.

    Arrays of the window have the axes (layers, columns, rows), without layers in 2-D. place: indices of the selected
    cells in such arrays, flattened.
    """

    def __init__(self, box: FastTransforms, cells: np.ndarray):
        """Prepare the matrices; cells: indices (n, dim) of the selected cells."""
        lines, where = zip(*(np.unique(index, return_inverse=True) for index in cells.T), strict=True)
        order = (2, 0, 1)[3 - len(lines) :]
        self.place = np.ravel_multi_index([where[d] for d in order], [len(lines[d]) for d in order])
        self.size = prod(len(line) for line in lines)
        self.selection = slice(None), lines[0], slice(box.modes[0].count)
        self.there = [m.matrices[0][:, line] for m, line in zip(box.modes, lines[1:], strict=True)]
        self.back = [m.matrices[1][line] for m, line in zip(box.modes, lines[1:], strict=True)]

    def values(self, waves: np.ndarray) -> np.ndarray:
        """Return the values for amplitudes of the box's modes, flattened."""
        first, *second = self.back
        x = waves[self.selection]
        x = x.reshape(-1, x.shape[-1]) @ first.T
        for matrix in second:
            x = matrix @ x.reshape(matrix.shape[1], -1)
        return x.reshape(-1)

    def waves(self, x: np.ndarray) -> np.ndarray:
        """Return the amplitudes, those of `selection`, for values x, flattened."""
        first, *second = self.there
        for matrix in second:
            x = matrix @ x.reshape(matrix.shape[1], -1)
        x = x.reshape(-1, first.shape[1]) @ first.T
        return x.reshape(-1, len(self.selection[1]), len(first))


class Capacitance:
    """Poisson solver of the pressure: transforms of the empty box, capacitance matrix for obstacles."""

    def __init__(self, changes: Changes, grid: Grid):
        self.grid = grid
        self.iterations = 1
        self.box = FastTransforms(changes.kinds, grid)
        self.cells, self.balance = np.flatnonzero(changes.air), Balance(changes.part, changes.floating)
        closed_off = np.unravel_index(np.flatnonzero(~changes.air), grid.shape, order="F")
        self.closed_off = np.ravel_multi_index(
            [index + grid.ghost for index in closed_off], grid.padded, order="F"
        )
        self.constant = np.float32(sqrt(prod(grid.shape[1:])))  # amplitude of the constant 1
        near, reach = (
            np.stack(np.unravel_index(cells, grid.shape, order="F"), axis=1)
            for cells in (changes.near, changes.reach)
        )
        cluster = clusters(near)
        order = np.argsort(cluster, kind="stable")
        near, matrix = near[order], changes.matrix[order]
        self.window = Window(self.box, reach)
        self.place = self.window.place[np.searchsorted(changes.reach, changes.near[order])]
        entries = matrix.tocoo()
        places = entries.row, self.window.place[entries.col]
        shape = len(near), self.window.size
        self.changes = sp.csr_array((entries.data.astype(np.float32), places), shape=shape)
        self.sources = np.zeros(self.window.size, np.float32)
        sizes = np.bincount(cluster)
        self.inverse = ClusterMatrix(
            self._inverse(matrix, reach, near), np.append(sizes, 1) if self.box.singular else sizes
        )

    def _inverse(self, changes: sp.csr_array, reach: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Return the inverse of the capacitance matrix 1 + C B^-1, for C and the indices (n, dim) of its columns and
        rows.
        """
        matrix = GreensFunction(self.box.kinds, self.grid.shape).apply(changes, reach, near)
        matrix[np.diag_indices_from(matrix)] += 1.0
        if self.box.singular:  # pair the free constant of B with the mean source, which B cannot have
            ones = np.ones((1, len(matrix)))
            matrix = np.block([[matrix, -changes.sum(axis=1)[:, None]], [ones, np.zeros((1, 1))]])
        # single precision is enough: the condition number is 30
        return scipy.linalg.inv(matrix.astype(np.float32), overwrite_a=True, check_finite=False)

    def solve(self, b: Field, phi: Field, tolerance: float) -> None:
        """Solve the Poisson equation for the right side b into the inner cells of phi, exactly for any tolerance."""
        del tolerance
        box, waves, trial = self.box, self.box.waves, self.box.trial
        right = box.rows(b)
        if self.balance.any:
            right = right.copy()
            flat = right.reshape(-1)
            flat[self.cells] -= self.balance.excess(flat[self.cells]).astype(np.float32)
        box.forward(right)
        np.copyto(trial.values, waves.values)
        trial.solve()
        missed = self.changes @ self.window.values(trial.values)
        if box.singular:
            missed = np.append(missed, self.constant * waves.values[0, :, 0].sum())
        sources = self.inverse.times(missed)
        self.sources[self.place] = sources[: len(self.place)]
        waves.values[self.window.selection] -= self.window.waves(self.sources)
        waves.solve()
        if box.singular:
            waves.values[0, :, 0] += self.constant * sources[-1]
        box.backward(box.rows(phi))
        phi.flat[self.closed_off] = 0.0
