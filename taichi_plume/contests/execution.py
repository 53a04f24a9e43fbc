"""Run a contest: execute a study for each scenario.

The folder holds `scenarios/NAME.yaml` and `NAME.study.yaml`, the folder `NAME` of each study, `contest.csv`,
`contest.parquet` and `contest.html`. Runs, airs, workers and resuming work as in studies.
"""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import yaml
from pydantic import Field

from taichi_plume.assembly.own_code import has_permission, not_allowed
from taichi_plume.contests import AIRS, QUICK_AIRS, QUICK_SEARCHES, SEARCHES
from taichi_plume.contests.entrants import Entrant, entrants, scenarios
from taichi_plume.contests.fixed_scenarios import NAMES, QUICK, Fixed, fixed
from taichi_plume.files import disk, own_folder
from taichi_plume.files.own_class import CLASSES, OwnFile
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.guard.terminal import notebook_display, say, visible
from taichi_plume.scenario.loading import ScenarioError, load_part
from taichi_plume.studies.plan import load_plan
from taichi_plume.studies.study_run import Settings, execute

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Plan
    from taichi_plume.studies.study_run import End

KIND = "contest"  # contest.json marks a contest's folder
SCENARIOS = "scenarios"
AXIS = "algorithm"
MOST = 4096  # airs, and searches
_NAMES = Annotated[list[str], Field(min_length=1)] | None
_ALGORITHMS = Annotated[list[str | dict[str, Any]], Field(min_length=1)] | None
_COUNT = Annotated[int, Field(ge=1, le=MOST, strict=True)] | None
_SEED = Annotated[int, Field(ge=0, lt=1 << 32, strict=True)] | None
KINDS = {
    "algorithms": _ALGORITHMS,
    "scenarios": _NAMES,
    "files": list[Path],
    "policies": list[Path],
    "seed": _SEED,
    "airs": _COUNT,
    "searches": _COUNT,
}
"""Types of the options of a contest, by name."""


class Choice(NamedTuple):
    """Options of a contest. algorithms: names, and sections of classes; scenarios: names; None for all. files,
    policies: of the user's algorithms.

    quick: one scenario with few airs; seed: of airs, starts and noise; airs: number in each scenario; searches: number
    in each air.
    """

    out: Path = Path("contest")
    algorithms: Sequence[str | dict[str, Any]] | None = None
    files: Sequence[str | Path] = ()
    policies: Sequence[str | Path] = ()
    scenarios: Sequence[str] | None = None
    quick: bool = False
    seed: int | None = None
    airs: int | None = None
    searches: int | None = None
    allow_code: bool = False

    def repetition(self) -> str:
        """Return the command line that repeats the contest or, if Python code gave classes, the call of Python."""
        if any(not isinstance(algorithm, str) for algorithm in self.algorithms or ()):
            return self._call()
        words = ["python", "-m", "taichi_plume.contest"]
        for name, files in (("--algorithm", self.files), ("--policy", self.policies)):
            words += [word for file in files for word in (name, str(file))]
        words += ["--allow-code"] * self.allow_code + ["--quick"] * self.quick
        for name, names in (("--scenarios", self.scenarios), ("--algorithms", self.algorithms)):
            words += [name, ",".join(map(str, names))] if names is not None else []
        numbers = {"--seed": self.seed, "--airs": self.airs, "--searches": self.searches}
        words += [word for name, n in numbers.items() if n is not None for word in (name, str(n))]
        return shlex.join([*words, "--out", str(self.out)])

    def _call(self) -> str:
        algorithms = ", ".join(map(_call_of, self.algorithms or ()))
        keys = {key: value for key, value in self._asdict().items() if value != self._field_defaults[key]}
        keys |= {key: list(map(str, keys[key])) for key in ("files", "policies") if key in keys}
        keys |= {"out": str(self.out)}
        others = [f"{key}={value!r}" for key, value in keys.items() if key != "algorithms"]
        return f"tp.contest({', '.join([f'[{algorithms}]', *others])})"


def _call_of(algorithm: str | dict[str, Any]) -> str:
    """Return the Python text of an entry of `Choice.algorithms`."""
    if isinstance(algorithm, str):
        return repr(algorithm)
    parameters = [f"{key}={value!r}" for key, value in algorithm["parameters"].items()]
    return f"tp.Own({', '.join([CLASSES[algorithm['name']].__name__, *parameters])})"


