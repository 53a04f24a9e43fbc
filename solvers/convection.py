"""Convection (advection) schemes: limited high-order upwind values of a transported quantity at a cell face.

`koren`: third order, limited so that no new extremum appears; it damps eddies of less than some 16 cells. `upwind5`:
fifth order, limited where the field is not smooth only, for little more work. `weno5`: fifth order, weighted by
smoothness, for about twice the work. Of the energy of vortices that drift with the wind `upwind5` keeps 0.98 (16 cells
across, over four of their sizes) and 0.92 (8 cells, one size), `weno5` 0.94 and 0.78, `koren` 0.60 and 0.40, with
steps as in runs.
"""

from collections.abc import Callable
from typing import NamedTuple

from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template


@ti.func
def lesser(a, b):
    """Return the smaller of two numbers; faster than Taichi's minimum, which checks for NaN."""
    return ti.select(a < b, a, b)


@ti.func
def greater(a, b):
    """Return the larger of two numbers; faster than Taichi's maximum, which checks for NaN."""
    return ti.select(a > b, a, b)


@ti.func
def koren(a, b):
    """Return the limited difference from the upwind cell's value to its face, for slopes a (upwind) and b (downwind).

    Koren 1993, "A robust upwind discretization method for advection, diffusion and source terms".
    """
    third = (2.0 * b + a) * (1.0 / 6.0)
    return greater(0.0, lesser(lesser(a, b), third)) + lesser(0.0, greater(greater(a, b), third))


@ti.func
def koren_value(q: Template, I, e, v):
    """Return q on the lower face of cell I along unit vector e by Koren's scheme; v: velocity along e [m/s]."""
    m2, m1, p0, p1 = q[I - 2 * e], q[I - e], q[I], q[I + e]
    forward = v > 0.0
    center = ti.select(forward, m1, p0)
    upwind = ti.select(forward, m2, p1)
    downwind = ti.select(forward, p0, m1)
    return center + koren(center - upwind, downwind - center)


@ti.func
def weno5_value(q: Template, I, e, v, p2):
    """Return q on the lower face of cell I along e by the fifth-order WENO scheme (weighted essentially
    non-oscillatory); v: velocity along e; p2: q of the second cell after I.

    Jiang & Shu 1996, doi:10.1006/jcph.1996.0130, for cell averages (Shu 1998, doi:10.1007/BFb0096355). Smoothness is
    measured against the squares of the values, so that the weights do not depend on the unit. Differences from the
    upwind cell are exactly zero in a uniform field. Small new extrema can appear.
    """
    m3, m2, m1, p0, p1 = q[I - 3 * e], q[I - 2 * e], q[I - e], q[I], q[I + e]
    forward = v > 0.0
    center = ti.select(forward, m1, p0)
    a2 = ti.select(forward, m3, p2) - center
    a1 = ti.select(forward, m2, p1) - center
    b1 = ti.select(forward, p0, m1) - center
    b2 = ti.select(forward, p1, m2) - center
    curved = 13.0 / 12.0
    rough0 = curved * (a2 - 2.0 * a1) ** 2 + 0.25 * (a2 - 4.0 * a1) ** 2
    rough1 = curved * (a1 + b1) ** 2 + 0.25 * (a1 - b1) ** 2
    rough2 = curved * (b2 - 2.0 * b1) ** 2 + 0.25 * (b2 - 4.0 * b1) ** 2
    size = m3 * m3 + m2 * m2 + m1 * m1 + p0 * p0 + p1 * p1 + p2 * p2 + 1e-30
    w0 = 0.1 / (1e-6 + rough0 / size) ** 2
    w1 = 0.6 / (1e-6 + rough1 / size) ** 2
    w2 = 0.3 / (1e-6 + rough2 / size) ** 2
    change = w0 * (2.0 * a2 - 7.0 * a1) + w1 * (2.0 * b1 - a1) + w2 * (5.0 * b1 - b2)
    return center + change / (6.0 * (w0 + w1 + w2))


@ti.func
def from_upwind(q: Template, I, e, v):
    """Return q of the cell upwind of the lower face of cell I along e, and the differences of two more cells upwind
    (outer cell first) and two downwind. Differences are exactly 0 in a uniform field.
    """
    m3, m2, m1, p0, p1, p2 = q[I - 3 * e], q[I - 2 * e], q[I - e], q[I], q[I + e], q[I + 2 * e]
    forward = v > 0.0
    center = ti.select(forward, m1, p0)
    a2 = ti.select(forward, m3, p2) - center
    a1 = ti.select(forward, m2, p1) - center
    b1 = ti.select(forward, p0, m1) - center
    b2 = ti.select(forward, p1, m2) - center
    return center, a2, a1, b1, b2


@ti.func
def fifth_order(a2, a1, b1, b2):
    """Return the fifth-order face value less the upwind cell's value, from the differences of `from_upwind`."""
    return (2.0 * a2 - 13.0 * a1 + 27.0 * b1 - 3.0 * b2) * (1.0 / 60.0)


