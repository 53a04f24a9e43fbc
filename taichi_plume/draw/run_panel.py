"""The runs of a session as widgets of Bokeh: progress, readings, the list, and report and recording beside."""

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    ColumnDataSource,
    DataTable,
    Div,
    HTMLTemplateFormatter,
    Select,
    Spacer,
    Span,
    StringFormatter,
    TableColumn,
    TextInput,
    Toggle,
)
from bokeh.plotting import figure

from taichi_plume.draw.canvas import Canvas
from taichi_plume.draw.document import data_of
from taichi_plume.draw.objects import Scene, named, names
from taichi_plume.draw.repeats import COUNT, Repeats
from taichi_plume.draw.runs import LISTED, Run
from taichi_plume.execution.latest_instant import Instant, Picture
from taichi_plume.observed.scales import Scale
from taichi_plume.report import theme
from taichi_plume.report.theme import ABOVE

if TYPE_CHECKING:
    from taichi_plume.draw.page import Page

DECADES = Scale(-2.0, 2.0, "linear")  # of a ratio of concentrations
LOOKS = {
    "source found": ("✓ ", "good"), "completed": ("", ""), "ended early": ("", ""), "interrupted": ("■ ", "warn"),
    "failed": ("✗ ", "bad"), "unstable": ("✗ ", "bad"), "disk_full": ("✗ ", "bad"),
}  # fmt: skip
"""Mark of a run by how it ended, and its class in the style sheet; of one that goes on: GOING."""
GOING = ("", "going")
COLUMNS = {"run": 34, "name": 120, "state": 115, "found": 170, "changed": 200, "simulated": 65, "took": 45}
"""Columns of the list and their widths [pixels]."""
ROW = 26  # pixels
DIFFERENCE, BESIDE = "difference", "side by side"


Pair = tuple[Picture | None, Picture | None]


