"""Law of the wall (wall functions): velocity near a surface, wall friction, and transfer of heat and gas.

Reichardt's law (1951, doi:10.1002/zamm.19510310704), valid from the surface through the viscous layer to the outer one:

    u+ = ln(1 + k y+)/k + (B - ln(k)/k) (1 - exp(-y+/11) - y+/11 exp(-y+/3)),   u+ = u/u_tau,   y+ = y u_tau/nu

which is u+ = y+ at the surface and u+ = ln(y+)/k + B far away. A cell at the surface stores the mean of u from the
surface to 2 y, y the distance of its middle. The mean is (1 - ln 2)/k less than u at y, 5 % at y+ = 50; the friction is
10 % more than if the mean were u at y. As u and y are known but not u_tau, u+ is expressed as a function of u+ y+ = u
y/nu: two polynomials of its logarithm, fitted within 0.1 %. Beside rough surfaces u+ is at most ln(1 + y/z)/k, z =
exp(-k B) nu/u_tau + exp(-8.5 k) k_s (Colebrook 1939, doi:10.1680/ijoti.1939.13150), k_s Nikuradse's sand grain size.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template
from taichi_plume.solvers.convection import greater, lesser

Real = Any
"""A float or an array."""

KAPPA = 0.41
B = 5.2
SMOOTH, ROUGH = float(np.exp(-KAPPA * B)), float(np.exp(-KAPPA * 8.5))  # of nu/u_tau and k_s, lengths z above
INNER = float(B - np.log(KAPPA) / KAPPA)
VISCOUS = 3.0  # y+ up to which u+ = y+ counts as exact, although Reichardt's law deviates by up to 1 %
MIDDLE = 1200.0  # u y/nu at which the second polynomial takes over
LAST = 1e9  # u y/nu beyond which u+ is constant


def law_of_the_wall(y_plus: Real) -> Real:
    """Return u+ at the wall distance y+ by Reichardt's law."""
    outer = np.log1p(KAPPA * y_plus) / KAPPA
    inner = 1.0 - np.exp(-y_plus / 11.0) - y_plus / 11.0 * np.exp(-y_plus / 3.0)
    return outer + INNER * inner


def mean_law(y_plus: Real) -> Real:
    """Return the mean of u+ from the surface to 2 y+."""
    far = 2.0 * y_plus
    outer = ((1.0 + 1.0 / (KAPPA * far)) * np.log1p(KAPPA * far) - 1.0) / KAPPA
    inner = far + 11.0 * np.expm1(-far / 11.0) + (3.0 * (far + 3.0) * np.exp(-far / 3.0) - 9.0) / 11.0
    return outer + INNER * inner / far


def bend_of_law(y_plus: Real) -> Real:
    """Return du+/dy+ at y+, divided by the slope from the surface to the mean of `mean_law`."""
    slope = 1.0 / (1.0 + KAPPA * y_plus) + INNER / 11.0 * (
        np.exp(-y_plus / 11.0) - (1.0 - y_plus / 3.0) * np.exp(-y_plus / 3.0)
    )
    return y_plus * slope / mean_law(y_plus)


RESOLVED = (0.5 * VISCOUS) ** 2  # u y/nu up to which the whole cell is viscous


def _fitted(law: Callable[[Real], Real]) -> tuple[list[float], list[float]]:
    """Return two polynomials of ln(u y/nu), below and above MIDDLE, that fit a function of y+; constant first."""
    y_plus = np.geomspace(0.25 * VISCOUS, 1e8, 3000)
    values, product = law(y_plus), mean_law(y_plus) * y_plus
    parts = []
    for low, high, degree in ((RESOLVED, MIDDLE, 7), (MIDDLE, LAST, 4)):
        there = (product >= low) & (product <= high)
        x, value = np.log(product[there]), values[there]
        parts.append(Polynomial.fit(x, value, degree, w=1.0 / value).convert().coef.tolist())
    return parts[0], parts[1]


LN_MIDDLE = float(np.log(MIDDLE))
U_PLUS, BEND = _fitted(mean_law), _fitted(bend_of_law)
LN2 = float(np.log(2.0))
MANTISSA = np.linspace(1.0, 2.0, 200)
LOGARITHM = Polynomial.fit(MANTISSA, np.log(MANTISSA), 6).convert().coef.tolist()


@ti.func
def logarithm(x):
    """Return ln(x) of a positive normal number within 1e-5; compilers vectorise it, unlike Taichi's logarithm."""
    bits = ti.bit_cast(x, ti.i32)
    mantissa = ti.bit_cast((bits & 0x7FFFFF) | 0x3F800000, ti.f32)
    result = 0.0
    for c in ti.static(LOGARITHM[::-1]):
        result = result * mantissa + c
    return result + LN2 * ti.cast((bits >> 23) - 127, ti.f32)


