"""The form of a section as widgets of Bokeh: every key with its unit, default and explanation, by its type."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

from bokeh.layouts import column
from bokeh.layouts import row as side_by_side
from bokeh.models import Button, Checkbox, Div, Select, Slider, TextInput

from taichi_plume.draw import forms
from taichi_plume.draw.checks import Remark
from taichi_plume.draw.document import data_of, duplicate, parent_of, value_at
from taichi_plume.draw.forms import Key, Row
from taichi_plume.draw.objects import Scene
from taichi_plume.draw.words import Words
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.yaml_text import LineError

if TYPE_CHECKING:
    from taichi_plume.draw.page import Page

WIDE: Any = {"sizing_mode": "stretch_width"}
MANY = 8  # keys that are always shown
FOLD = 3  # keys at least that are folded
MOST_FORMS = 12  # that are kept
ANOTHER = "+"
OFTEN = {
    "warm_up", "tick", "stop_early", "obstacles", "robots", "maps", "recording", "arena", "probes", "size", "depth",
    "openings", "wind", "gas", "sources", "turbulence_intensity", "turbulence_length", "position", "center", "rate",
    "radius", "height", "base", "yaw_deg", "motion", "sensors", "body", "reach", "heading_deg", "speed",
    "threshold_ppm", "max_speed", "range_ppm",
}  # fmt: skip
"""Keys that scenarios often give, of all sections."""


class Line:
    """Widgets of a key: fields, a list, a check box or a summary; perhaps a slider; a button that resets the key."""

    def __init__(self, panel: "FormPanel", row: Row):
        self.panel, self.row = panel, row
        about = row.about
        self.fields = self._fields(row)
        words = f"{escape(about.name)}<span title='{escape(about.meaning)}'>?</span>"
        parts = [Div(text=words, css_classes=["key"], margin=0), *self.fields]
        self.slider = None
        if row.field == "number" and about.slider is not None:
            low, high, step = about.slider
            self.slider = Slider(
                start=low, end=high, step=step, value=low, show_value=False, title="", format="0[.]000",
                margin=(4, 10), name=f"slider {about.name}", **WIDE,
            )  # fmt: skip
            self.slider.on_change("value_throttled", lambda _attr, _old, new: panel.slid(self, new))
            parts.append(self.slider)
        if row.field == "section" or (about.is_section and row.field == "choice"):
            button = Button(label="open ›", margin=0)
            button.on_click(lambda: panel.page.choose(self.row.path))
            parts.append(button)
        self.reset = Button(label="↺", margin=0, css_classes=["reset"], name=f"reset {about.name}")
        self.reset.on_click(lambda: panel.entered(self, ""))
        self.note = Div(css_classes=["note"], margin=0)
        self.layout = side_by_side([*parts, self.reset], css_classes=["key-line"], **WIDE)

    def _fields(self, row: Row) -> list[Any]:
        about, entered = row.about, self.panel.entered
        common: dict[str, Any] = {"margin": 0, "name": f"form {about.name}", "css_classes": ["field"]} | WIDE
        if row.field == "section":
            return [Div(**common)]
        if row.field == "switch":
            box = Checkbox(html_attributes={"aria-label": about.name}, **common)
            box.on_change("active", lambda _attr, _old, new: entered(self, str(new).lower()))
            return [box]
        if row.field in ("choice", "list"):
            widget = Select(title=about.name, **common)
            work = entered if row.field == "choice" else self.panel.opened
            widget.on_change("value", lambda _attr, _old, new: work(self, new))
            return [widget]
        if row.field == "point":
            fields = [TextInput(title=f"{about.name} {axis}", prefix=axis, **common) for axis in row.axes]
            fields[-1].css_classes = ["field", "last"]
            for n, field in enumerate(fields):
                field.on_change("value", lambda _attr, _old, new, n=n: entered(self, new, n))
            return fields
        widget = TextInput(title=about.name, **common)
        widget.on_change("value", lambda _attr, _old, new: entered(self, new))
        return [widget]

    def show(self, row: Row, of: Scene, note: tuple[str, str] | None) -> None:
        """Show a key: what the text gives, else its default in grey; note: words below it and their class."""
        half_given = row.path == self.row.path and row.field == "point" and row.given is None
        self.row = row
        about, widget = row.about, self.fields[0]
        self.reset.disabled = not row.value or not about.default
        default = about.default or "has to be given"
        if row.field == "switch":
            widget.active = row.given if row.value else about.default == "true"
            widget.label = "" if row.value else "default"
        elif row.field == "choice":
            absent = f"{about.default} (default)" if about.default else "choose …"
            extra = [row.value] if row.value and row.value not in about.choices else []
            names = [(name, name) for name in (*about.choices, *extra)]
            keep = row.value and not about.default
            widget.update(options=names if keep else [("", absent), *names], value=row.value)
        elif row.field == "list":
            items = [(f"{row.path}[{n}]", item) for n, item in enumerate(row.given or ())]
            things = {thing.path: thing.name for thing in of.things}
            named = [
                (path, f"{things.get(path, f'{n + 1}')}: {forms.summary(item)}")
                for n, (path, item) in enumerate(items)
            ]
            count = f"{len(items)} — open one …"
            widget.update(options=[("", count), *named, (ANOTHER, "+ a copy of the last one")], value="")
        elif row.field == "section":
            words = forms.summary(row.given) if row.value else default
            widget.text = f"<span title='{escape(words)}'>{escape(words)}</span>"
        elif row.field == "text":
            _set(widget, row.value, default)
        else:
            defaults = default.strip("[]").split(", ") if about.default[:1] == "[" else [default] * 3
            for field, (number, unit), absent in zip(self.fields, row.numbers, defaults, strict=False):
                _set(field, field.value if half_given else number, absent)
                is_shown = field is self.fields[-1] or unit != about.unit
                field.suffix = unit if is_shown and unit else None
        if row.field in ("switch", "choice", "section"):
            widget.css_classes = ["field"] if row.value else ["field", "default"]
        if self.slider is not None:
            position = row.position
            self.slider.value = self.slider.start if position is None else position
        if note is not None:
            self.note.update(text=escape(note[0]), css_classes=["note", note[1]])
        if (note is not None) != (self.note in self.layout.children):
            parts = [part for part in self.layout.children if part is not self.note]
            self.layout.children = [*parts, self.note] if note is not None else parts


def _set(field: TextInput, value: str, placeholder: str) -> None:
    """Show a value in a field. What a user types there stays unless the value changes."""
    if field.value != value:
        field.value = value
    if field.placeholder != placeholder:
        field.placeholder = placeholder


@dataclass
class Form:
    """Widgets of a kind of section. lines: by key; visible: keys that are not folded, in the order of the form."""

    column: Any
    lines: dict[str, Line]
    visible: dict[str, None]


class FormPanel:
    """Forms of a page: that of the chosen section, and hidden those of other kinds.

    Another object of a kind changes values alone, and a hidden form returns at once. To add a widget takes far longer:
    Bokeh then searches the whole page.
    """

    def __init__(self, page: "Page"):
        self.page = page
        self.widgets: dict[str, Any] = {}
        self.lines: dict[str, Line] = {}
        self._forms: dict[frozenset[Key], Form] = {}  # the last one is shown
        # path, words, class, and the text that they are about
        self._note: tuple[str, str, str, str] | None = None
        self._setting = False
        self.sections = Select(title="section", name="sections", css_classes=["alone"], **WIDE)
        self.sections.on_change("value", lambda _attr, _old, new: None if self._setting else page.choose(new))
        self.back = Button(label="‹ back", width=60)
        self.back.on_click(self._go_back)
        self.purpose = Words()
        self.rows = column(**WIDE)
        self.more = Button(**WIDE, name="more keys")
        self.more.on_click(self._unfold)
        self.layout = column(
            side_by_side(self.back, self.sections, **WIDE), self.purpose, self.rows, self.more,
            sizing_mode="stretch_height", css_classes=["scrolls"], styles={"height": "100%"},
        )  # fmt: skip

    def exists(self, data: Any, path: str) -> bool:
        """Return whether there is a section at a path, given or with its defaults."""
        return not path or value_at(data, path) is not None or bool(forms.rows(data, path))

    def _go_back(self) -> None:
        """Choose the section around the chosen one; lists are no sections."""
        above = parent_of(self.page.chosen)[0]
        while isinstance(value_at(self.page.scene.data, above), list):
            above = parent_of(above)[0]
        self.page.choose(above)

    def show(self, of: Scene, path: str, remarks: Sequence[Remark]) -> None:
        """Show the section at a path."""
        found = forms.rows(of.data, path)
        self._setting = True
        try:
            options = [(thing.path, thing.name) for thing in of.things]
            if path not in [value for value, _ in options]:
                options.append((path, of.named(path)))
            self.sections.update(options=options, value=path)
            about = [remark for remark in remarks if _within(remark.path, path)] if path else []
            words = "".join(
                f"<p class='{'bad' if remark.is_error else 'warn'}'>{escape(of.named(remark.line))}</p>"
                for remark in about
            )
            self.purpose.text = f"<p class='faint'>{escape(forms.title(of.data, path))}</p>{words}"
            self.back.visible = bool(path)
            self._show_rows(of, path, found)
        finally:
            self._setting = False

    def _show_rows(self, of: Scene, path: str, found: Sequence[Row]) -> None:
        by_key = {row.key: row for row in found}
        kind = frozenset(row.about for row in found)
        form = self._forms.pop(kind, None) or Form(column(**WIDE), {}, {})
        self._forms[kind] = form
        self._forms = dict([*self._forms.items()][-MOST_FORMS:])
        usual = [row.key for row in found if row.value or not row.about.default or row.key in OFTEN]
        form.visible |= dict.fromkeys(usual)
        rest = [key for key in by_key if key not in form.visible]
        form.visible |= dict.fromkeys(
            rest if len(by_key) <= MANY + FOLD else rest[: max(0, MANY - len(form.visible))]
        )
        folded = len(by_key) - len(form.visible)
        self.more.update(visible=folded > 0, label=f"{folded} more keys ▾")
        note = self._note if self._note is not None and self._note[3] == of.text else None
        self.lines, self.widgets = {}, {}
        for key in form.visible:
            row = by_key[key]
            line = form.lines.get(key)
            if line is None or (line.row.field, line.row.axes) != (row.field, row.axes):
                line = form.lines[key] = Line(self, row)
            line.show(row, of, (note[1], note[2]) if note is not None and note[0] == row.path else None)
            self.lines[row.path], self.widgets[row.path] = line, line.fields[0]
            if row.field == "point":
                self.widgets |= {f"{row.path}[{n}]": field for n, field in enumerate(line.fields)}
        layouts = [line.layout for line in self.lines.values()]
        if layouts != form.column.children:
            form.column.children = layouts
        columns = [other.column for other in self._forms.values()]
        for other in columns:
            other.visible = other is form.column
        if form.column not in self.rows.children:
            self.rows.children = columns

    def _unfold(self) -> None:
        *_, form = self._forms.values()
        form.visible |= {row.key: None for row in forms.rows(self.page.scene.data, self.page.chosen)}
        self.page.refresh()

    # ---------------------------------------------------------------- form → text

    def entered(self, line: Line, entry: str, number: int | None = None) -> None:
        """Take an entry into the text, or say at its field why the entry is refused. number: in a list of numbers."""
        if self._setting:
            return None
        row, text = line.row, self.page.workplace.text
        path = row.path if number is None else f"{row.path}[{number}]"
        if number is not None and row.given is None and entry.strip():
            given = [field.value.strip() for field in line.fields]
            missing = [axis for axis, part in zip(row.axes[: row.least], given, strict=False) if not part]
            if missing:
                return self._say(line, f"{row.key}: {' and '.join(missing)} must be given too", "faint", text)
            path, entry = row.path, f"[{', '.join(filter(None, given))}]"
        try:
            data = data_of(text)
            new = forms.entered(text, data, path, entry)
        except (InputError, LineError) as fault:
            return self._refuse(line, fault.lines[0] if isinstance(fault, InputError) else str(fault))
        gone = forms.lost(data, parent_of(path)[0], entry) if row.key == "kind" and number is None else []
        words = f"went: {', '.join(gone)}; undo returns {'them' if len(gone) > 1 else 'it'}" if gone else ""
        self._say(line, words, "warn", new)
        self.page.put(new)
        self._restore(line)
        return None

    def slid(self, line: Line, value: float) -> None:
        """Take the position at which the slider of a key was left."""
        if self._setting:
            return
        try:
            entry = line.row.slid(value)
        except InputError as fault:
            self._refuse(line, fault.lines[0])
        else:
            self.entered(line, entry)

    def _refuse(self, line: Line, words: str) -> None:
        """Say at a key why an entry is refused."""
        start = parent_of(line.row.path)[0]
        words = f"refused: {words.removeprefix(f'{start}.' if start else '')}"
        self._say(line, words, "bad", self.page.workplace.text)

    def opened(self, line: Line, path: str) -> None:
        """Choose an item of a list of sections, or add a copy of its last one."""
        if self._setting or not path:
            return
        text, items = self.page.workplace.text, line.row.path
        if path == ANOTHER:
            path = f"{items}[{len(line.row.given)}]"
            last = f"{items}[{len(line.row.given) - 1}]"
            self.page.edit(lambda: (duplicate(text, last), path))
        else:
            self.page.choose(path)

    def _say(self, line: Line, words: str, style: str, text: str) -> None:
        """Show words below a key while the text is this one; the key shows what the text gives."""
        self._note = (line.row.path, words, style, text) if words else None
        for other in self.lines.values():
            if other is line or other.note in other.layout.children:
                self._restore(other)

    def _restore(self, line: Line) -> None:
        self._setting = True
        try:
            note = self._note
            is_noted = note is not None and note[0] == line.row.path
            line.show(
                line.row, self.page.scene, (note[1], note[2]) if note is not None and is_noted else None
            )
        finally:
            self._setting = False


def _within(inner: str, path: str) -> bool:
    return f"{inner}.".startswith((f"{path}.", f"{path}["))
