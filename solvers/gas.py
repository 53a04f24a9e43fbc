"""Gas dispersion on the grid (Eulerian advection-diffusion): sources emit vapour into the air (see `transport`).

Gas that changes the air's density (buoyancy) also has a volume, that of an ideal gas, which displaces air (see
`continuity`): no cell holds more than pure gas. The flow takes the volume of the step before.
"""

from collections.abc import Callable, Sequence
from math import inf, isfinite

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier, GridGas
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import launch
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.openings import Opening
from taichi_plume.solvers.convection import LIMITED
from taichi_plume.solvers.emission import Emission
from taichi_plume.solvers.openings import VENTS, Patch, patch_of
from taichi_plume.solvers.release import Release
from taichi_plume.solvers.surface_exchange import Surface, SurfaceExchange
from taichi_plume.solvers.transport import Scalar, Transport


class EulerianSolver(GridGas):
    """Gas on the grid, carried by a wind that has face velocities. Field c: concentration [kg/m³]."""

    STATE = ("transport", "emissions", "emitted_kg", "initial_kg", "surfaces")

    def __init__(
        self,
        gas: EulerianGas,
        grid: Grid,
        wind: Carrier,
        air: Air,
        t: float = 0.0,
        seed: int = 0,
        name: str = "gas",
        scalar: Scalar | None = None,
        openings: Sequence[Opening] = (),
    ):
        """t: start of the run [s]; name: name of the gas; scalar: the concentration, if the gas has buoyancy; openings:
        openings of the wind. Raises ValueError for a source or a surface without air.
        """
        self.grid = grid
        self.dim = grid.dim
        self.air, self._solid = grid.filled(grid.pad(~air.solid)), air.solid
        self.species = gas.vapour
        self.emissions = [
            Emission(f"{name}.sources[{n}]", source, t, seed, self.species, wind)
            for n, source in enumerate(gas.sources)
        ]
        room = np.where(air.solid, 0.0, 1.0) if wind.area is None else air.room
        self.release = Release("sources", gas.sources, grid, air, room)

        self._carrier = wind
        self._vents = self._patches(gas, openings, air)
        self.surfaces: SurfaceExchange | None = None
        if gas.surfaces is not None:
            walls, obstacles = gas.surfaces.walls, gas.surfaces.obstacles
            surfaces = [
                Surface(
                    surface.transfer,
                    inf if surface.uptake is None else surface.uptake,
                    self._density(surface.concentration or 0.0),
                )
                for surface in (*walls, *obstacles)
            ]
            numbers = [obstacle.number for obstacle in obstacles]
            vents = [vent for vent in self._vents.values() if vent.kind in VENTS]
            try:
                self.surfaces = SurfaceExchange(
                    grid, wind, air, walls, numbers, vents, surfaces, self.species.diffusivity
                )
            except ValueError as error:
                raise ValueError(f"surfaces.{error}") from None
        scalar, scheme = scalar or Scalar(grid), LIMITED[gas.convection]
        self.transport = Transport(
            grid, wind, air, scheme, scalar, self.species.diffusivity, wind.schmidt, self.release,
            self.surfaces, bool(gas.inflow),
        )  # fmt: skip
        self.c, self.source = scalar.q, scalar.source
        if self.source is not None:
            self.STATE = (*EulerianSolver.STATE, "source")
            self._fill = launch(self.release.filling(self.source, self.transport.room))
            self._regions = air.regions()
        self._displaces = self.source is not None and self._all_vented()
        self._inflow = gas.inflow
        self._carried: list[float] = []
        self._bring(t)
        self.emitted_kg = self.initial_kg = 0.0

    def _patches(self, gas: EulerianGas, openings: Sequence[Opening], air: Air) -> dict[int, Patch]:
        """Return the boundary patches of the openings by index, empty unless inflow or surfaces need them."""
        if not gas.inflow and gas.surfaces is None:
            return {}
        patches = {n: patch_of(opening, self.grid, air.area) for n, opening in enumerate(openings)}
        return {n: patch for n, patch in patches.items() if patch is not None}

    def _density(self, ppm: float) -> float:
        """Return the concentration [kg/m³] of the gas at a mole fraction [ppm]."""
        return ppm / self.species.ppm_per_density

    def start_from(self, concentration: Callable[[np.ndarray], np.ndarray]) -> None:
        """Set c from a function of points (..., dim) [m] to concentrations [kg/m³]; 0 in obstacles."""
        solid = self._solid
        self.transport.start_from(lambda points: np.where(solid, 0.0, concentration(points)))
        self.initial_kg = self.transport.inside()

    def _all_vented(self) -> bool:
        """Return whether all sources release into air that an opening leads out of, so that gas can displace it."""
        vented = self._carrier.boundaries.vented(self._regions)
        return all(self._regions[tuple(cells[0])] in vented for cells, _ in self.release.balls)

    # ---------------------------------------------------------------- the step

    def advance(self, t: float, dt: float) -> None:
        """Emit and disperse gas from t to t + dt [s], in enough steps to keep the concentration positive."""
        steps = self.transport.steps(dt)
        h = dt / steps
        for n in range(steps):
            self._bring(t + n * h)
            self._emit(t + n * h, h)
            self.transport.step(h)

    def _bring(self, t: float) -> None:
        """Set the concentration of the air that enters through openings at time t [s]."""
        carried = [self._density(inflow.at(t)) for inflow in self._inflow]
        if self.transport.inflow and carried != self._carried:
            patches = [self._vents[inflow.opening] for inflow in self._inflow]
            self.transport.set_inflow(list(zip(patches, carried, strict=True)))
            self._carried = carried

    def _emit(self, t: float, dt: float) -> None:
        if self.release.follow(t + 0.5 * dt) and self.source is not None:
            self.source.fill(0.0)  # of the cells that balls have left
        masses = [emission.mass(t, dt) for emission in self.emissions]
        self.release.set_amounts(masses)
        if self._displaces:
            self._fill(1e-6 * self.species.ppm_per_density / dt)
        self.emitted_kg += sum(masses)

    # ---------------------------------------------------------------- budget

    def budget(self) -> dict[str, float]:
        """Return the mass balance [kg] by name: initial, if any, emitted, in the domain, outflow; if inflow or surfaces
        exchange gas, also the mass that entered with air and the mass that surfaces took up.
        """
        budget = {
            **({"initial_kg": self.initial_kg} if self.initial_kg else {}),
            "emitted_kg": self.emitted_kg,
            "in_domain_kg": self.transport.inside(),
            "outflow_kg": self.transport.outflow(),
        }
        if self.transport.inflow:
            budget["inflow_kg"] = self.transport.brought_in()
            budget["outflow_kg"] += budget["inflow_kg"]
        if self.surfaces is not None:
            budget["taken_up_kg"] = -self.surfaces.given()
        return budget

    def is_finite(self) -> bool:
        return isfinite(self.transport.inside())

    def least(self) -> float:
        """Return the smallest concentration [kg/m³] of all cells."""
        return self.transport.least()
