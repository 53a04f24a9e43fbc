"""Initial conditions: sets wind, gas and temperature at the start of the warm-up, from formulas or a film."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np

from taichi_plume.assembly.resources import Resources
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.initial_conditions import NO_UNITS, FilmedInitial, Initial, Units, units_of
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario

if TYPE_CHECKING:
    from taichi_plume.grid.fields import Gas, Wind
    from taichi_plume.scenario.sources import OtherSpecies
    from taichi_plume.solvers.flow import FlowSolver
    from taichi_plume.solvers.gas import EulerianSolver

Places = Callable[[np.ndarray], np.ndarray]
"""Values (...), or (..., dim) of a vector, at points (..., dim) [m]."""


def set_initial_conditions(
    scenario: Scenario, resources: Resources, wind: "Wind", gases: "Sequence[Gas]"
) -> None:
    """Set wind, heat and gases with an `initial` section, before the first step. Raises ScenarioError."""
    extent = scenario.domain.extent
    flow, solver = scenario.wind.computed, cast("FlowSolver", wind)
    if flow is not None and flow.initial is not None:
        start = flow.initial
        solver.start_from(
            _filmed(start, "wind.initial", resources) if start.film else _formulas(start, extent)
        )
    heat = scenario.heat
    if heat is not None and heat.initial is not None:
        solver.heat.start_from(_formulas(heat.initial, extent))
    for (path, gas), part in zip(scenario.gases, gases, strict=True):
        if isinstance(gas, EulerianGas) and gas.initial is not None:
            values = _formulas(gas.initial, extent, units_of(gas.vapour))
            if gas.initial.film:
                values = _filmed(gas.initial, f"{path}.initial", resources, gas.species)
            cast("EulerianSolver", part).start_from(values)


def _filmed(
    model: FilmedInitial, path: str, resources: Resources, species: "str | OtherSpecies | None" = None
) -> Places:
    """Return a function of points [m] that gives the recorded velocity, or a species' concentration, of a film."""
    from taichi_plume.files.film import FilmError  # brings zarr

    film = resources.films[path]
    try:
        if model.part == "wind":
            return film.velocity(model.at)
        return film.concentration(film.gas_of(species), model.at)
    except FilmError as error:
        raise ScenarioError([f"{path}.film: {error}"]) from None


def _formulas(model: Initial, extent: tuple[float, ...], units: Units = NO_UNITS) -> Places:
    """Return a function of points [m]: the values of the formulas, and 0 where a formula has no finite value.

    extent: size of the domain [m]; points outside take the values at its faces.
    """

    def places(points: np.ndarray) -> np.ndarray:
        raw = model.values(np.clip(points, 0.0, extent), units)
        values = np.where(np.isfinite(raw), raw, 0.0)
        return values[0] if len(values) == 1 else np.moveaxis(values, 0, -1)

    return places
