"""The context menu of the views (right mouse button), and the list of the keys."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from bokeh.layouts import column
from bokeh.models import Button, Div

from taichi_plume.draw import edits
from taichi_plume.draw.canvas import Canvas
from taichi_plume.draw.parts import Point
from taichi_plume.report.theme import ABOVE

if TYPE_CHECKING:
    from taichi_plume.draw.page import Page

KEYS = {
    "arrows": "move what is selected by one step of the grid; with Shift by ten",
    "Ctrl-C, Ctrl-V": "copy, and paste at the pointer",
    "Ctrl-D": "copy beside the original",
    "Delete": "delete",
    "Ctrl-A": "select all objects",
    "Shift-click": "select one more, or one less",
    "Shift-drag": "select all within a rectangle",
    "Alt while dragging": "neither grid nor guides",
    "Ctrl-Z, Ctrl-Y": "undo, redo",
    "Ctrl-S": "save",
    "Esc": "give up a drag or a tool; select nothing",
    "?": "show or hide this list",
}
"""Keys of the page, and what they do."""


class ContextMenu:
    """Buttons at the pointer for the object, or the floor, that was pressed."""

    def __init__(self, page: "Page"):
        self.page, self.at = page, None
        self.items: dict[str, Button] = {}
        works: dict[str, Callable[[], Any]] = {
            "Copy": page.take_clip, "Delete": page.delete, "Turn left 15°": lambda: page.turn(15),
            "Turn right 15°": lambda: page.turn(-15), "Open its form": self._form,
            "Paste here": lambda: page.paste(self.at), "Select all": page.select_all, "Whole room": page.fit,
        }  # fmt: skip
        for label, work in works.items():
            self.items[label] = Button(label=label, width=150, css_classes=["item"])
            self.items[label].on_click(partial(self._do, work))
        self.layout = column(
            *self.items.values(), visible=False, css_classes=["menu"], spacing=0, name="context menu"
        )
        rows = "".join(f"<tr><th>{keys}</th><td>{meaning}</td></tr>" for keys, meaning in KEYS.items())
        close = "<p><a href='#' data-act='help'>Close</a></p>"
        self.help = Div(
            text=f"<table>{rows}</table>{close}", visible=False, css_classes=["card"], name="help"
        )

    def show(self, canvas: Canvas, at: Point, left: float, top: float) -> None:
        """Show what can be done at a point of a view; left, top: of the menu in the window [pixels]."""
        page = self.page
        path = canvas.thing_at(page.scene, at)
        self.at = at if canvas.plane == ABOVE else None
        if path is not None and path not in page.selection:
            page.choose(path)
        can_turn = any(edits.can_turn(page.scene.data, each) for each in page.selection)
        for n, (label, item) in enumerate(self.items.items()):
            item.visible = (path is not None) == (n < 5) and (can_turn or not label.startswith("Turn"))
        self.items["Paste here"].disabled = not page.clip
        self.layout.styles = {
            "left": f"min({left:.0f}px, 100vw - 170px)", "top": f"min({top:.0f}px, 100vh - 170px)",
        }  # fmt: skip
        self.layout.visible = True

    def _do(self, work: Callable[[], Any]) -> None:
        self.layout.visible = False
        work()

    def _form(self) -> None:
        self.page.tabs.active = 0

    def toggle_help(self) -> None:
        """Show or hide the list of the keys."""
        self.help.visible = not self.help.visible
