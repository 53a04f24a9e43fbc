"""Plan of a study: the list of all runs. All runs are checked before the first run is executed."""

import re
from collections.abc import Iterator, Mapping, Sequence
from math import prod
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
import yaml
from pydantic import TypeAdapter, ValidationError

from taichi_plume.assembly.preparation import expanded
from taichi_plume.files.bundled import file_or_example
from taichi_plume.guard.safe_open import content_of
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.changes import shown
from taichi_plume.scenario.error_messages import explain
from taichi_plume.scenario.input_files import outside
from taichi_plume.scenario.loading import NEEDS, ScenarioError, of_python, read_mapping, scenario_of
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import Model
from taichi_plume.studies.air_plan import differs
from taichi_plume.studies.axes import Levels, Point, Range, count_of, points
from taichi_plume.studies.axis_values import resolve
from taichi_plume.studies.given_classes import PickledClass
from taichi_plume.studies.ids import Digests, Ids
from taichi_plume.studies.messages import Axis, Data, Request
from taichi_plume.studies.outcomes import OutcomeCheck
from taichi_plume.studies.scenario_checks import Checks
from taichi_plume.studies.study_keys import SEEDS, Study

MOST_RUNS = 100_000
LISTED = 10  # first points that `--check` lists
SAMPLE = 1000  # points beyond which `--check` checks only some, in a few seconds
MOST_FOLDERS = 1000  # folders of the table of trials
MOST_LEVELS = 64  # most values of an axis with a folder per value
LONGEST_FOLDER = 100  # most characters of a value in a folder's name
SEARCH_STEP = 1_000_003  # difference between the seeds of searches in one air
SEED_RANGE = 1 << 32
MOST_VALUES = 3  # values of an axis listed in an error
LARGEST_TEXT = 1 << 24  # most bytes of a file that the study's folder gets a copy of
CLASSES_TEXT = "classes.py"  # source text of classes that Python code gave, in the study's folder
STUDY_NEEDS = "a study needs at least name, base and axes"
WHOLE = TypeAdapter(int).validate_python
NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")


Source = str | Path | Mapping[str, object]
"""A study: path of its YAML file, name of an example, or dict with the same keys, whose base may be a scenario."""


class Plan(NamedTuple):
    """A study with all its runs. file: study.yaml; folder: folder of the base; base: data of the base scenario.

    texts: content of the study's file and of the base's, by their names in the study's folder. classes: those that
    Python code gave, by the names in the scenarios. runs, points: numbers of
    all runs and of all combinations of axis values but seeds; checked: number of those that were checked. Only the runs
    of these are in `requests`.
    """

    study: Study
    file: Path
    folder: Path
    base: Data
    axes: tuple[Axis, ...]
    requests: tuple[Request, ...]
    texts: dict[str, bytes]
    classes: dict[str, PickledClass]
    runs: int
    points: int
    checked: int

    @property
    def default_out(self) -> Path:
        """Folder of the study, unless another is given."""
        return Path("studies") / self.study.name


class _Base(NamedTuple):
    """Base scenario of a study. name: for messages; folder: of the files that it names; text: of its YAML file."""

    name: str
    folder: Path
    data: Data
    text: bytes


def load_plan(
    source: Source, allow_outside: bool = False, progress: bool = False, most: int = MOST_RUNS
) -> Plan:
    """Read a study, check the scenario of each combination of axis values, list all runs. Run no users' code.

    allow_outside: whether the base and the files that the base names may lie outside the study's folder. progress: show
    the progress of checks that take longer than a second. most: number of combinations beyond which only some are
    checked and listed, see `_sample`. Raises ScenarioError with a line for each error.
    """
    options = allow_outside, progress, most
    if isinstance(source, Mapping):
        return _of_dict(source, *options)
    if not isinstance(source, str | Path):
        raise ScenarioError(
            [f"study: got {shown(source)}; give a YAML file, the name of an example or a dict"]
        )
    file = file_or_example(source)
    study = read_study(file)
    try:
        texts = {"study.yaml": content_of(file, LARGEST_TEXT, _unreadable)}
        base = _base_of_file(file.parent / study.base, file.parent, study.base, allow_outside)
        return _Planning(study, base, *options).plan(file, texts)
    except ScenarioError as error:
        raise ScenarioError([f"{file}: {line}" for line in error.faults]) from None


