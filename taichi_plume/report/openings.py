"""Openings and screens, and where air goes through them, seen from above or from the side."""

from math import hypot
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

from taichi_plume.report import look
from taichi_plume.report.look import ABOVE
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.windows import Window


def windows(axes: Axes, scenario: Scenario, plane: tuple[int, int], sizes: bool) -> None:
    """Openings and screens."""
    named = sizes and plane == ABOVE
    shown: dict[tuple[str, str], int] = {}
    for opening in scenario.openings:
        if opening.region is None:  # periodic: both faces of an axis
            axis = "xyz".index(opening.wraps or "x")
            for level in (0.0, scenario.domain.extent[axis]) if axis in plane else ():
                ends = _ends(axis, level, 0.0, scenario.domain.extent[plane[1 - plane.index(axis)]], plane)
                axes.plot(*ends, color=look.FAINT, linestyle=":", linewidth=3, zorder=7)
            continue
        color = look.darker(opening.color)
        way = 0
        if opening.passes:
            way = 1 if opening.blows and (getattr(opening, "speed", None) or 0.0) >= 0 else -1
        like = (opening.region.face, opening.label)
        shown[like] = shown.get(like, 0) + 1
        name = opening.label if named and shown[like] == 1 else ""  # of several alike the first
        one_window(axes, scenario, opening.region, color, plane, name, way, opening.straight)
        _slide(axes, scenario, opening, color, plane)
    for screen in scenario.screens:
        one_window(
            axes, scenario, screen, look.darker(screen.color), plane, screen.kind if named else "", 0, True
        )


def one_window(
    axes: Axes,
    scenario: Scenario,
    window: Window,
    color: Any,
    plane: tuple[int, int],
    name: str,
    way: int,
    combed: bool = False,
) -> None:
    """A window as a thick line where it is seen edge on, else by its outline; way: +1 blows in, -1 lets out."""
    extent, normal = scenario.domain.extent, window.normal
    center, half = window.rectangle(extent)
    along = window.along(len(extent))
    if normal not in plane:
        place = dict(zip(along, zip(center, half, strict=True), strict=True))
        (x, w), (y, h) = (place[d] for d in plane)
        round_ = window.is_disc(len(extent))
        patch = Circle((x, y), w) if round_ else Rectangle((x - w, y - h), 2 * w, 2 * h)
        patch.set(fill=False, edgecolor=color, linestyle="--", linewidth=1.2, zorder=5)
        axes.add_patch(patch)
        return
    other = plane[1 - plane.index(normal)]
    middle, reach = next((c, h) for d, c, h in zip(along, center, half, strict=True) if d == other)
    low, high = max(0.0, middle - reach), min(extent[other], middle + reach)
    level = window.level(extent)
    ends = _ends(normal, level, low, high, plane)
    dashed = (0, (1.2, 0.7)) if combed else "-"
    axes.plot(
        *ends,
        color=color,
        linewidth=4.5,
        linestyle=dashed,
        solid_capstyle="butt",
        dash_capstyle="butt",
        zorder=7,
    )
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
            axes.add_patch(
                FancyArrowPatch(
                    *points, color=color, arrowstyle="-|>", mutation_scale=9, linewidth=1.3, zorder=8
                )
            )
    if name:
        upright = plane[0] == normal
        beyond = level - inward * 0.065 * size if getattr(window, "face", None) else level
        x, y = (beyond, (low + high) / 2) if upright else ((low + high) / 2, beyond)
        look.note(axes, x, y, name, color, rotation=90 if upright else 0)


def _slide(axes: Axes, scenario: Scenario, opening: Any, color: Any, plane: tuple[int, int]) -> None:
    """An arrow along a wall that slides."""
    velocity = getattr(opening, "velocity", None)
    if velocity is None or opening.region is None or opening.region.normal not in plane:
        return
    level, size = opening.region.level(scenario.domain.extent), max(scenario.domain.extent)
    middle = [scenario.domain.extent[d] / 2 for d in plane]
    middle[plane.index(opening.region.normal)] = level
    way = np.array([velocity[d] for d in plane], float)
    if hypot(*way) > 0:
        tip = np.array(middle) + 0.18 * size * way / hypot(*way)
        axes.add_patch(
            FancyArrowPatch(
                (middle[0], middle[1]),
                (tip[0], tip[1]),
                color=color,
                arrowstyle="-|>",
                mutation_scale=11,
                zorder=9,
            )
        )


def _ends(normal: int, level: float, low: float, high: float, plane: tuple[int, int]) -> tuple[Any, Any]:
    """x and y of the ends of a line across the axis `normal`."""
    return ((level, level), (low, high)) if plane[0] == normal else ((low, high), (level, level))


def wind(axes: Axes, scenario: Scenario, plane: tuple[int, int]) -> None:
    """An arrow and a speed for a wind that is given by its velocity."""
    velocity = getattr(scenario.wind, "velocity", None)
    if velocity is None:
        return
    way = np.array([velocity[d] for d in plane], float)
    if not hypot(*way) > 0:
        return
    extent = np.array([scenario.domain.extent[d] for d in plane])
    start = 0.12 * extent
    tip = start + 0.14 * extent.max() * way / hypot(*way)
    arrow = FancyArrowPatch(
        tuple(start), tuple(tip), color="#2778b5", arrowstyle="-|>", mutation_scale=14, linewidth=2, zorder=8
    )
    axes.add_patch(arrow)
    look.note(
        axes, start[0], start[1], f"wind {hypot(*velocity):.3g} m/s", "#2778b5", ha="left", va="top", dy=-5
    )
