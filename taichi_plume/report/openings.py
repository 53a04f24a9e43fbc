"""Drawings of openings and screens with the direction of the air, seen from above or from the side."""

from math import hypot

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle
from matplotlib.typing import ColorType

from taichi_plume.report import theme
from taichi_plume.report.theme import ABOVE
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.windows import Window


def windows(axes: Axes, scenario: Scenario, plane: tuple[int, int], sizes: bool) -> None:
    """Draw the openings (inlets, outlets, periodic sides) and screens of a scenario; sizes: whether to write names."""
    named = sizes and plane == ABOVE
    shown: set[tuple[str | None, str]] = set()
    for opening in scenario.openings:
        if opening.region is None:  # periodic: both faces of an axis
            axis = "xyz".index(opening.wraps or "x")
            for level in (0.0, scenario.domain.extent[axis]) if axis in plane else ():
                ends = _ends(axis, level, 0.0, scenario.domain.extent[plane[1 - plane.index(axis)]], plane)
                axes.plot(*ends, color=theme.FAINT, linestyle=":", linewidth=3, zorder=7)
            continue
        color = theme.darker(opening.color)
        way = 0
        if opening.passes:
            way = 1 if opening.blows and (vars(opening).get("speed") or 0.0) >= 0 else -1
        like = (opening.region.face, opening.label)
        name = opening.label if named and like not in shown else ""  # only the first of equal arrows
        shown.add(like)
        one_window(axes, scenario, opening.region, color, plane, name, way, opening.straight)
        velocity = vars(opening).get("velocity")
        if velocity is not None:
            _slide(axes, scenario, opening.region, velocity, color, plane)
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
    way: int,
    combed: bool = False,
) -> None:
    """Draw an opening as a thick line if seen edge on, else its outline; way: arrows inward +1, outward -1, none 0."""
    extent, normal = scenario.domain.extent, window.normal
    if normal not in plane:
        (x, y), (w, h) = window.rectangle(extent)
        round_ = window.is_disc(len(extent))
        patch = Circle((x, y), w) if round_ else Rectangle((x - w, y - h), 2 * w, 2 * h)
        patch.set(fill=False, edgecolor=color, linestyle="--", linewidth=1.2, zorder=5)
        axes.add_patch(patch)
        return
    n = window.along(len(extent)).index(plane[1 - plane.index(normal)])
    low, high = (float(corner[n]) for corner in window.bounds(extent))
    level = window.level(extent)
    caps = {
        "linestyle": (0, (1.2, 0.7)) if combed else "-",
        "solid_capstyle": "butt",
        "dash_capstyle": "butt",
    }
    axes.plot(*_ends(normal, level, low, high, plane), color=color, linewidth=4.5, zorder=7, **caps)
    inward = 1.0 if level < extent[normal] / 2 else -1.0
    size = max(extent[plane[0]], extent[plane[1]])
    if way:
        arrow = 0.055 * size
        start, end = (level - inward * 0.2 * arrow, level + inward * arrow)
        if way < 0:
            start, end = level + inward * 0.3 * arrow, level - inward * 0.9 * arrow
        count = max(1, min(5, round((high - low) / (0.16 * size))))
        for at in low + (np.arange(count) + 0.5) * (high - low) / count:
            points = [(level_, at) if plane[0] == normal else (at, level_) for level_ in (start, end)]
            style = {"arrowstyle": "-|>", "mutation_scale": 9, "linewidth": 1.3, "zorder": 8}
            axes.add_patch(FancyArrowPatch(*points, color=color, **style))
    if name:
        upright = plane[0] == normal
        beyond = level - inward * 0.065 * size if vars(window).get("face") else level
        x, y = (beyond, (low + high) / 2) if upright else ((low + high) / 2, beyond)
        theme.note(axes, x, y, name, color, rotation=90 if upright else 0)


def _slide(
    axes: Axes,
    scenario: Scenario,
    region: Window,
    velocity: tuple[float, ...],
    color: ColorType,
    plane: tuple[int, int],
) -> None:
    """Draw an arrow in the direction in which a sliding wall moves, if the wall is seen edge on."""
    way = np.array([velocity[d] for d in plane], float)
    if region.normal not in plane or not hypot(*way) > 0:
        return
    level, size = region.level(scenario.domain.extent), max(scenario.domain.extent)
    middle = np.array([scenario.domain.extent[d] / 2 for d in plane])
    middle[plane.index(region.normal)] = level
    tip = middle + 0.18 * size * way / hypot(*way)
    style = {"arrowstyle": "-|>", "mutation_scale": 11, "zorder": 9}
    axes.add_patch(FancyArrowPatch(tuple(middle), tuple(tip), color=color, **style))


Ends = tuple[float, float]


def _ends(normal: int, level: float, low: float, high: float, plane: tuple[int, int]) -> tuple[Ends, Ends]:
    """Return the x pair and y pair of a line at `level` of axis `normal`, from `low` to `high` on the other axis."""
    return ((level, level), (low, high)) if plane[0] == normal else ((low, high), (level, level))


def wind(axes: Axes, scenario: Scenario, plane: tuple[int, int]) -> None:
    """Draw an arrow, labelled with the speed, if the scenario's wind is given by a velocity; else nothing."""
    velocity = vars(scenario.wind).get("velocity")
    if velocity is None:
        return
    way = np.array([velocity[d] for d in plane], float)
    if not hypot(*way) > 0:
        return
    extent = np.array([scenario.domain.extent[d] for d in plane])
    start = 0.12 * extent
    tip = start + 0.14 * extent.max() * way / hypot(*way)
    style = {"arrowstyle": "-|>", "mutation_scale": 14, "linewidth": 2, "zorder": 8}
    axes.add_patch(FancyArrowPatch(tuple(start), tuple(tip), color=theme.BREEZE, **style))
    text = f"wind {hypot(*velocity):.3g} m/s"
    theme.note(axes, start[0], start[1], text, theme.BREEZE, ha="left", va="top", dy=-5)