class RunPanel:
    """Widgets of the runs on a page."""

    def __init__(self, page: "Page"):
        self.page, self.number = page, 0
        self._shown: tuple[Instant | None, Run | None, Run | None] = None, None, None
        self._drawn: dict[str, np.ndarray | None] = {}  # readings of the curves' sources
        self._pair: tuple[tuple[object, ...], Pair] = (), (None, None)
        self.beside = Canvas(ABOVE, page.canvases[ABOVE])  # the compared run
        # below it: the side view is then as wide as the plan
        self.below = Spacer(sizing_mode="stretch_width", visible=False)
        self.beside.figure.visible = False
        self._room: Scene | None = None  # that is drawn there
        self._listed: list[int] = []  # numbers of the runs in the table
        self._marking = False  # name and pin of another run are being shown
        self._frames: tuple[int, bool] = (0, False)
        self.stop = Button(label="■ Stop", width=80, disabled=True, name="stop")
        self.stop.on_click(self._stop)
        self.repeat = Button(label=f"▶ Run with {COUNT} seeds", width=150, name="repeat")
        self.repeat.on_click(lambda: page.run(Repeats))
        self.progress = Div(sizing_mode="stretch_width", name="progress")
        self.output = Div(width=400, name="output")
        self.links = Div(width=400, name="links")
        self.curves = ColumnDataSource({"xs": [], "ys": [], "color": []})
        labels: Any = {"x_axis_label": "t [s]", "y_axis_label": "reading [ppm]"}
        self.plot = figure(height=200, width=400, tools="", toolbar_location=None, **labels)
        self.plot.visible = False  # until there are readings
        self.plot.multi_line("xs", "ys", line_color="color", line_width=1.5, source=self.curves)
        self.dashed = ColumnDataSource({"xs": [], "ys": [], "color": []})  # of the compared run
        self.plot.multi_line("xs", "ys", line_color="color", line_dash="dashed", source=self.dashed)
        self.plot.outline_line_color = None
        self.plot.axis.minor_tick_line_color = None
        self.now = Span(dimension="height", location=0.0, visible=False, line_color=theme.FAINT)
        self.plot.add_layout(self.now)
        self.plot.axis.axis_label_text_font_style = "normal"
        self.quantity = Select(title="shown quantity", width=330, visible=False, name="quantity")
        self.quantity.on_change("value", lambda _attr, _old, _new: page.look())
        self.other = Select(title="compared with", width=200, visible=False, name="other")
        self.other.on_change("value", lambda _attr, _old, _new: page.look())
        self.way = Select(title="as", width=120, options=[DIFFERENCE, BESIDE], value=DIFFERENCE, name="way")
        self.way.on_change("value", lambda _attr, _old, _new: page.look())
        self.take = Button(label="Take its room", width=110, name="take")
        self.take.on_click(self._take)
        self.remove = Button(label="Delete run", width=95, name="remove")
        self.remove.on_click(self._remove)
        self.title = TextInput(title="name of the run", width=180, name="title")
        self.title.on_change("value", lambda _attr, _old, new: self._mark(new, self.pin.active))
        self.pin = Toggle(label="★ Pin", width=75, align="end", name="pin")
        self.pin.on_change("active", lambda _attr, _old, new: self._mark(self.title.value, bool(new)))
        self.rows = ColumnDataSource({key: [] for key in (*COLUMNS, "look")}, name="rows")
        self.rows.selected.on_change("indices", lambda _attr, _old, new: self._clicked(new))
        words = HTMLTemplateFormatter(template='<b class="<%- look %>"><%- value %></b>')  # both escaped
        columns = [
            TableColumn(
                field=key, title=key, width=width, formatter=words if key == "state" else StringFormatter()
            )
            for key, width in COLUMNS.items()
        ]
        self.table = DataTable(
            source=self.rows, columns=columns, sizing_mode="stretch_width", autosize_mode="none", index_position=None,
            row_height=ROW, name="runs", visible=False,
        )  # fmt: skip
        self.layout = column(
            self.table, row(self.stop, self.progress, sizing_mode="stretch_width"), self.output, self.links,
            row(self.title, self.pin), self.quantity, row(self.other, self.way), self.plot,
            row(self.take, self.remove), self.repeat,
            sizing_mode="stretch_both", css_classes=["scrolls"],
        )  # fmt: skip
        first = "<p>Run the scenario first.</p>"
        self.report = Div(text=first, sizing_mode="stretch_both", css_classes=["whole"], name="report")
        self.recording = Div(text=first, sizing_mode="stretch_both", css_classes=["whole"], name="recording")

    @property
    def run(self) -> Run | None:
        """The run that is shown."""
        return self.page.workplace.run_of(self.number)

    @property
    def sight(self) -> Instant | None:
        """State of the shown run at the chosen time.

        Without a choice it is the last; None once the run has ended and the text has changed.
        """
        run, t = self.run, self.page.time.t
        if run is not None and t is not None:
            return run.moment(t)
        return run.sight if run is not None and (run.alive or run.text == self.page.workplace.text) else None

    @property
    def picture(self) -> Picture | None:
        """Picture of the shown run, or its difference from the compared run; None without `sight`."""
        return self._pictures()[0]

    @property
    def other_sight(self) -> Instant | None:
        """State of the compared run at the time of `sight`; None without either."""
        sight, other = self.sight, self.compared
        return other.moment(sight.t) if sight is not None and other is not None else None

    def _pictures(self) -> Pair:
        """Return pictures of the chosen quantity, by default the first, of the shown and of the compared run.

        The second has the colours of the first. Shown as a difference, the first is the difference.
        """
        sight, other, moment = self.sight, self.compared, self.other_sight
        pictures = sight.pictures if sight is not None else {}
        name = str(self.quantity.value) if self.quantity.value in pictures else next(iter(pictures), "")
        a, b = pictures.get(name), moment.pictures.get(name) if moment is not None else None
        key = (a, b, self.way.value)
        if len(self._pair[0]) == len(key) and all(x is y for x, y in zip(key, self._pair[0], strict=True)):
            return self._pair[1]
        if a is not None and b is not None and other is not None:
            if self.way.value == BESIDE:
                b = b._replace(scale=a.scale)
            elif a.values.shape == b.values.shape:
                a = difference(a, b, f"run {self.number}", f"run {other.number}")
        self._pair = key, (a, b)
        return self._pair[1]

    @property
    def compared(self) -> Run | None:
        """The run with which the shown one is compared."""
        chosen = str(self.other.value)
        return self.page.workplace.run_of(int(chosen)) if chosen.isdecimal() else None

    # ---------------------------------------------------------------- run and stop

    def start(self, text: str, agreed: frozenset[str] = frozenset(), kind: type[Run] = Run) -> None:
        """Start a run of a text once the user has agreed to each of its Python files, by the SHA-256 of the file.

        The question has the words of the command. The run's process executes these files only if they still have this
        SHA-256. kind: Run, or Repeats for runs with several seeds.
        """
        page, work = self.page, self.page.workplace
        findings = work.check(text)[1]
        work.found(text, findings)
        if not findings.sound:
            page.say("the scenario has errors; see Remarks")
            return
        data = data_of(text)
        if kind is Repeats and not (data.get("robots") or data.get("gas")):
            page.say("the room has neither robots nor gas: its runs have no result to be repeated")
            return
        digests = frozenset(findings.code.values())
        if kind is Repeats and digests and not work.allow_code:
            page.say("the room names Python code: runs with several seeds need `draw --allow-code`")
            return
        if not work.allow_code and not digests <= agreed:
            words = named(" ".join([*findings.code, "Run it?"]), names(data_of(text)))
            page.ask(words, lambda: self.start(text, digests), lambda: page.say("not run"))
            return
        run = page.tried(lambda: work.run(text, agreed, kind))
        if run is not None:
            self.number = run.number
        page.look()

    def _take(self) -> None:
        if self.run is not None:
            self.page.put(self.run.text)

    def _remove(self) -> None:
        page, run = self.page, self.run
        if run is not None and not run.alive:
            words = f"Delete run {run.number} and its folder {run.folder.name}? This cannot be undone."
            page.ask(words, lambda: page.workplace.discard(run))

    def _stop(self) -> None:
        if self.run is not None:
            self.run.stop()
            self.page.look()

    # ---------------------------------------------------------------- show

    def refresh(self) -> None:
        """Show the present state of the runs."""
        runs = self.page.workplace.runs
        if self.run is None:  # the latest of the session
            self.number = next((run.number for run in reversed(runs) if run.begun_here), 0)
        self._show_list()
        run = self.run
        if run is None:
            self.progress.text, self.links.text, self.plot.visible = "", "", False
            return
        self.stop.disabled = not run.alive
        self._show_progress(run)
        seen = self.sight or run.sight
        self._show_clock(seen)
        shown = seen, run, self.compared
        if any(a is not b for a, b in zip(shown, self._shown, strict=True)):
            self._shown = shown
            self._show_readings(seen)
            self._show_quantities(seen)
        failed = LOOKS.get(run.words, GOING)[1] == "bad"
        lines = [line for line in run.output if line != run.why] if failed else []
        self.output.visible = bool(lines)
        self.output.text = "".join(f"<div>{escape(run.scene.named(line))}</div>" for line in lines)
        self._show_frames(run)

    def show_beside(self) -> None:
        """Show the compared run in a view beside, at the same time and on the same scales, if that is chosen."""
        other, seen = self.compared, self.other_sight
        self.way.visible = other is not None
        there = self.way.value == BESIDE and other is not None and seen is not None
        self.beside.figure.visible = self.below.visible = there
        title: Any = self.page.canvases[ABOVE].figure.title
        title.text = f"run {self.number}" if there else ""
        if other is None or seen is None or not there:
            return
        self.beside.show_run(seen, other.scene, other.scene, "", self._pictures()[1])
        if self._room is not other.scene:
            self._room = other.scene
            self.beside.show(other.scene)
        title = self.beside.figure.title
        title.text = f"run {other.number}"
        if self.sight is not None and seen.t < self.sight.t - max(1.0, 0.05 * seen.end):
            title.text += f", at its last moment, {seen.t:.1f} s"

    def _show_progress(self, run: Run) -> None:
        left, clock = run.left, run.clock if run.alive else ""
        remaining = f", about {left:.0f} s left" if left is not None else ""
        bar = f"<progress max='1' value='{run.done:.3f}'></progress>" if run.alive else ""
        (mark, look), why = LOOKS.get(run.words, GOING), run.scene.named(run.why)
        state = f"<b class='{look}'>{mark}{escape(run.words.replace('_', ' '))}</b>"
        text = (
            f"{bar} <b>run {run.number}</b> {state}{': ' * bool(why)}{escape(why or f' {clock}{remaining}')}"
        )
        self.progress.text = "".join(
            f"<div>{line}</div>" for line in [text, *map(escape, run.found(full=True))]
        )

    def _show_clock(self, seen: Instant | None) -> None:
        self.now.visible = self.page.time.t is not None and seen is not None
        self.now.location = seen.t if seen is not None else 0.0

    def _show_readings(self, sight: Instant | None) -> None:
        other = self.compared
        last = other.moment(np.inf) if other is not None else None
        for source, seen in ((self.curves, sight), (self.dashed, last)):
            table = seen.readings if seen is not None else None
            if table is self._drawn.get(source.id):
                continue
            self._drawn[source.id] = table
            times, *readings = table.T if table is not None else [np.empty(0)]
            source.data = {
                "xs": [times for _ in readings],
                "ys": readings,
                "color": [theme.robot(n) for n in range(len(readings))],
            }
        title: Any = self.plot.title
        title.text = f"lines: run {self.number}, dashed: run {other.number}" if other is not None else ""
        self.plot.visible = bool(self.curves.data["xs"] or self.dashed.data["xs"])

    def _show_quantities(self, sight: Instant | None) -> None:
        """Offer the quantities of a run; the chosen one stays if the run has it."""
        options = [(name, of.quantity) for name, of in sight.pictures.items()] if sight is not None else []
        if self.quantity.options == options:
            return
        names = [name for name, _ in options]
        chosen = self.quantity.value if self.quantity.value in names else (names or [""])[0]
        self.quantity.update(options=options, value=chosen, visible=len(options) > 1)

    def _show_frames(self, run: Run) -> None:
        there = not run.alive and (run.folder / "report.html").is_file()
        if (run.number, there) == self._frames:
            return
        self._frames = (run.number, there)
        base, links = f"runs/{run.number}", ""
        self.report.text = "<p>The run has no report yet.</p>"
        self.recording.text = "<p>The run has no recording yet.</p>"
        if there:
            self.report.text = f'<iframe title="report" src="{base}/report.html"></iframe>'
            links = f'<a href="{base}/report.html" target="_blank">report</a> &nbsp; '
            links += f'<a href="{base}/run.zip">ZIP of run {run.number}</a>'
        self.links.text = links

    def show_recording(self) -> None:
        """Load the recording in rerun's viewer, which is large: once its tab is opened."""
        run = self.run
        if run is None or not (run.folder / "recording.rrd").is_file() or run.alive:
            return
        self.recording.text = f'<iframe title="recording" src="viewer/?run={run.number}"></iframe>'

    def _show_list(self) -> None:
        """Show the pinned and then the last runs below each other, the newest first."""
        runs = [run for run in reversed(self.page.workplace.runs) if not run.discarded]
        pinned = [run for run in runs if run.pinned]
        runs = pinned + [run for run in runs if not run.pinned][:LISTED]
        rows = [run.row() | {"look": LOOKS.get(run.words, GOING)[1]} for run in runs]
        for line in rows:
            line["state"] = LOOKS.get(line["state"], GOING)[0] + line["state"].replace("_", " ")
        listed = {key: [line[key] for line in rows] for key in (*COLUMNS, "look")}
        if listed != self.rows.data:
            self.rows.data = listed
            self.table.tags = [
                not any(self.table.tags)
            ]  # a change of data of as many rows alone is not drawn
        self._listed = [run.number for run in runs]
        chosen = [n for n, number in enumerate(self._listed) if number == self.number]
        if self.rows.selected.indices != chosen:
            self.rows.selected.indices = chosen
        self.table.update(height=ROW * (len(runs) + 1) + 22, visible=bool(runs))
        others = [("", "none")]
        others += [
            (str(run.number), f"{run.number}: {run.name}") for run in runs if run.number != self.number
        ]
        stays = self.other.value if self.other.value in dict(others) else ""
        self.other.update(options=others, value=stays, visible=len(others) > 1 and self.number > 0)
        run = self.run
        for part in (self.take, self.remove, self.title, self.pin):
            part.visible = run is not None
        if run is not None:
            self._marking = True
            self.title.update(value=run.label[0], placeholder=run.folder.name)
            self.pin.active = run.pinned
            self._marking = False
            self.remove.disabled = run.alive or run.elsewhere or run.pinned

    def _clicked(self, rows: list[int]) -> None:
        if len(rows) == 1 and rows[0] < len(self._listed):
            self.choose(self._listed[rows[0]])

    def choose(self, number: int) -> None:
        """Show another run: one that goes on at its latest moment, one that has ended at its last."""
        if number != self.number:
            self.number = number
            run = self.run
            self.page.time.choose(None if run is None or run.alive else run.recorded[1])

    def _mark(self, name: str, pinned: bool) -> None:
        run = self.run
        if run is not None and not self._marking and (name.strip(), pinned) != run.label:
            self.page.tried(lambda: self.page.workplace.mark(run, name, pinned))


def difference(a: Picture, b: Picture, first: str, second: str) -> Picture:
    """Return how two pictures of a quantity differ: as a ratio in powers of ten on a logarithmic scale, else a - b."""
    if a.scale.kind == "log":
        low = np.float32(a.scale.low)  # below, all counts as nothing
        ratio = np.log10(np.maximum(a.values, low) / np.maximum(b.values, low))
        return Picture(f"{a.quantity}, {first} / {second}", "decades", DECADES, a.cell, ratio, a.plane)
    most = a.scale.high - a.scale.low
    scale = Scale(-most, most, "linear")
    return a._replace(quantity=f"{a.quantity}, {first} - {second}", scale=scale, values=a.values - b.values)
