"""Geometry, colours, scales and cameras of the recording as plain arrays, without rerun."""

from collections.abc import Sequence
from math import ceil, cos, pi, radians, sin, tan

import numpy as np

from taichi_plume.grid.outlines import Mesh, circle, extruded
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


def robot_mesh(radius: float, height: float) -> Mesh:
    """Return the mesh of a disc with a pointed front along +x."""
    return extruded(pointed_disc(radius, 1.7, 24), 0.0, height)


def pointed_disc(radius: float, tip: float, corners: int) -> np.ndarray:
    """Return the outline (corners + 1, 2) [m] of a disc with a point along +x, at `tip` radii from the middle."""
    side = np.arccos(1.0 / tip)  # angle at which the flanks of the point touch the disc
    angle = np.linspace(side, 2 * pi - side, corners)
    return radius * np.vstack([[tip, 0.0], np.stack([np.cos(angle), np.sin(angle)], axis=-1)])


# ---------------------------------------------------------------- openings


def comb(window: Window, extent: tuple[float, ...], height: float) -> list[np.ndarray]:
    """Return the cells of a honeycomb as hexagons (7, 3) [m] within a window; in 2-D as short bars."""
    along = [axis for axis in range(3) if axis != window.normal]
    size = (*extent[:2], height)
    outline = np.clip(window.outline(extent, height=height), 0.0, size)[:, along]
    low, high = outline.min(axis=0), outline.max(axis=0)
    if len(extent) == 2:
        count = 2 + ceil(24 * (high[0] - low[0]) / max(extent))
        flat = [np.array([[s, low[1]], [s, high[1]]]) for s in np.linspace(low[0], high[0], count)]
    else:
        edge = max(min(high - low) / 8, max(high - low) / 40)
        hexagon = circle((0.0, 0.0), edge, 6)[[0, 1, 2, 3, 4, 5, 0], ::-1]
        step = np.array([edge * 3**0.5, edge * 1.5])
        count = np.maximum(1, ((high - low) / step).astype(int))
        rows, columns = np.mgrid[: count[1], : count[0]].reshape(2, -1)
        middles = low + step * (np.column_stack([columns + 0.5 * (rows % 2), rows]) + 0.5)
        flat = middles[(middles + step / 2 <= high + 1e-9).all(axis=1)][:, None] + hexagon
    return [np.insert(line, window.normal, window.level(size), axis=-1) for line in flat]


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
