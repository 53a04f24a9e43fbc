"""Tridiagonal equations along the first axis of a box, for many modes of the other axes at once (Thomas algorithm)."""

from functools import partial
from math import prod
from typing import Any

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.cells import MOST
from taichi_plume.grid.kernels import CHUNK, FEW_CELLS, Pass, Template, launch

WIDTH = 16  # modes that are solved side by side in registers


class Tridiagonal:
    """Factors of the equations (T + lambda) x = r of many modes, T the negative second differences along an axis.

    Arrays of modes have the axes (rows, n, modes), with modes up to a multiple of WIDTH.
    """

    def __init__(self, kind: str, n: int, eigenvalues: np.ndarray):
        """Factorise for the eigenvalues lambda (rows, modes); kind: of the axis, as in `direct.FastTransforms`."""
        self.rows, modes = eigenvalues.shape
        self.n, self.strips = n, -(-modes // WIDTH)
        self.shape = self.rows, n, self.strips * WIDTH
        # Iterations from strip to strip: in a large box a strip is a chunk of iterations, which threads divide.
        self.apart = CHUNK if prod(self.shape) > FEW_CELLS else 1
        self.cyclic = kind == "periodic"
        self.chain = n - self.cyclic  # a periodic axis is a chain of cells whose ends meet in the last cell
        self.singular = bool(kind in ("closed", "periodic") and eigenvalues[0, 0] < 1e-12)
        self.inverses = ti.field(ti.f32, prod(self.shape))
        self.column = ti.field(ti.f32, prod(self.shape) if self.cyclic else 1)
        padded = np.pad(eigenvalues, [(0, 0), (0, self.shape[2] - modes)], constant_values=1.0)
        inverses, column = self._factors(kind, padded)
        self.inverses.from_numpy(inverses.ravel())
        if self.cyclic:
            self.column.from_numpy(column.ravel())

    def _factors(self, kind: str, eigenvalues: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the inverse pivots of Gaussian elimination and, for a periodic axis, minus the last column of its
        factor, both (rows, n, modes).
        """
        diagonal = np.repeat(eigenvalues[:, None] + 2.0, self.n, axis=1)
        if not self.cyclic:
            sides = kind.split("-")
            diagonal[:, 0] += 1.0 if sides[0] == "free" else -1.0
            diagonal[:, -1] += 1.0 if sides[-1] == "free" else -1.0
        inverses, column = np.zeros_like(diagonal), np.zeros_like(diagonal)
        link: Any = 1.0
        for i in range(self.chain):
            pivot = diagonal[:, i] - (inverses[:, i - 1] if i else 0.0)
            inverses[:, i] = _inverse(pivot)
            column[:, i] = link + (i == self.chain - 1)
            link = link * inverses[:, i]
        if self.cyclic:
            last = diagonal[:, -1] if self.chain else eigenvalues  # a single cell is its own neighbour
            inverses[:, -1] = _inverse(last - (column**2 * inverses).sum(axis=1))
        return inverses, column

    @ti.func
    def solve(self, x: Template, a, b):
        """Replace r by the solution in the memory x: eliminate forwards, substitute backwards."""
        for n in range(self.rows * self.strips * self.apart):
            if n & ti.static(self.apart - 1) == 0:
                strip = n // ti.static(self.apart)
                self._solve_strip(x, strip // self.strips, strip % self.strips)

    @ti.func
    def _solve_strip(self, x: Template, row, strip):
        value, last = ti.Vector([0.0] * WIDTH), ti.Vector([0.0] * WIDTH)
        for i in range(self.chain):
            here = self._place(row, i, strip)
            value = _load(self.inverses, here) * (_load(x, here) + value)
            _store(x, here, value)
            if ti.static(self.cyclic):
                last += _load(self.column, here) * value
        value = ti.Vector([0.0] * WIDTH)
        if ti.static(self.cyclic):
            end = self._place(row, self.chain, strip)
            last = _load(self.inverses, end) * (_load(x, end) + last)
            _store(x, end, last)
        for back in range(self.chain):
            here = self._place(row, self.chain - 1 - back, strip)
            if ti.static(self.cyclic):
                value += _load(self.column, here) * last
            value = _load(x, here) + _load(self.inverses, here) * value
            _store(x, here, value)

    @ti.func
    def _place(self, row, i, strip):
        # LLVM sees that a strip does not wrap around
        return (((row * self.n + i) * self.strips + strip) * WIDTH) & MOST


def _inverse(pivot: np.ndarray) -> np.ndarray:
    """Return 1 over the pivots, 0 for that of the equation of a constant, which has no unique solution."""
    return np.where(pivot > 1e-9, 1.0 / np.maximum(pivot, 1e-9), 0.0)


@ti.func
def _load(field: Template, place):
    return ti.Vector([field[place + k] for k in ti.static(range(WIDTH))])


@ti.func
def _store(field: Template, place, values: Template):
    for k in ti.static(range(WIDTH)):
        field[place + k] = values[k]


class Amplitudes:
    """Amplitudes of modes, right side or solution of `Tridiagonal` equations.

    values: array (rows, n, modes); amplitudes of modes that only fill up the last strip must be 0.
    """

    def __init__(self, equations: Tridiagonal):
        self.equations = equations
        field = ti.field(ti.f32, prod(equations.shape))
        self.values: np.ndarray = field.flat.reshape(equations.shape)
        self._solve = launch(Pass(partial(equations.solve, field), prod(equations.shape)))

    def solve(self) -> None:
        """Replace the right side by the solution. If the solution is unique up to a constant, the right side less its
        mean is solved for, with mean 0.
        """
        constant = self.values[0, :, 0]
        if self.equations.singular:
            constant -= constant.mean()
        self._solve()
        if self.equations.singular:
            constant -= constant.mean()
