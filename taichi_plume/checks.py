"""What is wrong with a scenario beyond single keys: dimensions, geometry, air that cannot get out, memory.

Every fault is one line: the YAML path, what is wrong, what would be right.
"""

from collections.abc import Iterator
from itertools import pairwise
from math import ceil, floor, hypot, inf, log10, pi, prod, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from scipy import ndimage
from scipy.spatial import cKDTree  # type: ignore[attr-defined]

from taichi_plume.checks_dishes import dishes
from taichi_plume.cut_cells import air_of
from taichi_plume.gases import PlaybackGas
from taichi_plume.geometry import MeshError, Shape, clearance_resolution, shape
from taichi_plume.grid import Grid
from taichi_plume.obstacles import Box, Obstacle, Prism, Sphere, motion_of
from taichi_plume.robots import Group, StartArea, StartAt, StartLine
from taichi_plume.scenario import Domain, Scenario
from taichi_plume.species import Species
from taichi_plume.winds import (
    Buoyancy,
    CfdWind,
    Fan,
    FrozenWind,
    Heat,
    Jet,
    MovingWall,
    Opening,
    Outlet,
    Periodic,
    Playback,
    Region,
    Screen,
    SyntheticWind,
    UniformWind,
    Vent,
    Window,
)

BYTES_PER_CELL = {2: 264, 3: 204}  # all fields of a CFD run with one gas
BYTES_PER_GAS = 16  # and cell, of every further gas
BYTES_OF_FACTORS = 700  # per cell of a 2-D flow solved by sparse factors, at 10⁵ cells; it grows slowly
BYTES_PER_ROBOT = 2000  # state, readings and a few minutes of track
MOST_MAP_CELLS = 4_000_000
CELL_STEPS_PER_SECOND = {2: 1.5e6, 3: 2e6}  # rough: wind and gas on a few CPU cores
GUST = 3.5  # largest sum of |u| over the axes, over the largest prescribed speed: 1.2 to 3.7 in the shipped scenarios
ROUNDING = 0.1  # of an extent: more is a scenario for another domain than the one written
# Share that discs put down at random can cover (Feder 1980, doi:10.1016/0022-5193(80)90358-6)
RANDOM_PACKING = 0.547
START_ROOM = 2e-3  # m, air around a body at the start
NEIGHBOURS = 20  # of each robot, looked at for overlaps
FREE_AREA_NODES = 200  # per axis, to measure the free area of a start rectangle
MOST_EDGES = 500  # of a polygon whose edges are tested against one another
SLIVER = 1e-6  # of the square of a polygon's width: less area is none
FASTEST_BODY = 20.0  # m/s: the air does not count as incompressible much beyond
TOUCHING = 1e-9  # of the same: a corner this close to an edge lies on it


def problems(scenario: Scenario, folder: Path) -> list[str]:
    """All faults as lines ``path: message``; `folder` is where mesh files lie.

    Wrong dimensions or sizes are told alone, and so are films: the other checks need them right.
    """
    for part in (_dimensions, _sizes):
        lines = list(part(scenario))
        if lines:
            return lines
    shapes, lines = _shapes(scenario, folder)
    films = list(_films(scenario, folder, shapes))
    if films:
        return lines + films
    if any(isinstance(gas, PlaybackGas) for _, gas in scenario.gases):
        from taichi_plume.film import completed

        scenario = completed(scenario, folder)
    lines += dishes(scenario)
    for part in (_obstacles, _sources, _robots):
        lines += part(scenario, shapes)
    lines += [*_names(scenario), *_eddies(scenario)]
    lines += _heat(scenario, shapes)
    lines += _screens(scenario)
    openings = list(_openings(scenario, shapes)) or list(_net_inflow(scenario))
    return lines + openings + list(_recording(scenario)) + list(_frozen(scenario)) + list(_fields(scenario))


