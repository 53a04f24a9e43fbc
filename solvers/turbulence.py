"""Viscosity of what the grid does not resolve."""

import taichi as ti

from taichi_plume.grid.kernels import Template
from taichi_plume.solvers.wall_law import KAPPA

# Cells from a surface within which the grid's own eddies carry little of its friction. With it a channel at Re_tau 1000
# of 16 cells is nowhere more than 11 % faster than the log law by weno5, without it 14 %.
LAYER = 1.3


@ti.func
def velocity_gradient(u: Template, I, d: Template, e: Template, dx: float):
    """du_d/dx_e [1/s] at the centre of cell I."""
    D = ti.Vector.unit(ti.static(len(u)), d, ti.i32)
    E = ti.Vector.unit(ti.static(len(u)), e, ti.i32)
    if ti.static(d == e):
        return (u[d][I + D] - u[d][I]) / dx
    else:  # noqa: RET505  Taichi compiles one branch only
        return (u[d][I + E] + u[d][I + E + D] - u[d][I - E] - u[d][I - E + D]) / (4.0 * dx)


@ti.func
def strain_rate(u: Template, I, dx: float):
    """|S| = sqrt(2 S_ij S_ij) [1/s] at the centre of cell I, with S_ij = (du_i/dx_j + du_j/dx_i)/2."""
    total = 0.0
    for d in ti.static(range(len(u))):
        total += 2.0 * velocity_gradient(u, I, d, d, dx) ** 2
        for e in ti.static(range(d + 1, len(u))):
            total += (velocity_gradient(u, I, d, e, dx) + velocity_gradient(u, I, e, d, dx)) ** 2
    return ti.sqrt(total)


@ti.func
def near_surfaces(rate, dx: float, constant: float, distance: float, viscosity: float):
    """(l², l_s²) [m²]: squares of the mixing lengths of what the grid does not resolve, and of all eddies so near to a
    surface that it resolves none of them; for a strain rate [1/s] at a distance [m] from the next surface.

    l = min(C dx, k d) D with van Driest's damping D = 1 - exp(-y+/26) (1956, doi:10.2514/8.3662). y+ is taken with the
    friction that is here, (nu + nu_t) |S| before the damping: near a surface, where D is not 1, it is the surface's.
    l_s = k d D/(1 + (d/LAYER dx)^4) (after the hybrid of Senocak et al. 2007, doi:10.1007/s10546-007-9181-y).
    """
    layer = KAPPA * distance
    whole = layer / (1.0 + (distance / (LAYER * dx)) ** 4)
    length = ti.min(constant * dx, layer)
    undamped = ti.max(length, whole) ** 2 * rate
    y_plus = distance * ti.sqrt((viscosity + undamped) * rate) / ti.max(viscosity, 1e-12)
    x = ti.min(y_plus, 1e4) / 26.0
    damping = 1.0 - 1.0 / (1.0 + x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x / 24.0))))  # no CPU vectorises exp
    return (length * damping) ** 2, (whole * damping) ** 2


@ti.func
def smagorinsky(u: Template, I, dx: float, constant: float, distance: float, viscosity: float):
    """Eddy viscosity [m²/s]: l² |S| (Smagorinsky 1963), near surfaces as `near_surfaces` has it."""
    rate = strain_rate(u, I, dx)
    unresolved, whole = near_surfaces(rate, dx, constant, distance, viscosity)
    return ti.max(unresolved, whole) * rate


@ti.func
def vreman(u: Template, I, dx: float, constant: float, distance: float, viscosity: float):
    """Eddy viscosity that vanishes in laminar shear (Vreman 2004, doi:10.1063/1.1785131, eq 5-8).

    c sqrt(B / (a_ij a_ij)) with a_ij = du_j/dx_i, b_ij = dx² a_mi a_mj and B the second invariant of b. c stands for
    2.5 (C dx)², and beside surfaces for no more than 2.5 (k d)²; there it is at least the l_s² |S| of `near_surfaces`.
    """
    dim = ti.static(len(u))
    a = ti.Matrix.zero(ti.f32, dim, dim)
    for i in ti.static(range(dim)):
        for j in ti.static(range(dim)):
            a[i, j] = velocity_gradient(u, I, j, i, dx)
    b = dx**2 * (a.transpose() @ a)
    squares, invariant, strain = 0.0, 0.0, 0.0
    for i in ti.static(range(dim)):
        for j in ti.static(range(dim)):
            squares += a[i, j] ** 2
            strain += a[i, j] * (a[i, j] + a[j, i])
            if ti.static(i < j):
                invariant += b[i, i] * b[j, j] - b[i, j] ** 2
    rate = ti.sqrt(ti.max(strain, 0.0))
    _, whole = near_surfaces(rate, dx, 0.0, distance, viscosity)
    factor = ti.min(constant, 2.5 * (KAPPA * distance / dx) ** 2)
    eddies = factor * ti.sqrt(ti.max(invariant, 0.0) / ti.max(squares, 1e-12))
    return ti.max(eddies, whole * rate)


MODELS = {"smagorinsky": smagorinsky, "vreman": vreman}
