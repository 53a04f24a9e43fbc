"""Friction of the air on the walls of the domain, by the law of the wall, and distances from all surfaces.

Beyond the viscous layer the velocity bends far more at a wall than cells can tell. What lies beyond the wall then goes
on as the law of the wall bends in the middle of the first cell, which is what convection and eddies need; and the
viscosity there is the one that with that slope has the law's stress. Where the viscous layer is resolved both are as
without the law.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti
from scipy.ndimage import distance_transform_edt

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass, Template, visit
from taichi_plume.grid.sweeps import sweep
from taichi_plume.grid.transfer import uploader
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.wall_law import near_surface

FAR = 1e3  # m: distance where there is no surface


@ti.data_oriented
class Walls:
    """What the law of the wall makes of the cells at the domain's walls, per boundary face.

    bend: d ln u/d ln y in the middle of the cell, 1 where the profile is straight and on all that is no wall;
    viscosity [m²/s]: that has the stress of the law with the slope that the ghost values make.
    """

    def __init__(self, boundaries: Boundaries, molecular: Any, rough: bool):
        """molecular: field () of the viscosity [m²/s]; rough: whether they may be."""
        self.rough = rough
        self.b, self.molecular = boundaries, molecular
        self.grid, self.dim = boundaries.grid, boundaries.dim
        self.bend, self.viscosity = (
            tuple(self.grid.field(shape) for shape in boundaries.sides) for _ in range(2)
        )
        self.roughness = ti.field(ti.f32, ())
        self._put = uploader(self.roughness)

    def begin(self, roughness: float | None) -> None:
        """Take k_s [m] over."""
        self._put(roughness or 0.0)

    def _visit(self, body: Callable[..., None]) -> Pass:
        def of_axis(d: int) -> Callable:
            @ti.func
            def visited(K, a, b):
                body(K, d)

            return visited

        axes = [d for d in range(self.dim) if self.b.is_wall[d].any()]
        return visit([of_axis(d) for d in axes], [self.b.sides[d] for d in axes])

    def measuring(self, u: Any) -> list[Pass]:
        """Take the law from the velocities u."""

        def of_axis(d: int) -> Callable:
            @ti.func
            def measure(K, a, b):
                return self._measured(u, K, d)

            return measure

        axes = [d for d in range(self.dim) if self.b.is_wall[d].any()]
        inner = {d: [(0, n - (a != d)) for a, n in enumerate(self.b.sides[d])] for d in axes}
        return [sweep([of_axis(d)], [(self.bend[d], self.viscosity[d])], inner[d]) for d in axes]

    def slowing(self, nu: Any) -> Pass:
        """Sets nu beyond the walls such that the mean with that inside is the law's."""

        @ti.func
        def beyond(K, d: Template):
            if self.b.mirror[d][K][d] < 0.0:
                first, outward = self.first_cell(K, d)
                nu[first + outward] = 2.0 * self.viscosity[d][K] - nu[first]

        return self._visit(beyond)

    @ti.func
    def first_cell(self, K, d: Template):
        """Index of the first cell inside of boundary face K of axis d, and the step out of the domain."""
        D = ti.Vector.unit(self.dim, d, ti.i32)
        n, g = ti.static(self.grid.shape[d], self.grid.ghost)
        return K + D * (g + K[d] * (n - 1) - K[d]), D * (2 * K[d] - 1)

    @ti.func
    def _measured(self, u: Template, K, d: Template):
        """(bend, viscosity) of the first cell inside of boundary face K of axis d."""
        cell, _ = self.first_cell(K, d)
        V, y = self.b.target[d][K], ti.static(0.5 * self.grid.dx)
        square = 0.0
        for c in ti.static(range(self.dim)):
            if ti.static(c != d):
                above = cell + ti.Vector.unit(self.dim, c, ti.i32)
                square += (0.5 * (u[c][cell] + u[c][above]) - V[c]) ** 2
        speed, molecular, grain = ti.sqrt(square), self.molecular[None], self.roughness[None]
        viscosity, bend = near_surface(speed, y, molecular, grain, self.rough)
        bend = ti.select(self.b.mirror[d][K][d] < 0.0, bend, 1.0)
        straight = straightness(bend)
        return ti.Vector([bend, viscosity / (straight + (1.0 - straight) * bend)])

    @ti.func
    def bend_at(self, K: Template, d: Template, c: Template):
        """d ln u/d ln y of component c, whose face is between the cells at K and below it."""
        below = K
        below[c] = ti.max(K[c] - 1, 0)
        return 0.5 * (self.bend[d][K] + self.bend[d][below])


