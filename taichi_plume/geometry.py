"""Obstacles as signed distances, the cells they fill, and how far a robot is from the next surface.

Distances are in m, negative inside; points are (..., 2) in a 2-D run and (..., 3) in a 3-D run. Those of
the primitives are exact. What a robot on the ground can touch of a shape is its shadow: the part between
two heights, seen from above.
"""

import ctypes
from abc import ABC, abstractmethod
from functools import cache
from math import ceil, cos, inf, radians, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti
from scipy import ndimage

from taichi_plume import obstacles
from taichi_plume.fields import corner
from taichi_plume.scenario import Domain, Scenario

TIE = 1e-4  # cells: a cell centre this close to a surface counts as outside, whatever the rounding
CLEARANCE_STEP = 0.01  # m, the finest grid of a clearance map
CLEARANCE_NODES = 400_000
FAR = 1e6  # m, clearance where there is no obstacle
CHUNK = 1 << 18  # points handed to open3d at a time
SKIN = 1e-5  # m: a section this far from the height asked for does not run within a level face


class MeshError(ValueError):
    """A mesh file that is missing, unreadable or not closed."""


class Shape(ABC):
    """An obstacle. `model` is its section of the scenario, `low` and `high` (dim,) its bounding box [m]."""

    model: obstacles.Obstacle
    low: np.ndarray
    high: np.ndarray

    @abstractmethod
    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """Distance [m] of points (..., dim) to the surface, negative inside."""

    @abstractmethod
    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Distance [m] from points (..., 2) to the shadow of the part with low < z < high; infinite if none.

        In a 2-D run heights do not matter.
        """

    def inside(self, points: np.ndarray, tie: float = 0.0) -> np.ndarray:
        """Whether points (..., dim) lie more than `tie` [m] below the surface."""
        return self.signed_distance(points) < -tie


class Upright(Shape):
    """A footprint, in 3-D drawn out from z = `base` to `top` [m]."""

    def __init__(self, model: Any, dim: int, low: np.ndarray, high: np.ndarray, base: float, top: float):
        self.model, self.base, self.top = model, base, top
        self.low = np.append(low, base)[:dim]
        self.high = np.append(high, top)[:dim]

    @abstractmethod
    def footprint_distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [m] of points (..., 2) to the outline of the footprint."""

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """Distance [m] of points (..., dim) to the surface, negative inside."""
        across = self.footprint_distance(points[..., :2])
        if len(self.low) == 2:
            return across
        along = np.maximum(self.base - points[..., 2], points[..., 2] - self.top)
        outside = np.hypot(np.maximum(across, 0.0), np.maximum(along, 0.0))
        return outside + np.minimum(np.maximum(across, along), 0.0)

    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Distance [m] from points (..., 2) to the footprint, if the shape reaches between these heights."""
        if len(self.low) == 3 and (self.base >= high or self.top <= low):
            return np.full(points.shape[:-1], inf)
        return self.footprint_distance(points)


class UprightBox(Upright):
    """A box turned about the vertical."""

    def __init__(self, model: obstacles.Box, dim: int):
        self.center = np.array(model.center[:2])
        self.half = np.array(model.size[:2]) / 2
        self.axes = _rotation(model.yaw_deg)
        reach = np.abs(self.axes) @ self.half
        z, height = (model.center[2], model.size[2]) if dim == 3 else (0.0, 0.0)
        super().__init__(model, dim, self.center - reach, self.center + reach, z - height / 2, z + height / 2)

    def footprint_distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [m] to the rectangle."""
        beyond = np.abs((points - self.center) @ self.axes) - self.half
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)


