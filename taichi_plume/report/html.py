"""Pages that need nothing else: sections of lines, images and tables, put into `page.html`."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taichi_plume import __version__
from taichi_plume.files.disk import written_whole
from taichi_plume.report.facts import Rows

TEMPLATE = Path(__file__).with_name("page.html")


@dataclass
class Image:
    """A figure: the image itself as an address, what it shows in a line, and how to read it."""

    address: str
    title: str
    caption: str


@dataclass
class Table:
    """Rows under their heads, with a line on what they say."""

    rows: Rows
    heads: tuple[str, ...] = ()
    caption: str = ""


@dataclass
class Section:
    """A part of the page, in the order in which it is read: lines, images, tables."""

    title: str
    key: str
    lines: list[str] = field(default_factory=list)
    images: list[Image] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)

    @property
    def empty(self) -> bool:
        """Whether there is nothing to be said."""
        return not (self.lines or self.images or self.tables)


def write(path: Path, sections: Iterable[Section], **told: Any) -> Path:
    """Write a page of those sections that say something; returns its path. Raises OSError.

    told: what else the template takes: name, status, good (whether that is a good one), message, began (lines of
    how it began), and where it is no report of a run, `what` it is and `about`.
    """
    import jinja2

    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    said = [one for one in sections if not one.empty]
    html = template.render(sections=said, version=__version__, **told)
    with written_whole(path) as fresh:
        fresh.write_text(html, encoding="utf-8", errors="backslashreplace")
    return path
