"""Self-contained HTML pages: sections of lines, images and tables, inserted into the template `page.html`.

Reports of runs and studies, statistics and standings of contests are such pages. The template escapes every text, so
sections hold names and messages as they are.
"""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from taichi_plume.files.disk import written_whole
from taichi_plume.guard.terminal import visible
from taichi_plume.version import __version__

TEMPLATE = Path(__file__).with_name("page.html")
NO_BREAK = "\u00a0"
LONGEST = 4000  # characters of a text; longer texts are cut in the middle, except commands
Rows = Sequence[Sequence[object]]


def data_url(content: bytes, kind: str) -> str:
    """Return a file as a data URL (base64), which a page embeds. kind: MIME type, such as "image/png"."""
    return f"data:{kind};base64," + base64.b64encode(content).decode("ascii")


@dataclass
class Image:
    """Figure of an HTML page: PNG bytes, a title of one line, and a caption."""

    png: bytes
    title: str
    caption: str

    @property
    def address(self) -> str:
        """The figure's PNG as a data URL (base64), which embeds the image in the page."""
        return data_url(self.png, "image/png")


@dataclass
class Table:
    """Table of an HTML page: rows of cells, heads of the columns, and a caption."""

    rows: Rows
    heads: Sequence[str] = ()
    caption: str = ""


@dataclass
class Section:
    """Section of an HTML page: lines of text, then images, then tables. key: anchor; code: the lines are commands."""

    title: str
    key: str
    lines: list[str] = field(default_factory=list)
    images: list[Image] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    code: bool = False

    def image(self, png: bytes, title: str, caption: str) -> None:
        """Append a figure to the section: PNG bytes, title and caption."""
        self.images.append(Image(png, title, caption))

    def table(self, rows: Rows, heads: Sequence[str] = (), caption: str = "") -> None:
        """Append a table to the section; without rows do nothing."""
        if rows:
            self.tables.append(Table(rows, heads, caption))

    @property
    def empty(self) -> bool:
        """True if the section has no lines, no images and no tables."""
        return not (self.lines or self.images or self.tables)


def write(
    path: Path,
    sections: Iterable[Section],
    *,
    name: str,
    status: str,
    good: bool,
    message: str = "",
    began: Sequence[str] = (),
    what: str = "report of a run",
    about: str = "Report of a run of taichi_plume",
) -> Path:
    """Write an HTML page of the sections that are not empty to `path`; return the path. Raises OSError.

    name: heading; status: word in a box, green if `good`, else red; message: line beside the box. about: line below
    the box, followed by the lines of `began`. what: text after the name in the window's title.
    """
    import jinja2

    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["shown"] = shown
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    html = template.render(
        sections=[section for section in sections if not section.empty], version=__version__, name=name, status=status,
        good=good, message=message, began=began, what=what, about=about,
    )  # fmt: skip
    with written_whole(path) as fresh:
        fresh.write_text(html, encoding="utf-8", errors="backslashreplace")
    return path


def shown(text: object, longest: int | None = LONGEST) -> str:
    """Return a text with control characters escaped, cut to `longest` characters; non-breaking spaces are kept."""
    return NO_BREAK.join(visible(part, longest) for part in str(text).split(NO_BREAK))
