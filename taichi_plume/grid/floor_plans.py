"""Walls of an occupancy map as an obstacle: pixels of a floor plan, in 3-D extruded to a height.

Walls of a pixel may be much thinner than the cells of the grid. The air fractions of cells and faces are therefore
measured on the pixels: of the air in a cell only the largest connected part counts, and a face is open where the parts
on both sides touch. Two cells then exchange air only by a path between the pixels, and even the thinnest wall is tight.
"""

from collections.abc import Sequence
from functools import cached_property
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.grid.drawings import read_drawing
from taichi_plume.grid.map_files import UNKNOWN, MapError, RosMap, read_map
from taichi_plume.grid.shapes import TIE, Blocks, Upright

FAR = 1e6  # m, distance without any wall
SLIVER = 0.02  # smaller fractions are closed
HALF = 0.49  # fraction of a cell: with less air, the domain's face before the cell is closed
TURNED = 2  # refinement of the pixels of a turned map
MOST_TURNED = 16_000_000  # largest number of pixels of a turned map in the domain
MOST_RIM = 1_000_000  # largest number of these at the edges of walls: lines are drawn from each
STRAIGHT = 1e-6  # quarters of a turn: a map turned by less lies along the axes
KNOWN = 4_000_000  # pixels: in larger maps, distances are taken to blocks of pixels


