"""Convection and diffusion of a quantity of the air on the grid: what gas and heat share.

    dq/dt + div(u q) = div((K + nu_t/Sc_t) grad q) + sources

Finite volumes with the flow's own face velocities, so a well-mixed quantity stays well mixed; the Koren limiter and
steps short enough that no cell gives away more than it holds make no new extrema. Every face's flux is seen alike from
both sides and a cell's fluxes are summed in f64; what f32 cannot hold of q is kept beside it, so that the total
is conserved however many steps are taken and however little each one changes.
"""

from collections.abc import Callable, Sequence
from math import ceil, prod
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template, double_field, launch, sweep
from taichi_plume.solvers.scalar import Scalar

FULLEST = (
    0.49  # largest share of a cell's volume that flows out in one stage; 1/2 empties it at the steepest slope
)


@ti.data_oriented
class Transport:
    """A quantity q per volume of air that the wind carries and that diffuses.

    wind: offers u, open, area (face fields; area None where no obstacle is), nu (viscosity with eddies, or None),
    viscosity, and the maxima max_viscosity [m²/s] and outflow_rate (flow out of a cell over its volume [1/s]).
    diffusivity [m²/s]: of still air; schmidt: eddy viscosity over eddy diffusivity.
    add_sources: a pass (see `kernels.launch`) that adds to q and `rest` what a step of length a brings.
    face_value: of `convection.POSITIVE_FACE_VALUES`.
    exchange: a pass that adds to `rate` k times what a stage exchanges with surfaces, at most exchange_rate [1/s]
    times q.
    inflow: q of the air that comes in, a field over the two faces of each axis; clean air unless given.
    scalar: the quantity; one of its own unless given.

    Fields: q; rest, what rounding has left out of q; rate [1/s], the mean tendency of the step's stages so far.
    """

    def __init__(
        self,
        grid: Grid,
        wind: Any,
        air: Air,
        diffusivity: float,
        schmidt: float,
        face_value: Callable[..., Any],
        add_sources: Callable[[Any, Any], None] | None,
        exchange: Callable[[Any, Any], None] | None = None,
        exchange_rate: float = 0.0,
        inflow: Sequence[Any] = (),
        scalar: Scalar | None = None,
    ):
        scalar = scalar or Scalar(grid)
        self.grid = grid
        self.dim = grid.dim
        self.wind = wind
        self.diffusivity = diffusivity
        self.schmidt = schmidt
        self.per_length = float(np.float32(1.0 / grid.dx))  # as the cells reckon it
        self.exchange_rate = exchange_rate
        self.inflow = tuple(inflow)
        self.q, self.rest = scalar.q, scalar.rest
        self.room: Any = None  # share of each cell's volume that stores q
        self.cut = wind.area is not None
        if self.cut:
            self.room = grid.field()
            self.room.from_numpy(grid.pad(air.room.astype(np.float32)))
        # a solver of the flow lends fields that it does not need meanwhile
        self._start, self.rate = getattr(wind, "scratch", None) or (grid.field(), grid.field())
        self._outflow = double_field()
        self._sides = [tuple(2 if a == d else n for a, n in enumerate(grid.shape)) for d in range(grid.dim)]
        self._build(add_sources, face_value, exchange)

    def _build(self, add_sources: Callable | None, face_value: Callable, exchange: Callable | None) -> None:
        """The formulas of a step, each swept over the cells."""
        q, rest, q0, rate = self.q, self.rest, self._start, self.rate
        per_length = self.per_length
        u, a, nu, dx, dim = self.wind.u, self.wind.open, self.wind.nu, self.grid.dx, self.dim
        area, room, cut = self.wind.area, self.room, self.cut
        diffusivity, viscosity, schmidt = self.diffusivity, self.wind.viscosity, self.schmidt
        eddies = nu is not None

        @ti.func
        def face_flux(I, d: Template):
            """Flux of q through the lower d-face of cell I: convection, and diffusion where it is open."""
            D = ti.Vector.unit(dim, d, ti.i32)
            K = diffusivity
            if ti.static(eddies):
                K += (0.5 * (nu[I] + nu[I - D]) - viscosity) / schmidt
            v = u[d][I]
            gradient = ti.select(a[d][I] > 0.0, (q[I] - q[I - D]) / dx, 0.0)
            flux = v * face_value(q, I, D, v) - K * gradient
            if ti.static(cut):
                flux *= area[d][I]
            return flux

        @ti.func
        def tendency(I, dt, k):
            """Mean of the first stage's (k = 1) and the second's (k = 1/2): Heun's method."""
            total = ti.cast(0.0, ti.f64)
            for d in ti.static(range(dim)):
                total += ti.cast(face_flux(I, d), ti.f64)
                total -= ti.cast(face_flux(I + ti.Vector.unit(dim, d, ti.i32), d), ti.f64)
            net = k * ti.cast(total, ti.f32) * per_length
            if ti.static(cut):
                net /= ti.max(room[I], 1e-3)
            return net + (1.0 - k) * ti.select(k < 1.0, rate[I], 0.0)

        @ti.func
        def remember(I, dt, k):
            return q[I]

        @ti.func
        def advanced(I, dt, k):
            """q, and what it leaves out; in f64, which no compiler takes for what it is rounded to."""
            change = ti.cast(rest[I], ti.f64) + ti.cast(dt, ti.f64) * ti.cast(rate[I], ti.f64)
            exact = ti.cast(q0[I], ti.f64) + change
            rounded = ti.cast(exact, ti.f32)
            left_out = ti.cast(exact - ti.cast(rounded, ti.f64), ti.f32)
            return ti.Vector([rounded, ti.select(k < 1.0, left_out, rest[I])])

        @ti.func
        def fill_ghosts(dt, k):
            self._fill_ghosts()

        @ti.func
        def count_outflow(dt, k):
            self._count_outflow(0.5 * dt)  # Heun's method is the mean of two Euler steps

        self.face_flux = face_flux
        cells, count = self.grid.cells, prod(self.grid.shape)
        self._begin = launch(
            *([add_sources] if add_sources else []), sweep([remember], [q0], cells), cells=count
        )
        self._stage = launch(
            fill_ghosts,
            sweep([tendency], [rate], cells),
            *([exchange] if exchange else []),
            count_outflow,
            sweep([advanced], [(q, rest)], cells),
            cells=count,
        )

    def start_from(self, function: Callable[[np.ndarray], np.ndarray]) -> None:
        """Set q from a function of points (..., dim) [m]."""
        self.q.from_numpy(self.grid.pad(function(self.grid.centers()).astype(np.float32)))
        self.rest.fill(0.0)

    # ---------------------------------------------------------------- the step

    def steps(self, dt: float) -> int:
        """Number of equal steps that make no new extremum within dt [s]: a limited face value is at most twice the
        upwind cell's.
        """
        K = self.diffusivity + (self.wind.max_viscosity - self.wind.viscosity) / self.schmidt
        given = self.wind.outflow_rate + self.dim * K / self.grid.dx**2 + 0.5 * self.exchange_rate
        longest = FULLEST / max(given, 1e-30)
        return max(1, ceil(dt / longest - 1e-9))

    def step(self, dt: float) -> None:
        """One step of Heun's method, no longer than `steps` allows."""
        self._begin(dt)
        self._stage(dt, 1.0)
        self._stage(dt, 0.5)

    @ti.func
    def _fill_ghosts(self):
        """Beyond an outflow q goes on unchanged; air that flows in has its own; periodic axes wrap round."""
        for d in ti.static(range(self.dim)):
            for J in ti.grouped(ti.ndrange(*self._sides[d])):
                g = ti.static(self.grid.ghost)
                n = ti.static(self.grid.shape[d])
                D = ti.Vector.unit(self.dim, d, ti.i32)
                outward = 2 * J[d] - 1
                inner = J + g + D * J[d] * (n - 2)
                for m in ti.static(range(1, g + 1)):
                    if ti.static(self.grid.periodic[d]):
                        self.q[inner + D * outward * m] = self.q[inner - D * outward * (n - m)]
                    else:
                        out = self.wind.u[d][inner + D * J[d]] * outward
                        beyond = 0.0
                        if ti.static(len(self.inflow) > 0):
                            beyond = self.inflow[d][J]
                        self.q[inner + D * outward * m] = ti.select(out >= 0.0, self.q[inner], beyond)

    @ti.func
    def _count_outflow(self, dt: float):
        """Add what leaves through the domain's faces in dt."""
        for d in ti.static([a for a in range(self.dim) if not self.grid.periodic[a]]):
            for J in ti.grouped(ti.ndrange(*self._sides[d])):
                D = ti.Vector.unit(self.dim, d, ti.i32)
                face = J + ti.static(self.grid.ghost) + D * J[d] * (ti.static(self.grid.shape[d]) - 1)
                flux = self.face_flux(face, d) * (2 * J[d] - 1)
                self._outflow[None] += ti.cast(flux, ti.f64) * ti.cast(dt, ti.f64)

    # ---------------------------------------------------------------- what is known about q

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

    @ti.kernel
    def least(self) -> ti.f32:
        """Smallest q."""
        result = 1e30
        for J in ti.grouped(ti.ndrange(*self.grid.shape)):
            ti.atomic_min(result, self.q[J + ti.static(self.grid.ghost)])
        return result

    def inside(self) -> float:
        """q summed over the domain's volume."""
        total: Any = self._sum()
        return total * self.grid.cell_volume

    def outflow(self) -> float:
        """What has left through the domain's faces so far."""
        gone: Any = self._outflow[None]
        return gone * self.grid.cell_volume * self.per_length
