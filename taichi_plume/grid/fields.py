"""Protocols of Gas, Wind and Carrier (gridded wind), multilinear interpolation, and sampling from the host.

Sensors, recorder and scores access gas and wind only through these protocols. A grid, puffs, a closed form and a
recording of an earlier run are thus interchangeable, in 2-D and 3-D. Winds and gases inherit their protocol's defaults.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Expression, Template

Faces = tuple[Field, ...]
"""Face fields of the staggered grid, one per axis."""


class Wind(Protocol):
    """Protocol of winds (moving air).

    p: cell field of the pressure over the density [m²/s²]; heat: temperature of the air, see `HeatSolver`. None if not
    computed.
    """

    STATE: ClassVar[tuple[str, ...]] = ()
    p: Any = None
    heat: Any = None

    def stable_dt(self, t: float = 0.0) -> float:
        """Return the longest stable step [s] of `advance` from time t, by the Courant number (CFL); else infinite."""
        return float("inf")

    def advance(self, t: float, dt: float) -> None:
        """Advance the wind from time t to t + dt [s]."""
        ...

    def velocity(self, x: Expression, t: Expression) -> Expression:
        """ti.func: return the velocity (dim,) [m/s] of the air at point x (dim,) [m] and time t [s]."""
        ...

    @ti.func
    def solenoidal_velocity(self, x: Template, t: float):
        """Return the velocity [m/s] at point x [m] in the domain, divergence-free also between the faces of a grid."""
        return self.velocity(x, t)

    def diagnostics(self) -> dict[str, float]:
        """Return diagnostic numbers by name, such as divergence, for the result of the run."""
        return {}

    def mixing(self) -> dict[str, float]:
        """Return the eddy diffusivity of a random wind by name, measured without effect on the run; else nothing."""
        return {}

    @property
    def carrier(self) -> "Carrier | None":
        """The wind itself if it has velocities on the faces of the grid, else None."""
        return None


class Carrier(Wind, Protocol):
    """Gridded wind as seen by scalar transport (gas, heat) and by the film writer.

    All fields are padded (see `Grid`) and belong to the time that `advance` has reached; nu is that of the last step,
    from its start. ti.func: `velocity`.

    A transported scalar reads the two numbers, viscosity and schmidt, in its constructor. The host reads outflow_rate
    and max_viscosity, which change from step to step, before each step of a scalar.
    """

    grid: Grid
    dim: int

    u: tuple[Field, ...]
    """Velocity [m/s] on the lower d-faces of the cells, one field per axis d; divergence-free, ghost layers filled."""

    open: tuple[Field, ...]
    """Fields like u: open fraction of each face. 1 in the open, less where an obstacle cuts the face, 0 without
    diffusion: on walls, in obstacles, and where a velocity is prescribed (Dirichlet)."""

    area: tuple[Field, ...] | None = None
    """Fields like u: area fraction of each face that is air, 0 to 1; None if no face is cut."""

    nu: Any = None
    """Cell field: molecular and eddy viscosity [m²/s], at least `viscosity` after the first step; None without a
    turbulence model, which is fixed at construction."""

    viscosity: float = 0.0
    """Molecular viscosity [m²/s]; nu less this is the eddy viscosity."""

    schmidt: float = 1.0
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas."""

    max_viscosity: float = 0.0
    """Largest nu [m²/s], `viscosity` without eddies."""

    outflow_rate: float = 0.0
    """Largest flow out of a cell over its volume [1/s]."""

    scratch: tuple[Field, Field] | None = None
    """Two cell fields free for other solvers between steps of the wind, which may overwrite them in a step; or None."""

    @property
    def carrier(self) -> "Carrier | None":
        """The wind itself, as it has velocities on the faces of the grid."""
        return self

    @ti.func
    def velocity(self, x: Template, t: float):
        """Return the velocity [m/s] at point x [m], linear between the faces, at the solver's present time."""
        return sample_faces(self.u, x, self.grid.dx, self.grid.ghost, self.grid.padded)

    @ti.func
    def solenoidal_velocity(self, x: Template, t: float):
        return sample_solenoidal(self.u, x, self.grid.dx, self.grid.ghost, self.grid.padded)


