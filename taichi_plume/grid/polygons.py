"""Polygons cut into triangles."""

from collections.abc import Sequence

import numpy as np

MOST_CORNERS = 2000  # of a polygon that is not convex


def triangulated(vertices: np.ndarray, polygons: Sequence[Sequence[int]]) -> np.ndarray:
    """Triangles (m, 3) that make up plane polygons, lists of indices of the vertices (n, 3)."""
    triangles: list[tuple[int, int, int]] = []
    for corners in polygons:
        if len(corners) == 3:
            triangles.append((corners[0], corners[1], corners[2]))
        else:
            triangles += [(corners[a], corners[b], corners[c]) for a, b, c in _cut(vertices[list(corners)])]
    return np.array(triangles, int).reshape(-1, 3)


def _cut(places: np.ndarray) -> list[tuple[int, int, int]]:
    """Triangles of the polygon of these corners (n, 3): a fan where it is convex, else ear by ear."""
    fan = [(0, n, n + 1) for n in range(1, len(places) - 1)]
    after = np.roll(places, -1, axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        normal = np.cross(places, after).sum(axis=0)  # Newell's
    drop = int(np.abs(normal).argmax())
    flat = np.delete(places, drop, axis=1)
    if (normal[drop] < 0) != (drop == 1):  # seen from where it turns to the left
        flat = flat * [1, -1]
    turns = _turn(np.roll(flat, 1, axis=0), flat, np.roll(flat, -1, axis=0))
    if (turns >= 0).all() or len(places) > MOST_CORNERS or not np.isfinite(places).all():
        return fan
    left, ears = list(range(len(places))), []
    while len(left) > 3:
        ear = next((n for n in range(len(left)) if _is_ear(flat, left, n)), None)
        if ear is None:  # it crosses itself
            return fan
        ears.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [*ears, (left[0], left[1], left[2])]


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Above 0 where the way a, b, c (..., 2) turns to the left."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
        c[..., 0] - a[..., 0]
    )


def _is_ear(flat: np.ndarray, left: list[int], n: int) -> bool:
    """Whether the corner sticks out, and no other one lies in its triangle."""
    mine = (left[n - 1], left[n], left[(n + 1) % len(left)])
    a, b, c = (flat[k] for k in mine)
    if not _turn(a, b, c) > 0:
        return False
    others = flat[[k for k in left if k not in mine]]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    return not inside.any()
