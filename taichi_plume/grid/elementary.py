"""Logarithm, exponential, sine, cosine and arctangent in f32 without library calls, for vectorised loops.

Taichi's own functions call the C library for each number, three to eight nanoseconds each. Here the argument is reduced
to a small interval, where a polynomial interpolates the function in the Chebyshev points, with an error of about 1e-7.
"""

from collections.abc import Callable
from math import log as log64

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from taichi_plume.engine import ti

LN2 = log64(2.0)
ROOT_OF_HALF = int(np.float32(np.sqrt(0.5)).view(np.int32))  # its bits


def _coefficients(
    function: Callable[[np.ndarray], np.ndarray], low: float, high: float, degree: int
) -> tuple[float, ...]:
    """Return the coefficients of a polynomial that interpolates `function` at the Chebyshev points of [low, high]."""
    fit = Chebyshev.interpolate(function, degree, (low, high))
    return tuple(float(k) for k in fit.convert(kind=Polynomial).coef)


EIGHTH = float(np.tan(np.pi / 8))
EXP = _coefficients(np.exp, -0.5 * LN2, 0.5 * LN2, 5)
ARTANH = _coefficients(lambda z: np.arctanh(np.sqrt(z)) / np.sqrt(z), 0.0, 0.0295, 3)  # artanh(s)/s of s²
COS = _coefficients(lambda z: np.cos(np.sqrt(z)), 0.0, (np.pi / 4) ** 2, 3)  # cos(a) of a²
SIN = _coefficients(lambda z: np.sin(np.sqrt(z)) / np.sqrt(z), 0.0, (np.pi / 4) ** 2, 3)  # sin(a)/a of a²
ARCTAN = _coefficients(lambda z: np.arctan(np.sqrt(z)) / np.sqrt(z), 0.0, EIGHTH**2, 4)  # arctan(r)/r of r²


@ti.func
def _polynomial(k: ti.template(), x):  # type: ignore[valid-type]
    """Return the value at x of the polynomial with coefficients k, the constant first (Horner's rule)."""
    result = ti.cast(k[-1], ti.f32)
    for n in ti.static(range(len(k) - 2, -1, -1)):
        result = result * x + k[n]
    return result


@ti.func
def _nearest(x: ti.f32):
    """Return the integer nearest to x."""
    return ti.cast(x + ti.select(x < 0.0, -0.5, 0.5), ti.i32)


@ti.func
def log(x: ti.f32):
    """Return the natural logarithm of a normal x > 0: e ln 2 + 2 artanh((m - 1)/(m + 1)), x = 2^e m, √½ <= m < √2."""
    bits = ti.bit_cast(x, ti.i32)
    e = (bits - ROOT_OF_HALF) >> 23
    m = ti.bit_cast(bits - (e << 23), ti.f32)
    s = (m - 1.0) / (m + 1.0)
    return LN2 * ti.cast(e, ti.f32) + 2.0 * s * _polynomial(ARTANH, s * s)


@ti.func
def exp(x: ti.f32):
    """Return e^x as 2^k e^r, |r| <= ln(2)/2; x is clipped to ±87, the range of f32."""
    inside = ti.math.clamp(x, -87.0, 87.0)
    k = _nearest(inside * (1.0 / LN2))
    power = ti.bit_cast((k + 127) << 23, ti.f32)
    return power * _polynomial(EXP, inside - LN2 * ti.cast(k, ti.f32))


@ti.func
def cos_sin(angle: ti.f32):
    """Return the vector (cos, sin) of an angle [rad] of a few turns at most."""
    q = _nearest(angle * (2.0 / np.pi))
    a = angle - (0.5 * np.pi) * ti.cast(q, ti.f32)
    c, s = _polynomial(COS, a * a), a * _polynomial(SIN, a * a)
    across = (q & 1) == 1
    x, y = ti.select(across, s, c), ti.select(across, c, s)
    return ti.Vector([ti.select(((q + 1) & 2) == 2, -x, x), ti.select((q & 2) == 2, -y, y)])


@ti.func
def direction(y: ti.f32, x: ti.f32):
    """Return the angle [rad] of the vector (x, y) in [-π, π], as atan2; 0 for the zero vector."""
    across, along = ti.abs(y), ti.abs(x)
    more, less = ti.max(across, along), ti.min(across, along)
    ratio = less / ti.max(more, 1e-30)
    upper = ratio > EIGHTH  # tan(a - π/4) = (tan a - 1)/(tan a + 1)
    part = ti.select(upper, (less - more) / ti.max(less + more, 1e-30), ratio)
    angle = part * _polynomial(ARCTAN, part * part) + ti.select(upper, 0.25 * np.pi, 0.0)
    angle = ti.select(across > along, 0.5 * np.pi - angle, angle)
    angle = ti.select(x < 0.0, np.pi - angle, angle)
    return ti.select(y < 0.0, -angle, angle)


@ti.func
def turned(v, angle):
    """Return the vector v (2,) turned left by `angle` [rad]."""
    e = cos_sin(angle)
    return ti.Vector([e[0] * v[0] - e[1] * v[1], e[1] * v[0] + e[0] * v[1]])


@ti.func
def wrap(angle):
    """Return an angle [rad] wrapped to [-π, π]."""
    return angle - 2.0 * np.pi * ti.round(angle / (2.0 * np.pi))
