"""The form of a section as widgets of Bokeh: every key with its unit, default and explanation."""

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

from bokeh.layouts import column, row
from bokeh.models import Button, Div, Select, TextInput
from bokeh.models.dom import HTML
from bokeh.models.ui import Tooltip

from taichi_plume.draw import forms
from taichi_plume.draw.checks import Remark
from taichi_plume.draw.document import EditError, data_of, parent_of, value_at
from taichi_plume.draw.objects import Scene
from taichi_plume.guard.yaml_text import LineError

WIDTH = 400
COMPACT = """
:host { font-family: Helvetica, Arial, sans-serif; font-size: 13px; }
.bk-input { min-height: 24px; height: 26px; padding: 2px 8px; font-size: 13px; }
label { color: #5d6875; font-size: 12px; padding-right: 4px; }
.bk-btn { padding: 3px 8px; }
"""


class FormPanel:
    """Widgets of the section at a path. put: takes a new text; choose: selects a path; say: shows a message."""

    def __init__(self, put: Callable[[str], None], choose: Callable[[str], None], say: Callable[[str], None]):
        self._put, self._choose, self._say = put, choose, say
        self.text, self.path, self.keys = "", "", ()
        self.widgets: dict[str, Any] = {}
        self._setting = False
        self.sections = Select(width=WIDTH - 70, name="sections", stylesheets=[COMPACT])
        self.sections.on_change("value", lambda _attr, _old, new: self._section_chosen(new))
        self.back = Button(label="‹ back", width=60, stylesheets=[COMPACT])
        self.back.on_click(self._go_back)
        self.purpose = Div(width=WIDTH)
        self.rows = column(width=WIDTH)
        self.layout = column(
            row(self.back, self.sections), self.purpose, self.rows,
            sizing_mode="stretch_height", styles={"overflow-y": "auto", "height": "100%"},
        )  # fmt: skip

    def exists(self, data: Any, path: str) -> bool:
        """Return whether there is a section at a path, given or with its defaults."""
        return not path or value_at(data, path) is not None or bool(forms.rows(data, path))

    def _section_chosen(self, path: str) -> None:
        if not self._setting:
            self._choose(path)

    def _go_back(self) -> None:
        above = self.path
        while above:
            above = parent_of(above)[0]
            if not above or not isinstance(value_at(data_of(self.text), above), list):
                break
        self._choose(above)

    def show(self, of: Scene, path: str, remarks: Sequence[Remark]) -> None:
        """Show the section at a path."""
        self.text = of.text
        found = forms.rows(of.data, path)
        keys = (path, *sorted((entry.key, entry.choices) for entry in found))
        self._setting = True
        try:
            options = [(thing.path, thing.name) for thing in of.things]
            if path not in [value for value, _ in options]:
                options.append((path, of.named(path)))
            self.sections.update(options=options, value=path)
            about = [remark for remark in remarks if _within(remark.path, path)] if path else []
            words = "".join(
                f"<p style='color:{'#d32f2f' if remark.is_error else '#b26a00'}'>{escape(of.named(remark.line))}</p>"
                for remark in about
            )
            self.purpose.text = f"<p style='color:#5d6875'>{escape(forms.title(of.data, path))}</p>{words}"
            self.back.visible = bool(path)
            if keys != self.keys:
                self.path, self.keys = path, keys
                self.widgets = {entry.path: self._widget(entry) for entry in found}
                self.rows.children = [self._line(entry) for entry in found]
            for entry in found:
                value = entry.value or (forms.NOT_GIVEN if entry.choices else "")
                if self.widgets[entry.path].value != value:
                    self.widgets[entry.path].value = value
        finally:
            self._setting = False

    def _widget(self, entry: forms.Row) -> Any:
        about: Any = Tooltip(
            content=HTML(html=f"<div style='max-width:300px'>{escape(entry.meaning)}</div>"), position="left"
        )
        common: dict[str, Any] = {
            "title": entry.label,
            "description": about,
            "width": WIDTH - 80,
            "name": entry.path,
        }
        common |= {"stylesheets": [COMPACT], "margin": (1, 5, 1, 5)}
        if entry.choices:
            options: list[Any] = [*([] if entry.key == "kind" else [forms.NOT_GIVEN]), *entry.choices]
            if entry.value and entry.value not in options:
                options.append(entry.value)
            widget: Any = Select(options=options, value=entry.value or forms.NOT_GIVEN, **common)
        else:
            placeholder = f"{entry.default}" if entry.default else "has to be given"
            widget = TextInput(value=entry.value, placeholder=placeholder, **common)
        widget.on_change("value", self._callback(entry.path))
        return widget

    def _callback(self, path: str) -> Callable[[str, object, str], None]:
        return lambda _attr, _old, new: self._entered(path, new)

    def _line(self, entry: forms.Row) -> Any:
        widget = self.widgets[entry.path]
        if not entry.is_section:
            return widget
        button = Button(label="open ›", width=60, align="end", stylesheets=[COMPACT], margin=(1, 5, 1, 5))
        button.on_click(lambda: self._choose(entry.path))
        return row(widget, button)

    def _entered(self, path: str, entry: str) -> None:
        if self._setting:
            return
        try:
            self._put(forms.entered(self.text, data_of(self.text), path, entry))
        except (EditError, LineError) as error:
            self._say(str(error))


def _within(inner: str, path: str) -> bool:
    return f"{inner}.".startswith((f"{path}.", f"{path}["))
