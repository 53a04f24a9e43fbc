"""Run a contest: a study for each fixed scenario, whose axis is the algorithm.

The scenarios are files of this package that `taichi_plume.run` can execute, too. The section `algorithm` of their
robots holds the facts of the plume for all algorithms: `threshold_ppm`, and `wind_speed` for plume models. The folder
holds `scenarios/NAME.yaml` and `NAME.study.yaml`, the folder `NAME` of each study, `contest.csv`, `contest.parquet` and
`contest.html`. Runs, airs, workers and resuming work as in studies.
"""

from collections.abc import Iterator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, get_type_hints

import yaml
from pydantic import Field

from taichi_plume.assembly.own_code import has_permission, not_allowed
from taichi_plume.contests import AIRS, QUICK_AIRS, QUICK_SEARCHES, SEARCHES
from taichi_plume.contests.entrants import Entrant, entrants, kinds, known
from taichi_plume.files import disk, own_folder
from taichi_plume.files.own_class import CLASSES, OwnFile
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.guard.terminal import notebook_display, say
from taichi_plume.scenario.loading import ScenarioError, load_part, scenario_from
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.studies.plan import load_plan
from taichi_plume.studies.study_run import Settings, execute

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Plan
    from taichi_plume.studies.study_run import End

KIND, SCENARIOS, AXIS = (
    "contest",
    "scenarios",
    "algorithm",
)  # mark of the folder, its folder of files, axis of studies
FOLDER = Path(__file__).with_name(SCENARIOS)
NAMES = (
    "open_2d", "open_3d", "meandering", "closed_room", "obstacles", "two_sources", "office", "moving_source",
    "two_gases", "drone",
)  # fmt: skip
"""Names of the scenarios in the order of execution and of the tables."""
QUICK = ("open_2d",)
"""Scenarios of `--quick`."""
Count = Annotated[int, Field(ge=1, le=4096, strict=True)] | None


class Fixed(NamedTuple):
    """A scenario of the contest. about: paragraphs of the file's head comment; data: as parsed from YAML."""

    name: str
    about: tuple[str, ...]
    data: dict[str, Any]

    @property
    def scenario(self) -> Scenario:
        """The scenario, validated without opening the files that it names."""
        return scenario_from(self.data)

    @property
    def facts(self) -> dict[str, float]:
        """Facts of the plume that algorithms are given, by key: those of the file's section `algorithm`."""
        return {k: value for k, value in self.data["robots"][0]["algorithm"].items() if k != "kind"}


