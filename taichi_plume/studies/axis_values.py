"""Resolve the axes of a study: convert values to SI units as the scenario does, and report invalid values."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from taichi_plume.scenario.changes import shown, steps_of
from taichi_plume.scenario.key_facts import facts
from taichi_plume.scenario.keys import look_up, near
from taichi_plume.scenario.loading import ScenarioError, scenario_of
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import Model
from taichi_plume.studies.axes import DIGITS, Level, Levels, Range
from taichi_plume.studies.given_classes import labels
from taichi_plume.studies.messages import Data, Value
from taichi_plume.studies.study_keys import Study, StudyAxis, canonical

Changes = Mapping[str, object]


def resolve(study: Study, base: Changes, name: str) -> list[Levels | Range]:
    """Resolve the axes of a study. base: data of the base scenario; name: its file name. Raises ScenarioError."""
    return _Resolving(study, base, name).axes()


class _Resolving:
    """Check of the axes of a study: each value is tried together with the first value of every other axis."""

    def __init__(self, study: Study, base: Changes, name: str):
        self.study, self.base, self.name = study, base, name
        self.trials = {name: list(_trials(axis)) for name, axis in study.axes.items()}
        self.base_faults = self._faults({})
        self.faults: list[str] = []

    def axes(self) -> list[Levels | Range]:
        common = self._tried(self._first())
        if isinstance(common, Scenario):
            common = []
        self._report_common(common)
        found = {name: self._scenarios(name, common) for name in self.study.axes}
        if self.faults:
            raise ScenarioError(list(dict.fromkeys(self.faults)))
        axes = [self._axis(name, axis, found[name]) for name, axis in self.study.axes.items()]
        if self.faults:
            raise ScenarioError(self.faults)
        return [axis for axis in axes if axis is not None]

    def _first(self, without: str = "") -> Data:
        """Return the scenario changes of the first value of every axis, except the axis `without`; by path."""
        firsts = [trials[0][1] for name, trials in self.trials.items() if name != without]
        return {key: value for changes in firsts for key, value in changes.items()}

    def _tried(self, changes: Changes) -> Scenario | list[str]:
        try:
            return scenario_of(self.base, changes)
        except ScenarioError as error:
            return error.faults

    def _report_common(self, common: list[str]) -> None:
        """Report errors of the base, and errors that only a combination of first values has."""
        for line in common:
            if line in self.base_faults:
                self.faults.append(f"{self.name}: {line}")
            elif sum(line in self._faults(trials[0][1]) for trials in self.trials.values()) != 1:
                self.faults.append(f"axes: with the first value of each: {line}")

    def _faults(self, changes: Changes) -> list[str]:
        tried = self._tried(changes)
        return [] if isinstance(tried, Scenario) else tried

    def _scenarios(self, name: str, common: list[str]) -> list[Scenario]:
        """Return the scenario for each value of an axis. An error that several values share is reported once."""
        found: list[Scenario] = []
        others = self._first(without=name)
        refused: dict[str, list[str]] = {}
        own = set(self._faults(self.trials[name][0][1])) - set(self.base_faults)
        for where, changes in self.trials[name]:
            tried = self._tried(others | changes)
            if isinstance(tried, Scenario):
                found.append(tried)
                continue
            for line in tried:
                if line not in common or line in own:
                    refused.setdefault(line, []).append(where)
        for line, places in refused.items():
            every = len(places) == len(self.trials[name]) > 1
            self.faults.append(f"axes.{name}{'' if every else places[0]}: {line}{self._meant(name, line)}")
        return found

    def _meant(self, name: str, line: str) -> str:
        """Return a hint with similarly spelt keys for an unknown key of an axis, unless the error has such a hint."""
        if "unknown key" in line:
            return ""
        unknown = [path for path in self.study.axes[name].paths if not any(look_up(path))]
        close = [key for path in unknown for key in near(path)]
        return f"; did you mean {' or '.join(dict.fromkeys(close))}?" if close else ""

    # ------------------------------------------------------------ values

    def _axis(self, name: str, axis: StudyAxis, found: list[Scenario]) -> Levels | Range | None:
        paths, unit = axis.paths, ""
        if axis.variants is not None:
            changes = [trial for _, trial in self.trials[name]]
            return Levels(name, "", list(map(Level, axis.variants, changes)))
        given = axis.values or (axis.low, axis.high)
        read = [_read(scenario, paths[0], value) for scenario, value in zip(found, given, strict=True)]
        values = [value for value, _ in read]
        if all(type(value) in (int, float) for value in values):
            unit = read[0][1]
        if axis.values is not None:
            return Levels(name, unit, self._levels(name, axis, values))
        return self._range(name, axis, values, unit)

    def _levels(self, name: str, axis: StudyAxis, values: list[Any]) -> list[Level]:
        """Return an axis's values with their scenario changes. With a list or section, `labels` names all."""
        assert axis.values is not None
        plain = all(isinstance(value, Value) and not _too_large(value) for value in values)
        shown_values: list[Value] = values if plain else [*labels(axis.values)]
        for n, value in enumerate(shown_values):
            if value in shown_values[:n]:
                self.faults.append(f"axes.{name}.values[{n}]: {shown(axis.values[n])} occurs twice")
        return [
            Level(value, dict.fromkeys(axis.paths, given))
            for value, given in zip(shown_values, axis.values, strict=True)
        ]

    def _range(self, name: str, axis: StudyAxis, ends: list[Any], unit: str) -> Levels | Range | None:
        where, log = f"axes.{name}", axis.spacing == "log"
        if not all(type(value) in (int, float) for value in ends):
            self.faults.append(f"{where}: {axis.paths[0]} is not a number; give values, not low and high")
            return None
        low, high = map(float, ends)
        if low >= high:
            self.faults.append(f"{where}: low must be less than high, got {low:g} and {high:g}")
        elif log and low <= 0:
            self.faults.append(f"{where}.low: got {low:g}: must be more than 0 with spacing: log")
        elif axis.sampled and isinstance(ends[0], int):
            self.faults.append(f"{where}: {axis.paths[0]} takes whole numbers; give values, or count")
        elif axis.sampled:
            return Range(name, unit, axis.paths, low, high, log)
        else:
            assert axis.count is not None
            values = (np.geomspace if log else np.linspace)(low, high, axis.count)
            numbers: list[Any] = [float(f"{value:.{DIGITS}g}") for value in values]
            if isinstance(ends[0], int):
                broken = next((value for value in numbers if value != int(value)), None)
                if broken is not None:
                    kinds = f"{axis.paths[0]} takes whole numbers, got {broken:g}"
                    self.faults.append(f"{where}: {kinds}; change count, or give values")
                numbers = list(map(int, numbers))
            return Levels(name, unit, [Level(value, dict.fromkeys(axis.paths, value)) for value in numbers])
        return None


