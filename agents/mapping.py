"""Kinds of online gas maps, and the maps of a run."""

from collections.abc import Sequence

from taichi_plume.agents.gas_map import Floor, GasMap
from taichi_plume.agents.gmrf import MarkovMap
from taichi_plume.agents.kernel_dm import KernelMap
from taichi_plume.agents.snapshots import InverseDistanceMap
from taichi_plume.agents.time_series import TimeSeriesMap
from taichi_plume.agents.tomography import BeamMap
from taichi_plume.agents.wind_map import WindMap
from taichi_plume.scenario.maps import Map

KINDS: dict[str, type[GasMap]] = {
    "time_series": TimeSeriesMap,
    "inverse_distance": InverseDistanceMap,
    "kernel_dmv": KernelMap,
    "gmrf": MarkovMap,
    "wind_gmrf": WindMap,
}
"""Gas map classes by their `kind` in the scenario. Add a kind of map here."""


def mappers(models: Sequence[Map], floor: Floor) -> list[GasMap]:
    """Return the online gas maps for the map sections `models`; maps with equal snapshots share the snapshots."""
    shared: dict = {}
    for model in models:
        KINDS[model.kind].reserve(model, floor, shared)
    return [_kind(model, floor).made(model, floor, shared) for model in models]


def _kind(model: Map, floor: Floor) -> type[GasMap]:
    return BeamMap if model.takes_beams and floor.lasers else KINDS[model.kind]
