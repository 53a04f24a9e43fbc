"""Occupancy grid of GADEN (OccupancyGrid3D.csv): cubes of a building that are walls or furniture, as an obstacle.

    #env_min(m) x y z
    #env_max(m) x y z
    #num_cells nx ny nz
    #cell_size(m) a

and then, from the floor upwards, layers of nx lines of ny numbers, each ended by a line with a semicolon: 0 air,
1 obstacle, 2 outlet, which is air too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree  # type: ignore[attr-defined]

from taichi_plume.files.tables import TextFile, shown
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.grid.clearance import FAR
from taichi_plume.grid.cut_cells import SLIVER
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import TIE, Blocks

HEADER = ("env_min", "env_max", "num_cells", "cell_size")
LARGEST = 1e9  # number of a header
NEIGHBOURS = 12  # number of nearest centres, among which is the nearest cube


@dataclass(frozen=True)
class Occupancy:
    """GADEN's occupancy grid. low: lower corner [m]; size: edge of a cube [m]; cubes: air 0, wall 1, outlet 2.

    remarks: what was assumed.
    """

    path: Path
    low: np.ndarray
    size: float
    cubes: np.ndarray
    remarks: tuple[str, ...] = ()

    @property
    def high(self) -> np.ndarray:
        """Upper corner of the grid [m]."""
        return self.low + self.size * np.array(self.cubes.shape)


def read(path: Path) -> Occupancy:
    """Read an occupancy grid from a CSV, or voxelise the models that a YAML lists. Raises WindFileError."""
    if path.suffix == ".yaml":
        from taichi_plume.files.gaden_models import occupancy

        return occupancy(path)
    file = TextFile(path, WindFileError)
    lines = file.lines
    known: dict[str, np.ndarray] = {}
    for n, line in enumerate(lines[: len(HEADER)], 1):
        name, *numbers = line.lstrip("# ").split() or [""]
        name = name.partition("(")[0]
        if not line.startswith("#") or name not in HEADER:
            raise file.wrong(n, f"must be one of #{', #'.join(HEADER)}, got {shown(line)}")
        try:
            known[name] = np.array([float(number) for number in numbers])
        except ValueError:
            known[name] = np.empty(0)
        if len(known[name]) != (1 if name == "cell_size" else 3) or not (np.abs(known[name]) < LARGEST).all():
            raise file.wrong(n, f"wrong numbers after {name}")
    if len(known) < len(HEADER):
        raise file.wrong(len(lines), "its header is incomplete")
    shape = known["num_cells"].astype(int)
    size, low = float(known["cell_size"][0]), known["env_min"]
    if (shape < 1).any() or (shape != known["num_cells"]).any() or size <= 0.0:
        raise WindFileError(f"{path}: its header gives no cells")
    if np.abs(low + size * shape - known["env_max"]).max() > 0.99 * size:
        cells = " x ".join(map(str, shape))
        raise WindFileError(f"{path}: {cells} cells of {size:g} m do not reach from env_min to env_max")
    return Occupancy(path, low, size, _cells(file, tuple(shape)))


def _cells(file: TextFile, shape: tuple[int, ...]) -> np.ndarray:
    rows, ends = [], []
    for n, line in enumerate(file.lines[len(HEADER) :], len(HEADER) + 1):
        line = line.strip()
        if line == ";":
            ends.append(len(rows))
        elif line:
            values = line.split()
            if len(values) != shape[1] or not set(values) <= {"0", "1", "2"}:
                raise file.wrong(n, f"must be {shape[1]} numbers of 0, 1 and 2")
            rows.append(np.array(values, np.int8))
    layers = min(shape[2], len(rows))  # a header may claim billions
    expected = [shape[0] * (layer + 1) for layer in range(layers)]
    if len(rows) != shape[0] * shape[2] or ends not in (expected, expected[:-1]):
        raise WindFileError(
            f"{file.path}: has {len(rows)} rows and {len(ends)} semicolons, not {shape[0]} rows in each of {shape[2]} "
            f"layers as its num_cells {' x '.join(map(str, shape))} say; is the file whole?"
        )
    return np.array(rows).reshape(shape[2], shape[0], shape[1]).transpose(1, 2, 0)


class Cubes(Blocks):
    """Solid cubes of an occupancy grid as an obstacle's shape. origin: the domain's lower corner in the grid [m].

    height: for a 2-D domain, z of the horizontal section in the grid [m].
    """

    def __init__(self, grid: Occupancy, dim: int, origin: np.ndarray, height: float):
        self.size = grid.size
        cubes = grid.cubes
        if dim == 2:
            layer = int((height - grid.low[2]) // grid.size)
            if not 0 <= layer < cubes.shape[2]:
                raise WindFileError(
                    f"{grid.path}: the section at z = {height:g} m is outside its z {grid.low[2]:g} to "
                    f"{grid.high[2]:g} m"
                )
            cubes = cubes[:, :, layer]
        self.solid, self.outlet = cubes == 1, cubes == 2
        self.low = grid.low[:dim] - origin[:dim]
        self.high = grid.high[:dim] - origin[:dim]

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        return _distance(points, self.solid, self.low, self.size)

    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        if self.solid.ndim == 2:
            return self.signed_distance(points)
        begin, end = ((np.array([low, high]) - self.low[2]) / self.size + [1e-6, 1 - 1e-6]).astype(int)
        shadow = np.asarray(self.solid[:, :, max(begin, 0) : max(end, 0)].any(axis=2))
        return _distance(points, shadow, self.low[:2], self.size)

    def shares(self, grid: Grid, outlets: bool = True) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the air fractions of the cells and, per axis, of the faces of `grid`; 1 beyond the cubes.

        outlets: whether outlet cubes count as air.
        """
        air = np.pad(~self.solid if outlets else ~(self.solid | self.outlet), 1, constant_values=True)
        counts = zip(self.low, self.solid.shape, strict=True)
        edges = [np.concatenate([[-np.inf], x + self.size * np.arange(n + 1), [np.inf]]) for x, n in counts]
        overlaps = [
            overlaps_of(np.arange(n + 1) * grid.dx, e) for n, e in zip(grid.shape, edges, strict=True)
        ]
        area = []
        for d, edge in enumerate(edges):
            planes = np.arange(grid.shape[d] + 1) * grid.dx
            below, above = (
                np.searchsorted(edge, planes + tie * grid.dx, side="right") - 1 for tie in (-TIE, TIE)
            )
            both = np.take(air, below, axis=d) & np.take(air, above, axis=d)
            area.append(_mean(both, [None if a == d else o for a, o in enumerate(overlaps)]))
        return _mean(air, overlaps), area

    def boxes(self, most: int, size: Sequence[float] = (np.inf,) * 3) -> np.ndarray:
        """Return lower and upper corners (n, 2, dim) [m] of all solid cubes with their centre in a room of this size.

        In 3-D, only the cubes at the surface count, without the ceiling.
        """
        places = [
            low + self.size * (np.arange(n) + 0.5) for low, n in zip(self.low, self.solid.shape, strict=True)
        ]
        within = [np.flatnonzero((x > 0.0) & (x < most)) for x, most in zip(places, size, strict=False)]
        solid = self.solid[np.ix_(*within)]
        if solid.ndim == 3:
            # solid from here to the top
            top = np.logical_and.accumulate(solid[:, :, ::-1], axis=2)[:, :, ::-1]
            solid = solid & ~(top & ~top[:, :, :1])
            solid &= ndimage.binary_erosion(solid) == 0
        seen = np.nonzero(solid)
        centers = np.stack([x[w][n] for x, w, n in zip(places, within, seen, strict=True)], axis=-1)
        return centers[:, None] + self.size * np.array([[-0.5], [0.5]])


