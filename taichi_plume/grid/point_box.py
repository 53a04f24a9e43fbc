"""Extent of a flow that is known at points: nodes, which lie on its boundary, or centres of cells, half a cell inside.

Where a table does not say which of both its points are, their positions do: nodes span the simulated domain, centres of
cells a spacing less; nodes start at 0, centres at half their spacing. Scattered nodes have many on each face of their
box. If these contradict each other, or nothing says it, the meaning is assumed: nodes at whole multiples of their
spacing, otherwise centres.
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
    evidence: list[Stand] = []
    if axes is None and _has_boundary(place[:, used]):
        evidence.append("nodes")
    strong: tuple[Stand | None, ...] = (
        _of_domain(low, high, ends, used, extent, near),
        _anchors(low[used], ends, near),
    )
    evidence.extend(kind for kind in strong if kind)
    weak = _multiples(low[used], ends)
    stand: Stand = stated or (evidence[0] if evidence else weak or "centres")
    contrary = (
        stand == "centres" and _looks(low[used], ends)[0].any()
    )  # such as a slice that starts at half a spacing
    is_known = stated is not None or (set(evidence) == {stand} and not contrary)
    slack = 0.0 if points.lattice is not None else float(points.apart.max()) / 2
    if stand == "centres":
        low[used] -= ends[:, 0] / 2
        high[used] += ends[:, 1] / 2
    return PointBox(low, high, slack, stand, is_known)


def _lattice_with_holes(place: np.ndarray) -> list[np.ndarray] | None:
    """Return the axes of the lattice on which points lie without filling it; None if they are scattered."""
    tie = SAME * float(np.ptp(place, axis=0).max())
    axes = [np.sort(x) for x in place.T]
    axes = [x[np.concatenate([[True], np.diff(x) > tie])] for x in axes]
    number = np.prod([float(len(axis)) for axis in axes])
    return axes if number <= SPARSEST * len(place) else None


def _agreed(nodes: np.ndarray, centres: np.ndarray, of_all: bool) -> Stand | None:
    """Return what the axes say, from masks of those that look like nodes and like centres; None if they contradict.

    of_all: whether every axis has to say it.
    """
    if (nodes.all() if of_all else nodes.any()) and not centres.any():
        return "nodes"
    return "centres" if (centres.all() if of_all else centres.any()) and not nodes.any() else None


def _anchors(low: np.ndarray, ends: np.ndarray, near: float) -> Stand | None:
    """Return the meaning of points that start at 0 or at half a spacing; None if no axis does, or axes contradict."""
    first = low / ends[:, 0]
    return _agreed(np.abs(first) < near, np.abs(first - 0.5) < near, of_all=False)


def _of_domain(
    low: np.ndarray,
    high: np.ndarray,
    ends: np.ndarray,
    used: np.ndarray,
    extent: Sequence[float],
    near: float,
) -> Stand | None:
    """Return the meaning with which the points fill the domain along all axes; None if none does."""
    axes = [n for n, a in enumerate(used) if a < len(extent)]
    longer = np.array([extent[used[n]] - (high - low)[used[n]] for n in axes])
    spacing = ends[axes].mean(axis=1)
    return _agreed(np.abs(longer) < near * spacing, np.abs(longer - spacing) < near * spacing, of_all=True)


def _multiples(low: np.ndarray, ends: np.ndarray) -> Stand | None:
    """Return the likely meaning of points that start at whole multiples of their spacing, or half a spacing beside."""
    return _agreed(*_looks(low, ends), of_all=True)


def _looks(low: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return masks of the axes that start at whole multiples of their spacing, and at half a spacing beside."""
    rest = np.mod(low / ends[:, 0], 1.0)
    return np.minimum(rest, 1.0 - rest) < NEAR, np.abs(rest - 0.5) < NEAR


def _has_boundary(place: np.ndarray) -> bool:
    """Return whether scattered points have many on each face of their box, as the nodes of a mesh do."""
    least = max(3.0, BOUNDARY * len(place) ** (1.0 - 1.0 / place.shape[1]))
    tie = SAME * np.ptp(place, axis=0).max()
    faces = [np.abs(place - end) <= tie for end in (place.min(axis=0), place.max(axis=0))]
    return all((face.sum(axis=0) >= least).all() for face in faces)
