"""Passes over the domain's faces: prescribed velocities, ghost layers, the pressure outside.

Beyond slip walls and outlets a velocity goes on as in a mirror; where it is prescribed as V, so that V lies half-way
between a cell and its image, which makes the values that schemes take at the face of second order. At a wall that moves
with V the first image lies on the parabola through V and the two cells inside: so is its friction.
Beyond the viscous layer see `walls`.
"""

from collections.abc import Callable

import taichi as ti

from taichi_plume.grid.fields import Field
from taichi_plume.grid.kernels import Pass, Template, visit
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.walls import Walls, straightness


@ti.data_oriented
class Ghosts:
    """What the boundaries make of the fields of a flow. walls: by the law of the wall, unless they are None."""

    def __init__(self, boundaries: Boundaries, walls: Walls | None = None):
        self.b, self.walls, self.lawful = boundaries, walls, walls is not None
        self.grid, self.dim = boundaries.grid, boundaries.dim

    def _visit(self, body: Callable[..., None]) -> Pass:
        """A pass that calls ``body(K, d, a, b)`` for all faces of each axis d; K[d] is 0 on the lower side, else 1."""

        def of_axis(d: int) -> Callable:
            @ti.func
            def visited(K, a, b):
                body(K, d, a, b)

            return visited

        return visit([of_axis(d) for d in range(self.dim)], self.b.sides)

    def filling_velocity(self, u: Field) -> Pass:
        """Sets all ghost values of the face velocities u."""

        @ti.func
        def fill(K, d: Template, a, b):
            self._fill_velocity_at(u, K, d)

        return self._visit(fill)

    def prescribing(self, u: Field, u0: Field) -> Pass:
        """Sets prescribed faces at a share `a` of the step, between u0 at its begin and the targets at its end; and the
        upper faces of periodic axes.
        """

        @ti.func
        def prescribe(K, d: Template, a, b):
            n = ti.static(self.grid.shape[d])
            D = ti.Vector.unit(self.dim, d, ti.i32)
            face = K + D * (self.grid.ghost + K[d] * n - K[d])
            if ti.static(self.grid.periodic[d]):
                if K[d] == 1:  # the lower face is the one that is solved
                    u[d][face] = u[d][face - D * n]
            elif self.b.free[d][K] == 0:
                u[d][face] = u0[d][face] + a * (self.b.target[d][K][d] - u0[d][face])

        return self._visit(prescribe)

    def filling_pressure(self, p: Field, with_ambient: bool) -> Pass:
        """Sets the ghost values of p that put the ambient pressure (or zero) on free faces."""

        @ti.func
        def fill(K, d: Template, a, b):
            self._fill_pressure_at(p, K, d, with_ambient)

        return self._visit(fill)

    def updating_losses(self, u: Field) -> Pass:
        """Sets the pressure on free faces from K/2 u|u|, relaxed over dt (a) at the rate that is stable for any K."""

        @ti.func
        def update(K, d: Template, a, b):
            self._update_loss_at(u, K, d, a)

        return self._visit(update)

    @ti.func
    def _fill_velocity_at(self, u: Template, K, d: Template):
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
            if side == 1:  # the lower face is the one that is solved
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
        """Shares of velocity component c at boundary face K of axis d that a wall holds (no slip) and that go on beyond
        the face as inside (slip, outflow); the rest is prescribed. Component c lies between two boundary faces, and
        each counts half.
        """
        wall, drawn = 0.0, 0.0
        for step in ti.static(range(2)):
            cell = K
            cell[c] = ti.max(K[c] - step, 0)
            mirror, speed = self.b.mirror[d][cell][c], self.b.target[d][cell][d]
            wall += ti.select(mirror < 0.0, 0.5, 0.0)
            drawn += ti.select(mirror > 0.0 or (mirror == 0.0 and speed * outward > 0.0), 0.5, 0.0)
        return wall, drawn

    @ti.func
    def _fill_pressure_at(self, p: Template, K, d: Template, with_ambient: Template):
        n = ti.static(self.grid.shape[d])
        D = ti.Vector.unit(self.dim, d, ti.i32)
        inner = K + D * (self.grid.ghost + K[d] * (n - 1) - K[d])
        outer = inner + D * (2 * K[d] - 1)
        if ti.static(self.grid.periodic[d]):
            p[outer] = p[inner + D * (n - 1) * (1 - 2 * K[d])]
        else:
            p[outer] = 2.0 * self.b.ambient[d][K] * with_ambient - p[inner]

    @ti.func
    def _update_loss_at(self, u: Template, K, d: Template, dt: float):
        if self.b.free[d][K] == 1:
            n = ti.static(self.grid.shape[d])
            face = K + ti.Vector.unit(self.dim, d, ti.i32) * (self.grid.ghost + K[d] * n - K[d])
            out = u[d][face] * (2 * K[d] - 1)
            k = self.b.loss[d][K]
            wanted = 0.5 * k * out * ti.abs(out)
            relax = 1.0 / (1.0 + 2.0 * k * ti.abs(out) * dt / ti.static(self.grid.dx))
            self.b.ambient[d][K] += relax * (wanted - self.b.ambient[d][K])
