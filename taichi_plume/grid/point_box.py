"""Extent of a flow that is known at points: nodes, which lie on its boundary, or centres of cells, half a cell inside.

Where a table does not say which of both its points are, their positions do: nodes start at 0 or at whole multiples of
their spacing, centres of cells at half of it; and nodes span the simulated domain, centres a spacing less.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from taichi_plume.grid.interpolation import SAME, Interpolation

Stand = Literal["nodes", "centres"]
NEAR, NEAR_SCATTERED = 0.01, 0.2  # spacings: tolerance of positions, on a lattice and off it
SPARSEST = 8.0  # positions of a lattice per point, above which points are scattered
BOUNDARY = 0.2  # share of the points that a face of scattered nodes would have at equal spacing


@dataclass(frozen=True)
class PointBox:
    """Box of a flow at points. low, high: corners [m]; slack: their uncertainty [m]; stand: meaning of the points.

    is_known: whether the points' meaning is stated or follows from their positions; otherwise it is assumed.
    """

    low: np.ndarray
    high: np.ndarray
    slack: float
    stand: Stand
    is_known: bool


def box_of(points: Interpolation, extent: Sequence[float], stated: Stand | None = None) -> PointBox:
    """Return the box of a flow. extent: edges of the simulated domain [m]; stated: meaning of the points, if known."""
    place, used = points.positions, points.used
    low, high = place.min(axis=0), place.max(axis=0)
    axes = points.lattice or _lattice_with_holes(place[:, used])
    if axes is None:
        ends, near = np.full((len(used), 2), np.median(points.apart)), NEAR_SCATTERED
    else:
        ends, near = np.array([(axis[1] - axis[0], axis[-1] - axis[-2]) for axis in axes]), NEAR
    votes: set[Stand] = {"nodes"} if axes is None and _has_boundary(place[:, used]) else set()
    votes = votes or _anchors(low[used], ends, near) or _of_domain(low, high, ends, used, extent, near)
    votes = votes or _multiples(low[used], ends)
    stand: Stand = stated or ("nodes" if votes == {"nodes"} else "centres")
    slack = 0.0 if points.lattice is not None else float(points.apart.max()) / 2
    if stand == "centres":
        low[used] -= ends[:, 0] / 2
        high[used] += ends[:, 1] / 2
    return PointBox(low, high, slack, stand, bool(stated) or len(votes) == 1)


def _lattice_with_holes(place: np.ndarray) -> list[np.ndarray] | None:
    """Return the axes of the lattice on which points lie without filling it; None if they are scattered."""
    tie = SAME * float(np.ptp(place, axis=0).max())
    axes = [np.sort(x) for x in place.T]
    axes = [x[np.concatenate([[True], np.diff(x) > tie])] for x in axes]
    number = np.prod([float(len(axis)) for axis in axes])
    return axes if number <= SPARSEST * len(place) else None


def _named(nodes: np.ndarray, centres: np.ndarray) -> set[Stand]:
    """Return what the axes say, from masks of the axes that look like nodes and like centres."""
    kinds: dict[Stand, bool] = {"nodes": bool(nodes.any()), "centres": bool(centres.any())}
    return {kind for kind, evidence in kinds.items() if evidence}


def _anchors(low: np.ndarray, ends: np.ndarray, near: float) -> set[Stand]:
    """Return the meaning of points that start at 0 or at half a spacing; nothing if axes contradict each other."""
    first = low / ends[:, 0]
    evidence = _named(np.abs(first) < near, np.abs(first - 0.5) < near)
    return evidence if len(evidence) == 1 else set()


def _of_domain(
    low: np.ndarray,
    high: np.ndarray,
    ends: np.ndarray,
    used: np.ndarray,
    extent: Sequence[float],
    near: float,
) -> set[Stand]:
    """Return the meaning with which the points fill the domain; nothing if none or both do."""
    axes = [n for n, a in enumerate(used) if a < len(extent)]
    longer = np.array([extent[used[n]] - (high - low)[used[n]] for n in axes])
    spacing = ends[axes].mean(axis=1)
    evidence = _named(np.abs(longer) < near * spacing, np.abs(longer - spacing) < near * spacing)
    return evidence if len(evidence) == 1 else set()


def _multiples(low: np.ndarray, ends: np.ndarray) -> set[Stand]:
    """Return the meaning of points that start at whole multiples of their spacing, or half a spacing beside these."""
    rest = np.mod(low / ends[:, 0], 1.0)
    return _named(np.minimum(rest, 1.0 - rest) < NEAR, np.abs(rest - 0.5) < NEAR)


def _has_boundary(place: np.ndarray) -> bool:
    """Return whether scattered points have many on each face of their box, as the nodes of a mesh do."""
    least = max(3.0, BOUNDARY * len(place) ** (1.0 - 1.0 / place.shape[1]))
    tie = SAME * np.ptp(place, axis=0).max()
    faces = [np.abs(place - end) <= tie for end in (place.min(axis=0), place.max(axis=0))]
    return all((face.sum(axis=0) >= least).all() for face in faces)
