"""Exchange of heat or gas between surfaces and air: walls and obstacles as boundary conditions (Robin, Dirichlet).

    dq/dt = v A/V (q_s - q)

v [m/s]: transfer velocity across the film of air at the surface and then into the surface, in series: 1/v is the sum of
both values 1/v. q_s: q of the surface; A/V [1/m]: its area over the volume of air of a cell. The transfer velocity of
the film is given, or follows from diffusion through half a cell, or beyond the diffusive layer, with a turbulence
model, from `wall_law.transfer_velocity`. Surfaces that the scenario does not name exchange nothing.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple, cast

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass, Template
from taichi_plume.scenario.windows import Region
from taichi_plume.solvers.openings import Patch
from taichi_plume.solvers.wall_law import transfer_velocity

Touched = tuple[tuple[np.ndarray, ...] | np.ndarray, float | np.ndarray]
"""Cells that a surface touches (indices or a mask), and the surface's area in each cell over the area of a face."""

FIRST, BETWEEN, LAST = 0.0, 1.0, 2.0
"""Position of a stage within a Runge–Kutta step."""


class Tally:
    """Time integral of a flux, in f64. Each stage of a step sets the total to its value before the step plus the step's
    length times the sum of the rates of all stages so far.
    """

    STATE = ("_total",)

    def __init__(self) -> None:
        self._total, self._before, self._rate = (ti.field(ti.f64) for _ in range(3))

    @ti.func
    def begin(self, stage):
        """Start a stage (FIRST, BETWEEN or LAST); the first stage of a step clears the rate."""
        if stage == FIRST:
            self._before[None] = self._total[None]
            self._rate[None] = 0.0

    @ti.func
    def add(self, rate):
        """Add the flux through one face or cell [1/s] to the rate of the step."""
        self._rate[None] += ti.cast(rate, ti.f64)

    @ti.func
    def end(self, h):
        """Finish a stage: set the total; h: length [s] by which the sum of rates counts, see `transport`."""
        self._total[None] = self._before[None] + ti.cast(h, ti.f64) * self._rate[None]

    def read(self) -> float:
        """Return the total flux since the start of the run."""
        return cast(float, self._total[None])


class Surface(NamedTuple):
    """Parameters of a surface. film: given transfer velocity [m/s] of the air film, None for the wall law; own:
    transfer velocity [m/s] of the surface itself, infinite for a surface of fixed q; held: q of the surface.
    """

    film: float | None
    own: float
    held: float


def in_series(first: float, second: float) -> float:
    """Return the transfer velocity [m/s] of two layers in series with transfer velocities `first` and `second`."""
    return 0.0 if 0.0 in (first, second) else 1.0 / (1.0 / first + 1.0 / second)


