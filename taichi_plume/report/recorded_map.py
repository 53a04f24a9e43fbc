"""Figure of a gas map of recorded readings: estimate, weight and standard deviation, seen from above."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from taichi_plume.report import theme

if TYPE_CHECKING:
    from taichi_plume.results.recorded_maps import GasMap

MOST_OBLONG = 4.0  # of a picture


def figure(gas_map: "GasMap", place: theme.Place) -> Figure:
    """Return a figure of a gas map and of the positions of its readings.

    place: axes for the estimate alone, or size of the figure.
    """
    weight = gas_map.weight
    pictures = {
        "estimate [ppm]": gas_map.estimate,
        "weight, as power of ten": np.log10(np.where(weight > 0, weight, np.nan)),
    }
    if gas_map.variance is not None:
        pictures["standard deviation [ppm]"] = np.sqrt(gas_map.variance)
    if place.ax is not None:
        title = next(iter(pictures))
        _draw(place.ax, gas_map, title, pictures[title])
        return theme.figure_around(place.ax)
    tall = 1.2 + 4.4 * _oblong(gas_map)
    with theme.styled():
        made = theme.figure(*(place.figsize or (5.2 * len(pictures), tall)))
        made.set_layout_engine("constrained")
        axes = made.subplots(1, len(pictures), squeeze=False)[0]
        for axis, (title, values) in zip(axes, pictures.items(), strict=True):
            _draw(axis, gas_map, title, values)
    return made


def _draw(axis: Axes, gas_map: "GasMap", title: str, values: np.ndarray) -> None:
    """Draw a quantity of a gas map with its colour bar, and the positions of the readings."""
    nx, ny = gas_map.estimate.shape
    size, extent = gas_map.size, (0, nx * gas_map.cell, 0, ny * gas_map.cell)
    aspect = "equal" if _oblong(gas_map) == size[1] / size[0] else "auto"
    picture = axis.imshow(values.T, origin="lower", extent=extent, aspect=aspect)
    theme.figure_around(axis).colorbar(picture, ax=axis, shrink=0.8)
    axis.plot(*gas_map.readings.place.T, ".", color="white", markersize=1, alpha=0.4)
    axis.set(xlim=(0, size[0]), ylim=(0, size[1]), xlabel="x [m]", ylabel="y [m]", title=title)


def _oblong(gas_map: "GasMap") -> float:
    """Return height over width of the map, within the limits of a picture."""
    return min(max(gas_map.size[1] / gas_map.size[0], 1 / MOST_OBLONG), MOST_OBLONG)
