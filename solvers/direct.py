"""Direct solvers of the Poisson equation of the pressure projection: sparse LU factors, and FFTs of empty boxes."""

from collections.abc import Sequence
from math import prod
from typing import Any

import numpy as np
import scipy.fft
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from taichi_plume.engine.fields import Field
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import FEW_CELLS
from taichi_plume.solvers.poisson import OpenFractions

DENSE = 100  # cells of an axis up to which a product with a matrix takes less than a fast transform


class Balance:
    """Compatibility of the right side: subtracts its mean in each closed part of the air, so that a solution exists.

    part: number of the connected part of the air for each cell; floating: whether phi = 0 nowhere touches a part.
    """

    def __init__(self, part: np.ndarray, floating: np.ndarray):
        self.part, self.floating = part, floating
        self.any = bool(floating.any())
        self.size = np.maximum(np.bincount(part, minlength=len(floating)), 1)

    def excess(self, right: np.ndarray) -> np.ndarray:
        """Return the mean to subtract from the right side in each cell (cells,): 0 in parts that are not floating."""
        mean = np.bincount(self.part, right, len(self.floating)) / self.size
        return np.where(self.floating, mean, 0.0)[self.part]


class SparseFactors:
    """Poisson solver by sparse LU factors, computed once (SuperLU, Li 2005, doi:10.1145/1089014.1089017)."""

    def __init__(self, fractions: OpenFractions, grid: Grid):
        self.grid = grid
        matrix = fractions.matrix()
        self.air = np.flatnonzero(matrix.diagonal() > 0)
        matrix = matrix[self.air][:, self.air]
        count, region = connected_components(matrix, directed=False)
        grounded = np.zeros(count, bool)
        np.logical_or.at(grounded, region, matrix.sum(axis=1) > 1e-6)
        self.balance = Balance(region, ~grounded)
        first = np.unique(region, return_index=True)[1]
        pins = np.zeros(len(self.air))
        pins[first[~grounded]] = 1.0
        matrix = (matrix + sp.diags_array(pins)).tocsc()
        options = {"SymmetricMode": True}
        self.lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        self.iterations = 1

    def solve(self, b: Field, phi: Field, tolerance: float) -> None:
        """Solve the Poisson equation for the right side b into the inner cells of phi, exactly for any tolerance."""
        del tolerance
        right = self.grid.read(b).ravel(order="F")[self.air].astype(np.float64)
        if self.balance.any:
            right -= self.balance.excess(right)
        flat = np.zeros(int(np.prod(self.grid.shape)), np.float32)
        flat[self.air] = self.lu.solve(right)
        self.grid.write(phi, flat.reshape(self.grid.shape, order="F"))