def read_study(file: Path) -> Study:
    """Read and validate a study.yaml, without its base scenario. Raises ScenarioError."""
    data = read_mapping(file, STUDY_NEEDS)
    if "base" not in data and "domain" in data:
        hint = "python -m taichi_plume.run runs scenarios; a study names its base scenario"
        raise ScenarioError([f"{file}: is a scenario, not a study; {hint}"])
    try:
        return _study(data)
    except ScenarioError as error:
        raise ScenarioError([f"{file}: {line}" for line in error.faults]) from None


def _study(data: Data) -> Study:
    try:
        study = Study.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(explain(error, data, Study)) from None
    faults = study.faults()
    if faults:
        raise ScenarioError(faults)
    return study


def _of_dict(source: Mapping[str, object], allow_outside: bool, progress: bool, most: int) -> Plan:
    """Return the plan of a study in a dict. Its base is a path from the working folder, an example or a scenario."""
    given, name = source.get("base"), "base.yaml"
    data = of_python({**source, "base": name} if "base" in source else source)
    study = _study(data)
    if isinstance(given, str | Path):
        path = file_or_example(given)
        base = _base_of_file(path, path.parent, path.name, allow_outside)
    elif isinstance(given, Scenario):
        keys = given.keys_set()
        base = _Base(name, given.origin.folder.resolve(), keys, _yaml(keys))
    elif isinstance(given, Mapping):
        keys = of_python(given)
        data_of_base, *_ = expanded(keys, Path(name), allow_outside)
        base = _Base(name, Path().resolve(), data_of_base, _yaml(keys))
    else:
        what = (
            f"got {shown(given)}; give a Scenario, a dict, the path of a YAML file or the name of an example"
        )
        raise ScenarioError([f"base: {what}"])
    planning = _Planning(study, base, allow_outside, progress, most)
    return planning.plan(Path("study.yaml"), {"study.yaml": _yaml(data)})


def _base_of_file(path: Path, folder: Path, name: str, allow_outside: bool) -> _Base:
    """Read the base scenario of a study, which must lie in `folder` or below unless `allow_outside`."""
    if not allow_outside and outside(folder, name):
        where = f"base: {visible(name, LONGEST_VALUE)} lies outside the study's folder"
        hint = "to read this file, add --allow-outside (in Python: allow_outside=True)"
        raise ScenarioError([f"{where}; {hint}"])
    data, *_ = expanded(read_mapping(path, NEEDS), path, allow_outside)
    return _Base(name, path.resolve().parent, data, content_of(path, LARGEST_TEXT, _unreadable))


def _unreadable(message: str) -> ScenarioError:
    return ScenarioError([message])


def _yaml(data: Data) -> bytes:
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True).encode()


class _Dumper(yaml.SafeDumper):
    """YAML dumper that writes sections, which a dict from Python may hold, with the keys that were set."""


_Dumper.add_multi_representer(
    Model,
    lambda dumper, section: dumper.represent_data(section.model_dump(mode="json", exclude_unset=True)),
)


