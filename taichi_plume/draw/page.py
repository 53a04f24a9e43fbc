"""The page: views, palette, form, text, remarks and runs, each a function of the workplace's text and runs.

A page holds no scenario: pointer and form edit the text, and the text's change redraws all pages of the server.
"""

from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from json import dumps
from math import isfinite
from pathlib import Path
from time import monotonic
from typing import Any

from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    CustomJS,
    Div,
    InlineStyleSheet,
    RadioButtonGroup,
    TabPanel,
    Tabs,
    TextAreaInput,
    TextInput,
)
from bokeh.themes import Theme

from taichi_plume.draw import edits, first_steps
from taichi_plume.draw.canvas import Canvas, paint
from taichi_plume.draw.checks import Findings, Remark
from taichi_plume.draw.context_menu import ContextMenu
from taichi_plume.draw.document import line_of
from taichi_plume.draw.drafts import Draft
from taichi_plume.draw.file_menu import FileMenu
from taichi_plume.draw.form_panel import FormPanel
from taichi_plume.draw.parts import Point, pair
from taichi_plume.draw.pointer import Pointer
from taichi_plume.draw.run_panel import RunPanel
from taichi_plume.draw.runs import Run
from taichi_plume.draw.time_bar import TimeBar
from taichi_plume.draw.words import Words
from taichi_plume.draw.workplace import FileChangedError, Workplace
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.yaml_text import LineError, read_text
from taichi_plume.report.theme import ABOVE, FRONT, SIDE

FINEST = 0.01  # m: step of the arrow keys without a grid
GAP = 30  # ms from one page that follows to the next, in which the server reads what users do
ABOUT_NAME = "Another name saves the text as a new file"
HERE = Path(__file__).parent
STYLE, SCRIPT = (read_text(HERE / name) for name in ("style.css", "page.js"))
HEAD = f"{{% block postamble %}}<style>{STYLE}</style>{{% endblock %}}"
"""Part of Bokeh's template of the page: the style sheet."""


