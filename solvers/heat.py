"""Temperature of the air: carried and spread like a gas, fed by heaters, and exchanged with surfaces.

    dT/dt + div(u T) = div((alpha + nu_t/Pr_t) grad T) + P/(rho c_p V)

A surface of temperature T_s gives its cells alpha (T_s - T)/(dx/2) per area, or h (T_s - T)/(rho c_p) where its
coefficient of heat transfer h is known; all others are adiabatic.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import double_field, listed
from taichi_plume.scenario.heat import Heat, TemperedSurface
from taichi_plume.scenario.openings import Jet, Outlet
from taichi_plume.solvers.boundaries import Patch
from taichi_plume.solvers.convection import FACE_VALUES
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.release import Release
from taichi_plume.solvers.scalar import Scalar
from taichi_plume.solvers.transport import Transport


@ti.data_oriented
class HeatSolver:
    """Temperature on the grid of a flow. Field theta: T - reference [K]."""

    def __init__(self, heat: Heat, grid: Grid, flow: FlowSolver, air: Air, scalar: Scalar | None = None):
        """scalar: theta, where the flow feels it. Raises ValueError for a heater or a surface that touches no air."""
        self.grid = grid
        self.reference = heat.reference
        self.capacity = heat.capacity
        self.heaters = heat.heaters
        self.heaters_joule = 0.0
        self._air = ~air.solid
        self.release = Release("heaters", heat.heaters, grid, air.room) if heat.heaters else None
        self._from_surfaces = double_field()
        rate, gain = self._surfaces(heat, flow, air)
        self._list_surface_cells(rate, gain, air.room)

        @ti.func
        def add_sources(dt, k):
            self.release.add_to(self.theta, self.transport.rest)

        @ti.func
        def exchange(dt, k):
            self._exchange(dt, k)

        schmidt = heat.prandtl_turbulent
        self.transport = Transport(
            grid,
            flow,
            air,
            heat.diffusivity,
            schmidt,
            FACE_VALUES["koren"],
            add_sources if self.release else None,
            exchange if rate.any() else None,
            float(rate.max()),
            self._inflow(flow),
            scalar,
        )
        self.theta = self.transport.q

    # ---------------------------------------------------------------- surfaces and openings

    def _surfaces(self, heat: Heat, flow: FlowSolver, air: Air) -> tuple[np.ndarray, np.ndarray]:
        """Per cell the rate r [1/s] and the gain g [K/s] of its exchange with surfaces: dT/dt = g - r T."""
        rate, gain = np.zeros(self.grid.shape), np.zeros(self.grid.shape)

        def touch(cells: Any, size: Any, surface: TemperedSurface) -> None:
            """size: area of the surface in each of the cells, over a face's."""
            film = 2.0 * heat.diffusivity / self.grid.dx
            if surface.transfer is not None:
                film = surface.transfer / heat.capacity
            exchange = film / self.grid.dx * size / air.room[cells]
            rate[cells] += exchange
            gain[cells] += exchange * (surface.temperature - self.reference)

        vents = [p for p in flow.boundaries.patches if isinstance(p.opening, Jet | Outlet)]
        for n, wall in enumerate(heat.walls):
            patch = Patch(wall, self.grid, ~air.solid)
            for vent in vents:
                if vent.opening.face == wall.face:
                    patch.covered &= ~vent.covered
            if not patch.covered.any():
                raise ValueError(
                    f"walls[{n}]: touches no air, an obstacle or an opening covers it; move one of them"
                )
            touch(patch.cells(), 1.0, wall)
        surface = np.linalg.norm(air.surface(), axis=-1) * ~air.solid
        for n, obstacle in enumerate(heat.obstacles):
            cells = (air.body == obstacle.number) & (surface > 0.0)
            if not cells.any():
                raise ValueError(
                    f"obstacles[{n}]: touches no air; obstacles[{obstacle.number}] is smaller than a cell"
                )
            touch(cells, surface[cells], obstacle)
        return rate, gain

    def _list_surface_cells(self, rate: np.ndarray, gain: np.ndarray, room: np.ndarray) -> None:
        """Keep the cells that exchange heat, and how."""
        where = np.nonzero(rate)
        self._cell = listed(np.argwhere(rate) + self.grid.ghost)
        self._rate, self._gain, self._room = (listed(values[where]) for values in (rate, gain, room))

    def _inflow(self, flow: FlowSolver) -> list[Any]:
        """theta of the air that comes in, on the two faces of each axis; empty where all of it is at the reference."""
        warm = [p for p in flow.boundaries.patches if getattr(p.opening, "temperature", None) is not None]
        if not warm:
            return []
        result = []
        for d in range(self.grid.dim):
            values = np.zeros([2 if a == d else n for a, n in enumerate(self.grid.shape)], np.float32)
            for patch in warm:
                if patch.axis == d:
                    face = np.moveaxis(values, d, 0)[patch.side]
                    face[patch.covered] = patch.opening.temperature - self.reference
            field = ti.field(ti.f32, values.shape)
            field.from_numpy(values)
            result.append(field)
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
    def _exchange(self, dt: float, k: float):
        """Add k times what the surfaces give to the rate, and count half a step of it: Heun's method is the mean of two
        Euler steps.
        """
        for n in range(self._rate.shape[0]):
            I = self._cell[n]
            given = self._gain[n] - self._rate[n] * self.theta[I]
            self.transport.rate[I] += k * given
            self._from_surfaces[None] += 0.5 * ti.cast(dt, ti.f64) * ti.cast(given * self._room[n], ti.f64)

    # ---------------------------------------------------------------- what is known about it

    def budget(self) -> dict[str, float]:
        """Heat [J] that heaters and surfaces gave, that is in the air and that left through the openings."""
        surfaces: Any = self._from_surfaces[None]
        return {
            "heaters_J": self.heaters_joule,
            "surfaces_J": surfaces * self.grid.cell_volume * self.capacity,
            "in_air_J": self.transport.inside() * self.capacity,
            "outflow_J": self.transport.outflow() * self.capacity,
        }

    def diagnostics(self) -> dict[str, float]:
        """Coldest and warmest cell [K] and the budget of heat."""
        theta = self.grid.read(self.theta)[self._air]
        return {
            "coldest_K": self.reference + float(theta.min()),
            "warmest_K": self.reference + float(theta.max()),
            **{f"heat_{name}": value for name, value in self.budget().items()},
        }
