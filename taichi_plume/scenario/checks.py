"""Checks of a whole scenario: errors and warnings of all sections, and their positions in the room."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.scenario import warnings
from taichi_plume.scenario.domain import Arena, Context, Located
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.size import too_large
from taichi_plume.scenario.starts import StartArea
from taichi_plume.scenario.vocabulary import Model, sections
from taichi_plume.scenario.windows import Window

if TYPE_CHECKING:
    from taichi_plume.assembly.resources import Resources

FIRST = ("obstacles", "gas", "arena", "robots", "wind")  # these come first in messages


def every(scenario: Scenario) -> Iterator[tuple[str, Model]]:
    """Yield every section with its path, in the order of messages; the scenario itself comes last."""
    for key in sorted(
        Scenario.model_fields, key=lambda key: FIRST.index(key) if key in FIRST else len(FIRST)
    ):
        yield from sections(vars(scenario)[key], key)
    yield "", scenario


def early_errors(scenario: Scenario) -> list[str]:
    """Return errors ``path: message`` of the dimension (2-D or 3-D) and the memory, before files are opened."""
    dim = scenario.domain.dim
    lines = [line for where, section in every(scenario) for line in section.dimension_errors(where, dim)]
    return lines or list(too_large(scenario))


def remarks(scenario: Scenario, resources: "Resources") -> list[str]:
    """Return warnings ``path: message`` of a scenario without errors."""
    context = Context(scenario, resources)
    lines = [line for where, section in every(scenario) for line in section.remarks(where, context)]
    return [*lines, *warnings.remarks(context)]


def problems(scenario: Scenario, resources: "Resources") -> list[str]:
    """Return the other errors of a scenario whose files have been opened.

    Errors of files are reported alone: the other checks need all files and shapes.
    """
    context = Context(scenario, resources)
    if resources.faults:
        return [f"{path}: {fault}" for path, fault in resources.faults.items()]
    lines = [line for where, section in every(scenario) for line in section.unusable(where, context)]
    return lines or [line for where, section in every(scenario) for line in section.problems(where, context)]


def numbered(
    remarks: Sequence[str], scenario: Scenario, resources: "Resources"
) -> list[tuple[int, tuple[float, ...]]]:
    """Return the number (from 1) and the position [m] (2 or 3 coordinates) of each warning that has a position."""
    places: dict[str, tuple[float, ...]] = {}
    for key in Scenario.model_fields:
        for where, section in sections(vars(scenario)[key], key):
            place = _place(where, section, scenario, resources)
            if place is not None:
                places[where] = tuple(float(x) for x in place)
    positions = []
    for n, remark in enumerate(remarks, 1):
        path = remark.partition(": ")[0]
        fits = [where for where in places if path == where or path.startswith((f"{where}.", f"{where}["))]
        if fits:
            positions.append((n, places[max(fits, key=len)]))
    return positions


def _place(
    where: str, section: Model, scenario: Scenario, resources: "Resources"
) -> Sequence[float] | np.ndarray | None:
    """Return the position [m] of a section; None for a section without a position."""
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
