"""What can be sampled: the Gas and Wind protocols, multilinear interpolation, and sampling from the host.

Sensors, recorder and scores know gas and wind only through these two protocols, so a grid, puffs, a closed form and
a recording of an earlier run are interchangeable, in 2-D and 3-D.
"""

from typing import Any, Protocol

import numpy as np
import taichi as ti

from taichi_plume.kernels import Template


class Wind(Protocol):
    """Air that moves. Implementations are `ti.data_oriented`."""

    def stable_dt(self, t: float = 0.0) -> float:
        """Longest step [s] that `advance` takes from time t in one go; infinite where there is no limit."""
        ...

    def advance(self, t: float, dt: float) -> None:
        """Step from time t [s] by dt [s]."""
        ...

    def velocity(self, x: Any, t: Any) -> Any:
        """ti.func: velocity [m/s] at point x [m] (both of the domain's dimension) and time t [s]."""
        ...


class Gas(Protocol):
    """Vapour in the air. Implementations are `ti.data_oriented`."""

    ppm_per_density: float
    """ppm per kg/m³ of its species."""

    def advance(self, t: float, dt: float) -> None:
        """Step from time t [s] by dt [s]."""
        ...

    def is_finite(self) -> bool:
        """Whether every concentration is a number."""
        ...

    def concentration(self, x: Any, t: Any) -> Any:
        """ti.func: concentration [kg/m³] at point x [m] and time t [s]."""
        ...


@ti.func
def corner(x: Template, shift: Template, dx: float, ghost: ti.i32, padded: Template):
    """Lower sample index and weight of x per axis; sample I sits at (I - ghost + shift) dx. Kept inside the array."""
    base = ti.Vector.zero(ti.i32, x.n)
    weight = ti.Vector.zero(ti.f32, x.n)
    for d in ti.static(range(x.n)):
        position = ti.math.clamp(x[d] / dx - shift[d] + ghost, 0.0, padded[d] - 1.001)
        base[d] = ti.cast(position, ti.i32)
        weight[d] = position - base[d]
    return base, weight


@ti.func
def corner_weight(weight: Template, offset: Template):
    """Multilinear weight of the sample at base + offset."""
    w = 1.0
    for d in ti.static(range(weight.n)):
        w *= weight[d] if ti.static(offset[d] == 1) else 1.0 - weight[d]
    return w


@ti.func
def between_faces(u: Template, x: Template, dx: float, ghost: ti.i32, padded: Template):
    """Velocity [m/s] at point x [m], linear between the face velocities u of a grid."""
    result = ti.Vector.zero(ti.f32, x.n)
    for c in ti.static(range(x.n)):
        shift = ti.Vector([0.0 if d == c else 0.5 for d in ti.static(range(x.n))])
        base, weight = corner(x, shift, dx, ghost, padded)
        for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * x.n)))):
            result[c] += corner_weight(weight, offset) * u[c][base + offset]
    return result


@ti.kernel
def _concentration_at(
    gas: Template, dim: Template, points: ti.types.ndarray(), t: float, out: ti.types.ndarray()
):
    for n in range(out.shape[0]):
        x = ti.Vector.zero(ti.f32, dim)
        for d in ti.static(range(dim)):
            x[d] = points[n, d]
        out[n] = gas.concentration(x, t)


@ti.kernel
def _velocity_at(
    wind: Template, dim: Template, points: ti.types.ndarray(), t: float, out: ti.types.ndarray()
):
    for n in range(out.shape[0]):
        x = ti.Vector.zero(ti.f32, dim)
        for d in ti.static(range(dim)):
            x[d] = points[n, d]
        u = wind.velocity(x, t)
        for d in ti.static(range(dim)):
            out[n, d] = u[d]


def concentration_at(gas: Gas, points: np.ndarray, t: float) -> np.ndarray:
    """Concentration [kg/m³] at points (..., dim) [m], as an array of shape (...)."""
    flat = np.ascontiguousarray(points.reshape(-1, points.shape[-1]), np.float32)
    out = np.empty(len(flat), np.float32)
    _concentration_at(gas, points.shape[-1], flat, t, out)
    return out.reshape(points.shape[:-1])


def velocity_at(wind: Wind, points: np.ndarray, t: float) -> np.ndarray:
    """Velocity [m/s] at points (..., dim) [m], as an array of the same shape."""
    flat = np.ascontiguousarray(points.reshape(-1, points.shape[-1]), np.float32)
    out = np.empty_like(flat)
    _velocity_at(wind, points.shape[-1], flat, t, out)
    return out.reshape(points.shape)
