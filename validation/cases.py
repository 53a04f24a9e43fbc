"""Table of all cases and experiments by name: each module of MODULES lists its own in `CASES`."""

from importlib import import_module

from taichi_plume.validation.case import Case
from taichi_plume.validation.experiment import Experiment

MODULES = """
flow_cases channel_cases cavity body_cases bluff_body dispersion_cases source_cases balance_cases wall_cases
symmetry_cases heat_cases cross_checks jet inflow_cases import_cases near_source near_source_mean plume_cases
puff_cases turbulent_whiffs annex20 backward_step tunnel_plume red_vapor orebro_office bouts_distance sensor_records
helium_box plume_edge open_path calibration_box plumesim_cases hybrid_cases plumesim_figures spiral_area spiral_cases
spiral_scan spiral_gas spiral_persons dapso_cases infotaxis_cases mapping_cases mapping_scan mapping_next
source_term_cases room_air_cases rotor_cases
"""


def _all() -> dict[str, Case | Experiment]:
    """Return the cases and experiments of all modules, by name."""
    modules = [import_module(f"taichi_plume.validation.{name}") for name in MODULES.split()]
    return {case.name: case for module in modules for case in module.CASES}


CASES = _all()