class Species(Protocol):
    """Protocol of a vapour; equal vapours are the same species."""

    @property
    def name(self) -> str:
        """Name of the vapour, as written in scenarios."""
        ...

    @property
    def ppm_per_density(self) -> float:
        """Conversion factor from concentration to mole fraction [ppm per kg/m³]."""
        ...


class Gas(Protocol):
    """Protocol of gases: vapour of a species in the air."""

    STATE: ClassVar[tuple[str, ...]] = ()

    species: Species

    finer_than_cells: bool = True
    """Whether `concentration` resolves more than `cells`: True for all gases but those solved for on the grid."""

    details: int = 1
    """Pixels per cell and axis in pictures of the gas."""

    def advance(self, t: float, dt: float) -> None:
        """Advance the gas from time t to t + dt [s]."""
        ...

    def is_finite(self) -> bool:
        """Return whether every concentration is finite; always True for closed forms."""
        return True

    def concentration(self, x: Expression, t: Expression) -> Expression:
        """ti.func: return the concentration [kg/m³] at point x [m] and time t [s]."""
        ...

    def budget(self) -> dict[str, float]:
        """Return the mass balance [kg] by name: emitted_kg, in_domain_kg, outflow_kg (lost through the domain's faces)
        and, if the run started with gas, initial_kg; empty if the gas has no balance.
        """
        return {}

    def cells(self, t: float) -> np.ndarray | None:
        """Return the mean concentration of every cell [kg/m³] at time t [s]; None if known at points only."""
        return None


class GridGas(Gas, Protocol):
    """Gas on the grid. c: padded field of the concentration [kg/m³]; air: padded field, 1 in cells that hold air."""

    finer_than_cells = False
    grid: Grid
    c: Field
    air: Field

    def cells(self, t: float) -> np.ndarray:
        return self.grid.read(self.c)

    @ti.func
    def concentration(self, x: Template, t: float):
        """Return the concentration [kg/m³] at point x [m], linear between the centres of cells that hold air."""
        return sample_cells(self.c, self.air, x, self.grid.dx, self.grid.ghost, self.grid.padded)


class Odour(Protocol):
    """Protocol of a mixture of gases as measured by gas sensors."""

    @property
    def species(self) -> tuple[Species, ...]:
        """Species of the components of `ppm`, in order."""
        ...

    def ppm(self, x: Expression, t: Expression) -> Expression:
        """ti.func: return the mole fraction [ppm] of each species, as a vector, at point x [m] and time t [s]."""
        ...


