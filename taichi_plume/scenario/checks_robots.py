"""Robots that do not fit where they start."""

from collections.abc import Iterator
from math import inf, pi, sqrt
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree  # type: ignore[attr-defined]

from taichi_plume.files.own_class import OwnAlgorithmError, own_class
from taichi_plume.grid.clearance import clearance_resolution
from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario.algorithms import Own
from taichi_plume.scenario.robots import Arena, Group, StartArea, StartAt, StartLine
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import UniformWind

# Share that discs put down at random can cover (Feder 1980, doi:10.1016/0022-5193(80)90358-6)
RANDOM_PACKING = 0.547
START_ROOM = 2e-3  # m, air around a body at the start
NEIGHBOURS = 20  # of each robot, looked at for overlaps
FREE_AREA_NODES = 200  # per axis, to measure the free area of a start rectangle


def own_algorithms(scenario: Scenario, folder: Path) -> Iterator[str]:
    """Files that hold no algorithm."""
    for n, group in enumerate(scenario.robots):
        if isinstance(group.algorithm, Own) and group.algorithm.file:
            try:
                own_class(folder / group.algorithm.file, group.algorithm.name)
            except OwnAlgorithmError as error:
                yield f"robots[{n}].algorithm.file: {error}"


def problems(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    """What is wrong with the robots' bodies, sensors and places."""
    domain, floor = scenario.domain, scenario.floor
    if scenario.arena is not None:
        reason = _arena(scenario.arena, domain.extent)
        if reason:
            yield reason
            return
    width = min(floor.size)
    names: list[tuple[str, int]] = []
    discs: list[tuple[np.ndarray, float]] = []
    for n, group in enumerate(scenario.robots):
        path = f"robots[{n}]"
        if 2 * group.body.radius > width:
            yield (
                f"{path}.body.radius: a robot {2 * group.body.radius:g} m wide does not fit on a floor "
                f"{width:g} m wide; make the body smaller"
            )
            continue
        most = int(floor.size[0] * floor.size[1] / (pi * group.body.radius**2))
        if group.count > most:
            yield (
                f"{path}.count: {group.count} robots of radius {group.body.radius:g} m do not fit on "
                f"the floor; use fewer than {most} or a smaller body"
            )
            continue
        if group.wake:
            yield from _wake(path, group, scenario)
        if domain.dim == 3:
            yield from _heights(path, group, domain.extent[2])
        if isinstance(group.start, StartArea):
            yield from _free_area(path, group, group.start, scenario, shapes)
            continue
        if isinstance(group.start, StartAt):
            if len(group.start.positions) != group.count:
                yield (
                    f"{path}.start.positions: has {len(group.start.positions)} places for "
                    f"count: {group.count}; give one place per robot"
                )
                continue
            places = np.array(group.start.positions)
        else:
            places = _on_line(group.start, group.count)
        yield from _touching(path, group, places, scenario, shapes)
        yield from _found_at_once(path, group, places, scenario)
        names += [(path, k) for k in range(group.count)]
        discs.append((places, group.body.radius))
        if scenario.rivals:
            yield from _too_close(names, discs)
            names, discs = [], []
    if discs:
        yield from _too_close(names, discs)


def _arena(arena: Arena, extent: tuple[float, ...]) -> str | None:
    """What is wrong with the part of the floor for the robots."""
    for axis in range(2):
        low, high = arena.low[axis], arena.high[axis]
        if not 0 <= low < high <= extent[axis] + 1e-9:
            return (
                f"arena: along {'xy'[axis]} low must be below high, both on the floor from 0 to {extent[axis]:g} m, "
                f"got {low:g} and {high:g} m"
            )
    return None


def _wake(path: str, group: Group, scenario: Scenario) -> Iterator[str]:
    """The air is one: robots that move it cannot be in several trials at once."""
    if isinstance(scenario.wind, UniformWind):
        yield f"{path}.wake: a uniform wind is not disturbed; use wind.kind: cfd, or remove the wake"
    for n, other in enumerate(scenario.robots):
        if other.trials > 1:
            yield (
                f"{path}.wake: robots[{n}] has {other.trials} trials in the same air, and a wake would be felt "
                "in all of them; use trials: 1, or remove the wake"
            )
            return
    sensors = {"gas": group.sensors.gas.height, "wind": group.sensors.wind.height}
    for name, height in sensors.items():
        if scenario.domain.dim == 3 and height <= group.body.height:
            yield (
                f"{path}.sensors.{name}.height: {height:g} m is inside the body, where with a wake there is no wind; "
                f"put it above body.height = {group.body.height:g} m, or remove the wake"
            )
    if 2 * group.body.radius < scenario.domain.spacing:
        yield (
            f"{path}.wake: a body {2 * group.body.radius:g} m wide is smaller than a cell of "
            f"{scenario.domain.spacing:g} m and would not move the air; lower domain.spacing or remove the wake"
        )


def _heights(path: str, group: Group, ceiling: float) -> Iterator[str]:
    heights = {
        "body.height": group.body.height,
        "sensors.gas.height": group.sensors.gas.height,
        "sensors.wind.height": group.sensors.wind.height,
    }
    for key, height in heights.items():
        if height > ceiling:
            yield f"{path}.{key}: {height:g} m is above the ceiling of the domain; use at most {ceiling:g} m"


def _on_line(start: StartLine, count: int) -> np.ndarray:
    share = np.linspace(0.0, 1.0, count)[:, None]
    return (1 - share) * np.array(start.begin) + share * np.array(start.end)


def _clearance(
    places: np.ndarray, height: float, scenario: Scenario, shapes: list[Shape | None]
) -> Iterator[tuple[str, str, np.ndarray, float]]:
    """What a body of this height may touch: its surface, what is beyond, distance [m] from places (..., 2), negative
    beyond, and air to leave [m].

    Robots know obstacles by their clearance map, which gives away a little more.
    """
    low, high = np.array(scenario.floor.low), np.array(scenario.floor.high)
    name = "wall" if scenario.arena is None else "edge of the arena"
    for axis in range(2):
        for side, distance in (("-", places[..., axis] - low[axis]), ("+", high[axis] - places[..., axis])):
            wall = f"the {name} {'xy'[axis]}{side}"
            yield wall, f"behind {wall}", distance, START_ROOM
    room = START_ROOM + sqrt(2) * clearance_resolution(scenario.floor.size)
    for n, one in enumerate(shapes):
        if one is not None:
            distance = one.horizontal_distance(places, 0.0, height)
            obstacle = f"obstacles[{n}] ({one.model.kind})"
            yield f"the surface of {obstacle}", f"inside {obstacle}", distance, room


def _touching(
    path: str, group: Group, places: np.ndarray, scenario: Scenario, shapes: list[Shape | None]
) -> Iterator[str]:
    """Robots that start in a wall or an obstacle: the worst one of each."""
    for surface, beyond, distance, room in _clearance(places, group.body.height, scenario, shapes):
        wanted = group.body.radius + room - 1e-9
        k = int(distance.argmin())
        if distance[k] < wanted:
            more = int((distance < wanted).sum()) - 1
            others = f" and {more} more touch it" if more else ""
            where = f"{abs(distance[k]):.3g} m from {surface}" if distance[k] >= 0 else beyond
            yield (
                f"{path}.start: robot {k} at ({places[k, 0]:g}, {places[k, 1]:g}) m is {where}"
                f"{others}; its centre must be {wanted:.3g} m or more away"
            )


def _found_at_once(path: str, group: Group, places: np.ndarray, scenario: Scenario) -> Iterator[str]:
    """A robot that starts within reach of a source would have nothing to search; the first one."""
    for source_path, source in scenario.sources:
        apart = np.linalg.norm(places - np.array(source.position[:2]), axis=1)
        near = np.flatnonzero(apart <= group.reach)
        if len(near):
            k = near[0]
            yield (
                f"{path}.start: robot {k} at ({places[k, 0]:g}, {places[k, 1]:g}) m is {apart[k]:.3g} m from "
                f"{source_path} and would count as found at once; start it more than {path}.reach = "
                f"{group.reach:g} m away, or lower the reach"
            )
            return


def _too_close(names: list[tuple[str, int]], discs: list[tuple[np.ndarray, float]]) -> Iterator[str]:
    """The two robots that overlap most, or all but touch.

    names: path of the group and number in it, per robot. discs: places (n, 2) and radius [m], per group.
    """
    places = np.concatenate([p for p, _ in discs])
    radii = np.concatenate([np.full(len(p), r) for p, r in discs])
    _, first, same = np.unique(places, axis=0, return_index=True, return_inverse=True)
    twins = np.flatnonzero(first[same] != np.arange(len(places)))
    if len(twins):  # a tree is slow where many places are one
        i, j = first[same[twins[0]]], twins[0]
    else:
        reach = 2 * radii.max() + START_ROOM
        distance, near = cKDTree(places).query(places, k=NEIGHBOURS, distance_upper_bound=reach)
        near = np.minimum(near, len(places) - 1)  # where there are fewer, the distance is infinite
        overlap = radii[:, None] + radii[near] - distance
        overlap[near == np.arange(len(places))[:, None]] = -inf
        i, k = np.unravel_index(np.round(overlap, 9).argmax(), overlap.shape)
        j = near[i, k]
    apart, least = float(np.hypot(*(places[i] - places[j]))), radii[i] + radii[j] + START_ROOM
    if i != j and apart < least - 1e-9:
        (path, one), (other_path, other) = names[i], names[j]
        second = f"robot {other}" if other_path == path else f"{other_path} robot {other}"
        yield (
            f"{path}.start: robot {one} and {second} are {apart:.3g} m apart, too close; "
            f"their centres must be {least:g} m apart or more"
        )


def _free_area(
    path: str, group: Group, start: StartArea, scenario: Scenario, shapes: list[Shape | None]
) -> Iterator[str]:
    """Whether so many discs can be put down at random where their centres may be."""
    low, high = np.array(start.low), np.array(start.high)
    if (high < low).any():
        yield f"{path}.start.high: must not be below low, got {start.high} under {start.low}"
        return
    radius = group.body.radius
    low, high = low - radius, high + radius  # where the discs may reach
    steps = (high - low) / FREE_AREA_NODES
    axes = [low[a] + (np.arange(FREE_AREA_NODES) + 0.5) * steps[a] for a in range(2)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    slack = float(steps.max()) / 2
    free = ((nodes >= np.array(start.low) - slack) & (nodes <= np.array(start.high) + slack)).all(axis=-1)
    for _, _, distance, room in _clearance(nodes, group.body.height, scenario, shapes):
        free &= distance >= radius + room - slack
    if not free.any():
        yield f"{path}.start: no robot fits anywhere in this area; move or enlarge it"
        return
    reached = ndimage.distance_transform_edt(~free, sampling=tuple(steps)) <= radius  # type: ignore[operator]
    area = float(reached.sum() * np.prod(steps))
    room = max(1, int(RANDOM_PACKING * area / (pi * radius**2)))
    if group.count > room:
        yield (
            f"{path}.count: {group.count} robots of radius {radius:g} m do not fit at random places of the "
            f"start area, there is room for about {room}; lower the count or enlarge {path}.start"
        )