def estimate(scenario: Scenario) -> dict[str, float]:
    """Rough size of a run: cells, bytes, steps of the flow, and seconds it takes on a few CPU cores."""
    domain, wind = scenario.domain, scenario.wind
    cells = prod(domain.shape)
    whole = scenario.warm_up + scenario.duration
    speed, courant, moving = 0.0, 1.0, whole
    if isinstance(wind, UniformWind):
        speed = sum(abs(v) for v in wind.velocity)
    elif isinstance(wind, SyntheticWind):
        speed = GUST * hypot(wind.speed, wind.circulation)
    elif isinstance(wind, CfdWind):
        speed, courant = GUST * _largest_speed(wind, scenario.obstacles, domain), wind.courant
    if isinstance(wind, FrozenWind):
        moving = min(whole, wind.after)
    substeps = max(1, ceil(scenario.tick * speed / (courant * domain.spacing) - 1e-9))
    steps = ceil(whole / scenario.tick - 1e-9) + (substeps - 1) * ceil(moving / scenario.tick - 1e-9)
    return {
        "cells": cells,
        "bytes": _bytes(scenario, cells),
        "steps": steps,
        "wall_s": cells * steps / CELL_STEPS_PER_SECOND[domain.dim],
    }


def _largest_speed(wind: CfdWind, obstacles: tuple[Obstacle, ...], domain: Domain) -> float:
    speeds = [0.0]
    for one in obstacles:
        motion = motion_of(one)
        if motion:
            speeds += [speed for _, _, speed in motion.legs(one.center)]
    for opening in wind.openings:
        if isinstance(opening, Jet):
            if isinstance(opening, Fan) and opening.curve:
                speeds.append(opening.curve.flow / opening.area(domain.extent, domain.depth))
            speeds += [abs(opening.speed or 0.0), *(abs(step.speed) for step in opening.schedule)]
        elif isinstance(opening, MovingWall):
            speeds.append(hypot(*opening.velocity))
    if wind.buoyancy is not None and wind.buoyancy.heat is not None:
        speeds.append(_fall(wind.buoyancy.heat, max(domain.extent)))
    return max(speeds)


def _fall(heat: Heat, length: float) -> float:
    """Speed [m/s] that air a few kelvin apart gains over a length [m], or above a heater."""
    surfaces = [*heat.walls, *heat.obstacles]
    differences = [abs(surface.temperature - heat.reference) for surface in surfaces]
    lift = 9.81 * heat.volume_expansion
    power = max((abs(heater.power) for heater in heat.heaters), default=0.0)
    return max(
        sqrt(lift * max(differences, default=0.0) * length),
        (lift * power / (heat.capacity * length)) ** (1 / 3),
    )


def _bytes(scenario: Scenario, cells: float) -> float:
    robots = sum(group.count * group.trials for group in scenario.robots)
    per_cell = BYTES_PER_CELL[scenario.domain.dim] + (BYTES_OF_FACTORS if _has_factors(scenario) else 0)
    per_cell += BYTES_PER_GAS * (len(scenario.gases) - 1)
    return cells * per_cell + robots * BYTES_PER_ROBOT


def _has_factors(scenario: Scenario) -> bool:
    """Whether a 2-D flow is too irregular for fast transforms: obstacles, or faces of the domain open in part."""
    if scenario.domain.dim == 3 or not isinstance(scenario.wind, CfdWind):
        return False
    lets_out = (
        o for o in scenario.wind.openings if isinstance(o, Outlet) or (isinstance(o, Jet) and not o.blows)
    )
    standing = any(motion_of(one) is None for one in scenario.obstacles)
    return standing or any(opening.center is not None for opening in lets_out)


# ---------------------------------------------------------------- numbers of coordinates, sizes


