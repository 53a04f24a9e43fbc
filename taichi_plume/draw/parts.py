"""Geometry of the drawn sections of a scenario: outlines, and handles by which a pointer changes the section.

A plane is a pair of axes, as of `report.theme`: (0, 1) from above, (0, 2) and (1, 2) from the side. Handles are named
points. A moved handle gives keys of the section new values in SI units.
"""

from collections.abc import Sequence
from math import hypot
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.draw.quantities import ROUNDED
from taichi_plume.grid.outlines import circle, rectangle
from taichi_plume.report.theme import ABOVE
from taichi_plume.scenario.domain import Arena, Domain
from taichi_plume.scenario.openings import Periodic
from taichi_plume.scenario.probes import ProbeGrid, ProbeLine
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.starts import StartArea, StartAt
from taichi_plume.scenario.windows import Window

Plane = tuple[int, int]
Point = tuple[float, float]
Values = dict[str, Any]
"""New values of keys of a section, by key or by path within the section."""
LEAST = 0.01  # m: a dragged edge stays this far from the opposite one
SIGNS = ((-1, -1), (1, -1), (1, 1), (-1, 1), (1, 0), (-1, 0), (0, 1), (0, -1))
"""Corners and edges of a rectangle, as signs along both axes."""


class Outline(NamedTuple):
    """Polygon (closed) or line of a drawing: corners (n, 2) [m]; rows of NaN stand between separate polygons."""

    points: np.ndarray
    closed: bool = True


class Part:
    """A drawn section. room: the extent of the domain [m]. within: where its keys are in the object's section.

    keys: those of the points of the section, or of its lists of points.
    """

    within = ""
    walks = False
    """Whether the section moves along a path."""

    def __init__(self, model: Any, room: tuple[float, ...], keys: Sequence[str] = ()):
        self.model, self.room, self.keys = model, room, keys
        self._drawn: dict[Plane, tuple[list[Outline], dict[str, Point]]] = {}

    @property
    def dim(self) -> int:
        """Number of dimensions of the scenario."""
        return len(self.room)

    @property
    def points(self) -> dict[str, Sequence[float]]:
        """Points of the section by their keys or, of a list, by their paths within the section."""
        given = {key: vars(self.model)[key] for key in self.keys}
        lists = {key: points for key, points in given.items() if isinstance(points[0], tuple)}
        listed = {f"{key}[{n}]": point for key in lists for n, point in enumerate(lists[key])}
        return {key: point for key, point in given.items() if key not in lists} | listed

    def drawn(self, plane: Plane) -> tuple[list[Outline], dict[str, Point]]:
        """Return the outlines and handles in a plane, computed once: a part does not change."""
        if plane not in self._drawn:
            self._drawn[plane] = self.outlines(plane), self.handles(plane)
        return self._drawn[plane]

    def outlines(self, plane: Plane) -> list[Outline]:
        """Return what is drawn in a plane."""
        return []

    def outline_at(self, t: float, plane: Plane) -> Outline:
        """Return the outline of a section that walks at time t [s] of a run."""
        return self.outlines(plane)[0]

    def handles(self, plane: Plane) -> dict[str, Point]:
        """Return the handles in a plane by their names; `center` moves the whole section."""
        return {}

    def moved(self, handle: str, plane: Plane, to: Point) -> Values:
        """Return the new values of keys once a handle has been dragged to a point of a plane."""
        if handle != "center" and handle in self.points:
            return {handle: _put(self.points[handle], plane, to)}
        x, y = self.handles(plane)["center"]
        shift = np.zeros(3)
        shift[list(plane)] = to[0] - x, to[1] - y
        return self.shifted(shift)

    def shifted(self, by: np.ndarray) -> Values:
        """Return the new values of keys once the section has been moved by a vector of three axes [m]."""
        return {key: moved_point(point, by) for key, point in self.points.items()}

    def measure(self, handle: str, plane: Plane) -> str:
        """Return the size [m] that a handle of an edge or a corner sets, or the position of another handle, as text."""
        if handle[0] in "+-":
            low, high = extent(self.outlines(plane))
            return size_text(high - low)
        return position_text(plane, self.handles(plane)[handle])


