"""Scalar transport equation on the grid: convection (advection) and diffusion of gas and heat in the air.

    dq/dt + div(u q) = div((K + nu_t/Sc_t) grad q) + sources

Finite volumes with the face velocities of the flow, so a well-mixed quantity stays well mixed. Limited face values, and
stages short enough that no cell loses more than its content, create no new extrema. Both sides of a face use the same
flux, and a cell's fluxes are summed in f64. The rounding errors of q in f32 are stored in `rest`, so that the total is
conserved for any number of steps and for changes of any size.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import ceil, prod
from typing import cast

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass, Template, each, launch, together
from taichi_plume.grid.sweeps import copying, flux_sweep, sweep
from taichi_plume.solvers.convection import Limited
from taichi_plume.solvers.openings import Patch
from taichi_plume.solvers.release import Release
from taichi_plume.solvers.surface_exchange import BETWEEN, FIRST, LAST, SurfaceExchange, Tally


class Scalar:
    """Scalar q per volume of air in the cells of a grid; rest: rounding errors of q, which is stored in f32; source:
    volume of gas that is released in each cell [1/s], None if the gas takes no space.
    """

    STATE = ("q", "rest")

    def __init__(self, grid: Grid, takes_space: bool = False):
        self.q, self.rest = grid.field(), grid.field()
        self.source: Field = grid.field() if takes_space else None


FULLEST = 0.98  # largest share of a cell's content that leaves it in one stage, at the steepest slope
MOST_STAGES = 5  # largest number of stages of a step; more stages leave more of the old content behind


@ti.func
def open_slope(q: Template, open_faces: Template, I, D, dx: float):
    """Return the gradient dq/dx at the lower face of cell I along the unit vector D; 0 if the face is closed."""
    return ti.select(open_faces[I] > 0.0, (q[I] - q[I - D]) / dx, 0.0)


@ti.func
def raised(q, rest, rate, dt):
    """Return q + rest + rate dt, computed in f64 and rounded to f32, and the rounding error."""
    change = ti.cast(rest, ti.f64) + ti.cast(dt, ti.f64) * ti.cast(rate, ti.f64)
    exact = ti.cast(q, ti.f64) + change
    rounded = ti.cast(exact, ti.f32)
    return rounded, ti.cast(exact - ti.cast(rounded, ti.f64), ti.f32)


class Transport:
    """Transport of a scalar q per volume of air by convection and diffusion, in finite volumes.

    scheme: convection scheme. diffusivity: of still air [m²/s]; schmidt: turbulent Schmidt number (eddy viscosity over
    eddy diffusivity). release: sources. surfaces: walls and obstacles that exchange q with the air. has_inflow:
    whether inflow may carry q, see `set_inflow`; otherwise inflow is clean.

    Fields: q; rest, rounding errors of q; rate [1/s], the sum of the tendencies in the step's stages so far.
    """

    STATE = ("q", "rest", "_outflow", "_inflow")

    def __init__(
        self,
        grid: Grid,
        wind: Carrier,
        air: Air,
        scheme: Limited,
        scalar: Scalar,
        diffusivity: float,
        schmidt: float,
        release: Release | None = None,
        surfaces: SurfaceExchange | None = None,
        has_inflow: bool = False,
    ):
        self.grid = grid
        self.dim = grid.dim
        self.wind = wind
        self.per_length = float(np.float32(1.0 / grid.dx))  # 1/dx in f32, as in the kernels
        self.surfaces = surfaces
        self.q, self.rest = scalar.q, scalar.rest
        self.eddies = wind.nu is not None
        self._area = wind.area or ()
        self.cut = wind.area is not None
        self.room: Field = None  # air fraction of each cell, which stores q
        if self.cut:
            self.room = grid.filled(grid.pad(air.room))
        # a flow solver provides fields that are unused during transport
        self._start, self.rate = wind.scratch or (grid.field(), grid.field())
        self._outflow = Tally()
        self._inflow = Tally() if has_inflow else None
        self._sides = [tuple(2 if a == d else n for a, n in enumerate(grid.shape)) for d in range(grid.dim)]
        self.inflow = tuple(ti.field(ti.f32, side) for side in self._sides) if has_inflow else ()
        self._set_diffusivity(diffusivity, schmidt)
        self._face_value, self._steepest = scheme
        cells = grid.cells
        self._keep = copying((self._start,), (self.q,))
        self._stage = launch(
            *([release.into(self.q, self.rest, self._start)] if release else []),
            Pass(self._begin_count, 1),
            *together(
                [
                    sweep(
                        partial(self._beyond, d),
                        (self.q,) * grid.ghost,
                        [(0, n) for n in side],
                        partial(self._ghost, d),
                        int(d == 0),
                    )
                    for d, side in enumerate(self._sides)
                ]
            ),
            flux_sweep(
                [partial(self._flux, d) for d in range(self.dim)],
                self._tendency,
                self.rate,
                cells,
                exact=True,
            ),
            *([surfaces.into(self.rate, self.q)] if surfaces else []),
            *self._counting(),
            sweep(self._advanced, (self.q, self.rest), cells),
        )

    def _set_diffusivity(self, diffusivity: float, schmidt: float) -> None:
        """Set the diffusivity of still air [m²/s] and the turbulent Schmidt number (eddy viscosity/diffusivity)."""
        self.diffusivity, self.schmidt = diffusivity, schmidt
        per_schmidt = np.float32(1.0 / float(np.float32(schmidt)))
        viscosity = np.float32(self.wind.viscosity if self.eddies else 0.0)
        still = np.float32(diffusivity) - viscosity * per_schmidt  # with nu_t/Sc_t = (nu - viscosity)/Sc_t
        self._still, self._per_schmidt = float(still), float(per_schmidt)

    def set_inflow(self, openings: Sequence[tuple[Patch, float]]) -> None:
        """Set q of the air that enters through openings (inlet, Dirichlet condition); elsewhere inflow has q = 0."""
        values = [np.zeros(side) for side in self._sides]
        for patch, q in openings:
            np.moveaxis(values[patch.axis], patch.axis, 0)[patch.side][patch.covered] = q
        for field, side in zip(self.inflow, values, strict=True):
            field.from_numpy(side)

    def start_from(self, function: Callable[[np.ndarray], np.ndarray]) -> None:
        """Set q from a function of points (..., dim) [m], without rounding errors."""
        self.q.from_numpy(self.grid.pad(function(self.grid.centers())))
        self.rest.fill(0.0)

    # ---------------------------------------------------------------- the scheme

    @ti.func
    def _diffusivity(self, I, D):
        """Return the diffusivity K + nu_t/Sc_t [m²/s] on the lower face of cell I along the unit vector D."""
        K = self._still
        if ti.static(self.eddies):
            K += 0.5 * self._per_schmidt * (self.wind.nu[I] + self.wind.nu[I - D])
        return K

    @ti.func
    def _flux(self, d: Template, I):
        """Return the flux of q through the lower face of cell I across axis d: convection, and diffusion if open."""
        D = ti.Vector.unit(self.dim, d, ti.i32)
        v = self.wind.u[d][I]
        slope = open_slope(self.q, self.wind.open[d], I, D, self.grid.dx)
        flux = v * self._face_value(self.q, I, D, v) - self._diffusivity(I, D) * slope
        if ti.static(self.cut):
            flux *= self._area[d][I]
        return flux

    @ti.func
    def _tendency(self, I, net, h, stage):
        """Return dq/dt of cell I by the net flux of this stage, added to the sum over the previous stages."""
        rate = ti.cast(net, ti.f32) * self.per_length
        if ti.static(self.cut):
            rate /= ti.max(self.room[I], 1e-3)
        return rate + ti.select(stage > FIRST, self.rate[I], 0.0)

    @ti.func
    def _advanced(self, I, h, stage):
        """Return q of cell I after a stage, and its rounding error, which only the last stage updates."""
        q, rest = raised(self._start[I], self.rest[I], self.rate[I], h)
        return ti.Vector([q, ti.select(stage == LAST, rest, self.rest[I])])

    @ti.func
    def _ghost(self, d: Template, J, m: Template):
        """Return the m-th ghost cell beyond boundary face J of axis d, the nearest first."""
        n, g = ti.static(self.grid.shape[d], self.grid.ghost)
        return J + g + ti.Vector.unit(self.dim, d, ti.i32) * (J[d] * (n + 2 * m) - 1 - m)

    @ti.func
    def _beyond(self, d: Template, J, h, stage):
        """Return q in the ghost cells beyond boundary face J of axis d: zero gradient at outflow, inflow values,
        periodic.
        """
        n, g = ti.static(self.grid.shape[d], self.grid.ghost)
        D = ti.Vector.unit(self.dim, d, ti.i32)
        outward = 2 * J[d] - 1
        inner = J + g + D * J[d] * (n - 2)
        values = ti.Vector.zero(ti.f32, g)
        if ti.static(self.grid.periodic[d]):
            for m in ti.static(range(g)):
                values[m] = self.q[inner - D * outward * (n - 1 - m % n)]
        else:
            out = self.wind.u[d][inner + D * J[d]] * outward
            beyond = 0.0
            if ti.static(len(self.inflow) > 0):
                beyond = self.inflow[d][J]
            value = ti.select(out >= 0.0, self.q[inner], beyond)
            for m in ti.static(range(g)):
                values[m] = value
        return values

    def _counting(self) -> list[Pass]:
        """Return the passes that add the outflow and the inflow through the domain's faces in a stage to their totals.

        A thread adds up a line of boundary faces, along the first axis.
        """
        axes = [d for d in range(self.dim) if not self.grid.periodic[d]]
        lines = [each(partial(self._count_line, d), prod(self._sides[d][1:])) for d in axes]
        return [*together(lines), Pass(self._end_count, 1)]

    @ti.func
    def _begin_count(self, h, stage):
        self._outflow.begin(stage)
        if ti.static(len(self.inflow) > 0):
            self._inflow.begin(stage)

    @ti.func
    def _end_count(self, h, stage):
        self._outflow.end(h)
        if ti.static(len(self.inflow) > 0):
            self._inflow.end(h)

    @ti.func
    def _count_line(self, d: Template, n, h, stage):
        K = ti.Vector.zero(ti.i32, self.dim)
        K[1] = n
        if ti.static(self.dim == 3):
            K[2] = ti.raw_div(n, self._sides[d][1])
            K[1] = n - K[2] * self._sides[d][1]
        D = ti.Vector.unit(self.dim, d, ti.i32)
        out, into = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
        for i in range(self._sides[d][0]):
            K[0] = i
            face = K + ti.static(self.grid.ghost) + D * K[d] * (ti.static(self.grid.shape[d]) - 1)
            leaves = ti.cast(self._flux(d, face) * (2 * K[d] - 1), ti.f64)
            out += leaves
            if ti.static(len(self.inflow) > 0):
                into -= ti.min(leaves, 0.0)
        self._outflow.add(out)
        if ti.static(len(self.inflow) > 0):
            self._inflow.add(into)

    # ---------------------------------------------------------------- the step

    def _euler_steps(self, dt: float) -> float:
        """Return the number of Euler steps in dt [s], as a fraction, in which no cell loses more than its content."""
        K = self.diffusivity + (self.wind.max_viscosity - self.wind.viscosity) / self.schmidt
        given = self._steepest * self.wind.outflow_rate + 2.0 * self.dim * K / self.grid.dx**2
        if self.surfaces is not None:
            given += self.surfaces.fastest
        return dt * given / FULLEST

    def steps(self, dt: float) -> int:
        """Return the number of equal Runge–Kutta steps into which to divide dt [s] for positivity."""
        return max(1, ceil(self._euler_steps(dt) / (MOST_STAGES - 1) - 1e-9))

    def step(self, dt: float) -> None:
        """Advance q by dt [s], no longer than `steps` allows, by a second-order strong-stability-preserving Runge–Kutta
        method (SSP(s, 2), Spiteri & Ruuth 2002, doi:10.1137/S0036142901389025; Heun's method for s = 2): s - 1 Euler
        stages of dt/(s - 1), another stage, and the mean of their rates over the step.
        """
        stages = 1 + max(1, ceil(self._euler_steps(dt) - 1e-9))
        self._keep()
        for n in range(stages - 1):
            self._stage(dt / (stages - 1), FIRST if n == 0 else BETWEEN)
        self._stage(dt / stages, LAST)

    # ---------------------------------------------------------------- totals

    @ti.kernel
    def _sum(self) -> ti.f64:
        total = ti.cast(0.0, ti.f64)
        for J in ti.grouped(ti.ndrange(*self.grid.shape)):
            I = J + ti.static(self.grid.ghost)
            stored = ti.cast(self.q[I], ti.f64)
            if ti.static(self.cut):
                stored *= self.room[I]
            total += stored
        return total

    def least(self) -> float:
        """Return the smallest q of all cells."""
        return float(self.grid.inner(self.q.values).min())

    def inside(self) -> float:
        """Return the integral of q over the air in the domain."""
        return cast(float, self._sum()) * self.grid.cell_volume

    def outflow(self) -> float:
        """Return the net outflow of q (outflow less inflow) through the domain's faces since the start."""
        return self._outflow.read() * self.grid.cell_volume * self.per_length

    def brought_in(self) -> float:
        """Return the inflow of q through the domain's faces since the start."""
        return self._inflow.read() * self.grid.cell_volume * self.per_length if self._inflow else 0.0