class SurfaceExchange:
    """Exchange of heat or gas between the air and walls or obstacles, in the cells that touch them.

    fastest [1/s]: largest rate of exchange, without the part by the law of the wall, which is implicit. Several
    surfaces without a given film that touch the same cell count as one surface.
    """

    STATE = ("_given",)

    def __init__(
        self,
        grid: Grid,
        wind: Carrier,
        air: Air,
        walls: Sequence[Region],
        obstacles: Sequence[int],
        vents: Sequence[Patch],
        surfaces: Sequence[Surface],
        diffusivity: float,
    ):
        """obstacles: indices of the obstacles; vents: openings, where there is no wall; surfaces: parameters of each
        wall, then of each obstacle; diffusivity [m²/s]: of still air. Raises ValueError for a surface that touches no
        air.
        """
        self.grid, self.wind, self.room = grid, wind, air.room
        self.eddies = wind.nu is not None
        self.fastest = 0.0
        self._given = Tally()
        self._touched = [*self._of_walls(walls, air, vents), *self._of_obstacles(obstacles, air)]
        touched = np.zeros(grid.shape, bool)
        for cells, _ in self._touched:
            touched[cells] = True
        self._where = np.nonzero(touched)
        self.cells = len(self._where[0])
        self._cell = ti.filled_vectors(np.argwhere(touched) + grid.ghost)
        self._stores = ti.filled(self.room[self._where])
        self._set_parameters(surfaces, diffusivity)

    def _of_walls(self, walls: Sequence[Region], air: Air, vents: Sequence[Patch]) -> Iterator[Touched]:
        """Yield for each wall the cells that touch it, and its area in each cell over the area of a face."""
        for n, wall in enumerate(walls):
            patch = Patch(wall, self.grid, air.area)
            for vent in vents:
                if (vent.axis, vent.side) == (wall.axis, wall.side):
                    patch.covered &= ~vent.covered
            if not patch.covered.any():
                raise ValueError(
                    f"walls[{n}]: touches no air, an obstacle or an opening covers it; move one of them"
                )
            yield patch.cells(), 1.0

    def _of_obstacles(self, obstacles: Sequence[int], air: Air) -> Iterator[Touched]:
        surface = np.linalg.norm(air.surface(), axis=-1) * ~air.solid
        for n, number in enumerate(obstacles):
            cells = (air.body == number) & (surface > 0.0)
            if not cells.any():
                raise ValueError(
                    f"obstacles[{n}]: touches no air; obstacles[{number}] is smaller than a cell"
                )
            yield cells, surface[cells]

    def _set_parameters(self, surfaces: Sequence[Surface], diffusivity: float) -> None:
        still = 2.0 * diffusivity / self.grid.dx
        known, film = np.zeros((2, *self.grid.shape)), np.zeros((3, *self.grid.shape))
        for (cells, size), (velocity, own, q) in zip(self._touched, surfaces, strict=True):
            exchange = size / self.room[cells] / self.grid.dx
            if velocity is not None:
                exchange = exchange * in_series(velocity, own)
                known[0][cells] += exchange
                known[1][cells] += exchange * q
            elif own > 0.0:
                film[0][cells] += exchange
                film[1][cells] += exchange * q
                film[2][cells] += exchange / own
        sticky = film[2] / np.maximum(film[0], 1e-30)  # 1/v of the surfaces
        fastest = known[0] + film[0] / (1.0 / max(still, 1e-30) + sticky)
        self.fastest = float(fastest.max())
        self.viscosity = ti.filled(self.wind.viscosity if self.eddies else 0.0)
        self.diffusivity = ti.filled(diffusivity)
        self._rate, self._gain, self._film, self._film_gain, self._sticky = (
            ti.filled(part[self._where]) for part in (*known, film[0], film[1], sticky)
        )

    def into(self, rate: Template, q: Template) -> Pass:
        """Return the pass that adds the flux from the surfaces to the rate of change of q, and to the total."""
        return Pass(partial(self._exchange, rate, q), self.cells)

    @ti.func
    def _exchange(self, rate: Template, q: Template, h, stage):
        self._given.begin(stage)
        for n in range(self._rate.shape[0]):
            I = self._cell[n]
            given = self._gain[n] - self._rate[n] * q[I]
            still = self._through(self.diffusivity[None] / ti.static(0.5 * self.grid.dx), n)
            v = still
            if ti.static(self.eddies):
                v = self._through(self._film_velocity(I), n)
            implicit = 1.0 + h * ti.max(v - still, 0.0) * self._film[n]
            given += v * (self._film_gain[n] - self._film[n] * q[I]) / implicit
            rate[I] += given
            self._given.add(given * self._stores[n])
        self._given.end(h)

    @ti.func
    def _through(self, film, n):
        """Return the transfer velocity [m/s] across a film of velocity `film` and into the surfaces of cell n."""
        return film / (1.0 + film * self._sticky[n])

    @ti.func
    def _film_velocity(self, I):
        """Return the transfer velocity [m/s] across the air film in cell I by the law of the wall."""
        square = 0.0
        for d in ti.static(range(self.grid.dim)):
            D = ti.Vector.unit(self.grid.dim, d, ti.i32)
            square += 0.25 * (self.wind.u[d][I] + self.wind.u[d][I + D]) ** 2
        y, nu = ti.static(0.5 * self.grid.dx), self.viscosity[None]
        return transfer_velocity(ti.sqrt(square), y, nu, self.diffusivity[None])

    def given(self) -> float:
        """Return the total that the surfaces have released into the air so far (q times volume)."""
        return self._given.read() * self.grid.cell_volume
