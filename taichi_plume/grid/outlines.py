"""Outlines and triangle meshes of bodies, for drawings and recordings: plain arrays, without a plotting library."""

from collections.abc import Sequence
from math import cos, radians
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.grid.polygons import ears

CORNERS = 96  # of a circle
SIDES = 48  # of a round body's mesh
BLUNT = cos(radians(12.0))  # an outline's corners that turn by less are shaded as a smooth curve
SILHOUETTE_PIXELS = 1000  # along the longer side of a mesh's projection


class Mesh(NamedTuple):
    """Triangle mesh: vertices (n, 3) [m], triangles (m, 3), anticlockwise seen from outside, and normals (n, 3)."""

    vertices: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray


def rectangle(low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the corners (4, 2) of a rectangle, anticlockwise, from its lower and upper corner."""
    (a, b), (c, d) = low, high
    return np.array([[a, b], [c, b], [c, d], [a, d]], float)


def circle(center: Sequence[float] | np.ndarray, radius: float, corners: int = CORNERS) -> np.ndarray:
    """Return a circle as a regular polygon (corners, 2)."""
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    return np.asarray(center, float) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def extruded(outline: np.ndarray, base: float, top: float) -> Mesh:
    """Return the mesh of an upright body from `base` to `top` [m] over an anticlockwise simple polygon (n, 2)."""
    n, following = len(outline), np.roll(outline, -1, axis=0)
    along = following - outline
    outward = _unit(np.stack([along[:, 1], -along[:, 0], np.zeros(n)], axis=-1))
    before = np.roll(outward, 1, axis=0)
    blunt = ((before * outward).sum(axis=1) > BLUNT)[:, None]
    start = np.where(blunt, _unit(before + outward), outward)
    end = np.where(np.roll(blunt, -1, axis=0), np.roll(start, -1, axis=0), outward)

    def at(points: np.ndarray, z: float) -> np.ndarray:
        return np.column_stack([points, np.full(n, z)])

    faces, i = np.array(ears(outline)), np.arange(n)
    sides = np.vstack([np.stack([i, i + n, i + 2 * n], -1), np.stack([i, i + 2 * n, i + 3 * n], -1)])
    corners = [at(outline, base), at(following, base), at(following, top), at(outline, top)]
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    return Mesh(
        np.vstack([*corners, at(outline, top), at(outline, base)]),
        np.vstack([sides, faces + 4 * n, faces[:, ::-1] + 5 * n]),
        np.vstack([start, end, end, start, up, -up]),
    )


def ball(center: np.ndarray, radius: float) -> Mesh:
    """Return the mesh of a sphere, divided by circles of longitude and latitude."""
    u, v = np.linspace(0.0, 2.0 * np.pi, SIDES + 1), np.linspace(np.pi, 0.0, SIDES // 2 + 1)[:, None]
    normals = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v) + 0.0 * u], axis=-1)
    at = np.arange(normals[..., 0].size).reshape(normals.shape[:2])
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    triangles = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    normals = normals.reshape(-1, 3)
    return Mesh(center + radius * normals, triangles, normals)


def faceted(corners: np.ndarray) -> Mesh:
    """Return a mesh whose triangles, given by their corners (m, 3, 3), share no vertices, so that the edges show."""
    normals = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return Mesh(
        corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), np.repeat(normals, 3, axis=0)
    )


def silhouette(triangles: np.ndarray) -> list[np.ndarray]:
    """Return closed polygons around the union of triangles (m, 3, 2), exact to half a pixel of SILHOUETTE_PIXELS."""
    from PIL import Image, ImageDraw

    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    pixel = (high - low).max() / SILHOUETTE_PIXELS
    columns, rows = np.ceil((high - low) / pixel).astype(int) + 3  # with an empty pixel around
    image = Image.new("L", (columns, rows))
    drawing = ImageDraw.Draw(image)
    for corners in ((triangles - low) / pixel + 1.0).reshape(-1, 6).tolist():
        drawing.polygon(corners, fill=1)
    x, y = (low[n] + pixel * (np.arange(count) - 1.0) for n, count in enumerate((columns, rows)))
    return contours(x, y, np.asarray(image, float) - 0.5)


def contours(x: np.ndarray, y: np.ndarray, values: np.ndarray) -> list[np.ndarray]:
    """Return the lines of value 0 as polygons (n, 2), from values (y, x); corners on straight lines are left out."""
    from contourpy import contour_generator

    lines: Any = contour_generator(x, y, values).lines(0.0)
    polygons = []
    for line in lines:
        points = line[:-1]
        to, beyond = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        turn = to[:, 0] * beyond[:, 1] - to[:, 1] * beyond[:, 0]
        polygons.append(points[np.abs(turn) > 1e-9 * (x[1] - x[0]) ** 2])
    return polygons


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)
