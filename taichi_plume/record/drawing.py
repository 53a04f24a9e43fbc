"""Geometry, colours, scales and cameras of the recording as plain arrays, without rerun."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, cos, floor, hypot, log, log10, pi, radians, sin, tan
from typing import Literal

import numpy as np

from taichi_plume.grid.polygons import ears
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


def logarithmic(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the position of `values` on a logarithmic scale from `low` (0) to `high` (1); NaN stays NaN."""
    place = (np.log10(np.maximum(values, low * 1e-6)) - log10(low)) / (log10(high) - log10(low))
    return np.clip(place, 0.0, 1.0)


def decades(low: float, high: float) -> list[tuple[float, str]]:
    """Return position (0 to 1) and label of each power of ten on a log scale; on short scales also 3 times each."""
    powers = range(floor(log10(low)), floor(log10(high) + 1e-9) + 1)
    factors = (1, 3) if log10(high / low) < 4 - 1e-9 else (1,)
    marks = [
        (factor * 10.0**n, f"{factor * 10.0**n:g}" if -4 < n < 4 else f"{factor}e{n}")
        for n in powers
        for factor in factors
    ]
    return [
        (float(logarithmic(np.array(value), low, high)), text)
        for value, text in marks
        if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)
    ]


def rounded_up(value: float, steps: Sequence[float] = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)) -> float:
    """Return the smallest of these numbers, times a power of ten, that is at least a positive value."""
    power = 10.0 ** ceil(log10(value) - 1 - 1e-9)
    return next(n * power for n in (*steps, 10.0) if n * power >= value * (1 - 1e-9))


@dataclass(frozen=True)
class Scale:
    """Scale of values as bytes v: low (high/low)^(v/255), v = 0 for at most low; or low + (high - low) v/255."""

    low: float
    high: float
    kind: Literal["log", "linear"]

    def bytes(self, values: np.ndarray) -> np.ndarray:
        """Encode values as bytes (u8) on a linear or logarithmic scale; NaN becomes 0."""
        known = np.fmax(values, np.float32(self.low))
        if self.kind == "log":
            places = np.log(known) - np.float32(log(self.low))
            places *= np.float32(255 / log(self.high / self.low))
        else:
            places = (known - np.float32(self.low)) * np.float32(255 / (self.high - self.low))
        return np.minimum(places + np.float32(0.5), 255).astype(np.uint8)

    def marks(self) -> list[tuple[float, str]]:
        """Return position (0 to 1) and label of each tick of a colour legend."""
        if self.kind == "log":
            return decades(self.low, self.high)
        step = rounded_up((self.high - self.low) / 7, (1.0, 2.0, 5.0))
        values = np.arange(ceil(self.low / step - 1e-9), floor(self.high / step + 1e-9) + 1) * step
        return [((value - self.low) / (self.high - self.low), f"{value:.6g}") for value in values.tolist()]


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


def arrow_places(extent: Sequence[float]) -> tuple[np.ndarray, float]:
    """Return the positions of wind arrows on a rectangle, (n, 2) [m], and the distance between them [m]."""
    step = hypot(*extent) / 26
    counts = [max(1, round(length / step)) for length in extent]
    axes = [(np.arange(n) + 0.5) * length / n for length, n in zip(extent, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2), step