class UprightCylinder(Upright):
    """A cylinder with a vertical axis."""

    def __init__(self, model: obstacles.Cylinder, dim: int, ceiling: float):
        self.center, self.radius = np.array(model.center), model.radius
        top = ceiling if model.height is None else model.base + model.height
        low, high = self.center - self.radius, self.center + self.radius
        super().__init__(model, dim, low, high, model.base, top)

    def footprint_distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [m] to the circle."""
        return np.linalg.norm(points - self.center, axis=-1) - self.radius


class UprightPrism(Upright):
    """A prism over a simple polygon, in either sense of rotation."""

    def __init__(self, model: obstacles.Prism, dim: int, ceiling: float):
        self.vertices = np.array(model.vertices)
        top = ceiling if model.height is None else model.base + model.height
        super().__init__(model, dim, self.vertices.min(axis=0), self.vertices.max(axis=0), model.base, top)

    def footprint_distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [m] to the polygon; inside is where a ray to the right crosses it oddly often."""
        squared = np.full(points.shape[:-1], inf)
        odd = np.zeros(points.shape[:-1], bool)
        x, y = points[..., 0], points[..., 1]
        for a, b in zip(self.vertices, np.roll(self.vertices, -1, axis=0), strict=True):
            side = b - a
            along = np.clip((points - a) @ side / max(side @ side, 1e-300), 0.0, 1.0)
            squared = np.minimum(squared, ((points - a - along[..., None] * side) ** 2).sum(axis=-1))
            if a[1] != b[1]:
                odd ^= ((a[1] > y) != (b[1] > y)) & (x < a[0] + (y - a[1]) * side[0] / side[1])
        return np.where(odd, -1.0, 1.0) * np.sqrt(squared)


class Ball(Shape):
    """A sphere, in 2-D a disc."""

    def __init__(self, model: obstacles.Sphere, dim: int):
        self.model = model
        self.center, self.radius = np.array(model.center[:dim]), model.radius
        self.low, self.high = self.center - self.radius, self.center + self.radius

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """Distance [m] of points (..., dim) to the surface, negative inside."""
        return np.linalg.norm(points - self.center, axis=-1) - self.radius

    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Distance [m] from points (..., 2) to the widest disc between these heights."""
        z = self.center[2] if len(self.center) == 3 else low
        squared = self.radius**2 - (z - np.clip(z, low, high)) ** 2
        if squared <= 0:
            return np.full(points.shape[:-1], inf)
        return np.linalg.norm(points - self.center[:2], axis=-1) - sqrt(squared)


class Solid(Shape):
    """Closed bodies from a mesh file: their union, scaled, then turned about the vertical, then moved.

    vertices: (n, 3) [m] and triangles: (m, 3) indices, as placed in the domain. In 2-D the shape is the
    section of the bodies at one height, with distances in the plane.
    """

    def __init__(self, model: obstacles.Mesh, dim: int, folder: Path):
        self.model = model
        self.vertices, self.triangles, body = _read_mesh(folder / model.file)
        self.vertices = model.scale * self.vertices
        self.vertices[:, :2] = self.vertices[:, :2] @ _rotation(model.yaw_deg).T
        self.vertices += np.array(model.translate)
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        self.low, self.high = low[:dim], high[:dim]
        self._slice = (model.section + SKIN, model.section + SKIN)
        if dim == 2 and not low[2] < self._slice[0] < high[2]:
            raise MeshError(
                f"{model.file}: section {model.section:g} m does not cut it, it lies at z {low[2]:.4g} to "
                f"{high[2]:.4g} m; give a section in between"
            )
        # A scene per body: where bodies of one scene overlap, the ray count that decides on inside is wrong.
        self._bodies = [self.triangles[body == n] for n in range(body.max() + 1)]
        self._scenes = [_scene(self.vertices, triangles) for triangles in self._bodies]

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """Distance [m] of points (..., dim) to the surface, negative inside."""
        if points.shape[-1] == 2:
            return self._shadow_distance(points, *self._slice)
        return _nearest(self._scenes, points, "compute_signed_distance")

    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Distance [m] from points (..., 2) to the shadow of the part between these heights.

        Inside the shadow of a body it is the distance to the next edge of a triangle, negative.
        """
        if len(self.low) == 2:
            return self._shadow_distance(points, *self._slice)
        return self._shadow_distance(points, low + SKIN, high - SKIN)

    def inside(self, points: np.ndarray, tie: float = 0.0) -> np.ndarray:
        """Whether points (..., dim) lie below the surface, also when moved by `tie` [m] to either side."""
        if points.shape[-1] == 2:
            points = _at_height(points, self._slice[0])
        nudge = tie * np.array([1.0, 0.8, 0.6])  # along no likely face
        return self._occupied(points + nudge) & self._occupied(points - nudge)

    def _occupied(self, points: np.ndarray) -> np.ndarray:
        return -_nearest(self._scenes, points, "compute_occupancy", sign=-1.0) > 0.5

    def _shadow_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Distance [m] to the nearest edge of a triangle cut to the layer: some of these make the outline."""
        shadow = np.full(points.shape[:-1], inf)
        for scene, triangles in zip(self._scenes, self._bodies, strict=True):
            edges = _edges_between(self.vertices[triangles], low, high)
            if not len(edges):
                continue
            foot = _at_height(points, low)
            covered = _nearest([scene], foot, "compute_occupancy") > 0.5
            if high > low:
                covered |= _blocked_upwards(scene, foot, high - low)
            distance = _nearest([_curtain(edges)], _at_height(points, 0.0), "compute_distance")
            shadow = np.minimum(shadow, np.where(covered, -distance, distance))
        return shadow


def shape(obstacle: obstacles.Obstacle, domain: Domain, folder: Path) -> Shape:
    """The shape of one obstacle; mesh files lie in `folder`. Raises MeshError."""
    ceiling = domain.extent[2] if domain.dim == 3 else inf
    match obstacle:
        case obstacles.Box():
            return UprightBox(obstacle, domain.dim)
        case obstacles.Cylinder():
            return UprightCylinder(obstacle, domain.dim, ceiling)
        case obstacles.Sphere():
            return Ball(obstacle, domain.dim)
        case obstacles.Prism():
            return UprightPrism(obstacle, domain.dim, ceiling)
        case obstacles.Mesh():
            return Solid(obstacle, domain.dim, folder)


def shapes(scenario: Scenario, folder: Path) -> list[Shape]:
    """The shapes of a scenario's obstacles, in their order; mesh files lie in `folder`. Raises MeshError."""
    return [shape(obstacle, scenario.domain, folder) for obstacle in scenario.obstacles]


