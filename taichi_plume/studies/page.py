"""HTML report page of a parameter study (`report.html`): axes, results and figures on one self-contained page."""

import shlex
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from taichi_plume.report import html
from taichi_plume.report.html import Section, Table
from taichi_plume.studies import captions, columns, grid_refinement, indices, intervals, plots
from taichi_plume.studies.estimates import SUCCESS, TIME, Points, Quantity
from taichi_plume.studies.messages import Value
from taichi_plume.studies.results import Results, cost_words, open_study

NAME = "report.html"
MOST_POINTS, BEST, WORST = 40, 20, 10  # rows of the table; of longer tables only the best and worst are shown
MOST_ALONG = 8  # axes that are plotted
MOST_FAULTS = 12  # messages of failed runs
MOST_SHOWN = 12  # values of an axis
MOST_KINDS = 6  # quantities or combinations whose indices or orders are shown


def write(folder: Path) -> Path:
    """Write the HTML report page of a study, finished or not, into the study's folder; return the page's path.

    Raises RunFolderError and OSError.
    """
    study = open_study(folder)
    status = study.runs()["status"].value_counts().to_dict()
    done, asked = status.get("completed", 0) + status.get("stopped", 0), sum(status.values())
    left = [f"{status[name]:,} {name}" for name in ("failed", "missing") if status.get(name)]
    return html.write(
        folder / NAME, Page(study).sections(),
        name=study.plan.about["name"], what="report of a study", about="Report of a study of taichi_plume",
        status=f"{done:,} of {asked:,} runs", good=done == asked, message=", ".join(left),
    )  # fmt: skip


