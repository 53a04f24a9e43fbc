"""A page of `draw` in headless Chromium: clicks and drags at positions of the room [m], pictures of each step."""

import os
import shutil
import time
from itertools import pairwise
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
PICTURES = os.environ.get("TAICHI_PLUME_PICTURES", "")
"""Folder for pictures of each step, to be looked at; none by default."""
FLAGS = ("--no-sandbox", "--disable-dev-shm-usage")  # for containers, which have little shared memory
VIEW = """() => {
  const models = [...Bokeh.documents[0]._all_models.values()]
  const plot = models.find((model) => model.name == "above")
  const box = Bokeh.index.find_one(plot).frame.bbox
  return {x: [plot.x_range.start, plot.x_range.end], y: [plot.y_range.start, plot.y_range.end],
          left: box.left, right: box.right, top: box.top, bottom: box.bottom}
}"""
SOCKETS = """
window.sockets = []
const Plain = WebSocket
window.WebSocket = class extends Plain { constructor(...about) { super(...about); sockets.push(this) } }
"""
EDITOR = ".ace_editor:not(.ace_autocomplete)"
CHOOSE = """([name, value]) => {
  [...Bokeh.documents[0]._all_models.values()].find((model) => model.name == name).value = value
}"""
TEXT_OF = """(name) => {
  const model = [...Bokeh.documents[0]._all_models.values()].find((model) => model.name == name)
  return model.text ?? model.html ?? model.value_input ?? model.value
}"""


def program() -> str:
    """Path of a browser; without one, or without Playwright, the test is skipped."""
    pytest.importorskip("playwright", reason="Playwright is not installed")
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip(f"no browser is installed: {', '.join(NAMES)}")
    return path


def launched(tools):
    """Chromium of Playwright's tools; the test is skipped where no browser can be started."""
    path = program()
    from playwright.sync_api import Error

    try:
        return tools.chromium.launch(executable_path=path, args=list(FLAGS))
    except Error as fault:
        pytest.skip(f"{path} cannot be started: {str(fault).splitlines()[0]}")


class Browser:
    """Page of `draw` at an address. elsewhere: addresses on other machines that the browser asked for."""

    def __init__(self, page, served, size=(1400, 860)):
        self.page, self.served = page, served
        self.elsewhere, self.errors = [], []
        page.context.on("request", self._asked)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.add_init_script(SOCKETS)
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.goto(served.url)
        page.wait_for_selector(".bk-Figure", timeout=60_000)
        self.until(lambda: self.text_of("size"), 60)

    def _asked(self, request):
        own = (f"http://{self.served.host}/", "data:", "blob:")
        if not request.url.startswith(own):
            self.elsewhere.append(request.url)

    def until(self, condition, patience=60.0):
        """Wait until a condition holds, and return its value."""
        end = time.monotonic() + patience
        while not (found := condition()):
            assert time.monotonic() < end, "waited too long"
            self.page.wait_for_timeout(100)
        return found

    def text_of(self, name: str) -> str:
        """Text or value of the widget of a name."""
        return self.page.evaluate(TEXT_OF, name)

    @property
    def yaml(self) -> str:
        """Text that the page shows."""
        return self.text_of("yaml")

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Pixel of a position in the room."""
        view, box = self.page.evaluate(VIEW), self.page.locator(".bk-Figure").first.bounding_box()
        (x0, x1), (y0, y1) = view["x"], view["y"]
        return (
            box["x"] + view["left"] + (x - x0) / (x1 - x0) * (view["right"] - view["left"]),
            box["y"] + view["bottom"] - (y - y0) / (y1 - y0) * (view["bottom"] - view["top"]),
        )

    def changed(self, work):
        """Do something, and wait until the text has changed."""
        before = self.yaml
        work()
        self.until(lambda: self.yaml != before, 30)
        self.page.wait_for_timeout(150)

    def tool(self, kind: str):
        """Choose a tool of the palette."""
        self.page.locator(".bk-btn").get_by_text(kind, exact=True).first.click()
        self.page.wait_for_timeout(100)

    def click(self, x: float, y: float):
        self.page.mouse.click(*self.at(x, y))

    def drag(self, *way: tuple[float, float], held=0):
        """Drag from position to position; held: time [ms] before the pointer moves."""
        self.page.mouse.move(*self.at(*way[0]))
        self.page.mouse.down()
        self.page.wait_for_timeout(held)
        for (a, b), (c, d) in pairwise(way):
            for part in (0.25, 0.5, 0.75, 1.0):
                self.page.mouse.move(*self.at(a + part * (c - a), b + part * (d - b)))
                self.page.wait_for_timeout(20)
        self.page.mouse.up()

    def press(self, label: str):
        """Press the button of a label."""
        self.page.locator(".bk-btn").get_by_text(label, exact=True).first.click()

    def choose(self, name: str, value: str):
        """Choose a value of the list of a name."""
        self.page.evaluate(CHOOSE, [name, value])

    def tab(self, title: str):
        """Open the tab whose title begins so."""
        self.page.locator(".bk-tab").filter(has_text=title).first.click()
        self.page.wait_for_timeout(200)

    def write(self, old: str, new: str):
        """Replace a part of the text in the editor."""
        replace = (
            "(place, [old, now]) => { const it = place.env.editor; it.find(old); it.insert(now); it.focus() }"
        )
        self.page.locator(EDITOR).evaluate(replace, [old, new])

    def picture(self, name: str):
        """Take a picture of the page, if pictures are wanted."""
        if PICTURES:
            Path(PICTURES).mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=str(Path(PICTURES) / f"{name}.png"))
