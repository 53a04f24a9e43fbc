"""The menu of files: new, open, examples, bring a file, and another name; each asks in a row above the drawing."""

from base64 import b64decode
from binascii import Error
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from bokeh.layouts import row
from bokeh.models import Button, Div, Dropdown, FileInput, Select, TextInput

from taichi_plume.draw.workplace import BROUGHT, DRAWN, ENDINGS, is_map
from taichi_plume.files.bundled import example, names
from taichi_plume.guard.input_error import InputError

if TYPE_CHECKING:
    from taichi_plume.draw.page import Page

NEW, OPEN, EXAMPLE, BRING, NAME = "New room", "Open …", "Example …", "Upload …", "Save as …"


class FileMenu:
    """The menu, and the row in which it asks for a file, an example or a name."""

    def __init__(self, page: "Page"):
        self.page = page
        entries = (NEW, OPEN, EXAMPLE, BRING, None, NAME)
        self.button = Dropdown(
            label="File", menu=[entry and (entry, entry) for entry in entries], width=70, name="file menu"
        )
        self.button.on_click(lambda event: self.chosen(event.item))
        self.words = Div(align="center")
        self.list = Select(title="file", width=300, name="files", css_classes=["alone"])
        self.entry = TextInput(title="new name", width=260, name="new name", css_classes=["alone"])
        self.brought = FileInput()
        self.go, stop = Button(width=80, button_type="primary", name="go"), Button(label="Cancel", width=70)
        self.go.on_click(lambda: self.work())
        stop.on_click(self.close)
        self.work: Callable[[], Any] = self.close
        self.layout = row(
            self.words, self.list, self.entry, self.brought, self.go, stop, visible=False, css_classes=["ask"],
            sizing_mode="stretch_width",
        )  # fmt: skip

    def chosen(self, name: str) -> None:
        """Carry out an entry of the menu."""
        place = self.page.workplace
        if name == NEW:
            self._take(place.open)
        elif name == OPEN:
            files = [file for file in place.files if file != place.file.name]
            self._ask("Open a scenario of this folder:", self.list, "Open", files, place.open)
        elif name == EXAMPLE:
            found = {each: example(each) for each in names()}
            options = [
                (each.name, f"{each.name}: {each.story}") for each in found.values() if each.kind in DRAWN
            ]
            self._ask("Draw a copy of:", self.list, "Draw", options, place.example)
        elif name == BRING:
            fresh = FileInput(title="file", accept=",".join(BROUGHT), name="upload", css_classes=["alone"])
            fresh.on_change("filename", lambda _attr, _old, _new: self._later())
            # an old one takes no file twice
            self.layout.children = [fresh if each is self.brought else each for each in self.layout.children]
            self.brought = fresh
            self._ask("A scenario, mesh or map for this folder:", fresh)
        else:
            self.entry.value = place.file.name
            self._ask("Save as:", self.entry, "Save", None, place.save_as)

    def _ask(
        self, words: str, widget: Any, label: str = "", options: list[Any] | None = None,
        work: Callable[[str], Any] = str,
    ) -> None:  # fmt: skip
        if options is not None:
            first = options[0] if options else ""
            self.list.update(options=options, value=first[0] if isinstance(first, tuple) else first)
        for each in (self.list, self.entry, self.brought):
            each.visible = each is widget
        self.go.update(label=label, visible=bool(label), disabled=options == [])
        self.words.text, self.layout.visible = words, True
        self.work = lambda: self._take(partial(work, widget.value))

    def _take(self, work: Callable[[], Any]) -> None:
        """Carry out what the row has asked for; the row stays after an error."""
        self.page.say("")
        try:
            work()
        except InputError as error:
            self.page.say("; ".join(error.lines))
        else:
            self.page.say(self.page.workplace.drafts.unreadable)
            self.close()

    def close(self) -> None:
        """Ask no more."""
        self.layout.visible = False

    def _later(self) -> None:
        """Bring the file once both name and content have arrived."""
        self.page.document.add_next_tick_callback(self.bring)

    def bring(self) -> None:
        """Write the file that the browser has sent; a scenario is opened."""
        place, name = self.page.workplace, str(self.brought.filename)

        def work() -> None:
            try:
                content = b64decode(str(self.brought.value), validate=True)
            except Error:
                raise InputError(f"{name}: has not arrived whole; try again") from None
            file = place.take(name, content)
            if file.suffix in ENDINGS and not is_map(file):
                place.open(file.name)

        self._take(work)
