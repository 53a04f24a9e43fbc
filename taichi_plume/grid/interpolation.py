"""Linear interpolation from points in any order to a lattice (moving least squares).

Points that fill a lattice are interpolated along each axis, other points by moving least squares: the best linear fit
to the nearest points, weighted by the inverse square of their distance (Lancaster & Salkauskas 1981,
doi:10.1090/S0025-5718-1981-0616367-1). Both are of second order and extrapolate a little beyond the points.
"""

from collections.abc import Callable, Sequence

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import make_interp_spline
from scipy.spatial import cKDTree  # type: ignore[attr-defined]

SAME = 2e-5  # tolerance over the largest extent: files have five or six digits
STEEPEST = 3.0  # sum of absolute weights, above which the plain mean takes over: far beyond the points
CHUNK = 1 << 16  # number of positions whose weights are computed at a time

Axes = Sequence[np.ndarray]
"""Coordinates [m] along each axis of a lattice."""


def lattice_of(place: np.ndarray) -> tuple[list[np.ndarray], np.ndarray] | None:
    """Return the axes of the lattice that points (n, k) fill, and their order on it, last axis fastest; else None."""
    tie = SAME * float(np.ptp(place, axis=0).max())
    axes, steps = [], []
    for x in place.T:
        order = np.argsort(x)
        step = np.concatenate([[0], np.cumsum(np.diff(x[order]) > tie)])
        number = np.empty(len(x), int)
        number[order] = step
        axes.append(np.bincount(number, x) / np.bincount(number))
        if np.abs(x - axes[-1][number]).max() > tie:
            return None
        steps.append(number)
    shape = tuple(len(axis) for axis in axes)
    if min(shape) < 2 or np.prod([float(n) for n in shape]) != len(place):
        return None
    cell = np.ravel_multi_index(steps, shape)
    order = np.argsort(cell)
    return (axes, order) if np.array_equal(cell[order], np.arange(len(place))) else None


class Interpolation:
    """Linear interpolation from points (n, k) [m] to a lattice. Axes along which all points coincide do not count.

    positions: of all points; used: axes that count; lattice: axes of the lattice that the points fill, or None; apart:
    distance of each scattered point to the next one [m].
    """

    def __init__(self, place: np.ndarray):
        extent = np.ptp(place, axis=0)
        self.positions, self.used = place, np.flatnonzero(extent > SAME * extent.max())
        self.place = place[:, self.used]
        lattice = lattice_of(self.place)
        self.lattice, self.apart = None, np.zeros(0)
        if lattice is None:
            self.tree = cKDTree(self.place)
            self.apart = self.tree.query(self.place, k=2)[0][:, 1]
        else:
            self.lattice, self.order = lattice

    def onto(self, axes: Axes) -> Callable[[np.ndarray], np.ndarray]:
        """Return a function from values at the points (n,) to values on the lattice `axes`, one dimension per axis."""
        shape = tuple(len(axis) for axis in axes)
        targets = [axes[int(a)] for a in self.used]
        level = [n if a in self.used else 1 for a, n in enumerate(shape)]
        if self.lattice is not None:
            order, places = self.order, self.lattice

            def along_axes(values: np.ndarray) -> np.ndarray:
                result = values[order].reshape([len(axis) for axis in places])
                for a, (known, x) in enumerate(zip(places, targets, strict=True)):
                    result = make_interp_spline(known, result, k=1, axis=a)(x)
                return np.broadcast_to(result.reshape(level), shape)

            return along_axes
        grid = np.stack(np.meshgrid(*targets, indexing="ij"), axis=-1).reshape(-1, len(targets))
        weights = sp.vstack([self._weights(grid[n : n + CHUNK]) for n in range(0, len(grid), CHUNK)]).tocsr()
        return lambda values: np.broadcast_to((weights @ values).reshape(level), shape)

    def _weights(self, places: np.ndarray) -> sp.csr_array:
        """Return the weights of all points in the values at positions (m, k), as a sparse row per position."""
        dim = places.shape[1]
        count = min(2**dim + 4, len(self.place))
        distance, near = self.tree.query(places, k=range(1, count + 1), workers=-1)
        scale = np.maximum(distance[:, -1:], 1e-12)
        offset = (self.place[near] - places[:, None]) / scale[..., None]
        closeness = 1.0 / ((distance / scale) ** 2 + 1e-9)
        closeness /= closeness.sum(axis=1, keepdims=True)
        basis = np.concatenate([np.ones((*near.shape, 1)), offset], axis=-1)
        weighted = closeness[..., None] * basis
        moments = np.matrix_transpose(weighted) @ basis
        moments[:, range(1, dim + 1), range(1, dim + 1)] += 1e-9
        first = np.zeros((len(places), dim + 1, 1))
        first[:, 0] = 1.0
        fit = np.linalg.solve(moments, first)
        weights = (weighted @ fit)[..., 0]
        size = np.abs(weights).sum(axis=1, keepdims=True)
        share = np.minimum(1.0, (STEEPEST - 1.0) / np.maximum(size - 1.0, 1e-12))
        weights = closeness + share * (weights - closeness)
        rows = np.repeat(np.arange(len(places)), count)
        return sp.csr_array((weights.ravel(), (rows, near.ravel())), shape=(len(places), len(self.place)))
