"""Shortest ways over the floor, around what stands, for a body that is a disc.

Dijkstra's algorithm on a grid of places where the disc fits, from each to 32 others around it: in the open a way is at
most 1.4 % longer than the true one, which is asked for first and taken where nothing is in it.
"""

from collections import OrderedDict
from collections.abc import Callable
from hashlib import sha256
from typing import Any

import numpy as np

NODES = 128  # along the longer side of the floor
OFFSETS = tuple(
    (i, j) for i in range(4) for j in range(-3, 4) if np.gcd(i, j) == 1 and (i > 0 or j > 0)
)  # and their opposites
ALONG = (0.25, 0.5, 0.75)  # of a step, where the disc has to fit too
FAR = 3.0  # steps from a start to the places by which it joins the grid
MOST_KNOWN = 4  # floors whose ways are kept: run after run asks for those of the same
SLACK = 2e-3  # m, that a start may be nearer to what stands

_known: OrderedDict[bytes, np.ndarray] = OrderedDict()

Room = Callable[[np.ndarray], np.ndarray]


def shortest_ways(
    starts: np.ndarray,
    goals: np.ndarray,
    reach: float,
    radius: float,
    room: Room,
    low: tuple[float, float],
    high: tuple[float, float],
) -> np.ndarray:
    """The shortest way from each start (n, 2) to any of the goals (m, 2), (n,) [m]; NaN where there is none.

    room: of points (..., 2) on the floor from low to high, how far they are from what stands [m]: the disc of `radius`
    fits where that is as much. A goal need not be free: from within `reach` of it, the rest is straight.
    """
    if not len(goals):
        return np.full(len(starts), np.nan)
    step = max(high[0] - low[0], high[1] - low[1]) / NODES

    def free(points: np.ndarray) -> np.ndarray:
        return room(points) >= radius - SLACK

    apart = np.linalg.norm(starts[:, None] - goals, axis=-1)
    ways, nearest = apart.min(axis=1), goals[apart.argmin(axis=1)]
    barred = np.array(
        [not _straight(*ends, reach, step, free) for ends in zip(starts, nearest, strict=True)], bool
    )
    if barred.any():
        axes = [a + step * np.arange(int((b - a) / step) + 1) for a, b in zip(low, high, strict=True)]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        told = (room(places), goals, np.array([*low, *high, reach, radius]))
        key = sha256(b"".join(np.ascontiguousarray(one).tobytes() for one in told)).digest()
        ways[barred] = _around(starts[barred], goals, reach, step, free, places, key)
    return ways


def _straight(start: np.ndarray, goal: np.ndarray, reach: float, step: float, free: Room) -> bool:
    """Whether nothing is in the straight way."""
    length = float(np.linalg.norm(goal - start))
    if length <= reach:
        return True
    count = max(2, int(np.ceil((length - reach) / (0.5 * step))))
    along = np.linspace(0.0, 1.0 - reach / length, count)[:, None]
    return bool(free(start + along * (goal - start)).all())


def _around(
    starts: np.ndarray,
    goals: np.ndarray,
    reach: float,
    step: float,
    free: Room,
    places: np.ndarray,
    key: bytes,
) -> np.ndarray:
    """Ways of starts whose straight way is barred, by the nodes (nx, ny, 2); key: of the floor and its goals."""
    from scipy.sparse.csgraph import dijkstra

    ways = _known.get(key)
    if ways is None:
        graph: Any = _graph(places, step, free, goals, reach)
        ways = dijkstra(graph, indices=graph.shape[0] - 1)[:-1].reshape(places.shape[:2])
        if len(_known) >= MOST_KNOWN:
            _known.popitem(last=False)
        _known[key] = ways
    found = np.full(len(starts), np.inf)
    for n, start in enumerate(starts):
        apart = np.linalg.norm(places - start, axis=-1)
        near = (apart <= FAR * step) & np.isfinite(ways)
        lines = start + np.array(ALONG)[:, None, None] * (places[near] - start)
        open_ = free(lines).all(axis=0)
        found[n] = (ways[near] + apart[near])[open_].min(initial=np.inf)
    return np.where(np.isfinite(found), found, np.nan)


def _graph(places: np.ndarray, step: float, free: Room, goals: np.ndarray, reach: float):
    """Of the free places (nx, ny, 2), with their steps [m]; a last node is joined to those within reach of a goal."""
    from scipy.sparse import coo_array

    nx, ny = places.shape[:2]
    fits, number = free(places), np.arange(nx * ny).reshape(nx, ny)
    begins, ends, lengths = [], [], []
    for i, j in OFFSETS:
        a = np.s_[: nx - i, max(0, -j) : ny - max(0, j)]
        b = np.s_[i:, max(0, j) : ny - max(0, -j)]
        joined = fits[a] & fits[b]
        for share in ALONG if abs(i) + abs(j) > 1 else ():
            joined &= free(places[a] + share * step * np.array([i, j]))
        begins.append(number[a][joined])
        ends.append(number[b][joined])
        lengths.append(np.full(int(joined.sum()), step * np.hypot(i, j)))
    apart = np.linalg.norm(places[..., None, :] - goals, axis=-1).min(axis=-1)
    last = fits & (apart <= max(reach, step))
    begins.append(np.full(int(last.sum()), nx * ny))
    ends.append(number[last])
    lengths.append(np.maximum(apart[last], 1e-9))
    i, j, w = (np.concatenate(some) for some in (begins, ends, lengths))
    size = nx * ny + 1
    return coo_array(
        (np.concatenate([w, w]), (np.concatenate([i, j]), np.concatenate([j, i]))), (size, size)
    ).tocsr()
