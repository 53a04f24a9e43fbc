"""Incompressible Navier-Stokes on the staggered grid.

    du/dt + div(u u) = -grad p + div(nu (grad u + grad u^T)) + g,   div u = 0

p is the kinematic pressure [m²/s²], g a constant acceleration. Convection in flux form with the Koren limiter, central
diffusion, Heun's method (SSP-RK2) with the last pressure's gradient, then one projection for the pressure increment
(second order in time).
"""

from collections.abc import Callable
from math import prod
from typing import Any, Protocol

import numpy as np
import taichi as ti

from taichi_plume.fields import corner, corner_weight
from taichi_plume.grid import Grid
from taichi_plume.kernels import Template, launch, sweep
from taichi_plume.scenario import CfdWind
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.convection import face_value
from taichi_plume.solvers.pressure import pressure_solver
from taichi_plume.solvers.screens import ScreenResistance
from taichi_plume.solvers.turbulence import MODELS

HUGE = 1e6  # m/s: no flow of ours is as fast


class Resistance(Protocol):
    """What holds or drags the air inside the domain; implementations are `ti.data_oriented`."""

    def advance(self, t: float, dt: float) -> None:
        """Prepare the step from time t [s] to t + dt."""
        ...

    def fastest(self, t: float) -> float:
        """Largest velocity component [m/s] that it gives the air soon after t [s]."""
        ...

    def apply(self, u: Any, dt: Any) -> None:
        """ti.func: u = (u + dt r v)/(1 + dt r) on its faces, r its rate [1/s] and v its own velocity [m/s]."""
        ...