class _Planning:
    def __init__(self, study: Study, base: _Base, allow_outside: bool, progress: bool, most: int):
        self.study, self.base_file, self.base = study, base, base.data
        self.progress, self.most = progress, most
        self.checks, self.digests = Checks(base.folder, allow_outside), Digests(base.folder)

    def plan(self, file: Path, texts: dict[str, bytes]) -> Plan:
        """Return the plan of the study in a file; texts: content of the file, see `Plan`. Raises ScenarioError."""
        study, base = self.study, self.base_file
        runs = prod(map(count_of, study.axes.values())) * study.draws
        runs *= 1 if study.over_seeds else study.airs * study.searches
        if runs > MOST_RUNS:
            limit = f"at most {MOST_RUNS:,} are allowed"
            raise ScenarioError([f"has {runs:,} runs; {limit}, use fewer values or airs"])
        axes = resolve(study, base.data, visible(base.name, LONGEST_VALUE))
        combinations = self._combinations(axes)
        chosen = _sample(combinations, axes, self.most)
        found, faults = self._checked(axes, combinations, chosen)
        if faults:
            raise ScenarioError(faults)
        requests = tuple(self._requests(found))
        same = _same_runs(requests)
        if same:
            raise ScenarioError([same])
        texts = texts | {"base.yaml": base.text}
        classes = self.checks.classes
        if classes.found:
            texts[CLASSES_TEXT] = classes.text().encode(errors="replace")
        counts = classes.pickled(), runs, len(combinations), len(chosen)
        return Plan(study, file, base.folder, base.data, tuple(columns(axes)), requests, texts, *counts)

    # ------------------------------------------------------------ checks

    def _combinations(self, axes: Sequence[Levels | Range]) -> dict[tuple[int, ...], list[Point]]:
        """Return the points of a study by combination of axis values; those of one differ only in seeds."""
        grid = [axis for axis in axes if isinstance(axis, Levels)]
        seeds = [n for n, axis in enumerate(grid) if set(self.study.axes[axis.name].paths) <= set(SEEDS)]
        combinations: dict[tuple[int, ...], list[Point]] = {}
        for point in points(self.study, axes):
            key = tuple(which for n, which in enumerate(point.which) if n not in seeds)
            combinations.setdefault(key, []).append(point)
        return combinations

    def _checked(
        self,
        axes: Sequence[Levels | Range],
        combinations: Mapping[tuple[int, ...], Sequence[Point]],
        chosen: Sequence[int],
    ) -> tuple["list[_Checked]", list[str]]:
        """Return the points of valid combinations, in the order of the study, and errors.

        combinations: see `_combinations`; chosen: numbers of those to check. Each is checked once.
        """
        from taichi_plume.studies.progress import watched  # imports pyarrow

        study, found, every = self.study, [], list(combinations.values())
        requested, refused = OutcomeCheck(study.outcomes, study.keep), _Refused(axes)
        scenario = None
        for number in watched(chosen, len(chosen), "points are checked", self.progress):
            first, *_ = every[number]
            try:
                scenario, resources = self.checks.checked(scenario_of(self.base, first.changes))
                ids = self._ids(scenario, resources.files)
                if requested.outcomes or requested.keep:
                    requested.look(scenario)
            except ScenarioError as error:
                refused.add(first, error.faults)
            except OSError as error:
                refused.add(first, [f"{error.filename}: cannot be read: {error.strerror or error}"])
            else:
                found += [_Checked(point, number, ids) for point in every[number]]
        found.sort(key=lambda each: each.point.which)
        return found, [*refused.lines(), *(requested.lines if scenario is not None else [])]

    def _ids(self, scenario: Scenario, files: Mapping[str, Sequence[Path]]) -> Ids:
        study, ids = self.study, self.digests.ids(scenario, files, self.checks.classes.digests(scenario))
        film_differs = study.share_air == "always" and differs(scenario, study.outcomes, study.keep)
        return ids.shown() if film_differs else ids

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

    def _seeds(self, changes: Mapping[str, object]) -> Iterator[tuple[int, int, dict[str, int]]]:
        """Yield the seed and the air's seed of each run, and the changes to the scenario that set the seeds."""
        given = {key: changes.get(key, self.base.get(key)) for key in SEEDS}
        seed = WHOLE(Scenario.model_fields["seed"].default if given["seed"] is None else given["seed"])
        air_seed = seed if given["air_seed"] is None else WHOLE(given["air_seed"])
        if self.study.over_seeds:
            yield seed, air_seed, {}
            return
        for k in range(self.study.airs):
            for j in range(self.study.searches):
                own = (seed + k + SEARCH_STEP * j) % SEED_RANGE
                air = (air_seed + k) % SEED_RANGE
                apart = own != air or given["air_seed"] is not None
                yield own, air, {"seed": own} | ({"air_seed": air} if apart else {})


