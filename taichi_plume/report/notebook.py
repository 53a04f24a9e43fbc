"""HTML that a notebook shows for a run, a scenario or a simulation: a table in words and a picture."""

from html import escape

from taichi_plume.execution.summary import summary
from taichi_plume.guard.input_error import InputError
from taichi_plume.report.html import in_notebook
from taichi_plume.report.page import COMPLETE
from taichi_plume.report.pictures import Shown, still
from taichi_plume.report.theme import png
from taichi_plume.results.run import Run

WIDTH = 900  # pixels of a picture


def of_run(run: Run) -> str:
    """Return HTML of a run: the summary of its result in words, and a picture of its end."""
    result = run.result
    if not result.keys() >= COMPLETE:  # still running, or killed
        return f"<pre>{escape(repr(run))}</pre>"
    try:
        picture = png(still(run, shown=Shown(width=WIDTH))[0])
    except InputError:  # neither recording nor fields
        picture = b""
    return in_notebook(summary(result), picture=picture) + f"<pre>{escape(repr(run))}</pre>"
