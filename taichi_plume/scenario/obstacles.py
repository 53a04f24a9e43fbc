"""Obstacles: boxes, cylinders, spheres, prisms, meshes and walls of maps, which stand or move."""

from collections.abc import Iterator
from math import hypot, inf, pi
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from taichi_plume.grid.floor_plans import FloorPlan
from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.shapes import Shape
from taichi_plume.grid.unresolved import SAMPLES, missed
from taichi_plume.quantities import conversion
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, Domain, span
from taichi_plume.scenario.motion import Motion
from taichi_plume.scenario.vocabulary import SHAPE, FileName, Model

TOO_LARGE = 10  # times the domain: a larger body is probably in another unit
MOSTLY_OUTSIDE = 0.4  # fraction of a body's base in the domain; a wall may stand on an edge
UNITS = ("millimetres", "centimetres", "inches")
ROUNDED = 1e-6  # of the domain's edge: so far a mesh may reach out of the domain
MOST_EDGES = 500  # of a polygon whose edges are tested against one another
SLIVER = 1e-6  # of the square of a polygon's width: less area is none
TOUCHING = 1e-9  # of the same: a corner this close to an edge lies on it


class AnyObstacle(Model):
    """Base class of the obstacles: their checks and sizes."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        shape, domain = context.shapes[where], context.domain
        extent, size = np.array(domain.extent), shape.high - shape.low
        beyond = (shape.high <= 0) | (shape.low >= extent)
        axis = int(beyond.argmax()) if beyond.any() else int(size.argmax())
        reach, room = span("xyz"[axis], shape.low[axis], shape.high[axis]), span("xyz"[axis], 0, extent[axis])
        if size.max() > TOO_LARGE * extent.max():
            yield (
                f"{where}: is at {reach}, far larger than the domain, {room}; {self._advice(shape, domain)}make "
                "it smaller"
            )
        elif beyond.any():
            yield (
                f"{where}: lies outside the domain: {reach}, the domain has {room}; {self._advice(shape, domain)}"
                "move it in or remove it"
            )
        elif isinstance(self, Box | Cylinder | Sphere) and self.motion is not None:
            yield from self.motion.placement_errors(where, self.center, shape, domain)

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        shape, domain = context.shapes[where], context.domain
        if vars(self).get("motion") is not None:
            if context.scenario.wind.computed is None:
                kind = context.scenario.wind.kind
                yield f"{where}.motion: moves for the robots, but does not move the air of a wind of kind {kind}"
            return
        low, high, extent = shape.low[:2], shape.high[:2], np.array(domain.extent[:2])
        share = float(np.prod((np.minimum(high, extent) - np.maximum(low, 0.0)) / (high - low)))
        if share < MOSTLY_OUTSIDE:
            yield (
                f"{where}: only {100 * share:.0f} % of its base are in the domain: it is at "
                f"{span('x', low[0], high[0])}, {span('y', low[1], high[1])}, the domain has {domain.box}"
            )
        if self.thinnest >= domain.spacing:
            return
        samples = max(500, SAMPLES // len(context.scenario.obstacles))
        lost = missed(shape, domain.extent, domain.spacing, samples)
        if lost is not None:
            part = "all of it" if lost.share > 0.99 else f"{100 * lost.share:.0f} % of it"
            near = ", ".join(f"{x:.3g}" for x in lost.place)
            yield (
                f"{where}: the grid misses {part}, about ({near}) m: parts thinner than half a cell of "
                f"{domain.spacing:g} m fall between nodes; {self._finer(shape, domain)}"
            )

    width: ClassVar[float] = inf
    """Largest horizontal width [m]; infinite if unknown."""

    thinnest: ClassVar[float] = 0.0
    """Smallest thickness [m]; 0 if unknown."""

    def _finer(self, shape: Shape, domain: Domain) -> str:
        """Return advice for an obstacle that is too thin for the grid: a finer grid or another unit."""
        if self.thinnest:
            return f"use a domain.spacing of {2 * self.thinnest:.3g} m or less, or make it thicker"
        return f"{self._advice(shape, domain)}lower domain.spacing, or make it thicker"

    def _advice(self, shape: Shape, domain: Domain) -> str:
        """Return a hint at the unit or the upward axis of a mesh file with which it would fit; "" if none."""
        return ""

    def surface(self, domain: Domain) -> float:
        """Return about the surface area [m²], in 2-D the outline's length [m]; infinite if only a file knows it."""
        return inf