def extent(outlines: Sequence[Outline]) -> np.ndarray:
    """Return the lowest and highest coordinates (2, 2) [m] of the areas of an object; without areas, of its lines."""
    points = np.concatenate([o.points for o in outlines if o.closed] or [o.points for o in outlines])
    return np.array([np.nanmin(points, axis=0), np.nanmax(points, axis=0)])


def position_text(plane: Plane, at: Point) -> str:
    """Return a position [m] in a plane as text, such as "x 1.20 y 0.80 m"."""
    return " ".join(f"{'xyz'[axis]} {x:.2f}" for axis, x in zip(plane, at, strict=True)) + " m"


def size_text(size: Any) -> str:
    """Return a size [m] as text, such as "0.40 × 0.60 m"; a window seen edge on has one number."""
    return " × ".join(f"{abs(x):.2f}" for x in size if abs(x) >= ROUNDED) + " m"


def edges_of(low: Sequence[float], high: Sequence[float]) -> dict[str, Point]:
    """Return the handles of a rectangle: `center`, its corners and the middles of its edges."""
    middle, half = (np.array(low) + high) / 2, (np.array(high) - low) / 2
    return {"center": pair(middle)} | {f"{a:+d}{b:+d}": pair(middle + half * (a, b)) for a, b in SIGNS}


def dragged(
    low: Sequence[float], high: Sequence[float], handle: str, to: Point
) -> tuple[list[float], list[float]]:
    """Return the corners of a rectangle of which a corner or an edge has been dragged to a point."""
    new_low, new_high = [float(x) for x in low], [float(x) for x in high]
    for n, sign in enumerate((int(handle[:2]), int(handle[2:]))):
        if sign > 0:
            new_high[n] = max(float(to[n]), new_low[n] + LEAST)
        if sign < 0:
            new_low[n] = min(float(to[n]), new_high[n] - LEAST)
    return new_low, new_high


def pair(point: Any) -> Point:
    """Return the first two numbers of a point as floats."""
    return float(point[0]), float(point[1])


def moved_point(point: Sequence[float], by: np.ndarray) -> list[float]:
    """Return a point moved by a vector [m]."""
    return [float(x + d) for x, d in zip(point, by, strict=False)]


def nearest_wall(at: Point, room: Sequence[float]) -> str:
    """Return the face of the room, x-, x+, y- or y+, whose plane is nearest to a point from above."""
    away = {"x-": at[0], "x+": room[0] - at[0], "y-": at[1], "y+": room[1] - at[1]}
    return min(away, key=lambda face: abs(away[face]))


def _put(point: Sequence[float], plane: Plane, to: Point) -> list[float]:
    """Return a point of the room with its coordinates in a plane replaced, as far as the point has them."""
    new = [float(x) for x in point]
    for axis, x in zip(plane, to, strict=True):
        if axis < len(new):
            new[axis] = float(x)
    return new


# ---------------------------------------------------------------- room and rectangles


class Room(Part):
    """The domain: its far edges are handles."""

    model: Domain

    def outlines(self, plane: Plane) -> list[Outline]:
        return [Outline(rectangle((0, 0), [self.room[d] for d in plane]))]

    def handles(self, plane: Plane) -> dict[str, Point]:
        a, b = (self.model.size[d] for d in plane)
        return {"+1+0": (a, b / 2), "+0+1": (a / 2, b), "+1+1": (a, b)}

    def moved(self, handle: str, plane: Plane, to: Point) -> Values:
        size = [float(x) for x in self.model.size]
        for n, axis in enumerate(plane):
            if int(handle[2 * n : 2 * n + 2]):
                size[axis] = max(float(to[n]), 2 * self.model.spacing)
        return {"size": size}


class Rectangle(Part):
    """Sections with the corners `low` and `high`: the arena, the area of a start, a lattice of probes."""

    model: Arena | StartArea | ProbeGrid

    def __init__(self, model: Any, room: tuple[float, ...]):
        super().__init__(model, room, ("low", "high"))

    def _corners(self, plane: Plane) -> tuple[list[float], list[float]] | None:
        low, high = self.model.low, self.model.high
        return None if max(plane) >= len(low) else ([low[d] for d in plane], [high[d] for d in plane])

    def outlines(self, plane: Plane) -> list[Outline]:
        corners = self._corners(plane)
        return [Outline(rectangle(*corners))] if corners else []

    def handles(self, plane: Plane) -> dict[str, Point]:
        corners = self._corners(plane)
        return edges_of(*corners) if corners else {}

    def moved(self, handle: str, plane: Plane, to: Point) -> Values:
        corners = self._corners(plane)
        if handle == "center" or corners is None:
            return super().moved(handle, plane, to)
        low, high = dragged(*corners, handle, to)
        return {
            "low": _put(self.model.low, plane, pair(low)),
            "high": _put(self.model.high, plane, pair(high)),
        }


