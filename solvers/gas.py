"""Convection and diffusion of a vapour on the grid.

    dc/dt + div(u c) = div((D + nu_t/Sc_t) grad c) + sources

Finite volumes with the flow's own face velocities, so a well-mixed gas stays well mixed; limited face values and steps
short enough that no cell gives away more than it holds keep c >= 0. Every face's flux is seen alike from both sides.
"""

from collections.abc import Callable
from math import ceil, isfinite, prod
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.fields import corner, corner_weight
from taichi_plume.grid import Grid, block_mean
from taichi_plume.kernels import Template, launch, sweep
from taichi_plume.rng import generator
from taichi_plume.scenario import EulerianGas, Source
from taichi_plume.solvers.convection import POSITIVE_FACE_VALUES
from taichi_plume.species import SPECIES, Species

FULLEST = (
    0.49  # largest share of a cell's volume that flows out in one stage; 1/2 empties it at the steepest slope
)


def species_of(gas: EulerianGas) -> Species:
    """The species of a scenario's gas."""
    if isinstance(gas.species, str):
        return SPECIES[gas.species]
    return Species(gas.species.name, gas.species.molar_mass, gas.species.diffusivity)


class Emission:
    """When a source emits: its start and stop, and pulses of random length."""

    def __init__(self, source: Source, begin: float, seed: int, name: str):
        self.source = source
        self.start = begin if source.start is None else source.start
        self.stop = np.inf if source.stop is None else source.stop
        self.rng = generator(seed, name)
        self.pulses = [(self.start, self.stop)] if source.puffing is None else []

    def _draw_until(self, t: float) -> None:
        puffing = self.source.puffing
        while puffing is not None and (not self.pulses or self.pulses[-1][1] < t):
            spread = 1.0 + puffing.spread * self.rng.uniform(-1.0, 1.0, 2)
            begin = self.pulses[-1][1] + puffing.pause * spread[0] if self.pulses else self.start
            self.pulses.append((begin, begin + puffing.pulse * spread[1]))

    def mass(self, t: float, dt: float) -> float:
        """Mass emitted between t and t + dt [kg]."""
        self._draw_until(t + dt)
        while len(self.pulses) > 1 and self.pulses[0][1] < t:
            self.pulses.pop(0)
        on = sum(max(0.0, min(e, t + dt, self.stop) - max(b, t)) for b, e in self.pulses)
        return self.source.rate * on


