"""Friction of the air on obstacles (wall stress) and separation of the flow from bluff bodies, at the faces whose
volume holds a part of the surface.

The law of the wall holds for attached layers. Where the pressure rises along a convex surface, the air next to the
surface comes to rest and the flow separates. On a cylinder or a sphere this layer is thinner than a cell, and with only
the friction of the law of the wall the flow stays attached too long. There the layer is made as thick as the grid
needs: the wall stress is that of air at rest on the surface (no-slip), nu_w = (C dx)² D² |u_t|/s, with Smagorinsky's
length and van Driest's damping D. The separation point of a laminar layer does not depend on its thickness (Thwaites
1949, doi:10.1017/S0001925900000184), as long as the layer is thin compared with the body.
"""

from functools import partial

import numpy as np
from scipy.ndimage import correlate1d, uniform_filter1d

from taichi_plume.engine import ti
from taichi_plume.engine.fields import LANES, Field, on_cpu
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Faces
from taichi_plume.grid.kernels import Pass, Template, each, together
from taichi_plume.solvers.extension import REACH, Extension
from taichi_plume.solvers.momentum import Momentum
from taichi_plume.solvers.turbulence import damped
from taichi_plume.solvers.wall_law import near_surface
from taichi_plume.solvers.walls import straightness

# 1/cells: least curvature of a convex surface. Oblique planes that the grid cuts have up to 0.016.
CONVEX = 0.02


