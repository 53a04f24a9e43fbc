"""The plan of a study: every run that it asks for. All that is wrong with any of them is told before the first one."""

import re
from collections.abc import Iterator, Mapping, Sequence
from math import prod
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from pydantic import TypeAdapter, ValidationError

from taichi_plume.assembly.prepare import expanded
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.error_messages import explain
from taichi_plume.scenario.input_files import outside
from taichi_plume.scenario.loading import NEEDS, ScenarioError, read_mapping, scenario_of
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.study.axes import Levels, Point, Range, count_of, points
from taichi_plume.study.checking import Checks
from taichi_plume.study.ids import Digests, Ids
from taichi_plume.study.messages import Axis, Request
from taichi_plume.study.model import SEEDS, Study
from taichi_plume.study.outcomes import Wanted
from taichi_plume.study.resolving import resolve
from taichi_plume.study.sharing import differs

MOST_RUNS = 100_000
MOST_FOLDERS = 1000  # that tables are laid out in
FEW = 64  # values of an axis by which they are
LONGEST_FOLDER = 100  # characters of a value in its name
SEARCH_STEP = 1_000_003  # between seeds of searches in one air
SEED_RANGE = 1 << 32
MOST_VALUES_TOLD = 3
STUDY_NEEDS = "a study needs at least name, base and axes"
WHOLE = TypeAdapter(int).validate_python
NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")


class Plan(NamedTuple):
    """A study with all of its runs. file: its own; folder: where the base and its files lie; base: the base's data."""

    study: Study
    file: Path
    folder: Path
    base: dict[str, Any]
    axes: tuple[Axis, ...]
    requests: tuple[Request, ...]


def load_plan(file: Path, allow_outside: bool = False) -> Plan:
    """The plan of a study.yaml, every point of which has been checked; no code that it names has been executed.

    allow_outside: whether the base, and files that it names, may lie outside of their folders. Raises ScenarioError,
    with a line for each fault.
    """
    file = Path(file)
    study = read_study(file)
    try:
        return _Planning(study, file, allow_outside).plan()
    except ScenarioError as error:
        raise ScenarioError([f"{file}: {line}" for line in error.faults]) from None


def read_study(file: Path) -> Study:
    """A study.yaml whose base has not been looked at. Raises ScenarioError."""
    data = read_mapping(file, STUDY_NEEDS)
    if "base" not in data and "domain" in data:
        raise ScenarioError(
            [
                f"{file}: is a scenario, no study; python -m taichi_plume.run runs it once, and a study names it as "
                "its base"
            ]
        )
    try:
        study = Study.model_validate(data)
    except ValidationError as error:
        raise ScenarioError([f"{file}: {line}" for line in explain(error, data, Study)]) from None
    faults = study.faults()
    if faults:
        raise ScenarioError([f"{file}: {line}" for line in faults])
    return study


class _Planning:
    def __init__(self, study: Study, file: Path, allow_outside: bool):
        self.study, self.file = study, file
        path = file.parent / study.base
        if not allow_outside and outside(file.parent, study.base):
            raise ScenarioError(
                [
                    f"base: {visible(study.base, LONGEST_VALUE)} lies outside the study's folder; if it is what you "
                    "want to be read, add --allow-outside (in Python: allow_outside=True)"
                ]
            )
        self.base, *_ = expanded(read_mapping(path, NEEDS), path, allow_outside)
        self.folder = path.resolve().parent
        self.checks, self.digests = Checks(self.folder, allow_outside), Digests(self.folder)

    def plan(self) -> Plan:
        study = self.study
        runs = prod(map(count_of, study.axes.values())) * study.draws
        runs *= 1 if study.over_seeds else study.airs * study.searches
        if runs > MOST_RUNS:
            raise ScenarioError(
                [f"has {runs:,} runs; at most {MOST_RUNS:,} are taken, use fewer values or airs"]
            )
        axes = resolve(study, self.base, visible(study.base, LONGEST_VALUE))
        found, faults = self._checked(axes)
        if faults:
            raise ScenarioError(faults)
        requests = tuple(self._requests(found))
        same = _same_runs(requests)
        if same:
            raise ScenarioError([same])
        return Plan(study, self.file, self.folder, self.base, tuple(_columns(axes)), requests)

    # ------------------------------------------------------------ checks

    def _checked(self, axes: Sequence[Levels | Range]) -> tuple["list[_Checked]", list[str]]:
        """All points, each combination of what is no seed looked at once, and what is wrong with them."""
        study = self.study
        wanted, refused, found = Wanted(study.outcomes, study.keep), _Refused(axes), []
        seen: dict[tuple[Any, ...], tuple[int, Ids] | None] = {}
        grid = [axis for axis in axes if isinstance(axis, Levels)]
        seeds = [n for n, axis in enumerate(grid) if set(study.axes[axis.name].paths) <= set(SEEDS)]
        scenario = None
        for point in points(study, axes):
            key = tuple(which for n, which in enumerate(point.which) if n not in seeds)
            if key not in seen:
                seen[key] = None
                try:
                    scenario = self.checks.checked(scenario_of(self.base, point.changes))
                    seen[key] = len(seen) - 1, self._ids(scenario)
                    if wanted.outcomes or wanted.keep:
                        wanted.look(scenario)
                except ScenarioError as error:
                    refused.add(point, error.faults)
                except OSError as error:
                    refused.add(point, [f"{error.filename}: cannot be read: {error.strerror or error}"])
            its = seen[key]
            if its is not None:
                found.append(_Checked(point, *its))
        return found, [*refused.lines(), *(wanted.lines if scenario is not None else [])]

    def _ids(self, scenario: Scenario) -> Ids:
        study, ids = self.study, self.digests.ids(scenario, self.checks.files(scenario))
        shown = study.share_air == "always" and differs(scenario, study.outcomes, study.keep)
        return ids.shown() if shown else ids

    # ------------------------------------------------------------ runs

    def _requests(self, found: "list[_Checked]") -> Iterator[Request]:
        number = 0
        for point, combination, ids in found:
            for seed, air_seed, changes in self._seeds(point.changes):
                yield Request(
                    run=ids.run(seed, air_seed),
                    number=number,
                    point=combination,
                    values=point.values,
                    seed=seed,
                    air_seed=air_seed,
                    air=ids.air_of(seed, air_seed),
                    air_by_chance=ids.air_by_chance,
                    changes={**point.changes, **changes},
                    structure=ids.structure,
                )
                number += 1

    def _seeds(self, changes: Mapping[str, Any]) -> Iterator[tuple[int, int, dict[str, int]]]:
        """Seed, seed of the air, and what a run's scenario changes for them."""
        given = {key: changes.get(key, self.base.get(key)) for key in SEEDS}
        seed = WHOLE(Scenario.model_fields["seed"].default if given["seed"] is None else given["seed"])
        air_seed = seed if given["air_seed"] is None else WHOLE(given["air_seed"])
        if self.study.over_seeds:
            yield seed, air_seed, {}
            return
        for k in range(self.study.airs):
            for j in range(self.study.searches):
                its = (seed + k + SEARCH_STEP * j) % SEED_RANGE
                air = (air_seed + k) % SEED_RANGE
                apart = its != air or given["air_seed"] is not None
                yield its, air, {"seed": its} | ({"air_seed": air} if apart else {})


