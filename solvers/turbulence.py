"""Viscosity of what the grid does not resolve."""

import taichi as ti

from taichi_plume.grid.kernels import Template


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
def smagorinsky(u: Template, I, dx: float, constant: float):
    """Eddy viscosity [m²/s]: (C dx)² |S| (Smagorinsky 1963)."""
    return (constant * dx) ** 2 * strain_rate(u, I, dx)


@ti.func
def vreman(u: Template, I, dx: float, constant: float):
    """Eddy viscosity [m²/s] that vanishes in laminar shear (Vreman 2004, doi:10.1063/1.1785131, eq 5-8).

    C sqrt(B / (a_ij a_ij)) with a_ij = du_j/dx_i, b_ij = dx² a_mi a_mj and B the second invariant of b.
    """
    dim = ti.static(len(u))
    a = ti.Matrix.zero(ti.f32, dim, dim)
    for i in ti.static(range(dim)):
        for j in ti.static(range(dim)):
            a[i, j] = velocity_gradient(u, I, j, i, dx)
    b = dx**2 * (a.transpose() @ a)
    squares, invariant = 0.0, 0.0
    for i in ti.static(range(dim)):
        for j in ti.static(range(dim)):
            squares += a[i, j] ** 2
            if ti.static(i < j):
                invariant += b[i, i] * b[j, j] - b[i, j] ** 2
    return constant * ti.sqrt(ti.max(invariant, 0.0) / ti.max(squares, 1e-12))


MODELS = {"smagorinsky": smagorinsky, "vreman": vreman}