def curvatures(vectors: np.ndarray, cells: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the sum of the principal curvatures of the surface around each cell, (n,) [1/cells], positive if convex.

    The normals of a surface of curvature k turn by k s over a length s, so that the integral of n' s over all surface
    within REACH is -k times the integral of s². vectors: area vectors of the surface, (*padded, dim); cells: padded
    indices (n, dim); normals: of the surface at each cell, (n, dim); both out of the air.
    """
    dim, where = vectors.shape[-1], tuple(cells.T)
    steps = np.arange(-REACH, REACH + 1.0)

    def over_window(values: np.ndarray, skipped: int = -1) -> np.ndarray:
        for axis in range(dim):
            if axis != skipped:
                values = uniform_filter1d(values, len(steps), axis=axis, mode="nearest")
        return values

    moments = np.empty((len(cells), dim, dim))  # of the areas' components i along the axes j
    for j in range(dim):
        along = correlate1d(vectors, steps / len(steps), axis=j, mode="nearest")
        moments[:, :, j] = over_window(along, skipped=j)[where]
    turning = np.einsum("ni,nij,nj->n", normals, moments, normals) - np.trace(moments, axis1=1, axis2=2)
    area = over_window(np.linalg.norm(vectors, axis=-1))[where]
    return turning / np.maximum(area * len(steps) ** 2 / 12.0, 1e-6)


NEAREST = 0.05  # cells: lower bound of distances from a surface
LEAST = 0.25  # cells: least distance over which the velocity of a layer that separates rises
MIXING = 0.13  # cells: mixing length C of a layer that separates, as Smagorinsky's constant


class Surfaces:
    """Wall stress nu_w u_t/s on obstacles, u_t the tangential velocity at a distance s from a surface. nu_w follows
    from the law of the wall if there is a turbulence model; on convex surfaces in an adverse pressure gradient from a
    layer that can separate.

    area, fractions: padded arrays of the fields `area` and `open` of the flow. vectors: area vector of the surface in
    each cell, padded; faces: indices of the faces, (n, dim) of each axis; cells: number of cells.
    """

    def __init__(
        self,
        momentum: Momentum,
        air: Air,
        area: list[np.ndarray],
        fractions: list[np.ndarray],
    ):
        self.m = momentum
        self.grid = grid = momentum.grid
        self.dim = grid.dim
        self.vectors = vectors = np.stack(
            [grid.pad(part) for part in np.moveaxis(air.surface(), -1, 0)], axis=-1
        )
        self.faces: list[np.ndarray] = []
        normals: list[np.ndarray] = []
        fields: list[list[Field]] = []  # per axis
        for d in range(grid.dim):
            above, below = np.roll(area[d], -1, axis=d), np.roll(area[d], 1, axis=d)
            # a cell's surface acts on its two faces of an axis, in proportion to their areas
            upper = (area[d] / np.maximum(area[d] + above, 1e-6))[..., None] * vectors
            lower = (area[d] / np.maximum(area[d] + below, 1e-6))[..., None] * np.roll(vectors, 1, axis=d)
            size = np.linalg.norm(upper, axis=-1) + np.linalg.norm(lower, axis=-1)
            inner = np.zeros(grid.padded, bool)
            inner[tuple(slice(begin, end) for begin, end in grid.faces(d))] = True
            cell = np.argwhere(inner & (size > 1e-6) & (fractions[d] > 0.0))
            where = tuple(cell.T)
            stored = area[d][where] / fractions[d][where]
            distance = np.maximum(grid.pad_faces(air.distance[d], d)[where], NEAREST)
            normal = (upper + lower)[where]
            normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
            self.faces.append(cell)
            normals.append(normal)
            per_face = (distance * grid.dx, size[where] / (distance * stored), stored)
            fields.append([ti.filled_vectors(cell), *map(ti.filled, per_face), ti.filled_vectors(normal)])
        # distance of the face's middle from the surface [m]; rate: surface area/(distance times stored volume), in
        # cells; stored: volume that stores the momentum of the face, in cells; normal of the surface, out of the air
        self._cell, self._distance, self._rate, self._stored, self._normal = zip(*fields, strict=True)
        self._coefficient = [ti.filled(np.zeros(len(cell))) for cell in self.faces]  # see `measure`
        self._count = [len(cell) for cell in self.faces]
        self.cells = sum(self._count)
        self._extension: Extension | None = None
        # mixing length [m] of a layer that can separate, 0 on plane and concave surfaces
        self._mixing: list[Field] = []
        if momentum.eddies:
            convex = curvatures(vectors, np.concatenate(self.faces), np.concatenate(normals)) > CONVEX
            parts = np.split(convex, np.cumsum(self._count)[:-1])
            self._mixing = [ti.filled(np.where(part, MIXING * grid.dx, 0.0)) for part in parts]
            self._extension = Extension(self, convex, area)

    def slipping(self, convection: list[Pass]) -> list[Pass]:
        """Return `convection` between passes that extend velocities to closed faces and reset them to 0."""
        if self._extension is None or self._extension.cells == 0:
            return convection
        return [*self._extension.setting(), *convection, *self._extension.clearing()]

    @ti.func
    def _along(self, d: Template, k):
        """Return the tangential velocity (dim,) [m/s] at the k-th surface face of axis d."""
        I, n = self._cell[d][k], self._normal[d][k]
        D = ti.Vector.unit(self.dim, d, ti.i32)
        u = ti.Vector.zero(ti.f32, self.dim)
        u[d] = self.m.u[d][I]
        for e in ti.static(range(self.dim)):
            if ti.static(e != d):
                E = ti.Vector.unit(self.dim, e, ti.i32)
                width = 1e-6
                for J in ti.static((0, 1)):
                    for K in ti.static((0, 1)):
                        face = I - J * D + K * E
                        u[e] += self.m.area[e][face] * self.m.u[e][face]
                        width += self.m.area[e][face]
                u[e] /= width
        return u - n * n.dot(u)

    @ti.func
    def _is_adverse(self, d: Template, k, along):
        """Return whether the pressure gradient is adverse at the k-th surface face of axis d: it rises along the
        tangential velocity `along`.
        """
        I = self._cell[d][k]
        D = ti.Vector.unit(self.dim, d, ti.i32)
        rise = along[d] * (self.m.p[I] - self.m.p[I - D])
        for e in ti.static(range(self.dim)):
            if ti.static(e != d):
                E = ti.Vector.unit(self.dim, e, ti.i32)
                total, width = 0.0, 1e-6
                for J in ti.static((0, 1)):
                    for K in ti.static((0, 1)):
                        face = I - J * D + K * E
                        total += self.m.area[e][face] * (self.m.p[face] - self.m.p[face - E])
                        width += self.m.area[e][face]
                rise += along[e] * total / width
        return rise > 0.0

    @ti.func
    def _friction(self, d: Template, k):
        """Return the friction coefficient [1/s] of the k-th surface face of axis d: friction over velocity."""
        along, nu = self._along(d, k), self.m.viscosity[None]
        wall = nu
        if ti.static(self.m.eddies):
            y, speed = self._distance[d][k], along.norm()
            wall, _ = near_surface(speed, y, nu, self.m.roughness[None], self.m.rough)
            if self._mixing[d][k] > 0.0 and self._is_adverse(d, k, along):
                wide = ti.max(y, ti.static(LEAST * self.grid.dx))
                wall = ti.max(wall, nu + damped(self._mixing[d][k], speed / wide, wide, nu))
        return self._rate[d][k] * wall / ti.static(self.grid.dx**2)

    @ti.func
    def slip(self, d: Template, k):
        """Return the velocity u_d [m/s] to extend beyond the surface at the k-th face of axis d: the velocity of the
        face, or 0 if the viscous layer is resolved half a cell from the surface, as at walls (see `straightness`).

        A remaining velocity normal to the surface is not removed: it would come from faces at other distances from the
        surface, and their excess speed would be driven into the air.
        """
        speed = self._along(d, k).norm()
        y = ti.max(self._distance[d][k], ti.static(0.5 * self.grid.dx))
        _, bend = near_surface(speed, y, self.m.viscosity[None], self.m.roughness[None], self.m.rough)
        return (1.0 - straightness(bend)) * self.m.u[d][self._cell[d][k]]

    def measuring(self) -> list[Pass]:
        """Return the passes that compute the friction coefficients of all surface faces for the present velocities and
        pressure.
        """
        if on_cpu():
            return [Pass(partial(self._measure, d), count) for d, count in enumerate(self._count)]
        axes = enumerate(self._count)
        return together([each(partial(self._measure_face, d), count) for d, count in axes])

    @ti.func
    def _measure(self, d: Template, a, b):
        count = self._count[d]
        for k in range((count + LANES - 1) // LANES):
            values = ti.Vector([0.0] * LANES)
            for n in range(LANES):
                values[n] = self._friction(d, ti.min(k * LANES + n, count - 1))
            for n in range(ti.min(LANES, count - k * LANES)):
                self._coefficient[d][k * LANES + n] = values[n]

    @ti.func
    def _measure_face(self, d: Template, k, a, b):
        self._coefficient[d][k] = self._friction(d, k)

    def slowing(self, rate: Faces) -> list[Pass]:
        """Return the passes that subtract the surfaces' friction from the rates of change of u [m/s²], implicitly, as
        friction is stiff, over a step `a` [s].
        """
        axes = enumerate(self._count)
        return together([each(partial(self._slow, rate, d), count) for d, count in axes])

    @ti.func
    def _slow(self, rate: Template, d: Template, k, dt, b):
        I, f = self._cell[d][k], self._coefficient[d][k]
        rate[d][I] = (rate[d][I] - f * self._along(d, k)[d]) / (1.0 + dt * f)

    def losing(self, loss: Faces) -> list[Pass]:
        """Return the passes that add the momentum that friction takes from the air to `loss` [m/s² of a whole cell]."""
        axes = enumerate(self._count)
        return together([each(partial(self._add_loss, loss, d), count) for d, count in axes])

    @ti.func
    def _add_loss(self, loss: Template, d: Template, k, a, b):
        I, f = self._cell[d][k], self._coefficient[d][k]
        loss[d][I] = loss[d][I] + self._stored[d][k] * f * self._along(d, k)[d]
