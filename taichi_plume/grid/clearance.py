"""How far a robot on the floor is from the next surface."""

from math import ceil, sqrt
from typing import Any

import numpy as np
import taichi as ti
from scipy import ndimage

from taichi_plume.grid.fields import corner
from taichi_plume.grid.shapes import Shape, clearance_resolution
from taichi_plume.grid.transfer import uploader

FAR = 1e6  # m, clearance where there is no obstacle


@ti.data_oriented
class ClearanceMap:
    """How far a point of the floor is from the next edge of it or obstacle: never more than the truth.

    Obstacles count as far as they reach between `base`, the floor, and `body_height` [m] above it. Their distances are
    kept on nodes `resolution` [m] apart. As a distance changes by at most the way walked, the bilinear value exceeds
    the truth by no more than resolution/√2 (at the middle of four nodes), which is taken off. Edges: exact.
    low, high: corners of the floor [m]. layers: maps for those who fly, None where nobody does.
    """

    layers: Any = None

    def __init__(
        self,
        shapes: list[Shape],
        high: tuple[float, ...],
        body_height: float,
        resolution: float | None = None,
        low: tuple[float, ...] = (0.0, 0.0),
        base: float = 0.0,
    ):
        self.low, self.high = (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))
        self.stands = bool(shapes)  # whether there is any obstacle
        size = (self.high[0] - self.low[0], self.high[1] - self.low[1])
        resolution = resolution or clearance_resolution(size)
        self.resolution = resolution if shapes else max(size)
        self.nodes = tuple(max(2, ceil(length / self.resolution - 1e-9) + 1) for length in size)
        axes = [low + np.arange(n) * self.resolution for low, n in zip(self.low, self.nodes, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        self._values = np.full(self.nodes, FAR)
        for one in shapes:
            self._values = np.minimum(self._values, one.horizontal_distance(points, base, base + body_height))
        self._values -= self.resolution / sqrt(2)
        self.values = ti.field(ti.f32, self.nodes)
        uploader(self.values)(self._values)

    @ti.func
    def distance(self, p):
        """Distance [m] from p (x, y) to the next surface, or a little less; negative inside an obstacle."""
        distance = self.wall(p)[0]
        if ti.static(self.stands):
            distance = ti.min(distance, self._obstacle(p)[0])
        return distance

    @ti.func
    def normal(self, p):
        """Unit vector away from the surface next to p."""
        wall = self.wall(p)
        away = ti.Vector([wall[1], wall[2]])
        if ti.static(self.stands):
            away = away_from(wall, self._obstacle(p))
        return away

    def distance_at(self, points: np.ndarray) -> np.ndarray:
        """What `distance` gives [m], for points (..., 2) on the host."""
        points = np.asarray(points, float)
        walls = np.minimum(points - np.array(self.low), np.array(self.high) - points).min(axis=-1)
        return np.minimum(walls, self.obstacle_distance_at(points))

    def obstacle_distance_at(self, points: np.ndarray) -> np.ndarray:
        """The same from obstacles alone, for points (..., 2) anywhere; off the floor, what it is at its next point."""
        where = (np.asarray(points, float) - np.array(self.low)).reshape(-1, 2).T / self.resolution
        standing = ndimage.map_coordinates(self._values, where, order=1, mode="nearest")
        return standing.reshape(points.shape[:-1])

    @ti.func
    def wall(self, p):
        """Distance [m] to the next edge of the floor and its normal."""
        result = ti.Vector([p[0] - self.low[0], 1.0, 0.0])
        if self.high[0] - p[0] < result[0]:
            result = ti.Vector([self.high[0] - p[0], -1.0, 0.0])
        if p[1] - self.low[1] < result[0]:
            result = ti.Vector([p[1] - self.low[1], 0.0, 1.0])
        if self.high[1] - p[1] < result[0]:
            result = ti.Vector([self.high[1] - p[1], 0.0, -1.0])
        return result

    @ti.func
    def _obstacle(self, p):
        """Distance [m] to the next obstacle, or a little less, and its gradient."""
        I, w = corner(p - ti.Vector(self.low), (0.0, 0.0), self.resolution, 0, self.nodes)
        v00, v10 = self.values[I[0], I[1]], self.values[I[0] + 1, I[1]]
        v01, v11 = self.values[I[0], I[1] + 1], self.values[I[0] + 1, I[1] + 1]
        return between(v00, v10, v01, v11, w)


@ti.func
def between(v00, v10, v01, v11, w):
    """Bilinear value between four nodes, of weights w, and its gradient over their distance."""
    lower, upper = v00 + w[0] * (v10 - v00), v01 + w[0] * (v11 - v01)
    along_x = (1.0 - w[1]) * (v10 - v00) + w[1] * (v11 - v01)
    return ti.Vector([lower + w[1] * (upper - lower), along_x, upper - lower])


@ti.func
def away_from(wall, obstacle):
    """Unit vector away from the nearer of the two: each the distance [m] and its gradient, a wall's of unit length."""
    away = ti.Vector([wall[1], wall[2]])
    gradient = ti.Vector([obstacle[1], obstacle[2]])
    steepness = gradient.norm()
    if obstacle[0] < wall[0] and steepness > 1e-6:
        away = gradient / steepness
    return away
