"""Sets wind, gas and heat to what a scenario says of the begin of its warm-up."""

from collections.abc import Callable
from typing import Any

import numpy as np

from taichi_plume.assembly.resources import Resources
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.initial import NO_UNITS, FilmedInitial, Initial, Units, units_of
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario

Places = Callable[[np.ndarray], np.ndarray]
"""Values (...), or (..., dim) of a vector, at points (..., dim) [m]."""


def begin_fields(scenario: Scenario, resources: Resources, wind: Any, gases: tuple[Any, ...]) -> None:
    """Set what has an `initial` section, once all has begun. Raises ScenarioError where a film is damaged."""
    extent = scenario.domain.extent
    flow = scenario.wind.computed
    if flow is not None and flow.initial is not None:
        start = flow.initial
        wind.start_from(_filmed(start, "wind.initial", resources) if start.film else _formulas(start, extent))
    heat = scenario.buoyancy.heat if scenario.buoyancy is not None else None
    if heat is not None and heat.initial is not None:
        wind.heat.start_from(_formulas(heat.initial, extent))
    for (path, gas), solver in zip(scenario.gases, gases, strict=True):
        if isinstance(gas, EulerianGas) and gas.initial is not None:
            start, where = gas.initial, f"{path}.initial"
            units = units_of(gas.vapour)
            told = (
                _filmed(start, where, resources, gas.species)
                if start.film
                else _formulas(start, extent, units)
            )
            solver.start_from(told)


def _filmed(model: FilmedInitial, path: str, resources: Resources, species: Any = None) -> Places:
    """The wind, or the gas of a species, that a section's film shows."""
    from taichi_plume.files.film import FilmError  # brings zarr

    film = resources.films[path]
    try:
        if model.part == "wind":
            return film.velocity(model.at)
        return film.concentration(film.gas_of(species), model.at)
    except FilmError as error:
        raise ScenarioError([f"{path}.film: {error}"]) from None


def _formulas(model: Initial, extent: tuple[float, ...], units: Units = NO_UNITS) -> Places:
    """Scalars, or vectors, of the formulas; 0 where they have no value, which is inside of obstacles.

    Beyond the domain, of that extent [m], the values at its faces hold.
    """

    def places(points: np.ndarray) -> np.ndarray:
        found = model.values(np.clip(points, 0.0, extent), units)
        values = np.where(np.isfinite(found), found, 0.0)
        return values[0] if len(values) == 1 else np.moveaxis(values, 0, -1)

    return places
