"""Direct solvers of the Poisson equation of the pressure projection: sparse LU factors; transforms and
tridiagonal equations for empty boxes.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from math import prod

import numpy as np
import scipy.fft
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from taichi_plume.engine.fields import Field
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import FEW_CELLS
from taichi_plume.solvers.poisson import OpenFractions
from taichi_plume.solvers.tridiagonal import Amplitudes, Tridiagonal

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


class Modes:
    """Modes of an axis: real eigenvectors of its second differences, by cosine, sine and Fourier transforms.

    Closed ends are even, free ends odd about the domain's face, which is half a cell from the first centre: types II
    and IV (Strang 1999, doi:10.1137/S0036144598336745). The amplitudes of a periodic axis are the real parts of its
    Fourier transform, then the imaginary parts. All transforms are orthonormal.
    """

    def __init__(self, kind: str, n: int, workers: int):
        """Prepare the transforms of n values; kind: closed, free, periodic, closed-free or free-closed."""
        self.kind, self.n, self.workers = kind, n, workers
        phases = angles(kind, n)
        if kind == "periodic":
            phases = np.tile(phases[: n // 2 + 1], 2)
        self.eigenvalues = eigenvalues(phases)
        self.count = len(phases)

    @cached_property
    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrices of the transform (count, n) and of its inverse (n, count)."""
        there, back = self._forward(np.eye(self.n), 0), self._backward(np.eye(self.count), 0)
        return np.asfortranarray(there, np.float32), np.asfortranarray(back, np.float32)

    def forward(self, x: np.ndarray, axis: int, out: np.ndarray) -> None:
        """Write the amplitudes of values x along `axis`, the last one (-1) or the one before it (-2), to `out`."""
        if self.n <= DENSE:
            _multiply(self.matrices[0], x, axis, out)
        else:
            out[...] = self._forward(x, axis)

    def backward(self, x: np.ndarray, axis: int, out: np.ndarray) -> None:
        """Write the values for amplitudes x of the modes to `out`, the inverse of `forward`."""
        if self.n <= DENSE:
            _multiply(self.matrices[1], x, axis, out)
        else:
            out[...] = self._backward(x, axis)

    def _forward(self, x: np.ndarray, axis: int) -> np.ndarray:
        if self.kind == "periodic":
            waves = scipy.fft.rfft(x, axis=axis, norm="ortho", workers=self.workers)
            return np.concatenate([waves.real, waves.imag], axis)
        return self._mirrored(scipy.fft.dst if self._odd else scipy.fft.dct, x, axis)

    def _backward(self, x: np.ndarray, axis: int) -> np.ndarray:
        if self.kind == "periodic":
            real, imaginary = np.split(x, 2, axis)
            waves = real + 1j * imaginary
            return np.asarray(scipy.fft.irfft(waves, self.n, axis, norm="ortho", workers=self.workers))
        return self._mirrored(scipy.fft.idst if self._odd else scipy.fft.idct, x, axis)

    @property
    def _odd(self) -> bool:
        """Whether the modes are odd about the axis's lower end."""
        return self.kind.startswith("free")

    def _mirrored(self, transform: Callable, x: np.ndarray, axis: int) -> np.ndarray:
        return transform(x, 4 if "-" in self.kind else 2, axis=axis, norm="ortho", workers=self.workers)


def _multiply(matrix: np.ndarray, x: np.ndarray, axis: int, out: np.ndarray) -> None:
    if axis == -1:
        np.matmul(x, matrix.T, out=out)
    else:
        np.matmul(matrix, x, out=out)


class FastTransforms:
    """Poisson solver of a box without obstacles: transforms along all axes but the first, along which the equations of
    each mode are tridiagonal (Hockney 1965, doi:10.1145/321250.321259).

    Each face of the domain must be closed, free or periodic as a whole. waves, trial: two arrays of `Amplitudes` (modes
    of axis 2, cells of axis 0, modes of axis 1).
    """

    def __init__(self, kinds: Sequence[str], grid: Grid):
        """Prepare the transforms; kinds: closed, free, periodic, closed-free or free-closed per axis."""
        self.grid = grid
        self.iterations = 1
        self.kinds = tuple(kinds)
        workers = 1 if prod(grid.shape) <= FEW_CELLS else -1
        self.modes = [Modes(kind, n, workers) for kind, n in zip(kinds[1:], grid.shape[1:], strict=True)]
        layers = self.modes[1].eigenvalues if grid.dim == 3 else np.zeros(1)
        self.equations = Tridiagonal(kinds[0], grid.shape[0], layers[:, None] + self.modes[0].eigenvalues)
        self.singular = self.equations.singular  # without a free face only differences of phi count
        self.waves, self.trial = Amplitudes(self.equations), Amplitudes(self.equations)

    def rows(self, field: Field) -> np.ndarray:
        """Return a view of the inner cells of a field: axes reversed, in 2-D with a first axis of one layer."""
        inner = self.grid.inner(field.values).T
        return inner if self.grid.dim == 3 else inner[None]

    def forward(self, rows: np.ndarray) -> None:
        """Set `waves` to the amplitudes of values like `rows`; overwrites `trial`."""
        first, *second = self.modes
        waves = self.waves.values
        layers = self.trial.values[: len(rows)] if second else waves
        first.forward(rows.swapaxes(1, 2), -1, layers[..., : first.count])
        for modes in second:
            modes.forward(_flat(layers), -2, _flat(waves))

    def backward(self, rows: np.ndarray) -> None:
        """Set `rows` to the values for the amplitudes `waves`; overwrites `trial`."""
        first, *second = self.modes
        waves = self.waves.values
        layers = self.trial.values[: len(rows)] if second else waves
        for modes in second:
            modes.backward(_flat(waves), -2, _flat(layers))
        first.backward(layers[..., : first.count].swapaxes(1, 2), -2, rows)

    def solve(self, b: Field, phi: Field, tolerance: float) -> None:
        """Solve the Poisson equation for the right side b into the inner cells of phi, exactly for any tolerance."""
        del tolerance
        self.forward(self.rows(b))
        self.waves.solve()
        self.backward(self.rows(phi))


def _flat(layers: np.ndarray) -> np.ndarray:
    return layers.reshape(len(layers), -1)


def angles(kind: str, n: int) -> np.ndarray:
    """Return the phase per cell [rad] of each mode of an axis of n cells, in the order of its transform."""
    if kind == "periodic":
        return 2.0 * np.pi * np.fft.fftfreq(n)
    return np.pi * (np.arange(n) + {"closed": 0.0, "free": 1.0}.get(kind, 0.5)) / n


def eigenvalues(angles: np.ndarray) -> np.ndarray:
    """Return the negative second differences of modes with these phases per cell [rad]."""
    return 2.0 - 2.0 * np.cos(angles)