class Mixture:
    """All gases of a run together, an `Odour`; gases of the same species add up. unresolved: see `solvers.unresolved`,
    for each gas, None for those without. background: uniform concentration of species in clean air [ppm], by name,
    which adds to the gases.
    """

    STATE = ("gases",)

    def __init__(
        self,
        gases: Sequence[Gas],
        unresolved: Sequence[Any] = (),
        background: Mapping[str, float] | None = None,
    ):
        self.gases, self.unresolved = tuple(gases), tuple(unresolved) or (None,) * len(gases)
        self._stirred = tuple(g for g, each in enumerate(self.unresolved) if each is not None)
        self.fluctuates = bool(self._stirred)
        self.species = tuple(dict.fromkeys(gas.species for gas in gases))
        self._which = tuple(self.species.index(gas.species) for gas in gases)
        self._ppm_per_density = ti.filled([gas.species.ppm_per_density for gas in gases])
        self.background = tuple((background or {}).get(species.name, 0.0) for species in self.species)
        self.has_background = any(self.background)
        if self.has_background:
            self._background = ti.filled(self.background, ti.f32)

    def advance(self, t: float, dt: float) -> None:
        """Advance all gases from time t to t + dt [s]."""
        for gas in self.gases:
            gas.advance(t, dt)

    def is_finite(self) -> bool:
        """Return whether every concentration of every gas is finite."""
        return all(gas.is_finite() for gas in self.gases)

    @ti.func
    def ppm(self, x: Template, t: float):
        """Return the mole fraction [ppm] of each species, as a vector, at point x [m] and time t [s]."""
        result = self.excess(x, t)
        if ti.static(self.has_background):
            for s in ti.static(range(len(self.species))):
                result[s] += self._background[s]
        return result

    @ti.func
    def excess(self, x: Template, t: float):
        """Return the mole fraction [ppm] of each species above its background at point x [m] and time t [s]."""
        result = ti.Vector.zero(ti.f32, ti.static(len(self.species)))
        for g in ti.static(range(len(self.gases))):
            result[self._which[g]] += self.gases[g].concentration(x, t) * self._ppm_per_density[g]
        return result

    @ti.func
    def fluctuations(self, x: Template, v: Template, t: float):
        """Return the standard deviation [ppm] of the unresolved fluctuations of each species at x [m], as a vector, and
        the rate [1/s] at which a sensor that moves with velocity v [m/s] forgets them.
        """
        stirred = ti.static([self.unresolved[g] for g in self._stirred])
        difference = stirred[0].difference(x, t)  # one wind stirs all gases
        square = ti.Vector.zero(ti.f32, ti.static(len(self.species)))
        for g in ti.static(self._stirred):
            square[self._which[g]] += (
                self.unresolved[g].deviation(x, difference, t) * self._ppm_per_density[g]
            ) ** 2
        return ti.sqrt(square), stirred[0].turnover(x, v, difference, t)


@ti.func
def corner(x: Template, shift: Template, dx: float, ghost: ti.i32, padded: Template):
    """Return the lower sample's index and the weight of x per axis, clipped; sample I is at (I - ghost + shift) dx."""
    base = ti.Vector.zero(ti.i32, x.n)
    weight = ti.Vector.zero(ti.f32, x.n)
    for d in ti.static(range(x.n)):
        position = ti.math.clamp(x[d] / dx - shift[d] + ghost, 0.0, padded[d] - 1.001)
        base[d] = ti.cast(position, ti.i32)
        weight[d] = position - base[d]
    return base, weight


@ti.func
def corner_weight(weight: Template, offset: Template):
    """Return the multilinear weight of the sample at base + offset; weight: from `corner`."""
    w = 1.0
    for d in ti.static(range(weight.n)):
        w *= weight[d] if ti.static(offset[d] == 1) else 1.0 - weight[d]
    return w


@ti.func
def sample_faces(u: Template, x: Template, dx: float, ghost: ti.i32, padded: Template):
    """Return the vector at point x [m] of the face fields u (staggered grid), multilinear between the faces."""
    result = ti.Vector.zero(ti.f32, x.n)
    for c in ti.static(range(x.n)):
        shift = ti.Vector([0.0 if d == c else 0.5 for d in ti.static(range(x.n))])
        base, weight = corner(x, shift, dx, ghost, padded)
        I = ti.cell(base, u)
        for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * x.n)))):
            result[c] += corner_weight(weight, offset) * u[c][I + offset]
    return result


