"""Theme of figures: colours, sizes of letters, colour bars; figures without a window."""

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.typing import ColorType

from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import visible
from taichi_plume.observed.scales import decades
from taichi_plume.scenario import palette

ABOVE, SIDE, FRONT = (0, 1), (0, 2), (1, 2)
PLANES = {"xy": ABOVE, "xz": SIDE, "yz": FRONT}
"""Axes of a view, to the right and up, by their names."""
INK, FAINT, PAPER, FLOOR = "#1d2733", "#7b8794", "#ffffff", "#f4f6f8"
FOUND, WRONG, SOURCE, SOLID, PROBE = (
    palette.FOUND,
    palette.WRONG,
    palette.SOURCE,
    palette.SOLID,
    palette.PROBE,
)
WARM, COOL = palette.WARM, palette.COOL
robot, state_colors = palette.robot_color, palette.state_colors
"""Colours of things are those of the palette, those of paper and letters are here."""
SOLID_EDGE, START, TRUE_GAS = "#5d6875", "#5d6875", "#c3cad2"
ERROR, UNLIKELY = "#d32f2f", "#b26a00"
"""Text of errors and of warnings on a page."""
WIND, BREEZE = "#27445f", "#2778b5"
WIDE, DPI = 7.2, 100  # inches and dots per inch: plots of pages
LEAST_INCHES, MOST_INCHES = 0.5, 200.0  # width and height of the smallest axes, of the largest figure
LONGEST_NAME = 24  # letters, in a figure
LETTERS = {"font.size": 9.0, "axes.titlesize": 10.0, "axes.labelsize": 9.0, "legend.fontsize": 8.0}
TEXT_AS_TEXT: Any = {"pdf.fonttype": 42, "ps.fonttype": 42, "svg.fonttype": "none"}
"""Settings of saved files: TrueType fonts in PDF and PostScript instead of Type 3, text instead of outlines in SVG."""
STYLE: Any = {
    "font.family": ["DejaVu Sans", "sans-serif"],  # SVG viewers without the first choose from the second
    "font.sans-serif": ["DejaVu Sans"],
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
    **TEXT_AS_TEXT,
}
GAS: Colormap = LinearSegmentedColormap.from_list(
    "plume", [FLOOR, "#fde9a9", "#fdbb57", "#f4763b", "#cf2f2c", "#7d0d2b", "#3b0518"]
)
"""Colours of gas on paper: the floor's colour without gas."""
WARMTH = mpl.colormaps["RdYlBu_r"]
HALO = [withStroke(linewidth=2.2, foreground=PAPER)]
"""Outline of a line or of letters on a picture."""


def colors_of(unit: str) -> Colormap:
    """Return the colours on paper of a quantity with a unit: of the gas for ppm."""
    return GAS if unit == "ppm" else WARMTH


@contextmanager
def styled(more: Mapping[Any, Any] | None = None) -> Iterator[None]:
    """Context with the report style for drawing and saving figures; more: further settings of matplotlib."""
    with warnings.catch_warnings(), mpl.rc_context({**STYLE, **(more or {})}):
        warnings.filterwarnings("ignore", "Glyph .* missing")  # names in scripts that the font lacks
        yield


class NotebookFigure(Figure):
    """Figure that a notebook shows, also without pyplot, and that is saved in the report's style."""

    def savefig(self, *args: Any, **keys: Any) -> None:
        """Save the figure as matplotlib does, with text that can be searched and edited in PDF and SVG."""
        with styled():
            super().savefig(*args, **keys)

    def _repr_png_(self) -> bytes:
        return png(self)


def figure(width: float, height: float, dpi: float = 110) -> Figure:
    """Return an empty figure of a size [inches]."""
    made = NotebookFigure(figsize=(width, height), dpi=dpi)
    FigureCanvasAgg(made)
    return made


class Place(NamedTuple):
    """Place that a user gives for a picture: axes of a figure of theirs, or the size of a new one [inches]."""

    ax: Axes | None = None
    figsize: tuple[float, float] | None = None

    @classmethod
    def of(cls, ax: Axes | None, figsize: Sequence[float] | None) -> "Place":
        """Return the place; raise InputError if both are given, or a figsize that is not two positive numbers."""
        if ax is not None and figsize is not None:
            raise InputError("ax, figsize: got both; give figsize to the figure that has the axes")
        if figsize is None:
            return cls(ax)
        sizes = [float(size) for size in figsize if isinstance(size, int | float | np.number)]
        if len(sizes) != 2 or len(figsize) != 2 or not all(0 < size < MOST_INCHES for size in sizes):
            allowed = f"width and height in inches, above 0 and below {MOST_INCHES:g}"
            raise InputError(f"figsize: got {visible(figsize)}; allowed are {allowed}")
        return cls(None, (sizes[0], sizes[1]))


