"""The scenario of a run: the base with the changes that its study makes."""

from collections.abc import Mapping
from typing import Any

from taichi_plume.guard.yaml_text import LineError
from taichi_plume.scenario.changes import changed, path_of, steps_of
from taichi_plume.scenario.loading import ScenarioError, scenario_from
from taichi_plume.scenario.scenario import Scenario


def scenario_of(base: Mapping[str, Any], changes: Mapping[str, Any]) -> Scenario:
    """The scenario of a base's data, as YAML has them, with other values at the paths of keys such as
    ``robots[0].count``; its files have not been opened. Values may be sections and lists. Raises ScenarioError.
    """
    try:
        data = changed(base, changes)
    except LineError as fault:
        raise ScenarioError([str(fault)]) from None
    return scenario_from(data)


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
