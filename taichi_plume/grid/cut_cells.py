"""Cut cells (immersed boundary): volume and area fractions of air, where surfaces of obstacles cut through the grid.

The signed distance to the surfaces is taken as linear between nodes half a cell apart and the centres between them, in
triangles and tetrahedra that no axis is preferred by: the fractions are of second order in the spacing, exact for plane
surfaces, and turn with the geometry. Parts thinner than half a cell may be missed (see `unresolved`). Shapes may
provide their own fractions (`Shape.shares`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from taichi_plume.grid.geometry_cache import geometry_cached
from taichi_plume.grid.grid import Grid, block_mean
from taichi_plume.grid.shapes import FINER, TIE, Shape

SLIVER = 0.02  # smaller fractions are closed
Fractions = tuple[np.ndarray, list[np.ndarray]]
"""Air fractions of the cells, and of the faces per axis."""


@dataclass(frozen=True)
class Air:
    """Air fractions of a grid: `volume` of cells, grid.shape; `area` of faces per axis, one more along that axis.

    distance: mean distance [cells] of a face's open part from the nearest surface, arrays like area. body: index of the
    obstacle nearest to the cell, -1 if none is near; periodic: per axis. sealed: per axis the faces, bool like area,
    closed by walls that may be thinner than any cell; empty without such walls.
    """

    volume: np.ndarray
    area: tuple[np.ndarray, ...]
    distance: tuple[np.ndarray, ...]
    body: np.ndarray
    periodic: tuple[bool, ...]
    sealed: tuple[np.ndarray, ...] = ()

    @property
    def solid(self) -> np.ndarray:
        """Mask of the cells that hold no air, bool of grid.shape."""
        return self.volume == 0.0

    @property
    def empty(self) -> bool:
        """True if there is no obstacle at all."""
        return all(bool(np.all(area == 1.0)) for area in self.area)

    @property
    def room(self) -> np.ndarray:
        """Volume fraction of storage of each cell, grid.shape: at least the area fraction of its widest face.

        A small cell thus does not shorten the time step.
        """
        return np.maximum(self.volume, _widest(list(self.area), self.volume.ndim))

    def regions(self) -> np.ndarray:
        """Return for each cell the number of its connected part of the air, from 1 on; 0 in solid cells."""
        number = np.arange(self.volume.size).reshape(self.volume.shape)
        links = []
        for d, area in enumerate(self.area):
            lower = np.moveaxis(np.roll(number, 1, axis=d), d, 0)
            upper, leads = np.moveaxis(number, d, 0), np.moveaxis(area, d, 0)[:-1] > 0.0
            leads[0] &= self.periodic[d]  # otherwise the first face leads out of the domain
            links.append(np.stack([lower[leads], upper[leads]]))
        i, j = np.concatenate(links, axis=1)
        graph = csr_array((np.ones(len(i), np.int8), (i, j)), shape=(number.size, number.size))
        labels = connected_components(graph, directed=False)[1].reshape(number.shape)
        result = np.zeros(number.shape, int)
        result[~self.solid] = np.unique(labels[~self.solid], return_inverse=True)[1] + 1
        return result

    @staticmethod
    def of(solid: np.ndarray, grid: Grid) -> "Air":
        """Return the air around obstacles of whole cells; solid: mask of these cells, bool of grid.shape."""
        faces = [np.ones(_faces(grid, d)) for d in range(grid.dim)]
        return _closed(1.0 - solid, faces, [0.5 * a for a in faces], np.zeros(grid.shape, np.int32), grid)

    @staticmethod
    def everywhere(grid: Grid) -> "Air":
        """Return the air of a domain without obstacles."""
        return Air.of(np.zeros(grid.shape, bool), grid)

    def surface(self) -> np.ndarray:
        """Return the surface's area vector in each cell, out of the air, over a face's area: (*grid.shape, dim)."""
        sides = [np.delete(a, -1, axis=d) - np.delete(a, 0, axis=d) for d, a in enumerate(self.area)]
        result = np.stack(sides, axis=-1)
        for d, wraps in enumerate(self.periodic):
            if not wraps:  # a face covered by an opening or a wall of the domain is not part of the obstacle
                for cells, full in ((0, 1.0), (-1, -1.0)):
                    edge = np.moveaxis(result, d, 0)[cells]
                    closed = np.moveaxis(self.area[d], d, 0)[cells] == 0.0
                    edge[..., d] += np.where(closed & (np.moveaxis(self.volume, d, 0)[cells] > 0), full, 0.0)
        return result


@geometry_cached
def air_of(
    shapes: Sequence[Shape | None],
    grid: Grid,
    open_cells: np.ndarray | None = None,
    left: Fractions | None = None,
) -> Air:
    """Return the air around obstacles with these shapes; None stands for an absent shape, whose index stays reserved.

    open_cells: bool of grid.shape, cells at an opening; unless given, all cells at the domain's faces. Air stays if it
    is the largest connected part or reaches an open cell; air sealed off by obstacles counts as solid. left: air
    fractions of the cells and of the faces per axis beside other obstacles.
    """
    distance, nearest = _distances(shapes, grid)
    area, away = _face_fractions(distance)
    body = nearest[(slice(FINER // 2, None, FINER),) * grid.dim]
    known = _own_fractions(shapes, grid)
    if known:
        distance, _ = _distances([None if n in known else shape for n, shape in enumerate(shapes)], grid)
        area, _ = _face_fractions(distance)
    volume, _ = _fraction(distance, tuple(range(grid.dim)))
    for shares in [*known.values(), *([left] if left is not None else [])]:
        volume, area = volume * shares[0], [a * b for a, b in zip(area, shares[1], strict=True)]
    air = _closed(volume, area, away, body, grid)
    regions = air.regions()
    if regions.max() > 1:
        reached = np.zeros(grid.shape, bool)
        for d, area in enumerate(air.area):
            for end in (0, -1):
                np.moveaxis(reached, d, 0)[end] |= np.moveaxis(area, d, 0)[end] > 0.0
        if open_cells is not None:
            reached &= open_cells
        vented = np.union1d(regions[reached], 1 + np.bincount(regions.ravel())[1:].argmax())
        volume = np.where(np.isin(regions, vented), air.volume, 0.0)
        air = _closed(volume, list(air.area), away, body, grid)
    return _sealed(air, known)


def sealed(air: Air, shapes: Sequence[Shape | None], grid: Grid) -> Air:
    """Return the air of a film completed by `sealed`: the faces that thin walls among these shapes close."""
    return _sealed(air, _own_fractions(shapes, grid))


def _own_fractions(shapes: Sequence[Shape | None], grid: Grid) -> dict[int, Fractions]:
    """Return the air fractions of those shapes that provide them, by the shapes' indices."""
    given = {n: shape.shares(grid.shape, grid.dx) for n, shape in enumerate(shapes) if shape is not None}
    return {n: shares for n, shares in given.items() if shares is not None}