def _trials(axis: StudyAxis) -> Iterable[tuple[str, Data]]:
    """Yield each value of an axis: its path below the axis, for messages, and its changes to the scenario."""
    if axis.variants is not None:
        for name, changes in axis.variants.items():
            yield f".variants.{name}", {canonical(key): value for key, value in changes.items()}
    elif axis.values is not None:
        for n, value in enumerate(axis.values):
            yield f".values[{n}]", dict.fromkeys(axis.paths, value)
    else:
        for end in ("low", "high"):
            yield f".{end}", dict.fromkeys(axis.paths, vars(axis)[end])


def _read(scenario: Scenario, path: str, given: object) -> tuple[Any, str]:
    """Return a scenario's value at a path in SI units, and the unit.

    A number given for a list of one item stays a number.
    """
    value: Any = scenario
    unit = ""
    try:
        for step in steps_of(path):
            if isinstance(value, Model):
                unit = facts(type(value), step).unit
                value = vars(value)[step]
            else:
                value = value[int(step) if isinstance(value, list | tuple) else step]
    except LookupError:
        return given, ""
    single = isinstance(value, tuple) and len(value) == 1 and not isinstance(given, list)
    return value[0] if single else value, unit


def _too_large(value: object) -> bool:
    """Whether an integer exceeds the 64 bits of a table's column."""
    return isinstance(value, int) and not -(1 << 63) <= value < 1 << 63