def _dimensions(scenario: Scenario) -> Iterator[str]:
    dim = scenario.domain.dim
    found: list[tuple[str, tuple[float, ...] | None, int]] = []
    for n, obstacle in enumerate(scenario.obstacles):
        if isinstance(obstacle, Box | Sphere):
            found.append((f"obstacles[{n}].center", obstacle.center, dim))
        if isinstance(obstacle, Box):
            found.append((f"obstacles[{n}].size", obstacle.size, dim))
    for path, source in scenario.sources:
        found.append((f"{path}.position", source.position, dim))
    wind = scenario.wind
    if isinstance(wind, UniformWind):
        found.append(("wind.velocity", wind.velocity, dim))
    elif isinstance(wind, CfdWind):
        found.append(("wind.acceleration", wind.acceleration, dim))
    buoyancy = _buoyancy_of(scenario)
    if buoyancy is not None:
        found.append(("wind.buoyancy.gravity", buoyancy.gravity, dim))
        if dim == 2 and buoyancy.gravity is None:
            yield (
                "wind.buoyancy.gravity: is missing; a 2-D run is a view from above, give [0, -9.81] to make it an "
                "upright section"
            )
        if buoyancy.gravity is not None and not any(buoyancy.gravity):
            yield "wind.buoyancy.gravity: is zero, so nothing rises or sinks; give it a size or remove wind.buoyancy"
        yield from _heat_dimensions(buoyancy.heat, dim, found)
    for n, opening in enumerate(_openings_of(scenario)):
        where = f"wind.openings[{n}]"
        if isinstance(opening, Region):
            found += [(f"{where}.center", opening.center, dim - 1), (f"{where}.size", opening.size, dim - 1)]
        if isinstance(opening, MovingWall):
            found.append((f"{where}.velocity", opening.velocity, dim))
        if dim == 2 and isinstance(opening, Region) and opening.face[0] == "z":
            yield f"{where}.face: '{opening.face}' does not exist in a 2-D run; use x-, x+, y- or y+"
        if dim == 2 and isinstance(opening, Periodic) and opening.axis == "z":
            yield f"{where}.axis: 'z' does not exist in a 2-D run; use x or y"
        if dim == 2 and isinstance(opening, Fan) and opening.swirl != 0:
            yield f"{where}.swirl: a 2-D run has no swirl; remove it, or give domain.size three numbers"
    for n, screen in enumerate(_screens_of(scenario)):
        where = f"wind.screens[{n}]"
        found += [(f"{where}.center", screen.center, dim - 1), (f"{where}.size", screen.size, dim - 1)]
        if dim == 2 and screen.axis == "z":
            yield f"{where}.axis: 'z' does not exist in a 2-D run; use x or y"
    for path, value, wanted in found:
        if value is not None and len(value) != wanted:
            yield f"{path}: has {_numbers(len(value))}, a {dim}-D run takes {wanted} here"


def _heat_dimensions(
    heat: Heat | None, dim: int, found: list[tuple[str, tuple[float, ...] | None, int]]
) -> Iterator[str]:
    """Faces that do not exist; adds the vectors of heaters and walls to `found`."""
    for n, heater in enumerate(heat.heaters if heat else ()):
        found.append((f"wind.buoyancy.heat.heaters[{n}].position", heater.position, dim))
    for n, wall in enumerate(heat.walls if heat else ()):
        where = f"wind.buoyancy.heat.walls[{n}]"
        found += [(f"{where}.center", wall.center, dim - 1), (f"{where}.size", wall.size, dim - 1)]
        if dim == 2 and wall.face[0] == "z":
            yield f"{where}.face: '{wall.face}' does not exist in a 2-D run; use x-, x+, y- or y+"


def _numbers(n: int) -> str:
    return f"{n} number{'s' * (n > 1)}"