def _upright(around: float, area: float, height: float, domain: Domain) -> float:
    """Return the surface of an upright body; around: length of its outline [m], in 2-D the result; area: of its top."""
    return around if domain.dim == 2 else around * min(height, domain.size[2]) + 2.0 * area


class Standing(AnyObstacle):
    """An obstacle that does not move."""

    motion: ClassVar[None] = None


class Box(AnyObstacle):
    """An upright box, which may be turned about the vertical: a table, a cupboard, a wall."""

    kind: Literal["box"]
    center: Annotated[si.Point, SHAPE]
    """Middle of the box, per axis."""
    size: Annotated[si.Edges, SHAPE]
    """Edges of the box along its own x, y and z, before it is turned."""
    yaw_deg: Annotated[si.Angle, SHAPE] = 0.0
    """Angle by which it is turned about the vertical, to the left seen from above."""
    motion: Motion | None = None
    """Motion over the floor, which stirs the air of a computed wind; unless given, it stands."""

    def surface(self, domain: Domain) -> float:
        x, y = self.size[:2]
        return _upright(2.0 * (x + y), x * y, self.size[-1], domain)

    @property
    def width(self) -> float:
        return max(self.size[:2])

    @property
    def disc(self) -> float:
        """Radius [m] of the disc around the box's base, as which robots perceive a moving box."""
        return hypot(*self.size[:2]) / 2

    @property
    def span(self) -> tuple[float, float]:
        """Heights of the lowest and the highest point of the box in 3-D [m]."""
        return self.center[-1] - self.size[-1] / 2, self.center[-1] + self.size[-1] / 2

    @property
    def thinnest(self) -> float:
        return min(self.size)


class Round(AnyObstacle):
    """An obstacle with a round footprint."""

    @property
    def disc(self) -> float:
        """Radius [m] of the disc as which robots perceive the obstacle while it moves."""
        return vars(self)["radius"]

    @property
    def width(self) -> float:
        return 2.0 * self.disc


class Cylinder(Round):
    """An upright cylinder: a pillar, a bin, or with a `motion` a person who walks."""

    kind: Literal["cylinder"]
    center: Annotated[si.Point2, SHAPE]
    """Where its axis stands on the floor, x and y."""
    radius: Annotated[si.Length, SHAPE]
    """Radius of its round footprint."""
    base: Annotated[si.Distance, SHAPE] = 0.0
    """Height of its lower end over the floor; 3-D only."""
    height: Annotated[si.Length, SHAPE] | None = None
    """Length from its base upward; unless given, it reaches the ceiling. 3-D only."""
    motion: Motion | None = None
    """Motion over the floor, which stirs the air of a computed wind; unless given, it stands."""

    def surface(self, domain: Domain) -> float:
        r = self.radius
        return _upright(2.0 * pi * r, pi * r**2, self.height or inf, domain)

    @property
    def span(self) -> tuple[float, float]:
        """Heights of the lowest and the highest point of the cylinder in 3-D [m]; the highest may be infinite."""
        return self.base, inf if self.height is None else self.base + self.height

    @property
    def thinnest(self) -> float:
        return min(2.0 * self.radius, self.height or inf)


class Sphere(Round):
    """A sphere (in 2-D a disc)."""

    kind: Literal["sphere"]
    center: Annotated[si.Point, SHAPE]
    """Middle of the sphere, per axis."""
    radius: Annotated[si.Length, SHAPE]
    """Radius of the sphere, in 2-D of the disc."""
    motion: Motion | None = None
    """Motion over the floor, which stirs the air of a computed wind; unless given, it stands."""

    def surface(self, domain: Domain) -> float:
        return 2.0 * pi * self.radius if domain.dim == 2 else 4.0 * pi * self.radius**2

    @property
    def span(self) -> tuple[float, float]:
        """Heights of the lowest and the highest point of the sphere in 3-D [m]."""
        return self.center[-1] - self.radius, self.center[-1] + self.radius

    @property
    def thinnest(self) -> float:
        return 2.0 * self.radius


