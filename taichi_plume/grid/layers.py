"""How far a body that flies is from the next surface beside it, above it and below it."""

from math import ceil, sqrt
from typing import Any

import numpy as np
import taichi as ti
from scipy import ndimage

from taichi_plume.grid.clearance import FAR, ClearanceMap, away_from, between
from taichi_plume.grid.fields import corner
from taichi_plume.grid.shapes import Shape, Upright, clearance_resolution
from taichi_plume.grid.transfer import uploader

MOST_LAYERS = 64
MOST_NODES = 4_000_000
STEP = 0.05  # m of altitude between two layers, where a shape is not the same at all heights
INSIDE = 1e-6  # m: what only touches a range of heights does not count
SAME = 1e-5  # m: levels this close are one


@ti.data_oriented
class Layers:
    """Clearance maps for ranges of altitude: how far an upright body somewhere in the range is from the next surface
    that reaches between its lower and its upper end, never more than the truth.

    floor: the map of the floor, whose edges are walls at all heights. ceiling [m]; body_height [m]: of the tallest body
    that flies. levels (n,) [m]: lower ends of the ranges, of the altitude of a body's lower end. They are those where
    upright shapes begin and end, so that a body passes close above and below these; elsewhere they are STEP apart, or
    as much as makes MOST_LAYERS of them.
    """

    def __init__(self, shapes: list[Shape], floor: ClearanceMap, ceiling: float, body_height: float):
        self.floor, self.ceiling, self.body_height = floor, float(ceiling), float(body_height)
        self.stands = bool(shapes)
        self._levels = levels(shapes, self.ceiling, self.body_height)
        self.count = len(self._levels)
        low, high = np.array(floor.low), np.array(floor.high)
        size = high - low
        self.resolution = max(
            clearance_resolution((size[0], size[1])), sqrt(float(np.prod(size)) * self.count / MOST_NODES)
        )
        if not shapes:
            self.resolution = float(size.max())
        self.nodes = tuple(max(2, ceil(length / self.resolution - 1e-9) + 1) for length in size)
        axes = [start + np.arange(n) * self.resolution for start, n in zip(low, self.nodes, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        self._values = np.full((self.count, *self.nodes), FAR)
        tops = [*self._levels[1:], self.ceiling]
        for layer, bottom, top in zip(self._values, self._levels, tops, strict=True):
            for one in shapes:
                reach = bottom + INSIDE, top + self.body_height - INSIDE
                np.minimum(layer, one.horizontal_distance(points, *reach), out=layer)
        self._values -= self.resolution / sqrt(2)
        self.values: Any = ti.field(ti.f32, self._values.shape)
        self.levels: Any = ti.field(ti.f32, self.count)
        uploader(self.values, self.levels)(self._values, self._levels)

    @ti.func
    def index(self, z):
        """The layer of a body whose lower end is at the altitude z [m]."""
        k = 0
        for n in range(1, self.count):
            k += ti.cast(z >= self.levels[n], ti.i32)
        return k

    @ti.func
    def distance(self, p, k):
        """Distance [m] from p (x, y) in layer k to the next surface beside it; negative inside an obstacle."""
        distance = self.floor.wall(p)[0]
        if ti.static(self.stands):
            distance = ti.min(distance, self._obstacle(p, k)[0])
        return distance

    @ti.func
    def normal(self, p, k):
        """Unit vector away from the surface next to p in layer k."""
        wall = self.floor.wall(p)
        away = ti.Vector([wall[1], wall[2]])
        if ti.static(self.stands):
            away = away_from(wall, self._obstacle(p, k))
        return away

    @ti.func
    def _obstacle(self, p, k):
        """Distance [m] to the next obstacle, or a little less, and its gradient."""
        I, w = corner(p - ti.Vector(self.floor.low), (0.0, 0.0), self.resolution, 0, self.nodes)
        v00, v10 = self.values[k, I[0], I[1]], self.values[k, I[0] + 1, I[1]]
        v01, v11 = self.values[k, I[0], I[1] + 1], self.values[k, I[0] + 1, I[1] + 1]
        return between(v00, v10, v01, v11, w)

    def distance_at(self, points: np.ndarray, z: float) -> np.ndarray:
        """What `distance` gives [m] at the altitude z [m], for points (..., 2) on the host."""
        points = np.asarray(points, float)
        low, high = np.array(self.floor.low), np.array(self.floor.high)
        walls = np.minimum(points - low, high - points).min(axis=-1)
        where = (points - low).reshape(-1, 2).T / self.resolution
        layer = self._values[int(np.searchsorted(self._levels, z, side="right")) - 1]
        standing = ndimage.map_coordinates(layer, where, order=1, mode="nearest")
        return np.minimum(walls, standing.reshape(points.shape[:-1]))


def levels(shapes: list[Shape], ceiling: float, body_height: float) -> np.ndarray:
    """Where layers begin, (n,) [m], from 0 on; body_height [m]: of what flies between the shapes."""
    found = [0.0]
    for one in shapes:
        low, high = float(one.low[2]) - body_height, float(one.high[2])
        low, high = max(low, 0.0), min(high, ceiling)
        steps = 1 if isinstance(one, Upright) else max(1, ceil((high - low) / STEP))
        found += np.linspace(low, high, steps + 1).tolist()
    result = np.unique([z for z in found if 0.0 <= z < ceiling])
    result = result[np.diff(result, prepend=-1.0) > SAME]
    if len(result) > MOST_LAYERS:
        result = np.linspace(0.0, ceiling, MOST_LAYERS, endpoint=False)
    return result
