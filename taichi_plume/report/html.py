"""Self-contained HTML pages: sections of lines, images and tables, inserted into the template `page.html`.

Reports of runs, studies and validations, statistics and standings of contests are such pages. The template escapes
every text, so sections hold names and messages as they are.
"""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from taichi_plume.files.disk import written_whole
from taichi_plume.guard.terminal import visible
from taichi_plume.version import __version__

TEMPLATE = Path(__file__).with_name("page.html")
NO_BREAK = "\u00a0"
LONGEST = 4000  # characters of a text; longer texts are cut in the middle, except commands
Rows = Sequence[Sequence[object]]
GOOD, BAD = "#1b8a3a", "#c2410c"
"""Colours of boxes with good and with bad news."""
CELL = '"text-align:left; vertical-align:top; padding:0.1em 1em 0.1em 0"'


def data_url(content: bytes, kind: str) -> str:
    """Return a file as a data URL (base64), which a page embeds. kind: MIME type, such as "image/png"."""
    return f"data:{kind};base64," + base64.b64encode(content).decode("ascii")


class Mark(NamedTuple):
    """Text in a coloured box, as a line or a cell of a page, with more text beside. to: key of a section to link to."""

    text: str
    color: str = ""
    beside: str = ""
    to: str = ""


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
    """Section of an HTML page: lines (texts or `Mark`), then images, then tables. key: anchor; code: of commands."""

    title: str
    key: str
    lines: list[Any] = field(default_factory=list)
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


def write(path: Path, sections: Iterable[Section], **about: Any) -> Path:
    """Write the HTML page of the sections to `path`, see `page`; return the path. Raises OSError."""
    text = page(sections, **about)
    with written_whole(path) as fresh:
        fresh.write_text(text, encoding="utf-8", errors="backslashreplace")
    return path


def page(
    sections: Iterable[Section], *, name: str, status: str, good: bool, message: str = "",
    began: Sequence[str] = (), what: str = "report of a run", about: str = "Report of a run of taichi_plume",
) -> str:  # fmt: skip
    """Return the HTML page of the sections that are not empty.

    name: heading; status: word in a box, green if `good`, else red; message: line beside the box. about: line below
    the box, followed by the lines of `began`. what: text after the name in the window's title.
    """
    import jinja2

    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["shown"] = shown
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    status_mark = Mark(status, GOOD if good else BAD, message)
    return template.render(
        sections=[section for section in sections if not section.empty], version=__version__, name=name,
        status=status_mark, began=began, what=what, about=about,
    )  # fmt: skip


def in_notebook(
    rows: Rows, heads: Sequence[str] = (), picture: bytes = b"", notes: Sequence[str] = ()
) -> str:
    """Return HTML that a notebook shows: a table whose first column is bold, a PNG unless it is empty, and notes."""
    head = "".join(f"<th style={CELL}>{escape(visible(head))}</th>" for head in heads)
    made = f"<tr>{head}</tr>" if heads else ""
    for name, *texts in rows:
        cells = "".join(f"<td style={CELL}>{escape(visible(text))}</td>" for text in texts)
        made += (
            f"<tr><td style={CELL}><b style=white-space:nowrap>{escape(visible(name))}</b></td>{cells}</tr>"
        )
    image = f'<img style="max-width:100%" src="{data_url(picture, "image/png")}">' if picture else ""
    return f"<table>{made}</table>{image}" + "".join(f"<p>{escape(visible(note))}</p>" for note in notes)


def shown(text: object, longest: int | None = LONGEST) -> str:
    """Return a text with control characters escaped, cut to `longest` characters; non-breaking spaces are kept."""
    return NO_BREAK.join(visible(part, longest) for part in str(text).split(NO_BREAK))