# ---------------------------------------------------------------- openings, screens, tempered walls


class Pane(Part):
    """A window on a wall or across the room: seen edge on it is a line with ends, else a rectangle or a disc."""

    model: Window

    def _sides(self, plane: Plane) -> tuple[list[float], list[float]]:
        """Return the corners of the window in a plane; on its normal axis both are the level of the window."""
        center, half = self.model.rectangle(self.room)
        middle = dict(zip(self.model.along(self.dim), zip(center, half, strict=False), strict=False))
        middle[self.model.normal] = self.model.level(self.room), 0.0
        return [middle[d][0] - middle[d][1] for d in plane], [middle[d][0] + middle[d][1] for d in plane]

    def outlines(self, plane: Plane) -> list[Outline]:
        points = self.model.outline(self.room, plane)
        return [Outline(points, len(points) > 2)]

    def handles(self, plane: Plane) -> dict[str, Point]:
        handles = edges_of(*self._sides(plane))
        if self.model.normal not in plane:
            return handles
        first = plane[0] == self.model.normal
        return {
            name: handles[name] for name in ("center", *(("+0+1", "+0-1") if first else ("+1+0", "-1+0")))
        }

    def moved(self, handle: str, plane: Plane, to: Point) -> Values:
        face = vars(self.model).get("face")
        if handle == "center" and plane == ABOVE and face is not None and face[0] != "z":
            wall = nearest_wall(to, self.room)
            if wall != face:
                return self._on(wall, to)
        low, high = self._sides(plane)
        if handle == "center":
            shift = np.subtract(to, self.handles(plane)["center"])
            low, high = list(low + shift), list(high + shift)
        else:
            low, high = dragged(low, high, handle, to)
        values: Values = {}
        if hasattr(self.model, "at") and self.model.normal in plane and handle == "center":
            values["at"] = float(to[plane.index(self.model.normal)])
        if self.model.center is None and handle == "center":
            return values  # a whole wall has nowhere to go
        center, half = (list(map(float, part)) for part in self.model.rectangle(self.room))
        for n, axis in enumerate(self.model.along(self.dim)):
            if axis in plane:
                a, b, most = low[plane.index(axis)], high[plane.index(axis)], self.room[axis]
                if handle != "center":
                    a, b = max(a, 0.0), min(b, most)
                half[n] = (b - a) / 2
                center[n] = min(max(a, 0.0), max(0.0, most - 2 * half[n])) + half[n]
        return values | {"center": center, **self._size(half)}

    def _size(self, half: Sequence[float]) -> Values:
        """Return the key of the size for half widths [m], of which one may have been changed."""
        if self.model.diameter is None:
            return {"size": [2 * h for h in half]}
        before = float(self.model.diameter) / 2
        return {"diameter": 2 * max(half, key=lambda h: abs(h - before))}

    def _on(self, wall: str, to: Point) -> Values:
        """Return the new values of keys on another wall: as wide as before, or as the wall; heights stay."""
        if self.model.center is None:
            return {"face": wall}
        axis = 1 if wall[0] == "x" else 0
        center, half = (list(map(float, part)) for part in self.model.rectangle(self.room))
        half[0] = min(half[0], self.room[axis] / 2)
        center[0] = min(max(float(to[axis]), half[0]), self.room[axis] - half[0])
        return {"face": wall, "center": center, **self._size(half)}


class Wrapped(Part):
    """A periodic axis: a line along both of its faces."""

    model: Periodic

    def outlines(self, plane: Plane) -> list[Outline]:
        faces = self.model.faces if self.model.faces[0].normal in plane else ()
        return [Outline(face.outline(self.room, plane), False) for face in faces]


# ---------------------------------------------------------------- points


