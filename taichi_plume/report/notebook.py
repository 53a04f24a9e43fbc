"""HTML that a notebook shows for a run, a scenario or a simulation: a table in words and a picture."""

from collections.abc import Sequence
from html import escape

from taichi_plume.execution.summary import summary
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import visible
from taichi_plume.report.html import data_url
from taichi_plume.report.page import COMPLETE
from taichi_plume.report.pictures import Shown, still
from taichi_plume.report.theme import png
from taichi_plume.results.run import Run

WIDTH = 900  # pixels of a picture
CELL = "text-align:left; vertical-align:top; padding:0.1em 1em 0.1em 0"


def of_run(run: Run) -> str:
    """Return HTML of a run: the summary of its result in words, and a picture of its end."""
    result = run.result
    if not result.keys() >= COMPLETE:  # still running, or killed
        return f"<pre>{escape(repr(run))}</pre>"
    try:
        picture = png(still(run, shown=Shown(width=WIDTH))[0])
    except InputError:  # neither recording nor fields
        picture = b""
    return page(summary(result), picture) + f"<pre>{escape(repr(run))}</pre>"


def page(rows: Sequence[tuple[str, object]], picture: bytes = b"") -> str:
    """Return HTML of (name, text) rows and, unless it is empty, a PNG below."""
    cells = "".join(
        f'<tr><td style="{CELL}; white-space:nowrap"><b>{escape(visible(name))}</b></td>'
        f'<td style="{CELL}">{escape(visible(text))}</td></tr>'
        for name, text in rows
    )
    shown = f'<img style="max-width:100%" src="{data_url(picture, "image/png")}">' if picture else ""
    return f"<table>{cells}</table>{shown}"
