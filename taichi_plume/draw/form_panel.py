"""The form of a section as widgets of Bokeh: every key with its unit, default and explanation."""

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from bokeh.layouts import column, row
from bokeh.models import Button, Select, TextInput
from bokeh.models.dom import HTML
from bokeh.models.ui import Tooltip

from taichi_plume.draw import forms
from taichi_plume.draw.checks import Remark
from taichi_plume.draw.document import data_of, parent_of, value_at
from taichi_plume.draw.objects import Scene
from taichi_plume.draw.words import Words

if TYPE_CHECKING:
    from taichi_plume.draw.page import Page

WIDTH = 400
COMPACT = """
:host { font-family: Helvetica, Arial, sans-serif; font-size: 13px; }
.bk-input { min-height: 24px; height: 26px; padding: 2px 8px; font-size: 13px; }
label { color: #5d6875; font-size: 12px; padding-right: 4px; }
.bk-btn { padding: 3px 8px; }
"""


class FormPanel:
    """Widgets of the chosen section of a page."""

    def __init__(self, page: "Page"):
        self.page, self.keys = page, ()
        self.widgets: dict[str, Any] = {}
        self._setting = False
        self.sections = Select(width=WIDTH - 70, name="sections", stylesheets=[COMPACT])
        self.sections.on_change("value", lambda _attr, _old, new: None if self._setting else page.choose(new))
        self.back = Button(label="‹ back", width=60, stylesheets=[COMPACT])
        self.back.on_click(self._go_back)
        self.purpose = Words()
        self.rows = column(width=WIDTH)
        self.layout = column(
            row(self.back, self.sections), self.purpose, self.rows,
            sizing_mode="stretch_height", styles={"overflow-y": "auto", "height": "100%"},
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
                self.keys = keys
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
        widget.on_change("value", lambda _attr, _old, new: self._entered(entry.path, new))
        return widget

    def _line(self, entry: forms.Row) -> Any:
        widget = self.widgets[entry.path]
        if not entry.is_section:
            return widget
        button = Button(label="open ›", width=60, align="end", stylesheets=[COMPACT], margin=(1, 5, 1, 5))
        button.on_click(lambda: self.page.choose(entry.path))
        return row(widget, button)

    def _entered(self, path: str, entry: str) -> None:
        text = self.page.workplace.text
        if not self._setting:
            self.page.edit(lambda: forms.entered(text, data_of(text), path, entry))


def _within(inner: str, path: str) -> bool:
    return f"{inner}.".startswith((f"{path}.", f"{path}["))
