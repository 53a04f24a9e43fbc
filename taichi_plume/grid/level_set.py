"""Level set of obstacles that reflect puffs and particles: a signed distance on nodes half a cell apart.

Each half of a cut cell counts as air or solid, so the error of the distance is half a cell. No point of a solid cell
has a positive distance.
"""

from itertools import product

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import corner, corner_weight
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template

FINER = 2  # nodes per cell and axis
BOUNCES = 3  # reflections off surfaces in a step
SAFE = 0.57  # fraction of a distance that is free: interpolated, a distance changes by up to sqrt(3) times the path


def signed_distance(air: Air, grid: Grid) -> np.ndarray:
    """Return the distance [m] of nodes, FINER n + 1 per axis, to the next surface; <= 0 on surfaces and in solids."""
    solid = _halves(air, grid)
    wide = [(n // 2, n // 2) if wraps else (0, 0) for n, wraps in zip(solid.shape, air.periodic, strict=True)]
    around = np.pad(np.pad(solid, wide, mode="wrap"), 1, mode="edge")
    inner = tuple(slice(1 + a, 1 + a + n + 1) for n, (a, _) in zip(solid.shape, wide, strict=True))
    distance = []
    for part in (around, ~around):  # nodes that touch a part are no distance from it
        touch = np.zeros([n + 1 for n in around.shape], bool)
        for shift in product((0, 1), repeat=grid.dim):
            touch[tuple(slice(s, n + s) for s, n in zip(shift, around.shape, strict=True))] |= part
        distance.append(np.asarray(distance_transform_edt(~touch))[inner])
    return (distance[0] - distance[1]) * (grid.dx / FINER)


def _halves(air: Air, grid: Grid) -> np.ndarray:
    """Return a mask of the solid halves of cells; in cut cells the deepest halves up to the solid fraction."""
    solid = air.volume.astype(float)
    for axis in range(grid.dim):
        solid = solid.repeat(FINER, axis=axis)
    solid = solid == 0.0
    cut = np.argwhere((air.volume > 0.0) & (air.volume < 1.0))
    if len(cut):
        normal = air.surface()[tuple(cut.T)]
        places = np.array(list(product(range(FINER), repeat=grid.dim)))
        depth = (
            places - 0.5 * (FINER - 1)
        ) @ normal.T  # of each part, along the surface's normal, (parts, cells)
        rank = (-depth).argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
        filled = rank < np.rint((1.0 - air.volume[tuple(cut.T)]) * len(places))
        for place, chosen in zip(places, filled, strict=True):
            solid[tuple((FINER * cut[chosen] + place).T)] = True
    for axis, shut in enumerate(air.sealed):  # walls that may be thinner: both halves of cells beside them
        faces = np.moveaxis(shut, axis, 0)[1:-1]
        for other in range(1, grid.dim):
            faces = faces.repeat(FINER, axis=other)
        halves = np.moveaxis(solid, axis, 0)
        halves[FINER - 1 : -1 : FINER] |= faces
        halves[FINER::FINER] |= faces
    return solid


class LevelSet:
    """Obstacles as a signed distance, multilinear between the nodes, with reflection of moving points."""

    def __init__(self, air: Air, grid: Grid):
        self.grid = grid
        self.dim = grid.dim
        self.step = grid.dx / FINER
        self.values = signed_distance(air, grid)
        self.field: Field = grid.filled(self.values)

    def in_air(self, x: np.ndarray) -> np.ndarray:
        """Return a mask of the points x (n, dim) [m] that lie in the air."""
        return map_coordinates(self.values, x.T / self.step, order=1, mode="nearest") > 0.0

    @ti.func
    def wrapped(self, x: Template):
        """Return the point x [m] wrapped into the domain along periodic axes."""
        y = x
        for d in ti.static([a for a in range(self.dim) if self.grid.periodic[a]]):
            L = ti.static(self.grid.extent[d])
            y[d] = ti.math.clamp(y[d] - L * ti.floor(y[d] / L), 0.0, L)
        return y

    @ti.func
    def _corner(self, x: Template):
        shift = ti.Vector.zero(ti.f32, self.dim)
        return corner(self.wrapped(x), shift, self.step, 0, self.field.shape)

    @ti.func
    def distance(self, x: Template):
        """Return the signed distance [m] of point x from the next surface, negative inside obstacles."""
        base, weight = self._corner(x)
        I = ti.cell(base, (self.field,))
        result = 0.0
        for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * self.dim)))):
            result += corner_weight(weight, offset) * self.field[I + offset]
        return result

    @ti.func
    def normal(self, x: Template):
        """Return the unit vector at x away from the next surface."""
        base, weight = self._corner(x)
        I = ti.cell(base, (self.field,))
        result = ti.Vector.zero(ti.f32, self.dim)
        for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * self.dim)))):
            value = self.field[I + offset]
            for d in ti.static(range(self.dim)):
                part = weight
                part[d] = 1.0 * offset[d]
                slope = corner_weight(part, offset)
                result[d] += (2.0 * offset[d] - 1.0) * slope * value
        return result / ti.max(result.norm(), 1e-6)

    @ti.func
    def bounce(self, x: Template, way: Template, v: Template):
        """Return the end of the path `way` from x and the velocity v, both reflected at surfaces; always in air."""
        end, last, speed = x + way, x, v
        met, bounces = 1, 0
        while met == 1 and bounces <= BOUNCES:
            begin, rest, s = last, end - last, 0.0
            hit, depth, length = begin, 0.0, ti.max(rest.norm(), 1e-9)
            met = 0
            while s <= 1.0 and met == 0:
                q = begin + s * rest
                away = self.distance(q)
                if away > 0.0:
                    last = q
                    free, least = SAFE * away / length, 0.5 * self.step / length
                    s = ti.select(s + free < 1.0, ti.min(s + ti.max(free, least), 1.0), 2.0)
                else:
                    hit, depth = q, away
                    met = 1
            if met == 1:
                n = self.normal(hit)
                deep = ti.math.dot(n, end - hit) + depth
                end -= 2.0 * ti.min(deep, 0.0) * n
                speed -= 2.0 * ti.min(ti.math.dot(speed, n), 0.0) * n
            bounces += 1
        if met == 1:
            end = last
        return end, speed
