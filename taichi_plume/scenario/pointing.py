"""Where in the room what a remark is about lies: for numbers in a drawing of the scene."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.scenario.domain import Arena, Located
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.starts import StartArea
from taichi_plume.scenario.vocabulary import sections
from taichi_plume.scenario.windows import Window

if TYPE_CHECKING:
    from taichi_plume.assembly.resources import Resources


def numbered(
    remarks: Sequence[str], scenario: Scenario, resources: "Resources"
) -> list[tuple[int, tuple[float, ...]]]:
    """Number, counted from 1, and place [m] of each remark about something that has one: 2 or 3 coordinates."""
    places: dict[str, tuple[float, ...]] = {}
    for key in Scenario.model_fields:
        for where, section in sections(vars(scenario)[key], key):
            place = _place(where, section, scenario, resources)
            if place is not None:
                places[where] = tuple(float(x) for x in place)
    found = []
    for n, remark in enumerate(remarks, 1):
        path = remark.partition(": ")[0]
        fits = [where for where in places if path == where or path.startswith((f"{where}.", f"{where}["))]
        if fits:
            found.append((n, places[max(fits, key=len)]))
    return found


def _place(where: str, section: Any, scenario: Scenario, resources: "Resources") -> Any:
    extent = scenario.domain.extent
    if isinstance(section, Located):
        return section.position
    if isinstance(section, Window):
        return np.insert(section.rectangle(extent)[0], section.normal, section.level(extent))
    if where in resources.shapes:
        shape = resources.shapes[where]
        return (shape.low + shape.high) / 2
    if isinstance(section, Group):
        places = section.places(scenario.floor)
        if isinstance(section.start, StartArea):
            return np.mean([section.start.low, section.start.high], axis=0)
        return None if places is None else places[0]
    return np.mean([section.low, section.high], axis=0) if isinstance(section, Arena) else None
