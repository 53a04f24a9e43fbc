"""Ghost cells: passes that impose the boundary conditions (Dirichlet, Neumann, no-slip, slip, outlet, ambient
pressure).

Slip walls and outlets mirror the velocity (zero gradient). Where the velocity is prescribed as V (Dirichlet), V is the
mean of a cell and its image, which makes face values of second order. At a wall that moves with V (no-slip) the first
image lies on the parabola through V and the two cells inside, so that friction is of second order too. `walls` replaces
that parabola by the law of the wall beyond the viscous layer.
"""

from functools import partial

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.fields import Faces
from taichi_plume.grid.kernels import Pass, Template, together
from taichi_plume.grid.sweeps import sweep
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.momentum import Momentum, density
from taichi_plume.solvers.walls import Walls, lower_face, straightness


class Ghosts:
    """Passes that fill the ghost cells of a flow's fields. walls: law of the wall, None without a turbulence model."""

    def __init__(self, boundaries: Boundaries, walls: Walls | None = None):
        self.b, self.walls, self.lawful = boundaries, walls, walls is not None
        self.grid, self.dim = boundaries.grid, boundaries.dim

    def filling_velocity(self, u: Faces) -> list[Pass]:
        """Return the passes that set all ghost values of the face velocities u by the boundary conditions."""
        axes = range(self.dim)  # the ghost values of an axis continue those of the axes before
        return [part for d in axes for part in together([self._filling(u, d, c) for c in axes])]

    def _filling(self, u: Faces, d: int, c: int) -> Pass:
        """Return the pass that sets the ghost values of component c beyond the boundary faces of axis d."""
        ranges = [
            (int(a == 0 and d > 0), n) for a, n in enumerate(self.b.sides[d])
        ]  # nothing reads x = 0, which has no lower face
        beyond = self._mirrored if d == c else self._beyond
        place = partial(self._ghost, d, d == c)
        return sweep(partial(beyond, u, d, c), (u[c],) * self.grid.ghost, ranges, place, int(d == 0))

    def prescribing(self, u: Faces, u0: Faces) -> list[Pass]:
        """Return the passes that set prescribed velocities at a fraction `a` of the step, between u0 at its start and
        the targets at its end, and the upper faces of periodic axes.
        """
        return together(
            [
                sweep(
                    partial(self._prescribed, u, u0, d),
                    u[d],
                    self._sides(d),
                    partial(self._face, d),
                    int(d == 0),
                )
                for d in range(self.dim)
            ]
        )

    def filling_pressure(self, p: Field, with_ambient: bool) -> list[Pass]:
        """Return the passes that set the ghost values of p such that free faces have the ambient pressure (or zero)."""
        return together(
            [
                sweep(
                    partial(self._outer, p, with_ambient, d),
                    p,
                    [(0, 2) if a == d else cells for a, cells in enumerate(self.grid.cells)],
                    partial(self._first_ghost, d),
                    int(d == 0),
                )
                for d in range(self.dim)
            ]
        )

    def updating_losses(self, u: Faces, m: Momentum) -> list[Pass]:
        """Return the passes that set the pressure on free faces from the loss K/2 rho u|u|, rho the density of the air
        that passes over the reference density: of the cell inside if air goes out, else 1.

        The pressure relaxes over dt (a) at the rate that is stable for any loss coefficient K.
        """
        return [
            sweep(partial(self._relaxed, u, m, d), self.b.ambient[d], self._sides(d), axis=int(d == 0))
            for d in range(self.dim)
        ]

    def _sides(self, d: int) -> list[tuple[int, int]]:
        """Return the range of the boundary faces K of axis d: K[d] is 0 on the lower side of the domain, else 1."""
        return [(0, n) for n in self.b.sides[d]]

    @ti.func
    def _face(self, d: Template, K, m: Template):
        """Return the place of boundary face K of axis d among the faces."""
        n, g = ti.static(self.grid.shape[d], self.grid.ghost)
        return K + ti.Vector.unit(self.dim, d, ti.i32) * (g + K[d] * n - K[d])

    @ti.func
    def _first_ghost(self, d: Template, K, m: Template):
        """Return the first ghost cell beyond boundary face K of axis d."""
        n, g = ti.static(self.grid.shape[d], self.grid.ghost)
        return K + ti.Vector.unit(self.dim, d, ti.i32) * (g - 1 + K[d] * (n + 1) - K[d])

    @ti.func
    def _prescribed(self, u: Template, u0: Template, d: Template, K, a, b):
        face, n = self._face(d, K, 0), ti.static(self.grid.shape[d])
        result = u[d][face]
        if ti.static(self.grid.periodic[d]):  # only the lower face is solved for
            result = ti.select(
                K[d] == 1, u[d][face - ti.Vector.unit(self.dim, d, ti.i32) * (K[d] * n)], result
            )
        else:
            target = u0[d][face] + a * (self.b.target[d][K][d] - u0[d][face])
            result = ti.select(self.b.free[d][K] == 0, target, result)
        return result

    @ti.func
    def _ghost(self, d: Template, normal: Template, K, m: Template):
        """Return the m-th ghost value beyond boundary face K of axis d, the nearest first; normal: of u_d."""
        n, g = ti.static(self.grid.shape[d], self.grid.ghost)
        D, upper = ti.Vector.unit(self.dim, d, ti.i32), K[d]
        above = n + g
        if ti.static(normal and self.grid.periodic[d]):
            above += m  # only the lower face is solved for
        elif ti.static(normal):
            above += ti.static(min(m + 1, g - 1))  # one face less is stored above
        else:
            above += m
        return K + D * (upper * (above - 1) + (1 - upper) * (g - 1 - m))

    @ti.func
    def _beyond(self, u: Template, d: Template, c: Template, K, a, b):
        """Return the ghost values of component c along boundary face K of axis d, the nearest first."""
        n, g = ti.static(self.grid.shape[d], self.grid.ghost)
        D, outward = ti.Vector.unit(self.dim, d, ti.i32), 2 * K[d] - 1
        inner = K + D * (g + K[d] * (n - 1) - K[d])  # K[d] is replaced by the first cell inside
        values = ti.Vector.zero(ti.f32, g)
        if ti.static(self.grid.periodic[d]):
            for m in ti.static(range(g)):
                values[m] = u[c][inner - D * outward * (n - 1 - m % n)]
        else:
            V = self.b.target[d][K][c]
            wall, drawn = self._conditions(K, d, c, outward)
            first = u[c][inner]
            straight, bent = 1.0, 0.0
            if ti.static(self.lawful):
                bend = self.walls.bend_at(K, d, c)
                straight = straightness(bend)
                bent = V + (1.0 - 2.0 * bend) * (first - V)
            for m in ti.static(range(g)):
                image = u[c][inner - D * outward * ti.static(min(m, n - 1))]
                dirichlet = 2.0 * V - image
                no_slip = dirichlet
                if ti.static(m == 0 and n > 1):  # the parabola through V and two cells
                    second = u[c][inner - D * outward]
                    no_slip = (8.0 * V + second) / 3.0 - 2.0 * first
                no_slip = straight * no_slip + (1.0 - straight) * bent
                values[m] = wall * no_slip + drawn * image + (1.0 - wall - drawn) * dirichlet
        return values

    @ti.func
    def _mirrored(self, u: Template, d: Template, c: Template, K, a, b):
        """Return the ghost values of the normal component d beyond boundary face K, the nearest first."""
        n, g = ti.static(self.grid.shape[d], self.grid.ghost)
        D, upper = ti.Vector.unit(self.dim, d, ti.i32), K[d]
        outward = 2 * upper - 1
        face = K + D * (g + upper * n - upper)
        values = ti.Vector.zero(ti.f32, g)
        if ti.static(self.grid.periodic[d]):
            for m in ti.static(range(g)):
                steps = m % n  # an axis may have fewer cells than ghost layers
                values[m] = u[d][face + D * (upper * (steps - n) + (1 - upper) * (n - 1 - steps))]
        else:
            at = u[d][face]
            still = ti.select(at * outward > 0.0, at, 0.0)  # still air comes in
            for m in ti.static(range(g)):
                away = upper * ti.static(min(m + 1, g - 1, n)) + (1 - upper) * ti.static(min(m + 1, n))
                mirrored = 2.0 * at - u[d][face - D * outward * away]
                values[m] = ti.select(self.b.free[d][K] == 1, still, ti.select(at != 0.0, mirrored, at))
        return values

    @ti.func
    def _conditions(self, K, d: Template, c: Template, outward):
        """Return the fractions of velocity component c at boundary face K of axis d with a no-slip wall and with zero
        gradient (slip, outflow). The rest is prescribed (Dirichlet). Component c lies between two boundary faces, and
        each counts half.
        """
        wall, drawn = self._condition(K, d, c, outward)
        other_wall, other_drawn = self._condition(lower_face(K, d, c), d, c, outward)
        return 0.5 * (wall + other_wall), 0.5 * (drawn + other_drawn)

    @ti.func
    def _condition(self, K, d: Template, c: Template, outward):
        """Return 1 or 0: whether face K is a no-slip wall, and whether it has zero gradient, for component c."""
        mirror, speed = self.b.mirror[d][K][c], self.b.target[d][K][d]
        blown_out = ti.select(mirror == 0.0, ti.select(speed * outward > 0.0, 1.0, 0.0), 0.0)
        return ti.select(mirror < 0.0, 1.0, 0.0), ti.select(mirror > 0.0, 1.0, blown_out)

    @ti.func
    def _outer(self, p: Template, with_ambient: Template, d: Template, K, a, b):
        """Return the pressure in the first ghost cell beyond boundary face K of axis d."""
        n = ti.static(self.grid.shape[d])
        D = ti.Vector.unit(self.dim, d, ti.i32)
        inner = self._first_ghost(d, K, 0) + D * (1 - 2 * K[d])
        result = 0.0
        if ti.static(self.grid.periodic[d]):
            result = p[inner + D * (n - 1) * (1 - 2 * K[d])]
        else:
            result = 2.0 * self.b.ambient[d][K] * with_ambient - p[inner]
        return result

    @ti.func
    def _relaxed(self, u: Template, m: Template, d: Template, K, dt, b):
        """Return the pressure on boundary face K of axis d, after a time dt if it is free."""
        face, before = self._face(d, K, 0), self.b.ambient[d][K]
        out = u[d][face] * (2 * K[d] - 1)
        inner = face - ti.Vector.unit(self.dim, d, ti.i32) * K[d]
        k = self.b.loss[d][K] * ti.select(out > 0.0, density(m, inner), 1.0)
        drop = 0.5 * k * out * ti.abs(out)
        relax = 1.0 / (1.0 + 2.0 * k * ti.abs(out) * dt / ti.static(self.grid.dx))
        return ti.select(self.b.free[d][K] == 1, before + relax * (drop - before), before)
