"""Obstacles as signed distances: boxes, cylinders, prisms and balls.

Distances are in m, negative inside; points are (..., 2) in a 2-D run and (..., 3) in a 3-D run. The distances of these
shapes are exact. A ground robot can touch the shadow of a shape: the part between two heights, seen from above.

Each shape has one outline and one mesh, which reports, recordings and drawn rooms only style.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import cos, inf, radians, sin, sqrt
from typing import Any

import numpy as np

from taichi_plume.grid.outlines import CORNERS, SIDES, Mesh, ball, circle, extruded, faceted, rectangle

FINER = 2  # nodes per cell and axis at which distances are taken, to cut cells
TIE = 1e-4  # cells: a point this close to a surface counts as outside, in spite of rounding
CLEARANCE_STEP = 0.01  # m, the finest grid of a clearance map
CLEARANCE_NODES = 400_000
MOST_RECTANGLES = 20_000  # of an outline in blocks
MOST_BOXES = 5000  # of a mesh in blocks
ABOVE = (0, 1)
"""Axes of the plane of a projection seen from above."""


class ShapeError(ValueError):
    """Error of an obstacle's file that is missing or unusable; the message begins with the file's name."""


class Shape(ABC):
    """Shape of an obstacle. model: scenario section, None for an imported wind; low, high: bounding box (dim,) [m]."""

    model: Any = None
    low: np.ndarray
    high: np.ndarray

    @abstractmethod
    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """Return the distance [m] of points (..., dim) to the surface, negative inside the obstacle."""

    @abstractmethod
    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Return the distance [m] of points (..., 2) from the shadow of the part with low < z < high; infinite if none.

        In a 2-D run heights do not matter.
        """

    def footprint(self, corners: int) -> np.ndarray:
        """Return an anticlockwise polygon (n, 2) [m], the outline seen from above; corners: of a round one.

        By default, the rectangle around the obstacle.
        """
        return rectangle(self.low[:2], self.high[:2])

    def outline(self, plane: tuple[int, int]) -> list[np.ndarray]:
        """Return polygons (n, 2) [m] of the projection on a plane of two axes, each closed by its first corner.

        Polygons around holes turn the other way: the non-zero winding rule fills the projection.
        """
        seen_from_above = plane == ABOVE
        return [
            self.footprint(CORNERS) if seen_from_above else rectangle(self.low[[*plane]], self.high[[*plane]])
        ]

    def mesh(self, size: tuple[float, float, float]) -> Mesh:
        """Return the surface in a room of this size [m]; in 2-D obstacles reach from the floor to the ceiling."""
        base, top = (0.0, size[2]) if len(self.low) == 2 else (self.low[2], min(self.high[2], size[2]))
        return extruded(self.footprint(SIDES), base, top)

    def shares(self, shape: tuple[int, ...], dx: float) -> tuple[np.ndarray, list[np.ndarray]] | None:
        """Return the air fractions of cells of edge dx [m] and of their faces per axis; None to use the distances."""
        return None

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Return a mask of the points (..., dim) inside the obstacle."""
        return self.signed_distance(points) < 0.0


class Upright(Shape):
    """Obstacle with a footprint, in 3-D extruded from z = `base` to `top` [m]."""

    def __init__(self, model: Any, dim: int, low: np.ndarray, high: np.ndarray, base: float, top: float):
        self.model, self.base, self.top = model, base, top
        self.low = np.append(low, base)[:dim]
        self.high = np.append(high, top)[:dim]

    @abstractmethod
    def footprint_distance(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distance [m] of points (..., 2) to the outline of the footprint."""

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        across = self.footprint_distance(points[..., :2])
        if len(self.low) == 2:
            return across
        along = np.maximum(self.base - points[..., 2], points[..., 2] - self.top)
        outside = np.hypot(np.maximum(across, 0.0), np.maximum(along, 0.0))
        return outside + np.minimum(np.maximum(across, along), 0.0)

    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Return the distance [m] from points (..., 2) to the footprint, if the shape reaches between these heights."""
        if len(self.low) == 3 and (self.base >= high or self.top <= low):
            return np.full(points.shape[:-1], inf)
        return self.footprint_distance(points)


class UprightBox(Upright):
    """Box obstacle turned about the vertical."""

    def __init__(self, model: Any, dim: int):
        self.center = np.array(model.center[:2])
        self.half = np.array(model.size[:2]) / 2
        self.axes = rotation(model.yaw_deg)
        reach = np.abs(self.axes) @ self.half
        z, height = (model.center[2], model.size[2]) if dim == 3 else (0.0, 0.0)
        super().__init__(model, dim, self.center - reach, self.center + reach, z - height / 2, z + height / 2)

    def footprint_distance(self, points: np.ndarray) -> np.ndarray:
        beyond = np.abs((points - self.center) @ self.axes) - self.half
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)

    def footprint(self, corners: int) -> np.ndarray:
        return self.center + rectangle(-self.half, self.half) @ self.axes.T


class UprightCylinder(Upright):
    """Cylinder obstacle with a vertical axis."""

    def __init__(self, model: Any, dim: int, ceiling: float):
        self.center, self.radius = np.array(model.center), model.radius
        top = ceiling if model.height is None else model.base + model.height
        low, high = self.center - self.radius, self.center + self.radius
        super().__init__(model, dim, low, high, model.base, top)

    def footprint_distance(self, points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - self.center, axis=-1) - self.radius

    def footprint(self, corners: int) -> np.ndarray:
        return circle(self.center, self.radius, corners)


class UprightPrism(Upright):
    """Prism obstacle over a simple polygon, in either sense of rotation."""

    def __init__(self, model: Any, dim: int, ceiling: float):
        self.vertices = np.array(model.vertices)
        top = ceiling if model.height is None else model.base + model.height
        super().__init__(model, dim, self.vertices.min(axis=0), self.vertices.max(axis=0), model.base, top)

    def footprint_distance(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distance [m] to the polygon; a ray from inside crosses it an odd number of times."""
        squared = np.full(points.shape[:-1], inf)
        odd = np.zeros(points.shape[:-1], bool)
        x, y = points[..., 0], points[..., 1]
        for a, b in zip(self.vertices, np.roll(self.vertices, -1, axis=0), strict=True):
            side = b - a
            along = np.clip((points - a) @ side / max(side @ side, 1e-300), 0.0, 1.0)
            squared = np.minimum(squared, ((points - a - along[..., None] * side) ** 2).sum(axis=-1))
            if a[1] != b[1]:
                odd ^= ((a[1] > y) != (b[1] > y)) & (x < a[0] + (y - a[1]) * side[0] / side[1])
        return np.where(odd, -1.0, 1.0) * np.sqrt(squared)

    def footprint(self, corners: int) -> np.ndarray:
        x, y = self.vertices.T
        anticlockwise = x @ np.roll(y, -1) > y @ np.roll(x, -1)
        return self.vertices if anticlockwise else self.vertices[::-1]