class Page:
    """The page of one browser tab. document: of Bokeh; workplace: shared by all tabs.

    The page in which a user acts shows the result first, the others follow one by one; a tab in the background follows
    once it is seen again.
    """

    def __init__(self, document: Document, workplace: Workplace):
        self.document, self.workplace = document, workplace
        self.chosen, self.scene = "", workplace.scene
        self.others: list[str] = []
        """Paths of the objects that are selected beside the chosen one, which has the form."""
        self.clip: edits.Clip = []
        self._due: list[Callable[[], None]] = []
        self._caught_up = monotonic()  # s, when the page followed last
        self.asked: Callable[[], None] | None = None
        self._left: Draft | None = None  # the draft that the standing question is about
        self._said, self._views = workplace.drafts.unreadable, 0
        self._formed, self._found = "", tuple[Remark, ...]()  # section and remarks of the form
        self.sheet = InlineStyleSheet(css=STYLE)
        no_tex = {"disable_math": True}  # in the words of users
        attributes = {"UIElement": {"stylesheets": [self.sheet]}, "Div": no_tex}
        document.theme, document.template = Theme(json={"attrs": attributes}), HEAD
        # the script does both
        document.config.update(reconnect_session=False, notify_connection_status=False)
        plan = Canvas(ABOVE)
        self.canvases = {ABOVE: plan, SIDE: Canvas(SIDE, plan=plan), FRONT: Canvas(FRONT, plan=plan)}
        self.time = TimeBar(self)
        self.form, self.runs = FormPanel(self), RunPanel(self)
        self._build()
        self.refresh()
        document.add_root(self.layout)  # complete: Bokeh would search the whole page again after each change
        workplace.pages.append(self)
        document.on_session_destroyed(lambda _: self.leave())

    def leave(self) -> None:
        """Forget the page: its tab has been closed. Runs go on."""
        if self in self.workplace.pages:
            self.workplace.pages.remove(self)

    def follow(self, runs_alone: bool = False) -> None:
        """Show changes of the workplace soon, those of many together; runs_alone: the text has not changed."""
        is_first, work = not self._due, self.look if runs_alone else self.refresh
        if work not in self._due:
            self._due.append(work)
        if is_first and not self.hidden:
            pages = self.workplace.pages
            past = 1e3 * (monotonic() - self._caught_up)
            # all pages together redraw once in a gap
            wait = max(GAP * (1 + pages.index(self)), round(GAP * len(pages) - past))
            self.document.add_timeout_callback(self._catch_up, wait)

    def _catch_up(self) -> None:
        due, self._due, self._caught_up = self._due, [], monotonic()
        for work in due:
            work()

    @property
    def hidden(self) -> bool:
        """Whether the tab is in the background."""
        return self.seen.value.startswith("hidden")

    def _seen(self, state: str) -> None:
        canvases = (*self.canvases.values(), self.runs.beside)
        for plot in (*(canvas.figure for canvas in canvases), self.runs.plot):
            paint(plot, state.endswith("dark"))
        if not self.hidden:
            self._catch_up()

    # ---------------------------------------------------------------- layout

    def _build(self) -> None:
        self.pointer = Pointer(self, self.sheet)
        self.files, self.menu = FileMenu(self), ContextMenu(self)
        self.name = TextInput(
            title="name of the file", width=130, name="file", description=ABOUT_NAME, css_classes=["alone"]
        )
        self.name.on_change("value", lambda _attr, _old, new: self._renamed(new))
        self.title = Words(css_classes=["faint"], styles={"flex": "1", "align-self": "center"})
        self.undo, self.redo = self._button("↶ Undo", self._undo, 70), self._button("↷ Redo", self._redo, 70)
        self.tools = [
            self._button("Copy", self.copy, 55),
            self._button("⟲ 15°", lambda: self.turn(15), 52),
            self._button("⟳ 15°", lambda: self.turn(-15), 52),
            self._button("Delete", self.delete, 62),
        ]
        run = self._button("▶ Run", self.run, 80)
        run.update(button_type="success", name="run")
        links = (
            '<a href="share/room.yaml">YAML</a> &nbsp; <a href="share/room.png" target="_blank">picture</a>'
        )
        bar = row(
            self.files.button, self.name, self.title, self.undo, self.redo, *self.tools,
            row(Div(text="grid", align="center"), self.pointer.step),
            self._button("Whole room", self.fit, 88), self._button("Save", lambda: self.save(), 54),
            Div(text=links, align="center"), run,
            sizing_mode="stretch_width", css_classes=["bar"],
        )  # fmt: skip
        # of fixed heights: if the views changed their size with each line of text, a drag would miss its aim
        self.hint = Words("hint", css_classes=["line", "faint"])
        self.size = Words("size", css_classes=["lines"])
        self.message = Words("message", css_classes=["bad", "line"])
        self.banner = Div(sizing_mode="stretch_width")
        answers = self._button("Yes", self._yes, 60), self._button("No", self._no, 60)
        self.question = row(
            self.banner, *answers, visible=False, sizing_mode="stretch_width", css_classes=["ask"]
        )
        above, *sides = (canvas.figure for canvas in self.canvases.values())
        for side in sides:
            side.update(height=190, sizing_mode="stretch_width", visible=False)
        self.side = RadioButtonGroup(
            labels=["side: x–z", "y–z"], active=0, css_classes=["corner"], name="which side"
        )
        self.side.on_change("active", lambda _attr, _old, _new: self._switched())
        views = column(
            self.files.layout, self.question, self.message,
            row(above, self.runs.beside.figure, sizing_mode="stretch_both"),
            row(*sides, self.runs.below, self.side, sizing_mode="stretch_width"),
            self.time.layout, self.hint, self.size,
            sizing_mode="stretch_both",
        )  # fmt: skip
        self.text = TextAreaInput(
            max_length=None, sizing_mode="stretch_both", name="yaml", css_classes=["mono"],  # type: ignore[arg-type]
        )  # fmt: skip
        self.text.on_change("value_input", lambda _attr, _old, new: self._typed(new))
        self.editor = Div(sizing_mode="stretch_both", name="editor")
        self.solid = Div(sizing_mode="stretch_both", name="solid", css_classes=["whole"])
        self.remarks = Words("remarks")
        contents = {
            "Form": self.form.layout, "YAML": column(self.editor, self.text, sizing_mode="stretch_both"),
            "Remarks": column(self.remarks, sizing_mode="stretch_both", css_classes=["scrolls"]),
            "Runs": self.runs.layout, "3-D": self.solid, "Report": self.runs.report, "Recording": self.runs.recording,
        }  # fmt: skip
        self.titles = list(contents)
        self.tabs = Tabs(
            tabs=[TabPanel(child=child, title=title) for title, child in contents.items()],
            sizing_mode="stretch_height", css_classes=["side"],
        )  # fmt: skip
        self.tabs.on_change("active", lambda _attr, _old, new: self._tab(new))
        self.acts = TextInput(visible=False, name="acts")
        self.acts.on_change("value", lambda _attr, _old, new: self._act(new.rpartition(" ")[0]))
        self.seen = TextInput(visible=False, name="seen")
        self.seen.on_change("value", lambda _attr, _old, new: self._seen(new))
        self.notes = TextInput(visible=False, name="notes")
        models = {
            "acts": self.acts,
            "seen": self.seen,
            "text": self.text,
            "editor": self.editor,
            "notes": self.notes,
            "above": above,
            "sides": sides,
            "menu": self.menu.layout,
        }
        self.document.js_on_event(DocumentReady, CustomJS(args=models, code=SCRIPT))
        palette = column(
            self.pointer.palette.layout,
            self.pointer.file,
            css_classes=["scrolls"],
            sizing_mode="stretch_height",
        )
        body = row(palette, views, self.tabs, sizing_mode="stretch_both")
        self.layout = column(
            bar,
            body,
            self.acts,
            self.seen,
            self.notes,
            self.menu.layout,
            self.menu.help,
            sizing_mode="stretch_both",
            stylesheets=[self.sheet],
        )

    def _button(self, label: str, work: Callable[[], Any], width: int) -> Button:
        button = Button(label=label, width=width)
        button.on_click(work)
        return button

    # ---------------------------------------------------------------- text → page

    def refresh(self) -> None:
        """Show the present text, and what the checks found about it."""
        work = self.workplace
        self.scene = work.scene
        self.others = [path for path in self.others if self.scene.thing(path) is not None]
        if self.chosen and not self.form.exists(self.scene.data, self.chosen):
            self.chosen = ""
        if self.text.value_input != work.text:  # what a user types; `value` follows once the area is left
            self.text.update(value=work.text, value_input=work.text)
        self.undo.disabled, self.redo.disabled = not work.history.can_undo, not work.history.can_redo
        for tool in self.tools:
            tool.disabled = self.scene.thing(self.chosen) is None or self.chosen in ("", "domain")
        self.name.value = work.file.name
        self.document.title = f"{work.file.name} - taichi_plume draw"
        self.title.text = "" if work.saved else "not saved"
        self.side.visible = len(self.scene.planes) > 1
        for n, plane in enumerate((SIDE, FRONT)):
            self.canvases[plane].figure.visible = self.side.visible and self.side.active == n
        self._show_remarks()
        self._banner()
        self._show_message()
        self.look()

    def _switched(self) -> None:
        """Show the other view from the side."""
        self.refresh()
        for canvas in self.canvases.values():
            if canvas.plan is not None:
                canvas.fit()

    def _show_remarks(self) -> None:
        """Show the errors and warnings of the present text in list, form and views, or that it is being checked."""
        work, scene = self.workplace, self.scene
        checked = work.findings if work.checked == work.text else None
        remarks = checked.remarks if checked is not None else ()
        lines, marks = [], {plane: [] for plane in self.canvases}
        for n, remark in enumerate(remarks, 1):
            owner = scene.thing(scene.owner(remark.path))
            for plane in scene.planes if owner is not None else ():
                place = owner.place(plane)
                if place is not None:
                    beside = sum(
                        other[1] == place[1] and abs(other[0] - place[0]) < 1 for _, other, _ in marks[plane]
                    )
                    shift = 0.05 * beside * max(scene.room or (1.0,))
                    marks[plane].append((str(n), (place[0] + shift, place[1]), remark.is_error))
            look, word = ("bad", "error") if remark.is_error else ("warn", "unlikely")
            words = f"<b class='{look}'>{n} {word}</b> {escape(scene.named(remark.line))}"
            path = escape(scene.owner(remark.path))
            lines.append(
                f"<p><a href='#' data-act='choose:{path}'>{words}</a></p>"
                if owner is not None
                else f"<p>{words}</p>"
            )
        wrong = {scene.owner(remark.path) for remark in remarks if remark.is_error}
        for plane, canvas in self.canvases.items():
            canvas.show(scene, self.selection, wrong, marks[plane])
        nothing = "<p>Nothing: the scenario can be run.</p>" if checked is not None else "<p>checking …</p>"
        self.remarks.text = "".join(lines) or nothing
        self.tabs.tabs[2].title = f"Remarks ({len(lines)})" if lines else "Remarks"
        self.size.text = self._summary(checked) if checked is not None else "checking …"
        self._note(remarks)
        self._found = tuple(remarks)
        if self.chosen == self._formed:
            self._show_form()
        else:  # the drawing first: the browser takes far longer for the fields of another form
            self.document.add_timeout_callback(self._show_form, GAP)

    def _show_form(self) -> None:
        self._formed = self.chosen
        self.form.show(self.scene, self.chosen, self._found)

    def _note(self, remarks: Sequence[Remark]) -> None:
        """Mark the lines of remarks in the editor, and bring the chosen section's line into view."""
        text = self.workplace.text
        marks = [
            {
                "row": line_of(text, remark.path, remark.line), "column": 0, "text": self.scene.named(remark.line),
                "type": "error" if remark.is_error else "warning",
            }
            for remark in remarks
        ]  # fmt: skip
        row = line_of(text, self.chosen) if self.chosen else None
        self.notes.value = dumps({"marks": marks, "row": row})

    def _summary(self, findings: Findings) -> str:
        """Return the line below the views as HTML: what is still to be drawn, the first error, or the size of a run."""
        errors = [remark.line for remark in findings.remarks if remark.is_error]
        lacks_alone = {remark.path for remark in findings.remarks if remark.is_error} == {"gas.sources"}
        if lacks_alone and (steps := first_steps.as_html(self.scene.data)):
            return steps
        if errors:
            more = f" and {len(errors) - 1} more" * (len(errors) > 1)
            count = f"{len(errors)} error{'s' * (len(errors) > 1)}"
            return f"<b class='bad'>{count}</b> {escape(self.scene.named(errors[0]))}{more}"
        derived = [f"{name}: {text}" for name, text in findings.derived.items() if name in ("air", "gas")]
        return escape(" · ".join([findings.amounts, *derived]))

    def _banner(self) -> None:
        """Ask about a draft that was left, unless another question stands; forget a question answered elsewhere."""
        work = self.workplace
        if self._left is not None and self._left not in work.drafts.waiting:
            self._left, self.asked, self.question.visible = None, None, False
        if self.asked is not None or work.recovered is None:
            return
        draft = work.recovered
        words = f"Unsaved changes of {work.file.name} were left by an earlier session. Take them?"
        if work.history.can_undo:
            words += " Undo returns to the present text."
        self.ask(words, lambda: work.restore(draft, True), lambda: work.restore(draft, False))
        self._left = draft

    # ---------------------------------------------------------------- page → text

    def put(self, text: str) -> None:
        """Make a text the present one."""
        self.say("")
        self.tried(lambda: self.workplace.put(text))
        if self.workplace.text != text:
            self.follow()  # the page shows the text as it stays
        self._catch_up()

    def say(self, words: str) -> None:
        """Show a message above the drawing; "": none. A draft that cannot be written is always mentioned."""
        self._said = self.scene.named(words)
        self._show_message()

    def _show_message(self) -> None:
        self.message.text = escape("; ".join(filter(None, (self._said, self.workplace.drafts.fault))))

    def ask(self, words: str, yes: Callable[[], Any], no: Callable[[], Any] = lambda: None) -> None:
        """Ask a question above the drawing; carry out one of two functions by the answer."""
        self.banner.text = escape(self.scene.named(words))
        self.asked, self.declined, self._left = yes, no, None
        self.question.visible = True

    def _yes(self) -> None:
        work, self.asked, self.question.visible = self.asked, None, False
        if work is not None:
            self.tried(work)

    def _no(self) -> None:
        self.asked, self.question.visible = None, False
        self.tried(self.declined)

    def tried(self, work: Callable[[], Any]) -> Any:
        """Return the result of a function, or show its error and return None."""
        try:
            return work()
        except (InputError, LineError) as error:
            self.say("; ".join(error.lines) if isinstance(error, InputError) else str(error))
            return None

    def choose(self, path: str) -> None:
        """Select the object or section at a path, and no other one."""
        self.select([path])

    def select(self, paths: Sequence[str]) -> None:
        """Select the objects at paths; the form shows the last one."""
        *others, self.chosen = dict.fromkeys(paths) or [""]
        self.others = list(filter(None, others))
        self.refresh()

    @property
    def selection(self) -> list[str]:
        """Paths of the selected objects, the chosen one last."""
        return [*self.others, *filter(None, [self.chosen])]

    def _typed(self, text: str) -> None:
        if text != self.workplace.text:
            self.put(text)

    def edit(self, work: Callable[[], str | tuple[str, str | Sequence[str]]]) -> bool:
        """Take the text that a function returns, perhaps with paths to be selected; return whether it made no error."""
        made = self.tried(work)
        if made is not None:
            text, paths = (made, self.selection) if isinstance(made, str) else made
            *self.others, self.chosen = [paths] if isinstance(paths, str) else paths or [""]
            self.put(text)
        return made is not None

    def _undo(self) -> None:
        self.workplace.undo()
        self._catch_up()

    def _redo(self) -> None:
        self.workplace.redo()
        self._catch_up()

    def copy(self) -> None:
        """Copy the selected objects beside themselves."""
        self.edit(lambda: edits.copy(self.workplace.text, self.selection, self.workplace.folder))

    def take_clip(self) -> None:
        """Keep copies of the selected objects for `paste`."""
        self.clip = edits.clip(self.scene, self.selection) or self.clip

    def paste(self, at: Point | None = None) -> None:
        """Add the kept copies, their middle at a point or, without one, beside the originals."""
        if self.clip:
            self.edit(lambda: edits.paste(self.workplace.text, self.clip, self.workplace.folder, at))

    def turn(self, degrees: float) -> None:
        """Turn the selected objects by an angle [degrees]."""
        self.edit(lambda: edits.turn(self.workplace.text, self.selection, degrees, self.scene))

    def delete(self) -> None:
        """Delete the selected objects."""
        if self.scene.thing(self.chosen) is not None:
            # the path is then that of the next item, which a second Delete would remove
            self.edit(lambda: (edits.remove(self.workplace.text, self.selection), ""))

    def select_all(self) -> None:
        """Select all objects, but neither the room nor the arena."""
        things = [thing for thing in self.scene.things if thing.part is not None]
        self.select([thing.path for thing in things if thing.path not in ("domain", "arena")])

    def fit(self) -> None:
        """Show the whole room in all views."""
        for canvas in self.canvases.values():
            canvas.fit()

    def save(self, agreed: FileChangedError | None = None) -> None:
        """Save the text; ask first if another program has changed the file. agreed: the error asked about before."""
        try:
            self.workplace.save(agreed)
            self.say("")
        except FileChangedError as error:
            self.ask(f"{error.lines[0]}. Overwrite it?", partial(self.save, error), self._offer_reload)
        except InputError as error:
            self.say("; ".join(error.lines))

    def _renamed(self, name: str) -> None:
        if name != self.workplace.file.name:
            self.say("")
            if name:
                self.tried(lambda: self.workplace.save_as(name))
            self.name.value = self.workplace.file.name

    def _offer_reload(self) -> None:
        self.ask("Take the file's text instead? Undo returns to the present one.", self.workplace.reload)

    def run(self, kind: type[Run] = Run) -> None:
        """Start a run of the text, or Repeats; ask first if another one goes on."""
        alive = [str(run.number) for run in self.workplace.runs if run.alive]
        if alive:
            self.ask(f"Run {', '.join(alive)} goes on. Start another one beside?", lambda: self._start(kind))
        else:
            self._start(kind)

    def _start(self, kind: type[Run]) -> None:
        self.tabs.active = 3
        self.choose("")  # handles would lie on the picture of the run
        self.time.choose(None)
        self.runs.start(self.workplace.text, kind=kind)

    def _act(self, words: str) -> None:
        """Carry out what a key or a link of the page means."""
        name, _, path = words.partition(":")
        works: dict[str, Callable[[], Any]] = {
            "undo": self._undo, "redo": self._redo, "copy": self.copy, "delete": self.delete, "save": self.save,
            "escape": self._escape, "choose": lambda: self.choose(path),
            "draw": lambda: self.pointer.palette.take(path), "solid": self._show_solid,
            "clip": self.take_clip, "paste": lambda: self._paste(path), "all": self.select_all,
            "move": lambda: self._move(path), "help": self.menu.toggle_help, "menu": lambda: self._menu(path),
        }  # fmt: skip
        if name in works:
            works[name]()

    def _paste(self, words: str) -> None:
        """Paste at the pointer. words: name of the view of the pointer, x and y [m]."""
        view, _, place = words.partition(" ")
        self.paste(pair(at) if (at := _numbers(place, 2)) and view == "above" else None)

    def _move(self, words: str) -> None:
        """Move the selected objects. words: numbers of steps along x and y, and how many times."""
        if numbers := _numbers(words, 3):
            x, y, times = numbers
            step = times * (self.pointer.pace or FINEST)
            moves = edits.moves(self.scene, self.selection, ABOVE, (x * step, y * step))
            self.edit(lambda: edits.move(self.workplace.text, self.scene, moves, ABOVE))

    def _menu(self, words: str) -> None:
        """Show the context menu. words: name of a view, x and y in it [m], left and top in the window [pixels]."""
        view, _, place = words.partition(" ")
        canvas = next((canvas for canvas in self.canvases.values() if canvas.figure.name == view), None)
        if canvas is not None and (numbers := _numbers(place, 4)):
            self.menu.show(canvas, pair(numbers), *numbers[2:])

    def _escape(self) -> None:
        self.menu.layout.visible = self.menu.help.visible = False
        self.pointer.cancel()
        self.choose("")

    def _tab(self, active: int) -> None:
        title = self.titles[active]
        self.tabs.css_classes = ["side", "wide"] if title in ("3-D", "Report", "Recording") else ["side"]
        if title == "Recording":
            self.runs.show_recording()
        elif title == "3-D":
            self._show_solid()

    def _show_solid(self) -> None:
        """Show the present room in rerun's viewer, which is large: once the tab is opened, or its link is clicked."""
        if not self.workplace.check()[1].sound:
            self.solid.text = "<p>The scenario has errors; see Remarks.</p>"
            return
        self._views += 1  # another address: the browser loads the room again
        link = "<p><a href='#' data-act='solid'>Show the room as it is now</a></p>"
        self.solid.text = (
            f"{link}<iframe title='room in 3-D' src='viewer/?run=room&amp;view={self._views}'></iframe>"
        )

    # ---------------------------------------------------------------- runs

    @property
    def usage(self) -> str:
        """Use of the pointer in the views or, while a run is seen, the scale of its picture; as HTML."""
        picture = self.runs.picture
        if picture is None or self.pointer.kind != "select":
            return self.pointer.usage
        scale, unit = picture.scale, "" if picture.unit == "1" else f" {picture.unit}"
        low, high = ("white", "dark") if picture.unit == "ppm" else ("blue", "red")
        ends = f"from {scale.low:g}{unit} ({low}) to {scale.high:g}{unit} ({high})"
        kind = ", logarithmic" if scale.kind == "log" else ""
        return escape(f"{picture.quantity} {ends}{kind}; lines show the wind.")

    def look(self) -> None:
        """Show the state of the runs, and of the file."""
        self.runs.refresh()
        sight, run = self.runs.sight, self.runs.run
        self.time.show(run, sight)
        of = run.scene if run is not None else None
        self.hint.text = self.usage
        before = self.canvases[ABOVE].sight is None, self.canvases[ABOVE].faded
        faded = self.scene.drawn_otherwise(of) if sight is not None and of is not None else ()
        now = sight is None, frozenset(thing.path for thing in faded)
        for canvas in self.canvases.values():
            canvas.faded = now[1]
            canvas.show_run(sight, of, self.scene, f"run {self.runs.number}", self.runs.picture)
        self.runs.show_beside()
        if now != before:
            self._show_remarks()  # walkers, and what has changed, are drawn otherwise while a run is seen


def _numbers(words: str, count: int) -> list[float]:
    """Return numbers that the page's script sends; none if there are not as many, or if any is not finite."""
    try:
        numbers = [float(word) for word in words.split()]
    except ValueError:
        return []
    return numbers if len(numbers) == count and all(map(isfinite, numbers)) else []
