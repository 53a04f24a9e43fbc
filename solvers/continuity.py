"""Continuity equation of incompressible flow: divergence of each cell, and the pressure projection that removes it.

    div u = s,   u -= a dphi/dx,   p += dphi dx/dt

s is the volume of gas that sources release, per volume of air and time. It is 0 unless the gas changes the density
(buoyancy). Ideal gases of one temperature and pressure have one molar volume: mixing them takes no space, only sources
do. u is then the molar mean velocity.

phi, a velocity potential in units of dx, solves the Poisson equation (see `poisson`) of the flow's divergence.
"""

from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template


@ti.func
def net_inflow(m: Template, I, dt, k):
    """Return the net inflow into cell I over a face's area [m/s], with the released volume: (s - div u) dx."""
    total = 0.0
    for d in ti.static(range(m.dim)):
        above = I + ti.Vector.unit(m.dim, d, ti.i32)
        if ti.static(m.cut):
            total += m.area[d][I] * m.u[d][I] - m.area[d][above] * m.u[d][above]
        else:
            total += m.u[d][I] - m.u[d][above]
    for n in ti.static(range(len(m.sources))):
        total += m.dx * m.sources[n][I]
    return total


@ti.func
def corrected(m: Template, phi: Template, d: Template, I, dt, k):
    """Return u_d [m/s] at face I minus the gradient of phi, in proportion to the open fraction of the face."""
    return m.u[d][I] - m.open[d][I] * (phi[I] - phi[I - ti.Vector.unit(m.dim, d, ti.i32)])


@ti.func
def increased(m: Template, phi: Template, I, dt, k):
    """Return the pressure p [m²/s²] of cell I after a projection with phi over a time dt [s]."""
    return m.p[I] + (m.dx / dt) * phi[I]
