"""Drawing of a scenario's scene: from above or, in 3-D, from the side; sizes in metres.

The drawing needs only a checked scenario and the shapes of the obstacles: no simulation, no Taichi.
"""

from collections.abc import Sequence
from math import cos, radians, sin
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from taichi_plume.grid.shapes import Shape
from taichi_plume.report import openings, solids, theme
from taichi_plume.report.theme import ABOVE, SIDE
from taichi_plume.scenario import palette
from taichi_plume.scenario.checks import numbered
from taichi_plume.scenario.gases import AnySource
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.shapes import shape
from taichi_plume.scenario.sources import Source

if TYPE_CHECKING:
    from taichi_plume.assembly.preparation import Prepared

MOST_LABELS = 8  # obstacles, openings etc.; beyond this number, names are left out
WIDE, MOST_TALL, LEFT, RIGHT, BELOW = 7.2, 9.0, 0.55, 0.1, 0.48  # inches of a drawing, and around its axes
MARGIN = 0.09  # around a room, for names, over its longer side
MOST_BODIES = 60  # robots whose starts are drawn one by one


def draw(
    axes: Axes,
    scenario: Scenario,
    shapes: Sequence[Shape] | None = None,
    sizes: bool = True,
    plane: tuple[int, int] = ABOVE,
    starts: bool = True,
    sources: bool = True,
) -> list[Artist]:
    """Draw walls, openings, screens, obstacles, heaters, sources, the robots' arena and start positions.

    shapes: obstacles, and cubes of an imported wind; by default all obstacles without a file. sizes: whether names
    and sizes are written. plane: `ABOVE`, in 3-D also `SIDE` or `FRONT`. starts, sources: whether start
    positions and sources are drawn. Returns the artists of the shapes.
    """
    extent = scenario.domain.extent
    a, b = plane
    width, height = extent[a], extent[b]
    axes.add_patch(Rectangle((0, 0), width, height, facecolor=theme.FLOOR, edgecolor="none", zorder=0))
    shapes = simple_shapes(scenario) if shapes is None else shapes
    drawn = [solids.solid(axes, solid, plane) for solid in shapes]
    axes.add_patch(Rectangle((0, 0), width, height, fill=False, edgecolor=theme.INK, linewidth=1.6, zorder=6))
    if plane == ABOVE and scenario.arena is not None:
        low, size = scenario.arena.low, scenario.arena.size
        edge = Rectangle(low, *size, fill=False, edgecolor=theme.FAINT, linestyle=(0, (5, 3)), zorder=6)
        axes.add_patch(edge)
        if sizes:
            theme.note(axes, low[0] + size[0], low[1], "robots' arena ", theme.FAINT, ha="right", va="bottom")
    openings.windows(axes, scenario, plane, sizes)
    if sources:
        _sources(axes, scenario, plane, sizes)
    _warmth(axes, scenario, plane, sizes)
    if starts:
        _starts(axes, scenario, plane, sizes)
    if sizes and plane == ABOVE and len(shapes) <= MOST_LABELS:
        for solid in shapes:
            solids.name(axes, solid)
    openings.wind(axes, scenario, plane)
    axes.set_aspect("equal")
    margin = (MARGIN if sizes else MARGIN / 3) * max(width, height)
    axes.set_xlim(-margin, width + margin)
    axes.set_ylim(-margin, height + margin)
    for along, length in ((axes.xaxis, width), (axes.yaxis, height)):
        along.set_ticks([place for place in along.get_ticklocs() if -1e-9 <= place <= length * (1 + 1e-9)])
    axes.set_xlabel(f"{'xyz'[a]} [m]")
    axes.set_ylabel(f"{'xyz'[b]} [m]")
    axes.spines[:].set_visible(False)
    axes.tick_params(length=3)
    return drawn


def simple_shapes(scenario: Scenario) -> list[Shape]:
    """Return the shapes of a scenario's obstacles, except obstacles that are read from a file."""
    obstacles = [obstacle for obstacle in scenario.obstacles if "file" not in vars(obstacle)]
    return [shape(obstacle, scenario.domain, Path()) for obstacle in obstacles]


def picture(scenario: Scenario, shapes: Sequence[Shape], dpi: float) -> bytes:
    """Return a PNG of the scene, see `figure_of`."""
    with theme.styled():
        return theme.png(figure_of(scenario, shapes, dpi))


