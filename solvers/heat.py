"""Temperature of the air: carried and spread like a gas, fed by heaters, and exchanged with surfaces.

    dT/dt + div(u T) = div((alpha + nu_t/Pr_t) grad T) + P/(rho c_p V)

A surface of temperature T_s gives its cells k (T_s - T) per area: k = h/(rho c_p) where its coefficient of heat
transfer h is known, else alpha/(dx/2), and beyond the conductive layer, where there is a model of eddies, that of
`wall_law.transfer_velocity`. All others are adiabatic.
"""

from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass
from taichi_plume.grid.transfer import Numbers, uploader
from taichi_plume.scenario.any_opening import Vent
from taichi_plume.scenario.heat import Heat
from taichi_plume.solvers.convection import FACE_VALUES
from taichi_plume.solvers.patches import VENTS, Patch
from taichi_plume.solvers.release import Release
from taichi_plume.solvers.scalar import Scalar
from taichi_plume.solvers.tally import Tally
from taichi_plume.solvers.transport import Transport
from taichi_plume.solvers.wall_law import friction_velocity, transfer_velocity


def _temperature(vent: Patch) -> float | None:
    """Of the air that comes in there [K], where it is given."""
    return cast(Vent, vent.opening).temperature


@ti.data_oriented
class HeatSolver:
    """Temperature on the grid of a flow. Field theta: T - reference [K]."""

    STATE = ("transport", "heaters_joule", "_from_surfaces")

    def __init__(
        self,
        heat: Heat,
        grid: Grid,
        wind: Carrier,
        patches: Sequence[Patch],
        air: Air,
        scalar: Scalar | None = None,
    ):
        """patches: of the wind's openings; scalar: theta, where the flow feels it. Raises ValueError for a heater or a
        surface that touches no air.
        """
        self.grid, self.air, self.wind = grid, air, wind
        self.eddies = wind.nu is not None
        self.n = Numbers("viscosity", "diffusivity")
        self.release = Release("heaters", heat.heaters, grid, air.room) if heat.heaters else None
        self._from_surfaces = Tally()
        self._vents = [patch for patch in patches if patch.kind in VENTS]
        self._touched = list(self._surfaces(heat))
        self._list_surface_cells()
        self._inflow = self._inflow_fields()
        self._warm = uploader(self._rate, self._gain, self._film, self._film_gain, *self._inflow)

        @ti.func
        def add_sources(dt, k):
            self.release.add_to(self.theta, self.transport.rest)

        @ti.func
        def exchange(h, stage):
            self._exchange(h, stage)

        self.transport = Transport(
            grid,
            wind,
            air,
            FACE_VALUES["koren"],
            Pass(add_sources, self.release.cells) if self.release else None,
            Pass(exchange, len(self._where[0])) if self._touched else None,
            self._inflow,
            scalar,
        )
        self.theta = self.transport.q
        self.begin(heat)

    def begin(self, model: Heat, t: float = 0.0, seed: int = 0) -> None:
        """Raises ValueError for a heater that touches no air."""
        self.reference = model.reference
        self.capacity = model.capacity
        self.heaters = model.heaters
        self.heaters_joule = 0.0
        if self.release is not None:
            self.release.begin(model.heaters)
        known, film = self._exchange_rates(model)
        self._warm(*(self._listed(part) for part in (*known, *film)), *self._inflow_theta())
        self.n.set(viscosity=self.wind.viscosity, diffusivity=model.diffusivity)
        still = 2.0 * model.diffusivity / self.grid.dx
        self.transport.begin(
            model.diffusivity, model.prandtl_turbulent, float((known[0] + still * film[0]).max())
        )

    # ---------------------------------------------------------------- surfaces and openings

    def _surfaces(self, heat: Heat) -> Iterator[tuple[Any, Any]]:
        """Of each wall and obstacle of a given temperature the cells that touch it, and its area in each of them over a
        face's.
        """
        for n, wall in enumerate(heat.walls):
            patch = Patch(wall, self.grid, ~self.air.solid)
            for vent in self._vents:
                if (vent.axis, vent.side) == (wall.axis, wall.side):
                    patch.covered &= ~vent.covered
            if not patch.covered.any():
                raise ValueError(
                    f"walls[{n}]: touches no air, an obstacle or an opening covers it; move one of them"
                )
            yield patch.cells(), 1.0
        surface = np.linalg.norm(self.air.surface(), axis=-1) * ~self.air.solid
        for n, obstacle in enumerate(heat.obstacles):
            cells = (self.air.body == obstacle.number) & (surface > 0.0)
            if not cells.any():
                raise ValueError(
                    f"obstacles[{n}]: touches no air; obstacles[{obstacle.number}] is smaller than a cell"
                )
            yield cells, surface[cells]

    def _list_surface_cells(self) -> None:
        """Make the lists of the cells that exchange heat, and how."""
        touched = np.zeros(self.grid.shape, bool)
        for cells, _ in self._touched:
            touched[cells] = True
        self._where = np.nonzero(touched)
        count = max(1, len(self._where[0]))
        self._cell = ti.Vector.field(self.grid.dim, ti.i32, count)
        self._room, self._rate, self._gain = (ti.field(ti.f32, count) for _ in range(3))
        self._film, self._film_gain = (ti.field(ti.f32, count) for _ in range(2))
        if self._touched:
            cell = np.argwhere(touched) + self.grid.ghost
            uploader(self._cell, self._room)(cell, self._listed(self.air.room))

    def _listed(self, values: np.ndarray) -> np.ndarray | float:
        """Values of the cells, of grid.shape, at surfaces."""
        return values[self._where] if self._touched else 0.0

    def _exchange_rates(self, heat: Heat) -> tuple[np.ndarray, np.ndarray]:
        """Per cell the rate r and the gain g of its exchange with surfaces, dT/dt = g - r T, arrays (2, *grid.shape):
        with those whose transfer is known [1/s, K/s], and with others over its velocity k [1/m, K/m].
        """
        known, film = np.zeros((2, *self.grid.shape)), np.zeros((2, *self.grid.shape))
        for (cells, size), surface in zip(self._touched, (*heat.walls, *heat.obstacles), strict=True):
            exchange = size / self.air.room[cells] / self.grid.dx
            theta = surface.temperature - self.reference
            if surface.transfer is not None:
                exchange = exchange * surface.transfer / heat.capacity
            chosen = film if surface.transfer is None else known
            chosen[0][cells] += exchange
            chosen[1][cells] += exchange * theta
        return known, film

    def _inflow_fields(self) -> list[Any]:
        """For theta of the air that comes in, on the two faces of each axis; none where all of it is at the
        reference.
        """
        if all(_temperature(vent) is None for vent in self._vents):
            return []
        shape = self.grid.shape
        return [
            ti.field(ti.f32, tuple(2 if a == d else n for a, n in enumerate(shape)))
            for d in range(self.grid.dim)
        ]

    def _inflow_theta(self) -> list[np.ndarray]:
        """theta on each axis' faces."""
        result = [np.zeros(field.shape) for field in self._inflow]
        for vent in self._vents:
            temperature = _temperature(vent)
            if temperature is not None:
                face = np.moveaxis(result[vent.axis], vent.axis, 0)[vent.side]
                face[vent.covered] = temperature - self.reference
        return result

    # ---------------------------------------------------------------- the step

    def advance(self, t: float, dt: float) -> None:
        """Warm, carry and spread from t to t + dt, in as many steps as make no new extrema."""
        steps = self.transport.steps(dt)
        h = dt / steps
        if self.release is not None:
            self.release.set_amounts([heater.power * h / self.capacity for heater in self.heaters])
        self.heaters_joule += sum(heater.power for heater in self.heaters) * dt
        for _ in range(steps):
            self.transport.step(h)

    @ti.func
    def _exchange(self, h, stage):
        """Add to the rate what the surfaces give, and count it."""
        self._from_surfaces.begin(stage)
        for n in range(self._rate.shape[0]):
            I = self._cell[n]
            still = self.n.diffusivity[None] / ti.static(0.5 * self.grid.dx)
            k = still
            if ti.static(self.eddies):
                k = self._film_velocity(I)
            given = self._gain[n] - self._rate[n] * self.theta[I]
            # `steps` allows for `still` only; what the wind adds is implicit
            given += (
                k
                * (self._film_gain[n] - self._film[n] * self.theta[I])
                / (1.0 + h * ti.max(k - still, 0.0) * self._film[n])
            )
            self.transport.rate[I] += given
            self._from_surfaces.add(given * self._room[n])
        self._from_surfaces.end(h)

    @ti.func
    def _film_velocity(self, I):
        """k [m/s] at the surfaces of cell I."""
        square = 0.0
        for d in ti.static(range(self.grid.dim)):
            D = ti.Vector.unit(self.grid.dim, d, ti.i32)
            square += 0.25 * (self.wind.u[d][I] + self.wind.u[d][I + D]) ** 2
        y, nu = ti.static(0.5 * self.grid.dx), self.n.viscosity[None]
        u_tau = friction_velocity(ti.sqrt(square), y, nu, 0.0)
        return transfer_velocity(u_tau, y, nu, self.n.diffusivity[None])

    # ---------------------------------------------------------------- what is known about it

    def budget(self) -> dict[str, float]:
        """Heat [J] that heaters and surfaces gave, that is in the air and that left through the openings."""
        return {
            "heaters_J": self.heaters_joule,
            "surfaces_J": self._from_surfaces.read() * self.grid.cell_volume * self.capacity,
            "in_air_J": self.transport.inside() * self.capacity,
            "outflow_J": self.transport.outflow() * self.capacity,
        }

    def diagnostics(self) -> dict[str, float]:
        """Coldest and warmest cell [K] and the budget of heat."""
        theta = self.grid.read(self.theta)[~self.air.solid]
        return {
            "coldest_K": self.reference + float(theta.min()),
            "warmest_K": self.reference + float(theta.max()),
            **{f"heat_{name}": value for name, value in self.budget().items()},
        }
