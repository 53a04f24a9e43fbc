"""Drawings of openings and screens with the direction of the air, seen from above or from the side."""

from collections.abc import Sequence
from math import hypot

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Polygon
from matplotlib.typing import ColorType

from taichi_plume.report import theme
from taichi_plume.report.theme import ABOVE
from taichi_plume.scenario.openings import Periodic
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.windows import Window

Vector = np.ndarray | Sequence[float]


def windows(axes: Axes, scenario: Scenario, plane: tuple[int, int], sizes: bool) -> None:
    """Draw the openings (inlets, outlets, periodic sides) and screens of a scenario; sizes: whether to write names."""
    named = sizes and plane == ABOVE
    shown: set[tuple[str | None, str]] = set()
    for opening in scenario.openings:
        if isinstance(opening, Periodic):
            for face in opening.faces if opening.faces[0].normal in plane else ():
                ends = face.outline(scenario.domain.extent, plane)
                axes.plot(*ends.T, color=theme.FAINT, linestyle=":", linewidth=3, zorder=7)
            continue
        color = theme.darker(opening.color)
        like = (opening.region.face, opening.label)
        name = opening.label if named and like not in shown else ""  # only the first of equal arrows
        shown.add(like)
        one_window(axes, scenario, opening.region, color, plane, name, opening.direction, opening.straight)
        velocity = vars(opening).get("velocity")
        if velocity is not None and opening.region.normal in plane:
            middle = opening.region.outline(scenario.domain.extent, plane).mean(axis=0)
            way, length = [velocity[d] for d in plane], 0.18 * max(scenario.domain.extent)
            _arrow(axes, middle, way, length, color, mutation_scale=11, zorder=9)
    for screen in scenario.screens:
        name = screen.kind if named else ""
        one_window(axes, scenario, screen, theme.darker(screen.color), plane, name, 0, True)


def one_window(
    axes: Axes,
    scenario: Scenario,
    window: Window,
    color: ColorType,
    plane: tuple[int, int],
    name: str,
    direction: int,
    combed: bool = False,
) -> None:
    """Draw an opening as a thick line if seen edge on, else its outline; direction: of arrows, inward +1, none 0."""
    room = [scenario.domain.extent[d] for d in plane]
    points = np.clip(window.outline(scenario.domain.extent, plane), 0.0, room)
    if window.normal not in plane:
        axes.add_patch(Polygon(points, fill=False, edgecolor=color, linestyle="--", linewidth=1.2, zorder=5))
        return
    ends = {
        "solid_capstyle": "butt",
        "dash_capstyle": "butt",
        "linestyle": (0, (1.2, 0.7)) if combed else "-",
    }
    axes.plot(*points.T, color=color, linewidth=4.5, zorder=7, **ends)
    low, high = points
    across, size = plane.index(window.normal), max(room)
    inward = np.zeros(2)
    inward[across] = 1.0 if low[across] < room[across] / 2 else -1.0
    count = max(1, min(5, round((high - low).max() / (0.16 * size))))
    for share in (np.arange(count) + 0.5) / count:
        start = low + share * (high - low) + (-0.011 if direction > 0 else 0.0165) * size * inward
        way = direction * inward
        _arrow(axes, start, way, 0.066 * size, color, mutation_scale=9, linewidth=1.3, zorder=8)
    if name:
        beyond = 0.065 * size * inward if vars(window).get("face") else 0.0
        x, y = (low + high) / 2 - beyond
        theme.note(axes, x, y, name, color, rotation=0 if across else 90)


def _arrow(axes: Axes, start: Vector, way: Vector, length: float, color: ColorType, **style: float) -> None:
    """Draw an arrow of this length [m] from a point along a vector; none along a vector of zero length."""
    if hypot(*way) > 0:
        end = np.add(start, length * np.asarray(way) / hypot(*way))
        ends = [(float(x), float(y)) for x, y in (start, end)]
        axes.add_patch(FancyArrowPatch(*ends, arrowstyle="-|>", color=color, **style))


def wind(axes: Axes, scenario: Scenario, plane: tuple[int, int]) -> None:
    """Draw an arrow, labelled with the speed, if the scenario's wind is given by a velocity; else nothing."""
    velocity = vars(scenario.wind).get("velocity")
    if velocity is None or not any(velocity[d] for d in plane):
        return
    extent = np.array([scenario.domain.extent[d] for d in plane])
    (x, y), way = 0.12 * extent, [velocity[d] for d in plane]
    _arrow(axes, (x, y), way, 0.14 * extent.max(), theme.BREEZE, mutation_scale=14, linewidth=2, zorder=8)
    text = f"wind {hypot(*velocity):.3g} m/s"
    theme.note(axes, x, y, text, theme.BREEZE, ha="left", va="top", dy=-5)
