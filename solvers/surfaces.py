"""Friction of the air on obstacles, for the few faces whose volume holds some of their surface."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.kernels import Pass, Template
from taichi_plume.grid.tables import Tables
from taichi_plume.grid.transfer import uploader
from taichi_plume.solvers.extension import Extension
from taichi_plume.solvers.momentum import Momentum
from taichi_plume.solvers.wall_law import near_surface
from taichi_plume.solvers.walls import straightness

NEAREST = 0.05  # cells: no distance from a surface counts as less


@ti.data_oriented
class Surfaces:
    """What slows the velocities beside obstacles: the stress nu_w u_t/s of the velocity u_t along a surface s away,
    nu_w by the law of the wall where there is a model of eddies.

    area, openness: padded arrays of the fields `area` and `open` of the flow. vectors: of the surface in each cell,
    padded; faces: which they are, (n, dim) of each axis; cells: their number.
    """

    def __init__(
        self,
        momentum: Momentum,
        air: Air,
        area: list[np.ndarray],
        openness: list[np.ndarray],
        tables: Tables,
    ):
        self.m = momentum
        self.roughness = ti.field(ti.f32, ())
        self._put = uploader(self.roughness)
        self.grid = grid = momentum.grid
        self.dim = grid.dim
        self.vectors = vectors = np.stack(
            [grid.pad(part) for part in np.moveaxis(air.surface(), -1, 0)], axis=-1
        )
        self.faces: list[np.ndarray] = []
        self._count: list[int] = []
        self._cell: list[Any] = []
        self._distance: list[Any] = []  # of the face's middle from the surface [m]
        self._rate: list[Any] = []  # surface over (distance times stored volume), in cells
        self._stored: list[Any] = []  # volume that stores the momentum of the face, in cells
        self._normal: list[Any] = []  # of the surface, out of the air
        for d in range(grid.dim):
            above, below = np.roll(area[d], -1, axis=d), np.roll(area[d], 1, axis=d)
            # a cell's surface acts on its two faces of an axis, in proportion to their areas
            upper = (area[d] / np.maximum(area[d] + above, 1e-6))[..., None] * vectors
            lower = (area[d] / np.maximum(area[d] + below, 1e-6))[..., None] * np.roll(vectors, 1, axis=d)
            size = np.linalg.norm(upper, axis=-1) + np.linalg.norm(lower, axis=-1)
            inner = np.zeros(grid.padded, bool)
            inner[tuple(slice(begin, end) for begin, end in grid.faces(d))] = True
            cell = np.argwhere(inner & (size > 1e-6) & (openness[d] > 0.0))
            where = tuple(cell.T)
            stored = area[d][where] / openness[d][where]
            distance = np.maximum(grid.pad_faces(air.distance[d], d)[where], NEAREST)
            normal = (upper + lower)[where]
            normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
            self.faces.append(cell)
            self._count.append(len(cell))
            self._cell.append(tables.listed(cell))
            self._distance.append(tables.listed(distance * grid.dx))
            self._rate.append(tables.listed(size[where] / (distance * stored)))
            self._stored.append(tables.listed(stored))
            self._normal.append(tables.listed(normal))
        self.cells = sum(self._count)
        self._extension = Extension(self, area, tables) if momentum.eddies else None

    def begin(self, roughness: float | None) -> None:
        """Take k_s [m] over."""
        self._put(roughness or 0.0)

    def slipping(self, convection: Pass) -> list[Pass]:
        """The pass with velocities on closed faces as `extension` has them, which are 0 before and after."""
        if self._extension is None or self._extension.cells == 0:
            return [convection]
        return [self._extension.setting(), convection, self._extension.clearing()]

    @ti.func
    def _along(self, d: Template, k):
        """(velocity u_d along the surface, speed along it) [m/s] at the k-th face of axis d."""
        I, n = self._cell[d][k], self._normal[d][k]
        D = ti.Vector.unit(self.dim, d, ti.i32)
        through = n[d] * self.m.u[d][I]
        square = self.m.u[d][I] ** 2
        for e in ti.static(range(self.dim)):
            if ti.static(e != d):
                E = ti.Vector.unit(self.dim, e, ti.i32)
                flow, width = 0.0, 1e-6
                for J in ti.static((0, 1)):
                    for K in ti.static((0, 1)):
                        face = I - J * D + K * E
                        flow += self.m.area[e][face] * self.m.u[e][face]
                        width += self.m.area[e][face]
                through += n[e] * flow / width
                square += (flow / width) ** 2
        return self.m.u[d][I] - n[d] * through, ti.sqrt(ti.max(square - through**2, 0.0))

    @ti.func
    def _friction(self, d: Template, k):
        """(face, rate [1/s] of friction, velocity along the surface [m/s]) of the k-th face of axis d."""
        along, speed = self._along(d, k)
        nu_here = self.m.viscosity[None]
        if ti.static(self.m.eddies):
            y = self._distance[d][k]
            nu_here, _ = near_surface(speed, y, nu_here, self.roughness[None], self.m.rough)
        return self._cell[d][k], self._rate[d][k] * nu_here / ti.static(self.grid.dx**2), along

    @ti.func
    def slip(self, d: Template, k):
        """Velocity u_d [m/s] with which the air at the k-th face of axis d goes on beyond the surface: its own, or 0
        where half a cell from the surface the viscous layer is resolved, as it is at walls (see `straightness`).

        What is left of a velocity through the surface is not taken off: it would be found from faces at other distances
        from the surface, and what they are faster would be driven into the air.
        """
        _, speed = self._along(d, k)
        y = ti.max(self._distance[d][k], ti.static(0.5 * self.grid.dx))
        _, bend = near_surface(speed, y, self.m.viscosity[None], self.roughness[None], self.m.rough)
        return (1.0 - straightness(bend)) * self.m.u[d][self._cell[d][k]]

    @ti.func
    def slow(self, rate: Template, dt: float):
        """Take friction off the rates of change of u [m/s²]; implicit, as it is stiff close to a surface."""
        for d in ti.static(range(self.dim)):
            for k in range(ti.static(self._count[d])):
                I, f, along = self._friction(d, k)
                rate[d][I] = (rate[d][I] - f * along) / (1.0 + dt * f)

    @ti.func
    def add_loss(self, loss: Template):
        """Add the momentum that friction takes [m/s² of a whole cell]."""
        for d in ti.static(range(self.dim)):
            for k in range(ti.static(self._count[d])):
                I, f, along = self._friction(d, k)
                loss[d][I] = loss[d][I] + self._stored[d][k] * f * along
