"""Drawings of obstacles: the outlines of their projections, seen from above or from the side."""

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from taichi_plume.grid.shapes import Blocks, Shape
from taichi_plume.report import theme


def solid(axes: Axes, shape: Shape, plane: tuple[int, int]) -> Artist:
    """Draw the outline of an obstacle's projection on a plane; return the artist."""
    polygons = [Path([*corners, corners[0]], closed=True) for corners in shape.outline(plane)]
    joined = isinstance(shape, Blocks)  # no edges between blocks, and no gaps
    edge = {"edgecolor": theme.SOLID if joined else theme.SOLID_EDGE, "linewidth": 0.2 if joined else 0.9}
    patch = PathPatch(Path.make_compound_path(*polygons), facecolor=theme.SOLID, zorder=4, **edge)
    return axes.add_patch(patch)


def name(axes: Axes, shape: Shape) -> None:
    """Write the kind and size of an obstacle below the obstacle's drawing."""
    if shape.model is None:
        return
    values = vars(shape.model)
    if "radius" in values:
        text = f"{shape.model.kind} ⌀ {2 * values['radius']:.3g}"
    else:
        size = values.get("size", shape.high - shape.low)
        text = f"{shape.model.kind} {' × '.join(f'{edge:.3g}' for edge in size)}"
    height = values.get("height")
    text += (f", {height:.3g} high" if height is not None and len(shape.low) == 3 else "") + " m"
    if shape.model.motion is not None:
        text += ", walks"
    theme.note(
        axes, (shape.low[0] + shape.high[0]) / 2, shape.low[1], text, theme.SOLID_EDGE, va="top", dy=-3
    )
