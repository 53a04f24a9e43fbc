"""Matrices between clusters of cells that act on one another from afar: blocks, and a remainder of low rank.

The potential of one obstacle at another is that of a few multipoles, so that the blocks between them have ranks of
about ten (Hackbusch 1999, doi:10.1007/s006070050015).
"""

from itertools import pairwise

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

GAP = 3.0  # largest distance of neighbours in one cluster [cells]
MOST_CLUSTERS = 8
UNDIVIDED = 500  # cells up to which a matrix stays in the cache of the processor
RANK = 48  # largest rank of the blocks of a cluster with all others


def clusters(cells: np.ndarray) -> np.ndarray:
    """Return the number of the cluster of each cell (n, dim). Cells of one obstacle, or of obstacles within GAP, share
    a cluster; below UNDIVIDED cells all numbers are 0.
    """
    if len(cells) < UNDIVIDED:
        return np.zeros(len(cells), int)
    pairs = KDTree(cells).query_pairs(GAP, output_type="ndarray")
    links = sp.csr_array((np.ones(len(pairs), np.int8), pairs.T), shape=(len(cells),) * 2)
    _, part = connected_components(links, directed=False)
    sizes = np.bincount(part)
    order = np.argsort(np.bincount(part, cells[:, 0]) / sizes, kind="stable")
    middle = np.cumsum(sizes[order]) - 0.5 * sizes[order]
    merged = np.empty(len(sizes), int)
    merged[order] = middle * MOST_CLUSTERS // len(cells)
    return np.unique(merged[part], return_inverse=True)[1]


class ClusterMatrix:
    """Matrix (n, n), f32, as its diagonal blocks and a product of two narrow matrices, `left @ right`."""

    def __init__(self, matrix: np.ndarray, sizes: np.ndarray):
        """Split a matrix into blocks of these sizes, unless more than two thirds of the memory would remain."""
        self.blocks, self.left = [(slice(None), matrix)], np.zeros((0, 0), np.float32)
        self.right = self.left
        if 3 * (sizes**2).sum() >= 2 * matrix.size:
            return
        ends = np.concatenate([[0], np.cumsum(sizes)])
        rows = [slice(a, b) for a, b in pairwise(ends)]
        tolerance, factors = 3e-7 * np.abs(matrix).max(), []
        for r in rows:
            others = matrix[r].copy()
            others[:, r] = 0.0
            factors.append(_low_rank(others, tolerance))
        entries = (sizes**2).sum() + 2 * len(matrix) * sum(len(right) for _, right, _ in factors)
        if all(exact for _, _, exact in factors) and 3 * entries < 2 * matrix.size:
            self.blocks = [(r, np.ascontiguousarray(matrix[r, r])) for r in rows]
            self.left = np.asarray(scipy.linalg.block_diag(*(left for left, _, _ in factors)))
            self.right = np.concatenate([right for _, right, _ in factors])

    def times(self, x: np.ndarray) -> np.ndarray:
        """Return the product with a vector (n,), f32."""
        result = np.empty_like(x)
        for rows, block in self.blocks:
            np.matmul(block, x[rows], out=result[rows])
        if self.left.size:
            result += self.left @ (self.right @ x)
        return result


def _low_rank(matrix: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray, bool]:
    """Return factors (m, r) and (r, n) of a matrix, r at most RANK, and whether their product is within a tolerance
    (Halko, Martinsson & Tropp 2011, doi:10.1137/090771806).
    """
    samples = np.random.default_rng(0).standard_normal((matrix.shape[1], RANK), np.float32)
    basis = np.linalg.qr(matrix @ samples)[0]
    left, weights, right = np.linalg.svd(basis.T @ matrix, full_matrices=False)
    r = np.count_nonzero(weights > tolerance)
    left, right = basis @ left[:, :r], weights[:r, None] * right[:r]
    return left, right, bool(np.abs(left @ right - matrix).max() < tolerance)