@ti.data_oriented
class EulerianSolver:
    """Gas on the grid of a wind that has face velocities; satisfies `fields.Gas`.

    wind: offers u, open (face fields), nu (viscosity with eddies, or None), viscosity, schmidt, and the maxima
    max_viscosity [m²/s] and outflow_rate (flow out of a cell over its volume [1/s]).
    Field c: concentration [kg/m³].
    """

    def __init__(
        self, gas: EulerianGas, grid: Grid, wind: Any, solid: np.ndarray, begin: float = 0.0, seed: int = 0
    ):
        self.grid = grid
        self.dim = grid.dim
        self.species = species_of(gas)
        self.ppm_per_density = self.species.ppm_per_density
        self.wind = wind
        self.eddies = wind.nu is not None
        self.c = grid.field()
        self._start = grid.field()
        self._rate = grid.field()
        self.air = grid.field()
        self.air.from_numpy(grid.pad((~solid).astype(np.float32)))
        self.emitted_kg = 0.0
        self._masses: list[float] = []
        self._outflow = ti.field(ti.f64)
        apart = ti.FieldsBuilder()  # beside 32-bit fields Vulkan would misplace it
        apart.place(self._outflow)
        apart.finalize()
        self._sides = [tuple(2 if a == d else n for a, n in enumerate(grid.shape)) for d in range(grid.dim)]
        self.emissions = [Emission(s, begin, seed, f"source {n}") for n, s in enumerate(gas.sources)]
        self._place_sources(gas.sources, solid)
        self._build(gas)

    def _place_sources(self, sources: tuple[Source, ...], solid: np.ndarray) -> None:
        """Cells of each source and the share of its mass that each receives. Raises ValueError for one without air."""
        cells, shares, owner = [], [], []
        sub = (np.arange(4) + 0.5) / 4
        for n, source in enumerate(sources):
            center = np.array(source.position)
            first = np.maximum(np.floor((center - source.radius) / self.grid.dx).astype(int), 0)
            last = np.minimum(np.ceil((center + source.radius) / self.grid.dx).astype(int), self.grid.shape)
            axes = [
                (np.arange(a, b)[:, None] + sub).ravel() * self.grid.dx
                for a, b in zip(first, last, strict=True)
            ]
            squares = [(axis - c) ** 2 for axis, c in zip(axes, center, strict=True)]
            inside = sum(np.ix_(*squares)) <= source.radius**2
            block = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
            share = block_mean(inside, 4) * ~solid[block]
            home = np.minimum((center / self.grid.dx).astype(int), np.array(self.grid.shape) - 1)
            if not share.any() and not solid[tuple(home)]:  # smaller than a cell's samples
                share[tuple(home - first)] = 1.0
            if not share.any():
                raise ValueError(
                    f"sources[{n}].position: is not in the air: an obstacle fills its cell or seals it off; "
                    "move it by a cell or lower domain.spacing"
                )
            where = np.argwhere(share > 0)
            cells.append(where + first + self.grid.ghost)
            shares.append(share[tuple(where.T)] / share.sum())
            owner.append(np.full(len(where), n))
        count = sum(len(c) for c in cells)
        self._cell = ti.Vector.field(self.dim, ti.i32, count)
        self._share = ti.field(ti.f32, count)
        self._owner = ti.field(ti.i32, count)
        self._mass = ti.field(ti.f32, len(sources))
        self._cell.from_numpy(np.concatenate(cells).astype(np.int32))
        self._share.from_numpy(np.concatenate(shares).astype(np.float32))
        self._owner.from_numpy(np.concatenate(owner).astype(np.int32))

    def _build(self, gas: EulerianGas) -> None:
        """The formulas of a step, each swept over the cells."""
        c, c0, rate = self.c, self._start, self._rate
        u, a, nu, dx, dim = self.wind.u, self.wind.open, self.wind.nu, self.grid.dx, self.dim
        diffusivity, viscosity, schmidt = self.species.diffusivity, self.wind.viscosity, self.wind.schmidt
        eddies = self.eddies
        face_value = POSITIVE_FACE_VALUES[gas.convection]

        @ti.func
        def face_flux(I, d: Template):
            """Flux [kg/(m² s)] through the lower d-face of cell I: convection, and diffusion where it is open."""
            D = ti.Vector.unit(dim, d, ti.i32)
            K = diffusivity
            if ti.static(eddies):
                K += (0.5 * (nu[I] + nu[I - D]) - viscosity) / schmidt
            v = u[d][I]
            gradient = ti.select(a[d][I] > 0.0, (c[I] - c[I - D]) / dx, 0.0)
            return v * face_value(c, I, D, v) - K * gradient

        @ti.func
        def tendency(I, dt, k):
            total = 0.0
            for d in ti.static(range(dim)):
                total += face_flux(I, d) - face_flux(I + ti.Vector.unit(dim, d, ti.i32), d)
            return total / dx

        @ti.func
        def remember(I, dt, k):
            return c[I]

        @ti.func
        def heun(I, dt, k):  # k = 1 in the first stage, where c = c0, and 1/2 in the second
            return c0[I] + k * ((c[I] - c0[I]) + dt * rate[I])

        @ti.func
        def add_sources(dt, k):
            self._add_sources()

        @ti.func
        def fill_ghosts(dt, k):
            self._fill_ghosts()

        @ti.func
        def count_outflow(dt, k):
            self._count_outflow(0.5 * dt)  # Heun's method is the mean of two Euler steps

        self.face_flux = face_flux
        cells, count = self.grid.cells, prod(self.grid.shape)
        self._begin = launch(add_sources, sweep([remember], [c0], cells), cells=count)
        self._stage = launch(
            fill_ghosts,
            sweep([tendency], [rate], cells),
            count_outflow,
            sweep([heun], [c], cells),
            cells=count,
        )

    def start_from(self, concentration: Callable[[np.ndarray], np.ndarray]) -> None:
        """Set c from a function of points (..., dim) [m] to concentrations [kg/m³]."""
        self.c.from_numpy(self.grid.pad(concentration(self.grid.centers()).astype(np.float32)))

    # ---------------------------------------------------------------- the step

    def advance(self, t: float, dt: float) -> None:
        """Emit and disperse from t to t + dt, in as many steps as keep the gas positive."""
        steps = max(1, ceil(dt / self.stable_dt() - 1e-9))
        h = dt / steps
        for n in range(steps):
            self._emit(t + n * h, h)
            self._begin(h)
            self._stage(h, 1.0)
            self._stage(h, 0.5)

    def _emit(self, t: float, dt: float) -> None:
        masses = [emission.mass(t, dt) for emission in self.emissions]
        if masses != self._masses:
            self._masses = masses
            self._mass.from_numpy(np.array(masses, np.float32))
        self.emitted_kg += sum(masses)

    @ti.func
    def _add_sources(self):
        for _ in range(1):  # sources may share cells
            for n in range(self._owner.shape[0]):
                mass = self._mass[self._owner[n]] * self._share[n]
                self.c[self._cell[n]] += mass / ti.static(self.grid.cell_volume)

    @ti.func
    def _fill_ghosts(self):
        """Beyond an outflow the gas goes on unchanged; clean air flows in; periodic axes wrap round."""
        for d in ti.static(range(self.dim)):
            for J in ti.grouped(ti.ndrange(*self._sides[d])):
                g = ti.static(self.grid.ghost)
                n = ti.static(self.grid.shape[d])
                D = ti.Vector.unit(self.dim, d, ti.i32)
                outward = 2 * J[d] - 1
                inner = J + g + D * J[d] * (n - 2)
                for m in ti.static(range(1, g + 1)):
                    if ti.static(self.grid.periodic[d]):
                        self.c[inner + D * outward * m] = self.c[inner - D * outward * (n - m)]
                    else:
                        out = self.wind.u[d][inner + D * J[d]] * outward
                        self.c[inner + D * outward * m] = ti.select(out >= 0.0, self.c[inner], 0.0)

    @ti.func
    def _count_outflow(self, dt: float):
        """Add what leaves through the domain's faces in dt [kg]."""
        for d in ti.static([a for a in range(self.dim) if not self.grid.periodic[a]]):
            for J in ti.grouped(ti.ndrange(*self._sides[d])):
                D = ti.Vector.unit(self.dim, d, ti.i32)
                face = J + ti.static(self.grid.ghost) + D * J[d] * (ti.static(self.grid.shape[d]) - 1)
                flux = self.face_flux(face, d) * (2 * J[d] - 1)
                area = ti.static(self.grid.cell_volume / self.grid.dx)
                self._outflow[None] += ti.cast(flux * area * dt, ti.f64)

    def stable_dt(self) -> float:
        """Longest step [s] that leaves c >= 0: a limited face value is at most twice the upwind cell's."""
        K = self.species.diffusivity + (self.wind.max_viscosity - self.wind.viscosity) / self.wind.schmidt
        return FULLEST / max(self.wind.outflow_rate + self.dim * K / self.grid.dx**2, 1e-30)

    # ---------------------------------------------------------------- what is known about the gas

    @ti.kernel
    def _inside(self) -> ti.f64:
        total = ti.cast(0.0, ti.f64)
        for J in ti.grouped(ti.ndrange(*self.grid.shape)):
            total += ti.cast(self.c[J + ti.static(self.grid.ghost)], ti.f64)
        return total

    @ti.kernel
    def _least(self) -> ti.f32:
        result = 1e30
        for J in ti.grouped(ti.ndrange(*self.grid.shape)):
            ti.atomic_min(result, self.c[J + ti.static(self.grid.ghost)])
        return result

    def budget(self) -> dict[str, float]:
        """Mass emitted, in the domain and gone through its faces [kg]."""
        inside: Any = self._inside()
        left: Any = self._outflow[None]
        return {
            "emitted_kg": self.emitted_kg,
            "in_domain_kg": inside * self.grid.cell_volume,
            "outflow_kg": left,
        }

    def is_finite(self) -> bool:
        """Whether every concentration is a number."""
        return isfinite(self.budget()["in_domain_kg"])

    def least(self) -> float:
        """Smallest concentration [kg/m³]."""
        return self._least()

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at point x [m], linear between the centres of cells that hold air."""
        shift = ti.Vector([0.5] * self.dim)
        base, weight = corner(x, shift, self.grid.dx, self.grid.ghost, self.grid.padded)
        total, air = 0.0, 0.0
        for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * self.dim)))):
            w = corner_weight(weight, offset) * self.air[base + offset]
            total += w * self.c[base + offset]
            air += w
        return total / ti.max(air, 1e-6)
