"""Make the pictures of the page `taichi-plume draw`: a film of a room drawn from nothing and run, and single steps.

    python docs/draw/make.py

needs a Chromium browser, Playwright and the extra `draw`. The pictures go to the folder of this file.
"""

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parents[1] / "tests" / "draw"), str(HERE.parents[1])]

from browser import Browser, launched  # noqa: E402
from playwright.sync_api import sync_playwright  # noqa: E402
from served import serving  # noqa: E402

SIZE = 1280, 780  # pixels of the page
WIDTH = 880  # pixels of the film
COLORS = 160
STEP, LIVE, LAST = 700, 250, 2500  # ms of a frame: a step of drawing, of the run, the last one
DRAWN = (
    ("inlet", (0, 1), (0, 2)),
    ("outlet", (4, 1), (4, 2)),
    ("box", (1.0, 0.9), (1.4, 1.3)),
    ("box", (1.9, 1.8), (2.3, 2.4)),
    ("source", (0.5, 1.5)),
    ("robots", (3.5, 1.0)),
    ("robots", (3.5, 2.0)),
)


class Film:
    """Frames of a film, each with its time [ms]."""

    def __init__(self, page: Browser):
        self.page, self.frames, self.times = page, [], []

    def shoot(self, time: int, name: str = "") -> None:
        """Take a frame; name: of a file for this picture as well."""
        picture = Image.open(io.BytesIO(self.page.page.screenshot())).convert("RGB")
        if name:
            picture.quantize(256).save(HERE / f"{name}.png", optimize=True)
        self.frames.append(
            picture.resize((WIDTH, round(WIDTH * SIZE[1] / SIZE[0])), Image.Resampling.LANCZOS)
        )
        self.times.append(time)

    def save(self, path: Path) -> None:
        """Write the frames as a GIF with the palette of two of them."""
        width, height = self.frames[0].size
        some = Image.new("RGB", (width, 2 * height))
        for n, frame in enumerate((self.frames[len(DRAWN)], self.frames[-2])):
            some.paste(frame, (0, n * height))
        palette = some.quantize(COLORS, dither=Image.Dither.NONE)
        frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in self.frames]
        frames[0].save(
            path, save_all=True, append_images=frames[1:], duration=self.times, loop=0, optimize=True
        )


def main() -> None:
    """Draw the room, run it, and write the pictures."""
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as served, sync_playwright() as tools:
        browser = launched(tools)
        page = Browser(browser.new_context().new_page(), served, SIZE)
        film = Film(page)
        film.shoot(STEP)
        for kind, *way in DRAWN:
            page.tool(kind)
            page.changed(lambda way=way: page.drag(*way) if len(way) > 1 else page.click(*way[0]))
            film.shoot(STEP)
        page.tool("select")
        page.until(lambda: "cells" in page.text_of("size"))
        film.shoot(STEP, "drawn")
        page.press("▶ Run")
        shown = ""
        while not any(
            word in page.text_of("progress")
            for word in ("completed", "source found", "ended early", "failed")
        ):
            progress = page.text_of("progress")
            if progress != shown and "running" in progress:
                film.shoot(LIVE)
            shown = progress
            page.page.wait_for_timeout(150)
        page.page.wait_for_timeout(1500)
        film.shoot(LAST, "run")
        page.tab("Report")
        page.page.wait_for_timeout(3000)
        film.shoot(LAST, "report")
        film.save(HERE / "draw.gif")
        browser.close()


if __name__ == "__main__":
    main()
