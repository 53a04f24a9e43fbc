"""Incompressible Navier-Stokes on the staggered grid.

    du/dt + div(u u) = -grad p + div(nu (grad u + grad u^T)),   div u = 0

p is the kinematic pressure [m²/s²]. Convection in flux form with the Koren limiter, central diffusion, Heun's method
(SSP-RK2) with the last pressure's gradient, then one projection for the pressure increment (second order in time).
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.fields import corner, corner_weight
from taichi_plume.grid import Grid
from taichi_plume.kernels import Template, sweep
from taichi_plume.scenario import CfdWind
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.convection import face_value
from taichi_plume.solvers.pressure import pressure_solver
from taichi_plume.solvers.turbulence import smagorinsky


@ti.data_oriented
class FlowSolver:
    """Air flow in a box with solid cells and openings; satisfies `fields.Wind`.

    Fields: u, face velocities [m/s], one per axis; p [m²/s²]; nu, viscosity with eddy viscosity [m²/s] or None;
    open, 1 on faces whose velocity is solved for, 0 on walls, in obstacles and where a velocity is prescribed.
    """

    def __init__(self, wind: CfdWind, grid: Grid, solid: np.ndarray, seed: int = 0):
        self.grid = grid
        self.dim = grid.dim
        self.courant = wind.courant
        self.tolerance = wind.tolerance
        self.viscosity = wind.viscosity
        self.boundaries = Boundaries(wind.openings, grid, solid, seed)
        self.u = grid.faces_field()
        self.p = grid.field()
        self.open = grid.faces_field()
        openness = self._openness(solid)
        for field, values in zip(self.open, openness, strict=True):
            field.from_numpy(values)
        self.solver = pressure_solver(openness, grid)
        self.eddies = wind.turbulence.kind != "none"
        self.nu = grid.field() if self.eddies else None
        self.schmidt = wind.turbulence.schmidt if wind.turbulence.kind == "smagorinsky" else 1.0
        self._start = grid.faces_field()  # u at the begin of the step
        self._rate = grid.faces_field()
        self._divergence = grid.field()
        self._phi = grid.field()
        self._build(wind)
        self._rate_of_steps = 0.0  # largest sum of |u|/dx [1/s]
        self.max_courant = 0.0
        self.project(1.0)  # from rest: the potential flow that the openings force
        self.p.fill(0.0)

    def _openness(self, solid: np.ndarray) -> tuple[np.ndarray, ...]:
        """1 on faces between two cells of air and on free faces of the domain, on the padded grid."""
        air = self.grid.pad(~solid)
        g = self.grid.ghost
        result = []
        for d in range(self.dim):
            faces = (air & np.roll(air, 1, axis=d)).astype(np.float32)
            if not self.grid.periodic[d]:
                free = self.boundaries.free[d].to_numpy()
                along = np.moveaxis(faces, d, 0)
                along[g] *= np.take(free, 0, axis=d)
                along[g + self.grid.shape[d]] *= np.take(free, 1, axis=d)
            result.append(faces)
        return tuple(result)

    def _build(self, wind: CfdWind) -> None:
        """The formulas of a step, each swept over its cells or faces."""
        u, u0, rate, p, nu, phi = self.u, self._start, self._rate, self.p, self.nu, self._phi
        dx, dim, viscosity, a = self.grid.dx, self.dim, self.viscosity, self.open
        eddies = self.eddies

        @ti.func
        def edge_viscosity(I, D, E, same: Template):
            """Viscosity where the stress on the lower e-side of the volume around face I acts."""
            result = viscosity
            if ti.static(eddies):
                if ti.static(same):
                    result = nu[I - D]
                else:
                    result = 0.25 * (nu[I] + nu[I - D] + nu[I - E] + nu[I - D - E])
            return result

        @ti.func
        def momentum_flux(I, d: Template, e: Template):
            """Flux of u_d [m²/s²] through the lower e-side of the volume around face I: convection less stress."""
            D, E = ti.Vector.unit(dim, d, ti.i32), ti.Vector.unit(dim, e, ti.i32)
            v = 0.5 * (u[e][I] + u[e][I - D])
            du_dx = (u[d][I] - u[d][I - E]) / dx
            if ti.static(d != e):  # beside an obstacle the wall, where u_d = 0, is half a cell away
                du_dx *= ti.select(ti.min(a[d][I], a[d][I - E]) > 0.0, 1.0, 2.0)
            dv_dx = (u[e][I] - u[e][I - D]) / dx
            return v * face_value(u[d], I, E, v) - edge_viscosity(I, D, E, d == e) * (du_dx + dv_dx)

        def on_faces(d: int) -> dict[str, Any]:
            """The kernels of the velocity component of axis d."""
            faces = self.grid.faces(d)

            @ti.func
            def tendency(I, s):
                total = -(p[I] - p[I - ti.Vector.unit(dim, d, ti.i32)])
                for e in ti.static(range(dim)):
                    total += momentum_flux(I, d, e) - momentum_flux(I + ti.Vector.unit(dim, e, ti.i32), d, e)
                return ti.select(a[d][I] > 0.0, total / dx, 0.0)

            @ti.func
            def remember(I, s):
                return u[d][I]

            @ti.func
            def euler(I, dt):
                return u0[d][I] + dt * rate[d][I]

            @ti.func
            def heun(I, dt):
                return u0[d][I] + 0.5 * ((u[d][I] - u0[d][I]) + dt * rate[d][I])

            @ti.func
            def correct(I, s):
                below = I - ti.Vector.unit(dim, d, ti.i32)
                return u[d][I] - ti.select(a[d][I] > 0.0, phi[I] - phi[below], 0.0)

            return {
                "remember": sweep(remember, u0[d], faces),
                "tendency": sweep(tendency, rate[d], faces),
                "euler": sweep(euler, u[d], faces),
                "heun": sweep(heun, u[d], faces),
                "correct": sweep(correct, u[d], faces),
            }

        @ti.func
        def net_inflow(I, s):
            total = 0.0
            for d in ti.static(range(dim)):
                total += u[d][I] - u[d][I + ti.Vector.unit(dim, d, ti.i32)]
            return total

        @ti.func
        def add_pressure(I, scale):
            return p[I] + scale * phi[I]

        @ti.func
        def eddy_viscosity(I, s):
            return viscosity + smagorinsky(u, I, dx, constant)

        self._axes = [on_faces(d) for d in range(dim)]
        self._net_inflow = sweep(net_inflow, self._divergence, self.grid.cells)
        self._add_pressure = sweep(add_pressure, p, self.grid.cells)
        if wind.turbulence.kind == "smagorinsky":
            constant = wind.turbulence.constant
            self._eddy_viscosity = sweep(eddy_viscosity, nu, self.grid.cells)

    def _each_axis(self, phase: str, s: float = 0.0) -> None:
        for kernels in self._axes:
            kernels[phase](s)

    # ---------------------------------------------------------------- the step

    def advance(self, t: float, dt: float) -> None:
        """One step of Heun's method and a projection."""
        self.max_courant = max(self.max_courant, dt * self._rate_of_steps)
        self.boundaries.update(t + dt, dt)
        self._each_axis("remember")
        if self.boundaries.has_loss:
            self.boundaries.update_losses(self.u, dt)
        self.boundaries.fill_pressure(self.p, 1)
        for stage in ("euler", "heun"):
            self.boundaries.fill_velocity(self.u)
            if self.nu is not None:
                self._eddy_viscosity(0.0)
                self.boundaries.fill_even(self.nu)
            self._each_axis("tendency")
            self._each_axis(stage, dt)
        self.project(dt)

    def project(self, dt: float) -> None:
        """Make u divergence-free by the gradient of phi, and add the increment to the pressure."""
        self.boundaries.fill_velocity(self.u)
        self._net_inflow(0.0)
        self.solver.solve(self._divergence, self._phi, self.tolerance * max(self.max_speed(), 1e-6))
        self.boundaries.fill_pressure(self._phi, 0)
        self._each_axis("correct")
        self._add_pressure(self.grid.dx / dt)
        self.boundaries.fill_velocity(self.u)

    # ---------------------------------------------------------------- limits and diagnostics

    @ti.kernel
    def _max_speed(self) -> ti.f32:
        result = 0.0
        for d in ti.static(range(self.dim)):
            for I in ti.grouped(self.u[d]):
                ti.atomic_max(result, ti.abs(self.u[d][I]))
        return result

    @ti.kernel
    def _max_rate(self) -> ti.f32:
        """Largest sum over the axes of |u|/dx; a value that is not finite counts as infinite."""
        result = 0.0
        g = ti.static(self.grid.ghost)
        for J in ti.grouped(ti.ndrange(*self.grid.shape)):
            total = 0.0
            for d in ti.static(range(self.dim)):
                D = ti.Vector.unit(self.dim, d, ti.i32)
                total += ti.max(ti.abs(self.u[d][J + g]), ti.abs(self.u[d][J + g + D]))
            ti.atomic_max(result, ti.select(total < 1e6, total, 1e30))
        return result / ti.static(self.grid.dx)

    @ti.kernel
    def _max_viscosity(self) -> ti.f32:
        result = 0.0
        for I in ti.grouped(self.nu):
            ti.atomic_max(result, self.nu[I])
        return result

    def max_speed(self) -> float:
        """Largest velocity component [m/s]."""
        return self._max_speed()

    def stable_dt(self) -> float:
        """The step [s] that keeps the Courant number at its limit and diffusion stable."""
        rate = self._max_rate()
        nu = self.viscosity if self.nu is None else max(self.viscosity, self._max_viscosity())
        self._rate_of_steps = rate
        return 1.0 / max(rate / self.courant + 2.0 * (self.dim + 1) * nu / self.grid.dx**2, 1e-30)

    def diagnostics(self) -> dict[str, float]:
        """max_divergence (over the largest |u|/dx), max_courant (of all steps so far), max_speed [m/s]."""
        self._net_inflow(0.0)
        largest = np.abs(self.grid.inner(self._divergence.to_numpy())).max()
        speed = self.max_speed()
        return {
            "max_divergence": float(largest / max(speed, 1e-9)),
            "max_courant": self.max_courant,
            "max_speed": speed,
        }

    # ---------------------------------------------------------------- sampling

    @ti.func
    def velocity(self, x: Template, t: float):
        """Velocity [m/s] at point x [m], linear between the faces; the time is the solver's own."""
        result = ti.Vector.zero(ti.f32, self.dim)
        for c in ti.static(range(self.dim)):
            shift = ti.Vector([0.0 if d == c else 0.5 for d in ti.static(range(self.dim))])
            base, weight = corner(x, shift, self.grid.dx, self.grid.ghost, self.grid.padded)
            for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * self.dim)))):
                result[c] += corner_weight(weight, offset) * self.u[c][base + offset]
        return result
