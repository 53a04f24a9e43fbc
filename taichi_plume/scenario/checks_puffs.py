"""What is wrong with a scenario's puffs."""

from collections.abc import Iterator

from taichi_plume.scenario.gases import PuffGas
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import CfdWind


def puffs(scenario: Scenario) -> Iterator[str]:
    """Lines ``path: message``."""
    domain, wind = scenario.domain, scenario.wind
    weighs = isinstance(wind, CfdWind) and wind.buoyancy is not None and wind.buoyancy.solutal
    for path, gas in scenario.gases:
        if not isinstance(gas, PuffGas):
            continue
        if gas.buoyancy and domain.dim == 2:
            yield f"{path}.buoyancy: is for 3-D runs; remove it, or give domain.size three numbers"
        if gas.initial_size > 0.5 * min(domain.extent):
            yield (
                f"{path}.initial_size: puffs of {gas.initial_size:g} m do not fit a domain that is "
                f"{min(domain.extent):g} m across; make them smaller"
            )
        if weighs:
            yield (
                f"{path}.kind: puffs do not weigh on the air; use eulerian, or wind.buoyancy.solutal: false, and "
                f"{path}.buoyancy: true to let them sink by themselves"
            )
