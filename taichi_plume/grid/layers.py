"""Clearance at several altitudes, for collisions of drones: distance to surfaces beside, above and below a body."""

from math import ceil, sqrt
from typing import Any

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.clearance import ClearanceMap, HorizontalDistances
from taichi_plume.grid.shapes import Shape, Upright, clearance_resolution

MOST_LAYERS = 64
MOST_NODES = 4_000_000
STEP = 0.05  # m of altitude between two layers of a shape that differs with height
INSIDE = 1e-6  # m: overlap below which a shape only touches a range of heights
SAME = 1e-5  # m: levels this close are merged


class Layers(HorizontalDistances):
    """Clearance per altitude layer: lower bound of the distance from an upright body in layer k to the next surface.

    A surface counts if it reaches between the body's lower and upper end. floor: the map of the floor, whose edges are
    walls at all heights. ceiling [m]; body_height [m]: of the tallest body that flies. levels (n,) [m]: lower ends of
    the layers, for the altitude of a body's lower end. Levels lie at the ends of upright shapes, so that a body passes
    close above and below these; elsewhere levels are STEP apart, or more, up to MOST_LAYERS levels.
    """

    def __init__(self, shapes: list[Shape], floor: ClearanceMap, ceiling: float, body_height: float):
        self.ceiling, self.body_height = float(ceiling), float(body_height)
        self._levels = levels(shapes, self.ceiling, self.body_height)
        self.count = len(self._levels)
        size = (floor.high[0] - floor.low[0], floor.high[1] - floor.low[1])
        resolution = max(clearance_resolution(size), sqrt(size[0] * size[1] * self.count / MOST_NODES))
        tops = [*self._levels[1:], self.ceiling]
        ranges = [
            (bottom + INSIDE, top + self.body_height - INSIDE)
            for bottom, top in zip(self._levels, tops, strict=True)
        ]
        super().__init__(shapes, floor.low, floor.high, resolution, ranges)
        self.levels: Any = ti.filled(self._levels)

    @ti.func
    def index(self, z):
        """Return the layer of a body whose lower end is at the altitude z [m]."""
        k = 0
        for n in range(1, self.count):
            k += ti.cast(z >= self.levels[n], ti.i32)
        return k

    def distance_above(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Return the least clearance [m] of points (..., 2) at altitudes from low to high [m], on the host."""
        first, last = np.searchsorted(self._levels, (low, high), side="right") - 1
        return np.min([self.distance_at(points, k) for k in range(first, last + 1)], axis=0)


def levels(shapes: list[Shape], ceiling: float, body_height: float) -> np.ndarray:
    """Return the lower ends of altitude layers, (n,) [m], from 0 on; body_height: of the tallest flying body [m]."""
    heights = [0.0]
    for shape in shapes:
        low, high = float(shape.low[2]) - body_height, float(shape.high[2])
        low, high = max(low, 0.0), min(high, ceiling)
        steps = 1 if isinstance(shape, Upright) else max(1, ceil((high - low) / STEP))
        heights += np.linspace(low, high, steps + 1).tolist()
    result = np.unique([z for z in heights if 0.0 <= z < ceiling])
    result = result[np.diff(result, prepend=-1.0) > SAME]
    if len(result) > MOST_LAYERS:
        result = np.linspace(0.0, ceiling, MOST_LAYERS, endpoint=False)
    return result
