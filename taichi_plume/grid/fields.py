"""What can be sampled: the Gas, Wind and Carrier protocols, multilinear interpolation, and sampling from the host.

Sensors, recorder and scores know gas and wind only through these, so a grid, puffs, a closed form and
a recording of an earlier run are interchangeable, in 2-D and 3-D.

Winds and gases inherit their protocol, and with it what they leave at its default.
"""

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
import taichi as ti

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.transfer import uploader

Field = Any
"""Taichi field. Kernels read and write it; Taichi has no type of it that static checks understand."""
Faces = tuple[Field, ...]
"""Face fields of the staggered grid, one per axis."""


class Wind(Protocol):
    """Air that moves. Implementations are `ti.data_oriented`."""

    STATE: ClassVar[tuple[str, ...]] = ()

    def begin(self, model: Any, t: float, seed: int) -> None:
        """Begin a run at time t [s] with the numbers of the scenario's section, of the structure that it was made for
        (see `state`).
        """
        ...

    def stable_dt(self, t: float = 0.0) -> float:
        """Longest step [s] that `advance` takes from time t in one go; infinite where there is no limit."""
        return float("inf")

    def advance(self, t: float, dt: float) -> None:
        """Step from time t [s] by dt [s]."""
        ...

    def velocity(self, x: Any, t: Any) -> Any:
        """ti.func: velocity [m/s] at point x [m] (both of the domain's dimension) and time t [s]."""
        ...

    def diagnostics(self) -> dict[str, float]:
        """Numbers for the result; nothing unless the wind has something to tell."""
        return {}

    def mixing(self) -> dict[str, float]:
        """More of them, how fast the air mixes, that take a moment to measure and change nothing of the run; nothing
        unless the wind is drawn by chance and knows it.
        """
        return {}

    @property
    def carrier(self) -> "Carrier | None":
        """The wind itself, where it has velocities on the faces of the grid; None where it has not."""
        return None


class Carrier(Wind, Protocol):
    """A wind on the grid, as gas and heat are carried by it and as it is filmed.

    All fields are padded (see `Grid`) and belong to the time that `advance` has come to. ti.func: `velocity`.

    The two numbers, viscosity and schmidt, are those of the last `begin`, and of the host: what is carried uploads to
    numbers of its own what its kernels need of them (see `transfer.Numbers`). It therefore begins after its wind. What
    changes from step to step (outflow_rate, max_viscosity) is read by the host before each of its steps.
    """

    grid: Grid
    dim: int

    u: tuple[Any, ...]
    """Velocity [m/s] on the lower d-faces of the cells, one field per axis d; divergence-free, ghost layers filled."""

    open: tuple[Any, ...]
    """Fields like u: how freely pressure moves the air of a face. 1 in the open, less where an obstacle cuts the face,
    0 where nothing diffuses through: on walls, in obstacles, and where a velocity is prescribed."""

    area: tuple[Any, ...] | None = None
    """Fields like u: share of each face that is air, 0 to 1; None where no face is cut."""

    nu: Any = None
    """Cell field: viscosity with that of the eddies [m²/s], at least `viscosity` once the air has moved a step; None
    where there are no eddies, which is fixed at construction."""

    viscosity: float = 0.0
    """Molecular viscosity [m²/s], which is taken off nu to have that of the eddies."""

    schmidt: float = 1.0
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas."""

    max_viscosity: float = 0.0
    """Largest nu [m²/s], `viscosity` where there are no eddies."""

    outflow_rate: float = 0.0
    """Largest flow out of a cell over its volume [1/s]."""

    scratch: tuple[Any, Any] | None = None
    """Two cell fields that the wind lends between its steps, for what is lost when it goes on; None where it has
    none to spare."""

    @property
    def carrier(self) -> "Carrier | None":
        """The wind itself."""
        return self

    @ti.func
    def velocity(self, x: Template, t: float):
        """Velocity [m/s] at point x [m], linear between the faces; the time is the solver's own."""
        return sample_faces(self.u, x, self.grid.dx, self.grid.ghost, self.grid.padded)


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

    STATE: ClassVar[tuple[str, ...]] = ()

    species: Species
    """Of the vapour."""

    finer_than_cells: bool = True
    """Whether points know more of it than `cells`: of all but what is solved for on the grid."""

    details: int = 1
    """How many details there are per cell and axis: pictures of it are so much finer than the grid."""

    def begin(self, model: Any, t: float, seed: int) -> None:
        """Begin a run at time t [s] with the numbers of the scenario's section, of the structure that it was made for
        (see `state`).
        """
        ...

    def advance(self, t: float, dt: float) -> None:
        """Step from time t [s] by dt [s]."""
        ...

    def is_finite(self) -> bool:
        """Whether every concentration is a number; a closed form always is."""
        return True

    def concentration(self, x: Any, t: Any) -> Any:
        """ti.func: concentration [kg/m³] at point x [m] and time t [s]."""
        ...

    def budget(self) -> dict[str, float]:
        """Mass emitted_kg, in_domain_kg and outflow_kg (gone through the domain's faces), and initial_kg where there
        was some at the begin; nothing where it is not kept.
        """
        return {}

    def cells(self, t: float) -> np.ndarray | None:
        """Mean concentration of every cell [kg/m³] at time t [s], of the grid's shape; None where only points know."""
        return None


class GridGas(Gas, Protocol):
    """A gas on the grid. c: padded field of the concentration [kg/m³]; air: padded field, 1 in cells that hold air."""

    finer_than_cells = False
    grid: Grid
    c: Field
    air: Field

    def cells(self, t: float) -> np.ndarray:
        return self.grid.read(self.c)

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at point x [m], linear between the centres of cells that hold air."""
        return sample_cells(self.c, self.air, x, self.grid.dx, self.grid.ghost, self.grid.padded)


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

    STATE = ("gases",)

    def __init__(self, gases: Sequence[Gas]):
        self.gases = tuple(gases)
        self.species = tuple(dict.fromkeys(gas.species for gas in gases))
        self._which = tuple(self.species.index(gas.species) for gas in gases)
        self._ppm_per_density = ti.field(ti.f32, max(1, len(gases)))
        self._set = uploader(self._ppm_per_density)
        self.begin()

    def begin(self) -> None:
        """Take the species of the gases, which have begun. Raises ValueError where others than before are of one."""
        species = tuple(dict.fromkeys(gas.species for gas in self.gases))
        if self._which != tuple(species.index(gas.species) for gas in self.gases):
            raise ValueError("other gases than before are of one species")
        self.species = species
        self._set(np.array([gas.species.ppm_per_density for gas in self.gases] or [0.0]))

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
        for g in ti.static(range(len(self.gases))):
            result[self._which[g]] += self.gases[g].concentration(x, t) * self._ppm_per_density[g]
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