@ti.func
def sample_solenoidal(u: Template, x: Template, dx: float, ghost: ti.i32, padded: Template):
    """Return the velocity at point x [m] in the domain of the face fields u (staggered grid): divergence-free within
    each cell, where the fluxes through its faces add up to 0.

    On a face the normal velocity is linear with central slopes, so that u is its mean; closed faces, where u is 0, have
    no slope. It is linear from face to face. Parabolas that vanish on the faces remove the divergence by the slopes
    (Balsara 2001, doi:10.1006/jcph.2001.6917). As the normal velocity is continuous, points that are carried stay
    uniform. Tangential velocities change at faces by a step of second order.
    """
    dim = ti.static(x.n)
    base = ti.Vector.zero(ti.i32, dim)  # cell
    away = ti.Vector.zero(ti.f32, dim)  # position from its middle [cells]
    for d in ti.static(range(dim)):
        position = ti.math.clamp(x[d] / dx, 0.0, padded[d] - 2.0 * ghost)
        base[d] = ti.min(ti.cast(position, ti.i32), padded[d] - 2 * ghost - 1)
        away[d] = position - base[d] - 0.5
        base[d] += ghost
    I = ti.cell(base, u)
    result = ti.Vector.zero(ti.f32, dim)
    for d in ti.static(range(dim)):
        D = ti.Vector.unit(dim, d, ti.i32)
        low, high = u[d][I], u[d][I + D]
        passes_low, passes_high = ti.select(low == 0.0, 0.0, 0.5), ti.select(high == 0.0, 0.0, 0.5)
        for e in ti.static([a for a in range(dim) if a != d]):
            E = ti.Vector.unit(dim, e, ti.i32)
            below = passes_low * (u[d][I + E] - u[d][I - E])
            above = passes_high * (u[d][I + D + E] - u[d][I + D - E])
            low += below * away[e]
            high += above * away[e]
            result[e] += 0.5 * (above - below) * (0.25 - away[e] * away[e])
        result[d] += low + (0.5 + away[d]) * (high - low)
    return result


@ti.func
def sample_cells(c: Template, air: Template, x: Template, dx: float, ghost: ti.i32, padded: Template):
    """Return the cell field c at point x [m], multilinear between the centres of those cells where `air` is 1."""
    shift = ti.Vector([0.5] * x.n)
    base, weight = corner(x, shift, dx, ghost, padded)
    I = ti.cell(base, (c, air))
    total, share = 0.0, 0.0
    for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * x.n)))):
        w = corner_weight(weight, offset) * air[I + offset]
        total += w * c[I + offset]
        share += w
    return total / ti.max(share, 1e-6)


@ti.kernel
def _sample(
    kind: Template,
    source: Template,
    dim: Template,
    points: ti.types.ndarray(),  # type: ignore[valid-type]
    t: float,
    out: ti.types.ndarray(),  # type: ignore[valid-type]
):
    for n in range(out.shape[0]):
        x = ti.Vector([points[n, d] for d in ti.static(range(dim))])
        if ti.static(kind == "velocity"):
            u = source.velocity(x, t)
            for d in ti.static(range(dim)):
                out[n, d] = u[d]
        elif ti.static(kind in ("ppm", "excess")):
            ppm = source.ppm(x, t) if ti.static(kind == "ppm") else source.excess(x, t)
            for s in ti.static(range(len(source.species))):
                out[n, s] = ppm[s]
        else:
            out[n, 0] = source.concentration(x, t)


def _sampled(kind: str, source: object, points: np.ndarray, t: float, width: int) -> np.ndarray:
    flat = np.ascontiguousarray(points.reshape(-1, points.shape[-1]), np.float32)
    out = np.empty((len(flat), width), np.float32)
    _sample(kind, source, points.shape[-1], flat, t, out)
    return out.reshape(*points.shape[:-1], width)


def ppm_at(gas: Mixture, points: np.ndarray, t: float) -> np.ndarray:
    """Return the mole fraction [ppm] of each species at points (..., dim) [m] and time t [s], (..., species)."""
    return _sampled("ppm", gas, points, t, len(gas.species))


def excess_at(gas: Mixture, points: np.ndarray, t: float) -> np.ndarray:
    """Return the mole fraction [ppm] of each species above its background at points (..., dim) [m], time t [s]."""
    return _sampled("excess", gas, points, t, len(gas.species))


def concentration_at(gas: Gas, points: np.ndarray, t: float) -> np.ndarray:
    """Return the concentration [kg/m³] of a gas at points (..., dim) [m] and time t [s], (...)."""
    return _sampled("concentration", gas, points, t, 1)[..., 0]


def velocity_at(wind: Wind, points: np.ndarray, t: float) -> np.ndarray:
    """Return the wind velocity [m/s] at points (..., dim) [m] and time t [s], (..., dim)."""
    return _sampled("velocity", wind, points, t, points.shape[-1])