@ti.func
def upwind5_flux(q: Template, I, e, half, p2):
    """Return the flux v q on the lower face of cell I along e by the linear fifth-order upwind scheme (Wicker &
    Skamarock 2002, doi:10.1175/1520-0493(2002)130<2088:TSMFEM>2.0.CO;2), limited only where q is not smooth. half: v/2;
    p2: q of the second cell after I.

    Without bounds, short waves grow behind the edges of obstacles. The bounds keep q between the two cells at the face
    and within four times the slope behind the upwind cell. A smooth extremum, with a like curvature in both cells, may
    exceed these bounds as its curvature demands (after Suresh & Huynh 1997, doi:10.1006/jcph.1997.5745).

    b, c, d: differences of neighbours, c across the face; change: twice the difference of the face from the upwind
    cell. Seen from the other side the scheme is the same, so only two differences depend on the wind's direction.
    """
    m1, p0, p1 = q[I - e], q[I], q[I + e]
    b, c, d = m1 - q[I - 2 * e], p0 - m1, p1 - p0
    back = ti.bit_cast(half, ti.i32) < 0  # the sign bit: cheaper than a comparison of numbers
    near = ti.select(back, d, b)
    outer = ti.select(back, p2 - p1, q[I - 2 * e] - q[I - 3 * e])
    change = 0.8 * c + (7.0 / 15.0) * near - (0.1 * (b + d) + (1.0 / 15.0) * outer)
    # curvatures of one sign, neither four times the other, leave room for an extremum
    room = greater(0.0, ti.abs(d - b) - (5.0 / 3.0) * ti.abs((c + c) - (b + d)))
    most = greater(0.0, lesser(c + c, 8.0 * near)) + room
    least = lesser(0.0, greater(c + c, 8.0 * near)) - room
    return half * (m1 + p0) + ti.abs(half) * (greater(least, lesser(most, change)) - c)


@ti.func
def koren_flux(q: Template, I, e, half, p2):
    """Return the flux by `koren_value`; p2 is ignored."""
    return 2.0 * half * koren_value(q, I, e, half)


@ti.func
def weno5_flux(q: Template, I, e, half, p2):
    """Return the flux by `weno5_value`."""
    return 2.0 * half * weno5_value(q, I, e, half, p2)


FLUXES = {"upwind5": upwind5_flux, "koren": koren_flux, "weno5": weno5_flux}
"""ti.func of the field, a cell, a unit vector, half the velocity along it and q of the second cell after the cell."""


STEEPEST = 3.0


class Limited(NamedTuple):
    """Limited (bounded) convection scheme, with which no cell loses more than its content.

    value: ti.func of the field, a cell, a unit vector and the velocity along it, as `koren_value`; steepest: largest
    face value over the value of the upwind cell.
    """

    value: Callable
    steepest: float


@ti.func
def minmod(a, b, c, d):
    """Return the argument nearest to 0 if all have one sign, otherwise 0 (minmod limiter)."""
    least, most = lesser(lesser(a, b), lesser(c, d)), greater(greater(a, b), greater(c, d))
    return greater(least, 0.0) + lesser(most, 0.0)


@ti.func
def fifth_order_value(q: Template, I, e, v):
    """Return q >= 0 on the lower face of cell I along e by a bounded fifth-order scheme; v: velocity along e [m/s]."""
    center, a2, a1, b1, b2 = from_upwind(q, I, e, v)
    change = fifth_order(a2, a1, b1, b2)
    curved, before, beyond = a1 + b1, a2 - 2.0 * a1, b2 - 2.0 * b1
    median = 0.5 * (b1 - minmod(4.0 * curved - beyond, 4.0 * beyond - curved, curved, beyond))
    steep = (1.0 - STEEPEST) * a1
    flat = (4.0 / 3.0) * minmod(4.0 * curved - before, 4.0 * before - curved, curved, before) - 0.5 * a1
    low = greater(lesser(0.0, lesser(b1, median)), lesser(0.0, lesser(steep, flat)))
    high = lesser(greater(0.0, greater(b1, median)), greater(0.0, greater(steep, flat)))
    change = greater(low, lesser(high, change))
    return center + greater(-center, lesser((STEEPEST - 1.0) * center, change))


# Schemes of scalars. The weights of WENO drag a plume of one to two cells that crosses the grid askew, and so does a
# bound of twice the upwind cell's value: 2 to 6 % of its way less than the wind (weights of the smooth case, unlimited,
# move any plume exactly). So the fifth-order value of the smooth case is kept within the bounds of Suresh & Huynh
# (1997, doi:10.1006/jcph.1997.5745), which let smooth extrema be, and as Zhang & Shu (2010,
# doi:10.1016/j.jcp.2009.12.030) do between 0 and what the cell can give: here STEEPEST times its content, as the steps
# of `transport` are short enough.
LIMITED = {"koren": Limited(koren_value, 2.0), "weno5": Limited(fifth_order_value, STEEPEST)}
