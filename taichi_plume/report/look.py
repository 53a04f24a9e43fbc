"""How figures look: colours, sizes of letters, scales; and figures without a window."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from taichi_plume.record.drawing import decades, robot_color

ABOVE, SIDE, FRONT = (0, 1), (0, 2), (1, 2)
PLANES = {"xy": ABOVE, "xz": SIDE, "yz": FRONT}
"""The axes of a view, to the right and up; by their names."""
INK, FAINT, PAPER, FLOOR = "#1d2733", "#7b8794", "#ffffff", "#f4f6f8"
SOLID, SOLID_EDGE = "#a7b0bb", "#5d6875"
SOURCE, FOUND, START = "#d81b60", "#1b8a3a", "#5d6875"
WRONG = "#d32f2f"
HEATER, WIND = "#fb8c00", "#27445f"
STATES = (
    "#90a4ae",
    "#ffb300",
    "#29b6f6",
    "#ab47bc",
    "#8bc34a",
    "#f06292",
    "#a1887f",
    "#26a69a",
    "#7986cb",
    "#d4e157",
)
LONGEST_NAME = 24  # letters, in a figure
LETTERS: dict[Any, float] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.labelsize": 9.0,
    "legend.fontsize": 8.0,
}
STYLE: Any = {
    "font.family": "DejaVu Sans",
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.linewidth": 0.8,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.frameon": False,
    "savefig.facecolor": PAPER,
    "figure.facecolor": PAPER,
    "path.simplify_threshold": 0.5,
    **LETTERS,
}
GAS: Colormap = LinearSegmentedColormap.from_list(
    "plume", [FLOOR, "#fde9a9", "#fdbb57", "#f4763b", "#cf2f2c", "#7d0d2b", "#3b0518"]
)
"""Of gas on paper: the floor's colour where there is none."""
WARMTH = "RdYlBu_r"
HALO = [withStroke(linewidth=2.2, foreground=PAPER)]
"""Around letters that stand on a picture."""


def robot(number: int) -> str:
    """The colour of a robot or a group: in recordings robots have the same."""
    return "#{:02x}{:02x}{:02x}".format(*robot_color(number))


@contextmanager
def styled(more: Any = None) -> Iterator[None]:
    """The context in which our figures are made and saved; more: other settings of matplotlib."""
    with warnings.catch_warnings(), mpl.rc_context(STYLE | (more or {})):
        warnings.filterwarnings(
            "ignore", "Glyph .* missing"
        )  # of names in scripts that the font does not have
        yield


def figure(width: float, height: float, dpi: float = 110) -> Figure:
    """One of this size [inches]."""
    made = Figure(figsize=(width, height), dpi=dpi)
    FigureCanvasAgg(made)
    return made


def png(one: Figure) -> bytes:
    """A figure as a PNG; without the time and version that would tell equal ones apart."""
    out = BytesIO()
    one.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def plain(axes: Any) -> None:
    """Axes of a plot over time: no frame but below and on the left, a faint grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#e3e7eb", linewidth=0.7)
    axes.set_axisbelow(True)


def scale(axes: Any, image: Any, low: float, high: float, logarithmic: bool, label: str, **where: Any) -> Any:
    """A colour bar beside an image of bytes or shares: its ends 0 and `top` stand for low and high."""
    bottom, top = image.get_clim()
    bar = image.figure.colorbar(image, ax=axes, **({"fraction": 0.04, "pad": 0.02, "aspect": 28} | where))
    if logarithmic:
        places, labels = zip(*(decades(low, high) or [(0.0, f"{low:g}")]), strict=True)
    else:
        places = tuple(n / 4 for n in range(5))
        labels = tuple(f"{low + (high - low) * place:.4g}" for place in places)
    bar.set_ticks([bottom + place * (top - bottom) for place in places], labels=labels)
    bar.ax.minorticks_off()
    bar.set_label(label)
    bar.outline.set_visible(False)
    return bar


def short(text: str, letters: int = LONGEST_NAME) -> str:
    """A name that leaves room for others: a longer one by its begin and its end, which may be a number."""
    half = letters // 2
    return text if len(text) <= letters else f"{text[: letters - half]}…{text[1 - half :]}"


def darker(color: Sequence[float], share: float = 0.68) -> tuple[float, ...]:
    """A colour of the recording's, 0 to 255, as one that shows on paper, 0 to 1."""
    return tuple(share * part / 255 for part in color)


def note(
    axes: Any, x: float, y: float, text: str, color: Any, dx: float = 0, dy: float = 0, **how: Any
) -> None:
    """Letters at a place, moved by so many points; never read as mathematics."""
    how = {"ha": "center", "va": "center"} | how
    axes.annotate(
        text, (x, y), (dx, dy), textcoords="offset points", color=color, fontsize=7.5,
        path_effects=HALO, zorder=12, parse_math=False, annotation_clip=False, **how,
    )  # fmt: skip