@ti.data_oriented
class FlowSolver:
    """Air flow in a box with solid cells and openings; satisfies `fields.Wind`.

    Fields: u, face velocities [m/s], one per axis; p [m²/s²]; nu, viscosity with eddy viscosity [m²/s] or None;
    open, 1 on faces whose velocity is solved for, 0 on walls, in obstacles and where a velocity is prescribed.
    To be completed before the first step: lift, cell fields with the acceleration [m/s²] that a unit of each gives the
    air (buoyancy); resistances, what holds or drags it (the wind's screens are there already).
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
        self.eddies = wind.turbulence.kind in MODELS
        self.nu: Any = grid.field() if self.eddies else None
        self.lift: list[tuple[Any, tuple[float, ...]]] = []
        self.resistances: list[Resistance] = [
            ScreenResistance(screen, grid, openness, wind.viscosity) for screen in wind.screens
        ]
        self.schmidt = 1.0 if wind.turbulence.kind == "none" else wind.turbulence.schmidt
        self._start = grid.faces_field()  # u at the begin of the step
        self._rate = grid.faces_field()
        self._divergence = grid.field()
        self._phi = grid.field()
        self._limits = ti.field(ti.f32, 4)
        self._rows = tuple(reversed(grid.cells[1:]))
        self.max_speed = 1.0
        self._build(wind)
        self.max_courant = 0.0
        self.boundaries.measure_inertia(self._impulse)
        self.start_from(np.zeros_like)  # from rest: the potential flow that the openings force

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
        boundaries = self.boundaries
        dx, dim, viscosity, a = self.grid.dx, self.dim, self.viscosity, self.open
        eddies, lift = self.eddies, self.lift
        g = wind.acceleration or (0.0,) * dim

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
            if ti.static(eddies):  # of a constant viscosity div u = 0 leaves only the first part
                du_dx += (u[e][I] - u[e][I - D]) / dx
            return v * face_value(u[d], I, E, v) - edge_viscosity(I, D, E, d == e) * du_dx

        def of_axis(d: int) -> dict[str, Any]:
            """The formulas of the velocity component along axis d."""

            @ti.func
            def tendency(I, dt, k):
                total = -(p[I] - p[I - ti.Vector.unit(dim, d, ti.i32)])
                if ti.static(g[d] != 0.0):
                    total += g[d] * dx
                for n in ti.static(range(len(lift))):
                    if ti.static(lift[n][1][d] != 0.0):
                        below = I - ti.Vector.unit(dim, d, ti.i32)
                        total += 0.5 * dx * lift[n][1][d] * (lift[n][0][I] + lift[n][0][below])
                for e in ti.static(range(dim)):
                    for side in range(2):  # not unrolled by Taichi: half the compile time; LLVM unrolls it
                        total += (1 - 2 * side) * momentum_flux(
                            I + side * ti.Vector.unit(dim, e, ti.i32), d, e
                        )
                return ti.select(a[d][I] > 0.0, total / dx, 0.0)

            @ti.func
            def remember(I, dt, k):
                return u[d][I]

            @ti.func
            def heun(I, dt, k):  # k = 1 in the first stage, where u = u0, and 1/2 in the second
                return u0[d][I] + k * ((u[d][I] - u0[d][I]) + dt * rate[d][I])

            @ti.func
            def correct(I, dt, k):
                below = I - ti.Vector.unit(dim, d, ti.i32)
                return u[d][I] - ti.select(a[d][I] > 0.0, phi[I] - phi[below], 0.0)

            return locals()

        @ti.func
        def eddy_viscosity(I, dt, k):
            return viscosity + model(u, I, dx, constant)

        @ti.func
        def net_inflow(I, dt, k):
            total = 0.0
            for d in ti.static(range(dim)):
                total += u[d][I] - u[d][I + ti.Vector.unit(dim, d, ti.i32)]
            return total

        @ti.func
        def add_pressure(I, dt, k):
            return p[I] + (dx / dt) * phi[I]

        @ti.func
        def fill_velocity(dt, k):
            boundaries.fill_velocity(u)

        @ti.func
        def resist(dt, k):
            for one in ti.static(self.resistances):
                one.apply(u, k * dt)

        @ti.func
        def ambient_pressure(dt, k):
            if ti.static(boundaries.has_loss):
                boundaries.update_losses(u, dt)
            boundaries.fill_pressure(p, True)

        @ti.func
        def fill_phi(dt, k):
            boundaries.fill_pressure(phi, False)

        @ti.func
        def measure(dt, k):
            self._measure()

        axes = [of_axis(d) for d in range(dim)]

        def on_faces(formula: str, out: Any) -> Any:
            return sweep([axis[formula] for axis in axes], out, self.grid.faces)

        eddies_pass = []
        if wind.turbulence.kind != "none":
            model, constant = MODELS[wind.turbulence.kind], wind.turbulence.constant
            around = [(begin - 1, end + 1) for begin, end in self.grid.cells]
            eddies_pass = [sweep([eddy_viscosity], [nu], around)]
        divergence = [fill_velocity, sweep([net_inflow], [self._divergence], self.grid.cells)]
        cells = prod(self.grid.shape)
        self._begin = launch(on_faces("remember", u0), ambient_pressure, *divergence, cells=cells)
        self._stage = launch(
            *eddies_pass, on_faces("tendency", rate), on_faces("heun", u), resist, *divergence, cells=cells
        )
        self._correct = launch(
            fill_phi,
            on_faces("correct", u),
            sweep([add_pressure], [p], self.grid.cells),
            fill_velocity,
            measure,
            cells=cells,
        )

    def start_from(self, velocity: Callable[[np.ndarray], np.ndarray]) -> None:
        """Set u from a function of points (..., dim) [m] to velocities [m/s], made divergence-free; p starts at 0."""
        index = (
            np.stack(np.meshgrid(*map(np.arange, self.grid.padded), indexing="ij"), axis=-1) - self.grid.ghost
        )
        for d, field in enumerate(self.u):
            shift = np.where(np.arange(self.dim) == d, 0.0, 0.5)
            field.from_numpy(velocity((index + shift) * self.grid.dx)[..., d].astype(np.float32))
        self._begin(1.0)
        self._project(1.0)
        self.p.fill(0.0)

    def _impulse(self) -> Any:
        """The field phi that sets air at rest in motion, to the velocities prescribed at the boundaries."""
        for u in self.u:
            u.fill(0.0)
        self._begin(1.0)
        self.solver.solve(self._divergence, self._phi, self.tolerance)
        return self._phi

    # ---------------------------------------------------------------- the step

    def advance(self, t: float, dt: float) -> None:
        """One step of Heun's method and a projection."""
        for fan in self.boundaries.curved.values():
            fan.advance(self.p, dt)
        self.boundaries.update(t + dt, dt)
        for resistance in self.resistances:
            resistance.advance(t, dt)
        self._begin(dt)
        self._stage(dt, 1.0)
        self._stage(dt, 0.5)
        self._project(dt)
        self.max_courant = max(self.max_courant, dt * self.speed_rate)

    def _project(self, dt: float) -> None:
        """Make u divergence-free by the gradient of phi, and add the increment to the pressure."""
        self.solver.solve(self._divergence, self._phi, self.tolerance * max(self.max_speed, 1e-3))
        self._limits.fill(0.0)
        self._correct(dt)
        self._read_limits()

    # ---------------------------------------------------------------- limits and diagnostics

    @ti.func
    def _measure(self):
        """Maxima over the cells: sum of |u| over the axes, flow out of the cell (both over a face's area), viscosity.

        What is not finite counts as huge.
        """
        for J in ti.grouped(ti.ndrange(*self._rows)):
            most, most_out, fastest, stickiest = 0.0, 0.0, 0.0, 0.0
            for i in range(self.grid.shape[0]):
                I = ti.Vector(
                    [i + self.grid.ghost] + [J[self.dim - 1 - d] for d in ti.static(range(1, self.dim))]
                )
                total, out = 0.0, 0.0
                for d in ti.static(range(self.dim)):
                    low, high = self.u[d][I], self.u[d][I + ti.Vector.unit(self.dim, d, ti.i32)]
                    speed = ti.max(ti.abs(low), ti.abs(high))
                    total += speed
                    fastest = ti.max(fastest, speed)
                    out += ti.max(high, 0.0) - ti.min(low, 0.0)
                most = ti.max(most, ti.select(total < HUGE, total, HUGE))
                most_out = ti.max(most_out, out)
                if ti.static(self.eddies):
                    stickiest = ti.max(stickiest, self.nu[I])
            ti.atomic_max(self._limits[0], most)
            ti.atomic_max(self._limits[1], most_out)
            ti.atomic_max(self._limits[2], fastest)
            ti.atomic_max(self._limits[3], stickiest)

    def _read_limits(self) -> None:
        speed_sum, out, self.max_speed, nu = (float(v) for v in self._limits.to_numpy())
        self.speed_rate = speed_sum / self.grid.dx
        self.outflow_rate = out / self.grid.dx
        self.max_viscosity = max(nu, self.viscosity)

    def stable_dt(self, t: float = 0.0) -> float:
        """The step [s] that keeps the Courant number at its limit and diffusion stable; 0 when the flow blew up.

        t: begin of the step; what a fan's schedule prescribes soon after counts already.
        """
        if not self.speed_rate * self.grid.dx < HUGE:
            return 0.0
        # Twice as careful as diffusion alone demands: the pressure lags behind in the first stage, and its error grows
        # when viscosity spreads it too fast.
        diffusion = (6.0 if self.eddies else 4.0) * self.dim * self.max_viscosity / self.grid.dx**2
        driven = max([self.boundaries.fastest(t), *(one.fastest(t) for one in self.resistances)])
        rate = max(self.speed_rate, driven / self.grid.dx)
        return 1.0 / max(rate / self.courant + diffusion, 1e-30)

    def diagnostics(self) -> dict[str, float]:
        """max_divergence (over the largest |u|/dx), max_courant (of all steps so far), max_speed [m/s]."""
        u = [field.to_numpy().astype(np.float64) for field in self.u]
        net = sum(self.grid.inner(v - np.roll(v, -1, axis=d)) for d, v in enumerate(u))
        return {
            "max_divergence": float(np.abs(net).max() / max(self.max_speed, 1e-9)),
            "max_courant": self.max_courant,
            "max_speed": self.max_speed,
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