def figure_of(
    scenario: Scenario,
    shapes: Sequence[Shape],
    dpi: float = 110,
    numbers: Sequence[tuple[int, tuple[float, ...]]] = (),
    place: theme.Place = theme.ANYWHERE,
) -> Figure:
    """Return a figure of the scene: seen from above and, in 3-D, below that seen from the side, on the same scale.

    numbers: (number, position [m]) of labels to draw. place: axes for the scene from above alone, or size of the
    figure. Raises InputError if the figure would be too small.
    """
    if place.ax is not None:
        draw(place.ax, scenario, shapes)
        _numbers(place.ax, numbers)
        return theme.figure_around(place.ax)
    extent = scenario.domain.extent
    planes = [ABOVE] if len(extent) == 2 else [ABOVE, SIDE]
    ways = [_sides(extent, plane) for plane in planes]
    wide, height = place.figsize or (WIDE, None)
    tall, around = sum(way[1] for way in ways), BELOW * len(planes) + 0.1
    room = MOST_TALL if height is None else height - around
    if place.figsize is not None:
        theme.require_size(place.figsize, (LEFT + RIGHT, around))
    scale = min((wide - LEFT - RIGHT) / ways[0][0], room / tall)
    height = scale * tall + around if height is None else height
    with theme.styled():
        figure = theme.figure(wide, height, dpi)
        top = height - 0.1
        for plane, (width, up) in zip(planes, ways, strict=True):
            bottom = top - scale * up
            left = (LEFT + (wide - LEFT - RIGHT - scale * width) / 2) / wide
            axes = figure.add_axes((left, bottom / height, scale * width / wide, scale * up / height))
            draw(axes, scenario, shapes, plane=plane)
            if plane == ABOVE:
                _numbers(axes, numbers)
            top = bottom - BELOW
        return figure


def _sides(extent: tuple[float, ...], plane: tuple[int, int]) -> tuple[float, float]:
    """Return the width and height [m] of a drawing of the room in a plane, with the margin for names."""
    margin = 2 * MARGIN * max(extent[d] for d in plane)
    return extent[plane[0]] + margin, extent[plane[1]] + margin


def save_check(prepared: "Prepared", fresh: Path) -> None:
    """Write a drawing of a checked scenario to a PNG file; its warnings are marked by numbers. Raises OSError."""
    with theme.styled():
        fresh.write_bytes(theme.png(checked_figure(prepared, 150)))


def checked_figure(prepared: "Prepared", dpi: float = 110, place: theme.Place = theme.ANYWHERE) -> Figure:
    """Return a figure of a checked scenario; its warnings are marked by numbers. place: as of `figure_of`."""
    numbers = numbered(prepared.resources.warnings, prepared.resources.context)
    return figure_of(prepared.scenario, all_shapes(prepared), dpi, numbers, place)


def _numbers(axes: Axes, numbers: Sequence[tuple[int, tuple[float, ...]]]) -> None:
    """Draw each (number, position [m]) as a number in a disc; numbers at the same position stand side by side."""
    beside: dict[tuple[float, ...], int] = {}
    for number, place in numbers:
        n = beside[place] = beside.get(place, -1) + 1
        axes.annotate(
            str(number), (place[0], place[1]), (-11 + 15 * n, -13), textcoords="offset points",
            ha="center", va="center", fontsize=7.5, color="white", weight="bold", zorder=13, annotation_clip=False,
            bbox={"boxstyle": "circle,pad=0.25", "facecolor": theme.INK, "edgecolor": "white"},
        )  # fmt: skip


def all_shapes(prepared: "Prepared") -> list[Shape]:
    """Return the shapes of a checked scenario's obstacles and, if its wind is imported, the wind's solid cubes."""
    resources = prepared.resources
    cubes = resources.site.cubes if resources.site is not None else None
    return [*resources.obstacles, *([cubes] if cubes is not None else [])]


# ---------------------------------------------------------------- sources and robots


def source_mark(axes: Axes, source: AnySource, plane: tuple[int, int]) -> tuple[Circle, Line2D]:
    """Draw a gas source at its position, and its path if it moves; return its disc and its star."""
    motion, place = vars(source).get("motion"), _place(source.position, plane)
    if motion is not None:
        way = np.array([source.position, *(point[1:] for point in motion.path)])[:, list(plane)]
        axes.plot(*way.T, color=theme.SOURCE, linewidth=1, linestyle=(0, (4, 3)), zorder=8)
    style = {"facecolor": theme.SOURCE, "edgecolor": "none", "alpha": 0.35, "zorder": 9}
    disc = Circle(place, source.radius, **style)
    axes.add_patch(disc)
    (star,) = axes.plot(*place, "*", color=theme.SOURCE, markeredgecolor="white", markersize=13, zorder=10)
    return disc, star


