"""Terms of the momentum equation (Navier-Stokes, buoyancy by Boussinesq) on the staggered grid, one function each.

    du_d/dt = sum_e -d(u_e u_d)/dx_e + d(nu (du_d/dx_e + du_e/dx_d))/dx_e - dp/dx_d + b_d + g_d

Face I of axis d is the lower d-face of cell I; the volume around it reaches half a cell to both sides. Where obstacles
cut the grid, the flux through a side of that volume is multiplied by the air fraction of the side.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.fields import Faces
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.convection import FLUXES
from taichi_plume.solvers.turbulence import MODELS, mixing_lengths


def _widest(area: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return, per face, the widest passage of its volume, as a fraction of a cell: the volume that stores its momentum.

    A volume with little air thus does not shorten the step; steady flows do not depend on this choice.
    """
    result = []
    for d, faces in enumerate(area):
        widest = faces.copy()
        for e, others in enumerate(area):
            low = 0.5 * (others + np.roll(others, 1, axis=d))
            widest = np.maximum(widest, np.maximum(low, np.roll(low, -1, axis=e)))
        result.append(np.maximum(widest, 1e-6))
    return result


def opennesses(grid: Grid, area: Sequence[np.ndarray], is_free: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the open fraction of faces per axis, padded: area over stored volume, 0 where no velocity is solved for.

    area: air fractions of the faces, padded; is_free: free faces of the domain, see `Boundaries`.
    """
    g, result = grid.ghost, []
    for d, widest in enumerate(_widest(area)):
        faces = area[d] / widest
        if not grid.periodic[d]:
            along = np.moveaxis(faces, d, 0)
            for side, face in enumerate((g, g + grid.shape[d])):
                along[face] = (along[face] > 0.0) * np.take(is_free[d], side, axis=d)
        result.append(faces)
    return result


@dataclass
class BuoyantScalar:
    """Cell field that changes the air's density (buoyancy, Boussinesq). weight: relative change of the density per unit
    of the field; source: cell field of the released volume of the scalar's gas [1/s],
    None if the scalar takes no space.
    """

    field: Field
    weight: float
    source: Field | None = None


class Momentum:
    """Inputs of the momentum equation: the fields of the flow (see `FlowSolver`) and the parameters of the scenario.

    viscosity [m²/s]; constant: of the turbulence model; roughness: k_s of surfaces [m]; force: g dx [m²/s²] per axis;
    weighing: cell fields of buoyancy; weight: relative change of the density per unit of each field; pull: acceleration
    [m/s²] per unit of each field; half_pull: pull dx/2. sources: cell fields of released volume [1/s]. distance, mixing
    [m]: distance of cells from the nearest surface, and the mixing length that depends on the distance.

    Where obstacles cut the grid, volumes in cells and areas in faces: spread[d], the inverse of the volume that stores
    the momentum of a face, 0 where no velocity is solved for; sheared[d][e], see `sheared_areas`.
    """

    def __init__(
        self,
        model: CfdWind,
        grid: Grid,
        u: Faces,
        p: Field,
        nu: Field,
        fractions: Sequence[np.ndarray],
        areas: Sequence[np.ndarray] | None,
        weighing: Sequence[Field],
        weights: Sequence[float],
        sources: Sequence[Field],
        distance: np.ndarray | None,
    ):
        """fractions, areas: of all faces on the padded grid, see `fields.Carrier`; no areas if no face is cut.

        weights: relative change of the density per unit of each weighing field. distance: from the cells to the next
        surface [m], grid.shape; None without a turbulence model.
        """
        self.grid, self.dim, self.dx = grid, grid.dim, grid.dx
        self.u, self.p, self.nu = u, p, nu
        self.open = tuple(grid.filled(values) for values in fractions)
        self.cut = areas is not None
        self.area: Field = None
        self.spread, self.sheared = self.open, ()
        if areas is not None:
            self.area = tuple(grid.filled(area) for area in areas)
            volumes = [
                np.maximum(a, 1e-6) / np.maximum(o, 1e-6) for a, o in zip(areas, fractions, strict=True)
            ]
            self.spread = tuple(
                grid.filled((o > 0.0) / np.maximum(v, 1e-3)) for v, o in zip(volumes, fractions, strict=True)
            )
            self.sheared = tuple(
                tuple(grid.filled(area) if d != e else None for e, area in enumerate(sheared_areas(areas, d)))
                for d in range(self.dim)
            )
        self.eddies = nu is not None
        self.rough = model.roughness is not None
        self.distance = self.mixing = None
        constant = 0.0 if model.turbulence.kind == "none" else model.turbulence.constant
        if distance is not None:
            near = grid.pad(distance)
            grids, surface = mixing_lengths(near, grid.dx, constant)
            smagorinsky = model.turbulence.kind == "smagorinsky"
            self.distance = grid.filled(near)
            self.mixing = grid.filled(np.maximum(grids, surface) if smagorinsky else surface)
        self.eddy_model = MODELS.get(model.turbulence.kind)
        self.face_flux = FLUXES[model.convection]
        self.driven = model.acceleration is not None
        self.weighing, self.sources = tuple(weighing), tuple(sources)
        self.viscosity, self.constant = ti.filled(model.viscosity), ti.filled(constant)
        self.roughness = ti.filled(model.roughness or 0.0)
        self.force = ti.filled_vectors(np.array(model.acceleration or (0.0,) * grid.dim) * grid.dx)
        self.weight = ti.filled(weights)
        gravity = (0.0,) * grid.dim if model.buoyancy is None else model.buoyancy.pull(grid.dim)
        pull = np.outer(weights, gravity)
        self.pull, self.half_pull = ti.filled_vectors(pull), ti.filled_vectors(0.5 * grid.dx * pull)


def sheared_areas(areas: Sequence[np.ndarray], d: int) -> list[np.ndarray]:
    """Return per axis e the area of the lower e-side of the volume around each face of axis d, over the distance across
    which the velocity u_d changes: the middles of the open parts of the two faces of axis d lie closer than dx.
    """
    result = []
    for e, area in enumerate(areas):
        side = 0.5 * (area + np.roll(area, 1, axis=d))
        low, high = np.roll(areas[d], 1, axis=e), areas[d]
        less, more = np.minimum(low, high), np.maximum(low, high)
        result.append(side * np.where(less > 0.0, 2.0 * more / np.maximum(less + more, 1e-6), 0.0))
    return result


# ---------------------------------------------------------------- fluxes through the sides of a face's volume


@ti.func
def convective_flux(m: Template, I, d: Template, e: Template):
    """Return the convective flux u_e u_d [m²/s²] through the lower e-side of the volume around face I of axis d.

    The convection scheme of m returns u_d on the side, times u_e.
    """
    D, E = ti.Vector.unit(m.dim, d, ti.i32), ti.Vector.unit(m.dim, e, ti.i32)
    half = 0.25 * (m.u[e][I] + m.u[e][I - D])
    if ti.static(m.cut):
        half = 0.25 * (m.area[e][I] * m.u[e][I] + m.area[e][I - D] * m.u[e][I - D])
    second = 0.0
    if ti.static(d == e and e > 0):  # beyond the domain's upper face one face less is stored
        second = m.u[d][I + E * ti.min(m.grid.padded[e] - 1 - I[e], 2)]
    else:
        second = m.u[d][I + 2 * E]
    if ti.static(d == e and e == 0):  # along a row a choice of values, as places stay consecutive
        second = ti.select(I[0] + 2 < m.grid.padded[0], second, m.u[d][I + E])
    return m.face_flux(m.u[d], I, E, half, second)


@ti.func
def viscosity_at(m: Template, I, d: Template, e: Template):
    """Return nu [m²/s], eddy viscosity included, on the lower e-side of the volume around face I of axis d."""
    result = m.viscosity[None]
    if ti.static(m.eddies):
        D, E = ti.Vector.unit(m.dim, d, ti.i32), ti.Vector.unit(m.dim, e, ti.i32)
        if ti.static(d == e):
            result = m.nu[I - D]
        else:
            result = 0.25 * ((m.nu[I] + m.nu[I - D]) + (m.nu[I - E] + m.nu[I - D - E]))
    return result


@ti.func
def stress(m: Template, I, d: Template, e: Template):
    """Return the viscous stress nu (du_d/dx_e + du_e/dx_d) [m²/s²] on the lower e-side of the volume around face I.

    I: face of axis d. The second part is left out for a constant viscosity, where it vanishes as div u = 0.
    """
    D, E = ti.Vector.unit(m.dim, d, ti.i32), ti.Vector.unit(m.dim, e, ti.i32)
    du_dx = (m.u[d][I] - m.u[d][I - E]) / m.dx
    if ti.static(m.eddies):
        du_dx += (m.u[e][I] - m.u[e][I - D]) / m.dx
    if ti.static(m.cut):
        if ti.static(d == e):
            du_dx *= 0.5 * (m.area[e][I] + m.area[e][I - D])
        else:
            du_dx *= m.sheared[d][e][I]
    return viscosity_at(m, I, d, e) * du_dx


@ti.func
def flux(m: Template, d: Template, e: Template, I):
    """Return the flux of u_d [m²/s²], convection less stress, through the lower e-side of the volume around face I."""
    viscous = stress(m, I, d, e)
    return convective_flux(m, I, d, e) - viscous


# ---------------------------------------------------------------- forces on a face's volume, times dx [m²/s²]


@ti.func
def pressure_force(m: Template, I, d: Template):
    """Return the pressure gradient term -dp/dx_d at face I, times dx [m²/s²]; p: kinematic pressure."""
    return -(m.p[I] - m.p[I - ti.Vector.unit(m.dim, d, ti.i32)])


@ti.func
def body_force(m: Template, d: Template):
    """Return component d of the body force g that drives all the air, times dx [m²/s²]."""
    return m.force[None][d]


@ti.func
def buoyancy(m: Template, I, d: Template, n: Template):
    """Return component d of the buoyancy at face I by the n-th weighing field (Boussinesq), times dx [m²/s²]."""
    q = ti.static(m.weighing[n])
    return m.half_pull[n][d] * (q[I] + q[I - ti.Vector.unit(m.dim, d, ti.i32)])


@ti.func
def density(m: Template, I):
    """Return the density of the air in cell I over the reference density."""
    result = 1.0
    for n in ti.static(range(len(m.weighing))):
        result += m.weight[n] * m.weighing[n][I]
    return ti.max(result, 0.1)  # linear in the temperature


# ---------------------------------------------------------------- all together


@ti.func
def tendency(m: Template, d: Template, I, net, dt, k):
    """Return du_d/dt [m/s²] at face I, the right side of the momentum equation; 0 where the velocity is prescribed.

    net: sum of `flux` into the volume around the face.
    """
    push = pressure_force(m, I, d)
    if ti.static(m.driven):
        push += body_force(m, d)
    for n in ti.static(range(len(m.weighing))):
        push += buoyancy(m, I, d, n)
    if ti.static(m.cut):
        push *= m.area[d][I]
    return m.spread[d][I] * (push + net) / m.dx


@ti.func
def eddy_viscosity(m: Template, I, dt, k):
    """Return the total viscosity of cell I [m²/s]: molecular viscosity plus eddy viscosity."""
    nu = m.viscosity[None]
    return nu + m.eddy_model(m, I)
