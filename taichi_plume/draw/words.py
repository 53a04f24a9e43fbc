"""Changing text of a page. For each changed `Div` Bokeh computes the layout of the whole page and paints all views."""

from typing import Any

from bokeh.core.has_props import Local
from bokeh.models.dom import HTML
from bokeh.models.ui import Pane


class Words(Local, Pane):
    """Text as HTML, sized by styles alone, so that a change leaves the layout of the page as it is."""

    __view_model__, __view_module__ = "Pane", "bokeh"  # to the browser

    def __init__(self, name: str = "", styles: dict[str, str] | None = None, **given: Any):
        whole: Any = {"margin": "0 5px"} | (styles or {})
        super().__init__(elements=[HTML(html="", name=name)], styles=whole, **given)

    @property
    def text(self) -> str:
        """The text as HTML."""
        return self.elements[0].html

    @text.setter
    def text(self, text: str) -> None:
        if text != self.text:
            self.elements[0].html = text
