"""The table of a contest: a row for each algorithm in each scenario, of what the studies' folders hold."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taichi_plume.contest.play import AXIS, Contest
from taichi_plume.files import disk
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.scoring.declarations import OUTCOMES
from taichi_plume.study import intervals
from taichi_plume.study.results import Results, open_study

if TYPE_CHECKING:
    import pandas as pd

NAME = "contest"


class Measure(NamedTuple):
    """What is told of searches. column: of the studies' trials; share: whether it is one; of: what is
    counted; brief: its title in a terminal.
    """

    name: str
    column: str
    title: str
    unit: str
    share: bool = False
    of: str = "searches"
    brief: str = ""


SUCCESS = Measure("success", "success", "success", "1", True)
TIME = Measure("time_s", "time_s", "time", "s", of="successes")
LATE = Measure("time_with_failures_s", "time_with_failures_s", "time with failures", "s", brief="with fails")
WAY = Measure("path_ratio", "path_ratio", "way / shortest way", "1", of="successes", brief="way")
ERROR = Measure(
    "localisation_error_m",
    "localisation_error_m",
    "localisation error",
    "m",
    of="searches with a declaration",
    brief="error",
)
FALSE = Measure(
    "false_declarations", "false_declarations", "false declarations per search", "1", brief="false"
)
DECLARED, REACHED, NEITHER = (Measure(name, name, name, "1", True) for name in OUTCOMES)
MEASURES = (SUCCESS, TIME, LATE, WAY, ERROR, FALSE, DECLARED, REACHED, NEITHER)


class Row(NamedTuple):
    """An algorithm in a scenario. searches: that were made; failed, missing: runs; message: why the first failed;
    estimates: by the names of MEASURES, None where there is nothing to count.
    """

    scenario: str
    algorithm: str
    robots: int
    runs: int
    failed: int
    missing: int
    message: str
    searches: int
    estimates: dict[str, intervals.Estimate | None]

    def told(self) -> dict[str, Any]:
        """As columns."""
        told: dict[str, Any] = {name: value for name, value in self._asdict().items() if name != "estimates"}
        for one in MEASURES:
            each = self.estimates[one.name]
            ends = (each.mean, each.low, each.high) if each else (np.nan,) * 3
            for end, value in zip(("", "_low", "_high"), ends, strict=True):
                told[one.name + end] = float(value)
        first = self.estimates[SUCCESS.name]
        told["airs"] = first.airs if first else 0
        told["success_words"] = intervals.words(first, "1", True)
        return told


def rows(contest: Contest) -> list[Row]:
    """All of them, in the contest's order: of what is there, also while it runs. Raises RunFolderError."""
    return [
        row for one in contest.scenarios if _there(contest.study(one)) for row in _of_study(contest, one.name)
    ]


def _there(folder: Path) -> bool:
    """Whether a study has been begun."""
    return (folder / "plan.parquet").is_file()


def _of_study(contest: Contest, name: str) -> Iterator[Row]:
    study = open_study(contest.out / name)
    runs: Any = study.runs()
    told = _estimates(study)
    for one in contest.entrants:
        mine = runs[runs[AXIS] == one.name]
        searched = told["searches"].get(one.name)
        failed = mine[mine["status"] == "failed"]
        yield Row(
            name, one.name, one.robots, len(mine), len(failed), int((mine["status"] == "missing").sum()),
            str(failed["message"].iloc[0]) if len(failed) else "", searched.n if searched else 0,
            {each.name: told[each.name].get(one.name) for each in MEASURES},
        )  # fmt: skip


def _estimates(study: Results) -> dict[str, dict[Any, intervals.Estimate]]:
    """Of each measure, by algorithm; and of `searches`, all."""
    trials: Any = study.trials()
    runs: Any = study.runs()
    chance = trials["run"].map(dict(zip(runs["run"], runs["air_by_chance"], strict=True)))
    trials = trials.assign(searches=1.0, path_ratio=trials["path_m"] / trials["shortest_m"])
    for name in OUTCOMES:
        trials[name] = (trials["outcome"] == name).astype("Float64").where(trials["outcome"].notna())

    def of(column: str, share: bool) -> dict[Any, intervals.Estimate]:
        if not len(trials):
            return {}
        values = trials[column].astype("Float64").to_numpy(float, na_value=np.nan)
        return intervals.estimates(values, trials[AXIS], trials["air_seed"], chance, share)

    return {one.name: of(one.column, one.share) for one in MEASURES} | {"searches": of("searches", False)}


def frame(some: list[Row]) -> "pd.DataFrame":
    """The table, a row for each of the rows."""
    import pandas as pd

    return pd.DataFrame([row.told() for row in some])


def write(contest: Contest, some: list[Row]) -> None:
    """Write contest.csv and contest.parquet; equal rows make equal bytes. Raises OSError."""
    table = frame(some)
    for suffix, save in (("csv", _csv), ("parquet", _parquet)):
        path = contest.out / f"{NAME}.{suffix}"
        with disk.written_whole(path) as fresh:
            save(table, fresh)


def _csv(table: "pd.DataFrame", path: Path) -> None:
    table.to_csv(path, index=False, lineterminator="\n", float_format="%.6g")


def _parquet(table: "pd.DataFrame", path: Path) -> None:
    table.to_parquet(path, index=False)


def require(some: list[Row]) -> None:
    """Raise RunFolderError where there is nothing to tell."""
    if not some:
        raise RunFolderError("nothing has been run yet")
