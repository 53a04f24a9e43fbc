"""Incompressible Navier-Stokes equations on the staggered grid (finite volumes, projection method).

    du/dt + div(u u) = -grad p + div(nu (grad u + grad u^T)) + b + g,   div u = s

p is the kinematic pressure [m²/s²], b buoyancy, g a constant acceleration and s released volume (see `continuity`). The
terms are in `momentum`: convection in flux form (see `convection`), central diffusion. A three-stage Runge-Kutta method
(see `time_stepping`) advances with the last pressure's gradient; projections (see `continuity`) give its increment:
second order.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier, Faces
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass, Template, launch, together
from taichi_plume.grid.sweeps import copying, flux_sweep, sweep
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.continuity import corrected, increased, net_inflow
from taichi_plume.solvers.ghosts import Ghosts
from taichi_plume.solvers.heat import HeatSolver
from taichi_plume.solvers.momentum import (
    BuoyantScalar,
    Momentum,
    eddy_viscosity,
    flux,
    opennesses,
    tendency,
)
from taichi_plume.solvers.prescribed_wind import padded_faces
from taichi_plume.solvers.pressure import pressure_solver
from taichi_plume.solvers.screens import Resistance, ScreenResistance
from taichi_plume.solvers.surfaces import Surfaces
from taichi_plume.solvers.time_stepping import HUGE, Limits, stages_for
from taichi_plume.solvers.transport import Scalar
from taichi_plume.solvers.turbulence import MODELS
from taichi_plume.solvers.walls import Walls, distances


@ti.func
def advanced(u: Template, u0: Template, rate: Template, d: Template, I, dt, k):
    """Return u_d at face I after a stage of weight k, from u0 at the start of the step (low-storage Runge-Kutta)."""
    return u0[d][I] + k * ((u[d][I] - u0[d][I]) + dt * rate[d][I])


@ti.func
def lost(m: Template, d: Template, I, net, a, b):
    """Return the momentum that flows to face I of axis d per time and volume of a whole cell [m/s²] where an obstacle
    closes the face; 0 at other faces. net: sum of `flux` into the volume around the face.
    """
    return ti.select(m.open[d][I] <= 0.0, net / m.dx, 0.0)


class FlowSolver(Carrier):
    """Solver of the incompressible Navier–Stokes equations in a box with solid cells and openings; a `fields.Carrier`.

    Fields besides the carrier's: p [m²/s²]. boundaries: boundary conditions; heat: temperature of the air, None if not
    computed; resistances: screens, moving bodies.
    """

    STATE = (
        "u", "p", "nu", "boundaries", "heat",
        "speed_rate", "outflow_rate", "max_speed", "max_viscosity", "max_courant", "step_rate",
    )  # fmt: skip

    def __init__(
        self,
        model: CfdWind,
        grid: Grid,
        air: Air,
        t: float = 0.0,
        seed: int = 0,
        weighing: Sequence[BuoyantScalar] = (),
        resistances: Sequence[Callable[[Faces], Resistance]] = (),
    ):
        """weighing: scalars besides heat that change the density; resistances: functions of the fields `open` that
        return resistances. Raises ValueError with the key in `model` of a jet, heater or warm surface without air.
        """
        self.grid = grid
        self.dim = grid.dim
        self.boundaries = Boundaries(model.openings, grid, air.area, seed)
        self._area = [grid.pad_faces(faces, d) for d, faces in enumerate(air.area)]
        fractions = opennesses(grid, self._area, self.boundaries.is_free)
        self.u = grid.faces_field()
        self.p = grid.field()
        self.nu = grid.field() if model.turbulence.kind in MODELS else None
        self.scratch = (grid.field(), grid.field())
        self._divergence, self._phi = self.scratch
        self._start, self._rate = grid.faces_field(), grid.faces_field()  # u at the start of the step, du/dt
        heat = model.buoyancy.heat if model.buoyancy is not None else None
        theta = Scalar(grid) if heat is not None else None
        weighing = list(weighing)
        if heat is not None and theta is not None:
            weighing.append(BuoyantScalar(theta.q, -heat.volume_expansion))
        sources = [scalar.source for scalar in weighing if scalar.source is not None]
        areas = None if air.empty else self._area
        away = None if self.nu is None else distances(air, self.boundaries.is_wall, grid)
        self.momentum = Momentum(
            model, grid, self.u, self.p, self.nu, fractions, areas, [scalar.field for scalar in weighing],
            [scalar.weight for scalar in weighing], sources, away,
        )  # fmt: skip
        self.walls = None
        if self.nu is not None and not all(grid.periodic):
            self.walls = Walls(self.boundaries, self.momentum)
        self.open, self.area = self.momentum.open, self.momentum.area
        screens = (ScreenResistance(screen, grid, fractions, model.viscosity) for screen in model.screens)
        self.resistances: tuple[Resistance, ...] = (*screens, *(make(self.open) for make in resistances))
        self.surfaces = None if air.empty else Surfaces(self.momentum, air, self._area, fractions)
        self.limits = Limits(self.momentum)
        self.solver = pressure_solver(tuple(a * o for a, o in zip(self._area, fractions, strict=True)), grid)
        self._list_passes()
        self.courant, self.tolerance, self.viscosity = model.courant, model.tolerance, model.viscosity
        self._stages = stages_for(model.courant)
        self._weights = self.limits.weights(model.courant)
        self.schmidt = 1.0 if model.turbulence.kind == "none" else model.turbulence.schmidt
        self.heat: HeatSolver | None = None
        if heat is not None:
            try:
                self.heat = HeatSolver(heat, grid, self, self.boundaries.patches, air, theta, seed)
            except ValueError as error:
                raise ValueError(f"buoyancy.heat.{error}") from None
        self.max_speed, self.max_courant = 1.0, 0.0
        self.boundaries.measure_inertia(self._impulse)
        for field in self.u:
            field.fill(0.0)
        self._settle()

    # ---------------------------------------------------------------- the step

    def _list_passes(self) -> None:
        """List the passes over cells and faces of which a step consists, in the order of the scheme."""
        m, grid, p, phi = self.momentum, self.grid, self.p, self._phi
        u, u0, rate = self.u, self._start, self._rate
        ghosts, walls, surfaces = Ghosts(self.boundaries, self.walls), self.walls, self.surfaces
        axes, faces = range(self.dim), [grid.faces(d) for d in range(self.dim)]
        around = [(begin - 1, end + 1) for begin, end in grid.cells]

        def on_faces(term: Callable, out: Faces, *parts: object) -> list[Pass]:
            return together([sweep(partial(term, *parts, d), out[d], faces[d]) for d in axes])

        def of_fluxes(term: Callable) -> list[Pass]:
            fluxes = [[partial(flux, m, d, e) for e in axes] for d in axes]
            return together([flux_sweep(fluxes[d], partial(term, m, d), rate[d], faces[d]) for d in axes])

        slipping = surfaces.slipping if surfaces else lambda convection: convection
        resisting = sum(resistance.cells for resistance in self.resistances)
        self._keep = copying(u0, u)
        self._prepare = launch(
            *together(
                [
                    *(walls.measuring(u) if walls else []),
                    *(ghosts.updating_losses(u, m) if self.boundaries.has_loss else []),
                ]
            ),
            *ghosts.filling_pressure(p, True),
        )
        self._fill = launch(*ghosts.filling_velocity(u))
        self._set_viscosity = launch(
            *([sweep(partial(eddy_viscosity, m), self.nu, around)] if m.eddies else []),
            *(walls.extending(self.nu) if walls else []),
            *(surfaces.measuring() if surfaces else []),
        )
        self._stage = launch(
            *slipping(of_fluxes(tendency)),
            *(surfaces.slowing(rate) if surfaces else []),
            *on_faces(advanced, u, u, u0, rate),
            *([Pass(self._resist, resisting)] if self.resistances else []),
        )
        self._prescribe = launch(*ghosts.prescribing(u, u0))
        self._diverge = launch(sweep(partial(net_inflow, m), self._divergence, grid.cells))
        self._correct = launch(
            *ghosts.filling_pressure(phi, False),
            *together(
                [
                    *(sweep(partial(corrected, m, phi, d), u[d], faces[d]) for d in axes),
                    sweep(partial(increased, m, phi), p, around),
                ]
            ),
        )
        self._find_limits = launch(*self.limits.passes())
        self._lose = launch(
            *slipping(of_fluxes(lost)),
            *(ghosts.filling_pressure(p, True) if surfaces else []),
            *([*surfaces.measuring(), *surfaces.losing(rate)] if surfaces else []),
        )

    @ti.func
    def _resist(self, dt, k):
        for resistance in ti.static(self.resistances):
            resistance.apply(self.u, k * dt)

    def advance(self, t: float, dt: float) -> None:
        self.boundaries.advance(self.p, t, dt)
        for resistance in self.resistances:
            resistance.advance(t, dt)
        self._begin(dt)
        for n, (k, c, lag) in enumerate(self._stages):
            if n > 0:
                self._fill()
            self._stage(dt, k)
            self._prescribe(c)
            if lag > 0.0:
                self._project(lag * dt)
        self._fill()
        self._measure()
        self.max_courant = max(self.max_courant, dt * self.speed_rate)
        if self.heat is not None:
            self.heat.advance(t, dt)

    def _begin(self, dt: float) -> None:
        """Remember u as the velocity at the start of a step of dt [s]; update what stays the same in the step: eddy
        viscosity and friction coefficients are those of its start.
        """
        self._keep()
        self._prepare(dt)
        self._fill()
        self._set_viscosity()

    def _project(self, dt: float) -> None:
        """Project u on divergence-free fields by the gradient of phi; dt [s]: scale of the pressure increment."""
        self._diverge()
        self.solver.solve(self._divergence, self._phi, self.tolerance * max(self.max_speed, 1e-3))
        self._correct(dt)

    # ---------------------------------------------------------------- the start of a run

    def start_from(self, velocity: Callable[[np.ndarray], np.ndarray]) -> None:
        """Set u from a function of points (..., dim) [m] to velocities [m/s], made divergence-free; p becomes 0."""
        for d, area in enumerate(self._area):
            self.u[d].from_numpy(np.where(area > 0.0, velocity(padded_faces(self.grid, d))[..., d], 0.0))
        self._settle()

    def _settle(self) -> None:
        """Make the present u divergence-free and set p to 0."""
        self._begin(1.0)
        self._prescribe(1.0)
        self._project(1.0)
        self._fill()
        self._set_viscosity()
        self._measure()
        self.p.fill(0.0)

    def _impulse(self) -> Field:
        """Return the field phi whose gradient sets resting air in motion with the velocities at the boundaries."""
        for field in self.u:
            field.fill(0.0)
        self._begin(1.0)
        self._prescribe(1.0)
        self._diverge()
        self.solver.solve(self._divergence, self._phi, self.tolerance)
        return self._phi

    # ---------------------------------------------------------------- limits and diagnostics

    def _measure(self) -> None:
        """Measure what limits the next step."""
        self._find_limits(*self._weights)
        self.speed_rate, self.outflow_rate, self.max_speed, viscosity, self.step_rate = self.limits.read()
        self.max_viscosity = max(viscosity, self.viscosity)

    def stable_dt(self, t: float = 0.0) -> float:
        """Return the largest stable time step [s] at time t, by the Courant number (CFL) and diffusion in each cell; 0
        if the flow is not finite.

        Speeds that a schedule prescribes soon after t already count.
        """
        if not self.speed_rate * self.grid.dx < HUGE:
            return 0.0
        driven = max(
            [self.boundaries.fastest(t), *(resistance.fastest(t) for resistance in self.resistances)]
        )
        convection, diffusion = self._weights
        rate = max(self.step_rate, convection * driven + diffusion * self.max_viscosity)
        return self.limits.longest_step(rate, self.courant)

    def diagnostics(self) -> dict[str, float]:
        """Return the largest divergence (over max_speed/dx), Courant number (of all steps) and speed [m/s], by name.

        With a turbulence model also the median and largest y+ of the cells at the domain's walls.
        """
        u = [field.to_numpy().astype(np.float64) for field in self.u]
        y_plus = self.walls.y_plus(u) if self.walls is not None else np.empty(0)
        heights = {"median": np.median(y_plus), "max": y_plus.max()} if len(y_plus) else {}
        if self.area is not None:
            u = [v * area for v, area in zip(u, self._area, strict=True)]
        net = sum(self.grid.inner(v - np.roll(v, -1, axis=d)) for d, v in enumerate(u))
        net += self.grid.dx * sum(self.grid.read(source).astype(float) for source in self.momentum.sources)
        return {
            "max_divergence": float(np.abs(net).max() / max(self.max_speed, 1e-9)),
            "max_courant": self.max_courant,
            "max_speed": self.max_speed,
            **{f"wall_y_plus_{name}": float(value) for name, value in heights.items()},
            **(self.heat.diagnostics() if self.heat is not None else {}),
        }

    def momentum_loss(self) -> list[np.ndarray]:
        """Return the friction of obstacles on the air per axis, on the lower faces of the cells [m/s²]."""
        self._lose()
        return [self.grid.read(field) for field in self._rate]
