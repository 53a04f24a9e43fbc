"""Figure of a gas map of recorded readings: estimate, weight and standard deviation, seen from above."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from taichi_plume.report import theme

if TYPE_CHECKING:
    from taichi_plume.results.recorded_maps import GasMap

MOST_OBLONG = 4.0  # of a picture


def figure(gas_map: "GasMap") -> Figure:
    """Return a figure of a gas map and of the positions of its readings."""
    weight = gas_map.weight
    pictures = {
        "estimate [ppm]": gas_map.estimate,
        "weight, as power of ten": np.log10(np.where(weight > 0, weight, np.nan)),
    }
    if gas_map.variance is not None:
        pictures["standard deviation [ppm]"] = np.sqrt(gas_map.variance)
    size = gas_map.size
    oblong = min(max(size[1] / size[0], 1 / MOST_OBLONG), MOST_OBLONG)
    aspect = "equal" if oblong == size[1] / size[0] else "auto"
    with theme.styled():
        made = theme.figure(5.2 * len(pictures), 1.2 + 4.4 * oblong)
        made.set_layout_engine("constrained")
        axes = made.subplots(1, len(pictures), squeeze=False)[0]
        nx, ny = gas_map.estimate.shape
        extent = (0, nx * gas_map.cell, 0, ny * gas_map.cell)
        for axis, (title, values) in zip(axes, pictures.items(), strict=True):
            picture = axis.imshow(values.T, origin="lower", extent=extent, aspect=aspect)
            made.colorbar(picture, ax=axis, shrink=0.8)
            axis.plot(*gas_map.readings.place.T, ".", color="white", markersize=1, alpha=0.4)
            axis.set(xlim=(0, size[0]), ylim=(0, size[1]), xlabel="x [m]", ylabel="y [m]", title=title)
    return made
