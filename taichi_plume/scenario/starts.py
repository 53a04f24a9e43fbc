"""Start positions of robots, and checks of their distances from walls, obstacles and each other."""

from collections.abc import Iterator
from math import inf, pi, sqrt
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from taichi_plume.grid.shapes import clearance_resolution
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, span
from taichi_plume.scenario.vocabulary import Model

if TYPE_CHECKING:
    from taichi_plume.scenario.bodies import Body

# Area fraction that randomly placed discs can cover (Feder 1980, doi:10.1016/0022-5193(80)90358-6)
RANDOM_PACKING = 0.547
GAP = 2e-3  # m, least air around a body at the start
ALTITUDE = 1.0  # m, of drones
NEIGHBOURS = 20  # of each robot, looked at for overlaps
FREE_AREA_NODES = 200  # per axis, to measure the free area of a start rectangle


class AnyStart(Model):
    """Base class of the starts: positions, headings and altitudes of the robots."""

    heading_deg: si.Angle | None = None
    """Heading of each robot at the start, from the x axis to the left; unless given, drawn at random."""
    altitude: si.Distance | None = None
    """Altitude of drones at the start, of the lower end of the body over the floor; unless given, 1 m. Search
    algorithms of the floor stay there."""

    @property
    def listed(self) -> np.ndarray:
        """Positions (n, 2) [m] that the scenario lists explicitly; none by default."""
        return np.empty((0, 2))

    def places(self, count: int) -> np.ndarray | None:
        """Return the start positions (count, 2) [m]; None if drawn at random, or if the list has another length."""
        return None

    def high_end(self, body: "Body") -> float:
        """Return the largest height [m] over the floor of the lower end of a robot's body at the start."""
        return self.low_end(body)

    def low_end(self, body: "Body") -> float:
        """Return the height [m] over the floor of the lower end of a robot's body at the start; 0 unless a drone."""
        if not body.flies:
            return 0.0
        return ALTITUDE if self.altitude is None else self.altitude

    def placement_errors(self, where: str, body: "Body", count: int, context: Context) -> Iterator[str]:
        """Yield errors of the start positions of `count` robots with this body; where: path of the start."""
        raise NotImplementedError


class StartAt(AnyStart):
    """Start at given positions."""

    kind: Literal["positions"]
    positions: Annotated[tuple[si.Point2, ...], Field(min_length=1)]
    """Positions, each [x, y], one per robot."""

    @property
    def listed(self) -> np.ndarray:
        return np.array(self.positions)

    def places(self, count: int) -> np.ndarray | None:
        return self.listed if len(self.positions) == count else None

    def placement_errors(self, where: str, body: "Body", count: int, context: Context) -> Iterator[str]:
        if len(self.positions) != count:
            yield f"{where}.positions: {len(self.positions)} given for {count} robots; give one position per robot"
        else:
            yield from touching(where, body, self.listed, context, self.low_end(body))


class StartLine(AnyStart):
    """Start on a line: robots at equal distances from `begin` to `end`."""

    kind: Literal["line"]
    begin: si.Point2
    """Position of the first robot, x and y."""
    end: si.Point2
    """Position of the last robot, x and y; the others are at equal distances between."""

    def places(self, count: int) -> np.ndarray:
        return np.linspace(self.begin, self.end, count)

    def placement_errors(self, where: str, body: "Body", count: int, context: Context) -> Iterator[str]:
        yield from touching(where, body, self.places(count), context, self.low_end(body))


