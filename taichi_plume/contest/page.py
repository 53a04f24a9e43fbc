"""`contest.html`: the standings of a contest on one page that needs nothing else; and the same in the terminal."""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from taichi_plume.contest import captions, plots
from taichi_plume.contest.fixed import Fixed
from taichi_plume.contest.play import SCENARIOS, Contest
from taichi_plume.contest.plume import mean_plume
from taichi_plume.contest.standings import (
    DECLARED,
    ERROR,
    FALSE,
    MEASURES,
    NAME,
    NEITHER,
    REACHED,
    SUCCESS,
    Measure,
    Row,
)
from taichi_plume.guard.terminal import show, visible
from taichi_plume.report import html
from taichi_plume.report.html import Image, Section, Table
from taichi_plume.study import cells, intervals
from taichi_plume.study.points import Quantity

ON_PAGE = (DECLARED, REACHED, NEITHER)
"""Too much for a terminal."""
WORDS = (ERROR, FALSE, DECLARED, REACHED, NEITHER)
"""Of those that say where the source is."""


def write(contest: Contest, rows: Sequence[Row], command: Sequence[str]) -> Path:
    """Write the page of a contest; returns its path. command: what makes it again. Raises OSError, ScenarioError."""
    runs, left = sum(row.runs for row in rows), sum(row.failed + row.missing for row in rows)
    return html.write(
        contest.out / f"{NAME}.html", _sections(contest, rows, command),
        name="Contest of search algorithms", what="taichi_plume", about="Page of a contest of taichi_plume",
        status=f"{runs - left:,} of {runs:,} runs", good=not left,
    )  # fmt: skip


def _sections(contest: Contest, rows: Sequence[Row], command: Sequence[str]) -> Iterator[Section]:
    yield _whole(contest, rows)
    for one in contest.scenarios:
        mine = [row for row in rows if row.scenario == one.name]
        if mine:
            yield _scenario(contest, one, mine)
    yield _failures(rows)
    yield Section("How it was measured", "measured", lines=list(captions.MEASURED))
    yield Section("How to repeat it", "again", lines=[shlex.join(command)], code=True)


def _whole(contest: Contest, rows: Sequence[Row]) -> Section:
    """Success of all in all scenarios, the best in the mean first."""
    names = [one.name for one in contest.scenarios if any(row.scenario == one.name for row in rows)]
    found = {(row.algorithm, row.scenario): row.estimates[SUCCESS.name] for row in rows}
    means = {}
    for one in contest.entrants:
        told = [found.get((one.name, name)) for name in names]
        means[one.name] = sum(each.mean if each else np.nan for each in told) / max(1, len(names))
    table = []
    for one in sorted(contest.entrants, key=lambda one: -np.nan_to_num(means[one.name], nan=-1.0)):
        each = [cell(SUCCESS, found.get((one.name, name))) for name in names]
        whole = means[one.name]
        table.append((one.name, *each, f"{100 * whole:.0f} %" if np.isfinite(whole) else "-"))
    searches = f"{contest.searches} searches in each of {contest.airs} airs"
    section = Section("Success", "success")
    section.lines.append(f"{len(contest.entrants)} algorithms in {len(names)} scenarios, {searches}.")
    section.tables.append(Table(table, ("success [%]", *names, "mean"), captions.WHOLE))
    return section


def _scenario(contest: Contest, one: Fixed, rows: Sequence[Row]) -> Section:
    section = Section(one.name, one.name, lines=list(one.about))
    told = ", ".join(f"{key} {value:g}" for key, value in one.told.items())
    section.lines.append(f"{captions.TOLD} {told}.")
    image = plots.arena(one, mean_plume(one, contest.out / SCENARIOS))
    section.images.append(Image(image, f"{one.name} from above", captions.ARENA))
    section.images.append(
        Image(plots.compared(rows, one.scenario.duration), "Success and time", captions.COMPARED)
    )
    said = [row for row in rows if row.estimates[ERROR.name]]
    section.tables.append(_table(rows, [each for each in MEASURES if each not in WORDS], captions.TABLE))
    if said:
        section.tables.append(_table(said, WORDS, captions.WORDS))
    words = [(row.algorithm, intervals.words(row.estimates[SUCCESS.name], "1", True)) for row in rows]
    section.tables.append(Table(words, ("success in words", "")))
    return section


def _table(rows: Sequence[Row], some: Sequence[Measure], caption: str) -> Table:
    table = [(row.algorithm, *(cell(each, row.estimates[each.name]) for each in some)) for row in rows]
    return Table(table, ("algorithm", *(plots.title(each) for each in some)), caption)


def _failures(rows: Sequence[Row]) -> Section:
    """What failed, in a line each."""
    told = [
        (f"{row.algorithm} in {row.scenario}", f"{row.failed} of {row.runs}", row.message)
        for row in rows
        if row.failed
    ]
    section = Section("What failed", "failed")
    if told:
        section.tables.append(Table(told, ("", "runs", "message"), captions.FAILED))
    return section


def cell(one: Measure, each: intervals.Estimate | None) -> str:
    """An estimate with its interval in brackets."""
    return cells.cell(Quantity(one.name, one.title, one.unit, one.share), each)


def show_table(rows: Sequence[Row]) -> None:
    """Print the standings: of success with its interval, of the rest the means."""
    from rich.table import Table as Shown

    some = [one for one in MEASURES if one not in ON_PAGE and any(row.estimates[one.name] for row in rows)]
    table = Shown(box=None, padding=(0, 1, 0, 0))
    for n, head in enumerate(("", *(plots.title(each, short=True) for each in some))):
        table.add_column(head, no_wrap=n < 2, min_width=5)
    before = ""
    for row in rows:
        if row.scenario != before:
            table.add_row(row.scenario, style="bold")
        before = row.scenario
        estimates = [(each, row.estimates[each.name]) for each in some]
        told = [cell(one, each) if one is SUCCESS else mean(one, each) for one, each in estimates]
        table.add_row(f" {visible(row.algorithm)}", *told)
    show(table)


def mean(one: Measure, each: intervals.Estimate | None) -> str:
    """An estimate without its interval."""
    return intervals.number(each.mean, "", one.share) if each and each.n else "-"