class Prism(Standing):
    """An upright body over any polygon: walls with corners, furniture."""

    kind: Literal["prism"]
    vertices: Annotated[tuple[si.Point2, ...], Field(min_length=3, max_length=10_000), SHAPE]
    """Corners of the outline, each [x, y], in order along the outline, which must not cross itself."""
    base: Annotated[si.Distance, SHAPE] = 0.0
    """Height of its lower end over the floor; 3-D only."""
    height: Annotated[si.Length, SHAPE] | None = None
    """Length from its base upward; unless given, it reaches the ceiling. 3-D only."""

    def surface(self, domain: Domain) -> float:
        corners = np.array(self.vertices)
        around = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum())
        return _upright(around, abs(_twice_area(corners)) / 2, self.height or inf, domain)

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from _outline(f"{where}.vertices", np.array(self.vertices))
        yield from super().errors(where, context)


class Mesh(Standing):
    """Bodies from a file of triangles (STL, OBJ or PLY); a 2-D run cuts them at a height."""

    kind: Literal["mesh"]
    file: FileName
    """Path of an STL, OBJ or PLY file of closed bodies, relative to the scenario's folder. Small holes are closed."""
    scale: Annotated[si.SomeCoefficient, SHAPE] = 1.0
    """Factor from the file's unit to metres: 0.001 for a file in millimetres."""
    up: Annotated[Literal["z", "y"], SHAPE] = "z"
    """Axis of the file that points up. With y, as modelling programs have it, (x, y, z) becomes (x, -z, y)."""
    yaw_deg: Annotated[si.Angle, SHAPE] = 0.0
    """Angle by which it is turned about the vertical, after scaling, to the left seen from above."""
    translate: Annotated[tuple[si.Coordinate, si.Coordinate, si.Coordinate], SHAPE] = (0.0, 0.0, 0.0)
    """Shift of the mesh after scaling and turning, per axis."""
    section: Annotated[si.Coordinate, SHAPE] = 0.0
    """Height at which a 2-D run cuts the mesh, once it has been moved."""

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        shape, extent = context.shapes[where], np.array(context.domain.extent)
        if (shape.low < -ROUNDED * extent).any() or (shape.high > (1 + ROUNDED) * extent).any():
            if turned := self._turned(shape, context.domain):
                yield f"{where}: not all of it lies in the domain; {turned}"
        yield from super().warnings(where, context)

    def _advice(self, shape: Shape, domain: Domain) -> str:
        if turned := self._turned(shape, domain):
            return f"{turned}; otherwise "
        assert isinstance(shape, Solid)
        size, most = (shape.high - shape.low).max(), max(domain.extent)
        units = {} if shape.unit is None else {shape.unit[0] / self.scale: shape.unit[1]}
        units |= {conversion(name, "m")[0]: name for name in UNITS} | {1000.0: "metres, not millimetres"}
        for factor, unit in units.items():
            if 0.03 * most <= factor * size <= most and factor != 1.0:
                return f"if {self.file} is in {unit}, give scale: {factor * self.scale:.4g}; otherwise "
        return ""

    def _turned(self, shape: Shape, domain: Domain) -> str:
        """Return a hint at the other upward axis if the mesh then lies in the domain, but now does not; else ""."""
        assert isinstance(shape, Solid)
        extent = np.array(domain.extent)
        (low, high), dim = shape.turned_up(), domain.dim

        def lies_in(low: np.ndarray, high: np.ndarray) -> bool:
            return bool((low >= -ROUNDED * extent).all() and (high <= (1 + ROUNDED) * extent).all())

        if lies_in(shape.low, shape.high) or not lies_in(low[:dim], high[:dim]):
            return ""
        other = "z" if self.up == "y" else "y"
        return f"if {other} is the upward axis of {self.file}, give up: {other}"


