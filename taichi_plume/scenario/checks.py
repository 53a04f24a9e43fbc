"""Checks of a whole scenario: errors and warnings of all sections, and the positions in the room that these concern."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from taichi_plume.scenario import combinations
from taichi_plume.scenario.domain import Arena, Context, Located
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.size import too_large
from taichi_plume.scenario.starts import StartArea
from taichi_plume.scenario.vocabulary import Model, sections
from taichi_plume.scenario.windows import Window


class Check(NamedTuple):
    """Result of the checks of a scenario. Without errors it can be run, and `size` and `derived` are known.

    errors, warnings: lines "key: message". size: estimates for a run: `cells`, `bytes` of memory, `disk` [bytes],
    `steps` of the flow, their length `step` [s], and `wall_s` on a few CPU cores. derived: texts on quantities that
    follow from the scenario, such as Reynolds numbers, by name.
    """

    errors: list[str]
    warnings: list[str]
    size: dict[str, float]
    derived: dict[str, str]

    def __bool__(self) -> bool:
        """Whether there are no errors."""
        return not self.errors


FIRST = ("obstacles", "gas", "arena", "robots", "wind")  # these come first in messages
ORDER = (*FIRST, *(key for key in Scenario.model_fields if key not in FIRST))


def every(scenario: Scenario) -> Iterator[tuple[str, Model]]:
    """Yield (path, section) for every section of a scenario, in the order of messages; the scenario itself is last."""
    for key in ORDER:
        yield from sections(vars(scenario)[key], key)
    yield "", scenario


def early_errors(scenario: Scenario) -> list[str]:
    """Return errors ``path: message`` that need no input files: wrong dimension (2-D or 3-D), too much memory."""
    dim = scenario.domain.dim
    lines = [line for where, section in every(scenario) for line in section.dimension_errors(where, dim)]
    return lines or list(too_large(scenario))


def warnings(context: Context) -> list[str]:
    """Return the warnings of the sections of a scenario without errors, each as a line ``path: message``."""
    parts = every(context.scenario)
    lines = [line for where, section in parts for line in section.warnings(where, context)]
    return [*lines, *combinations.warnings(context)]


def errors(context: Context) -> list[str]:
    """Return the errors of the sections of a scenario, each as a line ``path: message``."""
    parts = every(context.scenario)
    return [line for where, section in parts for line in section.errors(where, context)]


def numbered(lines: Sequence[str], context: Context) -> list[tuple[int, tuple[float, ...]]]:
    """Return (number from 1, position [m] with 2 or 3 coordinates) for each of these warnings that has a position."""
    places: dict[str, tuple[float, ...]] = {}
    for key in Scenario.model_fields:
        for where, section in sections(vars(context.scenario)[key], key):
            place = _place(where, section, context)
            if place is not None:
                places[where] = tuple(float(x) for x in place)
    positions = []
    for n, line in enumerate(lines, 1):
        path = line.partition(": ")[0]
        fits = [where for where in places if path == where or path.startswith((f"{where}.", f"{where}["))]
        if fits:
            positions.append((n, places[max(fits, key=len)]))
    return positions


def _place(where: str, section: Model, context: Context) -> Sequence[float] | np.ndarray | None:
    """Return the position [m] that represents a section, such as its centre; None for a section without one."""
    extent = context.domain.extent
    if isinstance(section, Located):
        return section.position
    if isinstance(section, Window):
        return np.insert(section.rectangle(extent)[0], section.normal, section.level(extent))
    if where in context.shapes:
        shape = context.shapes[where]
        return (shape.low + shape.high) / 2
    if isinstance(section, Group):
        places = section.places(context.scenario.floor)
        if isinstance(section.start, StartArea):
            return np.mean([section.start.low, section.start.high], axis=0)
        return None if places is None else places[0]
    return np.mean([section.low, section.high], axis=0) if isinstance(section, Arena) else None
