"""Value of a transported quantity at a cell face: third-order upwind, limited so that no new extremum appears."""

import taichi as ti

from taichi_plume.kernels import Template


@ti.func
def koren(a, b):
    """Limited half-difference from the upwind cell to its face, for slopes a (upwind) and b (downwind).

    Koren 1993, "A robust upwind discretization method for advection, diffusion and source terms".
    """
    sign = ti.select(b > 0.0, 1.0, -1.0)
    a_up, b_up = a * sign, b * sign
    return 0.5 * sign * ti.max(0.0, ti.min(2.0 * a_up, ti.min((2.0 * b_up + a_up) * (1.0 / 3.0), 2.0 * b_up)))


@ti.func
def face_value(q: Template, I, e, v):
    """q on the lower face of cell I along unit vector e, where the air moves with v [m/s] along e."""
    m2, m1, p0, p1 = q[I - 2 * e], q[I - e], q[I], q[I + e]
    forward = v > 0.0
    center = ti.select(forward, m1, p0)
    upwind = ti.select(forward, m2, p1)
    downwind = ti.select(forward, p0, m1)
    return center + koren(center - upwind, downwind - center)