class WallMap(Standing):
    """Walls of an occupancy map of ROS's map_server (YAML and picture); in 3-D extruded to a height."""

    kind: Literal["map"]
    file: FileName
    """Path of the map's YAML file, relative to the scenario's folder, with a picture (PGM, PNG or BMP) beside it. Or of
    the picture alone, or of a drawing (DXF), with a `resolution`."""
    resolution: Annotated[si.Length, SHAPE] | None = None
    """Edge of a pixel of a picture without a YAML file, or of the walls of a drawing. The lower left corner of such a
    picture is the origin of the map's frame."""
    layers: Annotated[tuple[str, ...], Field(max_length=1000), SHAPE] = ()
    """Layers of a drawing that are walls; unless given, all that are visible."""
    scale: Annotated[si.SomeCoefficient, SHAPE] | None = None
    """Metres per unit of a drawing, such as 0.001 for mm; unless given, as the drawing states."""
    unknown: Literal["wall", "free"] | None = None
    """Meaning of unknown pixels, and of pixels of grey 205, which map_saver writes for unknown. Unless given, pixels
    between the thresholds are walls, as most lie behind the walls, and the thresholds decide on grey 205."""
    origin: Annotated[si.Point2, SHAPE] | None = None
    """Where the domain's lower corner lies in the map's frame, x and y. Unless given, it is the lower corner of the box
    around the map."""
    base: Annotated[si.Distance, SHAPE] = 0.0
    """Height of the walls' lower end over the floor; 3-D only."""
    height: Annotated[si.Length, SHAPE] | None = None
    """Length from their base upward; unless given, they reach the ceiling. 3-D only."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        plan, extent = self._shape(where, context), np.array(context.domain.extent[:2])
        if (plan.high[:2] <= 0).any() or (plan.low[:2] >= extent).any():
            (low, high), at = plan.reach, np.array(self.origin or (0, 0))
            have, need = (
                f"{span('x', a[0], b[0])} and {span('y', a[1], b[1])}"
                for a, b in ((low, high), (at, at + extent))
            )
            yield f"{where}.origin: the map lies outside the domain: it has {have}, the domain {need}"

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        plan, domain = self._shape(where, context), context.domain
        low, high = plan.low[:2], plan.high[:2]
        if (low > domain.spacing).any() or (high < np.array(domain.extent[:2]) - domain.spacing).any():
            left, (x, y) = plan.reach[0], plan.reach[1] - plan.reach[0]
            yield (
                f"{where}: the domain reaches beyond the map, where no walls are; for all of the map use a domain.size "
                f"of {x:.6g} x {y:.6g} m with an origin of [{left[0]:.6g}, {left[1]:.6g}]"
            )
        if not plan.solid.any():
            yield f"{where}: has no walls in the domain"

    def _shape(self, where: str, context: Context) -> FloorPlan:
        plan = context.shapes[where]
        assert isinstance(plan, FloorPlan)
        return plan


Obstacle = Annotated[Box | Cylinder | Sphere | Prism | Mesh | WallMap, Field(discriminator="kind")]


def _outline(path: str, corners: np.ndarray) -> Iterator[str]:
    """Yield an error if a polygon, corners (n, 2) [m], has no area or crosses itself."""
    area = abs(_twice_area(corners)) / 2
    width = float(np.ptp(corners, axis=0).max())
    crossing = _crossing(corners, TOUCHING * width**2) if len(corners) <= MOST_EDGES else None
    if crossing:
        first, second = crossing
        yield f"{path}: the edge after vertex {first} crosses the edge after vertex {second}; reorder the corners"
    elif area <= SLIVER * width**2:
        yield f"{path}: the polygon has no area; its corners lie on a line or are out of order"


def _twice_area(corners: np.ndarray) -> float:
    """Return twice the area of a polygon, corners (n, 2); negative if clockwise."""
    x, y = (corners - corners[0]).T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _crossing(corners: np.ndarray, least: float) -> tuple[int, int] | None:
    """Return the first two edges of a polygon that cross, or None. Within an area `least` a corner only touches."""
    ends = np.roll(corners, -1, axis=0)
    along = (ends - corners)[:, None]

    def left(points: np.ndarray) -> np.ndarray:
        """Return on which side (1, 0, -1) of each edge (row) each point (column) lies."""
        arm = points[None] - corners[:, None]
        twice_area = along[..., 0] * arm[..., 1] - along[..., 1] * arm[..., 0]
        return np.sign(np.where(np.abs(twice_area) > least, twice_area, 0.0))

    divided = left(corners) * left(ends) < 0  # the row's line runs between the ends of the column's edge
    pairs = np.argwhere(divided & divided.T)
    return (int(pairs[0, 0]), int(pairs[0, 1])) if len(pairs) else None
