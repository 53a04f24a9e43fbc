"""Geometry of drawn obstacles: their outlines, and handles for corners, rims, heights, turning and way points."""

from functools import cached_property
from math import atan2, degrees, hypot
from typing import Any

import numpy as np

from taichi_plume.draw.parts import (
    LEAST,
    SIGNS,
    Outline,
    Part,
    Plane,
    Point,
    Values,
    dragged,
    moved_point,
    pair,
    size_text,
)
from taichi_plume.grid.floor_plans import FloorPlan
from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.outlines import rectangle
from taichi_plume.grid.shapes import Shape, rotation
from taichi_plume.report.theme import ABOVE
from taichi_plume.scenario.obstacles import Box, Cylinder, Mesh, Prism, Round, WallMap

ARM = 0.25  # m from an obstacle's edge to the handle that turns the obstacle
MOST_CORNERS = 80_000  # of an outline: more are drawn as the rectangle around


class Body(Part):
    """An obstacle, by its shape; below a path of way points if the obstacle walks."""

    def __init__(self, model: Any, room: tuple[float, ...], shape: Shape):
        keys = (
            ("vertices",)
            if isinstance(model, Prism)
            else ("translate",)
            if isinstance(model, Mesh)
            else ("center",)
        )
        super().__init__(model, room, () if isinstance(model, WallMap) else keys)
        self.shape = shape
        self.walks = model.motion is not None

    def _span(self, plane: Plane) -> tuple[list[float], list[float]]:
        low, high = (np.nan_to_num(end, posinf=max(self.room)) for end in (self.shape.low, self.shape.high))
        return [float(low[d]) for d in plane], [float(high[d]) for d in plane]

    def outlines(self, plane: Plane) -> list[Outline]:
        parts = self.shape.outline(plane)
        if not parts or sum(map(len, parts)) > MOST_CORNERS:
            parts = [rectangle(*self._span(plane))]
        gap = np.full((1, 2), np.nan)
        joined = np.concatenate([corners for part in parts for corners in (gap, part)][1:])
        way = self._way(plane)
        return [
            Outline(np.minimum(joined, 10 * max(self.room))),
            *([Outline(way, False)] if len(way) else []),
        ]

    def outline_at(self, t: float, plane: Plane) -> Outline:
        shift = np.zeros(3)
        shift[:2] = np.subtract(self.model.motion.place(self.model.center, t), self.model.center[:2])
        return Outline(self.outlines(plane)[0].points + shift[list(plane)])

    def _way(self, plane: Plane) -> np.ndarray:
        motion = self.model.motion
        if motion is None or plane != ABOVE:
            return np.empty((0, 2))
        return np.array([self.model.center[:2], *(point[1:] for point in motion.path)], float)

    @cached_property
    def _own_box(self) -> np.ndarray:
        """Lower and upper corner (2, 2) [m] of a mesh from above, in axes that turn with it, from its origin."""
        assert isinstance(self.shape, Solid)
        own = (self.shape.vertices[:, :2] - self.model.translate[:2]) @ rotation(self.model.yaw_deg)
        return np.array([own.min(axis=0), own.max(axis=0)])

    def turned(self, yaw_deg: float) -> Values:
        """Return the new values of keys of a box or a mesh at another angle [degrees]; its middle stays."""
        if not isinstance(self.model, Mesh):
            return {"yaw_deg": yaw_deg}
        shift = (rotation(self.model.yaw_deg) - rotation(yaw_deg)) @ self._own_box.mean(axis=0)
        return {"yaw_deg": yaw_deg, "translate": moved_point(self.model.translate, np.append(shift, 0.0))}

    def handles(self, plane: Plane) -> dict[str, Point]:
        model, (low, high) = self.model, self._span(plane)
        middle = (np.array(low) + high) / 2
        if isinstance(model, Mesh) and plane == ABOVE:
            middle = model.translate[:2] + rotation(model.yaw_deg) @ self._own_box.mean(axis=0)
        handles = {"center": pair(middle)}
        if plane != ABOVE:
            if not isinstance(model, Mesh | WallMap):
                handles["+0+1"] = (handles["center"][0], high[1])
            if isinstance(model, Box | Cylinder | Prism):
                handles["+0-1"] = (handles["center"][0], low[1])
            return handles
        if model.motion is not None:
            handles |= {f"way {n}": pair(point[1:]) for n, point in enumerate(model.motion.path)}
        if isinstance(model, Prism):
            handles |= {key: pair(corner) for key, corner in self.points.items()}
        if isinstance(model, Round):
            handles["rim"] = (model.center[0] + model.disc, model.center[1])
        if isinstance(model, Box):
            turned, half = rotation(model.yaw_deg), np.array(model.size[:2]) / 2
            handles |= {f"{i:+d}{j:+d}": pair(model.center[:2] + turned @ (half * (i, j))) for i, j in SIGNS}
        if isinstance(model, Box | Mesh):
            reach = (model.size[0] if isinstance(model, Box) else np.ptp(self._own_box, axis=0)[0]) / 2 + ARM
            handles["turn"] = pair(middle + rotation(model.yaw_deg) @ (reach, 0))
        return handles

    def moved(self, handle: str, plane: Plane, to: Point) -> Values:
        model = self.model
        if handle == "center" or handle in self.points:
            return super().moved(handle, plane, to)
        if handle == "turn":
            x, y = self.handles(plane)["center"]
            return self.turned(float(round(degrees(atan2(to[1] - y, to[0] - x)), 1)))
        if handle.startswith("way "):
            return {f"motion.path[{handle[4:]}][{1 + d}]": float(to[d]) for d in range(2)}
        if handle == "rim":
            return {"radius": max(LEAST, hypot(to[0] - model.center[0], to[1] - model.center[1]))}
        if plane != ABOVE:
            return self._heightened(handle, plane, to)
        local = rotation(-model.yaw_deg) @ np.subtract(to, model.center[:2])
        half = np.array(model.size[:2]) / 2
        low, high = dragged(pair(-half), pair(half), handle, pair(local))
        middle = rotation(model.yaw_deg) @ np.add(low, high) / 2
        center = [float(x) for x in model.center]
        center[:2] = [float(x) for x in model.center[:2] + middle]
        return {
            "center": center,
            "size": [*(b - a for a, b in zip(low, high, strict=True)), *map(float, model.size[2:])],
        }

    def measure(self, handle: str, plane: Plane) -> str:
        if handle == "turn":
            return f"{self.model.yaw_deg:g}°"
        if handle == "rim":
            return f"radius {self.model.radius:.2f} m"
        if handle[0] in "+-" and plane == ABOVE:
            return size_text(self.model.size[:2])  # along the edges of a box that is turned
        return super().measure(handle, plane)

    def _heightened(self, handle: str, plane: Plane, to: Point) -> Values:
        """Return new heights: the upper or the lower end has been dragged in a view from the side."""
        low, high = self._span(plane)
        (_, bottom), (_, top) = dragged(low, high, handle, to)
        model = self.model
        if isinstance(model, Box):
            return {
                "center": [*map(float, model.center[:2]), (bottom + top) / 2],
                "size": [*map(float, model.size[:2]), top - bottom],
            }
        if isinstance(model, Cylinder | Prism):
            return ({"base": bottom} if handle.endswith("-1") else {}) | {"height": top - bottom}
        return {"radius": max(LEAST, top - float(model.center[-1]))}

    def shifted(self, by: np.ndarray) -> Values:
        model = self.model
        if isinstance(model, WallMap):
            at = model.origin or (self.shape.reach[0] if isinstance(self.shape, FloorPlan) else (0.0, 0.0))
            return {"origin": [float(at[0] - by[0]), float(at[1] - by[1])]}
        values = super().shifted(by)
        if isinstance(model, Cylinder | Prism) and by[2]:
            values["base"] = max(0.0, model.base + float(by[2]))
        if model.motion is not None:
            for n, (_, x, y) in enumerate(model.motion.path):
                values |= {f"motion.path[{n}][{1 + d}]": float(z + by[d]) for d, z in enumerate((x, y))}
        return values
