"""Obstacles as outlines: their shadows seen from above or from the side."""

from collections.abc import Callable
from typing import Any

import numpy as np
from contourpy import contour_generator
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle, PathPatch, Polygon, Rectangle
from matplotlib.path import Path as Outline

from taichi_plume.grid.floor_plans import FloorPlan
from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.shapes import Ball, Shape, UprightBox, UprightCylinder, UprightPrism
from taichi_plume.report import look
from taichi_plume.report.look import ABOVE

MOST_RECTANGLES = 20_000  # of a map's walls: of more, pixels are joined
SECTION_NODES = 200  # per axis, at which the section of a mesh is looked for in 2-D


def solid(axes: Axes, one: Any, plane: tuple[int, int]) -> Any:
    """An obstacle; an outline of its shadow along the third axis."""
    style = {"facecolor": look.SOLID, "edgecolor": look.SOLID_EDGE, "linewidth": 0.9, "zorder": 4}
    if _is_cubes(one):
        places = one.visible([np.inf] * len(one.solid.shape))
        corners = np.unique(np.round(places[:, list(plane)] - one.size / 2, 6), axis=0)
        return axes.add_collection(
            PatchCollection(
                [Rectangle(tuple(corner), one.size, one.size) for corner in corners],
                facecolor=look.SOLID,
                edgecolor="none",
                zorder=4,
            )
        )
    return axes.add_patch(OUTLINES.get(type(one), _bounds)(one, plane, style))


def _is_cubes(one: Any) -> bool:
    """Whether it is the occupancy of an imported wind (`files.gaden.Cubes`, which would bring Taichi)."""
    return hasattr(one, "visible")


def _bounds(one: Shape, plane: tuple[int, int], style: dict[str, Any]) -> Any:
    """The rectangle around it, which an upright body fills when seen from the side."""
    low, high = one.low[list(plane)], one.high[list(plane)]
    return Rectangle((low[0], low[1]), high[0] - low[0], high[1] - low[1], **style)


def _box(one: Any, plane: tuple[int, int], style: dict[str, Any]) -> Any:
    if plane != ABOVE:
        return _bounds(one, plane, style)
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return Polygon(one.center + (signs * one.half) @ one.axes.T, **style)


def _cylinder(one: Any, plane: tuple[int, int], style: dict[str, Any]) -> Any:
    return Circle(tuple(one.center), one.radius, **style) if plane == ABOVE else _bounds(one, plane, style)


def _prism(one: Any, plane: tuple[int, int], style: dict[str, Any]) -> Any:
    return Polygon(one.vertices, **style) if plane == ABOVE else _bounds(one, plane, style)


def _ball(one: Any, plane: tuple[int, int], style: dict[str, Any]) -> Any:
    return Circle(tuple(one.center[list(plane)]), one.radius, **style)


def _mesh(one: Any, plane: tuple[int, int], style: dict[str, Any]) -> Any:
    """The shadow of a mesh: all its triangles, turned one way, as one path; of a flat run its section."""
    if len(one.low) == 2:
        return _section(one, style)
    corners = one.vertices[one.triangles][..., list(plane)]
    sides = corners[:, 1:] - corners[:, :1]
    clockwise = sides[:, 0, 0] * sides[:, 1, 1] < sides[:, 0, 1] * sides[:, 1, 0]
    corners[clockwise] = corners[clockwise][:, ::-1]
    points = np.concatenate([corners, corners[:, :1]], axis=1).reshape(-1, 2)
    codes = np.tile([Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY], len(corners))
    return PathPatch(Outline(points, codes), **style | {"edgecolor": look.SOLID, "linewidth": 0.3})


def _section(one: Any, style: dict[str, Any]) -> Any:
    """Where the plane of a flat run cuts a mesh."""
    pad = 0.02 * (one.high - one.low).max()
    x, y = (
        np.linspace(low - pad, high + pad, SECTION_NODES) for low, high in zip(one.low, one.high, strict=True)
    )
    places = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1)
    lines: Any = contour_generator(x, y, one.signed_distance(places)).lines(0.0)
    if not lines:
        return _bounds(one, ABOVE, style)
    return PathPatch(Outline.make_compound_path(*(Outline(line, closed=True) for line in lines)), **style)


def _plan(one: Any, plane: tuple[int, int], style: dict[str, Any]) -> Any:
    """The walls of a map, seen from above."""
    walls = one.rectangles(MOST_RECTANGLES)
    if plane != ABOVE or not len(walls):
        return _bounds(one, plane, style)
    x, y = walls[:, [0, 2, 2, 0, 0]], walls[:, [1, 1, 3, 3, 1]]
    codes = np.tile([Outline.MOVETO, *[Outline.LINETO] * 3, Outline.CLOSEPOLY], len(walls))
    style = style | {"edgecolor": look.SOLID, "linewidth": 0.2}
    return PathPatch(Outline(np.stack([x, y], axis=-1).reshape(-1, 2), codes), **style)


OUTLINES: dict[type, Callable[[Any, tuple[int, int], dict[str, Any]], Any]] = {
    UprightBox: _box,
    UprightCylinder: _cylinder,
    UprightPrism: _prism,
    Ball: _ball,
    Solid: _mesh,
    FloorPlan: _plan,
}
"""How obstacles of each shape are drawn; others by the rectangle around them."""


def name(axes: Axes, one: Any) -> None:
    """Kind and size of an obstacle, below it."""
    if _is_cubes(one):
        return
    model = one.model
    if hasattr(model, "radius"):
        text = f"{model.kind} ⌀ {2 * model.radius:.3g}"
    else:
        size = getattr(model, "size", one.high - one.low)
        text = f"{model.kind} {' × '.join(f'{edge:.3g}' for edge in size)}"
    height = getattr(model, "height", None)
    text += (f", {height:.3g} high" if height is not None and len(one.low) == 3 else "") + " m"
    if model.motion is not None:
        text += ", walks"
    look.note(axes, (one.low[0] + one.high[0]) / 2, one.low[1], text, look.SOLID_EDGE, va="top", dy=-3)
