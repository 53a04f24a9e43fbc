"""HTML page of a contest of search algorithms (`contest.html`), self-contained, and the standings in the terminal."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from taichi_plume.contests import captions, plots
from taichi_plume.contests.execution import SCENARIOS, Contest
from taichi_plume.contests.fixed_scenarios import Fixed
from taichi_plume.contests.standings import (
    DECLARED,
    ERROR,
    FALSE,
    MEASURES,
    NAME,
    NEITHER,
    REACHED,
    SUCCESS,
    Row,
)
from taichi_plume.guard.terminal import say, show, visible
from taichi_plume.report import html
from taichi_plume.report.html import Section

ON_PAGE = (DECLARED, REACHED, NEITHER)
"""Quantities that the terminal does not show."""
WORDS = (ERROR, FALSE, DECLARED, REACHED, NEITHER)
"""Quantities of algorithms that declare a position of the source."""


def write(contest: Contest, rows: Sequence[Row], again: str) -> Path:
    """Write a contest's HTML page; return its path. again: how to repeat the contest. Raises OSError, ScenarioError."""
    runs, left = sum(row.runs for row in rows), sum(row.failed + row.missing for row in rows)
    return html.write(
        contest.out / f"{NAME}.html", _sections(contest, rows, again),
        name="Contest of search algorithms", what="taichi_plume", about="Page of a contest of taichi_plume",
        status=f"{runs - left:,} of {runs:,} runs", good=not left,
    )  # fmt: skip


def _sections(contest: Contest, rows: Sequence[Row], again: str) -> Iterator[Section]:
    yield _whole(contest, rows)
    for scenario in contest.scenarios:
        mine = [row for row in rows if row.scenario == scenario.name]
        if mine:
            yield _scenario(contest, scenario, mine)
    yield _failures(rows)
    yield Section("How it was measured", "measured", lines=list(captions.MEASURED))
    yield Section("How to repeat it", "again", lines=[again], code=True)


def _whole(contest: Contest, rows: Sequence[Row]) -> Section:
    """Return the page section with the success of each algorithm in each scenario, sorted by mean, the best first."""
    names = [fixed.name for fixed in contest.scenarios if any(row.scenario == fixed.name for row in rows)]
    found = {(row.algorithm, row.scenario): row.estimates[SUCCESS.name] for row in rows}
    means = {}
    for entrant in contest.entrants:
        estimates = [found.get((entrant.name, name)) for name in names]
        means[entrant.name] = sum(each.mean if each else np.nan for each in estimates) / max(1, len(names))
    table = []
    for algorithm, mean in sorted(means.items(), key=lambda pair: -np.nan_to_num(pair[1], nan=-1.0)):
        cells = [SUCCESS.cell(found.get((algorithm, name))) for name in names]
        table.append((algorithm, *cells, f"{100 * mean:.0f} %" if np.isfinite(mean) else "-"))
    searches = f"{contest.searches} searches in each of {contest.airs} airs"
    section = Section("Success", "success")
    section.lines.append(f"{len(contest.entrants)} algorithms in {len(names)} scenarios, {searches}.")
    section.table(table, ("success [%]", *names, "mean"), captions.WHOLE)
    section.lines += notes(rows)
    return section


def _scenario(contest: Contest, scenario: Fixed, rows: Sequence[Row]) -> Section:
    section = Section(scenario.name, scenario.name, lines=list(scenario.about))
    facts = ", ".join(f"{key} {value:g}" for key, value in scenario.facts.items())
    section.lines.append(f"{captions.FACTS} {facts}.")
    plume = plots.mean_plume(scenario, contest.out / SCENARIOS)
    section.image(plots.arena(scenario, plume), f"{scenario.name} from above", captions.ARENA)
    section.image(plots.compared(rows, scenario.scenario.duration), "Success and time", captions.COMPARED)
    declaring = [row for row in rows if row.estimates[ERROR.name]]
    for part, shown, caption in (
        (rows, [each for each in MEASURES if each not in WORDS], captions.TABLE),
        (declaring, WORDS, captions.WORDS),
    ):
        table = [(row.algorithm, *(q.cell(row.estimates[q.name]) for q in shown)) for row in part]
        section.table(table, ("algorithm", *map(plots.title, shown)), caption)
    words = [(row.algorithm, SUCCESS.words(row.estimates[SUCCESS.name])) for row in rows]
    section.table(words, ("success in words", ""))
    return section


def _failures(rows: Sequence[Row]) -> Section:
    """Return the page section with failed runs: a row per algorithm and scenario, with number and message."""
    failed = [
        (f"{row.algorithm} in {row.scenario}", f"{row.failed} of {row.runs}", row.message)
        for row in rows
        if row.failed
    ]
    section = Section("What failed", "failed")
    section.table(failed, ("", "runs", "message"), captions.FAILED)
    return section


def notes(rows: Sequence[Row]) -> list[str]:
    """Return the sentence that states why success rates have no interval, if any has none for lack of airs."""
    estimates = (row.estimates[SUCCESS.name] for row in rows)
    return [captions.NO_INTERVALS] if any(e and e.over == "too few airs" for e in estimates) else []


def brief(rows: Sequence[Row]) -> tuple[list[list[str]], list[str]]:
    """Return cells and heads of the standings: success with its interval, the other quantities as means."""
    shown = [q for q in MEASURES if q not in ON_PAGE and any(row.estimates[q.name] for row in rows)]
    heads = ["scenario", "algorithm", *(plots.title(q, short=True) for q in shown)]
    cells = [
        [
            row.scenario,
            visible(row.algorithm),
            *((q.cell if q is SUCCESS else q.mean)(row.estimates[q.name]) for q in shown),
        ]
        for row in rows
    ]
    return cells, heads


def show_table(rows: Sequence[Row]) -> None:
    """Print the contest's standings in the terminal, see `brief`."""
    from rich.table import Table as Shown

    cells, heads = brief(rows)
    table = Shown(box=None, padding=(0, 1, 0, 0))
    for n, head in enumerate(("", *heads[2:])):
        table.add_column(head, no_wrap=n < 2, min_width=5)
    before = ""
    for scenario, algorithm, *others in cells:
        if scenario != before:
            table.add_row(scenario, style="bold")
        before = scenario
        table.add_row(f" {algorithm}", *others)
    show(table)
    say(*notes(rows))