def y_plus(speed: np.ndarray, y: float, viscosity: float, roughness: float = 0.0) -> np.ndarray:
    """Return y+ at the distance y [m] for air with the mean `speed` (n,) [m/s] along a surface, see `near_surface`."""
    table = np.geomspace(1e-3, 1e8, 4000)
    known = np.log(mean_law(table) * table), np.log(table)
    result = np.exp(np.interp(np.log(speed * y / viscosity), *known))
    if roughness > 0.0:
        u_tau = result * viscosity / y
        for _ in range(8):
            s = 2.0 * y / (SMOOTH * viscosity / u_tau + ROUGH * roughness)
            u_tau = speed / np.maximum(((1.0 + 1.0 / s) * np.log1p(s) - 1.0) / KAPPA, 1.0)
        result = np.maximum(result, u_tau * y / viscosity)
    return result


@ti.func
def _of_fit(x, fit: Template):
    """Return the value of a function fitted by `_fitted` at x = ln(u y/nu)."""
    low, high = 0.0, 0.0
    for c in ti.static(fit[0][::-1]):
        low = low * x + c
    for c in ti.static(fit[1][::-1]):
        high = high * x + c
    return ti.select(x > LN_MIDDLE, high, low)


@ti.func
def near_surface(speed, y, viscosity, roughness, rough: Template):
    """Return (nu_w [m²/s], bend) of air with the mean `speed` [m/s] along a surface, from the surface to 2 y [m].

    The friction is nu_w speed/y [m²/s²], and du/dy in the middle is bend speed/y. In the viscous layer nu_w is the
    viscosity and bend is 1. roughness: k_s [m], used if `rough`.
    """
    nu = ti.max(viscosity, 1e-12) + 1e-9 * speed * y
    product = speed * y / nu
    x = logarithm(greater(lesser(product, LAST), RESOLVED))
    u_plus = _of_fit(x, U_PLUS)
    viscous = product < RESOLVED
    result = ti.select(viscous, viscosity, nu * greater(product / (u_plus * u_plus), 1.0))
    bend = ti.select(viscous, 1.0, lesser(_of_fit(x, BEND), 1.0))
    if ti.static(rough):
        u_tau = speed / u_plus
        for _ in range(4):  # the logarithm reduces the error to a third or less per iteration
            u_tau = speed / rough_law(2.0 * y, _grain(u_tau, nu, roughness))
        drag = u_tau * u_tau * y / ti.max(speed, 1e-9)
        if drag > result:
            z = _grain(u_tau, nu, roughness)
            result, bend = drag, ti.min(y / ((y + z) * KAPPA * rough_law(2.0 * y, z)), 1.0)
    return result, bend


@ti.func
def _grain(u_tau, nu, roughness):
    """Return the length z [m] of the rough law of the wall at the friction velocity u_tau [m/s]."""
    return SMOOTH * nu / ti.max(u_tau, 1e-9) + ROUGH * roughness


@ti.func
def rough_law(far, z):
    """Return the mean of ln(1 + y/z)/k from the surface to the distance `far` [m], at least 1."""
    s = far / z
    return ti.max(((1.0 + 1.0 / s) * ti.log(1.0 + s) - 1.0) / KAPPA, 1.0)


@ti.func
def transfer_velocity(speed, y, viscosity, diffusivity):
    """Return the transfer velocity [m/s] (flux per difference) of heat or gas between a smooth surface and air at a
    distance y [m]: Kader 1981, doi:10.1016/0017-9310(81)90220-9, eq 33; diffusivity/y in the viscous layer.

    speed: see `near_surface` [m/s]. Valid for Schmidt (or Prandtl) numbers viscosity/diffusivity of 0.006 to 40,000;
    the turbulent one is 0.85.
    """
    nu = ti.max(viscosity, 1e-12)
    drag, _ = near_surface(speed, y, viscosity, 0.0, False)
    u_tau = ti.sqrt(drag * speed / y)
    schmidt = nu / ti.max(diffusivity, 1e-12)
    y_plus = ti.max(y * u_tau / nu, 1e-6)
    gamma = 0.01 * (schmidt * y_plus) ** 4 / (1.0 + 5.0 * schmidt**3 * y_plus)
    beta = (3.85 * schmidt ** (1.0 / 3.0) - 1.3) ** 2 + 2.12 * ti.log(schmidt)
    near = schmidt * y_plus * ti.exp(-gamma)
    theta_plus = near + (2.12 * ti.log(1.0 + y_plus) + beta) * ti.exp(-1.0 / ti.max(gamma, 1e-6))
    return ti.max(u_tau, 1e-6 * nu / y) / theta_plus
