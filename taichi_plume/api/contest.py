"""Contest of search algorithms from Python: ``tp.contest()`` is ``python -m taichi_plume.contest``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from taichi_plume.api.study import raise_unless_done
from taichi_plume.contests.execution import Choice, contest_of, play, settings_of
from taichi_plume.contests.standings import Standings, conclude
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import as_path


def contest(
    algorithms: Sequence[str | dict[str, Any]] | None = None,
    *,
    files: Sequence[str | Path] = (),
    policies: Sequence[str | Path] = (),
    scenarios: Sequence[str] | None = None,
    quick: bool = False,
    seed: int | None = None,
    airs: int | None = None,
    searches: int | None = None,
    out: str | Path = "contest",
    workers: int | None = None,
    retry: bool = False,
    force: bool = False,
    progress: bool = True,
    allow_code: bool = False,
) -> Standings:
    """Let search algorithms compete in the same scenarios, realisations of the air and starts; return the standings.

    algorithms, scenarios: names of shipped ones, by default all; your classes are algorithms as `Own(Class)`. files:
    Python files with algorithms of your own, which `allow_code` executes. policies: learnt policies, as ONNX files or
    scenarios whose robots run one. quick: one scenario with few airs. airs: number in each scenario, by default 8;
    searches: number in each air, by default 8. out: the contest's folder, which also receives contest.csv,
    contest.parquet and contest.html. The same call resumes an interrupted contest. The other arguments, the warning of
    failed runs and the errors are those of `study`.

    >>> import taichi_plume as tp
    >>> standings = tp.contest(
    ...     ["random_walk"], scenarios=["open_2d"], airs=1, searches=1, out=folder, progress=False
    ... )
    >>> standings.table.algorithm.tolist()
    ['random_walk']
    """
    choice = Choice(
        as_path(out, "out"), algorithms, files, policies, scenarios, quick, seed, airs, searches, allow_code
    )
    settings = settings_of(choice, workers, retry, force, progress)
    settings.check()
    played = contest_of(choice)
    ends = list(play(played, settings))
    try:
        standings = conclude(played, choice.repetition())
    except (InputError, OSError):
        for end in ends:  # the first cause
            raise_unless_done(end)
        raise
    for end in ends:
        raise_unless_done(end)
    return standings
