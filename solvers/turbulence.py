"""Turbulence models (large-eddy simulation): eddy viscosity of unresolved scales by Smagorinsky or Vreman."""

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template
from taichi_plume.solvers.convection import greater, lesser
from taichi_plume.solvers.wall_law import KAPPA

# Cells from a surface within which the grid's own eddies carry little of its friction. With it a channel at Re_tau 1000
# of 16 cells is nowhere more than 11 % faster than the log law by weno5, without it 14 %.
LAYER = 1.3


@ti.func
def velocity_gradient(u: Template, I, d: Template, e: Template, dx: float):
    """Return the velocity gradient du_d/dx_e [1/s] at the centre of cell I."""
    D = ti.Vector.unit(ti.static(len(u)), d, ti.i32)
    E = ti.Vector.unit(ti.static(len(u)), e, ti.i32)
    if ti.static(d == e):
        return (u[d][I + D] - u[d][I]) / dx
    else:  # noqa: RET505  Taichi compiles one branch only
        return (u[d][I + E] + u[d][I + E + D] - u[d][I - E] - u[d][I - E + D]) / (4.0 * dx)


@ti.func
def strain_rate(u: Template, I, dx: float):
    """Return the strain rate |S| = sqrt(2 S_ij S_ij) [1/s] in cell I, with S_ij = (du_i/dx_j + du_j/dx_i)/2."""
    total = 0.0
    for d in ti.static(range(len(u))):
        total += 2.0 * velocity_gradient(u, I, d, d, dx) ** 2
        for e in ti.static(range(d + 1, len(u))):
            total += (velocity_gradient(u, I, d, e, dx) + velocity_gradient(u, I, e, d, dx)) ** 2
    return ti.sqrt(total)


def mixing_lengths(distance: np.ndarray, dx: float, constant: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the mixing lengths l and l_s [m] for `damped` at these distances [m] from the nearest surface.

    l = min(C dx, k d): unresolved eddies; l_s = k d/(1 + (d/LAYER dx)^4): all eddies, so near to a surface that the
    grid resolves none (after the hybrid model of Senocak et al. 2007, doi:10.1007/s10546-007-9181-y).
    """
    layer = KAPPA * distance
    return np.minimum(constant * dx, layer), layer / (1.0 + (distance / (LAYER * dx)) ** 4)


@ti.func
def damped(length, rate, distance, viscosity):
    """Return (length D)² rate [m²/s], with van Driest's damping D = 1 - exp(-y+/26) (1956, doi:10.2514/8.3662).

    length: mixing length [m]; rate: strain rate [1/s]. y+ uses the local friction, (nu + nu_t) |S| before the damping.
    Near a surface, where D is not 1, this is the friction at the surface.
    """
    undamped = length * length * rate
    y_plus = distance * ti.sqrt((viscosity + undamped) * rate) / greater(viscosity, 1e-12)
    x = lesser(y_plus, 1e4) * (1.0 / 26.0)
    exponential = 1.0 + x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0))))  # no CPU vectorises exp
    damping = 1.0 - 1.0 / exponential
    return undamped * damping * damping


@ti.func
def smagorinsky(m: Template, I):
    """Return the eddy viscosity of cell I [m²/s], l² |S| (Smagorinsky 1963), near surfaces l_s² |S| if larger."""
    return damped(m.mixing[I], strain_rate(m.u, I, m.dx), m.distance[I], m.viscosity[None])


@ti.func
def vreman(m: Template, I):
    """Return the eddy viscosity of cell I [m²/s], 0 in laminar shear (Vreman 2004, doi:10.1063/1.1785131, eq 5-8).

    c sqrt(B / (a_ij a_ij)) with a_ij = du_j/dx_i, b_ij = dx² a_mi a_mj and B the second invariant of b. c is 2.5 (C
    dx)², beside surfaces at most 2.5 (k d)²; there the viscosity is at least l_s² |S|, damped.
    """
    dim = ti.static(len(m.u))
    a = ti.Matrix.zero(ti.f32, dim, dim)
    for i in ti.static(range(dim)):
        for j in ti.static(range(dim)):
            a[i, j] = velocity_gradient(m.u, I, j, i, m.dx)
    b = m.dx**2 * (a.transpose() @ a)
    squares, invariant, strain = 0.0, 0.0, 0.0
    for i in ti.static(range(dim)):
        for j in ti.static(range(dim)):
            squares += a[i, j] ** 2
            strain += a[i, j] * (a[i, j] + a[j, i])
            if ti.static(i < j):
                invariant += b[i, i] * b[j, j] - b[i, j] ** 2
    factor = lesser(m.constant[None], 2.5 * (KAPPA * m.distance[I] / m.dx) ** 2)
    eddies = factor * ti.sqrt(greater(invariant, 0.0) / greater(squares, 1e-12))
    rate = ti.sqrt(greater(strain, 0.0))
    return greater(eddies, damped(m.mixing[I], rate, m.distance[I], m.viscosity[None]))


MODELS = {"smagorinsky": smagorinsky, "vreman": vreman}
