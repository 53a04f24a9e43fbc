"""Points in the plane with values, looked up on the device through bins (cell lists, neighbour search).

The host sorts the points into the bins of a lattice (counting sort). Bins are at least as wide as the reach of a
look-up, which thus visits 3 x 3 bins, a row of three at a time.
"""

from math import ceil, prod, sqrt

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.kernels import Template

MOST_BINS = 65_536
NEAREST, FARTHEST = 1e-6, 1e6  # m: limits of a reach, whose square must fit in f32
CORNER = 0.25  # weight of a lattice's last node half a cell beyond it along both axes
SLACK = 1.001  # of a bin's width: the device finds bins of positions in f32


class PointCloud:
    """Cloud of points with values, to be looked up from positions in [0, extent] (x, y) [m].

    reach [m]: points count below this distance; values: number of values per point; capacity: largest number of points.
    Fields: points sorted by bins, with position, value and order (original number); first: first point of each bin.
    """

    STATE = ("first", "order", "place", "value")

    def __init__(self, extent: tuple[float, ...], reach: float, values: int, capacity: int):
        self.extent, self.values = np.array(extent[:2]), values
        self.reach = min(max(reach, NEAREST), FARTHEST)
        self.edge = max(SLACK * self.reach, sqrt(float(self.extent.prod()) / MOST_BINS))
        self.bins = tuple(max(1, ceil(width / self.edge)) for width in self.extent)
        self.capacity = max(1, capacity)
        self.first: Field = ti.field(ti.i32, prod(self.bins) + 1)
        self.order: Field = ti.field(ti.i32, self.capacity)
        self.place: Field = ti.vector_field(2, ti.f32, self.capacity)
        self.value: Field = ti.vector_field(values, ti.f32, self.capacity)

    def set(self, place: np.ndarray, value: np.ndarray) -> None:
        """Replace all points by points (n, 2) [m] with values (n, values); those out of reach are left out."""
        near = np.flatnonzero(within_reach(place, self.extent, self.reach))
        place, value = place[near], value[near]
        column, row = (np.clip((place[:, d] / self.edge).astype(int), 0, self.bins[d] - 1) for d in range(2))
        bins = row * self.bins[0] + column
        sort = np.argsort(bins, kind="stable")
        counts = np.bincount(bins, minlength=prod(self.bins))
        self.first.from_numpy(np.concatenate([[0], np.cumsum(counts)]))
        for field, of_each in ((self.order, sort), (self.place, place[sort]), (self.value, value[sort])):
            rows = np.zeros((self.capacity, *of_each.shape[1:]))
            rows[: len(sort)] = of_each
            field.from_numpy(rows)

    @ti.func
    def _bins(self, x: Template, d: Template):
        """Return the first and the last bin along axis d that may hold points within reach of x."""
        middle = ti.math.clamp(ti.cast(ti.floor(x[d] / self.edge), ti.i32), 0, self.bins[d] - 1)
        return ti.max(middle - 1, 0), ti.min(middle + 1, self.bins[d] - 1)

    @ti.func
    def nearest(self, x: Template):
        """Return the values of the point nearest to x within `reach`, of equally near ones the first; else zero."""
        best, winner = ti.cast(self.reach * self.reach, ti.f32), -1
        left, right = self._bins(x, 0)
        low, high = self._bins(x, 1)
        for row in range(low, high + 1):
            first = self.first[row * self.bins[0] + left]
            for k in range(first, self.first[row * self.bins[0] + right + 1]):
                r2 = (self.place[k] - ti.Vector([x[0], x[1]])).norm_sqr()
                if r2 < best or (
                    winner >= 0 and r2 == best and self.order[k] < self.order[ti.max(winner, 0)]
                ):
                    best, winner = r2, k
        result = ti.Vector.zero(ti.f32, self.values)
        if winner >= 0:
            result = self.value[winner]
        return result

    @ti.func
    def between(self, x: Template):
        """Return the mean of the values with weights (1 - |dx|/reach)(1 - |dy|/reach); 0 far from all points.

        On a lattice of spacing `reach` this is the bilinear interpolation. Up to half a cell beyond the last nodes, at
        the ends and corners of a domain with nodes at the cell centres, the result is still the mean.
        """
        total, share = ti.Vector.zero(ti.f32, self.values), 0.0
        left, right = self._bins(x, 0)
        low, high = self._bins(x, 1)
        for row in range(low, high + 1):
            first = self.first[row * self.bins[0] + left]
            for k in range(first, self.first[row * self.bins[0] + right + 1]):
                gap = ti.abs(self.place[k] - ti.Vector([x[0], x[1]])) / self.reach
                w = ti.max(1.0 - gap[0], 0.0) * ti.max(1.0 - gap[1], 0.0)
                total += w * self.value[k]
                share += w
        return total / ti.max(share, CORNER)

    @ti.func
    def count(self, x: Template):
        """Return the number of points that are closer to x than `reach`."""
        found = 0
        left, right = self._bins(x, 0)
        low, high = self._bins(x, 1)
        for row in range(low, high + 1):
            first = self.first[row * self.bins[0] + left]
            for k in range(first, self.first[row * self.bins[0] + right + 1]):
                if (self.place[k] - ti.Vector([x[0], x[1]])).norm_sqr() < self.reach * self.reach:
                    found += 1
        return found


def within_reach(place: np.ndarray, extent: np.ndarray | tuple[float, ...], reach: float) -> np.ndarray:
    """Return a mask of the points (n, 2) [m] that are within `reach` of the rectangle [0, extent] (x, y)."""
    return np.all((place > -reach) & (place < np.asarray(extent)[:2] + reach), axis=1)