def _sizes(scenario: Scenario) -> Iterator[str]:
    """Cells and memory; nothing here allocates."""
    domain = scenario.domain
    cells = prod(max(1.0, extent / domain.spacing) for extent in domain.size)
    needed, free = _bytes(scenario, cells), psutil.virtual_memory().available
    if needed > free:
        if _bytes(scenario, 0) > free / 2:
            robots = sum(group.count * group.trials for group in scenario.robots)
            yield (
                f"robots: {robots} robots in all trials need {_memory(needed)} of memory, "
                f"{_memory(free)} are free; lower count or trials"
            )
        else:
            fits = max(domain.spacing, 1e-9 * max(domain.size))
            while _bytes(scenario, prod(max(1.0, extent / fits) for extent in domain.size)) > free:
                fits *= 1.05
            yield (
                f"domain.spacing: {cells:.3g} cells need {_memory(needed)} of memory, "
                f"{_memory(free)} are free; a spacing of {_round_up(fits):g} m fits"
            )
        return
    for n, gas_map in enumerate(scenario.maps):
        area = domain.size[0] * domain.size[1]
        if area / gas_map.cell > MOST_MAP_CELLS * gas_map.cell:
            yield (
                f"maps[{n}].cell: {gas_map.cell:g} m makes more than {MOST_MAP_CELLS} map cells; "
                f"use {_round_up(sqrt(area / MOST_MAP_CELLS)):g} m or more"
            )
    for axis, (extent, n) in enumerate(zip(domain.size, domain.shape, strict=True)):
        if n < 2:
            advice = "; two numbers in domain.size make a 2-D run" if axis == 2 else ""
            yield (
                f"domain.size[{axis}]: {extent:g} m is fewer than two cells of {domain.spacing:g} m; "
                f"lower domain.spacing to {extent / 4:.3g} m or less{advice}"
            )
        elif abs(n * domain.spacing - extent) > ROUNDING * extent:
            yield (
                f"domain.size[{axis}]: {extent:g} m in cells of {domain.spacing:g} m becomes "
                f"{n * domain.spacing:g} m; choose a spacing that divides it, such as {extent / n:.4g} m"
            )


def _memory(amount: float) -> str:
    return f"{amount / 1e9:,.0f} GB" if amount >= 1e11 else f"{amount / 1e9:.2g} GB"


def _round_up(value: float) -> float:
    """`value` rounded up to two digits."""
    unit = 10.0 ** (floor(log10(value)) - 1)
    return ceil(value / unit - 1e-9) * unit


# ---------------------------------------------------------------- obstacles and sources


def _shapes(scenario: Scenario, folder: Path) -> tuple[list[Shape | None], list[str]]:
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
                f"{_range('xyz'[axis], one.low[axis], one.high[axis])}, "
                f"the domain has {_range('xyz'[axis], 0, extent[axis])}; move it in or remove it"
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
                    f"{_range('xy'[axis], 0, domain.extent[axis])}; keep the centre inside"
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


def _range(axis: str, low: float, high: float) -> str:
    return f"{axis} {low:.4g} to {high:.4g} m"


