"""Wall functions: friction on the walls of the domain by the law of the wall, and distances from all surfaces.

Beyond the viscous layer the velocity profile bends more at a wall than cells resolve. The ghost values then continue
the slope of the law of the wall in the middle of the first cell, for convection and eddy viscosity. The viscosity at
the wall is chosen such that this slope gives the wall stress of the law. If the viscous layer is resolved, neither
changes.
"""

from functools import partial
from typing import cast

import numpy as np
from scipy.spatial import cKDTree

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.geometry_cache import geometry_cached
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass, Template
from taichi_plume.grid.sweeps import sweep
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.momentum import Momentum
from taichi_plume.solvers.wall_law import near_surface, y_plus

FAR = 1e3  # m: distance without a surface


class Walls:
    """Law of the wall in the cells at the domain's walls, per boundary face.

    bend: d ln u/d ln y in the middle of the cell, 1 for a straight profile and without a wall; viscosity [m²/s]:
    viscosity at the wall that, with the slope of the ghost values, gives the wall stress of the law.
    """

    def __init__(self, boundaries: Boundaries, momentum: Momentum):
        self.b, self.m = boundaries, momentum
        self.grid, self.dim = boundaries.grid, boundaries.dim
        self.bend, self.viscosity = (
            tuple(self.grid.field(shape) for shape in boundaries.sides) for _ in range(2)
        )

    def measuring(self, u: Field) -> list[Pass]:
        """Return the passes that compute `bend` and `viscosity` by the law of the wall for the velocities u."""
        axes = [d for d in range(self.dim) if self.b.is_wall[d].any()]
        inner = {d: [(0, n - (a != d)) for a, n in enumerate(self.b.sides[d])] for d in axes}
        return [
            sweep(
                partial(self._measured, u, d), (self.bend[d], self.viscosity[d]), inner[d], axis=int(d == 0)
            )
            for d in axes
        ]

    def extending(self, nu: Field) -> list[Pass]:
        """Return the passes that set the viscosity nu beyond the domain's faces: at walls such that the mean with the
        cell inside is that of the law, elsewhere as inside (zero gradient).
        """
        return [
            sweep(
                partial(self._beyond, nu, d),
                nu,
                [(0, n) for n in self.b.sides[d]],
                partial(self._outside, d),
                int(d == 0),
            )
            for d in range(self.dim)
            if not self.grid.periodic[d]
        ]

    @ti.func
    def _outside(self, d: Template, K, m: Template):
        first, outward = self.first_cell(K, d)
        return first + outward

    @ti.func
    def _beyond(self, nu: Template, d: Template, K, a, b):
        first, _ = self.first_cell(K, d)
        wall = self.b.mirror[d][K][d] < 0.0
        return ti.select(wall, 2.0 * self.viscosity[d][K] - nu[first], nu[first])

    @ti.func
    def first_cell(self, K, d: Template):
        """Return the first cell inside boundary face K of axis d, and the step out of the domain."""
        D = ti.Vector.unit(self.dim, d, ti.i32)
        n, g = ti.static(self.grid.shape[d], self.grid.ghost)
        return K + D * (g + K[d] * (n - 1) - K[d]), D * (2 * K[d] - 1)

    @ti.func
    def _measured(self, u: Template, d: Template, K, a, b):
        """Return (bend, viscosity [m²/s]) by the law of the wall in the first cell inside boundary face K of axis d."""
        cell, _ = self.first_cell(K, d)
        y = ti.static(0.5 * self.grid.dx)
        square = 0.0
        for c in ti.static(range(self.dim)):
            if ti.static(c != d):
                C = ti.Vector.unit(self.dim, c, ti.i32)
                V = 0.5 * (self.b.target[d][K][c] + self.b.target[d][K + C][c])
                square += (0.5 * (u[c][cell] + u[c][cell + C]) - V) ** 2
        speed, molecular, grain = ti.sqrt(square), self.m.viscosity[None], self.m.roughness[None]
        viscosity, bend = near_surface(speed, y, molecular, grain, self.m.rough)
        bend = ti.select(self.b.mirror[d][K][d] < 0.0, bend, 1.0)
        straight = straightness(bend)
        return ti.Vector([bend, viscosity / (straight + (1.0 - straight) * bend)])

    def y_plus(self, u: list[np.ndarray]) -> np.ndarray:
        """Return y+ in the middles of the cells of air at the walls, (count,), by the law of the wall.

        u: face velocities per axis [m/s], padded arrays.
        """
        inner, targets = self.grid.cells, [target.values for target in self.b.target]
        middle = [0.5 * (v + np.roll(v, -1, axis=c)) for c, v in enumerate(u)]
        found = [np.empty(0)]
        for d in range(self.dim):
            window = tuple(slice(None) if a == d else slice(*ends) for a, ends in enumerate(inner))
            square = np.zeros(self.b.sides[d])
            for c in range(self.dim):
                if c != d:
                    sliding = 0.5 * (targets[d][..., c] + np.roll(targets[d][..., c], -1, axis=c))
                    first = np.take(middle[c], (inner[d][0], inner[d][1] - 1), axis=d)
                    square += (first - sliding) ** 2
            found.append(np.sqrt(square[window][self.b.is_wall[d]]))
        speeds = np.concatenate(found)
        viscosity, roughness = (cast(float, field[None]) for field in (self.m.viscosity, self.m.roughness))
        if viscosity <= 0.0:
            return np.empty(0)
        return y_plus(speeds[speeds > 0.0], 0.5 * self.grid.dx, viscosity, roughness)

    @ti.func
    def bend_at(self, K: Template, d: Template, c: Template):
        """Return d ln u/d ln y for component c, mean of the boundary faces K and K - 1 along c; d: axis of the wall."""
        return 0.5 * (self.bend[d][K] + self.bend[d][lower_face(K, d, c)])


