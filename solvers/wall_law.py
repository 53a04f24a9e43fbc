"""The law of the wall: how fast the air is near a surface whose friction it feels, and what that surface passes on.

Reichardt's law (1951, doi:10.1002/zamm.19510310704), valid from the surface through the viscous layer to the outer one:

    u+ = ln(1 + k y+)/k + (B - ln(k)/k) (1 - exp(-y+/11) - y+/11 exp(-y+/3)),   u+ = u/u_tau,   y+ = y u_tau/nu

which is u+ = y+ at the surface and u+ = ln(y+)/k + B far from it. A cell at the surface knows the mean of u from there
to 2 y, y its middle's distance: by (1 - ln 2)/k less than u there, 5 % where y+ is 50; the friction is 10 % more than
if that were u at y. What is known is u at a distance y, so u+ is taken as a function of u+ y+ = u y/nu: two polynomials
of its logarithm, fitted within 0.3 %. Beside rough surfaces u+ is at most ln(1 + y/z)/k, z = exp(-k B) nu/u_tau +
exp(-8.5 k) k_s (Colebrook 1939, doi:10.1680/ijoti.1939.13150), k_s the size of Nikuradse's sand grains.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti
from numpy.polynomial import Polynomial

from taichi_plume.grid.kernels import Template

KAPPA = 0.41
B = 5.2
SMOOTH, ROUGH = float(np.exp(-KAPPA * B)), float(np.exp(-KAPPA * 8.5))  # of nu/u_tau and k_s, lengths z above
INNER = float(B - np.log(KAPPA) / KAPPA)
VISCOUS = 3.0  # y+ up to which u+ = y+ counts as exact: Reichardt's law leaves it by up to 1 % in its own way
MIDDLE = 1200.0  # u y/nu at which the second polynomial takes over
LAST = 1e9  # u y/nu beyond which u+ grows no more


def law_of_the_wall(y_plus: Any) -> Any:
    """u+ of y+."""
    outer = np.log1p(KAPPA * y_plus) / KAPPA
    inner = 1.0 - np.exp(-y_plus / 11.0) - y_plus / 11.0 * np.exp(-y_plus / 3.0)
    return outer + INNER * inner


def mean_law(y_plus: Any) -> Any:
    """Mean of u+ from the surface to 2 y+."""
    far = 2.0 * y_plus
    outer = ((1.0 + 1.0 / (KAPPA * far)) * np.log1p(KAPPA * far) - 1.0) / KAPPA
    inner = far + 11.0 * np.expm1(-far / 11.0) + (3.0 * (far + 3.0) * np.exp(-far / 3.0) - 9.0) / 11.0
    return outer + INNER * inner / far


def _fitted(law: Callable[[Any], Any], viscous: float) -> tuple[float, list[float], list[float]]:
    """u+ y+ up to which u+ = y+, then u+ as polynomials of ln(u+ y+), below MIDDLE and above: their coefficients, the
    constant one first. viscous: y+ where they begin.
    """
    y_plus = np.geomspace(0.5 * viscous, 1e8, 3000)
    u_plus = law(y_plus)
    product, parts = u_plus * y_plus, []
    for low, high, degree in ((viscous**2, MIDDLE, 6), (MIDDLE, LAST, 3)):
        there = (product >= low) & (product <= high)
        x, u = np.log(product[there]), u_plus[there]
        parts.append(Polynomial.fit(x, u, degree, w=1.0 / u).convert().coef.tolist())
    return viscous**2, *parts


THERE = _fitted(law_of_the_wall, VISCOUS)
MEAN = _fitted(mean_law, 0.5 * VISCOUS)


@ti.func
def velocity_in_wall_units(product, fit: Template):
    """u+ where u+ y+ = u y/nu is `product`; fit: THERE or MEAN."""
    resolved, low_part, high_part = ti.static(fit[0], fit[1], fit[2])
    x = ti.log(ti.math.clamp(product, resolved, LAST))
    low, high = 0.0, 0.0
    for c in ti.static(low_part[::-1]):
        low = low * x + c
    for c in ti.static(high_part[::-1]):
        high = high * x + c
    return ti.select(
        product > MIDDLE, high, ti.select(product > resolved, low, ti.sqrt(ti.max(product, 0.0)))
    )


@ti.func
def rough_law(far, z):
    """Mean of ln(1 + y/z)/k from the surface to `far` [m], at least 1."""
    s = far / z
    return ti.max(((1.0 + 1.0 / s) * ti.log(1.0 + s) - 1.0) / KAPPA, 1.0)


@ti.func
def friction_velocity(speed, y, viscosity, roughness, at_surface: Template):
    """u_tau [m/s] of air that moves with `speed` [m/s] along a surface, y [m] from it. roughness: k_s [m]; at_surface:
    whether `speed` is the mean from the surface to 2 y, else that at y.
    """
    nu = ti.max(viscosity, 1e-12) + 1e-9 * speed * y
    u_tau = speed / ti.max(
        velocity_in_wall_units(speed * y / nu, MEAN if ti.static(at_surface) else THERE), 1e-6
    )
    if roughness > 0.0:
        rough = u_tau
        for _ in range(4):  # the logarithm makes each error a third of the last one, or less
            z = SMOOTH * nu / ti.max(rough, 1e-9) + ROUGH * roughness
            if ti.static(at_surface):
                rough = speed / rough_law(2.0 * y, z)
            else:
                rough = speed * KAPPA / ti.max(ti.log(1.0 + y / z), KAPPA)
        u_tau = ti.max(u_tau, rough)
    return u_tau


@ti.func
def near_surface(u_tau, y, viscosity, roughness):
    """(nu_w [m²/s], bend) of the cell at a surface of the friction velocity u_tau [m/s], its middle y [m] away.

    Its mean u is u_tau² y/nu_w, and du/dy in its middle is bend u/y. In the viscous layer nu_w is the viscosity and
    bend is 1.
    """
    nu = ti.max(viscosity, 1e-12)
    y_plus = y * u_tau / nu
    near, core = (
        ti.exp(-y_plus / 11.0),
        ti.exp(-y_plus / 3.0),
    )  # of the middle; their squares are of the far side
    slope = 1.0 / (1.0 + KAPPA * y_plus) + INNER * (near / 11.0 - (1.0 - y_plus / 3.0) * core / 11.0)
    far = ti.max(2.0 * y_plus, 1e-3)
    outer = ((1.0 + 1.0 / (KAPPA * far)) * ti.log(1.0 + KAPPA * far) - 1.0) / KAPPA
    inner = far + 11.0 * (near**2 - 1.0) + (3.0 * (far + 3.0) * core**2 - 9.0) / 11.0
    u_plus = outer + INNER * inner / far
    bend = y_plus * slope / ti.max(u_plus, 1e-6)
    if far < VISCOUS:
        u_plus, bend = y_plus, 1.0
    if roughness > 0.0:
        z = SMOOTH * nu / ti.max(u_tau, 1e-9) + ROUGH * roughness
        rough = rough_law(2.0 * y, z)
        if rough < u_plus:
            u_plus, bend = rough, y / ((y + z) * KAPPA * rough)
    return ti.select(u_plus < y_plus, u_tau * y / ti.max(u_plus, 1e-6), nu), ti.min(bend, 1.0)


@ti.func
def transfer_velocity(u_tau, y, viscosity, diffusivity):
    """Flux per difference [m/s] of a scalar, such as heat or a gas, between a smooth surface and the air at a distance
    y [m] from it: Kader 1981, doi:10.1016/0017-9310(81)90220-9, eq 33; diffusivity/y in the viscous layer.

    u_tau: friction velocity [m/s]. Valid for Schmidt (or Prandtl) numbers viscosity/diffusivity of 0.006 to 40,000; the
    turbulent one is 0.85.
    """
    nu = ti.max(viscosity, 1e-12)
    schmidt = nu / ti.max(diffusivity, 1e-12)
    y_plus = ti.max(y * u_tau / nu, 1e-6)
    gamma = 0.01 * (schmidt * y_plus) ** 4 / (1.0 + 5.0 * schmidt**3 * y_plus)
    beta = (3.85 * schmidt ** (1.0 / 3.0) - 1.3) ** 2 + 2.12 * ti.log(schmidt)
    near = schmidt * y_plus * ti.exp(-gamma)
    theta_plus = near + (2.12 * ti.log(1.0 + y_plus) + beta) * ti.exp(-1.0 / ti.max(gamma, 1e-6))
    return ti.max(u_tau, 1e-6 * nu / y) / theta_plus
