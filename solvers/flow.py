"""Incompressible Navier-Stokes on the staggered grid.

    du/dt + div(u u) = -grad p + div(nu (grad u + grad u^T)) + g,   div u = 0

p is the kinematic pressure [m²/s²], g a constant acceleration. Convection in flux form (see `convection`), central
diffusion, Heun's method (SSP-RK2) with the last pressure's gradient, then one projection for the pressure increment
(second order in time).
"""

from collections.abc import Callable
from math import prod, sqrt
from typing import Any, Protocol

import numpy as np
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import sample_faces
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template, launch, sweep
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.convection import FACE_VALUES
from taichi_plume.solvers.pressure import pressure_solver
from taichi_plume.solvers.screens import ScreenResistance
from taichi_plume.solvers.surfaces import Surfaces
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


class Carried(Protocol):
    """What moves with the air and acts on it in turn."""

    def advance(self, t: float, dt: float) -> None:
        """Step from time t [s] by dt [s] with the flow at its end."""
        ...

    def diagnostics(self) -> dict[str, float]:
        """Numbers for the result."""
        ...


def _set(fields: tuple[Any, ...], values: list[np.ndarray]) -> None:
    for field, array in zip(fields, values, strict=True):
        field.from_numpy(array.astype(np.float32))


@ti.data_oriented
class FlowSolver:
    """Air flow in a box with solid cells and openings; satisfies `fields.Wind`.

    Fields: u, face velocities [m/s], one per axis; p [m²/s²]; nu, viscosity with eddy viscosity [m²/s] or None;
    area, the share of each face that is air, or None where no obstacle is; open, how freely the pressure moves the air
    of a face: 1 in the open, less where an obstacle cuts it, 0 on walls and where a velocity is prescribed.
    To be completed before the first step: lift, cell fields with the acceleration [m/s²] that a unit of each gives the
    air (buoyancy); resistances, what holds or drags it (the wind's screens are there already); carried, what is
    advanced together with it (heat).
    """

    def __init__(self, wind: CfdWind, grid: Grid, air: Air, seed: int = 0):
        self.grid = grid
        self.dim = grid.dim
        self.courant = wind.courant
        self.tolerance = wind.tolerance
        self.viscosity = wind.viscosity
        self.boundaries = Boundaries(wind.openings, grid, air.solid, seed)
        self.u = grid.faces_field()
        self.p = grid.field()
        area = [grid.pad_faces(faces, d) for d, faces in enumerate(air.area)]
        self.open = grid.faces_field()
        openness = self._openness(area)
        _set(self.open, openness)
        self.area: Any = None
        if not air.empty:
            self.area = grid.faces_field()
            _set(self.area, area)
        self.solver = pressure_solver(tuple(a * o for a, o in zip(area, openness, strict=True)), grid)
        self.eddies = wind.turbulence.kind in MODELS
        self.nu: Any = grid.field() if self.eddies else None
        self.lift: list[tuple[Any, tuple[float, ...]]] = []
        self.resistances: list[Resistance] = [
            ScreenResistance(screen, grid, openness, wind.viscosity) for screen in wind.screens
        ]
        self.carried: list[Carried] = []
        self.schmidt = 1.0 if wind.turbulence.kind == "none" else wind.turbulence.schmidt
        if self.area is not None:
            self._surfaces = Surfaces(self, air, area, openness)
        self._start = grid.faces_field()  # u at the begin of the step
        self._rate = grid.faces_field()
        self._divergence = grid.field()
        self._phi = grid.field()
        self.scratch = (self._divergence, self._phi)  # free between the steps
        self._limits = ti.field(ti.f32, 4)
        self._rows = tuple(reversed(grid.cells[1:]))
        self.max_speed = 1.0
        self._build(wind)
        self.max_courant = 0.0
        self.boundaries.measure_inertia(self._impulse)
        self.start_from(np.zeros_like)  # from rest: the potential flow that the openings force

    def _widest(self, area: list[np.ndarray]) -> list[np.ndarray]:
        """The widest passage of the volume around each face, which counts as the volume that stores its momentum.

        However little of a volume is air, it then does not shorten the step; what is steady does not depend on it.
        """
        result = []
        for d in range(self.dim):
            widest = area[d].copy()
            for e in range(self.dim):
                low = 0.5 * (area[e] + np.roll(area[e], 1, axis=d))
                widest = np.maximum(widest, np.maximum(low, np.roll(low, -1, axis=e)))
            result.append(np.maximum(widest, 1e-6))
        return result

    def _openness(self, area: list[np.ndarray]) -> list[np.ndarray]:
        """Area over stored volume, 0 where the velocity is not solved for; padded."""
        g = self.grid.ghost
        result = []
        for d, widest in enumerate(self._widest(area)):
            faces = area[d] / widest
            if not self.grid.periodic[d]:
                free = self.boundaries.free[d].to_numpy()
                along = np.moveaxis(faces, d, 0)
                along[g] = (along[g] > 0.0) * np.take(free, 0, axis=d)
                along[g + self.grid.shape[d]] = (along[g + self.grid.shape[d]] > 0.0) * np.take(
                    free, 1, axis=d
                )
            result.append(faces)
        return result

    def _build(self, wind: CfdWind) -> None:
        """The formulas of a step, each swept over its cells or faces."""
        u, u0, rate, p, nu, phi = self.u, self._start, self._rate, self.p, self.nu, self._phi
        boundaries = self.boundaries
        dx, dim, viscosity, a = self.grid.dx, self.dim, self.viscosity, self.open
        eddies, lift = self.eddies, self.lift
        area, cut = self.area, self.area is not None
        face_value = FACE_VALUES[wind.convection]
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
            if ti.static(eddies):  # of a constant viscosity div u = 0 leaves only the first part
                du_dx += (u[e][I] - u[e][I - D]) / dx
            if ti.static(cut):
                v = 0.5 * (area[e][I] * u[e][I] + area[e][I - D] * u[e][I - D])
                du_dx *= 0.5 * (area[e][I] + area[e][I - D])
                if ti.static(d != e):  # the middles of what is open of the two faces lie closer than dx
                    low, high = area[d][I - E], area[d][I]
                    less, more = ti.min(low, high), ti.max(low, high)
                    du_dx *= ti.select(less > 0.0, 2.0 * more / (less + more), 0.0)
            return v * face_value(u[d], I, E, v) - edge_viscosity(I, D, E, d == e) * du_dx

        def of_axis(d: int) -> dict[str, Any]:
            """The formulas of the velocity component along axis d."""

            @ti.func
            def inflow(I):
                """Net flux of u_d [m²/s²] into the volume around face I."""
                total = 0.0
                for e in ti.static(range(dim)):
                    for side in range(2):  # not unrolled by Taichi: half the compile time; LLVM unrolls it
                        total += (1 - 2 * side) * momentum_flux(
                            I + side * ti.Vector.unit(dim, e, ti.i32), d, e
                        )
                return total

            @ti.func
            def tendency(I, dt, k):
                below = I - ti.Vector.unit(dim, d, ti.i32)
                push = -(p[I] - p[below])
                if ti.static(g[d] != 0.0):
                    push += g[d] * dx
                for n in ti.static(range(len(lift))):
                    if ti.static(lift[n][1][d] != 0.0):
                        push += 0.5 * dx * lift[n][1][d] * (lift[n][0][I] + lift[n][0][below])
                stored = 1.0  # volume in cells
                if ti.static(cut):
                    stored = area[d][I] / ti.max(a[d][I], 1e-6)
                result = (a[d][I] * push + inflow(I) / ti.max(stored, 1e-3)) / dx
                return ti.select(a[d][I] > 0.0, result, 0.0)

            @ti.func
            def loss(I, dt, k):
                """Momentum [m/s² of a whole cell] that flows on to faces that obstacles close."""
                return ti.select(a[d][I] > 0.0, 0.0, inflow(I) / dx)

            @ti.func
            def remember(I, dt, k):
                return u[d][I]

            @ti.func
            def heun(I, dt, k):  # k = 1 in the first stage, where u = u0, and 1/2 in the second
                return u0[d][I] + k * ((u[d][I] - u0[d][I]) + dt * rate[d][I])

            @ti.func
            def correct(I, dt, k):
                below = I - ti.Vector.unit(dim, d, ti.i32)
                return u[d][I] - a[d][I] * (phi[I] - phi[below])

            return locals()

        @ti.func
        def eddy_viscosity(I, dt, k):
            return viscosity + model(u, I, dx, constant)

        @ti.func
        def net_inflow(I, dt, k):
            total = 0.0
            for d in ti.static(range(dim)):
                above = I + ti.Vector.unit(dim, d, ti.i32)
                if ti.static(cut):
                    total += area[d][I] * u[d][I] - area[d][above] * u[d][above]
                else:
                    total += u[d][I] - u[d][above]
            return total

        @ti.func
        def add_pressure(I, dt, k):
            return p[I] + (dx / dt) * phi[I]

        @ti.func
        def fill_velocity(dt, k):
            boundaries.fill_velocity(u)

        @ti.func
        def slow(dt, k):
            if ti.static(cut):
                self._surfaces.slow(rate, dt)

        @ti.func
        def add_loss(dt, k):
            self._surfaces.add_loss(rate)

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
        cells = prod(self.grid.shape)
        self._begin = launch(on_faces("remember", u0), ambient_pressure, cells=cells)
        self._stage = launch(
            fill_velocity,
            *eddies_pass,
            on_faces("tendency", rate),
            slow,
            on_faces("heun", u),
            resist,
            cells=cells,
        )
        net_inflow_pass = sweep([net_inflow], [self._divergence], self.grid.cells)
        self._diverge = launch(fill_velocity, net_inflow_pass, cells=cells)
        self._correct = launch(
            fill_phi,
            on_faces("correct", u),
            sweep([add_pressure], [p], self.grid.cells),
            fill_velocity,
            measure,
            cells=cells,
        )

        if cut:
            self._lose = launch(on_faces("loss", rate), add_loss, cells=cells)

    def start_from(self, velocity: Callable[[np.ndarray], np.ndarray]) -> None:
        """Set u from a function of points (..., dim) [m] to velocities [m/s], made divergence-free; p starts at 0."""
        index = (
            np.stack(np.meshgrid(*map(np.arange, self.grid.padded), indexing="ij"), axis=-1) - self.grid.ghost
        )
        for d, field in enumerate(self.u):
            shift = np.where(np.arange(self.dim) == d, 0.0, 0.5)
            field.from_numpy(velocity((index + shift) * self.grid.dx)[..., d].astype(np.float32))
        self._begin(1.0)
        self._diverge()
        self._project(1.0)
        self.p.fill(0.0)

    def _impulse(self) -> Any:
        """The field phi that sets air at rest in motion, to the velocities prescribed at the boundaries."""
        for u in self.u:
            u.fill(0.0)
        self._begin(1.0)
        self._diverge()
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
        self._diverge()
        self._project(dt)
        self.max_courant = max(self.max_courant, dt * self.speed_rate)
        for one in self.carried:
            one.advance(t, dt)

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
        limit = max(rate / self.courant + diffusion, 1e-30)
        # What the lift adds to |u| within the step counts as well; near a corner the pressure turns and more than
        # doubles it. Waves in layered air are slower than that.
        strongest: Any = self._strongest_lift() if self.lift else 0.0
        return 2.0 / (limit + sqrt(limit**2 + 12.0 * strongest / (self.courant * self.grid.dx)))

    @ti.kernel
    def _strongest_lift(self) -> ti.f32:
        """Largest acceleration by lift, its components' magnitudes summed [m/s²]."""
        result = 0.0
        for J in ti.grouped(ti.ndrange(*self._rows)):
            most = 0.0
            for i in range(self.grid.shape[0]):
                I = ti.Vector(
                    [i + self.grid.ghost] + [J[self.dim - 1 - d] for d in ti.static(range(1, self.dim))]
                )
                total = 0.0
                for d in ti.static(range(self.dim)):
                    component = 0.0
                    for n in ti.static(range(len(self.lift))):
                        component += self.lift[n][0][I] * self.lift[n][1][d]
                    total += ti.abs(component)
                most = ti.max(most, total)
            ti.atomic_max(result, most)
        return result

    def diagnostics(self) -> dict[str, float]:
        """max_divergence (over the largest |u|/dx), max_courant (of all steps so far), max_speed [m/s]."""
        u = [field.to_numpy().astype(np.float64) for field in self.u]
        if self.area is not None:
            u = [v * area.to_numpy() for v, area in zip(u, self.area, strict=True)]
        net = sum(self.grid.inner(v - np.roll(v, -1, axis=d)) for d, v in enumerate(u))
        return {
            "max_divergence": float(np.abs(net).max() / max(self.max_speed, 1e-9)),
            "max_courant": self.max_courant,
            "max_speed": self.max_speed,
            **{key: value for one in self.carried for key, value in one.diagnostics().items()},
        }

    def momentum_loss(self) -> list[np.ndarray]:
        """What obstacles take from the air except by pressure, per axis on the lower faces of the cells [m/s²]."""
        self._lose()
        return [self.grid.read(field) for field in self._rate]

    # ---------------------------------------------------------------- sampling

    @ti.func
    def velocity(self, x: Template, t: float):
        """Velocity [m/s] at point x [m], linear between the faces; the time is the solver's own."""
        return sample_faces(self.u, x, self.grid.dx, self.grid.ghost, self.grid.padded)