def _sources(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    for path, source in scenario.sources:
        yield from _in_the_air(f"{path}.position", "source", source.position, scenario, shapes)
    names: dict[str, Species] = {}
    for path, gas in scenario.gases:
        other = names.setdefault(gas.vapour.name, gas.vapour)
        if other != gas.vapour:
            yield f"{path}.species.name: '{other.name}' is another species of this scenario; give it its own name"


def _in_the_air(
    path: str, what: str, position: tuple[float, ...], scenario: Scenario, shapes: list[Shape | None]
) -> Iterator[str]:
    """A position has to be in the domain and outside of all obstacles."""
    extent = scenario.domain.extent
    outside = [a for a, x in enumerate(position) if not 0 <= x <= extent[a]]
    if outside:
        axis = "xyz"[outside[0]]
        yield (
            f"{path}: {axis} = {position[outside[0]]:g} m is outside the domain, "
            f"{_range(axis, 0, extent[outside[0]])}; move the {what} in"
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


# ---------------------------------------------------------------- warm and heavy air


def _buoyancy_of(scenario: Scenario) -> Buoyancy | None:
    return scenario.wind.buoyancy if isinstance(scenario.wind, CfdWind) else None


def _heat(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    buoyancy = _buoyancy_of(scenario)
    heat = buoyancy.heat if buoyancy else None
    openings = _openings_of(scenario)
    if heat is None:
        for n, opening in enumerate(openings):
            if isinstance(opening, Vent) and opening.temperature is not None:
                yield (
                    f"wind.openings[{n}].temperature: has no effect as the temperature of the air is not computed; "
                    "add wind.buoyancy.heat or remove it"
                )
        return
    where = "wind.buoyancy.heat"
    for n, heater in enumerate(heat.heaters):
        path = f"{where}.heaters[{n}].position"
        yield from _in_the_air(path, "heater", heater.position, scenario, shapes)
    for n, wall in enumerate(heat.walls):
        path = f"{where}.walls[{n}]"
        yield from _on_its_face(path, wall, scenario, shapes)
        for m, opening in enumerate(openings):
            if isinstance(opening, Periodic) and opening.axis == wall.face[0]:
                yield (
                    f"{path}.face: there is no wall {wall.face}, wind.openings[{m}] makes axis {opening.axis} "
                    "periodic; remove one of them"
                )
        for m, other in enumerate(heat.walls[:n]):
            if _overlap(wall, other, scenario):
                yield (
                    f"{path}: overlaps {where}.walls[{m}] on face {wall.face}; "
                    "give both a center and a size that leave them apart"
                )
    for n, obstacle in enumerate(heat.obstacles):
        path = f"{where}.obstacles[{n}].number"
        if obstacle.number >= len(scenario.obstacles):
            count = len(scenario.obstacles)
            allowed = f"use 0 to {count - 1}" if count else "there are none"
            yield f"{path}: there is no obstacles[{obstacle.number}]; {allowed}"
        elif any(obstacle.number == other.number for other in heat.obstacles[:n]):
            yield f"{path}: obstacles[{obstacle.number}] has a temperature already; remove one"


# ---------------------------------------------------------------- openings


def _openings_of(scenario: Scenario) -> tuple[Opening, ...]:
    return scenario.wind.openings if isinstance(scenario.wind, CfdWind) else ()


def _openings(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    openings = _openings_of(scenario)
    for n, opening in enumerate(openings):
        path = f"wind.openings[{n}]"
        earlier = openings[:n]
        if isinstance(opening, Periodic):
            if any(isinstance(o, Periodic) and o.axis == opening.axis for o in earlier):
                yield f"{path}: axis {opening.axis} is periodic already; remove one"
            for m, other in enumerate(openings):
                if isinstance(other, Region) and other.face[0] == opening.axis:
                    yield (
                        f"{path}: axis {opening.axis} cannot be periodic while wind.openings[{m}] "
                        f"({other.kind}) is on face {other.face}; remove one of them"
                    )
            continue
        yield from _on_its_face(path, opening, scenario, shapes)
        for m, other in enumerate(earlier):
            if isinstance(other, Region) and _overlap(opening, other, scenario):
                yield (
                    f"{path}: overlaps wind.openings[{m}] ({other.kind}) on face {opening.face}; "
                    "give both a center and a size that leave them apart"
                )
        axis = opening.axis
        if isinstance(opening, MovingWall) and opening.velocity[axis] != 0:
            yield (
                f"{path}.velocity: the wall {opening.face} slides in its own plane: "
                f"the {'xyz'[axis]} component must be 0, got {opening.velocity[axis]:g} m/s; "
                "to blow air use kind: inlet"
            )


def _on_its_face(path: str, region: Region, scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    """A region must lie on its face and cover cells with air."""
    beyond = _beyond(region, scenario)
    if beyond:
        yield f"{path}: reaches beyond its face {region.face}: {beyond}"
    else:
        yield from _covered_cells(path, region, scenario, shapes)


def _beyond(window: Window, scenario: Scenario) -> str:
    """Where a window reaches beyond the domain, if it does, and what to do."""
    domain = scenario.domain
    center, half = window.rectangle(domain.extent)
    for a, c, h in zip(window.along(domain.dim), center, half, strict=True):
        axis, length = "xyz"[a], domain.extent[a]
        # up to half a cell may be due to the rounding of the domain to whole cells
        if c - h < -1e-6 or c + h > length + domain.spacing / 2 + 1e-6:
            return (
                f"{_range(axis, c - h, c + h)}, the face has {_range(axis, 0, length)}; "
                "move its center or make it smaller"
            )
    return ""


def _covered(window: Window, domain: Domain) -> np.ndarray:
    """Centres (n, dim - 1) [m] of the cells that a window covers, in its own axes."""
    center, half = map(np.array, window.rectangle(domain.extent))
    axes = window.along(domain.dim)
    ranges = [(np.arange(domain.shape[a]) + 0.5) * domain.spacing for a in axes]
    places = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, len(axes))
    if window.is_disc(domain.dim):
        return places[np.linalg.norm(places - center, axis=-1) <= half[0]]
    return places[(np.abs(places - center) <= half).all(axis=-1)]


def _covered_cells(
    path: str, opening: Region, scenario: Scenario, shapes: list[Shape | None]
) -> Iterator[str]:
    """An opening must cover a cell, and one behind which there is air."""
    domain = scenario.domain
    covered = _covered(opening, domain)
    _, half = map(np.array, opening.rectangle(domain.extent))
    if not len(covered) and (2 * half < domain.spacing).any():
        yield (
            f"{path}: is smaller than a cell of {domain.spacing:g} m and covers none; "
            "make it larger or lower domain.spacing"
        )
        return
    axis = opening.axis
    depth = (domain.shape[axis] - 0.5 if opening.side else 0.5) * domain.spacing
    behind = np.insert(covered, axis, depth, axis=1)
    solid = np.zeros(len(behind), bool)
    for one in shapes:
        if one is not None:
            solid |= one.inside(behind)
    if len(behind) and solid.all():
        yield f"{path}: there is no air behind it, an obstacle covers it; move one of them"


def _overlap(a: Region, b: Region, scenario: Scenario) -> bool:
    """Whether two regions are on one face and share more than their rims."""
    if a.face != b.face:
        return False
    rim = 1e-6 * scenario.domain.spacing
    center_a, half_a = map(np.array, a.rectangle(scenario.domain.extent))
    center_b, half_b = map(np.array, b.rectangle(scenario.domain.extent))
    apart = np.abs(center_a - center_b)
    disc_a, disc_b = a.is_disc(scenario.domain.dim), b.is_disc(scenario.domain.dim)
    if disc_a and disc_b:
        return bool(np.linalg.norm(apart) < half_a[0] + half_b[0] - rim)
    if disc_a or disc_b:
        radius, half = (half_a[0], half_b) if disc_a else (half_b[0], half_a)
        return bool(np.linalg.norm(np.maximum(apart - half, 0.0)) < radius - rim)
    return bool((apart < half_a + half_b - rim).all())


def _screens_of(scenario: Scenario) -> tuple[Screen, ...]:
    return scenario.wind.screens if isinstance(scenario.wind, CfdWind) else ()


def _screens(scenario: Scenario) -> Iterator[str]:
    domain = scenario.domain
    for n, screen in enumerate(_screens_of(scenario)):
        path = f"wind.screens[{n}]"
        half = max(screen.thickness, domain.spacing) / 2
        low, high = half + domain.spacing, domain.extent[screen.normal] - half - domain.spacing
        if not low - 1e-6 <= screen.at <= high + 1e-6:
            yield (
                f"{path}.at: {screen.axis} = {screen.at:g} m leaves less than a cell of air on each side of "
                f"it; use {_range(screen.axis, low, high)}"
                if low <= high
                else f"{path}.thickness: {2 * half:g} m does not fit in the domain; make it thinner"
            )
        beyond = _beyond(screen, scenario)
        if beyond:
            yield f"{path}: reaches beyond the domain: {beyond.replace('the face has', 'the domain has')}"
        elif not len(_covered(screen, domain)):
            yield (
                f"{path}: is smaller than a cell of {domain.spacing:g} m and covers none; "
                "make it larger or lower domain.spacing"
            )


def _net_inflow(scenario: Scenario) -> Iterator[str]:
    """Air cannot be compressed: without an outlet, what is blown in must be drawn out at every moment."""
    jets: list[Jet] = []
    for opening in _openings_of(scenario):
        if isinstance(opening, Outlet) or (isinstance(opening, Jet) and not opening.blows):
            return
        if isinstance(opening, Jet):
            jets.append(opening)
    for n, opening in enumerate(_openings_of(scenario)):
        if isinstance(opening, Fan) and opening.curve:
            yield (
                f"wind.openings[{n}].curve: needs an outlet: what a fan blows along its curve nothing balances; "
                "add {kind: outlet, face: ...} or use speed"
            )
            return
    begin = 0.0 - scenario.warm_up
    ends = {begin, scenario.duration}
    for jet in jets:
        ends.update(time for step in jet.schedule for time in (step.at, step.at + jet.ramp))
    times = sorted(t for t in ends if begin <= t <= scenario.duration)
    times = sorted([*times, *((a + b) / 2 for a, b in pairwise(times))])
    for t in times:
        flows = [jet.speed_at(t) * jet.area(scenario.domain.extent, scenario.domain.depth) for jet in jets]
        if abs(sum(flows)) > 1e-6 * sum(abs(flow) for flow in flows):
            change = "blown in" if sum(flows) > 0 else "drawn out"
            yield (
                f"wind.openings: an outlet is missing: at t = {t:g} s a net {abs(sum(flows)):.4g} m³/s is "
                f"{change} and all else is closed; add {{kind: outlet, face: ...}} or balance the speeds"
            )
            return


def _eddies(scenario: Scenario) -> Iterator[str]:
    """The cells must carry the waves of a synthetic wind."""
    wind, spacing = scenario.wind, scenario.domain.spacing
    if not isinstance(wind, SyntheticWind):
        return
    shortest = wind.shortest_on(spacing)
    if shortest < 2 * spacing:
        yield (
            f"wind.shortest: {shortest:g} m is less than two cells of {spacing:g} m; "
            f"use {4 * spacing:g} m or more, or lower domain.spacing"
        )
    elif shortest >= wind.longest:
        yield (
            f"wind.longest: {wind.longest:g} m is not above the shortest wavelength, {shortest:g} m; "
            "make it longer, or give a wind.shortest below it"
        )


# ---------------------------------------------------------------- robots


def _names(scenario: Scenario) -> Iterator[str]:
    """Tables and recordings tell groups by their names."""
    first: dict[str, int] = {}
    for n, group in enumerate(scenario.robots):
        if group.name in first:
            yield (
                f"robots[{n}].name: '{group.name}' is the name of robots[{first[group.name]}] too; "
                "give each group its own"
            )
        first.setdefault(group.name, n)


def _robots(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    domain = scenario.domain
    width = min(domain.extent[:2])
    names: list[tuple[str, int]] = []
    discs: list[tuple[np.ndarray, float]] = []
    for n, group in enumerate(scenario.robots):
        path = f"robots[{n}]"
        if 2 * group.body.radius > width:
            yield (
                f"{path}.body.radius: a robot {2 * group.body.radius:g} m wide does not fit in a domain "
                f"{width:g} m wide; make the body smaller"
            )
            continue
        most = int(domain.extent[0] * domain.extent[1] / (pi * group.body.radius**2))
        if group.count > most:
            yield (
                f"{path}.count: {group.count} robots of radius {group.body.radius:g} m do not fit in "
                f"the domain; use fewer than {most} or a smaller body"
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
    if discs:
        yield from _too_close(names, discs)


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
    size = np.array(scenario.domain.extent[:2])
    for axis in range(2):
        for side, distance in (("-", places[..., axis]), ("+", size[axis] - places[..., axis])):
            wall = f"the wall {'xy'[axis]}{side}"
            yield wall, f"behind {wall}", distance, START_ROOM
    room = START_ROOM + sqrt(2) * clearance_resolution(scenario.domain.extent)
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


# ---------------------------------------------------------------- films, flows that stand still


def _films(scenario: Scenario, folder: Path, shapes: list[Shape | None]) -> Iterator[str]:
    """Films that are played back: whole, of the same domain and obstacles, with what is asked of them."""
    for part, path, model in [("wind", "wind", scenario.wind), *(("gas", *gas) for gas in scenario.gases)]:
        if not isinstance(model, Playback):
            continue
        from taichi_plume.film import Film, FilmError, completed  # zarr is for runs that need it

        try:
            film = Film(folder / model.file)
            if part == "gas":
                completed(scenario, folder)
            air = film.still("air")
            for n in {0, len(film.times) - 1}:
                film.frame(n, film.wind if part == "wind" else film.gas)
        except FilmError as error:
            yield f"{path}.file: {error}"
            continue
        held = [name for name, variables in (("wind", film.wind), ("gas", film.gas)) if variables]
        if part not in held:
            yield (
                f"{path}.file: {film.path}: holds no {part}, only {', '.join(held) or 'nothing'}; record it "
                f"with fields.quantities: [{part}]"
            )
        elif faults := list(_another_domain(scenario, film, part)):
            yield from faults
        elif None not in shapes:
            grid = Grid.of(scenario.domain, film.periodic)
            here = air_of([s for s in shapes if s], grid, air > 0)
            differing = int((np.abs(here.volume - air) > 0.01).sum())
            if differing:
                yield (
                    f"obstacles: {differing} cells are not as in {film.path}, which {part} plays back; "
                    "give the obstacles of the recorded run"
                )
        if model.start > film.times[-1] and not model.loop:
            yield (
                f"{path}.start: {model.start:g} s is after the last frame of {film.path}; "
                f"it has {film.times[0]:g} to {film.times[-1]:g} s"
            )


def _another_domain(scenario: Scenario, film: Any, part: str) -> Iterator[str]:
    domain = scenario.domain
    if domain.shape != film.shape or abs(domain.spacing - film.dx) > 1e-6 * film.dx:
        size = ", ".join(f"{n * film.dx:.6g}" for n in film.shape)
        yield (
            f"domain: {_cells(domain.shape, domain.spacing)}, but {film.path}, which {part} plays back, has "
            f"{_cells(film.shape, film.dx)}; use size: [{size}], spacing: {film.dx:g}"
        )
    elif part == "gas" and domain.dim == 2 and abs(domain.depth - film.depth) > 1e-6 * film.depth:
        yield (
            f"domain.depth: {domain.depth:g} m, but the gas of {film.path} was recorded in {film.depth:g} m; "
            f"use depth: {film.depth:g}"
        )


def _cells(shape: tuple[int, ...], dx: float) -> str:
    return f"{' x '.join(map(str, shape))} cells of {dx:g} m"


def _frozen(scenario: Scenario) -> Iterator[str]:
    wind, whole = scenario.wind, scenario.warm_up + scenario.duration
    if not isinstance(wind, FrozenWind):
        return
    if wind.after > whole:
        yield (
            f"wind.after: {wind.after:g} s is longer than warm_up + duration = {whole:g} s, so the flow would "
            "never stand still; lower it, raise warm_up, or use kind: cfd"
        )
    if wind.average is not None and wind.average > wind.after:
        yield f"wind.average: {wind.average:g} s is longer than after: {wind.after:g} s; use at most that"


def _fields(scenario: Scenario) -> Iterator[str]:
    model = scenario.fields
    if model is None:
        return
    if model.rate * scenario.tick > 1 + 1e-9:
        yield (
            f"fields.rate: {model.rate:g} frames per second are more than one per tick of {scenario.tick:g} s; "
            f"use at most {1 / scenario.tick:g}, or lower tick"
        )
    if model.start > scenario.duration:
        yield f"fields.start: {model.start:g} s is after the end at {scenario.duration:g} s; start it earlier"


# ---------------------------------------------------------------- recording


def _recording(scenario: Scenario) -> Iterator[str]:
    recording, extent = scenario.recording, scenario.domain.extent
    if len(extent) == 3 and recording.slice_height > extent[2]:
        yield (
            f"recording.slice_height: {recording.slice_height:g} m is above the ceiling; "
            f"use at most {extent[2]:g} m"
        )
    if recording.range_ppm[0] >= recording.range_ppm[1]:
        yield (
            f"recording.range_ppm: the first must be below the second, got {recording.range_ppm[0]:g} and "
            f"{recording.range_ppm[1]:g}"
        )
