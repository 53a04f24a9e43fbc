"""Mobile-robot olfaction in one process: air flow, gas, robots, maps and a recording from one YAML file."""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

# Before the first import of taichi, here or elsewhere: no banner.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

if TYPE_CHECKING:
    from taichi_plume.prepare import load_scenario
    from taichi_plume.scenario.scenario import Scenario
    from taichi_plume.simulation import Simulation

__version__ = "0.1.0"
__all__ = ["Scenario", "Simulation", "load_scenario"]


def __getattr__(name: str) -> Any:
    """The public names, imported when first used: `import taichi_plume` alone is instant."""
    where = {
        "Scenario": "scenario.scenario",
        "Simulation": "simulation",
        "load_scenario": "prepare",
    }
    if name not in where:
        raise AttributeError(f"module 'taichi_plume' has no attribute '{name}'")
    return getattr(import_module(f"taichi_plume.{where[name]}"), name)
