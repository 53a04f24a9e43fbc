"""Parameter study from Python: ``results = tp.study("wind_speeds.yaml")`` is ``taichi-plume study``."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Source
    from taichi_plume.studies.results import Results
    from taichi_plume.studies.study_run import End


def study(
    source: "Source",
    *,
    out: Annotated[str | Path | None, "DIR"] = None,
    workers: Annotated[int | None, "N"] = None,
    scheduler: Annotated[str | None, "ADDRESS"] = None,
    dashboard: bool = False,
    retry: bool = False,
    force: bool = False,
    progress: bool = True,
    report: bool = True,
    allow_code: bool = False,
    allow_outside: bool = False,
    shard: Annotated[str | tuple[int, int] | bool, "[K/N]"] = False,
    merge: bool = False,
) -> "Results":
    """Execute the missing runs of a study and return its tables. The same call resumes an interrupted study.

    source: YAML file, name of an example, or dict with the keys of such a file. In a dict, `base` may be a scenario: a
    `Scenario` or a dict. out: the study's folder, by default studies/NAME. workers: processes on this machine, by
    default one per core. scheduler: Dask scheduler, such as tcp://host:8786, or its scheduler file (.json), whose
    workers execute the runs. dashboard: print the address of the scheduler's page. retry: repeat failed runs. force:
    drop runs in the folder that the study does not ask for. progress: show the progress. report: write report.html.
    allow_code: execute Python files that scenarios name. allow_outside: read files that lie outside the study's folder.
    shard: execute only the k-th of n parts, such as 3/7; without K/N (in Python: shard=True) that of this task of a
    SLURM job array. merge: execute no runs; write the tables of the shards' runs.

    Failed runs are rows of ``results.runs()`` and cause a warning. Raises InputError (ScenarioError, RunFolderError)
    before any run, RunError if the workers are lost or the disk is full, and KeyboardInterrupt; finished runs are kept.

    >>> import taichi_plume as tp
    >>> base = tp.Scenario.from_file("plumesim_casting").with_({"duration": 2, "robots.0.trials": 2})
    >>> speed = {"key": "robots.0.algorithm.speed", "values": ["20 cm/s", "30 cm/s"]}
    >>> results = tp.study({"name": "speeds", "base": base, "axes": {"speed": speed}, "airs": 1}, out=folder)
    >>> len(results.trials())
    4
    """
    end = held(**locals())
    from taichi_plume.studies.results import Results

    raise_unless_done(end)
    return Results(end.folder)


def held(source: "Source", out: str | Path | None = None, shard: object = False, **options: Any) -> "End":
    """Execute the missing runs of a study, see `study`; return how that ended."""
    from taichi_plume.guard.safe_open import as_path
    from taichi_plume.studies.plan import load_plan
    from taichi_plume.studies.shards import shard_of
    from taichi_plume.studies.study_run import Settings, execute

    part = None if shard is False or shard is None else shard_of(shard)
    settings = Settings(Path() if out is None else as_path(out, "out"), shard=part, **options)
    settings.check()
    plan = load_plan(source, settings.allow_outside, settings.progress)
    return execute(plan, settings if out is not None else settings._replace(out=plan.default_out))


def raise_unless_done(end: "End", level: int = 3) -> None:
    """Raise RunError or KeyboardInterrupt if the execution of a study was ended early; warn of failed runs.

    level: number of calls between the warning and the user's program.
    """
    text = "\n".join(end.notes)
    if end.status == "interrupted":
        raise KeyboardInterrupt(text) from end.error
    if end.error is not None:
        from taichi_plume.execution.execute import RunError  # imports Taichi, which only the workers need

        raise RunError(end.status, end.notes, end.folder) from end.error
    if end.notes:
        warnings.warn(text, stacklevel=level)
