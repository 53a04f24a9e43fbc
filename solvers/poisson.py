"""The Poisson equation of the pressure projection: sum over faces of a (phi_I - phi_neighbour) = b.

`a` is the open fraction of a face: 0 closed, 1 open, 2 on the domain's boundary with phi = 0 (Dirichlet) on the face.
All arrays have one ghost layer, axis 0 contiguous, and three axes in any dimension.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from taichi_plume.grid.grid import Grid


@dataclass(frozen=True)
class OpenFractions:
    """Open fractions of the faces, the coefficients of the Poisson equation: per axis an array with a ghost layer."""

    a: tuple[np.ndarray, ...]
    periodic: tuple[bool, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of inner cells along each of three axes."""
        return tuple(m - 2 for m in self.a[0].shape)

    @staticmethod
    def of(fractions: tuple[np.ndarray, ...], grid: Grid) -> "OpenFractions":
        """Return the coefficients for padded arrays of open fractions, one per axis; free domain faces become 2."""
        beyond = 3 - grid.dim  # axes missing in a 2-D grid
        n = (*grid.shape, *(1,) * beyond)
        result = [np.zeros(tuple(m + 2 for m in n), np.float32) for _ in range(3)]
        for d, source in enumerate(fractions):
            inner = [slice(b, e + (axis == d)) for axis, (b, e) in enumerate(grid.cells)]
            faces = source[tuple(inner)].astype(np.float32)
            if not grid.periodic[d]:
                faces = np.moveaxis(faces.copy(), d, 0)
                faces[0] *= 2.0
                faces[-1] *= 2.0
                faces = np.moveaxis(faces, 0, d)
            index = tuple(slice(1, 1 + m) for m in faces.shape) + (1,) * beyond
            result[d][index] = faces
        return OpenFractions(tuple(result), (*grid.periodic, *(False,) * beyond))

    def coarser(self) -> "OpenFractions":
        """Return the open fractions of merged pairs of cells (multigrid coarsening); a coarse face is the mean of its
        fine faces. An axis of a single cell stays: its faces weigh four times as much as those of axes whose spacing
        doubled.
        """
        factor = [2 if n > 1 else 1 for n in self.shape]
        shape = [-(-n // f) for n, f in zip(self.shape, factor, strict=True)]
        result = []
        for d in range(3):
            fine = self.a[d]
            planes = np.minimum(np.arange(shape[d] + 1) * factor[d], self.shape[d]) + 1
            coarse = np.take(fine, planes, axis=d)
            for e in range(3):
                if e != d:
                    inner = np.moveaxis(coarse, e, 0)[1:-1]
                    missing = np.zeros((shape[e] * factor[e] - len(inner), *inner.shape[1:]), inner.dtype)
                    inner = np.concatenate([inner, missing]).reshape(shape[e], factor[e], *inner.shape[1:])
                    coarse = np.moveaxis(inner.mean(axis=1), 0, e)
            if factor[d] == 1:
                coarse = coarse * 4.0
            padded = np.zeros([n + 2 for n in shape], np.float32)
            padded[tuple(slice(1, 1 + n) for n in coarse.shape)] = coarse
            result.append(padded)
        return OpenFractions(tuple(result), self.periodic)

    def matrix(self) -> sp.csr_array:
        """Return the sparse matrix of the equations (axis 0 fastest); the rows of closed-off cells are empty."""
        shape = self.shape
        number = np.arange(np.prod(shape)).reshape(shape, order="F")
        total = len(number.ravel())
        inner = tuple(slice(1, 1 + n) for n in shape)
        result = sp.csr_array((total, total))
        for d in range(3):
            low = self.a[d][inner]
            high = np.roll(self.a[d], -1, axis=d)[inner]
            result += sp.diags_array((low + high).ravel(order="F"))
            below = np.roll(number, 1, axis=d)
            linked = low > 0
            if not self.periodic[d]:
                np.moveaxis(linked, d, 0)[0] = False
            i, j, a = number[linked], below[linked], low[linked]
            link = sp.csr_array((a, (i, j)), shape=(total, total))
            result -= link + link.T
        return sp.csr_array(result)
