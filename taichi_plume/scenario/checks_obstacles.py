"""Obstacles and sources that lie where they cannot be."""

from collections.abc import Iterator
from math import hypot
from pathlib import Path

import numpy as np

from taichi_plume.grid.meshes import MeshError
from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Prism, motion_of
from taichi_plume.scenario.resources import shape
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.species import Species
from taichi_plume.scenario.winds import UniformWind

MOST_EDGES = 500  # of a polygon whose edges are tested against one another
SLIVER = 1e-6  # of the square of a polygon's width: less area is none
FASTEST_BODY = 20.0  # m/s: the air does not count as incompressible much beyond
TOUCHING = 1e-9  # of the same: a corner this close to an edge lies on it


def shapes_of(scenario: Scenario, folder: Path) -> tuple[list[Shape | None], list[str]]:
    """The shapes of the obstacles, None where one cannot be made, and what is wrong with those."""
    shapes: list[Shape | None] = []
    lines = []
    for n, obstacle in enumerate(scenario.obstacles):
        try:
            shapes.append(shape(obstacle, scenario.domain, folder))
        except MeshError as error:
            shapes.append(None)
            lines.append(f"obstacles[{n}]: {error}")
    return shapes, lines


def problems(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    """What is wrong with obstacles and sources."""
    yield from _obstacles(scenario, shapes)
    yield from _sources(scenario, shapes)


def _obstacles(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    extent = np.array(scenario.domain.extent)
    if shapes and isinstance(scenario.wind, UniformWind):
        yield "wind.kind: a uniform wind blows through obstacles; use kind: cfd or synthetic, or remove the obstacles"
    for n, one in enumerate(shapes):
        if one is None:
            continue
        if isinstance(one.model, Prism):
            yield from _outline(f"obstacles[{n}].vertices", np.array(one.model.vertices))
        beyond = (one.high <= 0) | (one.low >= extent)
        if beyond.any():
            axis = int(beyond.argmax())
            yield (
                f"obstacles[{n}]: lies outside the domain: "
                f"{span('xyz'[axis], one.low[axis], one.high[axis])}, "
                f"the domain has {span('xyz'[axis], 0, extent[axis])}; move it in or remove it"
            )
        elif motion_of(one.model):
            yield from _motion(f"obstacles[{n}]", one, scenario.domain)


def _motion(path: str, one: Shape, domain: Domain) -> Iterator[str]:
    """A way has to stay in the domain, and the body be seen by the grid."""
    motion, center = motion_of(one.model), one.model.center
    for k, point in enumerate(motion.path):
        for axis, x in enumerate(point[1:]):
            if not 0 <= x <= domain.extent[axis]:
                yield (
                    f"{path}.motion.path[{k}]: {'xy'[axis]} = {x:g} m is outside the domain, "
                    f"{span('xy'[axis], 0, domain.extent[axis])}; keep the centre inside"
                )
                return
    if motion.loop and hypot(motion.path[-1][1] - center[0], motion.path[-1][2] - center[1]) > 1e-6:
        yield (
            f"{path}.motion.path[{len(motion.path) - 1}]: a loop must end at the center "
            f"({center[0]:g}, {center[1]:g}) m, got ({motion.path[-1][1]:g}, {motion.path[-1][2]:g}) m"
        )
    for k, (begin, end, speed) in enumerate(motion.legs(center)):
        if speed > FASTEST_BODY:
            yield (
                f"{path}.motion.path[{k}]: moves at {speed:.3g} m/s from {begin:g} to {end:g} s; "
                f"at most {FASTEST_BODY:g} m/s"
            )
            break
    width = float((one.high - one.low).min())
    if width < domain.spacing:
        yield (
            f"{path}: is {width:.3g} m thin, less than a cell of {domain.spacing:g} m, and would not move the air; "
            "make it larger or lower domain.spacing"
        )


def _outline(path: str, corners: np.ndarray) -> Iterator[str]:
    """A polygon, corners (n, 2) [m], has to have an inside and must not cross itself."""
    x, y = (corners - corners[0]).T
    area = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    width = float(np.ptp(corners, axis=0).max())
    crossing = _crossing(corners, TOUCHING * width**2) if len(corners) <= MOST_EDGES else None
    if crossing:
        first, second = crossing
        yield (
            f"{path}: the edge after vertex {first} crosses the edge after vertex {second}; "
            "list the corners in the order in which the outline meets them"
        )
    elif area <= SLIVER * width**2:
        yield f"{path}: the polygon has no area: its corners lie on a line or are out of order"


def _crossing(corners: np.ndarray, least: float) -> tuple[int, int] | None:
    """The first two edges of a polygon that cross. A corner and an edge that span less than `least` [m²] touch."""
    ends = np.roll(corners, -1, axis=0)
    along = (ends - corners)[:, None]

    def left(points: np.ndarray) -> np.ndarray:
        """On which side of each edge (row) each point (column) lies: 1, 0 or -1."""
        arm = points[None] - corners[:, None]
        twice_area = along[..., 0] * arm[..., 1] - along[..., 1] * arm[..., 0]
        return np.sign(np.where(np.abs(twice_area) > least, twice_area, 0.0))

    parted = left(corners) * left(ends) < 0  # the row's line runs between the ends of the column's edge
    pairs = np.argwhere(parted & parted.T)
    return (int(pairs[0, 0]), int(pairs[0, 1])) if len(pairs) else None


def span(axis: str, low: float, high: float) -> str:
    """Where something lies along an axis, in words."""
    return f"{axis} {low:.4g} to {high:.4g} m"


def _sources(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    for path, source in scenario.sources:
        yield from in_the_air(f"{path}.position", "source", source.position, scenario, shapes)
    names: dict[str, Species] = {}
    for path, gas in scenario.gases:
        other = names.setdefault(gas.vapour.name, gas.vapour)
        if other != gas.vapour:
            yield f"{path}.species.name: '{other.name}' is another species of this scenario; give it its own name"


def in_the_air(
    path: str, what: str, position: tuple[float, ...], scenario: Scenario, shapes: list[Shape | None]
) -> Iterator[str]:
    """A position has to be in the domain and outside of all obstacles."""
    extent = scenario.domain.extent
    outside = [a for a, x in enumerate(position) if not 0 <= x <= extent[a]]
    if outside:
        axis = "xyz"[outside[0]]
        yield (
            f"{path}: {axis} = {position[outside[0]]:g} m is outside the domain, "
            f"{span(axis, 0, extent[outside[0]])}; move the {what} in"
        )
        return
    for m, one in enumerate(shapes):
        if one is not None and one.inside(np.array([position]))[0]:
            place = ", ".join(f"{x:g}" for x in position)
            deep = -float(one.signed_distance(np.array([position]))[0])
            yield (
                f"{path}: ({place}) m is inside obstacles[{m}] ({one.model.kind}), "
                f"{deep:.3g} m below its surface; move the {what} or the obstacle"
            )
            return