class Points(Part):
    """Points by their keys: a source, a heater, a probe, the ends of a line of probes or robots, or listed positions.

    places: of the drawn discs [m], by default those of the points; radius: of the discs [m], unless the section has its
    own; base: height of the discs' lower end and of the bodies [m].
    """

    def __init__(
        self,
        model: Any,
        room: tuple[float, ...],
        keys: Sequence[str],
        places: Any = None,
        radius: float | None = None,
        base: Point = (0, 0),
    ):
        super().__init__(model, room, keys)
        self.rim = vars(model).get("radius")
        self.radius = self.rim or radius or 0.02 * min(room[:2])
        self.base = base
        self.places = np.array(list(self.points.values()) if places is None else places)
        self.motion = vars(model).get("motion")
        self.walks = self.motion is not None

    @property
    def _way(self) -> dict[str, Sequence[float]]:
        """Way points (dim,) [m] of a source that moves, by their handles."""
        return {f"way {n}": point[1:] for n, point in enumerate(self.motion.path)} if self.motion else {}

    def outline_at(self, t: float, plane: Plane) -> Outline:
        return Outline(circle(self.model.places(t)[[*plane]], self.radius))

    def outlines(self, plane: Plane) -> list[Outline]:
        if self.places.shape[1] > max(plane):
            discs = [circle(place[[*plane]], self.radius) for place in self.places]
        else:
            low, height = self.base
            discs = [
                rectangle((x - self.radius, low), (x + self.radius, low + height))
                for x in self.places[:, plane[0]]
            ]
        ends = [self._seen(end, plane) for end in (*self.points.values(), *self._way.values())]
        is_line = len(self.keys) == 2 or self.walks
        return [*map(Outline, discs), *([Outline(np.array(ends), False)] if is_line else [])]

    def _seen(self, point: Sequence[float], plane: Plane) -> Point:
        return pair([point[d] if d < len(point) else self.base[0] for d in plane])

    def handles(self, plane: Plane) -> dict[str, Point]:
        seen = {name: self._seen(end, plane) for name, end in self.points.items()}
        x, y = pair(np.mean(list(seen.values()), axis=0))
        # of handles at one place the first counts: the middle one of three robots can be moved alone
        handles = {**(seen if len(seen) > 1 else {}), "center": (x, y)}
        handles |= {name: self._seen(point, plane) for name, point in self._way.items()}
        return handles | ({"rim": (x + self.rim, y)} if self.rim else {})

    def measure(self, handle: str, plane: Plane) -> str:
        return f"radius {self.rim:.2f} m" if handle == "rim" else super().measure(handle, plane)

    def moved(self, handle: str, plane: Plane, to: Point) -> Values:
        if handle == "rim":
            x, y = self.handles(plane)["center"]
            return {"radius": max(LEAST, hypot(to[0] - x, to[1] - y))}
        if handle in self._way:
            put = zip(plane, to, strict=True)
            return {f"motion.path[{handle[4:]}][{1 + axis}]": float(x) for axis, x in put}
        return super().moved(handle, plane, to)

    def shifted(self, by: np.ndarray) -> Values:
        values = super().shifted(by)
        for n, point in enumerate(self._way.values()):
            values |= {f"motion.path[{n}][{1 + d}]": x for d, x in enumerate(moved_point(point, by))}
        return values


def start_part(group: Group | None, start: Any, room: tuple[float, ...]) -> Part:
    """Return the part of a group's start; of a group with faults elsewhere (None), robots of 10 cm are drawn."""
    radius = group.body.radius if group is not None else 0.1
    base = (group.start_altitude, group.body.height) if group is not None else (0.0, 0.2)
    if isinstance(start, StartArea):
        part: Part = Rectangle(start, room)
    elif isinstance(start, StartAt):
        part = Points(start, room, ("positions",), start.listed, radius, base)
    else:
        places = start.places(group.count if group is not None else 2)
        part = Points(start, room, ("begin", "end"), places, radius, base)
    part.within = ".start"
    return part


def probe_part(probe: Any, room: tuple[float, ...]) -> Part:
    """Return the part of a probe: a point, a line of points or a lattice."""
    if isinstance(probe, ProbeGrid):
        return Rectangle(probe, room)
    is_line = isinstance(probe, ProbeLine)
    return Points(probe, room, probe.what, probe.places, (0.01 if is_line else 0.02) * min(room[:2]))
