"""Polygons cut into triangles: fans, and ear clipping where they are not convex."""

from collections.abc import Sequence

import numpy as np

MOST_CORNERS = 2000  # of a polygon that is not convex
MOST_WORK = 20_000_000  # corners looked at in all searches for ears of a file: some seconds
PER_TURN = 50  # as many corners as to see whether one sticks out


class DamagedError(Exception):
    """Fault of a mesh file, in words."""


def triangulated(vertices: np.ndarray, polygons: Sequence[Sequence[int]]) -> np.ndarray:
    """Triangles (m, 3) that make up plane polygons, lists of indices of the vertices (n, 3). Raises DamagedError."""
    triangles: list[tuple[int, int, int]] = []
    work = _Work()
    with np.errstate(over="ignore", invalid="ignore"):  # such coordinates are refused afterwards
        for corners in polygons:
            if len(corners) == 3:
                triangles.append((corners[0], corners[1], corners[2]))
            else:
                cut = _cut(vertices[list(corners)], work)
                triangles += [(corners[a], corners[b], corners[c]) for a, b, c in cut]
    return np.array(triangles, int).reshape(-1, 3)


class _Work:
    """Count of the corners that were looked at for a file."""

    def __init__(self) -> None:
        self.done = 0

    def add(self, corners: int) -> None:
        """Raises DamagedError where it becomes too much."""
        self.done += corners
        if self.done > MOST_WORK:
            raise DamagedError(
                "has too many faces of many corners that are not convex; cut them into triangles in a mesh editor"
            )


def _cut(places: np.ndarray, work: _Work) -> list[tuple[int, int, int]]:
    """Triangles of the polygon of these corners (n, 3): a fan where it is convex, else ear by ear."""
    fan = [(0, n, n + 1) for n in range(1, len(places) - 1)]
    after = np.roll(places, -1, axis=0)
    normal = np.cross(places, after).sum(axis=0)  # Newell's
    drop = int(np.abs(normal).argmax())
    flat = np.delete(places, drop, axis=1)
    if (normal[drop] < 0) != (drop == 1):  # seen from where it turns to the left
        flat = flat * [1, -1]
    turns = _turn(np.roll(flat, 1, axis=0), flat, np.roll(flat, -1, axis=0))
    if (turns >= 0).all() or len(places) > MOST_CORNERS or not np.isfinite(places).all():
        return fan
    return ears(flat, work, afresh=True)


def ears(outline: np.ndarray, work: _Work | None = None, afresh: bool = False) -> list[tuple[int, int, int]]:
    """Return triangles of a polygon (n, 2) that turns to the left, by clipping ears; a fan if it crosses itself.

    afresh: look for each ear from the first corner on, which takes longer: the triangles of mesh files, and with them
    the distances to their surface, depend on it.
    """
    left, found = list(range(len(outline))), []
    n = misses = 0
    while len(left) > 3:
        if misses == len(left):
            return [(0, k, k + 1) for k in range(1, len(outline) - 1)]
        n %= len(left)
        if _is_ear(outline, left, n, work):
            found.append((left[n - 1], left[n], left[(n + 1) % len(left)]))
            del left[n]
            misses, n = 0, 0 if afresh else n
        else:
            n, misses = n + 1, misses + 1
    return [*found, (left[0], left[1], left[2])]


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Above 0 where the way a, b, c (..., 2) turns to the left."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
        c[..., 0] - a[..., 0]
    )


def _is_ear(flat: np.ndarray, left: list[int], n: int, work: _Work | None) -> bool:
    """Whether the corner sticks out, and no other one lies in its triangle."""
    mine = (left[n - 1], left[n], left[(n + 1) % len(left)])
    a, b, c = (flat[k] for k in mine)
    sticks_out = bool(_turn(a, b, c) > 0)
    if work is not None:
        work.add(PER_TURN + sticks_out * len(left))
    if not sticks_out:
        return False
    others = flat[[k for k in left if k not in mine]]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    return not inside.any()
