"""Inside of a surface with holes by the generalised winding number: a point is inside where |w| > 1/2.

Jacobson, Kavan & Sorkine-Hornung 2013, doi:10.1145/2461912.2461916: w is the solid angle of the surface seen from the
point, over 4 pi. It is whole for a closed surface, and smooth across a hole, where it passes 1/2. A surface M and caps
C over its holes are closed together, so w(M) = w(M and C) - w(C). The first is a whole number, to which a sum over
a tree of clusters is rounded; distant clusters count as dipoles (Barill et al. 2018, doi:10.1145/3197517.3201337). The
second is a sum over the few triangles of the caps. A flat hole is thus closed flat.
"""

from dataclasses import dataclass, field
from math import pi

import numpy as np

FLAT = 0.9999  # of the area of a hole's caps: so much has one normal if the hole is flat
STAR = 0.8  # of the same area: so much lies within the rim, and not beside it
MOST_PAIRS = 1 << 22  # points times triangles computed together
LEVEL = 2e-7  # of the largest coordinate: a point closer to a triangle's plane lies in it
LEAF = 32  # triangles that are not divided into clusters
DISTANT = 2.0  # radii of a cluster: farther away it is a dipole


@dataclass(frozen=True)
class Caps:
    """Triangles (k, 3, 3) that close the holes of a surface, and the area of the holes, seen along their normals.

    flat: mask of the triangles in flat holes, which are the surface that the winding number gives there.
    """

    corners: np.ndarray
    area: float
    flat: np.ndarray


def caps_of(vertices: np.ndarray, triangles: np.ndarray) -> Caps:
    """Return the caps over the holes of a surface: triangles from the middle of each rim to its edges.

    vertices (n, 3), triangles (m, 3). An edge belongs to a rim as often as triangles on both of its sides run along it
    in unlike numbers. A hole's area is the length of its vector area: of a crack between two equal rims it is 0.
    """
    edges = rim_edges(triangles)
    if not len(edges):
        return Caps(np.empty((0, 3, 3)), 0.0, np.empty(0, bool))
    used, index = np.unique(edges, return_inverse=True)
    index = index.reshape(-1, 2)
    hole = _connected(index.T, len(used))
    count = hole.max() + 1
    middle = np.stack([np.bincount(hole, x, count) for x in vertices[used].T], axis=-1)
    middle /= np.bincount(hole)[:, None]
    of = hole[index[:, 0]]
    corners = np.stack([vertices[edges[:, 1]], vertices[edges[:, 0]], middle[of]], axis=1)
    normal = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.stack([np.bincount(of, x, count) for x in normal.T], axis=-1)
    seen = np.linalg.norm(total, axis=1)
    along = np.abs(np.einsum("kd,kd->k", normal, (total / np.maximum(seen, 1e-300)[:, None])[of]))
    whole, level = (np.bincount(of, x, count) for x in (np.linalg.norm(normal, axis=1), along))
    return Caps(corners, float(seen.sum()), ((level > FLAT * whole) & (seen > STAR * whole))[of])


def rim_edges(triangles: np.ndarray) -> np.ndarray:
    """Return the directed edges (k, 2) of the rims of holes, each as often as triangles lack on its other side."""
    ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = ends.min(axis=1), ends.max(axis=1)
    pairs, index = np.unique(np.stack([low, high], axis=1), axis=0, return_inverse=True)
    surplus = np.bincount(index.ravel(), np.where(ends[:, 0] == low, 1, -1), len(pairs)).astype(int)
    forward = np.where(surplus[:, None] > 0, pairs, pairs[:, ::-1])
    return np.repeat(forward, np.abs(surplus), axis=0)