class StartArea(AnyStart):
    """Start at random free positions in a rectangle."""

    kind: Literal["area"]
    low: si.Point2
    """Lower corner of the rectangle in which the centres are drawn, x and y."""
    high: si.Point2
    """Upper corner of the rectangle in which the centres are drawn, x and y."""
    highest: si.Distance | None = None
    """Largest altitude of drones at the start, drawn from `altitude` on; unless given, all have that altitude."""

    def high_end(self, body: "Body") -> float:
        return self.low_end(body) if not body.flies or self.highest is None else self.highest

    def placement_errors(self, where: str, body: "Body", count: int, context: Context) -> Iterator[str]:
        low, high = np.array(self.low), np.array(self.high)
        if (high < low).any():
            yield f"{where}.high: must not be below low, got {self.high} under {self.low}"
            return
        base, top = self.low_end(body), self.high_end(body)
        if top < base or (self.highest is not None and not body.flies):
            least = f"must be at least {base:g} m" if body.flies else "is for drones; remove it"
            yield f"{where}.highest: {self.highest:g} m; {least}"
            return
        floor = context.scenario.floor
        for key, corner in (("low", low), ("high", high)):
            for axis, x, least, most in zip("xy", corner, floor.low, floor.high, strict=True):
                if not least - 1e-9 <= x <= most + 1e-9:
                    yield f"{where}.{key}: {axis} = {x:g} m is not on the floor, {span(axis, least, most)}; move it in"
                    return
        from scipy import ndimage  # slow to import: only for this check

        radius = body.radius
        low, high = low - radius, high + radius  # extent of the discs
        steps = (high - low) / FREE_AREA_NODES
        axes = [low[a] + (np.arange(FREE_AREA_NODES) + 0.5) * steps[a] for a in range(2)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        slack = float(steps.max()) / 2
        free = ((nodes >= np.array(self.low) - slack) & (nodes <= np.array(self.high) + slack)).all(axis=-1)
        for _, _, distance, gap in clearances(nodes, top - base + body.height, context, base):
            free &= distance >= radius + gap - slack
        if not free.any():
            yield f"{where}: no robot fits anywhere in this area; move or enlarge it"
            return
        reached = ndimage.distance_transform_edt(~free, sampling=tuple(steps)) <= radius  # type: ignore[operator]
        area = float(reached.sum() * np.prod(steps))
        most = max(1, int(RANDOM_PACKING * area / (pi * radius**2)))
        if count > most:
            group = where.removesuffix(".start")
            yield (
                f"{group}.count: {count} robots of radius {radius:g} m do not fit at random into the start area, about "
                f"{most} do; lower it or enlarge {where}"
            )


Start = Annotated[StartAt | StartLine | StartArea, Field(discriminator="kind")]


def clearances(
    places: np.ndarray, height: float, context: Context, base: float = 0.0
) -> Iterator[tuple[str, str, np.ndarray, float]]:
    """Yield each wall and obstacle that a robot of this height, whose lower end is `base` [m] high, may touch.

    For each: the names of its surface and its inside, the distance [m] from positions (..., 2), negative inside, and
    the least gap [m], which is larger for obstacles because of the resolution of the clearance map.
    """
    floor = context.scenario.floor
    low, high = np.array(floor.low), np.array(floor.high)
    name = "wall" if context.scenario.arena is None else "edge of the arena"
    for axis in range(2):
        for side, distance in (("-", places[..., axis] - low[axis]), ("+", high[axis] - places[..., axis])):
            wall = f"the {name} {'xy'[axis]}{side}"
            yield wall, f"behind {wall}", distance, GAP
    spare = GAP + sqrt(2) * clearance_resolution(floor.size)
    for path, shape in context.shapes.items():
        distance, air = shape.horizontal_distance(places, base, base + height), spare
        if (
            shape.model.motion is not None and np.isfinite(distance).any()
        ):  # robots perceive moving obstacles as discs
            distance, air = np.linalg.norm(places - shape.model.center[:2], axis=-1) - shape.model.disc, GAP
        obstacle = f"{path} ({shape.model.kind})"
        yield f"the surface of {obstacle}", f"inside {obstacle}", distance, air


def touching(
    where: str, body: "Body", places: np.ndarray, context: Context, base: float = 0.0
) -> Iterator[str]:
    """Yield an error for each wall or obstacle that robots at these positions touch, about the worst of the robots."""
    for surface, beyond, distance, gap in clearances(places, body.height, context, base):
        least = body.radius + gap - 1e-9
        k = int(distance.argmin())
        if distance[k] < least:
            more = int((distance < least).sum()) - 1
            others = f" and {more} more touch it" if more else ""
            place = f"{abs(distance[k]):.3g} m from {surface}" if distance[k] >= 0 else beyond
            yield (
                f"{where}: robot {k} at ({places[k, 0]:g}, {places[k, 1]:g}) m is {place}"
                f"{others}; its centre must be {least:.3g} m or more away"
            )


def too_close(names: list[tuple[str, int]], discs: list[tuple[np.ndarray, float]]) -> Iterator[str]:
    """Yield an error about the two robots that overlap most, or nearly touch, at the start.

    names: path of the group and number within the group, per robot; discs: positions (n, 2) and radius [m], per group.
    """
    from scipy.spatial import cKDTree  # type: ignore[attr-defined]

    places = np.concatenate([p for p, _ in discs])
    radii = np.concatenate([np.full(len(p), r) for p, r in discs])
    _, first, same = np.unique(places, axis=0, return_index=True, return_inverse=True)
    twins = np.flatnonzero(first[same] != np.arange(len(places)))
    if len(twins):  # a tree is slow with many equal positions
        i, j = first[same[twins[0]]], twins[0]
    else:
        reach = 2 * radii.max() + GAP
        distance, near = cKDTree(places).query(places, k=NEIGHBOURS, distance_upper_bound=reach)
        near = np.minimum(near, len(places) - 1)  # missing neighbours have infinite distance
        overlap = radii[:, None] + radii[near] - distance
        overlap[near == np.arange(len(places))[:, None]] = -inf
        i, k = np.unravel_index(np.round(overlap, 9).argmax(), overlap.shape)
        j = near[i, k]
    apart, least = float(np.hypot(*(places[i] - places[j]))), radii[i] + radii[j] + GAP
    if i != j and apart < least - 1e-9:
        (path, robot), (other_path, other) = names[i], names[j]
        second = f"robot {other}" if other_path == path else f"{other_path} robot {other}"
        yield (
            f"{path}.start: robot {robot} and {second} are {apart:.3g} m apart, too close; their centres must be "
            f"{least:g} m apart or more"
        )
