"""What of a body the grid does not see: parts so thin that they lie between the nodes at which distances are taken.

`cut_cells` takes the distance to a surface as linear between nodes half a cell apart. A body is seen where that is
negative. It is asked here at random places of the body, for the shapes of a scenario, before anything is assembled.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from taichi_plume.grid.shapes import FINER, TIE, Shape

SAMPLES = 20_000  # places in the box around a body
LOOKED_AT = 500  # of those that are in the body
FEW = 10  # places in the body that tell little: more are tried once
MOST_MISSED = 0.4  # of a body: more counts as missed
MOST_LOST = 0.02  # of a body that no node near it sees: more is a part that is missed


@dataclass(frozen=True)
class Missed:
    """share: of a body's volume in the domain that the grid does not see; place: the middle of what is missed, (dim,)
    [m]; whole: whether more of it is missed than seen.
    """

    share: float
    place: np.ndarray
    whole: bool


def missed(shape: Shape, extent: tuple[float, ...], dx: float, samples: int = SAMPLES) -> Missed | None:
    """What of a shape is not seen in a domain of that extent [m] by cells of dx [m]; None where nothing to speak of."""
    low, high = np.maximum(shape.low, 0.0), np.minimum(shape.high, extent)
    if (high <= low).any():
        return None
    places, random = np.empty((0, len(low))), np.random.default_rng(0)
    for tries in (samples, 10 * samples):
        if len(places) < FEW:
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
    """As `cut_cells` takes it [m]."""
    distance = shape.signed_distance(points)
    return np.where(np.abs(distance) < TIE * dx, 0.0, distance)