class Page:
    """Builder of the sections (tables, figures and sentences) of a parameter study's report page."""

    def __init__(self, study: Results):
        self.study, self.folder = study, study.folder
        self.points: Points = study.by_points
        self.about = study.plan.about
        self.named, self.numeric = plots.named(self.points), plots.numeric(self.points)
        self.by = next((axis for axis in self.named if len(self._values(axis)) <= 24), None)
        self.known = [q for q in self.points.quantities if any(self.points.estimates[q.name])]
        self.main = [q for q in self.known if q in (SUCCESS, TIME)]
        self.others = [q for q in self.known if q.what == "runs"]
        self.varying = [q for q in self.others if np.ptp(self._means(q)) > 0]

    def _values(self, axis: str) -> list[Value]:
        return plots.values_of(self.points, axis)

    def _means(self, quantity: Quantity) -> np.ndarray:
        return np.array([estimate.mean for estimate in self.points.estimates[quantity.name] if estimate])

    def sections(self) -> list[Section]:
        """Return all sections of the report page in their order; a section without content is empty."""
        folder, trials, study = self.folder, f"{self.folder}/trials", ["python", "-m", "taichi_plume.study"]
        costs = Section("Cost", "costs")
        costs.table(cost_words(self.study.tables.costs), (), captions.COSTS)
        reading = [
            f'import taichi_plume as tp; results = tp.open_study("{folder}"); results.points(); results.trials()',
            f"duckdb -c \"select * from '{trials}/**/*.parquet'\"",
            f'pandas.read_parquet("{trials}")',
            f'polars.read_parquet("{trials}/**/*.parquet")',
        ]
        out = str(folder.resolve())
        again = [
            shlex.join([*study, str(self.about["file"]), "--out", out]),
            shlex.join([*study, "report", out]),
        ]
        return [
            self._words(), self._varied(), self._along(), self._kind(), self._table(), self._failures(), costs,
            Section("How to read the tables", "read", lines=reading, code=True),
            Section("How to resume", "again", lines=again, tables=[Table(captions.AGAIN)], code=True),
        ]  # fmt: skip

    def _words(self) -> Section:
        """Return the main results in sentences, for all runs and by axis value."""
        section = Section("The result in words", "words")
        declared = [q for q in self.known if q.name in ("declared", "localisation_error_m")]
        for quantity in [*(self.main or self.others)[:2], *declared]:
            rows = [("all", quantity.words(e)) for e in self.points.estimated(quantity, ["all"]).values()]
            for axis in self.named[:2]:
                found = self.points.estimated(quantity, [axis])
                values = [value for value in self._values(axis)[:MOST_SHOWN] if value in found]
                rows += [(f"{axis}: {value}", quantity.words(found[value])) for value in values]
            section.table(rows, (quantity.title, ""))
        self._differences(section)
        several = any(e and e.airs > 1 for column in self.points.estimates.values() for e in column)
        section.lines += [captions.FAILURES] * (TIME in self.main)
        section.lines += [captions.SHARED] * bool(self.points.trials["shares_arena"].any())
        section.lines += [captions.OVER_AIRS] * several
        return section

    def _differences(self, section: Section) -> None:
        """Add a table: success at other values of an axis minus success at its first value, in the same airs."""
        axis = next((name for name in self.named if name in self.points.axes), None)
        if axis is None or SUCCESS not in self.main:
            return
        others = [name for name in self.points.axes if name != axis and name in self.named + self.numeric]
        paired = (row for row in self.points.differences(axis) if row["apart"].airs >= 2)
        rows = [
            (
                ", ".join(f"{name} {_plain(row[name])}" for name in others),
                f"{row['second']} - {row['first']}",
                *_apart_words(row["apart"]),
            )
            for row in islice(paired, MOST_SHOWN + 1)
        ]
        more = f" The first {MOST_SHOWN} are shown." if len(rows) > MOST_SHOWN else ""
        heads = ("in the same airs", "success of", "differs by [percentage points]", "95 % interval")
        section.table(rows[:MOST_SHOWN], heads, captions.APART + more)

    def _varied(self) -> Section:
        """Return the study's axes, their values, and the numbers of points and runs."""
        section = Section("What was varied", "varied")
        plan, axes = self.study.plan, self.about["study"].get("axes") or {}
        rows = []
        for axis in plan.axes:
            values = list(dict.fromkeys(plan.table[axis.name].to_pylist()))
            if columns.is_number(plan.table, axis.name):
                values.sort()
            text = ", ".join(map(_plain, values[:MOST_SHOWN]))
            if len(values) > MOST_SHOWN:
                ends = f"{_plain(values[0])} to {_plain(values[-1])}"
                text = f"{text} ..." if isinstance(values[0], str) else ends
            rows.append((axis.name, _keys(axes.get(axis.name)), text, axis.unit or "-", f"{len(values):,}"))
        section.table(rows, ("axis", "key of the scenario", "values", "unit", "how many"))
        runs = self.points.runs
        airs = int(runs.groupby("point")["air"].nunique().max()) if len(runs) else 0
        points = int(runs["point"].nunique())
        each = len(runs) / max(1, points * max(1, airs))
        base = self.about["study"].get("base", "a scenario")
        section.lines.append(
            f"{points:,} point{'s' * (points != 1)}, each in {airs:,} air{'s' * (airs != 1)} with {each:.3g} "
            f"run{'s' * (each != 1)} in each: {len(runs):,} runs. The base is {base}."
        )
        if len(runs) and not runs["air_by_chance"].any():
            section.lines.append(captions.STILL)
        return section

    def _along(self) -> Section:
        """Return plots of results along each axis and heat maps over pairs of numeric axes."""
        section = Section("Along the axes", "along")
        shown = self.main or self.others[:2]
        if not shown:
            return section
        lines = f", by {self.by}" if self.by else ""
        kinds = [group for group in (self.main, self.varying[:2], self.varying[2:4]) if group] or [shown]
        grid = [axis for axis in self.numeric if len(self._values(axis)) <= plots.MOST_VALUES]
        for axis in self.numeric[:MOST_ALONG]:
            caption = captions.ALONG if axis in grid else captions.RUNNING
            for kind in kinds:
                title = f"{' and '.join(quantity.name for quantity in kind)} over {axis}{lines}"
                section.image(plots.along(self.points, axis, self.by, kind), title, caption)
        for axis in self.named[:MOST_ALONG]:
            section.image(plots.between(self.points, axis, shown), f"By {axis}", captions.BETWEEN)
        for pair in list(pairwise(grid))[:3]:
            title = f"{shown[0].title} over {pair[0]} and {pair[1]}{lines}"
            section.image(plots.heat(self.points, pair, self.by, shown[0]), title, captions.HEAT)
        left = len(self.numeric) + len(self.named) - 2 * MOST_ALONG
        if left > 0:
            section.lines.append(f"{left} more axes are not drawn; results.points() has all.")
        return section

    def _kind(self) -> Section:
        """Return Sobol indices or orders of grid convergence; empty for a plain sweep."""
        kinds = {"sensitivity": self._indices, "refinement": self._orders}
        return kinds.get(self.about["kind"], lambda: Section("", ""))()

    def _indices(self) -> Section:
        section = Section("Which axes matter", "sensitivity", lines=[captions.INDICES])
        for quantity, group, found in list(indices.found(self.points))[:MOST_KINDS]:
            title = quantity.title + (f", {group}" if group and "group" in self.named else "")
            section.lines += [f"{title}: {line}." for line in indices.words(found)]
            if not found.indices:
                continue
            section.image(plots.sensitivity(title, found.indices), title, captions.SOBOL)
            rows = [
                (axis, f"{index[0]:.2f}", _ends(*index[1:3]), f"{index[3]:.2f}", _ends(*index[4:]))
                for axis, index in found.indices.items()
            ]
            section.table(rows, (title, "first order", "95 %", "total", "95 %"))
        return section

    def _orders(self) -> Section:
        section = Section("Refinement of the grid", "refinement")
        axis = grid_refinement.axis_of(self.about)
        if axis is None or axis not in self.points.axes:
            section.lines.append("The study has no axis on domain.spacing.")
            return section
        section.lines.append(captions.ORDERS)
        rows = list(grid_refinement.orders(self.points, axis))
        others = [name for name in (*self.named, *self.numeric) if name != axis]
        for quantity in self.known[:MOST_KINDS]:
            mine = [row for row in rows if row["quantity"] == quantity.name]
            if not mine:
                continue
            names = [", ".join(_plain(row[name]) for name in others if name in row) for row in mine]
            image = plots.refinement(mine, names, quantity)
            section.image(image, f"{quantity.title} over the spacing", captions.SPACING)
            lines = [
                (name or "all", ", ".join(f"{v:.4g}" for v in row["values"]), grid_refinement.words(row))
                for row, name in list(zip(mine, names, strict=True))[:MOST_SHOWN]
            ]
            section.table(lines, (quantity.title, "values, finest first", "order"))
        return section

    def _table(self) -> Section:
        """Return a table of mean results per point (combination of axis values)."""
        section = Section("The points", "points")
        table, estimates = self.points.table, self.points.estimates
        shown = [q for q in self.known if q.name != "time_s"]
        axes = [axis for axis in (*self.points.axes, "group") if axis in self.numeric or axis in self.named]
        order, caption = np.arange(len(table)), captions.POINTS
        if len(table) > MOST_POINTS and shown:
            columns_of = [estimates[q.name] for q in shown[:2]]
            means = np.array([[each.mean if each else np.nan for each in column] for column in columns_of])
            order = np.lexsort([*means[1:], -np.nan_to_num(means[0], nan=-np.inf)])
            order = np.concatenate([order[:BEST], order[-WORST:]])
            ends = {"best": BEST, "worst": WORST, "all": len(table), "first": shown[0].title}
            caption = captions.SOME_POINTS.format(**ends) + caption
        rows = []
        for row in order:
            about = table.iloc[row]
            lost = [f"{about[name]} {name}" for name in ("failed", "missing") if about[name]]
            cells = [quantity.cell(estimates[quantity.name][row]) for quantity in shown]
            rows.append(
                (*(_plain(about[axis]) for axis in axes), *cells, ", ".join([f"{about['runs']}", *lost]))
            )
        heads = [plots.label(self.points, axis) for axis in axes]
        section.table(rows, (*heads, *(q.heading for q in shown), "runs"), caption)
        return section

    def _failures(self) -> Section:
        """Return failed runs (messages, commands to repeat them) and missing runs."""
        section = Section("Failed and missing runs", "failures")
        runs = self.points.runs
        rows = []
        failed = runs[runs["status"] == "failed"].groupby("message")
        for message, part in sorted(failed, key=lambda pair: -len(pair[1])):
            scenario = self.folder / "failed" / str(part["run"].iloc[0]) / "scenario.yaml"
            command = shlex.join(["python", "-m", "taichi_plume.run", str(scenario)])
            rows.append((f"{len(part):,}", str(message) or "no message", command))
        left = len(rows) - MOST_FAULTS
        more = f" {left:,} more messages are in results.runs()." if left > 0 else ""
        heads = ("runs", "message", "to run one of them again")
        section.table(rows[:MOST_FAULTS], heads, captions.FAILED + more)
        missing = int((runs["status"] == "missing").sum())
        if missing:
            section.lines.append(captions.MISSING.format(missing=missing, all=len(runs)))
        return section


