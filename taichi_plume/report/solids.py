"""Drawings of obstacles: outlines of their projections, seen from above or from the side."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Protocol, TypeGuard

import numpy as np
from contourpy import contour_generator
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle, Patch, PathPatch, Polygon, Rectangle
from matplotlib.path import Path as Outline
from matplotlib.transforms import Affine2D
from PIL import Image, ImageDraw

from taichi_plume.grid.floor_plans import FloorPlan
from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.shapes import Ball, Shape, UprightBox, UprightCylinder, UprightPrism
from taichi_plume.report import theme
from taichi_plume.report.theme import ABOVE

MOST_RECTANGLES = 20_000  # largest number of a map's wall boxes: beyond, pixels are joined
CACHED = 64  # silhouettes
FINE = 500.0  # pixels per metre, as which matplotlib divides curves into edges
SECTION_NODES = 200  # per axis, to find the section of a mesh in 2-D, or the outline of its projection
Style = dict[str, Any]


class Cubes(Protocol):
    """Protocol of the solid cells of an imported wind; stands for `files.gaden.Cubes`, whose import starts Taichi."""

    solid: np.ndarray
    size: float

    def visible(self, extent: Any) -> np.ndarray:
        """Return the centres (n, dim) [m] of the solid cubes at the surface, within `extent` [m]."""
        ...


def solid(axes: Axes, shape: Shape, plane: tuple[int, int]) -> Artist:
    """Draw the outline of an obstacle's projection on a plane; return the artist."""
    if _is_cubes(shape):
        places = shape.visible([np.inf] * len(shape.solid.shape))
        corners = np.unique(np.round(places[:, list(plane)] - shape.size / 2, 6), axis=0)
        squares = [Rectangle(tuple(corner), shape.size, shape.size) for corner in corners]
        style: Style = {"facecolor": theme.SOLID, "edgecolor": "none", "zorder": 4}
        return axes.add_collection(PatchCollection(squares, **style))
    style = {"facecolor": theme.SOLID, "edgecolor": theme.SOLID_EDGE, "linewidth": 0.9, "zorder": 4}
    return axes.add_patch(_patch(shape, plane, style))


def polygons(shape: Shape, plane: tuple[int, int]) -> list[np.ndarray]:
    """Return the polygons (n, 2) [m] of an obstacle's projection, each closed; by the even-odd rule they fill it."""
    if isinstance(shape, Solid) and len(shape.low) == 3:
        return _silhouette(shape, plane)
    patch = _patch(shape, plane, {})
    path = patch.get_path().transformed(patch.get_patch_transform() + Affine2D().scale(FINE))
    return [np.asarray(corners) / FINE for corners in path.to_polygons(closed_only=True)]


@lru_cache(CACHED)
def _silhouette(shape: Solid, plane: tuple[int, int]) -> list[np.ndarray]:
    """Return the outlines of a mesh's projection, exact to half a pixel of SECTION_NODES along the longer side."""
    low, size = shape.low[list(plane)], (shape.high - shape.low)[list(plane)]
    pixel = size.max() / SECTION_NODES
    columns, rows = np.ceil(size / pixel).astype(int) + 3  # an empty one around
    image = Image.new("L", (columns, rows))
    drawing = ImageDraw.Draw(image)
    for corners in (shape.vertices[shape.triangles][..., list(plane)] - low) / pixel + 1.0:
        drawing.polygon([(x, y) for x, y in corners], fill=1)
    x, y = (low[n] + pixel * (np.arange(count) - 1.0) for n, count in enumerate((columns, rows)))
    lines: Any = contour_generator(x, y, np.asarray(image, float)).lines(0.5)
    return lines


def _patch(shape: Shape, plane: tuple[int, int], style: Style) -> Patch:
    seen_from_above = plane == ABOVE or isinstance(shape, Ball | Solid)
    outline = OUTLINES.get(type(shape), _bounds) if seen_from_above else _bounds
    return outline(shape, plane, style)


def _is_cubes(shape: Shape) -> TypeGuard[Cubes]:
    return shape.model is None


def _bounds(shape: Shape, plane: tuple[int, int], style: Style) -> Patch:
    """Return the bounding rectangle of an obstacle in a plane; upright bodies seen from the side fill the rectangle."""
    low, high = shape.low[list(plane)], shape.high[list(plane)]
    return Rectangle((low[0], low[1]), high[0] - low[0], high[1] - low[1], **style)


