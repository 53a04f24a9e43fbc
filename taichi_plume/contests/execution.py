"""Run a contest: execute a study for each scenario.

The folder holds `scenarios/NAME.yaml` and `NAME.study.yaml`, the folder `NAME` of each study, `contest.csv`,
`contest.parquet` and `contest.html`. Runs, airs, workers and resuming work as in studies.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import yaml

from taichi_plume.contests.entrants import Entrant
from taichi_plume.contests.fixed_scenarios import Fixed
from taichi_plume.files import disk, own_folder
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.guard.terminal import say, visible
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.studies.plan import load_plan
from taichi_plume.studies.study_run import Wishes, carry_out

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Plan

KIND = "contest"  # contest.json marks a contest's folder
SCENARIOS = "scenarios"
AXIS = "algorithm"


class Contest(NamedTuple):
    """Settings of a contest. out: folder of the contest; airs: number of airs in each scenario."""

    out: Path
    scenarios: tuple[Fixed, ...]
    entrants: tuple[Entrant, ...]
    airs: int

    @property
    def searches(self) -> int:
        """Number of searches in each air."""
        return self.scenarios[0].data["robots"][0]["trials"]

    def study(self, scenario: Fixed) -> Path:
        """Return the folder of a scenario's study."""
        return self.out / scenario.name


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


def play(contest: Contest, wishes: Wishes) -> int:
    """Execute the missing runs of a contest; return the largest exit code of the studies. Raises the errors of `plans`.

    wishes: options of the studies; `out` is replaced.
    """
    code = 0
    for plan, scenario in zip(plans(contest), contest.scenarios, strict=True):
        if not wishes.quiet:
            say(f"{scenario.name}: {len(contest.entrants)} algorithms in {contest.airs} airs", error=True)
        code = max(code, carry_out(plan, wishes._replace(out=contest.study(scenario))))
        if code == 130:
            break
    return code


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