class Contest(NamedTuple):
    """Settings of a contest. out: folder of the contest; airs: number of airs in each scenario.

    allowed: SHA-256 of the Python files with algorithms that the user has allowed; no other code is executed.
    """

    out: Path
    scenarios: tuple[Fixed, ...]
    entrants: tuple[Entrant, ...]
    airs: int
    allowed: tuple[str, ...] = ()

    @property
    def searches(self) -> int:
        """Number of searches in each air."""
        return self.scenarios[0].data["robots"][0]["trials"]

    def study(self, scenario: Fixed) -> Path:
        """Return the folder of a scenario's study."""
        return self.out / scenario.name


def settings_of(choice: Choice, workers: int | None, retry: bool, force: bool, progress: bool) -> Settings:
    """Return the settings of a contest's studies. Own algorithms may lie anywhere."""
    return Settings(
        choice.out, workers, retry=retry, force=force, progress=progress, allow_outside=True, report=False
    )  # fmt: skip


def contest_of(choice: Choice) -> Contest:
    """Return the contest of the chosen scenarios and algorithms. Raises ScenarioError for values that do not fit."""
    choice = choice._replace(
        **{name: load_part(getattr(choice, name), name, kind) for name, kind in KINDS.items()}
    )
    names = scenarios(choice.scenarios, QUICK if choice.quick else NAMES)
    entries = entrants(choice.algorithms, list(map(Path, choice.files)), list(map(Path, choice.policies)))
    allowed = _allowed(choice)
    searches = choice.searches or (QUICK_SEARCHES if choice.quick else SEARCHES)
    airs = choice.airs or (QUICK_AIRS if choice.quick else AIRS)
    fixed_scenarios = tuple(fixed(name, choice.seed, searches) for name in names)
    return Contest(choice.out, fixed_scenarios, tuple(entries), airs, allowed)


def _allowed(choice: Choice) -> tuple[str, ...]:
    """Return the SHA-256 of the Python files with algorithms. Raises ScenarioError if the user does not allow them."""
    files = {path: OwnFile.read(path, None) for path in map(Path, choice.files)}
    refused = [
        not_allowed(str(path))
        for path, file in files.items()
        if not choice.allow_code and not has_permission(str(path), file.digest)
    ]
    if refused:
        raise ScenarioError(refused)
    return tuple(file.digest for file in files.values())


def plans(contest: Contest) -> list["Plan"]:
    """Write a study for each scenario of a contest; return plans. Raises ScenarioError, RunFolderError, OSError."""
    _require_ours(contest.out)
    folder = contest.out / SCENARIOS
    contest.out.mkdir(parents=True, exist_ok=True)
    own_folder.mark(contest.out, KIND)
    folder.mkdir(exist_ok=True)
    made = []
    for scenario in contest.scenarios:
        base, file = folder / f"{scenario.name}.yaml", folder / f"{scenario.name}.study.yaml"
        head = "".join(f"# {line}\n" for line in scenario.about)
        _write(base, head + yaml.safe_dump(scenario.data, sort_keys=False))
        study = {
            "name": scenario.name,
            "base": base.name,
            "airs": contest.airs,
            "axes": {AXIS: {"variants": {each.name: each.changes(scenario) for each in contest.entrants}}},
        }
        _write(file, yaml.safe_dump(study, sort_keys=False))
        made.append(load_plan(file, allow_outside=True))  # own algorithms lie where the user has them
    return made


def play(contest: Contest, settings: Settings) -> Iterator["End"]:
    """Execute the missing runs of a contest, yield the end of each scenario's study. Raises the errors of `plans`.

    settings: of the studies; `out` and `allow_code` are replaced.
    """
    for plan, scenario in zip(plans(contest), contest.scenarios, strict=True):
        if settings.progress:
            line = f"{scenario.name}: {len(contest.entrants)} algorithms in {contest.airs} airs"
            say(line, error=notebook_display() is None)
        end = execute(plan, settings._replace(out=contest.study(scenario), allow_code=contest.allowed))
        yield end
        if end.status == "interrupted":
            return


def _require_ours(out: Path) -> None:
    """Raise RunFolderError if the folder holds links or files that do not belong to a contest."""
    if not out.exists():
        return
    fault = unopenable(out, folder=True)
    if fault:
        raise RunFolderError(f"{out}: {fault}; give a folder for the contest")
    refusal = own_folder.refusal(out, KIND)
    if refusal:
        raise RunFolderError(refusal)


def _write(path: Path, text: str) -> None:
    with disk.written_whole(path) as fresh:
        fresh.write_text(text, encoding="utf-8")


def chosen(names: str | None) -> Sequence[str] | None:
    """Split names at commas; None stays None. Raises ScenarioError for an empty name."""
    if names is None:
        return None
    parts = [name.strip() for name in names.split(",")]
    if not all(parts):
        raise ScenarioError(
            [f"'{visible(names)}': give names with commas between, such as open_2d,meandering"]
        )
    return parts
