"""Contest of search algorithms from Python: ``tp.contest()`` is ``taichi-plume contest``."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from taichi_plume.contests.standings import Standings
    from taichi_plume.studies.study_run import End

Count = Annotated[int | None, "N"]


def contest(
    algorithms: Annotated[Sequence[str | dict[str, Any]] | None, "--algorithms NAMES"] = None,
    *,
    files: Annotated[Sequence[str | Path], "--entry FILE.py ..."] = (),
    policies: Annotated[Sequence[str | Path], "--policy FILE ..."] = (),
    scenarios: Annotated[Sequence[str] | None, "NAMES"] = None,
    quick: bool = False,
    seed: Count = None,
    airs: Count = None,
    searches: Count = None,
    out: Annotated[str | Path, "DIR"] = Path("contest"),
    workers: Count = None,
    retry: bool = False,
    force: bool = False,
    progress: bool = True,
    allow_code: bool = False,
) -> "Standings":
    """Let search algorithms compete in the same scenarios, realisations of the air and starts; return the standings.

    algorithms, scenarios: names of shipped ones, separated by commas; by default all. In Python a list, in which your
    classes are algorithms as `Own(Class)`. files: Python file with an algorithm of your own; may be repeated. policies:
    a learnt policy: an ONNX file, or a scenario whose robots run one; may be repeated. quick: one scenario with few
    airs: a preview of about a minute. seed: seed of airs, starts and noise, by default the scenarios'. airs: number in
    each scenario, by default 8. searches: number in each air, by default 8. out: the contest's folder, by default
    contest, which also receives contest.csv, contest.parquet and contest.html. workers: processes, by default one per
    core. retry: repeat failed runs. force: drop runs in the folder that this contest does not ask for. allow_code:
    execute the files of --entry.

    The same call resumes an interrupted contest. The warning of failed runs and the errors are those of `study`.

    >>> import taichi_plume as tp
    >>> standings = tp.contest(
    ...     ["random_walk"], scenarios=["open_2d"], airs=1, searches=1, out=folder, progress=False
    ... )
    >>> standings.table.algorithm.tolist()
    ['random_walk']
    """
    options = locals()
    from taichi_plume.api.study import raise_unless_done

    ends: list[End] = []
    try:
        return held(ends.append, **options)
    finally:  # before an error of `held`: what ended a study is its cause
        for end in ends:
            raise_unless_done(end)


def held(
    tell: "Callable[[End], object]",
    algorithms: Any = None,
    *,
    out: str | Path = Path("contest"),
    workers: int | None = None,
    retry: bool = False,
    force: bool = False,
    progress: bool = True,
    again: str = "",
    **options: Any,
) -> "Standings":
    """Let search algorithms compete, see `contest`; return the standings. tell: is called as each study ends.

    again: how to repeat the contest, by default the call of Python.
    """
    from taichi_plume.contests.execution import Choice, contest_of, play
    from taichi_plume.contests.standings import conclude
    from taichi_plume.guard.safe_open import as_path
    from taichi_plume.studies.study_run import Settings

    choice = Choice(algorithms, out=as_path(out, "out"), **options)
    settings = Settings(choice.out, workers, retry=retry, force=force, progress=progress)
    settings.check()
    played = contest_of(choice, again)
    for end in play(played, settings):
        tell(end)
    return conclude(played)
