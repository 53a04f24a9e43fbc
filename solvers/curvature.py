"""Curvature of the surfaces of obstacles, which tells convex (bluff) bodies from plane and concave walls."""

import numpy as np
from scipy.ndimage import correlate1d, uniform_filter1d

from taichi_plume.solvers.extension import REACH

# 1/cells: least curvature of a convex surface. Oblique planes that the grid cuts have up to 0.016.
CONVEX = 0.02


def curvatures(vectors: np.ndarray, cells: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the sum of the principal curvatures of the surface around the cells (n, dim), padded: (n,) [1/cells].

    The sum is positive where the obstacle is convex. The normals of a surface of curvature k turn by k s over a length
    s, so that the integral of n' s over all surface within REACH is -k times the integral of s².

    vectors: areas of the surface, (*padded, dim); normals: of the surface at each cell, (n, dim); both out of the air.
    """
    dim, where = vectors.shape[-1], tuple(cells.T)
    steps = np.arange(-REACH, REACH + 1.0)

    def over_window(values: np.ndarray, skipped: int = -1) -> np.ndarray:
        for axis in range(dim):
            if axis != skipped:
                values = uniform_filter1d(values, len(steps), axis=axis, mode="nearest")
        return values

    moments = np.empty((len(cells), dim, dim))  # of the areas' components i along the axes j
    for j in range(dim):
        along = correlate1d(vectors, steps / len(steps), axis=j, mode="nearest")
        moments[:, :, j] = over_window(along, skipped=j)[where]
    turning = np.einsum("ni,nij,nj->n", normals, moments, normals) - np.trace(moments, axis1=1, axis2=2)
    area = over_window(np.linalg.norm(vectors, axis=-1))[where]
    return turning / np.maximum(area * len(steps) ** 2 / 12.0, 1e-6)
