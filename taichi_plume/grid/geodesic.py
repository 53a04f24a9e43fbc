"""Shortest paths (geodesic distances) over the floor, around obstacles, for a disc.

Dijkstra's algorithm on a grid of positions where the disc fits, each linked to 32 positions around it: in the open a
path is at most 1.4 % longer than the shortest path. A straight path is tried first and used if free.
"""

from collections import OrderedDict
from collections.abc import Callable
from hashlib import sha256

import numpy as np

NODES = 128  # positions along the longer side of the floor
OFFSETS = [(i, j) for i in range(4) for j in range(-3, 4) if np.gcd(i, j) == 1 and (i > 0 or j > 0)]
"""Steps (i, j) to half of the 32 linked positions; the other steps are opposite."""
ALONG = (0.25, 0.5, 0.75)  # fractions of a step at which the disc has to fit too
FAR = 3.0  # steps from a start to the positions by which it joins the grid
MOST_KNOWN = 4  # floors whose distances are cached for the next runs
SLACK = 2e-3  # m by which a start may be closer to an obstacle

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
    """Return the length of the shortest path from each start (n, 2) to any goal (m, 2), (n,) [m]; NaN without a path.

    room: function from points (..., 2) on the floor from low to high to the distance [m] to the next obstacle. The disc
    of `radius` fits if the distance is as large. Within `reach` of a goal the path is straight: goals need not be free.
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
        floor = (room(places), goals, np.array([*low, *high, reach, radius]))
        key = sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in floor)).digest()
        ways[barred] = _around(starts[barred], goals, reach, step, free, places, key)
    return ways


def _straight(start: np.ndarray, goal: np.ndarray, reach: float, step: float, free: Room) -> bool:
    """Return whether the disc fits along the straight path from start to within `reach` [m] of the goal."""
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
    """Return path lengths (n,) [m] around obstacles, NaN if none; places: nodes (nx, ny, 2); key: of the floor."""
    from scipy.sparse.csgraph import dijkstra

    ways = _known.get(key)
    if ways is None:
        graph = _graph(places, step, free, goals, reach)
        ways = dijkstra(graph, indices=len(places.reshape(-1, 2)))[:-1].reshape(places.shape[:2])
        if len(_known) >= MOST_KNOWN:
            _known.popitem(last=False)
        _known[key] = ways
    lengths = np.full(len(starts), np.inf)
    for n, start in enumerate(starts):
        apart = np.linalg.norm(places - start, axis=-1)
        near = (apart <= FAR * step) & np.isfinite(ways)
        lines = start + np.array(ALONG)[:, None, None] * (places[near] - start)
        open_ = free(lines).all(axis=0)
        lengths[n] = (ways[near] + apart[near])[open_].min(initial=np.inf)
    return np.where(np.isfinite(lengths), lengths, np.nan)


def _graph(places: np.ndarray, step: float, free: Room, goals: np.ndarray, reach: float):
    """Return the sparse graph of distances [m] between free nodes `places` (nx, ny, 2); its last node is all goals."""
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
    i, j, w = np.concatenate(begins + ends), np.concatenate(ends + begins), np.concatenate(lengths + lengths)
    return coo_array((w, (i, j)), (nx * ny + 1, nx * ny + 1)).tocsr()
