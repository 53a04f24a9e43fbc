"""`report.html` of a study: what was varied and what came of it, on one page that needs nothing else; words first."""

import shlex
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.report import html
from taichi_plume.report.html import Image, Section, Table
from taichi_plume.study import captions, cells, columns, costs, indices, plots, refine
from taichi_plume.study.points import SUCCESS, TIME, Points, Quantity
from taichi_plume.study.results import Results, open_study

NAME = "report.html"
MOST_POINTS, BEST, WORST = 40, 20, 10  # rows of the table: all, or of each end
MOST_ALONG = 8  # axes that are plotted
MOST_FAULTS = 12  # messages
MOST_SHOWN = 12  # values of an axis
MOST_KINDS = 6  # quantities or combinations whose indices or orders are shown


def write(folder: Path) -> Path:
    """Write the page of a study, finished or not, into its folder; returns its path.

    Raises RunFolderError, in a line, and OSError.
    """
    study = open_study(folder)
    status = study.runs()["status"].value_counts().to_dict()
    done, asked = status.get("completed", 0) + status.get("stopped", 0), sum(status.values())
    return html.write(
        folder / NAME, Page(study).sections(),
        name=study.plan.about["name"], what="report of a study", about="Report of a study of taichi_plume",
        status=f"{done:,} of {asked:,} runs", good=done == asked, message=_left(status),
    )  # fmt: skip


def _left(status: dict[str, int]) -> str:
    told = [f"{status[name]:,} {name}" for name in ("failed", "missing") if status.get(name)]
    return ", ".join(told)


