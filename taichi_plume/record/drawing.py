"""Geometry, colours, scales and cameras of the recording as plain arrays, without rerun."""

from collections.abc import Sequence
from math import ceil, cos, pi, radians, sin, tan

import numpy as np

from taichi_plume.grid.polygons import ears
from taichi_plume.observed.scales import Scale
from taichi_plume.scenario.windows import Window

VIRIDIS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
EMBER = ((24, 26, 32), (78, 52, 46), (191, 97, 44), (255, 183, 77), (255, 245, 200))
BLUE_RED = ((33, 102, 172), (103, 169, 207), (236, 239, 241), (239, 138, 98), (178, 24, 43))
TIME = "sim_time"
"""Name of the time axis of recordings."""
FIELD_OF_VIEW = radians(55)  # of the viewer's camera, the angle over the height of its panel

# ---------------------------------------------------------------- colours


def pale(color: tuple[int, ...]) -> tuple[int, ...]:
    """Return a colour of bytes (0 to 255) mixed half and half with white."""
    return tuple((part + 255) // 2 for part in color)


DENSITIES = Scale(1e-3, 1e2, "log")
"""Scale of beliefs [1/m²]."""


def painted(places: np.ndarray, palette: Sequence[Sequence[int]]) -> np.ndarray:
    """Return RGBA bytes (..., 4) of `places` in 0..1 on a palette; NaN is transparent."""
    known = np.isfinite(places)
    at = np.where(known, places, 0.0) * (len(palette) - 1)
    rgb = [np.interp(at, np.arange(len(palette)), channel) for channel in np.transpose(palette)]
    return np.stack([*rgb, np.where(known, 255.0, 0.0)], axis=-1).round().astype(np.uint8)


def rows(image: np.ndarray) -> bytes:
    """Return the bytes of image[ix, iy, ...] in the viewer's order: rows of constant y, the largest y first."""
    return np.ascontiguousarray(np.swapaxes(image, 0, 1)[::-1]).tobytes()


# ---------------------------------------------------------------- solids


Triangles = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Vertices (n, 3) [m], triangles (m, 3) and normals (n, 3) of a mesh."""


def robot_mesh(radius: float, height: float) -> Triangles:
    """Return the mesh of a disc with a pointed front along +x."""
    return prism_mesh(pointed_disc(radius, 1.7, 24), 0.0, height)


def pointed_disc(radius: float, tip: float, corners: int) -> np.ndarray:
    """Return the outline (corners + 1, 2) [m] of a disc with a point along +x, at `tip` radii from the middle."""
    side = np.arccos(1.0 / tip)  # angle at which the flanks of the point touch the disc
    angle = np.linspace(side, 2 * pi - side, corners)
    return radius * np.vstack([[tip, 0.0], np.stack([np.cos(angle), np.sin(angle)], axis=-1)])


def prism_mesh(outline: np.ndarray, base: float, top: float) -> Triangles:
    """Return the mesh of a vertical prism over a simple polygon (n, 2)."""
    x, y = outline.T
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0:
        outline = outline[::-1]  # counter-clockwise
    n = len(outline)
    following = np.roll(outline, -1, axis=0)
    along = following - outline
    outward = np.stack([along[:, 1], -along[:, 0], np.zeros(n)], axis=-1)
    outward /= np.maximum(np.linalg.norm(outward, axis=-1, keepdims=True), 1e-12)

    def at(points: np.ndarray, z: float) -> np.ndarray:
        return np.column_stack([points, np.full(n, z)])

    faces = np.array(ears(outline))
    corners = [at(outline, base), at(following, base), at(following, top), at(outline, top)]
    i = np.arange(n)
    sides = np.vstack([np.stack([i, i + n, i + 2 * n], -1), np.stack([i, i + 2 * n, i + 3 * n], -1)])
    vertices = np.vstack([*corners, at(outline, top), at(outline, base)])
    triangles = np.vstack([sides, faces + 4 * n, faces[:, ::-1] + 5 * n])
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    return vertices, triangles, np.vstack([outward, outward, outward, outward, up, -up])


def faceted(vertices: np.ndarray, triangles: np.ndarray) -> Triangles:
    """Return a mesh whose triangles share no vertices, so that the edges show."""
    corners = np.asarray(vertices, float)[np.asarray(triangles)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), np.repeat(normals, 3, axis=0)


# ---------------------------------------------------------------- openings


def opening(region: Window, extent: tuple[float, ...], height: float) -> np.ndarray:
    """Return the outline (n, 3) [m] of an opening or a screen on its plane; height: of the walls [m], in 2-D too."""
    low, high = region_bounds(region, extent, height)
    if region.is_disc(len(extent)):
        center, half = map(np.array, region.rectangle(extent))
        angle = np.linspace(0, 2 * pi, 48, endpoint=False)
        flat = center + half * np.stack([np.cos(angle), np.sin(angle)], -1)
    else:
        flat = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    return on_plane(flat, region, (*extent[:2], height))


def region_bounds(region: Window, extent: tuple[float, ...], height: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper corner [m] of a region in the two axes of its plane."""
    low, high = region.bounds(extent)
    return np.append(low, 0.0)[:2], np.append(high, height)[:2]


def on_plane(flat: np.ndarray, region: Window, size: tuple[float, ...]) -> np.ndarray:
    """Return points (n, 3) on the region's plane in the box 0..size, from points (n, 2) in the plane's axes."""
    return np.insert(flat, region.normal, region.level(size), axis=-1)


def comb(region: Window, extent: tuple[float, ...], height: float) -> list[np.ndarray]:
    """Return the cells of a honeycomb as hexagons (7, 3) [m] within its region; in 2-D as short bars."""
    low, high = region_bounds(region, extent, height)
    size = (*extent[:2], height)
    if len(extent) == 2:
        bars = np.linspace(low[0], high[0], 2 + ceil(24 * (high[0] - low[0]) / max(extent)))
        return [on_plane(np.array([[s, low[1]], [s, high[1]]]), region, size) for s in bars]
    edge = max(min(high - low) / 8, max(high - low) / 40)
    angle = pi / 6 + np.arange(7) * pi / 3
    hexagon = edge * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    step = np.array([edge * 3**0.5, edge * 1.5])
    count = np.maximum(1, ((high - low) / step).astype(int))
    cells = []
    for j in range(count[1]):
        for i in range(count[0]):
            middle = low + step * (np.array([i, j]) + 0.5 + [0.5 * (j % 2), 0.0])
            if np.all(middle + step / 2 <= high + 1e-9):
                cells.append(on_plane(middle + hexagon, region, size))
    return cells


# ---------------------------------------------------------------- cameras


def camera(
    points: np.ndarray, aspect: float, elevation_deg: float, azimuth_deg: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the position, target [m] and up vector of a camera that just frames points (n, 3).

    aspect: width over height of its panel; elevation_deg: above the ground, 90 looks straight down; azimuth_deg: 0
    looks along +y, 90 along -x.
    """
    e, a = radians(elevation_deg), radians(azimuth_deg)
    ahead, right = np.array([-sin(a), cos(a), 0.0]), np.array([cos(a), sin(a), 0.0])
    forward = cos(e) * ahead - np.array([0.0, 0.0, sin(e)])
    up = sin(e) * ahead + np.array([0.0, 0.0, cos(e)])
    half_height = tan(FIELD_OF_VIEW / 2)
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    distance = 0.0
    for _ in range(20):  # near objects look larger: move the target until top and bottom have the same margin
        offsets = points - target
        depth, height = offsets @ forward, offsets @ up
        distance = max(
            np.max(np.abs(offsets @ right) / (half_height * aspect) - depth),
            np.max(np.abs(height) / half_height - depth),
        )
        seen = height / (distance + depth)
        target = target + 0.5 * distance * (seen.max() + seen.min()) / 2 * up
    return target - 1.03 * distance * forward, target, up