def _sources(axes: Axes, scenario: Scenario, plane: tuple[int, int], sizes: bool) -> None:
    """Draw gas sources, with labels if `sizes`."""
    named = sizes and plane == ABOVE and len(scenario.sources) <= MOST_LABELS
    searched = [gas.searched for _, gas in scenario.gases for _ in gas.sources]
    for (_, source), is_target in zip(scenario.sources, searched, strict=True):
        source_mark(axes, source, plane)
        if named:
            place, not_searched = _place(source.position, plane), "" if is_target else ", not searched for"
            theme.note(axes, *place, _given_off(source) + not_searched, theme.SOURCE, va="bottom", dy=8)


def _warmth(axes: Axes, scenario: Scenario, plane: tuple[int, int], sizes: bool) -> None:
    """Draw heaters and heated or cooled walls, with labels if `sizes`."""
    named = sizes and plane == ABOVE and len(scenario.sources) <= MOST_LABELS
    heat = scenario.heat
    for heater in heat.heaters if heat else ():
        place = _place(heater.position, plane)
        axes.add_patch(Circle(place, heater.radius, facecolor=theme.WARM, alpha=0.6, zorder=8))
        if named:
            theme.note(axes, *place, f"heater, {heater.power:g} W", theme.darker(palette.rgb(theme.WARM)))
    for wall in heat.walls if heat else ():
        color = theme.darker(palette.rgb(theme.WARM if wall.temperature > heat.reference else theme.COOL))
        openings.one_window(
            axes, scenario, wall, color, plane, f"{wall.temperature:.4g} K" if named else "", 0
        )


def _place(position: tuple[float, ...], plane: tuple[int, int]) -> tuple[float, float]:
    return position[plane[0]], position[plane[1]]


def _given_off(source: AnySource) -> str:
    """Return the label of a gas source: its emission rate, or the diameter of its dish."""
    if isinstance(source, Source) and source.dish is not None:
        return f"source, dish of {100 * source.dish.diameter:.3g} cm"
    rate = vars(source).get("rate")
    return f"source, {1e6 * rate:.3g} mg/s" if rate else "source"


def _starts(axes: Axes, scenario: Scenario, plane: tuple[int, int], sizes: bool) -> None:
    """Draw robots at their start positions or, for random positions, the rectangle that contains the starts."""
    first = 0
    named = sizes and plane == ABOVE and len(scenario.robots) <= MOST_LABELS
    for group in scenario.robots:
        radius, height, base = group.body.radius, group.body.height, group.start_altitude
        colors = [theme.robot(first + k) for k in range(group.count)]
        first += group.count
        places = group.places(scenario.floor)
        name = theme.short(group.name)
        text = f"{group.count} × {name}" if group.count > 1 else name
        if places is None:
            low, high = (np.array(vars(group.start).get(key, (0, 0)), float) for key in ("low", "high"))
            corner = np.array([*low, base])[list(plane)]
            size = (np.array([*high, base + height]) - np.array([*low, base]))[list(plane)]
            style = {"facecolor": theme.START, "alpha": 0.16, "edgecolor": theme.START, "linestyle": ":"}
            axes.add_patch(Rectangle(tuple(corner), *size, zorder=3, **style))
            at = corner + size * [0.5, 1.0]
            text += " start here" if group.count > 1 else " starts here"
        else:
            heading = group.start.heading_deg
            for place, color in zip(places[:MOST_BODIES], colors, strict=False):
                if plane == ABOVE:
                    style = {"facecolor": color, "edgecolor": "white", "linewidth": 0.6, "zorder": 11}
                    axes.add_patch(Circle(tuple(place), radius, **style))
                    if heading is not None:
                        nose = place + 2.2 * radius * np.array([cos(radians(heading)), sin(radians(heading))])
                        axes.plot(*zip(place, nose, strict=True), color=color, linewidth=1.6, zorder=11)
                else:
                    corner = (place[plane[0]] - radius, base)
                    axes.add_patch(Rectangle(corner, 2 * radius, height, facecolor=color, zorder=11))
            up = places[:, 1] + radius if plane == ABOVE else np.full(len(places), base + height)
            at = (places[up.argmax(), plane[0]], up.max())
            text += " starts" if group.count == 1 else " start"
        if named:
            side = at[0] / scenario.domain.extent[plane[0]]
            long = len(text) > theme.LONGEST_NAME  # otherwise it would leave the drawing
            ha = "right" if long and side > 0.7 else "left" if long and side < 0.3 else "center"
            theme.note(axes, at[0], at[1], text, theme.INK, va="bottom", ha=ha, dy=3)