class Page:
    """The sections of a study's page."""

    def __init__(self, study: Results):
        self.study, self.folder = study, study.folder
        self.points: Points = study.by_points
        self.about = study.plan.about
        self.named, self.numeric = plots.named(self.points), plots.numeric(self.points)
        self.by = next((axis for axis in self.named if len(plots.values_of(self.points, axis)) <= 24), None)
        known = [one for one in self.points.quantities if any(self.points.estimates[one.name])]
        self.main = [one for one in known if one in (SUCCESS, TIME)]
        self.others = [one for one in known if one.what == "runs"]
        self.varying = [one for one in self.others if np.ptp(self._means(one)) > 0]
        self.known = known

    def _means(self, one: Quantity) -> np.ndarray:
        return np.array([each.mean for each in self.points.estimates[one.name] if each])

    def sections(self) -> Iterator[Section]:
        """All of them, in their order; those of which there is nothing are empty."""
        yield self.words()
        yield self.varied()
        yield self.along()
        yield self.kind()
        yield self.table()
        yield self.failures()
        yield self.costs()
        yield self.reading()
        yield self.again()

    def words(self) -> Section:
        """The result in sentences."""
        section = Section("The result in words", "words")
        said = [one for one in self.known if one.name in ("declared", "localisation_error_m")]
        for one in [*(self.main or self.others)[:2], *said]:
            rows = []
            whole = self.points.estimated(one, ["all"])
            rows += [("all", cells.said(one, each)) for each in whole.values()]
            for axis in self.named[:2]:
                told = self.points.estimated(one, [axis])
                rows += [
                    (f"{axis}: {value}", cells.said(one, told[value]))
                    for value in plots.values_of(self.points, axis)[:MOST_SHOWN]
                    if value in told
                ]
            section.tables.append(Table(rows, (one.title, "")))
        section.tables += list(self._apart())
        if TIME in self.main:
            section.lines.append(captions.FAILURES)
        if self.points.trials["shares_arena"].any():
            section.lines.append(captions.SHARED)
        if any(one and one.airs > 1 for told in self.points.estimates.values() for one in told):
            section.lines.append(captions.OVER_AIRS)
        return section

    def _apart(self) -> Iterator[Table]:
        """Values of the first axis of names beside its first, where they met the same airs."""
        axis = next((one for one in self.named if one in self.points.axes), None)
        if axis is None or SUCCESS not in self.main:
            return
        rows = []
        for row in self.points.differences(axis):
            apart, others = row["apart"], [name for name in self.points.axes if name != axis]
            if apart.airs < 2:
                continue
            where = ", ".join(
                f"{name} {cells.plain(row[name])}" for name in others if name in self.named + self.numeric
            )
            rows.append((where, f"{row['second']} - {row['first']}", *cells.apart_words(apart)))
            if len(rows) > MOST_SHOWN:
                break
        if rows:
            more = f" The first {MOST_SHOWN} are shown." if len(rows) > MOST_SHOWN else ""
            heads = ("in the same airs", "success of", "differs by [percentage points]", "95 % interval")
            yield Table(rows[:MOST_SHOWN], heads, captions.APART + more)

    def varied(self) -> Section:
        """The axes."""
        section = Section("What was varied", "varied")
        told = self.about["study"].get("axes") or {}
        rows = []
        for axis in self.study.plan.axes:
            values = list(dict.fromkeys(self.study.plan.table[axis.name].to_pylist()))
            if columns.is_number(self.study.plan.table, axis.name):
                values.sort()
            text = ", ".join(map(cells.plain, values[:MOST_SHOWN]))
            if len(values) > MOST_SHOWN:
                text = (
                    f"{cells.plain(values[0])} to {cells.plain(values[-1])}"
                    if not isinstance(values[0], str)
                    else f"{text} ..."
                )
            rows.append(
                (axis.name, cells.keys(told.get(axis.name)), text, axis.unit or "-", f"{len(values):,}")
            )
        if rows:
            section.tables.append(Table(rows, ("axis", "key of the scenario", "values", "unit", "how many")))
        runs = self.points.runs
        airs = int(runs.groupby("point")["air"].nunique().max()) if len(runs) else 0
        each = len(runs) / max(1, runs["point"].nunique() * max(1, airs))
        points = int(runs["point"].nunique())
        base = self.about["study"].get("base", "a scenario")
        section.lines.append(
            f"{points:,} point{'s' * (points != 1)}, each in {airs:,} air{'s' * (airs != 1)} with {each:.3g} "
            f"run{'s' * (each != 1)} in each: {len(runs):,} runs. The base is {base}."
        )
        if len(runs) and not runs["air_by_chance"].any():
            section.lines.append(captions.STILL)
        return section

    def along(self) -> Section:
        """Plots along each axis, and over pairs of them."""
        section = Section("Along the axes", "along")
        some = self.main or self.others[:2]
        if not some:
            return section
        lines = f", by {self.by}" if self.by else ""
        kinds = [one for one in (self.main, self.varying[:2], self.varying[2:4]) if one] or [some]
        for axis in self.numeric[:MOST_ALONG]:
            few = len(plots.values_of(self.points, axis)) <= plots.MOST_VALUES
            caption = captions.ALONG if few else captions.RUNNING
            for kind in kinds:
                title = f"{' and '.join(one.name for one in kind)} over {axis}{lines}"
                section.images.append(Image(plots.along(self.points, axis, self.by, kind), title, caption))
        for axis in self.named[:MOST_ALONG]:
            section.images.append(
                Image(plots.between(self.points, axis, some), f"By {axis}", captions.BETWEEN)
            )
        grid = [axis for axis in self.numeric if len(plots.values_of(self.points, axis)) <= plots.MOST_VALUES]
        for pair in list(pairwise(grid))[:3]:
            title = f"{some[0].title} over {pair[0]} and {pair[1]}{lines}"
            section.images.append(
                Image(plots.heat(self.points, pair, self.by, some[0]), title, captions.HEAT)
            )
        left = len(self.numeric) + len(self.named) - 2 * MOST_ALONG
        if left > 0:
            section.lines.append(f"{left} more axes are not drawn; results.points() has all.")
        return section

    def kind(self) -> Section:
        """Sobol indices, or orders of refinement."""
        if self.about["kind"] == "sensitivity":
            return self._indices()
        if self.about["kind"] == "refinement":
            return self._orders()
        return Section("", "")

    def _indices(self) -> Section:
        section = Section("Which axes matter", "sensitivity", lines=[captions.INDICES])
        for one, group, found in list(indices.found(self.points))[:MOST_KINDS]:
            title = one.title + (f", {group}" if group and "group" in self.named else "")
            section.lines += [f"{title}: {line}." for line in indices.words(found)]
            if not found.indices:
                continue
            section.images.append(Image(plots.sensitivity(title, found.indices), title, captions.SOBOL))
            rows = [
                (axis, f"{each[0]:.2f}", cells.ends(*each[1:3]), f"{each[3]:.2f}", cells.ends(*each[4:]))
                for axis, each in found.indices.items()
            ]
            section.tables.append(Table(rows, (title, "first order", "95 %", "total", "95 %")))
        return section

    def _orders(self) -> Section:
        section = Section("Refinement of the grid", "refinement")
        axis = refine.axis_of(self.about)
        if axis is None or axis not in self.points.axes:
            section.lines.append("The study has no axis on domain.spacing.")
            return section
        section.lines.append(captions.ORDERS)
        rows = list(refine.orders(self.points, axis))
        for one in self.known[:MOST_KINDS]:
            mine = [row for row in rows if row["quantity"] == one.name]
            names = [self._combination(row, axis) for row in mine]
            if not mine:
                continue
            image = plots.refinement(mine, names, one.title, one.unit)
            section.images.append(Image(image, f"{one.title} over the spacing", captions.SPACING))
            told = [
                (name or "all", ", ".join(f"{value:.4g}" for value in row["values"]), refine.words(row))
                for row, name in list(zip(mine, names, strict=True))[:MOST_SHOWN]
            ]
            heads = (one.title, "values, finest first", "order")
            section.tables.append(Table(told, heads))
        return section

    def _combination(self, row: dict[str, Any], axis: str) -> str:
        others = [name for name in (*self.named, *self.numeric) if name != axis and name in row]
        return ", ".join(cells.plain(row[name]) for name in others)

    def table(self) -> Section:
        """The points."""
        section = Section("The points", "points")
        table, told = self.points.table, self.points.estimates
        some = [one for one in self.known if one.name != "time_s"]
        axes = [axis for axis in (*self.points.axes, "group") if axis in self.numeric or axis in self.named]
        order, caption = np.arange(len(table)), captions.POINTS
        if len(table) > MOST_POINTS and some:
            means = np.array([[each.mean if each else np.nan for each in told[one.name]] for one in some[:2]])
            order = np.lexsort([*means[1:], -np.nan_to_num(means[0], nan=-np.inf)])
            order = np.concatenate([order[:BEST], order[-WORST:]])
            caption = (
                captions.SOME_POINTS.format(best=BEST, worst=WORST, all=len(table), first=some[0].title)
                + caption
            )
        rows = []
        for row in order:
            about = table.iloc[row]
            runs = f"{about['runs']}"
            for name in ("failed", "missing"):
                runs += f", {about[name]} {name}" if about[name] else ""
            means = [cells.cell(one, told[one.name][row]) for one in some]
            rows.append((*(cells.plain(about[axis]) for axis in axes), *means, runs))
        heads = tuple(plots.label(self.points, axis) for axis in axes)
        section.tables.append(Table(rows, (*heads, *(cells.head(one) for one in some), "runs"), caption))
        return section

    def failures(self) -> Section:
        """What failed, how to repeat it, and what is missing."""
        section = Section("What failed, and what is missing", "failures")
        runs = self.points.runs
        failed = runs[runs["status"] == "failed"]
        rows = []
        for message, part in sorted(failed.groupby("message"), key=lambda one: -len(one[1])):
            scenario = self.folder / "failed" / str(part["run"].iloc[0]) / "scenario.yaml"
            command = shlex.join(["python", "-m", "taichi_plume.run", str(scenario)])
            rows.append((f"{len(part):,}", str(message) or "no message", command))
        if rows:
            more = (
                f" {len(rows) - MOST_FAULTS:,} more messages are in results.runs()."
                if len(rows) > MOST_FAULTS
                else ""
            )
            heads = ("runs", "message", "to run one of them again")
            section.tables.append(Table(rows[:MOST_FAULTS], heads, captions.FAILED + more))
        missing = int((runs["status"] == "missing").sum())
        if missing:
            section.lines.append(captions.MISSING.format(missing=missing, all=len(runs)))
        return section

    def costs(self) -> Section:
        """What it took."""
        rows = costs.told(self.study.tables.costs)
        return Section("What it took", "costs", tables=[Table(rows, (), captions.COSTS)] if rows else [])

    def reading(self) -> Section:
        """How to read the tables."""
        folder, trials = self.folder, f"{self.folder}/trials"
        lines = [
            f'from taichi_plume import study; results = study.open("{folder}"); results.points(); results.trials()',
            f"duckdb -c \"select * from '{trials}/**/*.parquet'\"",
            f'pandas.read_parquet("{trials}")',
            f'polars.read_parquet("{trials}/**/*.parquet")',
        ]
        return Section("How to read the tables", "read", lines=lines, code=True)

    def again(self) -> Section:
        """How to go on."""
        out = str(self.folder.resolve())
        lines = [
            shlex.join(["python", "-m", "taichi_plume.study", str(self.about["file"]), "--out", out]),
            shlex.join(["python", "-m", "taichi_plume.study", "report", out]),
        ]
        return Section("How to go on", "again", lines=lines, tables=[Table(captions.AGAIN)], code=True)