def overlaps_of(cells: np.ndarray, cubes: np.ndarray) -> np.ndarray:
    """Return the fraction of each cell covered by each cube along an axis, (cells, cubes), from the edges of both."""
    low, high = np.maximum(cells[:-1, None], cubes[:-1]), np.minimum(cells[1:, None], cubes[1:])
    return np.maximum(high - low, 0.0) / np.diff(cells)[:, None]


def _mean(air: np.ndarray, overlaps: Sequence[np.ndarray | None]) -> np.ndarray:
    """Average the cubes' air mask over each axis with overlap fractions (cells, cubes) to cells; None: no average."""
    result = air.astype(float)
    for axis, overlap in enumerate(overlaps):
        if overlap is not None:
            result = np.moveaxis(np.tensordot(overlap, result, axes=(1, axis)), 0, axis)
    return np.where(result < SLIVER, 0.0, np.where(result > 1.0 - TIE, 1.0, result))


def _distance(points: np.ndarray, solid: np.ndarray, low: np.ndarray, size: float) -> np.ndarray:
    """Return the signed distance [m] of points to solid cubes. low: grid's lower corner [m]; size: cube edge [m]."""
    flat = points.reshape(-1, solid.ndim)
    away = []
    for kind, sign in ((solid, 1.0), (~solid, -1.0)):
        centers = low + size * (np.argwhere(kind) + 0.5)
        if not len(centers):
            return np.full(points.shape[:-1], sign * FAR)
        _, nearest = cKDTree(centers).query(flat, k=range(1, min(NEIGHBOURS, len(centers)) + 1))
        beyond = np.maximum(np.abs(flat[:, None] - centers[nearest]) - size / 2, 0.0)
        away.append(np.linalg.norm(beyond, axis=-1).min(axis=1))
    return np.where(away[0] > 0.0, away[0], -away[1]).reshape(points.shape[:-1])