class FastTransforms:
    """Poisson solver of a box without obstacles: cosine, sine and Fourier transforms diagonalise the equations.

    Each face of the domain must be closed, free or periodic as a whole. Closed ends are even, free ends odd about the
    domain's face, which is half a cell from the first centre: types II and IV (Strang 1999,
    doi:10.1137/S0036144598336745).
    """

    def __init__(self, kinds: Sequence[str], grid: Grid):
        """Prepare the transforms; kinds: closed, free, periodic, closed-free or free-closed per axis."""
        self.grid = grid
        self.iterations = 1
        self.kinds = tuple(kinds)
        self.workers = 1 if prod(grid.shape) <= FEW_CELLS else -1
        self.options: dict[str, Any] = {"overwrite_x": True, "workers": self.workers}
        eigenvalues = np.zeros(grid.shape)
        for d, kind in enumerate(kinds):
            line = 2.0 - 2.0 * np.cos(angles(kind, grid.shape[d]))
            eigenvalues = eigenvalues + line.reshape([-1 if a == d else 1 for a in range(grid.dim)])
        constant = eigenvalues < 1e-12  # only differences of phi count: its mean stays zero
        self.singular = bool(constant.any())
        self.eigenvalues = np.where(constant, np.inf, eigenvalues)
        inverse = (1.0 / self.eigenvalues).astype(np.float32).T  # axes reversed, as `Grid.read` returns them
        self.wrapped = [grid.dim - 1 - d for d, kind in enumerate(kinds) if kind == "periodic"]
        if self.wrapped:  # a real Fourier transform returns half of its last axis
            last = self.wrapped[-1]
            inverse = np.take(inverse, np.arange(inverse.shape[last] // 2 + 1), axis=last)
        self.inverse = np.ascontiguousarray(inverse)
        self.dense: dict[int, list[np.ndarray]] = {}
        self.transforms: dict[tuple[bool, int], list[int]] = {}  # (odd at the lower end, type): axes
        for d, kind in enumerate(kinds):
            if kind != "periodic" and grid.shape[d] <= DENSE:
                self.dense[d] = self.matrices(d)
            elif kind != "periodic":
                self.transforms.setdefault(_type(kind), []).append(grid.dim - 1 - d)

    def matrices(self, d: int) -> list[np.ndarray]:
        """Return the matrices of the transform and its inverse along axis d, which must not be periodic."""
        odd, kind = _type(self.kinds[d])
        make = (scipy.fft.dst, scipy.fft.idst) if odd else (scipy.fft.dct, scipy.fft.idct)
        return [transform(np.eye(self.grid.shape[d]), kind, axis=0).astype(np.float32) for transform in make]

    def forward(self, x: np.ndarray) -> np.ndarray:
        """Transform x, f32 with the grid's axes reversed, and return the amplitudes of its modes; may overwrite x."""
        for d, (there, _) in self.dense.items():
            x = along(there, x, d)
        for (odd, kind), axes in self.transforms.items():
            x = np.asarray((scipy.fft.dstn if odd else scipy.fft.dctn)(x, kind, None, axes, **self.options))
        return np.asarray(scipy.fft.rfftn(x, None, self.wrapped, workers=self.workers)) if self.wrapped else x

    def backward(self, x: np.ndarray) -> np.ndarray:
        """Return the values for amplitudes x of the modes, the inverse of `forward`; x may be overwritten."""
        if self.wrapped:
            shape = [self.grid.shape[::-1][d] for d in self.wrapped]
            x = np.asarray(scipy.fft.irfftn(x, shape, self.wrapped, **self.options))
        for (odd, kind), axes in self.transforms.items():
            x = np.asarray((scipy.fft.idstn if odd else scipy.fft.idctn)(x, kind, None, axes, **self.options))
        for d, (_, back) in self.dense.items():
            x = along(back, x, d)
        return x

    def solve(self, b: Field, phi: Field, tolerance: float) -> None:
        """Solve the Poisson equation for the right side b into the inner cells of phi, exactly for any tolerance."""
        del tolerance
        waves = self.forward(self.grid.read(b).T)
        waves *= self.inverse
        self.grid.write(phi, self.backward(waves).T)


def _type(kind: str) -> tuple[bool, int]:
    """Return whether the modes of an axis of this kind are odd at its lower end, and the type of their transform."""
    return kind.startswith("free"), 4 if "-" in kind else 2


class Window:
    """Transforms between the modes of a box and selected cells only.

    Dense matrices over only the rows, columns and layers with selected cells; with a periodic axis, transforms of the
    whole box.
    """

    def __init__(self, box: FastTransforms, cells: np.ndarray, sources: np.ndarray):
        """Prepare the matrices; cells: indices of cells to read; sources: of cells with sources, axis 0 fastest."""
        self.box, shape = box, box.grid.shape
        self.whole = bool(box.wrapped)
        self.cells, self.sources = cells, sources
        if self.whole:
            return
        every = np.union1d(cells, sources)
        used = [np.unique(i) for i in np.unravel_index(every, shape, order="F")]
        self.shape = tuple(len(i) for i in reversed(used))
        self.cells, self.sources = (self._place(c, used, shape) for c in (cells, sources))
        self.to, self.back = [], []
        for d, i in enumerate(used):
            forward, backward = box.matrices(d)
            self.to.append(np.ascontiguousarray(forward[:, i]))
            self.back.append(np.ascontiguousarray(backward[i]))

    @staticmethod
    def _place(cells: np.ndarray, used: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
        """Return the indices of cells in the array of the `used` rows, columns and layers."""
        where = np.unravel_index(cells, shape, order="F")
        inside = [np.searchsorted(u, w) for u, w in zip(used, where, strict=True)]
        return np.ravel_multi_index(inside, [len(u) for u in used], order="F")

    def values(self, waves: np.ndarray) -> np.ndarray:
        """Return the values in `cells` for these amplitudes of the modes."""
        if self.whole:
            return self.box.backward(waves.copy()).reshape(-1)[self.cells]
        for d, matrix in enumerate(self.back):
            waves = along(matrix, waves, d)
        return waves.reshape(-1)[self.cells]

    def waves(self, sources: np.ndarray) -> np.ndarray:
        """Return the amplitudes of the modes for these source strengths in the cells `sources`."""
        x = np.zeros(self.box.grid.shape[::-1] if self.whole else self.shape, np.float32)
        x.reshape(-1)[self.sources] = sources
        if self.whole:
            return self.box.forward(x)
        for d in reversed(range(x.ndim)):
            x = along(self.to[d], x, d)
        return x


def along(matrix: np.ndarray, x: np.ndarray, d: int) -> np.ndarray:
    """Return x multiplied by a matrix along the grid's axis d; x has the axes of the grid in reversed order."""
    if d == 0:
        return x @ matrix.T
    shape = x.shape
    axis = len(shape) - 1 - d
    result = matrix @ x.reshape(*shape[: axis + 1], -1)
    return result.reshape(*shape[:axis], len(matrix), *shape[axis + 1 :])


def angles(kind: str, n: int) -> np.ndarray:
    """Return the phase per cell [rad] of each mode of an axis of n cells, in the order of its transform."""
    if kind == "periodic":
        return 2.0 * np.pi * np.fft.fftfreq(n)
    return np.pi * (np.arange(n) + {"closed": 0.0, "free": 1.0}.get(kind, 0.5)) / n
