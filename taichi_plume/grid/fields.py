"""What can be sampled: the Gas and Wind protocols, multilinear interpolation, and sampling from the host.

Sensors, recorder and scores know gas and wind only through these, so a grid, puffs, a closed form and
a recording of an earlier run are interchangeable, in 2-D and 3-D.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import taichi as ti

from taichi_plume.grid.kernels import Template


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


class Species(Protocol):
    """A vapour; two are the same where they are equal."""

    @property
    def name(self) -> str:
        """As written in scenarios."""
        ...

    @property
    def ppm_per_density(self) -> float:
        """ppm per kg/m³."""
        ...


class Gas(Protocol):
    """Vapour of one species in the air. Implementations are `ti.data_oriented`."""

    @property
    def species(self) -> Species:
        """Of the vapour."""
        ...

    def advance(self, t: float, dt: float) -> None:
        """Step from time t [s] by dt [s]."""
        ...

    def is_finite(self) -> bool:
        """Whether every concentration is a number."""
        ...

    def concentration(self, x: Any, t: Any) -> Any:
        """ti.func: concentration [kg/m³] at point x [m] and time t [s]."""
        ...


class Odour(Protocol):
    """What a gas sensor smells."""

    @property
    def species(self) -> tuple[Species, ...]:
        """Those of the numbers that `ppm` gives."""
        ...

    def ppm(self, x: Any, t: Any) -> Any:
        """ti.func: mole fraction [ppm] of each species, a vector, at point x [m] and time t [s]."""
        ...


@ti.data_oriented
class Mixture:
    """All the gas of a run, an `Odour`: one or several gases, of which those of one species add up."""

    def __init__(self, gases: Sequence[Gas]):
        self.gases = tuple(gases)
        self.species = tuple(dict.fromkeys(gas.species for gas in gases))

    def advance(self, t: float, dt: float) -> None:
        """Step all gases from time t [s] by dt [s]."""
        for gas in self.gases:
            gas.advance(t, dt)

    def is_finite(self) -> bool:
        """Whether every concentration is a number."""
        return all(gas.is_finite() for gas in self.gases)

    @ti.func
    def ppm(self, x: Template, t: float):
        """Mole fraction [ppm] of each species at point x [m] and time t [s]."""
        result = ti.Vector.zero(ti.f32, ti.static(len(self.species)))
        for gas in ti.static(self.gases):
            s = ti.static(self.species.index(gas.species))
            result[s] += gas.concentration(x, t) * ti.static(gas.species.ppm_per_density)
        return result


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
def sample_faces(u: Template, x: Template, dx: float, ghost: ti.i32, padded: Template):
    """Vector at point x [m] of a staggered grid's face fields u, one per axis, linear between the faces."""
    result = ti.Vector.zero(ti.f32, x.n)
    for c in ti.static(range(x.n)):
        shift = ti.Vector([0.0 if d == c else 0.5 for d in ti.static(range(x.n))])
        base, weight = corner(x, shift, dx, ghost, padded)
        for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * x.n)))):
            result[c] += corner_weight(weight, offset) * u[c][base + offset]
    return result


@ti.func
def sample_cells(c: Template, air: Template, x: Template, dx: float, ghost: ti.i32, padded: Template):
    """Value of the cell field c at point x [m], linear between the centres of cells where air is 1."""
    shift = ti.Vector([0.5] * x.n)
    base, weight = corner(x, shift, dx, ghost, padded)
    total, share = 0.0, 0.0
    for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * x.n)))):
        w = corner_weight(weight, offset) * air[base + offset]
        total += w * c[base + offset]
        share += w
    return total / ti.max(share, 1e-6)


@ti.func
def _point(points: Template, n, dim: Template):
    """Row n as a vector."""
    return ti.Vector([points[n, d] for d in ti.static(range(dim))])


@ti.kernel
def _concentration_at(
    gas: Template, dim: Template, points: ti.types.ndarray(), t: float, out: ti.types.ndarray()
):
    for n in range(out.shape[0]):
        out[n] = gas.concentration(_point(points, n, dim), t)


@ti.kernel
def _velocity_at(
    wind: Template, dim: Template, points: ti.types.ndarray(), t: float, out: ti.types.ndarray()
):
    for n in range(out.shape[0]):
        u = wind.velocity(_point(points, n, dim), t)
        for d in ti.static(range(dim)):
            out[n, d] = u[d]


@ti.kernel
def _ppm_at(gas: Template, dim: Template, points: ti.types.ndarray(), t: float, out: ti.types.ndarray()):
    for n in range(out.shape[0]):
        ppm = gas.ppm(_point(points, n, dim), t)
        for s in ti.static(range(len(gas.species))):
            out[n, s] = ppm[s]


def ppm_at(gas: Mixture, points: np.ndarray, t: float) -> np.ndarray:
    """Mole fraction [ppm] of each species at points (..., dim) [m], as an array of shape (..., species)."""
    flat = np.ascontiguousarray(points.reshape(-1, points.shape[-1]), np.float32)
    out = np.empty((len(flat), len(gas.species)), np.float32)
    _ppm_at(gas, points.shape[-1], flat, t, out)
    return out.reshape(*points.shape[:-1], -1)


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
