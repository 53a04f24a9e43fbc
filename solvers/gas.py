"""A vapour on the grid: sources that emit into the air, which carries and spreads it (see `transport`)."""

from collections.abc import Callable
from math import isfinite

import numpy as np
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier, Gas, sample_cells
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass, Template
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.solvers.convection import POSITIVE_FACE_VALUES
from taichi_plume.solvers.emission import Emission
from taichi_plume.solvers.release import Release
from taichi_plume.solvers.scalar import Scalar
from taichi_plume.solvers.transport import Transport


@ti.data_oriented
class EulerianSolver(Gas):
    """Gas on the grid of a wind that has face velocities. Field c: concentration [kg/m³]."""

    STATE = ("transport", "emissions", "emitted_kg", "initial_kg")

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
    ):
        """t: begin of the run [s]; name: of the gas among others; scalar: the concentration, where the flow feels its
        weight. Raises ValueError for a source in no air.
        """
        self.grid = grid
        self.dim = grid.dim
        self.air, self._solid = grid.field(), air.solid
        uploader(self.air)(grid.pad(~air.solid))
        self.emissions = [Emission(f"{name}.sources[{n}]", wind) for n in range(len(gas.sources))]
        room = np.where(air.solid, 0.0, 1.0) if wind.area is None else air.room
        self.release = Release("sources", gas.sources, grid, room)

        @ti.func
        def add_sources(dt, k):
            self.release.add_to(self.c, self.transport.rest)

        self._carrier = wind
        face_value = POSITIVE_FACE_VALUES[gas.convection]
        self.transport = Transport(
            grid, wind, air, face_value, Pass(add_sources, self.release.cells), scalar=scalar
        )
        self.c = self.transport.q
        self.begin(gas, t, seed)

    def begin(self, model: EulerianGas, t: float = 0.0, seed: int = 0) -> None:
        """Raises ValueError for a source in no air."""
        self.species = model.vapour
        self.release.begin(model.sources)
        for emission, source in zip(self.emissions, model.sources, strict=True):
            emission.begin(source, t, seed, self.species)
        self.transport.begin(self.species.diffusivity, self._carrier.schmidt)
        self.emitted_kg = self.initial_kg = 0.0

    def start_from(self, concentration: Callable[[np.ndarray], np.ndarray]) -> None:
        """Set c from a function of points (..., dim) [m] to concentrations [kg/m³]."""
        solid = self._solid
        self.transport.start_from(lambda points: np.where(solid, 0.0, concentration(points)))
        self.initial_kg = self.transport.inside()

    # ---------------------------------------------------------------- the step

    def advance(self, t: float, dt: float) -> None:
        """Emit and disperse from t to t + dt, in as many steps as keep the gas positive."""
        steps = self.transport.steps(dt)
        h = dt / steps
        for n in range(steps):
            self._emit(t + n * h, h)
            self.transport.step(h)

    def _emit(self, t: float, dt: float) -> None:
        masses = [emission.mass(t, dt) for emission in self.emissions]
        self.release.set_amounts(masses)
        self.emitted_kg += sum(masses)

    # ---------------------------------------------------------------- what is known about the gas

    def budget(self) -> dict[str, float]:
        """Mass that was there at the begin, where any was, emitted, in the domain and gone through its faces [kg]."""
        return {
            **({"initial_kg": self.initial_kg} if self.initial_kg else {}),
            "emitted_kg": self.emitted_kg,
            "in_domain_kg": self.transport.inside(),
            "outflow_kg": self.transport.outflow(),
        }

    def cells(self, t: float) -> np.ndarray:
        """Concentration of every cell [kg/m³], of the grid's shape; the time is the solver's own."""
        return self.grid.read(self.c)

    def is_finite(self) -> bool:
        """Whether every concentration is a number."""
        return isfinite(self.budget()["in_domain_kg"])

    def least(self) -> float:
        """Smallest concentration [kg/m³]."""
        return self.transport.least()

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at point x [m], linear between the centres of cells that hold air."""
        return sample_cells(self.c, self.air, x, self.grid.dx, self.grid.ghost, self.grid.padded)
