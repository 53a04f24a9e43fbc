"""Direct solvers of the Poisson equation of the projection: sparse factors, and fast transforms of empty boxes."""

from typing import Any

import numpy as np
import scipy.fft
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.poisson import Openness

TRANSFORMS = {"closed": (scipy.fft.dct, scipy.fft.idct), "free": (scipy.fft.dst, scipy.fft.idst)}
"""By the lower end of an axis: the transform and its inverse."""


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

    def __init__(self, openness: Openness, grid: Grid):
        self.grid = grid
        self.iterations = 1
        self.kinds = [self._kind(openness, d) for d in range(grid.dim)]
        eigenvalues = np.zeros(grid.shape)
        for d, kind in enumerate(self.kinds):
            n = grid.shape[d]
            k = np.arange(n) if kind != "periodic" else np.fft.fftfreq(n, 1.0 / n)
            shift = {"closed": 0.0, "free": 1.0, "closed-free": 0.5, "free-closed": 0.5, "periodic": 0.0}[
                kind
            ]
            angle = np.pi * (k + shift) / n * (2.0 if kind == "periodic" else 1.0)
            line = 2.0 - 2.0 * np.cos(angle)
            eigenvalues = eigenvalues + line.reshape([-1 if a == d else 1 for a in range(grid.dim)])
        constant = eigenvalues < 1e-12  # only differences of phi count: its mean stays zero
        inverse = np.where(constant, 0.0, 1.0 / np.where(constant, 1.0, eigenvalues)).astype(np.float32)
        self.wrapped = [d for d, kind in enumerate(self.kinds) if kind == "periodic"]
        if self.wrapped:  # a real Fourier transform keeps half of its last axis
            last = self.wrapped[-1]
            inverse = np.take(inverse, np.arange(grid.shape[last] // 2 + 1), axis=last)
        self.inverse = np.asfortranarray(inverse)

    @staticmethod
    def fits(openness: Openness, grid: Grid) -> bool:
        """Whether the box is empty and each of its faces is of one kind."""
        for d in range(grid.dim):
            n = openness.shape[d]
            inner = tuple(slice(1, 1 + m) for m in openness.shape)
            faces = np.moveaxis(openness.a[d][inner], d, 0)
            last = np.take(openness.a[d], n + 1, axis=d)[tuple(s for a, s in enumerate(inner) if a != d)]
            if np.any(faces[1:] != 1.0) or np.ptp(faces[0]) or np.ptp(last):
                return False
        return True

    @staticmethod
    def _kind(openness: Openness, d: int) -> str:
        if openness.periodic[d]:
            return "periodic"
        low, high = (np.take(openness.a[d], i, axis=d)[1, 1] > 0 for i in (1, openness.shape[d] + 1))
        if low == high:
            return "free" if low else "closed"
        return "free-closed" if low else "closed-free"

    def _transform(self, x: Any, inverse: bool) -> Any:
        """Along all axes that do not wrap round."""
        for d, kind in enumerate(self.kinds):
            if kind != "periodic":
                transform = TRANSFORMS[kind.split("-")[0]][inverse]
                x = transform(x, type=4 if "-" in kind else 2, axis=d, workers=-1)
        return x

    def solve(self, b: Any, phi: Any, tolerance: float) -> None:
        """Set the inner cells of field phi to the solution for field b; exact to rounding, whatever the tolerance."""
        del tolerance
        x: Any = self._transform(self.grid.read(b), inverse=False)
        if self.wrapped:
            shape = [x.shape[d] for d in self.wrapped]
            waves: Any = scipy.fft.rfftn(x, axes=self.wrapped, workers=-1)
            x = scipy.fft.irfftn(self.inverse * waves, s=shape, axes=self.wrapped, workers=-1)
        else:
            x = self.inverse * x
        self.grid.write(phi, self._transform(x, inverse=True))
