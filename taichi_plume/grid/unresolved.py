"""Check for thin parts of an obstacle, between the nodes of the signed distance, that the grid does not resolve.

`cut_cells` interpolates the distance to a surface linearly between nodes half a cell apart: a point is resolved if that
value is negative. The value is evaluated here at random points of a shape, before the assembly.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from taichi_plume.grid.shapes import FINER, TIE, Shape

SAMPLES = 20_000  # points in the box around a body
LOOKED_AT = 500  # number of points in the body that are evaluated
LEAST_POINTS = 10  # with fewer points in the body, more are tried once
MOST_MISSED = 0.4  # fraction of a body: more counts as missed
MOST_LOST = 0.02  # fraction of a body without a node inside near it: more is a missed part


@dataclass(frozen=True)
class Missed:
    """Part of an obstacle that the grid does not resolve. share: fraction of the obstacle's volume in the domain;
    place: centre of the part, (dim,) [m]; whole: whether the obstacle as a whole is missed.
    """

    share: float
    place: np.ndarray
    whole: bool


def missed(shape: Shape, extent: tuple[float, ...], dx: float, samples: int = SAMPLES) -> Missed | None:
    """Return the part of a shape that cells of dx [m] miss in a domain of this extent [m]; None if it is negligible."""
    low, high = np.maximum(shape.low, 0.0), np.minimum(shape.high, extent)
    if (high <= low).any():
        return None
    places, random = np.empty((0, len(low))), np.random.default_rng(0)
    for tries in (samples, 10 * samples):
        if len(places) < LEAST_POINTS:
            places = low + random.random((tries, len(low))) * (high - low)
            places = places[shape.inside(places)][:LOOKED_AT]
    if not len(places):
        return None
    step = dx / FINER
    last = np.round(np.array(extent) / step).astype(int)
    base = np.clip(np.floor(places / step).astype(int), 0, last - 1)
    weight = places / step - base
    value = np.zeros(len(places))
    for corner in product((0, 1), repeat=len(low)):
        near = np.where(corner, weight, 1.0 - weight).prod(axis=1)
        value += near * _distance(shape, (base + corner) * step, dx)
    unseen = value > 0.0
    lost = np.flatnonzero(unseen)
    for offset in product(range(-1, 3), repeat=len(low)):
        nodes = np.clip(base[lost] + offset, 0, last) * step
        lost = lost[_distance(shape, nodes, dx) > 0.0]
        if not len(lost):
            break
    if unseen.mean() > MOST_MISSED:
        return Missed(float(unseen.mean()), places[unseen].mean(axis=0), True)
    if len(lost) > MOST_LOST * len(places):
        return Missed(len(lost) / len(places), places[lost[0]], False)
    return None


def _distance(shape: Shape, points: np.ndarray, dx: float) -> np.ndarray:
    """Return the signed distance [m] of points from the surface of a shape, as `cut_cells` takes it."""
    distance = shape.signed_distance(points)
    return np.where(np.abs(distance) < TIE * dx, 0.0, distance)