def _sample(
    combinations: Mapping[tuple[int, ...], Sequence[Point]], axes: Sequence[Levels | Range], most: int
) -> list[int]:
    """Return the numbers of the combinations of axis values to check: all, or of more than `most` a sample.

    A sample has the first combinations, others at equal distances, the first with each value of an axis, and of an axis
    with a range or many values those with the least and the largest.
    """
    count = len(combinations)
    if count <= most:
        return list(range(count))
    values = [points[0].values for points in combinations.values()]
    chosen = {*range(LISTED), *np.linspace(0, count - 1, most, dtype=int).tolist()}
    for axis in axes:
        of_axis = [each[axis.name] for each in values]
        if isinstance(axis, Range) or len(axis.levels) > MOST_LEVELS:
            chosen |= {of_axis.index(end(of_axis)) for end in (min, max)} if _ordered(of_axis) else set()
        else:
            chosen |= {of_axis.index(value) for value in dict.fromkeys(of_axis)}
    return sorted(chosen)


def _ordered(values: Sequence[object]) -> bool:
    return all(isinstance(value, int | float) for value in values)


class _Checked(NamedTuple):
    """Valid combination of axis values (point). combination: number, equal for points that differ only in seeds."""

    point: Point
    combination: int
    ids: Ids


class _Refused:
    """Errors of a study's combinations of axis values (points). Errors that several points share are merged."""

    def __init__(self, axes: Sequence[Levels | Range]):
        self.axes = axes
        self.first: dict[str, str] = {}
        self.points: dict[str, list[Point]] = {}

    def add(self, point: Point, faults: Sequence[str]) -> None:
        """Add the errors of a point. Errors that differ only in numbers count as equal."""
        for line in faults:
            where, _, message = line.partition(": ")
            key = f"{where}: {NUMBER.sub('#', message)}"
            self.first.setdefault(key, line)
            self.points.setdefault(key, []).append(point)

    def lines(self) -> list[str]:
        """Return a line for each error."""
        return [f"{self._whose(points)}: {self.first[key]}" for key, points in self.points.items()]

    def _whose(self, points: list[Point]) -> str:
        """Return text that names the axis values of points with an error, without axes that have it at all values."""
        parts = []
        for axis in self.axes:
            values = list(dict.fromkeys(point.values[axis.name] for point in points))
            if isinstance(axis, Range) or len(values) < len(axis.levels):
                unit = f" {axis.unit}" if axis.unit else ""
                shown = ", ".join(
                    f"{visible(_plain(value), LONGEST_VALUE)}{unit}" for value in values[:MOST_VALUES]
                )
                more = f" and {len(values) - MOST_VALUES} more" if len(values) > MOST_VALUES else ""
                parts.append(f"axes.{axis.name}: {shown}{more}")
        count = f" ({len(points)} points)" if len(points) > 1 else ""
        return f"{', '.join(parts)}{count}" if parts else "all points"


def _plain(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def columns(axes: Sequence[Levels | Range]) -> Iterator[Axis]:
    """Yield the table column of each axis. Axes with few values get a folder per value, at most MOST_FOLDERS in all."""
    folders = 1
    for axis in axes:
        levels = axis.levels if isinstance(axis, Levels) and axis.name not in SEEDS else ()
        names = {quote(str(level.value)).casefold() for level in levels}  # some file systems ignore case
        short = len(names) == len(levels) and all(len(name) <= LONGEST_FOLDER for name in names)
        partition = short and 1 < len(levels) <= MOST_LEVELS and folders * len(levels) <= MOST_FOLDERS
        folders *= len(levels) if partition else 1
        yield Axis(axis.name, axis.unit, partition)


def _same_runs(requests: Sequence[Request]) -> str | None:
    """Return an error line if two runs have the same id, else None."""
    known: dict[str, Request] = {}
    for request in requests:
        other = known.setdefault(request.run, request)
        if other is not request:
            pairs = [(name, other.values[name], value) for name, value in request.values.items()]
            differ = [f"{name}: {_plain(a)} and {_plain(b)}" for name, a, b in pairs if a != b]
            which = visible(", ".join(differ), None)
            return f"axes: points with {which} are the same run: this difference does not affect results"
    return None
