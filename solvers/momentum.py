"""The terms of the momentum equation on the staggered grid, one function each.

    du_d/dt = sum_e -d(u_e u_d)/dx_e + d(nu (du_d/dx_e + du_e/dx_d))/dx_e - dp/dx_d + b_d + g_d

Face I of axis d is the lower d-face of cell I; the volume around it reaches half a cell to both sides. Where obstacles
cut the grid, what goes through a side of that volume counts with the share of the side that is air.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.convection import FACE_VALUES
from taichi_plume.solvers.turbulence import MODELS


@dataclass
class Weighing:
    """What makes the air heavier: a cell field, and the relative change of the density per unit of it, which the flow
    takes over when it begins.
    """

    field: Any
    weight: float


class Momentum:
    """What the terms read: the fields of the flow (see `FlowSolver`) and the numbers of the scenario.

    viscosity [m²/s]; constant: of the eddy model; force: g dx [m²/s²] per axis; weighing: cell fields that make the air
    rise or sink; pull: acceleration [m/s²] that a unit of each gives; half_pull: pull dx/2.
    """

    def __init__(
        self,
        model: CfdWind,
        grid: Grid,
        u: tuple[Any, ...],
        p: Any,
        nu: Any,
        open: tuple[Any, ...],
        area: tuple[Any, ...] | None,
        weighing: Sequence[Any],
    ):
        self.grid, self.dim, self.dx = grid, grid.dim, grid.dx
        self.u, self.p, self.nu, self.open = u, p, nu, open
        self.area: Any = area
        self.cut = area is not None
        self.eddies = nu is not None
        self.eddy_model = MODELS.get(model.turbulence.kind)
        self.face_value = FACE_VALUES[model.convection]
        self.driven = model.acceleration is not None
        self.weighing = tuple(weighing)
        self.viscosity, self.constant = ti.field(ti.f32, ()), ti.field(ti.f32, ())
        self.force: Any = ti.Vector.field(grid.dim, ti.f32, ())
        count = max(1, len(self.weighing))
        self.pull, self.half_pull = (ti.Vector.field(grid.dim, ti.f32, count) for _ in range(2))
        self._put = uploader(self.viscosity, self.constant, self.force, self.pull, self.half_pull)

    def begin(self, model: CfdWind, pull: np.ndarray) -> None:
        """Take the numbers over; pull: of each weighing field, (count, dim) [m/s²]."""
        constant = 0.0 if model.turbulence.kind == "none" else model.turbulence.constant
        force = np.array(model.acceleration or (0.0,) * self.dim) * self.dx
        pull = pull if len(pull) else np.zeros((1, self.dim))
        self._put(model.viscosity, constant, force, pull, 0.5 * self.dx * pull)


# ---------------------------------------------------------------- through the sides of the volume around a face


@ti.func
def convective_flux(m: Template, I, d: Template, e: Template):
    """u_e u_d [m²/s²] through the lower e-side of the volume around face I of axis d; u_d as `convection` has it."""
    D, E = ti.Vector.unit(m.dim, d, ti.i32), ti.Vector.unit(m.dim, e, ti.i32)
    v = 0.5 * (m.u[e][I] + m.u[e][I - D])
    if ti.static(m.cut):
        v = 0.5 * (m.area[e][I] * m.u[e][I] + m.area[e][I - D] * m.u[e][I - D])
    return v * m.face_value(m.u[d], I, E, v)


@ti.func
def viscosity_at(m: Template, I, d: Template, e: Template):
    """Viscosity nu [m²/s], with that of the eddies, on the lower e-side of the volume around face I of axis d."""
    result = m.viscosity[None]
    if ti.static(m.eddies):
        D, E = ti.Vector.unit(m.dim, d, ti.i32), ti.Vector.unit(m.dim, e, ti.i32)
        if ti.static(d == e):
            result = m.nu[I - D]
        else:
            result = 0.25 * (m.nu[I] + m.nu[I - D] + m.nu[I - E] + m.nu[I - D - E])
    return result


@ti.func
def stress(m: Template, I, d: Template, e: Template):
    """nu (du_d/dx_e + du_e/dx_d) [m²/s²] on the lower e-side of the volume around face I of axis d.

    Of a constant viscosity div u = 0 leaves only the first part.
    """
    D, E = ti.Vector.unit(m.dim, d, ti.i32), ti.Vector.unit(m.dim, e, ti.i32)
    du_dx = (m.u[d][I] - m.u[d][I - E]) / m.dx
    if ti.static(m.eddies):
        du_dx += (m.u[e][I] - m.u[e][I - D]) / m.dx
    if ti.static(m.cut):
        du_dx *= 0.5 * (m.area[e][I] + m.area[e][I - D])
        if ti.static(d != e):  # the middles of what is open of the two faces lie closer than dx
            low, high = m.area[d][I - E], m.area[d][I]
            less, more = ti.min(low, high), ti.max(low, high)
            du_dx *= ti.select(less > 0.0, 2.0 * more / (less + more), 0.0)
    return viscosity_at(m, I, d, e) * du_dx


@ti.func
def inflow(m: Template, I, d: Template):
    """Net flux of u_d [m²/s²] into the volume around face I: convection less stress, of all its sides."""
    total = 0.0
    for e in ti.static(range(m.dim)):
        for side in range(2):  # not unrolled by Taichi: half the compile time; LLVM unrolls it
            J = I + side * ti.Vector.unit(m.dim, e, ti.i32)
            viscous = stress(m, J, d, e)
            total += (1 - 2 * side) * (convective_flux(m, J, d, e) - viscous)
    return total


# ---------------------------------------------------------------- forces on it, times dx [m²/s²]


@ti.func
def pressure_force(m: Template, I, d: Template):
    """-dp/dx_d, p the kinematic pressure."""
    return -(m.p[I] - m.p[I - ti.Vector.unit(m.dim, d, ti.i32)])


@ti.func
def body_force(m: Template, d: Template):
    """g_d, the same on all the air."""
    return m.force[None][d]


@ti.func
def buoyancy(m: Template, I, d: Template, n: Template):
    """b_d of the n-th of the fields that make the air lighter or heavier (Boussinesq)."""
    q = ti.static(m.weighing[n])
    return m.half_pull[n][d] * (q[I] + q[I - ti.Vector.unit(m.dim, d, ti.i32)])


# ---------------------------------------------------------------- all together


@ti.func
def tendency(m: Template, I, d: Template):
    """du_d/dt [m/s²] at face I; 0 where the velocity is not solved for."""
    push = pressure_force(m, I, d)
    if ti.static(m.driven):
        push += body_force(m, d)
    for n in ti.static(range(len(m.weighing))):
        push += buoyancy(m, I, d, n)
    stored = 1.0  # volume in cells
    if ti.static(m.cut):
        stored = m.area[d][I] / ti.max(m.open[d][I], 1e-6)
    result = (m.open[d][I] * push + inflow(m, I, d) / ti.max(stored, 1e-3)) / m.dx
    return ti.select(m.open[d][I] > 0.0, result, 0.0)


@ti.func
def loss(m: Template, I, d: Template):
    """Momentum [m/s² of a whole cell] that flows on to faces that obstacles close."""
    return ti.select(m.open[d][I] > 0.0, 0.0, inflow(m, I, d) / m.dx)


@ti.func
def eddy_viscosity(m: Template, I):
    """nu [m²/s] of cell I."""
    return m.viscosity[None] + m.eddy_model(m.u, I, m.dx, m.constant[None])


def of_axis(term: Callable, m: Momentum, d: int) -> Callable:
    """A term (m, I, d) as the formula of a sweep over the d-faces."""

    @ti.func
    def formula(I, dt, k):
        return term(m, I, d)

    return formula