def clearance_resolution(extent: tuple[float, ...]) -> float:
    """Spacing [m] of the nodes of a clearance map, which may tell up to √2 times this less than is free."""
    return max(CLEARANCE_STEP, sqrt(extent[0] * extent[1] / CLEARANCE_NODES))


@ti.data_oriented
class ClearanceMap:
    """How far a point of the floor is from the next edge of it or obstacle: never more than the truth.

    Obstacles count as far as they reach between the floor and `body_height` [m]. Their distances are kept on
    nodes `resolution` [m] apart. As a distance changes by at most the way walked, the bilinear value exceeds
    the truth by no more than resolution/√2 (at the middle of four nodes), which is taken off. Edges: exact.
    low, high: corners of the floor [m].
    """

    def __init__(
        self,
        shapes: list[Shape],
        high: tuple[float, ...],
        body_height: float,
        resolution: float | None = None,
        low: tuple[float, ...] = (0.0, 0.0),
    ):
        self.low, self.high = (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))
        size = (self.high[0] - self.low[0], self.high[1] - self.low[1])
        resolution = resolution or clearance_resolution(size)
        self.resolution = resolution if shapes else max(size)
        self.nodes = tuple(max(2, ceil(length / self.resolution - 1e-9) + 1) for length in size)
        axes = [low + np.arange(n) * self.resolution for low, n in zip(self.low, self.nodes, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        self._values = np.full(self.nodes, FAR)
        for one in shapes:
            self._values = np.minimum(self._values, one.horizontal_distance(points, 0.0, body_height))
        self._values -= self.resolution / sqrt(2)
        self.values = ti.field(ti.f32, self.nodes)
        self.values.from_numpy(self._values.astype(np.float32))

    @ti.func
    def distance(self, p):
        """Distance [m] from p (x, y) to the next surface, or a little less; negative inside an obstacle."""
        return ti.min(self._wall(p)[0], self._obstacle(p)[0])

    @ti.func
    def normal(self, p):
        """Unit vector away from the surface next to p."""
        wall = self._wall(p)
        obstacle = self._obstacle(p)
        gradient = ti.Vector([obstacle[1], obstacle[2]])
        steepness = gradient.norm()
        away = ti.Vector([wall[1], wall[2]])
        if obstacle[0] < wall[0] and steepness > 1e-6:
            away = gradient / steepness
        return away

    def distance_at(self, points: np.ndarray) -> np.ndarray:
        """What `distance` gives [m], for points (..., 2) on the host."""
        points = np.asarray(points, float)
        walls = np.minimum(points - np.array(self.low), np.array(self.high) - points).min(axis=-1)
        return np.minimum(walls, self.obstacle_distance_at(points))

    def obstacle_distance_at(self, points: np.ndarray) -> np.ndarray:
        """The same from obstacles alone, for points (..., 2) anywhere; off the floor, what it is at its next point."""
        where = (np.asarray(points, float) - np.array(self.low)).reshape(-1, 2).T / self.resolution
        standing = ndimage.map_coordinates(self._values, where, order=1, mode="nearest")
        return standing.reshape(points.shape[:-1])

    @ti.func
    def _wall(self, p):
        """Distance [m] to the next edge of the floor and its normal."""
        result = ti.Vector([p[0] - self.low[0], 1.0, 0.0])
        if self.high[0] - p[0] < result[0]:
            result = ti.Vector([self.high[0] - p[0], -1.0, 0.0])
        if p[1] - self.low[1] < result[0]:
            result = ti.Vector([p[1] - self.low[1], 0.0, 1.0])
        if self.high[1] - p[1] < result[0]:
            result = ti.Vector([self.high[1] - p[1], 0.0, -1.0])
        return result

    @ti.func
    def _obstacle(self, p):
        """Distance [m] to the next obstacle, or a little less, and its gradient."""
        I, w = corner(p - ti.Vector(self.low), (0.0, 0.0), self.resolution, 0, self.nodes)
        v00, v10 = self.values[I[0], I[1]], self.values[I[0] + 1, I[1]]
        v01, v11 = self.values[I[0], I[1] + 1], self.values[I[0] + 1, I[1] + 1]
        lower, upper = v00 + w[0] * (v10 - v00), v01 + w[0] * (v11 - v01)
        along_x = (1.0 - w[1]) * (v10 - v00) + w[1] * (v11 - v01)
        return ti.Vector([lower + w[1] * (upper - lower), along_x, upper - lower])


# ---------------------------------------------------------------- meshes


@cache
def _open3d() -> Any:
    """The open3d module: 2 s to import and 100 MB, so only for scenarios with meshes."""
    import libusb_package

    # open3d links libusb for its cameras; a machine without it gets the one from the Python package
    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import open3d

    return open3d


def _rotation(yaw_deg: float) -> np.ndarray:
    c, s = cos(radians(yaw_deg)), sin(radians(yaw_deg))
    return np.array([[c, -s], [s, c]])


def _at_height(points: np.ndarray, z: float) -> np.ndarray:
    return np.concatenate([points, np.full((*points.shape[:-1], 1), z)], axis=-1)


def _read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (n, 3), triangles (m, 3) and the number of the body that each triangle belongs to (m,)."""
    if path.is_dir():
        raise MeshError(f"{path.name}: is a folder; give an STL, OBJ or PLY file in it")
    if not path.is_file():
        raise MeshError(f"{path.name}: no such file in {path.parent}")
    o3d = _open3d()
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh = o3d.io.read_triangle_mesh(str(path))
    mesh.remove_duplicated_vertices()  # in an STL every triangle has its own
    mesh.remove_degenerate_triangles()
    mesh.remove_unreferenced_vertices()
    if not len(mesh.triangles):
        raise MeshError(f"{path.name}: no triangles in it; STL, OBJ and PLY files are read")
    if not np.isfinite(np.asarray(mesh.vertices)).all():
        raise MeshError(f"{path.name}: some coordinates are not finite")
    body = np.asarray(mesh.cluster_connected_triangles()[0])
    vertices, triangles = np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles).copy()
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
    return vertices, triangles, body


def _scene(vertices: np.ndarray, triangles: np.ndarray) -> Any:
    o3d = _open3d()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(triangles.astype(np.uint32))
    )
    return scene


def _nearest(scenes: list[Any], points: np.ndarray, query: str, sign: float = 1.0) -> np.ndarray:
    """The least of sign·query over the scenes at points (..., 3)."""
    flat = points.reshape(-1, 3).astype(np.float32)
    least = np.full(len(flat), inf)
    for begin in range(0, len(flat), CHUNK):
        part = slice(begin, begin + CHUNK)
        for scene in scenes:
            answer = getattr(scene, query)(_open3d().core.Tensor(flat[part])).numpy()
            least[part] = np.minimum(least[part], sign * answer)
    return least.reshape(points.shape[:-1])


def _blocked_upwards(scene: Any, points: np.ndarray, length: float) -> np.ndarray:
    """Whether a surface lies within `length` [m] above points (..., 3)."""
    flat = points.reshape(-1, 3)
    rays = np.concatenate([flat, np.broadcast_to([0.0, 0.0, 1.0], flat.shape)], axis=1).astype(np.float32)
    blocked = scene.test_occlusions(_open3d().core.Tensor(rays), tnear=0.0, tfar=length)
    return blocked.numpy().reshape(points.shape[:-1])


def _edges_between(corners: np.ndarray, low: float, high: float) -> np.ndarray:
    """Edges (n, 2, 2) in the plane of the triangles (m, 3, 3) cut to low <= z <= high."""
    start, way = corners, np.roll(corners, -1, axis=1) - corners
    rise = way[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        at_low, at_high = (low - start[..., 2]) / rise, (high - start[..., 2]) / rise
    level = (start[..., 2] >= low) & (start[..., 2] <= high)
    enter = np.where(rise == 0, 0.0, np.clip(np.minimum(at_low, at_high), 0.0, 1.0))
    leave = np.where(rise == 0, level, np.clip(np.maximum(at_low, at_high), 0.0, 1.0))
    kept = leave > enter
    ends = [start[kept][:, :2] + share[kept][:, None] * way[kept][:, :2] for share in (enter, leave)]
    edges = [np.stack(ends, axis=1)]
    for z, share in ((low, at_low), (high, at_high)):
        above = corners[..., 2] >= z
        crosses = above != np.roll(above, -1, axis=1)  # two edges of a triangle that the plane cuts
        where = start[crosses][:, :2] + share[crosses][:, None] * way[crosses][:, :2]
        edges.append(where.reshape(-1, 2, 2))
    edges = np.concatenate(edges)
    return edges[(edges[:, 0] != edges[:, 1]).any(axis=1)]


def _curtain(edges: np.ndarray) -> Any:
    """A scene in which the distance of a point at z = 0 is that to the nearest of the edges (n, 2, 2)."""
    bottom, top = _at_height(edges, -1.0), _at_height(edges, 1.0)
    corners = np.concatenate([bottom, top], axis=1).reshape(-1, 3)
    first = 4 * np.arange(len(edges))[:, None]
    return _scene(corners, np.concatenate([first + np.array(corner) for corner in ((0, 1, 2), (1, 3, 2))]))
