"""The scenario of a run: the base with the changes that its study makes."""

from typing import Any

from taichi_plume.scenario.changes import path_of, steps_of
from taichi_plume.scenario.scenario import Scenario


def value_at(scenario: Scenario, path: str) -> Any:
    """What a scenario has at the path of a key, in SI units. Raises LookupError."""
    place: Any = scenario
    for step in steps_of(path):
        if isinstance(place, list | tuple):
            place = place[int(step)]
        elif isinstance(place, dict):
            place = place[step]
        else:
            place = vars(place)[step]
    return place


def canonical(path: str) -> str:
    """The one way of writing a path: ``robots.00.count`` is ``robots[0].count``."""
    return path_of([str(int(step)) if step.isdecimal() else step for step in steps_of(path)])
