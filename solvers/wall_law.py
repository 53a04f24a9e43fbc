"""The law of the wall: how fast the air is near a surface whose friction it feels, and what that surface passes on.

Reichardt's law (1951, doi:10.1002/zamm.19510310704), valid from the surface through the viscous layer to the outer one:

    u+ = ln(1 + k y+)/k + (B - ln(k)/k) (1 - exp(-y+/11) - y+/11 exp(-y+/3)),   u+ = u/u_tau,   y+ = y u_tau/nu

which is u+ = y+ at the surface and u+ = ln(y+)/k + B far from it. What is known is u at a distance y, so u+ is taken as
a function of u+ y+ = u y/nu: two polynomials of its logarithm, fitted within 0.1 %. Beside rough surfaces u+ is at most
ln(1 + y/z)/k, z = exp(-k B) nu/u_tau + exp(-8.5 k) k_s (Colebrook 1939, doi:10.1680/ijoti.1939.13150), k_s the size of
Nikuradse's sand grains.
"""

from typing import Any

import numpy as np
import taichi as ti
from numpy.polynomial import Polynomial

KAPPA = 0.41
B = 5.2
SMOOTH, ROUGH = float(np.exp(-KAPPA * B)), float(np.exp(-KAPPA * 8.5))  # of nu/u_tau and k_s, lengths z above
INNER = float(B - np.log(KAPPA) / KAPPA)
RESOLVED = 9.0  # u y/nu up to which u+ = y+ counts as exact; y+ is 3 there
MIDDLE = 1200.0  # u y/nu at which the second polynomial takes over
LAST = 1e9  # u y/nu beyond which u+ grows no more


def law_of_the_wall(y_plus: Any) -> Any:
    """u+ of y+."""
    outer = np.log1p(KAPPA * y_plus) / KAPPA
    inner = 1.0 - np.exp(-y_plus / 11.0) - y_plus / 11.0 * np.exp(-y_plus / 3.0)
    return outer + INNER * inner


def _fitted() -> list[list[float]]:
    """u+ as polynomials of ln(u+ y+), below MIDDLE and above: their coefficients, the constant one first."""
    y_plus = np.geomspace(1.0, 1e8, 2000)
    u_plus = law_of_the_wall(y_plus)
    product, parts = u_plus * y_plus, []
    for low, high, degree in ((RESOLVED, MIDDLE, 6), (MIDDLE, LAST, 3)):
        there = (product >= low) & (product <= high)
        x, u = np.log(product[there]), u_plus[there]
        parts.append(Polynomial.fit(x, u, degree, w=1.0 / u).convert().coef.tolist())
    return parts


LOW, HIGH = _fitted()


@ti.func
def velocity_in_wall_units(product):
    """u+ where u+ y+ = u y/nu is `product`."""
    x = ti.log(ti.math.clamp(product, RESOLVED, LAST))
    low, high = 0.0, 0.0
    for c in ti.static(LOW[::-1]):
        low = low * x + c
    for c in ti.static(HIGH[::-1]):
        high = high * x + c
    return ti.select(
        product > MIDDLE, high, ti.select(product > RESOLVED, low, ti.sqrt(ti.max(product, 0.0)))
    )


@ti.func
def friction_velocity(speed, y, viscosity, roughness):
    """u_tau [m/s] of air that moves with `speed` [m/s] along a surface, y [m] from it. roughness: k_s [m]."""
    nu = ti.max(viscosity, 1e-12) + 1e-9 * speed * y
    u_tau = speed / ti.max(velocity_in_wall_units(speed * y / nu), 1e-6)
    if roughness > 0.0:
        rough = u_tau
        for _ in range(4):  # the logarithm makes each error a third of the last one, or less
            z = SMOOTH * nu / ti.max(rough, 1e-9) + ROUGH * roughness
            rough = speed * KAPPA / ti.max(ti.log(1.0 + y / z), KAPPA)
        u_tau = ti.max(u_tau, rough)
    return u_tau


@ti.func
def near_surface(u_tau, y, viscosity, roughness):
    """(nu_w [m²/s], bend) y [m] from a surface of the friction velocity u_tau [m/s].

    u is u_tau² y/nu_w there and goes with y**bend. In the viscous layer nu_w is the viscosity and bend is 1.
    """
    nu = ti.max(viscosity, 1e-12)
    y_plus = y * u_tau / nu
    near, core = ti.exp(-y_plus / 11.0), ti.exp(-y_plus / 3.0)
    u_plus = ti.log(1.0 + KAPPA * y_plus) / KAPPA + INNER * (1.0 - near - y_plus / 11.0 * core)
    slope = 1.0 / (1.0 + KAPPA * y_plus) + INNER * (near / 11.0 - (1.0 - y_plus / 3.0) * core / 11.0)
    bend = y_plus * slope / ti.max(u_plus, 1e-6)
    if y_plus < 3.0:  # where Reichardt's law leaves u+ = y+ by up to 1 % in its own way
        u_plus, bend = y_plus, 1.0
    if roughness > 0.0:
        z = SMOOTH * nu / ti.max(u_tau, 1e-9) + ROUGH * roughness
        rough = ti.max(ti.log(1.0 + y / z) / KAPPA, 1.0)
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