def walls_of(boundaries: Boundaries, molecular: Any, rough: bool) -> Walls | None:
    """Those of a domain; None where it has none."""
    return Walls(boundaries, molecular, rough) if any(faces.any() for faces in boundaries.is_wall) else None


@ti.func
def straightness(bend):
    """How much a first cell counts as resolved: 1 in the viscous layer, 0 from where u goes with the root of y on."""
    return ti.math.clamp(2.0 * bend - 1.0, 0.0, 1.0)


def distances(air: Air, walls: list[np.ndarray], grid: Grid) -> np.ndarray:
    """Distance [m] of the cells' centres from the next surface, (*grid.shape): obstacles' as the cut cells have them.

    walls: per axis which faces of its two sides are walls, bool, of the grid's shape but for 2 along the axis.
    """
    nearest = np.zeros((*(n + 2 for n in grid.shape), grid.dim), np.float32)
    known = np.zeros([n + 2 for n in grid.shape], bool)
    inside = (slice(1, -1),) * grid.dim
    for d, sides in enumerate(walls):
        for side in (0, 1):
            place = [slice(1, -1)] * grid.dim
            place[d] = slice(-1, None) if side else slice(0, 1)
            known[tuple(place)] = np.take(sides, [side], axis=d)
            nearest[(*place, d)] = (
                0.5 if side == 0 else -0.5
            )  # the face is half a cell inside of the ghost's centre
    if not air.empty:
        vectors = air.surface()
        size = np.linalg.norm(vectors, axis=-1)
        at = (size > 1e-6) & ~air.solid
        weight = sum(np.delete(a, end, axis=d) for d, a in enumerate(air.area) for end in (0, -1))
        total = sum(
            np.delete(a * s, end, axis=d)
            for d, (a, s) in enumerate(zip(air.area, air.distance, strict=True))
            for end in (0, -1)
        )
        away = np.where(at, total / np.maximum(weight, 1e-6), 0.0)
        known[inside] |= at
        nearest[inside] = np.where(
            at[..., None], (away / np.maximum(size, 1e-6))[..., None] * vectors, nearest[inside]
        )
    if not known.any():
        return np.full(grid.shape, FAR, np.float32)
    wide = [(n // 2, n // 2) if wraps else (0, 0) for n, wraps in zip(grid.shape, grid.periodic, strict=True)]
    return np.maximum(_to_nearest(known, nearest, wide)[inside], 0.5) * grid.dx


def _to_nearest(known: np.ndarray, nearest: np.ndarray, wide: list[tuple[int, int]]) -> np.ndarray:
    """Distance [cells] of all cells from the surface point of the known cell next to them.

    nearest: from a known cell's centre to its surface point [cells]; wide: how far periodic axes go on, with the layer
    around them.
    """
    for d, (before, after) in enumerate(wide):
        if before:
            known, nearest = (np.delete(a, (0, -1), axis=d) for a in (known, nearest))
            width = [(before + 1, after + 1) if a == d else (0, 0) for a in range(known.ndim)]
            known, nearest = np.pad(known, width, mode="wrap"), np.pad(nearest, [*width, (0, 0)], mode="wrap")
    index = np.asarray(distance_transform_edt(~known, return_distances=False, return_indices=True))
    point = np.moveaxis(nearest[tuple(index)], -1, 0) + index - np.indices(known.shape)
    inner = tuple(slice(before, known.shape[d] - after) for d, (before, after) in enumerate(wide))
    return np.sqrt((point**2).sum(axis=0))[inner]