ANYWHERE = Place()


def require_size(figsize: tuple[float, float], around: tuple[float, float]) -> None:
    """Raise InputError if a figure has no room for axes; around: what its margins take, width and height [inches]."""
    least = around[0] + LEAST_INCHES, around[1] + LEAST_INCHES
    if figsize[0] < least[0] or figsize[1] < least[1]:
        allowed = f"at least {least[0]:.2g} by {least[1]:.2g} inches"
        raise InputError(f"figsize: got ({figsize[0]:g}, {figsize[1]:g}); allowed are {allowed}")


def figure_around(ax: Axes) -> Figure:
    """Return the figure that has these axes, also if they are in a part of the figure (SubFigure)."""
    figure = ax.get_figure(root=True)
    assert isinstance(figure, Figure)
    return figure


class Panels(list[Axes]):
    """Panels of a plot: their axes, the figure and, after the block of `panels`, the picture as PNG bytes."""

    figure: Figure
    png: bytes


@contextmanager
def panels(
    count: int = 1, columns: int = 1, tall: float = 2.9, *, math: bool = True, below: float = 0.0, **keys: Any
) -> Iterator[Panels]:
    """Context that draws a plot of a page: `count` panels in columns, with frames at the left and below.

    tall: height of the panels; below: height of a strip that stays free [inches]. math: read `$` as mathematics; names
    from files need False. keys: of matplotlib's subplots.
    """
    with styled({"text.parse_math": math, "axes.titlesize": 9.0}):
        made = Panels()
        made.figure = figure(WIDE, tall + below, DPI)
        axes = made.figure.subplots(-(-count // columns), columns, squeeze=False, **keys).ravel()
        made += axes[:count]
        for panel in made:
            plain(panel)
        for panel in axes[count:]:
            panel.set_axis_off()
        yield made
        made.figure.tight_layout(pad=0.6, rect=(0, below / (tall + below), 1, 1))
        made.png = png(made.figure)


def png(figure: Figure) -> bytes:
    """Return a figure as a PNG, without time and version, so that equal figures have equal files."""
    out = BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def plain(axes: Axes) -> None:
    """Style the axes of a plot over time: frame below and on the left only, a faint grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#e3e7eb", linewidth=0.7)
    axes.set_axisbelow(True)


def verbatim(texts: Iterable[Text]) -> None:
    """Let texts of a figure show `$` as is, never as mathematics (mathtext)."""
    for text in texts:
        text.set_parse_math(False)


def scale(
    axes: Axes | Sequence[Axes] | None,
    image: ScalarMappable,
    low: float,
    high: float,
    logarithmic: bool,
    label: str,
    **where: Any,
) -> Colorbar:
    """Add a colour bar beside an image of bytes or fractions; its least and largest colours are low and high."""
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
    """Return a name, cut in the middle if it is too long; the end may be a number."""
    half = letters // 2
    return text if len(text) <= letters else f"{text[: letters - half]}…{text[1 - half :]}"


def darker(color: Sequence[float]) -> tuple[float, float, float]:
    """Return a colour of the recording, 0 to 255, as a colour for paper, 0 to 1."""
    red, green, blue = (0.68 * part / 255 for part in color)
    return red, green, blue


def note(
    axes: Axes, x: float, y: float, text: str, color: ColorType, dx: float = 0, dy: float = 0, **how: Any
) -> None:
    """Write a text at a position, moved by (dx, dy) points, with a halo below; never read as mathematics.

    The halo is a text of its own, as files have outlines instead of letters where a text has an effect.
    """
    how = {"ha": "center", "va": "center"} | how
    for look in ({"color": PAPER, "path_effects": HALO}, {"color": color}):
        axes.annotate(
            text, (x, y), (dx, dy), textcoords="offset points", fontsize=7.5, zorder=12, parse_math=False,
            annotation_clip=False, **look, **how,
        )  # fmt: skip
