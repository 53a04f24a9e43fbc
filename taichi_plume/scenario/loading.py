"""Loading of scenarios from YAML, with a one-line error message for each fault."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.guard.yaml_text import MOST_VALUES, LineError, parse, read_text, weight
from taichi_plume.scenario.changes import Data, ValueLineError, changed, path_of, shown, steps_of, yaml_value
from taichi_plume.scenario.error_messages import explain
from taichi_plume.scenario.scenario import Scenario

MOST_LINES = 20
NEEDS = "a scenario needs at least duration, domain, wind and gas"


class ScenarioError(InputError):
    """A scenario that cannot be run. faults: all errors, each a line with its YAML path; lines: those shown.

    >>> import taichi_plume as tp
    >>> tp.load_scenario("casting_room", {"robots.0.count": 0.5})
    Traceback (most recent call last):
    taichi_plume.scenario.loading.ScenarioError: ...robots[0].count: got 0.5: must be a whole number
    """

    def __init__(self, lines: Sequence[str]):
        self.faults = [visible(line) for line in lines]
        more = len(lines) - MOST_LINES
        shown = [*self.faults[:MOST_LINES], *([f"... and {more} more"] if more > 0 else [])]
        super().__init__(*shown)


def read_mapping(path: Path, needs: str) -> Data:
    """Return the keys and values of a YAML file. needs: hint for an empty file. Raises ScenarioError."""
    try:
        data = parse(read_text(path))
    except LineError as fault:
        raise ScenarioError([f"{path}: {fault}"]) from None
    if data is None:
        raise ScenarioError([f"{path}: is empty; {needs}"])
    if not isinstance(data, dict):
        raise ScenarioError([f"{path}: must be a mapping (key: value), got {shown(data)}"])
    return data


Overrides = Sequence[str] | Mapping[str, object]
"""Changes of keys: texts like ``robots.0.count=3``, or values by their paths, as ``{"robots.0.count": 3}``."""


def read_scenario(
    source: Path | Mapping[str, object],
    overrides: Overrides = (),
    expand: Callable[[Data], Data] | None = None,
) -> Scenario:
    """Return the scenario of a YAML file or a mapping, with overrides; opens no other file.

    expand: function applied to the data before the overrides. Raises ScenarioError.
    """
    data = read_mapping(source, NEEDS) if isinstance(source, Path) else of_python(source)
    where = f"{source}: " if isinstance(source, Path) else ""
    if expand is not None:
        data = expand(data)
    if "base" in data and "axes" in data:
        raise ScenarioError([f"{where}is a study, no scenario; python -m taichi_plume.study makes its runs"])
    data = _overridden(data, overrides)
    try:
        return scenario_from(data)
    except ScenarioError as error:
        raise ScenarioError([f"{where}{line}" for line in error.faults]) from None


def of_python(values: Mapping[str, object]) -> Data:
    """Return a mapping of Python values in the types of YAML, see `yaml_value`. Raises ScenarioError."""
    if not isinstance(values, Mapping):
        raise ScenarioError([f"got {shown(values)}; give a dict of keys and values"])
    try:
        return yaml_value(values)
    except LineError as fault:
        raise ScenarioError([str(fault)]) from None


def scenario_of(data: Mapping[str, Any], changes: Mapping[str, object]) -> Scenario:
    """Return the scenario of `data` with new values at the paths of `changes`, such as ``robots[0].count``.

    Values may be sections and lists. Raises ScenarioError.
    """
    try:
        return scenario_from(changed(data, changes))
    except LineError as fault:
        raise ScenarioError([str(fault)]) from None


def scenario_from(data: Data) -> Scenario:
    """Return the validated scenario of data read from YAML. Raises ScenarioError, with a line for each fault."""
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(explain(error, data)) from None
    # each value takes more than a byte of JSON, so that few scenarios have to be counted
    is_short = len(scenario.model_dump_json(exclude_none=True)) <= MOST_VALUES
    values = 0 if is_short else _values(scenario.model_dump(mode="json", exclude_none=True))
    if values > MOST_VALUES:
        line = f"has {values:,} values with all defaults written out, at most {MOST_VALUES:,} are allowed; use fewer "
        raise ScenarioError([line + "obstacles, groups of robots, or way points"])
    return scenario


def _values(data: object) -> int:
    """Return how many values and keys the YAML of `data` has, to limit its size."""
    if isinstance(data, dict):
        return 1 + sum(weight(key) + _values(part) for key, part in data.items())
    return 1 + sum(map(_values, data)) if isinstance(data, list) else weight(data)


def load_part(value: object, where: str, kind: Any) -> Any:
    """Return a section of the type `kind` from YAML text such as ``{kind: gmrf, cell: 0.1}``, or from Python values.

    where: name of the section in messages. Raises ScenarioError.
    """
    try:
        data = {where: parse(value)} if isinstance(value, str) else yaml_value({where: value})
    except ValueLineError as fault:
        raise ScenarioError([str(fault)]) from None
    except LineError as fault:
        raise ScenarioError([f"{where}: {fault}"]) from None
    adapter = TypeAdapter(dict[str, kind])
    try:
        return adapter.validate_python(data)[where]
    except ValidationError as error:
        raise ScenarioError(explain(error, data, adapter)) from None


# ---------------------------------------------------------------- overrides


def overridden(overrides: Overrides) -> list[str]:
    """Return the paths of the keys that overrides set, such as ``robots[0].count``."""
    return [path_of(steps_of(override.partition("=")[0])) for override in overrides]


def _overridden(data: Data, overrides: Overrides) -> Data:
    """Return a copy of `data` with the overrides applied. Raises ScenarioError."""
    for path, value in values_of(overrides).items():
        try:
            data = changed(data, {path: value})
        except LineError as fault:
            raise ScenarioError([f"override '{visible(path, LONGEST_VALUE)}': {fault}"]) from None
    return data


def values_of(overrides: Overrides) -> Data:
    """Return the values of overrides by their paths, in order. Raises ScenarioError."""
    if isinstance(overrides, Mapping):
        return of_python(overrides)
    if isinstance(overrides, str | bytes) or not isinstance(overrides, Sequence):
        what = "give a list, such as ['robots.0.count=3'], or a dict, such as {'robots.0.count': 3}"
        raise ScenarioError([f"overrides: got {shown(overrides)}; {what}"])
    values: Data = {}
    for override in overrides:
        if not isinstance(override, str):
            raise ScenarioError([f"overrides: got {shown(override)}; give texts, such as 'robots.0.count=3'"])
        try:
            path, value = _parsed(override)
        except LineError as fault:
            raise ScenarioError([f"override '{visible(override, LONGEST_VALUE)}': {fault}"]) from None
        values.pop(path, None)  # the last of equal paths counts, at its place
        values[path] = value
    return values


def _parsed(override: str) -> tuple[str, object]:
    """Return path and value of an override ``path.to.key=value``. Raises LineError."""
    path, equals, text = override.partition("=")
    if not equals or not all(steps_of(path)):
        raise LineError("must be path.to.key=value, such as robots.0.count=3")
    return path, parse(text)
