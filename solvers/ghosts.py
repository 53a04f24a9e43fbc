"""Ghost cells: passes that impose the boundary conditions (Dirichlet, Neumann, no-slip, slip, outlet, ambient
pressure).

Slip walls and outlets mirror the velocity (zero gradient). Where the velocity is prescribed as V (Dirichlet), V is the
mean of a cell and its image, which makes face values of second order. At a wall that moves with V (no-slip) the first
image lies on the parabola through V and the two cells inside, so that friction is of second order too. `walls` replaces
that parabola by the law of the wall beyond the viscous layer.
"""

from collections.abc import Callable
from functools import partial

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.fields import Faces
from taichi_plume.grid.kernels import Pass, Template, visit
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.momentum import Momentum, density
from taichi_plume.solvers.walls import Walls, straightness


@ti.data_oriented
class Ghosts:
    """Passes that fill the ghost cells of a flow's fields. walls: law of the wall, None without a turbulence model."""

    def __init__(self, boundaries: Boundaries, walls: Walls | None = None):
        self.b, self.walls, self.lawful = boundaries, walls, walls is not None
        self.grid, self.dim = boundaries.grid, boundaries.dim

    def _visit(
        self, body: Callable[..., None], field: Field, *given: Field | Faces | Momentum | bool
    ) -> Pass:
        """Return the pass that calls ``body(*given, d, K, a, b)`` for all boundary faces K of each axis d.

        K[d] is 0 on the lower side of the domain and 1 on the upper one; field: a padded field that is visited.
        """
        like = [(field, self.b.free[d]) for d in range(self.dim)]
        return visit([partial(body, *given, d) for d in range(self.dim)], self.b.sides, *like)

    def filling_velocity(self, u: Faces) -> Pass:
        """Return the pass that sets all ghost values of the face velocities u by the boundary conditions."""
        return self._visit(self._fill_velocity_at, u[0], u)

    def prescribing(self, u: Faces, u0: Faces) -> Pass:
        """Return the pass that sets prescribed velocities at a fraction `a` of the step, between u0 at its start and
        the targets at its end, and the upper faces of periodic axes.
        """
        return self._visit(self._prescribe_at, u[0], u, u0)

    def filling_pressure(self, p: Field, with_ambient: bool) -> Pass:
        """Return the pass that sets the ghost values of p such that free faces have the ambient pressure (or zero)."""
        return self._visit(self._fill_pressure_at, p, p, with_ambient)

    def updating_losses(self, u: Faces, m: Momentum) -> Pass:
        """Return the pass that sets the pressure on free faces from the loss K/2 rho u|u|, rho the density of the air
        that passes over the reference density: of the cell inside if air goes out, else 1.

        The pressure relaxes over dt (a) at the rate that is stable for any loss coefficient K.
        """
        return self._visit(self._update_loss_at, u[0], u, m)

    @ti.func
    def _prescribe_at(self, u: Template, u0: Template, d: Template, K, a, b):
        n = ti.static(self.grid.shape[d])
        D = ti.Vector.unit(self.dim, d, ti.i32)
        face = K + D * (self.grid.ghost + K[d] * n - K[d])
        if ti.static(self.grid.periodic[d]):
            if K[d] == 1:  # only the lower face is solved for
                u[d][face] = u[d][face - D * n]
        elif self.b.free[d][K] == 0:
            u[d][face] = u0[d][face] + a * (self.b.target[d][K][d] - u0[d][face])

    @ti.func
    def _fill_velocity_at(self, u: Template, d: Template, K, a, b):
        n = ti.static(self.grid.shape[d])
        g = ti.static(self.grid.ghost)
        D = ti.Vector.unit(self.dim, d, ti.i32)
        side = K[d]
        inner = K + D * (g + side * (n - 1) - side)  # K[d] is replaced by the first cell inside
        face = K + D * (g + side * n - side)
        outward = 2 * side - 1
        if ti.static(self.grid.periodic[d]):
            other = inner + D * (n - 1) * (1 - 2 * side)
            for c in ti.static(range(self.dim)):
                if ti.static(c != d):
                    for m in ti.static(range(g)):
                        u[c][inner + D * outward * (m + 1)] = u[c][other + D * outward * m]
            if side == 1:  # only the lower face is solved for
                for m in ti.static(range(g)):
                    u[d][face + D * m] = u[d][face + D * (m - n)]
            else:
                for m in ti.static(range(1, g + 1)):
                    u[d][face - D * m] = u[d][face + D * (n - m)]
        else:
            V = self.b.target[d][K]
            for c in ti.static(range(self.dim)):
                if ti.static(c != d):
                    wall, drawn = self._conditions(K, d, c, outward)
                    first = u[c][inner]
                    straight, bent = 1.0, 0.0
                    if ti.static(self.lawful):
                        bend = self.walls.bend_at(K, d, c)
                        straight = straightness(bend)
                        bent = V[c] + (1.0 - 2.0 * bend) * (first - V[c])
                    for m in ti.static(range(g)):
                        image = u[c][inner - D * outward * ti.static(min(m, n - 1))]
                        dirichlet = 2.0 * V[c] - image
                        no_slip = dirichlet
                        if ti.static(m == 0 and n > 1):  # the parabola through V and two cells
                            second = u[c][inner - D * outward]
                            no_slip = (8.0 * V[c] + second) / 3.0 - 2.0 * first
                        no_slip = straight * no_slip + (1.0 - straight) * bent
                        value = wall * no_slip + drawn * image + (1.0 - wall - drawn) * dirichlet
                        u[c][inner + D * outward * (m + 1)] = value
            at, beyond = u[d][face], u[d][face]
            if self.b.free[d][K] == 1:
                beyond = ti.select(at * outward > 0.0, at, 0.0)  # still air comes in
            for m in ti.static(range(1, g + 1)):
                if self.b.free[d][K] == 0 and at != 0.0:
                    beyond = 2.0 * at - u[d][face - D * outward * ti.min(m, n)]
                if m < g or side == 0:
                    u[d][face + D * outward * m] = beyond

    @ti.func
    def _conditions(self, K: Template, d: Template, c: Template, outward):
        """Return the fractions of velocity component c at boundary face K of axis d with a no-slip wall and with zero
        gradient (slip, outflow). The rest is prescribed (Dirichlet). Component c lies between two boundary faces, and
        each counts half.
        """
        wall, drawn = 0.0, 0.0
        for step in ti.static(range(2)):
            cell = K + ti.Vector.unit(self.dim, c, ti.i32) * (ti.max(K[c] - step, 0) - K[c])
            mirror, speed = self.b.mirror[d][cell][c], self.b.target[d][cell][d]
            wall += ti.select(mirror < 0.0, 0.5, 0.0)
            drawn += ti.select(mirror > 0.0 or (mirror == 0.0 and speed * outward > 0.0), 0.5, 0.0)
        return wall, drawn

    @ti.func
    def _fill_pressure_at(self, p: Template, with_ambient: Template, d: Template, K, a, b):
        n = ti.static(self.grid.shape[d])
        D = ti.Vector.unit(self.dim, d, ti.i32)
        inner = K + D * (self.grid.ghost + K[d] * (n - 1) - K[d])
        outer = inner + D * (2 * K[d] - 1)
        if ti.static(self.grid.periodic[d]):
            p[outer] = p[inner + D * (n - 1) * (1 - 2 * K[d])]
        else:
            p[outer] = 2.0 * self.b.ambient[d][K] * with_ambient - p[inner]

    @ti.func
    def _update_loss_at(self, u: Template, m: Template, d: Template, K, dt, b):
        if self.b.free[d][K] == 1:
            n = ti.static(self.grid.shape[d])
            face = K + ti.Vector.unit(self.dim, d, ti.i32) * (self.grid.ghost + K[d] * n - K[d])
            out = u[d][face] * (2 * K[d] - 1)
            inner = face - ti.Vector.unit(self.dim, d, ti.i32) * K[d]
            k = self.b.loss[d][K] * ti.select(out > 0.0, density(m, inner), 1.0)
            drop = 0.5 * k * out * ti.abs(out)
            relax = 1.0 / (1.0 + 2.0 * k * ti.abs(out) * dt / ti.static(self.grid.dx))
            self.b.ambient[d][K] += relax * (drop - self.b.ambient[d][K])