def _sealed(air: Air, known: dict[int, Fractions]) -> Air:
    if not known:
        return air
    shut = [np.any([shares[1][d] == 0.0 for shares in known.values()], axis=0) for d in range(len(air.area))]
    return replace(air, sealed=tuple(shut))


def _faces(grid: Grid, d: int) -> tuple[int, ...]:
    return tuple(n + (a == d) for a, n in enumerate(grid.shape))


def _distances(shapes: Sequence[Shape | None], grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Return the signed distance [cells] of each node to the nearest surface, at most 2, and the index of its shape."""
    nodes, step = tuple(FINER * n + 1 for n in grid.shape), grid.dx / FINER
    distance, nearest = np.full(nodes, 2.0, np.float32), np.full(nodes, -1, np.int32)
    for number, shape in enumerate(shapes):
        if shape is None:
            continue
        first = np.clip(np.floor(shape.low / step) - FINER, 0, nodes).astype(int)
        last = np.clip(np.ceil(shape.high / step) + FINER + 1, 0, nodes).astype(int)
        block = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        axes = [np.arange(a, b) * step for a, b in zip(first, last, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        if points.size:
            here = shape.signed_distance(points) / grid.dx
            closer = here < distance[block]
            distance[block] = np.where(closer, here, distance[block])
            nearest[block] = np.where(closer, number, nearest[block])
    distance[np.abs(distance) < TIE] = 0.0  # on the surface, in spite of rounding
    return distance, nearest


def _face_fractions(distance: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the air fractions of the faces, and their open parts' mean distances from surfaces, per axis."""
    dim = distance.ndim
    area, mean = zip(
        *(_fraction(distance, tuple(a for a in range(dim) if a != d)) for d in range(dim)), strict=True
    )
    return list(area), list(mean)


def _fraction(distance: np.ndarray, axes: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the fraction with positive distance of faces or cells that span `axes`, and the mean distance there."""
    dim = distance.ndim
    ends = [
        (slice(None, -1), slice(1, None)) if a in axes else (slice(None, None, FINER),) for a in range(dim)
    ]
    corners = [distance[index] for index in product(*ends)]  # corners of every part, axis 0 slowest
    low, high, total = corners[0], corners[0], np.zeros_like(corners[0])
    for corner in corners:
        low, high = np.minimum(low, corner), np.maximum(high, corner)
        total += np.maximum(corner, 0.0) / len(corners)
    share = np.where(high <= 0.0, np.float32(0.0), np.float32(1.0))
    cut = (low < 0.0) & (high > 0.0)
    values = np.stack([corner[cut] for corner in corners], axis=-1)
    share[cut], total[cut] = _integrate(values.reshape(-1, *[2] * len(axes)))
    parts = tuple(FINER if a in axes else 1 for a in range(dim))
    share, total = block_mean(share, parts), block_mean(total, parts)
    mean = total / np.maximum(share, 1e-6)
    return np.where(share < SLIVER, 0.0, np.where(share > 1.0 - TIE, 1.0, share)), mean


def _integrate(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positive fraction, and the integral of the positive values, of intervals, squares or cubes.

    corners: values (n, 2, ...). Around the centre of a square or cube, and of each side of it, which have the mean of
    their corners, it is divided into simplices, in which the values are linear.
    """
    simplices = [np.stack(simplex, axis=-1) for simplex in _simplices(corners)]
    shares, totals = zip(*(_positive(values) for values in simplices), strict=True)
    return np.mean(shares, axis=0), np.mean(totals, axis=0)


def _simplices(corners: np.ndarray) -> list[list[np.ndarray]]:
    """Return the values (n,) at the corners of each simplex of equal volume; corners: values (n, 2, ...)."""
    dim = corners.ndim - 1
    if dim == 1:
        return [[corners[:, 0], corners[:, 1]]]
    middle = corners.mean(axis=tuple(range(1, dim + 1)), dtype=float)
    sides = [np.take(corners, end, axis=axis) for axis in range(1, dim + 1) for end in (0, 1)]
    return [[middle, *simplex] for side in sides for simplex in _simplices(side)]


def _positive(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positive fraction (n,), and the integral of the positive values, of simplices of volume 1 in which
    the values are linear; values (n, dim + 1) at their corners, dim up to 3.
    """
    sorted_values = np.sort(values.astype(float), axis=1)
    count = (sorted_values > 0.0).sum(axis=1)
    corners = values.shape[1]
    share, total = (count == corners).astype(float), np.zeros(len(values))
    total[count == corners] = sorted_values[count == corners].mean(axis=1)
    single, all_but_single = count == 1, (count == corners - 1) & (corners > 2)
    for part, sign in (
        (single, 1.0),
        (all_but_single, -1.0),
    ):  # the corner that differs in sign cuts off a simplex
        v = sign * sorted_values[part]
        tip, base = (v[:, -1:], v[:, :-1]) if sign > 0.0 else (v[:, :1], v[:, 1:])
        cut = (tip / (tip - base)).prod(axis=1)
        mean = cut * tip[:, 0] / corners
        share[part] = cut if sign > 0.0 else 1.0 - cut
        total[part] = mean if sign > 0.0 else sorted_values[part].mean(axis=1) + mean
    if corners == 4:
        two = count == 2
        d, c, b, a = sorted_values[two].T  # a and b are positive
        # where the surface cuts the edges
        ad, ac, bd, bc = a / (a - d), a / (a - c), b / (b - d), b / (b - c)
        first, second, third = ad * ac, (1.0 - ad) * ac * bd, (1.0 - ac) * bd * bc  # tetrahedra of the wedge
        share[two] = first + second + third
        total[two] = (first * (a + b) + (second + third) * b) / 4.0
    return share, total


def _closed(
    volume: np.ndarray, area: list[np.ndarray], distance: list[np.ndarray], body: np.ndarray, grid: Grid
) -> Air:
    """Return the air with consistent faces, which lead from air to air; cells without an open face become solid.

    A face of the domain is open if half of the cell behind is air, else closed.
    """
    volume = volume.astype(np.float32)
    area = [a.astype(np.float32) for a in area]
    for _ in range(2):  # cells without faces close their neighbours' faces
        for d in range(grid.dim):
            faces, cells = np.moveaxis(area[d], d, 0), np.moveaxis(volume, d, 0)
            faces[1:-1] *= (cells[1:] > 0.0) & (cells[:-1] > 0.0)
            if grid.periodic[d]:
                faces[0] = np.minimum(faces[0], faces[-1]) * ((cells[0] > 0.0) & (cells[-1] > 0.0))
                faces[-1] = faces[0]
            else:
                faces[0], faces[-1] = cells[0] >= 0.5, cells[-1] >= 0.5
        widest = _widest(area, grid.dim)
        volume = np.where(widest > 0.0, np.maximum(volume, SLIVER), 0.0)
    return Air(volume, tuple(area), tuple(distance), body, grid.periodic)


def _widest(area: list[np.ndarray], dim: int) -> np.ndarray:
    """Return the largest area fraction among each cell's faces."""
    sides = [np.delete(area[d], end, axis=d) for d in range(dim) for end in (0, -1)]
    return np.max(sides, axis=0)