@ti.func
def lower_face(K, d: Template, c: Template):
    """Return the boundary face below K along c, or K if it is the first; d: axis of the boundary. Along x, in sweeps
    over faces of the other axes, K is never the first.
    """
    C = ti.Vector.unit(K.n, c, ti.i32)
    if ti.static(c == 0 and d > 0):
        return K - C
    else:  # noqa: RET505  Taichi compiles one branch only
        return K - C * ti.min(K[c], 1)


@ti.func
def straightness(bend):
    """Return how well a wall cell resolves the profile with `bend`: 1 in the viscous layer, 0 from u ~ sqrt(y) on."""
    return ti.math.clamp(2.0 * bend - 1.0, 0.0, 1.0)


def distances(air: Air, walls: list[np.ndarray], grid: Grid) -> np.ndarray:
    """Return the distance [m] of the cells' centres from the nearest surface, (*grid.shape), at least half a cell.

    Surfaces are the middles of the domain's wall faces and, in each cell that an obstacle cuts, the point of the
    obstacle's surface that is nearest to the centre.

    walls: per axis a mask of the wall faces on its two sides, of the grid's shape but 2 along the axis.
    """
    points = [_wall_points(sides, d, grid) for d, sides in enumerate(walls)]
    if not air.empty:
        points.append(_obstacle_points(air))
    return _from_points(points, grid)


@geometry_cached
def _from_points(points: list[np.ndarray], grid: Grid) -> np.ndarray:
    surface = np.concatenate(points)
    if not len(surface):
        return np.full(grid.shape, FAR, np.float32)
    period = np.where(grid.periodic, grid.shape, 0.0)
    surface = np.where(period > 0.0, surface % np.maximum(period, 1.0), surface)
    centers = np.moveaxis(np.indices(grid.shape), 0, -1) + 0.5
    away, _ = cKDTree(surface, boxsize=period).query(centers, workers=-1)
    return (np.maximum(away, 0.5) * grid.dx).astype(np.float32)


def _wall_points(sides: np.ndarray, d: int, grid: Grid) -> np.ndarray:
    """Return the centres of the wall faces across axis d, (count, dim) [cells]; sides: mask of the wall faces."""
    index = np.argwhere(sides)
    points = index + 0.5
    points[:, d] = index[:, d] * grid.shape[d]
    return points


def _obstacle_points(air: Air) -> np.ndarray:
    """Return, for each cell that an obstacle cuts, the surface point nearest to its centre, (count, dim) [cells]."""
    vectors = air.surface()
    size = np.linalg.norm(vectors, axis=-1)
    cut = (size > 1e-6) & ~air.solid
    weight = sum(np.delete(a, end, axis=d) for d, a in enumerate(air.area) for end in (0, -1))
    total = sum(
        np.delete(a * s, end, axis=d)
        for d, (a, s) in enumerate(zip(air.area, air.distance, strict=True))
        for end in (0, -1)
    )
    away = total[cut] / np.maximum(weight[cut], 1e-6)
    return np.argwhere(cut) + 0.5 + (away / size[cut])[:, None] * vectors[cut]
