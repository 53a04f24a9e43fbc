"""From a YAML file to a Scenario; whatever is wrong with the file is told in one line per fault."""

import difflib
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.guard.yaml_text import MOST_VALUES, LineError, parse, read_text, weight
from taichi_plume.scenario.changes import changed, path_of, shown, steps_of
from taichi_plume.scenario.scenario import Scenario

MOST_LINES = 20
NEEDS = "a scenario needs at least duration, domain, wind and gas"

_NO_KIND = "\0"  # stands for a missing kind, so that pydantic lists the known ones


class ScenarioError(ValueError):
    """A scenario that cannot be run. `faults`: all that is wrong, a line each with the YAML path first; `lines`: those
    that are shown.
    """

    def __init__(self, lines: Sequence[str]):
        self.faults = [visible(line) for line in lines]
        more = len(lines) - MOST_LINES
        self.lines = [*self.faults[:MOST_LINES], *([f"... and {more} more"] if more > 0 else [])]
        super().__init__("\n".join(self.lines))


def read_mapping(path: Path, needs: str) -> dict[str, Any]:
    """The keys and values of a YAML file. needs: what such a file has at least, in words. Raises ScenarioError."""
    try:
        data = parse(read_text(path))
    except LineError as fault:
        raise ScenarioError([f"{path}: {fault}"]) from None
    if data is None:
        raise ScenarioError([f"{path}: is empty; {needs}"])
    if not isinstance(data, dict):
        raise ScenarioError([f"{path}: must be a mapping (key: value), got {shown(data)}"])
    return data


def read_scenario(
    source: Path | Mapping[str, Any],
    overrides: Sequence[str] = (),
    expand: Callable[[dict[str, Any]], dict[str, Any]] | None = None,
) -> Scenario:
    """Scenario of a YAML file, or of such data, with overrides such as ``robots.0.count=3``; no file of it is opened.

    expand: applied to the data before the overrides. Raises ScenarioError.
    """
    data = read_mapping(source, NEEDS) if isinstance(source, Path) else dict(source)
    where = f"{source}: " if isinstance(source, Path) else ""
    if expand is not None:
        data = expand(data)
    if "base" in data and "axes" in data:
        raise ScenarioError([f"{where}is a study, no scenario; python -m taichi_plume.study makes its runs"])
    for override in overrides:
        try:
            data = _overridden(data, override)
        except LineError as fault:
            raise ScenarioError([f"override '{visible(override, LONGEST_VALUE)}': {fault}"]) from None
    try:
        return scenario_from(data)
    except ScenarioError as error:
        raise ScenarioError([f"{where}{line}" for line in error.faults]) from None


def scenario_of(data: Mapping[str, Any], changes: Mapping[str, Any]) -> Scenario:
    """Scenario of these data with other values at the paths of keys such as ``robots[0].count``.

    Values may be sections and lists. Raises ScenarioError.
    """
    try:
        return scenario_from(changed(data, changes))
    except LineError as fault:
        raise ScenarioError([str(fault)]) from None


def scenario_from(data: dict[str, Any]) -> Scenario:
    """The scenario of these data, as YAML has them. Raises ScenarioError."""
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(explain(error, data)) from None
    values = _values(scenario.model_dump(mode="json", exclude_none=True))
    if values > MOST_VALUES:
        raise ScenarioError(
            [
                f"has {values:,} values once every default is written out, {MOST_VALUES:,} are taken; use "
                "fewer obstacles, groups of robots, or way points"
            ]
        )
    return scenario


def _values(data: Any) -> int:
    """How many values and keys the YAML of `data` has."""
    if isinstance(data, dict):
        return 1 + sum(1 + _values(part) for part in data.values())
    return 1 + sum(map(_values, data)) if isinstance(data, list) else weight(data)


def load_part(text: str, where: str, kind: Any) -> Any:
    """A part of a scenario of this type, told in YAML such as ``{kind: gmrf, cell: 0.1}``; where: its name in messages.

    Raises ScenarioError.
    """
    try:
        data = {where: parse(text)}
    except LineError as fault:
        raise ScenarioError([f"{where}: {fault}"]) from None
    validate = TypeAdapter(dict[str, kind]).validate_python
    try:
        return validate(data)[where]
    except ValidationError as error:
        raise ScenarioError(explain(error, data, validate)) from None


# ---------------------------------------------------------------- overrides


def overridden(overrides: Sequence[str]) -> list[str]:
    """The paths of the keys that overrides give, such as ``robots[0].count``."""
    return [path_of(steps_of(override.partition("=")[0])) for override in overrides]


def _overridden(data: dict[str, Any], override: str) -> dict[str, Any]:
    """The data with ``path.to.key=value`` in it."""
    path, equals, text = override.partition("=")
    if not equals or not all(steps_of(path)):
        raise LineError("must be path.to.key=value, such as robots.0.count=3")
    return changed(data, {path: parse(text)})


