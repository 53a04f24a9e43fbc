"""Walls and obstacles for puffs: reflection of their paths, and mirror images of the gas in front of them."""

from taichi_plume.engine import ti
from taichi_plume.grid.fields import Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.level_set import LevelSet

STILL = 1e-4  # m/s: slower air does not go through a face


class PuffWalls:
    """Walls for puffs: faces of the domain, closed where no air passes, and surfaces in the domain (None: none)."""

    def __init__(self, grid: Grid, wind: Wind, surfaces: LevelSet | None):
        self.grid, self.dim, self.wind, self.surfaces = grid, grid.dim, wind, surfaces
        self.solid = surfaces is not None

    @ti.func
    def inside(self, x: Template):
        """Return point x moved into the domain: wrapped around periodic axes, clipped along the others."""
        y = x
        for d in ti.static(range(self.dim)):
            L = ti.static(self.grid.extent[d])
            if ti.static(self.grid.periodic[d]):
                y[d] -= L * ti.floor(y[d] / L)
            y[d] = ti.math.clamp(y[d], 0.0, L)
        return y

    @ti.func
    def air_goes_through(self, x: Template, face: ti.i32, t: float):
        """Return whether air passes through a face of the domain near x; face: 2 d (lower) or 2 d + 1 (upper)."""
        p = self.inside(x)
        for d in ti.static(range(self.dim)):
            p[d] = ti.select(face == 2 * d, 0.0, p[d])
            p[d] = ti.select(face == 2 * d + 1, self.grid.extent[d], p[d])
        u = self.wind.velocity(p, t)
        speed = 0.0
        for d in ti.static(range(self.dim)):
            speed += ti.select(face // 2 == d, ti.abs(u[d]), 0.0)
        return speed > STILL

    @ti.func
    def travel(self, x: Template, way: Template, v: Template, t: float):
        """Return the end of the path `way` from x and its velocity, both reflected, and whether it is in the domain."""
        end, speed, stays = x + way, v, True
        if ti.static(self.solid):
            end, speed = self.surfaces.bounce(x, way, v)
        face, share = -1, 1.0  # first face on the way, and its position
        rest = end - x
        for d in ti.static([a for a in range(self.dim) if not self.grid.periodic[a]]):
            L = ti.static(self.grid.extent[d])
            if end[d] < 0.0 or end[d] > L:
                wall = ti.select(end[d] > L, L, 0.0)
                there = (wall - x[d]) / rest[d]
                if there <= share:
                    face, share = 2 * d + ti.cast(end[d] > L, ti.i32), there
                end[d] = 2.0 * wall - end[d]
                speed[d] = -speed[d]
        place = self.inside(end)
        if face >= 0:
            stays = not self.air_goes_through(x + share * rest, face, t)
            if ti.static(self.solid):
                free = self.surfaces.distance(place) > 0.0  # or reflected into an obstacle at the wall
                place = ti.select(free, place, x)
        return place, speed, stays

    # ---------------------------------------------------------------- images

    @ti.func
    def closed(self, x: Template, farthest: float, t: float):
        """Return for each lower and each upper face 1 if it is closed near x, or farther from x than `farthest` [m],
        the reach of all puffs; else 0.
        """
        below, above = ti.Vector.one(ti.i32, self.dim), ti.Vector.one(ti.i32, self.dim)
        for face in range(ti.static(2 * self.dim)):
            away = 0.0
            for d in ti.static(range(self.dim)):
                L = ti.static(self.grid.extent[d])
                away += ti.select(face == 2 * d, x[d], 0.0) + ti.select(face == 2 * d + 1, L - x[d], 0.0)
            if away < farthest:
                shut = 1 - ti.cast(self.air_goes_through(x, face, t), ti.i32)
                for d in ti.static([a for a in range(self.dim) if not self.grid.periodic[a]]):
                    below[d] = ti.select(face == 2 * d, shut, below[d])
                    above[d] = ti.select(face == 2 * d + 1, shut, above[d])
        return below, above

    @ti.func
    def images(self, x: Template, reach: float, below: Template, above: Template):
        """Return the mirror images of x within `reach` of the domain: first image and number per axis, total number.

        Along an axis the images are x mirrored at closed faces, repeatedly, or shifted by the period.
        """
        first, size = ti.Vector.zero(ti.i32, self.dim), ti.Vector.zero(ti.i32, self.dim)
        count = 1
        for d in ti.static(range(self.dim)):
            L = ti.static(self.grid.extent[d])
            low, high = ti.cast(x[d] < reach, ti.i32), ti.cast(L - x[d] < reach, ti.i32)
            if ti.static(self.grid.periodic[d]):  # points beyond the lower face are at the upper face
                low, high = high, low
            first[d] = -below[d] * low
            last = above[d] * high
            if below[d] * above[d] == 1 and reach > L:
                last = ti.cast(reach / L, ti.i32) + 1
                first[d] = -last
            size[d] = last - first[d] + 1
            count *= size[d]
        return first, size, count

    @ti.func
    def image(self, x: Template, first: Template, size: Template, n: ti.i32):
        """Return the position [m] of mirror image n of x, by `first` and `size` of `images`."""
        p, left = x, n
        for d in ti.static(range(self.dim)):
            L = ti.static(self.grid.extent[d])
            m = first[d] + left % size[d]
            left = left // size[d]
            p[d] += m * L
            if ti.static(not self.grid.periodic[d]):
                p[d] = ti.select(m & 1, m * L + L - x[d], p[d])
        return p
