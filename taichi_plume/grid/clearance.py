"""Clearance map for collision detection: distance from the floor's points to the next surface, a lower bound."""

from collections.abc import Sequence
from math import ceil, sqrt
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from taichi_plume.engine import ti
from taichi_plume.grid.fields import corner
from taichi_plume.grid.geometry_cache import geometry_cached
from taichi_plume.grid.shapes import Shape, clearance_resolution

if TYPE_CHECKING:
    from taichi_plume.grid.layers import Layers

FAR = 1e6  # m, clearance without obstacles


@geometry_cached
def _lower_bounds(
    shapes: Sequence[Shape],
    low: tuple[float, float],
    nodes: tuple[int, int],
    resolution: float,
    ranges: Sequence[tuple[float, float]],
) -> np.ndarray:
    """Return lower bounds of the distances [m] of the nodes to obstacles, (ranges, *nodes)."""
    axes = [start + np.arange(n) * resolution for start, n in zip(low, nodes, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = np.full((len(ranges), *nodes), FAR)
    for layer, reach in zip(values, ranges, strict=True):
        for shape in shapes:
            np.minimum(layer, shape.horizontal_distance(points, *reach), out=layer)
    return values - resolution / sqrt(2)


class HorizontalDistances:
    """Distance to the edges of the floor (exact) and to obstacles (a lower bound), for several ranges of height.

    low, high: corners of the floor [m]; ranges: (lower, upper end) of each range of height k [m]. Obstacle distances
    are stored on nodes `resolution` [m] apart. As the slope of a distance is at most 1, the bilinear value exceeds the
    truth by at most resolution/√2 (at the middle of four nodes), which is subtracted.
    """

    def __init__(
        self,
        shapes: Sequence[Shape],
        low: Sequence[float],
        high: Sequence[float],
        resolution: float,
        ranges: Sequence[tuple[float, float]],
    ):
        self.low, self.high = (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))
        self.has_obstacles = bool(shapes)
        size = (self.high[0] - self.low[0], self.high[1] - self.low[1])
        self.resolution = resolution if shapes else max(size)
        across, along = (max(2, ceil(length / self.resolution - 1e-9) + 1) for length in size)
        self.nodes = across, along
        self._values = _lower_bounds(shapes, self.low, self.nodes, self.resolution, ranges)
        self.values = ti.filled(self._values)

    @ti.func
    def distance(self, p, k=0):
        """Return a lower bound of the distance [m] from p (x, y) to the next surface in range k; < 0 in obstacles."""
        distance = self.wall(p)[0]
        if ti.static(self.has_obstacles):
            distance = ti.min(distance, self._obstacle(p, k)[0])
        return distance

    @ti.func
    def normal(self, p, k=0):
        """Return the unit vector away from the surface nearest to p (x, y) in the range of height k."""
        wall = self.wall(p)
        away = ti.Vector([wall[1], wall[2]])
        if ti.static(self.has_obstacles):
            obstacle = self._obstacle(p, k)
            gradient = ti.Vector([obstacle[1], obstacle[2]])
            steepness = gradient.norm()
            if obstacle[0] < wall[0] and steepness > 1e-6:
                away = gradient / steepness
        return away

    @ti.func
    def wall(self, p):
        """Return the distance [m] from p to the nearest edge of the floor, and the edge's inward normal (x, y)."""
        result = ti.Vector([p[0] - self.low[0], 1.0, 0.0])
        if self.high[0] - p[0] < result[0]:
            result = ti.Vector([self.high[0] - p[0], -1.0, 0.0])
        if p[1] - self.low[1] < result[0]:
            result = ti.Vector([p[1] - self.low[1], 0.0, 1.0])
        if self.high[1] - p[1] < result[0]:
            result = ti.Vector([self.high[1] - p[1], 0.0, -1.0])
        return result

    @ti.func
    def _obstacle(self, p, k):
        """Return a lower bound of the distance [m] from p to obstacles in range k, and its bilinear gradient."""
        I, w = corner(p - ti.Vector(self.low), (0.0, 0.0), self.resolution, 0, self.nodes)
        v00, v10 = self.values[k, I[0], I[1]], self.values[k, I[0] + 1, I[1]]
        v01, v11 = self.values[k, I[0], I[1] + 1], self.values[k, I[0] + 1, I[1] + 1]
        lower, upper = v00 + w[0] * (v10 - v00), v01 + w[0] * (v11 - v01)
        along_x = (1.0 - w[1]) * (v10 - v00) + w[1] * (v11 - v01)
        return ti.Vector([lower + w[1] * (upper - lower), along_x, upper - lower])

    def distance_at(self, points: np.ndarray, k: int = 0) -> np.ndarray:
        """Return the clearance [m] of points (..., 2) in the range of height k, as `distance` but on the host."""
        points = np.asarray(points, float)
        walls = np.minimum(points - np.array(self.low), np.array(self.high) - points).min(axis=-1)
        return np.minimum(walls, self.obstacle_distance_at(points, k))

    def obstacle_distance_at(self, points: np.ndarray, k: int = 0) -> np.ndarray:
        """Return the distance [m] from points (..., 2) to obstacles alone; off the floor, from its nearest point."""
        where = (np.asarray(points, float) - np.array(self.low)).reshape(-1, 2).T / self.resolution
        distances = ndimage.map_coordinates(self._values[k], where, order=1, mode="nearest")
        return distances.reshape(points.shape[:-1])


class ClearanceMap(HorizontalDistances):
    """Clearance of the floor: distance from points to the next edge or obstacle, for collisions of ground robots.

    Only the parts of obstacles between `base`, the floor, and `body_height` [m] above it count. low, high: corners of
    the floor [m]. layers: maps for flying robots, None without drones.
    """

    layers: "Layers | None" = None

    def __init__(
        self,
        shapes: list[Shape],
        high: tuple[float, ...],
        body_height: float,
        resolution: float | None = None,
        low: tuple[float, ...] = (0.0, 0.0),
        base: float = 0.0,
    ):
        size = (float(high[0]) - float(low[0]), float(high[1]) - float(low[1]))
        resolution = resolution or clearance_resolution(size)
        super().__init__(shapes, low, high, resolution, [(base, base + body_height)])
        self.shapes = shapes

    def solid_distance_at(self, points: np.ndarray) -> np.ndarray:
        """Return the distance [m] from points (..., 3) to obstacles, negative inside."""
        distances = [shape.signed_distance(points) for shape in self.shapes]
        return np.min(distances, axis=0) if distances else np.full(np.shape(points)[:-1], FAR)