class FloorPlan(Blocks, Upright):
    """Walls of an occupancy map as an obstacle; only the part in the domain is stored.

    solid: wall pixels, bool, axes (x, y), along the domain's; size: edge of a pixel [m]; corner: lower corner of the
    first pixel in the domain [m]. low, high: box around the whole map; in the map's frame, reach: box of its
    floor, origin: the domain's lower corner, x and y [m]. text, remarks: what was read and assumed of the file.
    """

    def __init__(self, model: Any, extent: tuple[float, ...], folder: Path):
        file = folder / model.file
        if file.suffix.lower() == ".dxf":
            plan = read_drawing(file, model.resolution, model.layers, model.scale)
        elif model.layers or model.scale:
            raise MapError(f"{model.file}: is no drawing (.dxf), for which layers and scale are; remove them")
        else:
            plan = read_map(file, model.resolution)
        solid = plan.walls(model.unknown)
        low, high = _reach(plan)
        self.text = _described(plan, solid, low, high)
        self.remarks = (*plan.remarks, *plan.remarks_on(model.unknown))
        self.reach = low, high
        self.origin = shift = low if model.origin is None else np.array(model.origin)
        try:
            self.solid, self.size, self.corner = _along_axes(solid, plan, shift, extent)
        except MapError as error:
            raise MapError(f"{model.file}: {error}") from None
        ceiling = extent[2] if len(extent) == 3 else np.inf
        top = ceiling if model.height is None else model.base + model.height
        super().__init__(model, len(extent), low - shift, high - shift, model.base, top)

    # ---------------------------------------------------------------- distances

    @cached_property
    def _nearest(self) -> tuple[np.ndarray, float, list[np.ndarray]]:
        """Wall mask in blocks of pixels, with a margin; block edge [m]; nearest wall and nearest air per block."""
        from scipy import ndimage

        finer = max(1, int(np.ceil(np.sqrt(self.solid.size / KNOWN))))
        walls = np.pad(_blocks(self.solid, finer), 1)
        kinds = (walls, ~walls) if walls.any() else ()
        nearest = [
            np.asarray(ndimage.distance_transform_edt(~kind, return_distances=False, return_indices=True))
            for kind in kinds
        ]
        return walls, finer * self.size, nearest

    def footprint_distance(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distance [m] of points (..., 2) to the walls; in large maps a lower bound."""
        if points.ndim == 4 and points.shape[2] > 1 and (points == points[:, :, :1]).all():  # of all heights
            return np.repeat(self.footprint_distance(points[:, :, :1]), points.shape[2], axis=2)
        walls, size, nearest = self._nearest
        if not nearest:
            return np.full(points.shape[:-1], FAR)
        place = (points.reshape(-1, 2) - self.corner) / size + 1.0  # in blocks of the padded walls
        most = np.array(walls.shape, float)
        near = np.clip(place, 0.0, most)
        beyond = np.linalg.norm(place - near, axis=-1)
        first = np.clip(np.floor(near - 0.5), 0, most - 2).astype(int)
        away = np.full((2, len(place)), np.inf)
        for corner in ((0, 0), (0, 1), (1, 0), (1, 1)):  # the nearest block is nearest to one of four around
            index = tuple((first + corner).T)
            for n, table in enumerate(nearest):
                to = np.abs(near - (table[(slice(None), *index)].T + 0.5)) - 0.5
                away[n] = np.minimum(away[n], np.linalg.norm(np.maximum(to, 0.0), axis=-1))
        signed = np.where(away[0] > 0.0, np.hypot(away[0], beyond), -away[1])
        return size * signed.reshape(points.shape[:-1])

    # ---------------------------------------------------------------- shares

    def shares(self, shape: tuple[int, ...], dx: float) -> tuple[np.ndarray, list[np.ndarray]]:
        volume, area = self._flat_shares(shape[:2], dx)
        if len(shape) == 3:
            planes = np.arange(shape[2] + 1) * dx
            overlap = np.minimum(planes[1:], self.top) - np.maximum(planes[:-1], self.base)
            within = np.maximum(overlap, 0.0) / dx
            cut = (planes > self.base + TIE * dx) & (planes < self.top - TIE * dx)
            flat, volume = volume, 1.0 - within * (1.0 - volume[..., None])
            area = [1.0 - within * (1.0 - part[..., None]) for part in area]
            area.append(np.where(cut, flat[..., None], 1.0))
        for axis in range(2):  # a wall on a face of the domain closes the face
            cells, faces = np.moveaxis(volume, axis, 0), np.moveaxis(area[axis], axis, 0)
            for end in (0, -1):
                cells[end] = np.where(faces[end] < 0.5, np.minimum(cells[end], HALF), cells[end])
        return _whole(volume), [_whole(part) for part in area]

    def _flat_shares(self, shape: tuple[int, ...], dx: float) -> tuple[np.ndarray, list[np.ndarray]]:
        axes = [self._parts(a, n, dx) for a, n in enumerate(shape)]
        (pixel_x, cell_x, width_x), (pixel_y, cell_y, width_y) = axes
        padded = np.pad(~self.solid, 1, constant_values=True)
        air = padded[np.ix_(pixel_x, pixel_y)]
        begin = [np.searchsorted(cell, np.arange(n)) for (_, cell, _), n in zip(axes, shape, strict=True)]

        def over(part: np.ndarray) -> np.ndarray:
            """Return the fractions of the cells that are made of some parts."""
            columns = np.add.reduceat(part * width_y.astype(np.float32), begin[1], axis=1)
            return np.add.reduceat(columns * width_x[:, None], begin[0], axis=0) / dx**2

        share = over(air)
        mixed = (share > 0.0) & (share < 1.0 - TIE)
        air &= ~_lesser(air & mixed[np.ix_(cell_x, cell_y)], axes)
        area = []
        for axis, (first, width, across) in enumerate(
            ((begin[0], width_y, begin[1]), (begin[1], width_x, begin[0]))
        ):
            part = np.moveaxis(air, axis, 0)
            both = part[first[1:] - 1] & part[first[1:]]
            faces = np.concatenate([part[:1], both, part[-1:]])
            area.append(np.moveaxis(np.add.reduceat(faces * width, across, axis=1) / dx, 0, axis))
        return over(air), area

    def _parts(self, axis: int, cells: int, dx: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cut an axis at the edges of pixels and cells; return the (padded) pixel, cell and width [m] of each part."""
        planes, count = np.arange(cells + 1) * dx, self.solid.shape[axis]
        edges = self.corner[axis] + self.size * np.arange(count + 1)
        nearest = dx * np.rint(edges / dx)
        edges = np.where(np.abs(edges - nearest) < TIE * dx, nearest, edges)
        cuts = np.unique(np.concatenate([planes, edges[(edges > 0.0) & (edges < planes[-1])]]))
        cuts = cuts[np.concatenate([[True], np.diff(cuts) > 1e-9 * dx])]
        middle = 0.5 * (cuts[1:] + cuts[:-1])
        pixel = np.searchsorted(edges, middle)  # 0 below the first, count + 1 beyond the last
        cell = np.minimum((middle / dx).astype(int), cells - 1)
        return pixel, cell, np.diff(cuts)

    # ---------------------------------------------------------------- drawing

    def boxes(self, most: int, size: Sequence[float] = (np.inf,) * 3) -> np.ndarray:
        walls = self.rectangles(most).reshape(-1, 2, 2)
        upright = np.broadcast_to([[self.base], [self.top]], (len(walls), 2, 1))
        return np.concatenate([walls, upright], axis=2)[..., : len(self.low)]

    def rectangles(self, most: int) -> np.ndarray:
        """Return the walls as at most `most` rectangles (n, 4), lower and upper corner [m], coarsened if needed."""
        walls, size = self.solid, self.size
        while True:
            runs = _runs(walls)
            if len(runs) <= most or min(walls.shape) < 2:
                return np.concatenate([self.corner, self.corner]) + size * runs
            walls, size = _blocks(walls, 2), 2.0 * size


def _blocks(walls: np.ndarray, n: int) -> np.ndarray:
    """Return a mask of the blocks of n x n pixels that hold a wall pixel."""
    padded = np.pad(walls, [(0, -length % n) for length in walls.shape])
    blocks = padded.reshape(padded.shape[0] // n, n, padded.shape[1] // n, n)
    return np.any(blocks, axis=(1, 3))


def _whole(share: np.ndarray) -> np.ndarray:
    return np.where(share < SLIVER, 0.0, np.where(share > 1.0 - TIE, 1.0, share))


def _lesser(air: np.ndarray, axes: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return a mask of the air in cut cells outside the largest connected part of each cell; axes: from `_parts`."""
    from scipy import ndimage

    (_, cell_x, width_x), (_, cell_y, width_y) = axes
    rows, columns = np.nonzero(air)
    if not len(rows):
        return air
    place = rows + cell_x[rows], columns + cell_y[columns]  # with a gap between cells
    apart = np.zeros([len(cell) + cell[-1] + 1 for cell in (cell_x, cell_y)], bool)
    apart[place] = True
    labelled: Any = ndimage.label(apart)
    label, count = labelled[0][place] - 1, int(labelled[1])
    area = np.bincount(label, width_x[rows] * width_y[columns], count)
    owner = np.zeros(count, int)
    owner[label] = cell_x[rows] * (cell_y[-1] + 1) + cell_y[columns]
    order = np.lexsort((np.rint(area / (1e-6 * area.max(initial=1e-30))), owner))
    largest = np.zeros(count, bool)
    largest[order[np.append(owner[order][1:] != owner[order][:-1], True)]] = True
    result = np.zeros_like(air)
    result[rows, columns] = ~largest[label]
    return result


def _runs(walls: np.ndarray) -> np.ndarray:
    """Return rectangles [pixels] that cover the walls: runs of each row, joined if consecutive rows have equal runs."""
    steps = np.diff(np.pad(walls, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, begin = np.nonzero(steps == 1)
    end = np.nonzero(steps == -1)[1]
    order = np.lexsort((row, end, begin))
    row, begin, end = row[order], begin[order], end[order]
    new = np.ones(len(row), bool)
    new[1:] = (np.diff(row) != 1) | (np.diff(begin) != 0) | (np.diff(end) != 0)
    first = np.flatnonzero(new)
    last = np.append(first[1:], len(row)) - 1 if len(row) else first
    return np.column_stack([row[first], begin[first], row[last] + 1, end[first]]).astype(float)


# ---------------------------------------------------------------- position of a map


def _turned(yaw: float) -> np.ndarray:
    return np.array([[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]])


def _reach(plan: RosMap) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper corner of the box around a map, in the map's frame [m]."""
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * plan.pixels.shape * plan.resolution
    corners = corners @ _turned(plan.yaw).T + np.array(plan.origin)
    return corners.min(axis=0), corners.max(axis=0)


def _described(plan: RosMap, solid: np.ndarray, low: np.ndarray, high: np.ndarray) -> str:
    """Return the file, place and content of a map in a line; low, high: box around it in the map's frame [m]."""
    turned = f", turned by {np.degrees(plan.yaw):.4g} deg" if plan.yaw else ""
    box = ", ".join(f"{axis} {a:.6g} to {b:.6g} m" for axis, a, b in zip("xy", low, high, strict=True))
    unknown = np.count_nonzero(plan.pixels == UNKNOWN)
    return f"{plan.text}, {box} in frame map{turned}, {solid.sum():,} wall pixels, {unknown:,} unknown"


def _along_axes(
    solid: np.ndarray, plan: RosMap, shift: np.ndarray, extent: tuple[float, ...]
) -> tuple[np.ndarray, float, np.ndarray]:
    """Return a map's part in a domain of `extent`, with pixels along the axes; their edge and lower corner [m]."""
    low, high = (corner - shift for corner in _reach(plan))
    quarters = 2.0 * plan.yaw / pi
    if abs(quarters - round(quarters)) < STRAIGHT:
        size, solid = plan.resolution, np.rot90(solid, round(quarters) % 4)
        first, last = _range(low, size, solid.shape, extent)
        return solid[first[0] : last[0], first[1] : last[1]], size, low + size * first
    size = plan.resolution / TURNED
    first, last = _range(low, size, np.ceil((high - low) / size).astype(int), extent)
    count = np.maximum(last - first, 0)
    if count.prod() > TURNED**2 * MOST_TURNED:
        raise MapError(
            f"its picture is rotated and has more than {MOST_TURNED:,} pixels in the domain; save it without rotation"
        )
    return _drawn(solid, plan, shift, low + size * first, size, count), size, low + size * first


def _range(
    low: np.ndarray, size: float, shape: np.ndarray | tuple[int, ...], extent: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and last pixels in the domain, with one more at each end; low: lower corner of the map [m]."""
    first = np.clip(np.floor(-low / size) - 1, 0, shape).astype(int)
    last = np.clip(np.ceil((np.array(extent[:2]) - low) / size) + 1, first, shape).astype(int)
    return first, last


def _drawn(
    solid: np.ndarray, plan: RosMap, shift: np.ndarray, corner: np.ndarray, size: float, count: np.ndarray
) -> np.ndarray:
    """Return the wall mask of a turned map on pixels along the axes: pixels whose centre lies in a wall, and lines
    between neighbouring pixels of a wall's edge, without which a thin wall might have gaps.
    """
    from scipy import ndimage

    inner: Any = ndimage.binary_erosion(solid, np.ones((3, 3)), border_value=1)
    rim = solid & ~inner
    if np.count_nonzero(rim) > MOST_RIM:
        raise MapError(
            f"its picture is turned, and has more than {MOST_RIM:,} pixels at edges of walls; turn it back"
        )
    turn, origin = _turned(plan.yaw), np.array(plan.origin) - shift
    result = np.zeros(count, bool)
    y = corner[1] + size * (np.arange(count[1]) + 0.5)
    for n in range(count[0]):
        x = np.full(len(y), corner[0] + size * (n + 0.5))
        index = np.floor((np.column_stack([x, y]) - origin) @ turn / plan.resolution).astype(int)
        known = ((index >= 0) & (index < solid.shape)).all(axis=1)
        result[n, known] = solid[tuple(index[known].T)]
    for step in ((1, 0), (0, 1), (1, 1), (1, -1)):
        pixel = np.argwhere(rim)
        beside = pixel + step
        known = ((beside >= 0) & (beside < solid.shape)).all(axis=1)
        known[known] = rim[tuple(beside[known].T)]
        for share in np.linspace(0.0, 1.0, 4 * TURNED):
            place = (pixel[known] + 0.5 + share * np.array(step)) * plan.resolution @ turn.T + origin
            index = np.floor((place - corner) / size).astype(int)
            index = index[((index >= 0) & (index < count)).all(axis=1)]
            result[tuple(index.T)] = True
    return result
