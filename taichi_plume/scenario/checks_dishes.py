"""What a scenario lacks for its dishes of liquid."""

from collections.abc import Iterator

from taichi_plume.scenario.gases import PlaybackGas
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.species import PRESSURE


def dishes(scenario: Scenario) -> Iterator[str]:
    """The species of a dish has to be known as a liquid, which must not boil."""
    for path, gas in scenario.gases:
        if isinstance(gas, PlaybackGas):
            continue  # nothing evaporates, whatever the robots search for
        for n, source in enumerate(gas.sources):
            dish, species = getattr(source, "dish", None), gas.vapour
            if dish is None:
                continue
            where = f"{path}.sources[{n}].dish"
            if species.antoine is None and species.vapour_pressure is None:
                yield f"{path}.species: missing key 'vapour_pressure', at the temperature of {where}"
            elif species.saturation(dish.temperature, dish.temperature) >= PRESSURE:
                pressure = species.saturation(dish.temperature, dish.temperature)
                yield (
                    f"{where}.temperature: at {dish.temperature:g} K {species.name} boils, its vapour pressure is "
                    f"{pressure / 1e3:.4g} kPa; must be below {PRESSURE / 1e3:g} kPa"
                )
            if dish.cooling and species.latent_heat is None:
                yield f"{path}.species: missing key 'latent_heat'; without it, set {where}.cooling: false"