def _box(shape: UprightBox, plane: tuple[int, int], style: Style) -> Patch:
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return Polygon(shape.center + (signs * shape.half) @ shape.axes.T, **style)


def _cylinder(shape: UprightCylinder, plane: tuple[int, int], style: Style) -> Patch:
    return Circle(tuple(shape.center), shape.radius, **style)


def _prism(shape: UprightPrism, plane: tuple[int, int], style: Style) -> Patch:
    return Polygon(shape.vertices, **style)


def _ball(shape: Ball, plane: tuple[int, int], style: Style) -> Patch:
    return Circle(tuple(shape.center[list(plane)]), shape.radius, **style)


def _mesh(shape: Solid, plane: tuple[int, int], style: Style) -> Patch:
    """Return the projection of a mesh on a plane: all its triangles, as one path; in a 2-D run its cross-section."""
    if len(shape.low) == 2:
        return _section(shape, style)
    corners = shape.vertices[shape.triangles][..., list(plane)]
    sides = corners[:, 1:] - corners[:, :1]
    clockwise = sides[:, 0, 0] * sides[:, 1, 1] < sides[:, 0, 1] * sides[:, 1, 0]
    corners[clockwise] = corners[clockwise][:, ::-1]
    return _polygons(corners, style | {"edgecolor": theme.SOLID, "linewidth": 0.3})


def _polygons(corners: np.ndarray, style: Style) -> Patch:
    """Return one patch of m closed polygons, given by their corners (m, corners, 2)."""
    codes = [Outline.MOVETO, *[Outline.LINETO] * (corners.shape[1] - 1), Outline.CLOSEPOLY]
    points = np.concatenate([corners, corners[:, :1]], axis=1).reshape(-1, 2)
    return PathPatch(Outline(points, np.tile(codes, len(corners))), **style)


def _section(shape: Solid, style: Style) -> Patch:
    """Return the cross-section of a mesh in a 2-D run: the zero contour of its signed distance."""
    pad = 0.02 * (shape.high - shape.low).max()
    x, y = (
        np.linspace(low - pad, high + pad, SECTION_NODES)
        for low, high in zip(shape.low, shape.high, strict=True)
    )
    places = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1)
    lines: Any = contour_generator(x, y, shape.signed_distance(places)).lines(0.0)
    if not lines:
        return _bounds(shape, ABOVE, style)
    return PathPatch(Outline.make_compound_path(*(Outline(line, closed=True) for line in lines)), **style)


def _plan(shape: FloorPlan, plane: tuple[int, int], style: Style) -> Patch:
    """Return the walls of a floor plan (occupancy grid), seen from above, as one patch of rectangles."""
    walls = shape.rectangles(MOST_RECTANGLES)
    if not len(walls):
        return _bounds(shape, plane, style)
    corners = walls[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]
    return _polygons(corners, style | {"edgecolor": theme.SOLID, "linewidth": 0.2})


OUTLINES: dict[type, Callable[[Any, tuple[int, int], Style], Patch]] = {
    UprightBox: _box,
    UprightCylinder: _cylinder,
    UprightPrism: _prism,
    Ball: _ball,
    Solid: _mesh,
    FloorPlan: _plan,
}
"""Outlines of obstacles by shape, mostly seen from above; other shapes are drawn by the rectangle around them."""


def name(axes: Axes, shape: Shape) -> None:
    """Write the kind and size of an obstacle below the obstacle's drawing."""
    if shape.model is None:
        return
    values = vars(shape.model)
    if "radius" in values:
        text = f"{shape.model.kind} ⌀ {2 * values['radius']:.3g}"
    else:
        size = values.get("size", shape.high - shape.low)
        text = f"{shape.model.kind} {' × '.join(f'{edge:.3g}' for edge in size)}"
    height = values.get("height")
    text += (f", {height:.3g} high" if height is not None and len(shape.low) == 3 else "") + " m"
    if shape.model.motion is not None:
        text += ", walks"
    theme.note(
        axes, (shape.low[0] + shape.high[0]) / 2, shape.low[1], text, theme.SOLID_EDGE, va="top", dy=-3
    )