class _Checked(NamedTuple):
    """A point of which nothing is wrong. combination: its number, which those that differ in seeds alone share."""

    point: Point
    combination: int
    ids: Ids


class _Refused:
    """What is wrong with points; the same fault of several is told once, of the axes' values that have it."""

    def __init__(self, axes: Sequence[Levels | Range]):
        self.axes = axes
        self.first: dict[str, str] = {}
        self.points: dict[str, list[Point]] = {}

    def add(self, point: Point, faults: Sequence[str]) -> None:
        """A point with its faults; numbers in them may differ from point to point."""
        for line in faults:
            where, _, message = line.partition(": ")
            key = f"{where}: {NUMBER.sub('#', message)}"
            self.first.setdefault(key, line)
            self.points.setdefault(key, []).append(point)

    def lines(self) -> list[str]:
        """One for each fault."""
        return [f"{self._whose(points)}: {self.first[key]}" for key, points in self.points.items()]

    def _whose(self, points: list[Point]) -> str:
        """The axes of which not all values have it, with those that do."""
        parts = []
        for axis in self.axes:
            values = list(dict.fromkeys(point.values[axis.name] for point in points))
            if isinstance(axis, Range) or len(values) < len(axis.levels):
                unit = f" {axis.unit}" if axis.unit else ""
                told = [
                    f"{visible(_plain(value), LONGEST_VALUE)}{unit}" for value in values[:MOST_VALUES_TOLD]
                ]
                more = len(values) - len(told)
                parts.append(f"axes.{axis.name}: {', '.join(told)}{f' and {more} more' if more else ''}")
        count = f" ({len(points)} points)" if len(points) > 1 else ""
        return f"{', '.join(parts)}{count}" if parts else "all points"


def _plain(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _columns(axes: Sequence[Levels | Range]) -> Iterator[Axis]:
    """The axes' columns; as many folders are made of them, in their order, as a dataset can have."""
    folders = 1
    for axis in axes:
        levels = axis.levels if isinstance(axis, Levels) and axis.name not in SEEDS else ()
        names = {quote(str(level.value)).casefold() for level in levels}  # as some systems tell folders apart
        short = len(names) == len(levels) and all(len(name) <= LONGEST_FOLDER for name in names)
        partition = short and 1 < len(levels) <= FEW and folders * len(levels) <= MOST_FOLDERS
        folders *= len(levels) if partition else 1
        yield Axis(axis.name, axis.unit, partition)


def _same_runs(requests: Sequence[Request]) -> str | None:
    """A line where two runs are one and the same."""
    known: dict[str, Request] = {}
    for one in requests:
        other = known.setdefault(one.run, one)
        if other is not one:
            differ = [name for name in one.values if one.values[name] != other.values[name]]
            pairs = [
                f"{name}: {_plain(other.values[name])} and {_plain(one.values[name])}" for name in differ
            ]
            which = visible(", ".join(pairs), None)
            return f"axes: points with {which} are the same run; what differs decides nothing of its result"
    return None