# ---------------------------------------------------------------- cells of tables


def _apart_words(apart: intervals.Estimate) -> tuple[str, str]:
    """Return two texts: a difference of success rates in percentage points, and its interval or why there is none."""
    points = f"{100 * apart.mean:+.0f}"
    if apart.over in intervals.WITHOUT:
        return points, intervals.without(apart)
    over = intervals.OVER[apart.over].format(airs=apart.airs)
    return points, f"{100 * apart.low:+.0f} to {100 * apart.high:+.0f} {over}"


def _ends(low: float, high: float) -> str:
    return f"{low:.2f} to {high:.2f}" if np.isfinite(low) and np.isfinite(high) else "none"


def _plain(value: object) -> str:
    """Return a value of a study's axis as text; numbers have 4 significant digits."""
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return f"{value:.4g}" if number else str(value)


def _keys(axis: object) -> str:
    """Return the scenario keys that an axis section of study.yaml changes, as text; a dash if there are none."""
    if not isinstance(axis, dict):
        return "-"
    variants = [changes for changes in (axis.get("variants") or {}).values() if isinstance(changes, dict)]
    keys = [axis.get("key"), *(axis.get("keys") or ()), *(key for changes in variants for key in changes)]
    return ", ".join(dict.fromkeys(str(key) for key in keys if key)) or "-"
