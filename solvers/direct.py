"""Direct solvers of the Poisson equation of the projection: sparse factors, and fast transforms of empty boxes."""

from collections.abc import Sequence
from math import prod
from typing import Any

import numpy as np
import scipy.fft
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import FEW_CELLS
from taichi_plume.solvers.poisson import Openness


class SparseFactors:
    """Sparse LU factors of the equations, made once (SuperLU, Li 2005, doi:10.1145/1089014.1089017)."""

    def __init__(self, openness: Openness, grid: Grid):
        self.grid = grid
        matrix = openness.matrix()
        self.air = np.flatnonzero(matrix.diagonal() > 0)
        matrix = matrix[self.air][:, self.air]
        count, self.region = connected_components(matrix, directed=False)
        grounded = np.zeros(count, bool)
        np.logical_or.at(grounded, self.region, matrix.sum(axis=1) > 1e-6)
        self.floating = ~grounded[self.region]  # cells of regions that phi = 0 nowhere touches
        self.size = np.bincount(self.region)
        first = np.unique(self.region, return_index=True)[1]
        pins = np.zeros(len(self.air))
        pins[first[~grounded]] = 1.0
        matrix = (matrix + sp.diags_array(pins)).tocsc()
        options = {"SymmetricMode": True}
        self.lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        self.iterations = 1

    def solve(self, b: Any, phi: Any, tolerance: float) -> None:
        """Set the inner cells of field phi to the solution for field b; exact, whatever the tolerance."""
        del tolerance
        right = self.grid.read(b).ravel(order="F")[self.air].astype(np.float64)
        if self.floating.any():  # solvable only without a net source
            mean = np.bincount(self.region, right) / self.size
            right -= np.where(self.floating, mean[self.region], 0.0)
        flat = np.zeros(int(np.prod(self.grid.shape)), np.float32)
        flat[self.air] = self.lu.solve(right)
        self.grid.write(phi, flat.reshape(self.grid.shape, order="F"))


class FastTransforms:
    """Cosine, sine and Fourier transforms that make the equations of a box without obstacles diagonal.

    Each face of the domain must be closed, free or periodic as a whole. Closed ends are even, free ends odd about the
    domain's face, which is half a cell from the first centre: types II and IV (Strang 1999,
    doi:10.1137/S0036144598336745).
    """

    def __init__(self, kinds: Sequence[str], grid: Grid):
        """kinds: closed, free, periodic, closed-free or free-closed per axis."""
        self.grid = grid
        self.iterations = 1
        self.kinds = tuple(kinds)
        self.workers = 1 if prod(grid.shape) <= FEW_CELLS else -1
        eigenvalues = np.zeros(grid.shape)
        for d, kind in enumerate(kinds):
            line = 2.0 - 2.0 * np.cos(angles(kind, grid.shape[d]))
            eigenvalues = eigenvalues + line.reshape([-1 if a == d else 1 for a in range(grid.dim)])
        constant = eigenvalues < 1e-12  # only differences of phi count: its mean stays zero
        self.singular = bool(constant.any())
        self.eigenvalues = np.where(constant, np.inf, eigenvalues)
        inverse = (1.0 / self.eigenvalues).astype(np.float32).T  # axes reversed, as `Grid.read` returns them
        self.wrapped = [grid.dim - 1 - d for d, kind in enumerate(kinds) if kind == "periodic"]
        if self.wrapped:  # a real Fourier transform keeps half of its last axis
            last = self.wrapped[-1]
            inverse = np.take(inverse, np.arange(inverse.shape[last] // 2 + 1), axis=last)
        self.inverse = np.ascontiguousarray(inverse)
        self.transforms: dict[tuple[bool, int], list[int]] = {}  # (odd at the lower end, type): axes
        for d, kind in enumerate(kinds):
            if kind != "periodic":
                key = kind.startswith("free"), 4 if "-" in kind else 2
                self.transforms.setdefault(key, []).append(grid.dim - 1 - d)

    def apply(self, x: Any) -> Any:
        """The solution for the right side x, f32 of the grid's shape reversed; x is overwritten."""
        options = {"workers": self.workers, "overwrite_x": True}
        for (odd, kind), axes in self.transforms.items():
            x = (scipy.fft.dstn if odd else scipy.fft.dctn)(x, type=kind, axes=axes, **options)
        if self.wrapped:
            shape = [x.shape[d] for d in self.wrapped]
            waves: Any = scipy.fft.rfftn(x, axes=self.wrapped, workers=self.workers)
            waves *= self.inverse
            x = scipy.fft.irfftn(waves, s=shape, axes=self.wrapped, **options)
        else:
            x *= self.inverse
        for (odd, kind), axes in self.transforms.items():
            x = (scipy.fft.idstn if odd else scipy.fft.idctn)(x, type=kind, axes=axes, **options)
        return x

    def solve(self, b: Any, phi: Any, tolerance: float) -> None:
        """Set the inner cells of field phi to the solution for field b; exact to rounding, whatever the tolerance."""
        del tolerance
        self.grid.write(phi, self.apply(self.grid.read(b).T).T)


def angles(kind: str, n: int) -> np.ndarray:
    """Phase per cell of the modes of a box's axis of n cells, in the order of its transform."""
    if kind == "periodic":
        return 2.0 * np.pi * np.fft.fftfreq(n)
    return np.pi * (np.arange(n) + {"closed": 0.0, "free": 1.0}.get(kind, 0.5)) / n