class Ball(Shape):
    """Sphere obstacle, in 2-D a disc."""

    def __init__(self, model: Any, dim: int):
        self.model = model
        self.center, self.radius = np.array(model.center[:dim]), model.radius
        self.low, self.high = self.center - self.radius, self.center + self.radius

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - self.center, axis=-1) - self.radius

    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Return the distance [m] of points (..., 2) to the widest disc between these heights; infinite if none."""
        z = self.center[2] if len(self.center) == 3 else low
        squared = self.radius**2 - (z - np.clip(z, low, high)) ** 2
        if squared <= 0:
            return np.full(points.shape[:-1], inf)
        return np.linalg.norm(points - self.center[:2], axis=-1) - sqrt(squared)

    def footprint(self, corners: int) -> np.ndarray:
        return circle(self.center[:2], self.radius, corners)

    def outline(self, plane: tuple[int, int]) -> list[np.ndarray]:
        return [circle(self.center[[*plane]], self.radius)]

    def mesh(self, size: tuple[float, float, float]) -> Mesh:
        return ball(self.center, self.radius) if len(self.center) == 3 else super().mesh(size)


class Blocks(Shape):
    """Obstacle made of boxes along the axes."""

    @abstractmethod
    def boxes(self, most: int, size: Sequence[float] = (inf, inf, inf)) -> np.ndarray:
        """Return lower and upper corners (n, 2, dim) [m] of at most about `most` boxes in a room of this size [m]."""

    def outline(self, plane: tuple[int, int]) -> list[np.ndarray]:
        flat = np.unique(np.round(self.boxes(MOST_RECTANGLES)[..., [*plane]], 6), axis=0)
        return [rectangle(low, high) for low, high in flat]

    def boxes_in(self, size: tuple[float, float, float]) -> np.ndarray:
        """Return the boxes in a room as corners (n, 2, 3) [m]; in 2-D they reach from the floor to the ceiling."""
        boxes = self.boxes(MOST_BOXES, size)
        upright = np.broadcast_to([[0.0], [size[2]]], (len(boxes), 2, 3 - boxes.shape[2]))
        boxes = np.clip(np.concatenate([boxes, upright], axis=2), 0.0, size)
        return boxes[(boxes[:, 1] > boxes[:, 0]).all(axis=1)]

    def mesh(self, size: tuple[float, float, float]) -> Mesh:
        parts = [extruded(rectangle(low[:2], high[:2]), low[2], high[2]) for low, high in self.boxes_in(size)]
        return faceted(
            np.concatenate([part.vertices[part.triangles] for part in parts] or [np.empty((0, 3, 3))])
        )


def rotation(yaw_deg: float) -> np.ndarray:
    """Return the horizontal axes of a body turned by `yaw_deg` about the vertical, as columns (2, 2)."""
    c, s = cos(radians(yaw_deg)), sin(radians(yaw_deg))
    return np.array([[c, -s], [s, c]])


def clearance_resolution(extent: tuple[float, ...]) -> float:
    """Return the spacing [m] of the nodes of a clearance map, whose error is up to √2 times this."""
    return max(CLEARANCE_STEP, sqrt(extent[0] * extent[1] / CLEARANCE_NODES))
