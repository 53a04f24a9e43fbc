"""Obstacles from closed bodies in mesh files (STL, OBJ, PLY): signed distance, inside test and shadow, by open3d."""

import ctypes
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from math import inf
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np

from taichi_plume.grid.mesh_files import MeshError, read_mesh
from taichi_plume.grid.shapes import Shape, rotation

LONGEST_REASON = 150  # characters of the reason why open3d cannot be imported
CHUNK = 1 << 18  # points handed to open3d at a time
FLAT = 1e-9  # fraction of a body's length: in single precision a thinner body has no inside
MOST_BODIES = (
    800  # bodies in all meshes: open3d ends the process near 1000 scenes (thread-local keys of the system)
)
MOST_AT_EDGE = 100  # triangles that share an edge: more make no body, and open3d compares each with each
SKIN = 1e-5  # m: offset of a section from the given height, so that it does not run within a level face


class Solid(Shape):
    """Union of the closed bodies of a mesh file: scaled, then turned about the vertical, then moved.

    vertices: (n, 3) [m] and triangles: (m, 3) indices, as placed in the domain. In 2-D the shape is the section of the
    bodies at one height, with distances in the plane.
    """

    def __init__(self, model: Any, dim: int, folder: Path):
        self.model = model
        self.vertices, self.triangles, body = _bodies_of(folder / model.file)
        self.vertices = model.scale * self.vertices
        self.vertices[:, :2] = self.vertices[:, :2] @ rotation(model.yaw_deg).T
        self.vertices += np.array(model.translate)
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        self.low, self.high = low[:dim], high[:dim]
        self._slice = (model.section + SKIN, model.section + SKIN)
        if dim == 2 and not low[2] < self._slice[0] < high[2]:
            raise MeshError(
                f"{model.file}: section {model.section:g} m does not cut it, it lies at z {low[2]:.4g} to "
                f"{high[2]:.4g} m; give a section in between"
            )
        # A scene per body: if bodies of one scene overlap, the ray count that decides on inside is wrong.
        self._bodies = [self.triangles[body == n] for n in range(body.max() + 1)]
        if len(_scenes) + len(self._bodies) > MOST_BODIES:
            raise MeshError(
                f"{model.file}: has {len(self._bodies)} bodies, with which all meshes have more than {MOST_BODIES}; "
                "join bodies in a mesh editor, or leave small ones out"
            )
        self._scenes = [_scene(self.vertices, triangles) for triangles in self._bodies]

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        if points.shape[-1] == 2:
            return self._shadow_distance(points, *self._slice)
        return _least(points, [scene.compute_signed_distance for scene in self._scenes])

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
        return -_least(points, [scene.compute_occupancy for scene in self._scenes], sign=-1.0) > 0.5

    def _shadow_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Return the distance [m] to the shadow of the bodies between two heights; negative inside it."""
        shadow = np.full(points.shape[:-1], inf)
        for scene, triangles in zip(self._scenes, self._bodies, strict=True):
            edges = _edges_between(self.vertices[triangles], low, high)
            if not len(edges):
                continue
            foot = _at_height(points, low)
            covered = _least(foot, [scene.compute_occupancy]) > 0.5
            if high > low:
                covered |= _blocked_upwards(scene, foot, high - low)
            distance = _least(_at_height(points, 0.0), [_curtain(edges).compute_distance])
            shadow = np.minimum(shadow, np.where(covered, -distance, distance))
        return shadow


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


def _bodies_of(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the vertices (n, 3), the triangles (m, 3) and each triangle's body number (m,) of a mesh file."""
    vertices, triangles = read_mesh(path)
    o3d = _open3d()
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(triangles.astype(np.int32))
    )
    mesh.remove_duplicated_vertices()  # in an STL every triangle has its own
    mesh.remove_degenerate_triangles()
    mesh.remove_unreferenced_vertices()
    if not len(mesh.triangles):
        raise MeshError(f"{path.name}: all its triangles are lines or points")
    vertices, triangles = np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles).copy()
    _check_edges(path, vertices, triangles)
    body = np.asarray(mesh.cluster_connected_triangles()[0])
    # not is_watertight(): that also looks for self-intersections, in quadratic time
    gaps = np.asarray(mesh.get_non_manifold_edges(allow_boundary_edges=False))
    if len(gaps):
        holed = body[(triangles == gaps[0, 0]).any(axis=1)].min()
        here = np.isin(gaps[:, 0], triangles[body == holed])
        x, y, z = vertices[gaps[here][0]].mean(axis=0)
        raise MeshError(
            f"{path.name}: body {holed} is not watertight: {here.sum()} open or non-manifold edges, "
            f"first near ({x:.3f}, {y:.3f}, {z:.3f}) in the file's coordinates; close it in a mesh editor"
        )
    for n in range(body.max() + 1):
        extent = np.ptp(vertices[triangles[body == n]].reshape(-1, 3), axis=0)
        if extent.min() <= FLAT * extent.max():
            raise MeshError(f"{path.name}: body {n} is flat: it encloses nothing")
    return vertices, triangles, body


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


def _scene(vertices: np.ndarray, triangles: np.ndarray) -> Any:
    o3d = _open3d()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(triangles.astype(np.uint32))
    )
    _scenes.add(scene)
    return scene


_scenes: "WeakSet[Any]" = WeakSet()  # vertices in use


def _least(points: np.ndarray, queries: list[Callable], sign: float = 1.0) -> np.ndarray:
    """Return the smallest value of sign * query(point) over all `queries`, at each of the points (..., 3)."""
    flat = points.reshape(-1, 3).astype(np.float32)
    least = np.full(len(flat), inf)
    for begin in range(0, len(flat), CHUNK):
        part = slice(begin, begin + CHUNK)
        for query in queries:
            answer = query(_open3d().core.Tensor(flat[part])).numpy()
            least[part] = np.minimum(least[part], sign * answer)
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


def _curtain(edges: np.ndarray) -> Any:
    """Return an open3d scene to measure distances in the plane z = 0: each edge (n, 2, 2) is a vertical wall."""
    bottom, top = _at_height(edges, -1.0), _at_height(edges, 1.0)
    corners = np.concatenate([bottom, top], axis=1).reshape(-1, 3)
    first = 4 * np.arange(len(edges))[:, None]
    return _scene(corners, np.concatenate([first + np.array(corner) for corner in ((0, 1, 2), (1, 3, 2))]))