# ---------------------------------------------------------------- what pydantic found


def explain(
    error: ValidationError, data: dict, validate: Callable[[dict], object] = Scenario.model_validate
) -> list[str]:
    """What is wrong with `data`, a line per fault; validate: what told it."""
    faults = error.errors(include_url=False)
    nameless = [
        _walk(fault["loc"], data)
        for fault in faults
        if fault["type"] == "union_tag_not_found"
        or (fault["type"] == "missing" and fault["loc"][-1] == "kind")
    ]
    if nameless:
        kinds = {path_of([*steps, "kind"]): _NO_KIND for steps in nameless}
        data = changed(data, kinds)
        try:
            validate(data)
        except ValidationError as again:
            faults = again.errors(include_url=False)
    lines = dict.fromkeys(_line(fault, data) for fault in faults)
    return [line for line in lines if line]


def _line(fault: Any, data: dict) -> str | None:
    """`path: what is wrong` for one pydantic error; None where another error says it better."""
    kind, got, context = fault["type"], fault["input"], fault.get("ctx", {})
    steps = _walk(fault["loc"], data, absent=kind == "missing")
    member = fault["loc"][-1] if fault["loc"] else ""
    if kind == "missing":
        parent, key = path_of(steps[:-1]), steps[-1]
        if isinstance(key, int):
            return f"{parent}: too few numbers: item {key} is missing"
        return f"{parent}: missing key '{key}'" if parent else f"missing key '{key}'"
    where = f"{path_of(steps)}: " if steps else ""
    union = isinstance(member, str) and (member[:1].isupper() or member.startswith("tagged-union["))
    if kind in ("model_type", "model_attributes_type") and union:
        return None  # a section where there may also be a name: the list of names says it
    if kind == "literal_error":
        if isinstance(got, dict) and str(member).startswith("literal["):
            return None  # a section where there may also be a name
        names = re.findall(r"'((?:[^'\\]|\\.)*)'", context["expected"])
        if got == _NO_KIND:
            parent = f"{path_of(steps[:-1])}: " if steps[:-1] else ""
            return f"{parent}missing key 'kind'; known kinds: {', '.join(names)}"
        return f"{where}got {shown(got)}; {_meant(got, names)}allowed: {', '.join(names)}"
    if kind == "union_tag_invalid":
        names = re.findall(r"'([^']*)'", context["expected_tags"])
        if context["tag"] == _NO_KIND:
            return f"{where}missing key 'kind'; known kinds: {', '.join(names)}"
        tag = visible(context["tag"], LONGEST_VALUE)
        return f"{where}unknown kind '{tag}'; {_meant(tag, names)}known kinds: {', '.join(names)}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"{where}must be a mapping (key: value), got {shown(got)}"
    if kind == "tuple_type":
        return f"{where}must be a list, got {shown(got)}"
    if kind == "string_pattern_mismatch":
        letters = "at most 64 letters, digits, '_', '.' or '-', the first a letter or digit"
        return f"{where}got {shown(got)}: must be {letters}"
    if kind in ("too_long", "too_short"):
        bound = "at most" if kind == "too_long" else "at least"
        limit = context.get("max_length", context.get("min_length"))
        if kind == "too_short" and len(got) >= limit:
            return None  # pydantic leaves out items that have faults of their own
        return f"{where}must have {bound} {limit} item{'s' * (limit > 1)}, got {len(got)}"
    if kind in ("float_parsing", "float_type"):
        key = next((step for step in reversed(steps) if isinstance(step, str)), "")
        such = " of degrees, such as 90" if key.endswith("_deg") else ", such as 0.08"
        return f"{where}got {shown(got)}: must be a plain number{such}"
    if kind == "fault":
        return where + fault["msg"]
    message = re.sub(r"^(Input|String|Value) should", "must", fault["msg"]).replace("valid string", "text")
    return f"{where}got {shown(got)}: {message}"


def _walk(location: tuple[int | str, ...], data: Any, absent: bool = False) -> list[int | str]:
    """The YAML path of an error: pydantic's location without the names of union members in it.

    absent: the last step is a key that is missing.
    """
    steps: list[int | str] = []
    place = data
    known = None  # the section whose kind was the step before
    for n, step in enumerate(location):
        if isinstance(place, dict):
            if place.get("kind") == step and place is not known:
                known = place  # a section may have a key of the same name
                continue
            if step not in place and not (absent and n == len(location) - 1):
                continue  # the model's name
            place = place.get(step)
        elif isinstance(place, (list, tuple)) and isinstance(step, int):
            place = place[step] if step < len(place) else None
        else:
            continue
        steps.append(step)
    return steps


def _meant(got: Any, names: Sequence[str]) -> str:
    close = difflib.get_close_matches(str(got), names, n=1)
    return f"did you mean '{close[0]}'? " if close else ""
