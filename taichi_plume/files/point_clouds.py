"""Point clouds of scalar quantities, as in the topics of the live service and in bags: columns x, y, z and a value."""

from collections.abc import Sequence
from math import ceil, prod

import numpy as np

from taichi_plume.files import ros_messages as ros

MOST_POINTS = 20_000
LEAST = 0.1  # ppm


def topic(name: str) -> str:
    """Return the topic of a quantity's point clouds: plume/ethanol of "ethanol" or "ethanol_ppm"."""
    return f"plume/{ros.word(name.removesuffix('_ppm'))}"


def columns(
    values: np.ndarray,
    places: Sequence[np.ndarray],
    unit: str,
    level: float = 0.0,
    air: np.ndarray | None = None,
    most: int = MOST_POINTS,
    least: float = LEAST,
) -> dict[str, np.ndarray]:
    """Return the columns x, y, z [m] and the values of a point cloud, (n,); the last has the unit as name, or "value".

    values: (y, x) at a level [m], or (z, y, x); NaN without air. places: positions along these axes [m]. air: volume
    fractions of air. More than `most` cells are averaged over blocks of cells, which conserves the gas. Concentrations
    [ppm] below `least` give no point.
    """
    side = 1
    while prod(ceil(n / side) for n in values.shape) > most:
        side += 1
    share = np.isfinite(values) * (np.float32(1.0) if air is None else air)
    total = np.where(share > 0.0, values, np.float32(0.0)) * share
    middles = []
    for axis, place in enumerate(places):
        starts = np.arange(0, len(place), side)
        total, share = (np.add.reduceat(each, starts, axis) for each in (total, share))
        middles.append(np.add.reduceat(place, starts) / np.diff(np.append(starts, len(place))))
    mean = total / np.where(share > 0.0, share, np.nan)
    there = mean >= least if unit == "ppm" else np.isfinite(mean)
    z, y, x = np.meshgrid(*([[level]] if len(places) == 2 else []), *middles, indexing="ij")
    found = {axis: each.reshape(mean.shape)[there] for axis, each in (("x", x), ("y", y), ("z", z))}
    return {**found, unit if unit.isidentifier() else "value": mean[there]}
