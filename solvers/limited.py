"""Values at cell faces of what the air carries, limited so that no cell gives away more than it holds.

`koren`: third order, makes no new extrema. `weno5`: fifth order, also at the tops of puffs, for about twice the work.
Both see a face from the upwind cell. The weights of WENO drag a plume of one to two cells that crosses the grid askew,
and so does a bound of twice the upwind cell's value: 2 to 6 % of its way less than the wind (weights of the smooth
case, unlimited, move any plume exactly). So the fifth-order value of the smooth case is kept within the bounds of
Suresh & Huynh (1997, doi:10.1006/jcph.1997.5745), which let smooth extrema be, and as Zhang & Shu (2010,
doi:10.1016/j.jcp.2009.12.030) do between 0 and what the cell can give: here STEEPEST times what it holds, as the steps
of `transport` are short enough for that.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import taichi as ti

from taichi_plume.grid.kernels import Template
from taichi_plume.solvers.convection import fifth_order, from_upwind, greater, koren_value, lesser

STEEPEST = 3.0


class Limited(NamedTuple):
    """A limited scheme. value: ti.func of the field, a cell, a unit vector and the velocity along it, as `koren_value`;
    steepest: what it is at most, over the upwind cell.
    """

    value: Callable[..., Any]
    steepest: float


@ti.func
def minmod(a, b, c, d):
    """The one nearest to 0 where all are of one sign, otherwise 0."""
    least, most = lesser(lesser(a, b), lesser(c, d)), greater(greater(a, b), greater(c, d))
    return greater(least, 0.0) + lesser(most, 0.0)


@ti.func
def fifth_order_value(q: Template, I, e, v):
    """q on the lower face of cell I along unit vector e, where the air moves with v [m/s] along e; q is nowhere
    negative.
    """
    center, a2, a1, b1, b2 = from_upwind(q, I, e, v, I + 2 * e)
    change = fifth_order(a2, a1, b1, b2)
    curved, before, beyond = a1 + b1, a2 - 2.0 * a1, b2 - 2.0 * b1
    median = 0.5 * (b1 - minmod(4.0 * curved - beyond, 4.0 * beyond - curved, curved, beyond))
    steep = (1.0 - STEEPEST) * a1
    flat = (4.0 / 3.0) * minmod(4.0 * curved - before, 4.0 * before - curved, curved, before) - 0.5 * a1
    low = greater(lesser(0.0, lesser(b1, median)), lesser(0.0, lesser(steep, flat)))
    high = lesser(greater(0.0, greater(b1, median)), greater(0.0, greater(steep, flat)))
    change = greater(low, lesser(high, change))
    return center + greater(-center, lesser((STEEPEST - 1.0) * center, change))


LIMITED = {"koren": Limited(koren_value, 2.0), "weno5": Limited(fifth_order_value, STEEPEST)}
