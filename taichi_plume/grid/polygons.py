"""Triangulation of polygons: fans of convex polygons, ear clipping of others."""

from collections.abc import Sequence

import numpy as np

MOST_CORNERS = 2000  # corners of a polygon that is not convex
MOST_WORK = 20_000_000  # corners examined for all ears of a file: takes some seconds
PER_TURN = 50  # corners that take as long as a test for a convex corner


class DamagedError(Exception):
    """Error that describes the damage of a mesh file in words."""


def triangulated(vertices: np.ndarray, polygons: Sequence[Sequence[int]]) -> np.ndarray:
    """Return triangles (m, 3) of plane polygons, each a list of indices of the vertices (n, 3). Raises DamagedError."""
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
    """Limit on the work of cutting a file's polygons into triangles: counts the corners examined."""

    def __init__(self) -> None:
        self.done = 0

    def add(self, corners: int) -> None:
        """Add a number of examined corners. Raises DamagedError above MOST_WORK."""
        self.done += corners
        if self.done > MOST_WORK:
            raise DamagedError(
                "has too many faces of many corners that are not convex; cut them into triangles in a mesh editor"
            )


def _cut(places: np.ndarray, work: _Work) -> list[tuple[int, int, int]]:
    """Return triangles of a polygon with these corners (n, 3): a fan if it is convex, otherwise by ear clipping."""
    fan = [(0, n, n + 1) for n in range(1, len(places) - 1)]
    after = np.roll(places, -1, axis=0)
    normal = np.cross(places, after).sum(axis=0)  # Newell's
    drop = int(np.abs(normal).argmax())
    flat = np.delete(places, drop, axis=1)
    if (normal[drop] < 0) != (drop == 1):  # make the polygon counter-clockwise
        flat = flat * [1, -1]
    turns = _turn(np.roll(flat, 1, axis=0), flat, np.roll(flat, -1, axis=0))
    if (turns >= 0).all() or len(places) > MOST_CORNERS or not np.isfinite(places).all():
        return fan
    return ears(flat, work, afresh=True)


def ears(outline: np.ndarray, work: _Work | None = None, afresh: bool = False) -> list[tuple[int, int, int]]:
    """Return triangles of a counter-clockwise polygon (n, 2), by ear clipping; a fan if the polygon crosses itself.

    afresh: search for each ear from the first corner on, which takes longer. The triangles of mesh files, and so the
    distances to their surface, depend on this choice.
    """
    left, triangles = list(range(len(outline))), []
    n = misses = 0
    while len(left) > 3:
        if misses == len(left):
            return [(0, k, k + 1) for k in range(1, len(outline) - 1)]
        n %= len(left)
        if _is_ear(outline, left, n, work):
            triangles.append((left[n - 1], left[n], left[(n + 1) % len(left)]))
            del left[n]
            misses, n = 0, 0 if afresh else n
        else:
            n, misses = n + 1, misses + 1
    return [*triangles, (left[0], left[1], left[2])]


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return a positive number if the path a, b, c (points (..., 2)) turns left, a negative one if it turns right."""
    (along_x, along_y), (to_x, to_y) = (b - a).T, (c - a).T
    return along_x * to_y - along_y * to_x


def _is_ear(flat: np.ndarray, left: list[int], n: int, work: _Work | None) -> bool:
    """Return whether corner n of the polygon `left` is convex and its triangle holds no other corner of the polygon."""
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