def solid_angles(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the solid angle (n,) of all triangles (k, 3, 3) together, seen from points (n, 3), over 4 pi.

    van Oosterom & Strackee 1983, doi:10.1109/TBME.1983.325207, with scalar products from the lengths of the sides. In
    the plane of a triangle it is 0, the mean of both sides: two walls that touch are one.
    """
    result = np.zeros(len(points))
    if not len(corners):
        return result
    places, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    n1, n2, n3 = index.reshape(-1, 3).T
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    level = np.einsum("kd,kd->k", normal, corners[:, 0])
    least = LEVEL * np.abs(places).max() * np.linalg.norm(normal, axis=1)
    side_12, side_23, side_31 = (((corners[:, n] - corners[:, n - 2]) ** 2).sum(axis=1) for n in range(3))
    step = max(1, MOST_PAIRS // len(corners))
    for begin in range(0, len(points), step):
        part = points[begin : begin + step].astype(float)
        squared = sum((part[:, d, None] - places[:, d]) ** 2 for d in range(3))
        length = np.sqrt(squared)
        a, b, c = length[:, n1], length[:, n2], length[:, n3]
        aa, bb, cc = squared[:, n1], squared[:, n2], squared[:, n3]
        below = a * b * c + 0.5 * (
            (aa + bb - side_12) * c + (bb + cc - side_23) * a + (cc + aa - side_31) * b
        )
        above = level - part @ normal.T
        angle = np.where(np.abs(above) > least, np.arctan2(above, below), 0.0)
        result[begin : begin + step] = angle.sum(axis=1)
    return result / (2.0 * pi)


@dataclass(frozen=True)
class Cluster:
    """Tree of triangles (k, 3, 3) that lie together: their middle, radius and vector area (3,), and two halves."""

    corners: np.ndarray
    middle: np.ndarray
    radius: float
    area: np.ndarray
    halves: "list[Cluster]" = field(default_factory=list)

    @classmethod
    def of(cls, corners: np.ndarray) -> "Cluster":
        """Return the tree of these triangles, halved along the longest edge of their box."""
        middles = corners.mean(axis=1)
        areas = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        middle = np.average(middles, axis=0, weights=np.linalg.norm(areas, axis=1) + 1e-300)
        halves = []
        if len(corners) > LEAF:
            order = np.argsort(middles[:, np.ptp(middles, axis=0).argmax()], kind="stable")
            halves = [cls.of(corners[half]) for half in np.array_split(order, 2)]
        radius = float(np.linalg.norm(corners - middle, axis=-1).max())
        return cls(corners, middle, radius, areas.sum(axis=0), halves)

    def winding_number(self, points: np.ndarray) -> np.ndarray:
        """Return about the winding number (n,) at points (n, 3): distant clusters are dipoles."""
        if not self.halves:
            return solid_angles(points, self.corners)
        way = self.middle - points
        squared = np.maximum((way**2).sum(axis=1), 1e-300)
        result = way @ self.area / (4.0 * pi * squared**1.5)
        near = squared <= (DISTANT * self.radius) ** 2
        if near.any():
            result[near] = sum(half.winding_number(points[near]) for half in self.halves)
        return result


def section(corners: np.ndarray, z: float) -> np.ndarray:
    """Return the edges (k, 2, 2), in plan, in which the plane at height z cuts triangles (m, 3, 3).

    Each has its triangle's front on the right: the outline of a body whose triangles face outwards runs to the left.
    """
    ends, above = np.roll(corners, -1, axis=1), corners[..., 2] >= z
    leaves = np.roll(above, -1, axis=1)
    points = []
    for crosses in (above & ~leaves, ~above & leaves):
        first, last = corners[crosses], ends[crosses]
        points.append(first + ((z - first[:, 2]) / (last[:, 2] - first[:, 2]))[:, None] * (last - first))
    return np.stack(points, axis=1)[..., :2]


def turns(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the winding number (n,) of directed edges (k, 2, 2) about points (n, 2) in their plane."""
    result = np.zeros(len(points))
    step = max(1, MOST_PAIRS // max(1, len(edges)))
    for begin in range(0, len(points), step):
        part = points[begin : begin + step, None].astype(float)
        (x1, y1), (x2, y2) = (np.moveaxis(edges[:, n] - part, -1, 0) for n in (0, 1))
        result[begin : begin + step] = np.arctan2(x1 * y2 - y1 * x2, x1 * x2 + y1 * y2).sum(axis=1)
    return result / (2.0 * pi)


def oriented(triangles: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, int]:
    """Return triangles (m, 3) of which neighbours face the same way, and how many of them were turned.

    Neighbours share an edge that no third triangle has. Of each patch of neighbours, the side is kept that more of its
    area (m,) faces; a patch with only one side, as of a Moebius strip, stays as it is.
    """
    count = len(triangles)
    ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pairs, edge = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    order = np.argsort(edge.ravel(), kind="stable")
    first = np.searchsorted(edge.ravel()[order], np.arange(len(pairs)))
    shared = first[np.bincount(edge.ravel(), minlength=len(pairs)) == 2]
    here, there = order[shared], order[shared + 1]
    # nodes of the graph: triangle t as it is has the number t, turned t + count
    unlike = (ends[here, 0] == ends[there, 0]) * count
    here, there = here // 3, there // 3
    firsts, seconds = [here, here + count], [there + unlike, there + count - unlike]
    patch = _connected(np.stack([np.concatenate(firsts), np.concatenate(seconds)]), 2 * count)
    faces = np.bincount(patch[:count], area, patch.max() + 1)
    as_is, turned = faces[patch[:count]], faces[patch[count:]]
    flip = (turned > as_is) | ((turned == as_is) & (patch[count:] < patch[:count]))
    return np.where(flip[:, None], triangles[:, ::-1], triangles), int(flip.sum())


def _connected(links: np.ndarray, count: int) -> np.ndarray:
    """Return the number of the connected part of each of `count` nodes, with links (2, n) between them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(links.shape[1], bool), tuple(links)), shape=(count, count))
    return connected_components(graph, directed=False)[1]
