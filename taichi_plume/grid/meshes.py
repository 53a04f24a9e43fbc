"""Obstacles from bodies in mesh files (STL, OBJ, PLY): signed distance, inside test and shadow, by open3d.

Bodies that are not watertight have the inside of the generalised winding number, see `winding_number`.
"""

import ctypes
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from math import inf
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np

from taichi_plume.grid.mesh_files import MeshData, MeshError, read_mesh
from taichi_plume.grid.outlines import Mesh, contours, faceted, silhouette
from taichi_plume.grid.shapes import Shape, rotation
from taichi_plume.grid.winding_number import (
    Cluster,
    caps_of,
    oriented,
    rim_edges,
    section,
    solid_angles,
    turns,
)

LONGEST_REASON = 150  # characters of the reason why open3d cannot be imported
CHUNK = 1 << 18  # points handed to open3d at a time
FLAT = 1e-9  # fraction of a body's length: in single precision a thinner body has no inside
MOST_BODIES = (
    800  # bodies in all meshes: open3d ends the process near 1000 scenes (thread-local keys of the system)
)
MOST_AT_EDGE = 100  # triangles that share an edge: more make no body, and open3d compares each with each
WELD = 1e-5  # of the mesh's length: in a mesh with gaps, corners closer than this are joined
SAMPLES = 1 << 15  # points, to judge a body that is not closed
CACHED = 64  # outlines
SECTION_NODES = 200  # per axis, to find the outline of a section
MOST_TESTED = 50  # corners of a body that are looked for in another
MOST_RIM = 2000  # open edges: from each point of the grid, a triangle at each is seen
MOST_OPEN, MOST_UNDECIDED = 0.12, 0.1  # of its surface (a triangle of a cube has 0.09), and of its volume
Y_UP = np.array(
    [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
)  # (x, y, z) of a y-up model to (x, -z, y)
Query = Callable[[np.ndarray], np.ndarray]
SKIN = 1e-5  # m: offset of a section from the given height, so that it does not run within a level face


class _Body:
    """Closed body: corners (m, 3, 3) of its triangles, and an open3d scene. Points are (n, 3) in single precision."""

    def __init__(self, corners: np.ndarray):
        self.corners, self.scene = corners, _scene(corners)

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        return self.scene.compute_signed_distance(_open3d().core.Tensor(points)).numpy()

    def occupancy(self, points: np.ndarray) -> np.ndarray:
        """Return 1 for points inside and 0 for the others, (n,)."""
        return self.scene.compute_occupancy(_open3d().core.Tensor(points)).numpy()


class _OpenBody(_Body):
    """Bodies with holes, or with edges of more than two triangles, whose inside is that of the winding number.

    Caps over flat holes belong to the surface.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray):
        used = vertices[triangles]
        self.area = _areas(vertices, triangles).sum()
        self.low, self.high = used.min(axis=(0, 1)), used.max(axis=(0, 1))
        self.caps = caps_of(vertices, triangles)
        super().__init__(np.concatenate([used, self.caps.corners[self.caps.flat]]))
        self._closed = Cluster.of(np.concatenate([used, self.caps.corners]))

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        away = self.scene.compute_distance(_open3d().core.Tensor(points)).numpy()
        return np.where(self.occupancy(points) > 0.5, -away, away)

    def occupancy(self, points: np.ndarray) -> np.ndarray:
        return np.where(np.abs(self.winding_number(points)) > 0.5, 1.0, 0.0)

    def winding_number(self, points: np.ndarray) -> np.ndarray:
        """Return the winding number at points; 0 outside the box around the body."""
        result = np.zeros(len(points))
        near = ((points >= self.low) & (points <= self.high)).all(axis=1)
        if near.any():
            whole = np.rint(self._closed.winding_number(points[near].astype(float)))
            result[near] = whole - solid_angles(points[near], self.caps.corners)
        return result

    def undecided(self) -> float:
        """Return the volume in the box where |w| is within 0.2 of 1/2, over the inside; infinite without one."""
        points = np.random.default_rng(0).uniform(self.low, self.high, (SAMPLES, 3)).astype(np.float32)
        number = np.abs(self.winding_number(points))
        inside = np.count_nonzero(number > 0.5)
        return np.count_nonzero(np.abs(number - 0.5) < 0.2) / inside if inside else inf


class _Outline(_Body):
    """Section of bodies with holes, if closed: at its height, the inside of the plane winding number of its edges."""

    def __init__(self, corners: np.ndarray, z: float):
        super().__init__(corners)
        self.edges = section(corners, z)

    def is_closed(self) -> bool:
        """Return whether as many edges start as end at each point; no edges are not closed."""
        if not len(self.edges):
            return False
        size = WELD * max(float(np.ptp(self.edges.reshape(-1, 2), axis=0).max()), 1e-300)
        ends = np.rint(self.edges.reshape(-1, 2) / size)
        _, place = np.unique(ends, axis=0, return_inverse=True)
        return not np.bincount(place.ravel(), np.tile([1, -1], len(self.edges))).any()

    def occupancy(self, points: np.ndarray) -> np.ndarray:
        return np.where(np.abs(turns(points[:, :2], self.edges)) > 0.5, 1.0, 0.0)


class Solid(Shape):
    """Union of the bodies of a mesh file: scaled, then turned about the vertical, then moved.

    vertices: (n, 3) [m] and triangles: (m, 3) indices, as placed in the domain. In 2-D the shape is the section of the
    bodies at one height, with distances in the plane. text, remarks: what was read and assumed of the file. unit: of a
    comment in the file, its metres and its name, or None.
    """

    def __init__(self, model: Any, dim: int, folder: Path):
        self.model = model
        data = read_mesh(folder / model.file)
        parts = _parts_of(folder / model.file, data)
        self.unit, self.triangles = data.unit, parts.triangles
        self.vertices = model.scale * (parts.vertices @ Y_UP.T if model.up == "y" else parts.vertices)
        self.vertices[:, :2] = self.vertices[:, :2] @ rotation(model.yaw_deg).T
        self.vertices += np.array(model.translate)
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        self.low, self.high = low[:dim], high[:dim]
        self._slice = (model.section + SKIN, model.section + SKIN)
        if dim == 2 and not low[2] < self._slice[0] < high[2]:
            (_, _, least), (_, _, most) = self.turned_up()
            other = {"y": "z", "z": "y"}[model.up]
            cuts = bool(least < self._slice[0] < most)
            turned = f", or up: {other}, if {other} is the upward axis of the file" if cuts else ""
            raise MeshError(
                f"{model.file}: section {model.section:g} m does not cut it, it lies at z {low[2]:.4g} to "
                f"{high[2]:.4g} m; give a section in between{turned}"
            )
        # A scene per body: if bodies of one scene overlap, the ray count that decides on inside is wrong.
        count = len(parts.bodies) + (parts.open is not None)
        if len(_scenes) + count > MOST_BODIES:
            raise MeshError(
                f"{model.file}: has {count} bodies, with which all meshes have more than {MOST_BODIES}; "
                "join bodies in a mesh editor, or leave small ones out"
            )
        self._bodies = [_Body(self.vertices[triangles]) for triangles in parts.bodies]
        remarks = [*data.remarks, *parts.remarks, *self._scale_remarks()]
        if parts.open is not None:
            loose = _Outline(self.vertices[parts.open], self._slice[0]) if dim == 2 else None
            if loose is not None and loose.is_closed():
                remarks.append(f"{parts.gaps}; its section at {model.section:g} m is closed")
            else:
                loose = _OpenBody(self.vertices, parts.open)
                remarks.append(_judged(model.file, parts.gaps, loose))
            self._bodies.append(loose)
        self.remarks = tuple(f"{model.file}: {remark}" for remark in remarks)
        bodies = f"{count} bod{'ies' if count > 1 else 'y'}"
        ends = np.round([low, high], 6).T + 0.0  # no -0
        box = ", ".join(f"{axis} {a:.4g} to {b:.4g} m" for axis, (a, b) in zip("xyz", ends, strict=True))
        self.text = f"mesh {model.file}, {len(self.triangles):,} triangles, {bodies}, {box}, {model.up} up in the file"

    def _scale_remarks(self) -> Iterator[str]:
        if self.unit is not None and abs(self.model.scale / self.unit[0] - 1.0) > 1e-6:
            factor, name = self.unit
            yield f"a comment names the unit {name}, but scale is {self.model.scale:g}; metres need scale: {factor:g}"

    def turned_up(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower and upper corner (3,) [m] of the box around the bodies if the other axis, y or z, is up."""
        turn, at = np.eye(3), np.array(self.model.translate)
        turn[:2, :2] = rotation(self.model.yaw_deg)
        raised = Y_UP.T if self.model.up == "y" else Y_UP
        vertices = (self.vertices - at) @ turn @ raised.T @ turn.T + at
        return vertices.min(axis=0), vertices.max(axis=0)

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        if points.shape[-1] == 2:
            return self._shadow_distance(points, *self._slice)
        return _least(points, [body.signed_distance for body in self._bodies])

    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Return the distance [m] in the plane from points (..., 2) to the bodies' shadow from `low` to `high` [m].

        Inside the shadow it is the negative distance to the next edge of a triangle.
        """
        if len(self.low) == 2:
            return self._shadow_distance(points, *self._slice)
        return self._shadow_distance(points, low + SKIN, high - SKIN)

    def inside(self, points: np.ndarray) -> np.ndarray:
        if points.shape[-1] == 2:
            points = _at_height(points, self._slice[0])
        return -_least(points, [body.occupancy for body in self._bodies], sign=-1.0) > 0.5

    def outline(self, plane: tuple[int, int]) -> list[np.ndarray]:
        return _outline(self, plane)

    def mesh(self, size: tuple[float, float, float]) -> Mesh:
        return faceted(self.vertices[self.triangles])

    def _shadow_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Return the distance [m] to the shadow of the bodies between two heights; negative inside it."""
        shadow = np.full(points.shape[:-1], inf)
        for body in self._bodies:
            edges = _edges_between(body.corners, low, high)
            if not len(edges):
                continue
            foot = _at_height(points, low)
            covered = _least(foot, [body.occupancy]) > 0.5
            if high > low:
                covered |= _blocked_upwards(body.scene, foot, high - low)
            distance = _least(_at_height(points, 0.0), [_distance_to(_curtain(edges))])
            shadow = np.minimum(shadow, np.where(covered, -distance, distance))
        return shadow


@lru_cache(CACHED)
def _outline(solid: Solid, plane: tuple[int, int]) -> list[np.ndarray]:
    """Return the outline of a mesh: of its projection or, in 2-D, of its section, where the distance is 0."""
    if len(solid.low) == 3:
        return silhouette(solid.vertices[solid.triangles][..., [*plane]])
    pad = 0.02 * (solid.high - solid.low).max()
    x, y = np.linspace(solid.low - pad, solid.high + pad, SECTION_NODES, axis=1)
    lines = contours(x, y, -solid.signed_distance(np.stack(np.meshgrid(x, y), axis=-1)))
    return lines or [solid.footprint(0)]


@cache
def _open3d() -> Any:
    """Import and return open3d, which takes 2 s and 100 MB, so only for scenarios with meshes. Raises MeshError."""
    with suppress(ImportError, OSError):
        import libusb_package

        # open3d links libusb for its cameras; a machine without libusb gets it from the Python package
        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    try:
        import open3d
    except (ImportError, OSError) as error:
        reason = " ".join(str(error).split())[:LONGEST_REASON]
        raise MeshError(
            f"meshes are measured by open3d, which cannot be imported ({reason}); pip install open3d libusb-package, "
            "or use boxes, cylinders, spheres and prisms"
        ) from None
    return open3d


def _at_height(points: np.ndarray, z: float) -> np.ndarray:
    return np.concatenate([points, np.full((*points.shape[:-1], 1), z)], axis=-1)


@dataclass(frozen=True)
class _Parts:
    """Bodies of a mesh, in the file's coordinates. vertices (n, 3), triangles (m, 3); bodies: the closed ones.

    open: triangles of all others together, None without; gaps: their open and non-manifold edges in words.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    bodies: list[np.ndarray]
    open: np.ndarray | None
    gaps: str
    remarks: list[str]


def _parts_of(path: Path, data: MeshData) -> _Parts:
    """Split a mesh into bodies: closed ones, and the rest. Raises MeshError."""
    o3d = _open3d()
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(data.vertices), o3d.utility.Vector3iVector(data.triangles.astype(np.int32))
    )
    mesh.remove_duplicated_vertices()  # in an STL every triangle has its own
    _cleaned(path, mesh)
    remarks: list[str] = []
    if copies := _copies(mesh):
        remarks.append(f"{copies:,} triangles are there again, facing the same way; one of each is taken")
    # not is_watertight(): that also looks for self-intersections, in quadratic time
    gaps = np.asarray(mesh.get_non_manifold_edges(allow_boundary_edges=False))
    if len(gaps):
        near = WELD * float(np.ptp(np.asarray(mesh.vertices), axis=0).max())
        count = len(mesh.vertices)
        mesh.merge_close_vertices(near)
        _cleaned(path, mesh)
        _copies(mesh)
        if count > len(mesh.vertices):
            remarks.append(
                f"{count - len(mesh.vertices):,} corners closer than {near:.2g} of its units to another are joined"
            )
        gaps = np.asarray(mesh.get_non_manifold_edges(allow_boundary_edges=False))
    vertices, triangles = np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles).copy()
    body = np.asarray(mesh.cluster_connected_triangles()[0])
    holed = np.unique(body[np.isin(triangles, gaps).any(axis=1)]) if len(gaps) else np.empty(0, int)
    holed = np.array([n for n in holed if _has_edge(triangles[body == n], gaps)], int)
    root = _hollowed(vertices, triangles, body, remarks)
    body, is_open = root[body], np.isin(root[body], root[holed])
    bodies = [triangles[body == n] for n in np.unique(body[~is_open])]
    for n, part in enumerate(bodies):
        extent = np.ptp(vertices[part].reshape(-1, 3), axis=0)
        if extent.min() <= FLAT * extent.max():
            raise MeshError(f"{path.name}: body {n} is flat: it encloses nothing")
    if not len(holed):
        return _Parts(vertices, triangles, bodies, None, "", remarks)
    loose, part = triangles[is_open], body[is_open]
    _, first, place, copies = np.unique(
        np.sort(loose, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    twice = np.bincount(part, copies[place.ravel()] != 2, body.max() + 1)[part] == 0
    if twice.any():  # as of programs that draw both sides of a face
        is_first = np.isin(np.arange(len(loose)), first)
        loose = loose[is_first | ~twice]
        remarks.append("each triangle of bodies with open or non-manifold edges is there twice; one is taken")
    loose, turned = oriented(loose, _areas(vertices, loose))
    if turned:
        remarks.append(f"{turned:,} triangles are turned, as their neighbours face the other way")
    if (rim := len(rim_edges(loose))) > MOST_RIM:
        raise MeshError(
            f"{path.name}: has {rim:,} open edges; bodies with more than {MOST_RIM:,} are not closed here"
        )
    x, y, z = vertices[gaps[0]].mean(axis=0)
    what = f"body {holed[0]}" if len(holed) == 1 else f"{len(holed)} bodies from body {holed[0]} on"
    verb = "is" if len(holed) == 1 else "are"
    words = (
        f"{what} {verb} not watertight: {len(gaps)} open or non-manifold edges, first near "
        f"({x:.3f}, {y:.3f}, {z:.3f}) in the file's coordinates"
    )
    return _Parts(vertices, triangles, bodies, loose, words, remarks)


def _hollowed(
    vertices: np.ndarray, triangles: np.ndarray, body: np.ndarray, remarks: list[str]
) -> np.ndarray:
    """Return, for each number of `body` (m,), the body to which it belongs: itself, or that which it makes hollow.

    A body makes the smallest that it lies in hollow if they face opposite ways, as the inner faces of the walls of a
    room do. What was decided becomes a remark.
    """
    count = body.max() + 1
    corners = vertices[oriented(triangles, _areas(vertices, triangles))[0]]
    low, high = np.full((count, 3), inf), np.full((count, 3), -inf)
    np.minimum.at(low, body, corners.min(axis=1))
    np.maximum.at(high, body, corners.max(axis=1))
    moved = corners - 0.5 * (low + high)[body][:, None]
    volume = np.bincount(body, np.linalg.det(moved))
    size, root, filled = np.abs(volume), np.arange(count), 0
    for n in np.argsort(-size, kind="stable"):
        around = (low <= low[n]).all(axis=1) & (high >= high[n]).all(axis=1) & (size > size[n])
        if not around.any():
            continue
        own = corners[body == n].reshape(-1, 3)
        own = own[:: len(own) // MOST_TESTED + 1]
        for m in sorted(np.flatnonzero(around), key=size.__getitem__):
            if (np.abs(solid_angles(own, corners[body == m])) > 0.5).all():
                if volume[n] * volume[m] < 0.0:
                    root[n] = root[m]
                else:
                    whole = corners[root[body] == root[m]]
                    filled += bool((np.abs(solid_angles(own, whole)) > 0.5).all())
                break
    if hollow := np.count_nonzero(root != np.arange(count)):
        remarks.append(
            f"bodies that lie in others and face the opposite way: {hollow}; where they begin, a solid is hollow"
        )
    if filled:
        remarks.append(
            f"bodies that lie in others and face the same way: {filled}; they are united, so nothing is hollow there"
        )
    return root


def _copies(mesh: Any) -> int:
    """Remove copies of triangles that face the same way; return their number."""
    triangles = np.asarray(mesh.triangles)
    start = triangles.argmin(axis=1)[:, None]
    alike = np.take_along_axis(triangles, (start + np.arange(3)) % 3, axis=1)
    _, first = np.unique(alike, axis=0, return_index=True)
    if copies := len(triangles) - len(first):
        mesh.remove_triangles_by_index(np.setdiff1d(np.arange(len(triangles)), first).tolist())
    return copies


def _cleaned(path: Path, mesh: Any) -> None:
    """Remove triangles without an area and vertices without a triangle. Raises MeshError if no triangle is left."""
    mesh.remove_degenerate_triangles()
    mesh.remove_unreferenced_vertices()
    if not len(mesh.triangles):
        raise MeshError(f"{path.name}: all its triangles are lines or points")
    _check_edges(path, np.asarray(mesh.vertices), np.asarray(mesh.triangles))


def _has_edge(triangles: np.ndarray, edges: np.ndarray) -> bool:
    """Return whether triangles (m, 3) have one of these edges (k, 2)."""
    ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
    given = np.sort(edges, axis=1).astype(np.int64)
    return bool(np.isin(ends @ [1 << 32, 1], given @ [1 << 32, 1]).any())


def _judged(name: str, gaps: str, loose: _OpenBody) -> str:
    """Return a remark on bodies that are not closed; gaps: their edges in words. Raises MeshError if they are too open.

    They are if the holes, or the volume that may be inside or outside, are more than a few percent.
    """
    share, undecided = loose.caps.area / loose.area, loose.undecided()
    figures = (
        f"holes are {100 * share:.3g} % of the surface, and the winding number leaves {100 * undecided:.3g} % of the "
        "volume undecided (within 0.2 of 1/2)"
    )
    if undecided == inf:
        raise MeshError(f"{name}: {gaps}; it encloses no volume: close it in a mesh editor")
    if share > MOST_OPEN or undecided > MOST_UNDECIDED:
        raise MeshError(
            f"{name}: {gaps}; {figures}, more than {100 * MOST_OPEN:g} or {100 * MOST_UNDECIDED:g} %: "
            "close it in a mesh editor"
        )
    return f"{gaps}; its holes are closed: inside is where the winding number exceeds 1/2; {figures}"


def _areas(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the areas (m,) of triangles (m, 3)."""
    corners = vertices[triangles]
    return 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )


def _check_edges(path: Path, vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Raise MeshError if far too many triangles share an edge; a closed body has two at each."""
    ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
    edges, counts = np.unique(ends[:, 0] * len(vertices) + ends[:, 1], return_counts=True)
    if counts.max() > MOST_AT_EDGE:
        first, second = divmod(int(edges[counts.argmax()]), len(vertices))
        x, y, z = vertices[[first, second]].mean(axis=0)
        raise MeshError(
            f"{path.name}: {counts.max()} triangles share the edge near ({x:.3f}, {y:.3f}, {z:.3f}) in the file's "
            "coordinates; a closed body has two at each edge; close it in a mesh editor"
        )


def _scene(corners: np.ndarray) -> Any:
    """Return an open3d scene of triangles, given by their corners (m, 3, 3)."""
    o3d = _open3d()
    scene = o3d.t.geometry.RaycastingScene()
    triangles = np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(
        o3d.core.Tensor(corners.reshape(-1, 3).astype(np.float32)), o3d.core.Tensor(triangles)
    )
    _scenes.add(scene)
    return scene


_scenes: "WeakSet[Any]" = WeakSet()  # in use


def _least(points: np.ndarray, queries: Sequence[Query], sign: float = 1.0) -> np.ndarray:
    """Return the smallest value of sign * query(point) over all `queries`, at each of the points (..., 3)."""
    flat = points.reshape(-1, 3).astype(np.float32)
    least = np.full(len(flat), inf)
    for begin in range(0, len(flat), CHUNK):
        part = slice(begin, begin + CHUNK)
        for query in queries:
            least[part] = np.minimum(least[part], sign * query(flat[part]))
    return least.reshape(points.shape[:-1])


def _blocked_upwards(scene: Any, points: np.ndarray, length: float) -> np.ndarray:
    """Return whether a surface of the scene lies within `length` [m] vertically above each point (..., 3)."""
    flat = points.reshape(-1, 3)
    rays = np.concatenate([flat, np.broadcast_to([0.0, 0.0, 1.0], flat.shape)], axis=1).astype(np.float32)
    blocked = scene.test_occlusions(_open3d().core.Tensor(rays), tnear=0.0, tfar=length)
    return blocked.numpy().reshape(points.shape[:-1])


def _edges_between(corners: np.ndarray, low: float, high: float) -> np.ndarray:
    """Cut triangles (m, 3, 3) to the layer low <= z <= high; return their edges seen from above (n, 2, 2)."""
    start, way = corners, np.roll(corners, -1, axis=1) - corners
    rise = way[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        at_low, at_high = (low - start[..., 2]) / rise, (high - start[..., 2]) / rise
    level = (start[..., 2] >= low) & (start[..., 2] <= high)
    enter = np.where(rise == 0, 0.0, np.clip(np.minimum(at_low, at_high), 0.0, 1.0))
    leave = np.where(rise == 0, level, np.clip(np.maximum(at_low, at_high), 0.0, 1.0))
    inside = leave > enter
    ends = [start[inside][:, :2] + share[inside][:, None] * way[inside][:, :2] for share in (enter, leave)]
    edges = [np.stack(ends, axis=1)]
    for z, share in ((low, at_low), (high, at_high)):
        above = corners[..., 2] >= z
        crosses = above != np.roll(above, -1, axis=1)  # two edges of a triangle that the plane cuts
        where = start[crosses][:, :2] + share[crosses][:, None] * way[crosses][:, :2]
        edges.append(where.reshape(-1, 2, 2))
    edges = np.concatenate(edges)
    return edges[(edges[:, 0] != edges[:, 1]).any(axis=1)]


def _distance_to(scene: Any) -> Query:
    """Return a function of the distance [m] from points (n, 3) to the surfaces of a scene."""
    return lambda points: scene.compute_distance(_open3d().core.Tensor(points)).numpy()


def _curtain(edges: np.ndarray) -> Any:
    """Return an open3d scene to measure distances in the plane z = 0: each edge (n, 2, 2) is a vertical wall."""
    bottom, top = _at_height(edges, -1.0), _at_height(edges, 1.0)
    corners = np.concatenate([bottom, top], axis=1)
    return _scene(corners[:, [[0, 1, 2], [1, 3, 2]]].reshape(-1, 3, 3))