def fixed(name: str, seed: int | None = None, searches: int | None = None) -> Fixed:
    """Read the scenario `name`, one of NAMES, from its file. seed, searches (number in each air) replace its values.

    The comment at the head of the file has two paragraphs: the setting and the question.
    """
    text = (FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    data = yaml.safe_load(text)
    if seed is not None:
        data["seed"] = seed
    if searches is not None:
        data["robots"][0]["trials"] = searches
    head = takewhile(lambda line: line.startswith("#"), text.splitlines())
    lines = " ".join(line.removeprefix("#").strip() for line in head)
    setting, _, question = lines.partition("The question: ")
    return Fixed(name, (setting.strip(), f"The question: {question.strip()}"), data)


class Choice(NamedTuple):
    """Options of a contest, as of `taichi_plume.contest`."""

    algorithms: Annotated[list[str | dict[str, Any]], Field(min_length=1)] | None = None
    files: list[Path] = []  # noqa: RUF012  never changed
    policies: list[Path] = []  # noqa: RUF012
    scenarios: Annotated[list[str], Field(min_length=1)] | None = None
    quick: bool = False
    seed: Annotated[int, Field(ge=0, lt=1 << 32, strict=True)] | None = None
    airs: Count = None
    searches: Count = None
    out: Path = Path("contest")
    allow_code: bool = False

    def checked(self) -> "Choice":
        """Return the options as their types. Raises ScenarioError."""
        kinds = get_type_hints(Choice, include_extras=True)
        given = {name: value for name, value in self._asdict().items() if name != "out"}
        return self._replace(**{name: load_part(value, name, kinds[name]) for name, value in given.items()})

    def call(self) -> str:
        """Return the call of Python that repeats the contest."""
        keys = {key: value for key, value in self._asdict().items() if value != self._field_defaults[key]}
        keys |= {key: list(map(str, keys[key])) for key in ("files", "policies") if key in keys}
        given = [f"{key}={value!r}" for key, value in keys.items() if key not in ("algorithms", "out")]
        given += [f"out={str(self.out)!r}"]
        if self.algorithms is not None:
            given.insert(0, f"[{', '.join(map(_call_of, self.algorithms))}]")
        return f"tp.contest({', '.join(given)})"


def _call_of(algorithm: str | dict[str, Any]) -> str:
    """Return the Python text of an entry of `Choice.algorithms`."""
    if isinstance(algorithm, str):
        return repr(algorithm)
    parameters = [f"{key}={value!r}" for key, value in algorithm["parameters"].items()]
    return f"tp.Own({', '.join([CLASSES[algorithm['name']].__name__, *parameters])})"


class Contest(NamedTuple):
    """Settings of a contest. out: folder of the contest; airs: number of airs in each scenario.

    allowed: SHA-256 of the Python files with algorithms that the user has allowed; no other code is executed.
    again: how to repeat the contest.
    """

    out: Path
    scenarios: tuple[Fixed, ...]
    entrants: tuple[Entrant, ...]
    airs: int
    allowed: tuple[str, ...] = ()
    again: str = ""

    def entrants_in(self, scenario: Fixed) -> list[Entrant]:
        """Return the entrants that take part in a scenario: those that climb only where the robot flies."""
        flies = scenario.scenario.robots[0].body.flies
        return [each for each in self.entrants if flies or not kinds()[each.section["kind"]].in_space]

    @property
    def searches(self) -> int:
        """Number of searches in each air."""
        return self.scenarios[0].data["robots"][0]["trials"]

    def study(self, scenario: Fixed) -> Path:
        """Return the folder of a scenario's study."""
        return self.out / scenario.name


def contest_of(choice: Choice, again: str = "") -> Contest:
    """Return the contest of the chosen scenarios and algorithms. Raises ScenarioError for values that do not fit, and
    for Python files that the user does not allow.

    again: how to repeat the contest, by default the call of Python.
    """
    choice = choice.checked()
    names = scenarios(choice.scenarios, QUICK if choice.quick else NAMES)
    entries = entrants(choice.algorithms, choice.files, choice.policies)
    digests = {str(path): OwnFile.read(path, None).digest for path in choice.files}
    asked = {} if choice.allow_code else digests
    refused = [not_allowed(path) for path, digest in asked.items() if not has_permission(path, digest)]
    if refused:
        raise ScenarioError(refused)
    searches = choice.searches or (QUICK_SEARCHES if choice.quick else SEARCHES)
    airs = choice.airs or (QUICK_AIRS if choice.quick else AIRS)
    chosen = tuple(fixed(name, choice.seed, searches) for name in names)
    allowed = tuple(digests.values())
    contest = Contest(choice.out, chosen, tuple(entries), airs, allowed, again or choice.call())
    empty = [each.name for each in chosen if not contest.entrants_in(each)]
    if empty:
        raise ScenarioError(
            [f"scenario {empty[0]}: none of the algorithms takes part in it, as they fly; add others"]
        )
    return contest


def scenarios(names: Sequence[str] | None, unless: Sequence[str]) -> list[str]:
    """Return the given scenarios, by default `unless`, in the contest's order. Raises ScenarioError."""
    given = known("scenario", names, list(NAMES)) if names else list(unless)
    return [name for name in NAMES if name in given]


def plans(contest: Contest) -> list["Plan"]:
    """Write a study for each scenario of a contest; return plans. Raises ScenarioError, RunFolderError, OSError.

    Raises RunFolderError if the folder holds links or files that do not belong to a contest.
    """
    out, folder = contest.out, contest.out / SCENARIOS
    if out.exists():
        fault = unopenable(out, folder=True)
        refusal = f"{out}: {fault}; give a folder for the contest" if fault else own_folder.refusal(out, KIND)
        if refusal:
            raise RunFolderError(refusal)
    out.mkdir(parents=True, exist_ok=True)
    own_folder.mark(out, KIND)
    folder.mkdir(exist_ok=True)
    made = []
    for scenario in contest.scenarios:
        base, file = folder / f"{scenario.name}.yaml", folder / f"{scenario.name}.study.yaml"
        variants = {each.name: each.changes(scenario.facts) for each in contest.entrants_in(scenario)}
        study = {
            "name": scenario.name,
            "base": base.name,
            "airs": contest.airs,
            "axes": {AXIS: {"variants": variants}},
        }
        head = "".join(f"# {line}\n" for line in scenario.about)
        for path, text, data in ((base, head, scenario.data), (file, "", study)):
            with disk.written_whole(path) as fresh:
                fresh.write_text(text + yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
        made.append(load_plan(file, allow_outside=True))  # own algorithms lie where the user has them
    return made


def play(contest: Contest, settings: Settings) -> Iterator["End"]:
    """Execute the missing runs of a contest, yield the end of each scenario's study. Raises the errors of `plans`.

    settings: of the studies; `out` and what code is allowed are those of the contest.
    """
    for plan, scenario in zip(plans(contest), contest.scenarios, strict=True):
        if settings.progress:
            line = f"{scenario.name}: {len(contest.entrants_in(scenario))} algorithms in {contest.airs} airs"
            say(line, error=notebook_display() is None)
        own = {"allow_code": contest.allowed, "allow_outside": True}  # own algorithms may lie anywhere
        end = execute(plan, settings._replace(out=contest.study(scenario), report=False, **own))
        yield end
        if end.status == "interrupted":
            return
