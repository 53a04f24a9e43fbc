"""What is wrong with an imported wind: its files, and how they lie in the domain."""

from collections.abc import Iterator
from math import prod
from pathlib import Path

import numpy as np
import psutil

from taichi_plume.files.site import Site
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.grid.cut_cells import Air, air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario.robots import StartAt
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import ImportedWind

ROUNDING = 0.01  # cells that the domain may reach beyond the points


def imports(scenario: Scenario, folder: Path, shapes: list[Shape | None]) -> Iterator[str]:
    """The first and the last file are read; those between, when the run begins."""
    wind, domain = scenario.wind, scenario.domain
    if not isinstance(wind, ImportedWind):
        return
    if wind.origin is not None and len(wind.origin) != domain.dim:
        yield f"wind.origin: has {len(wind.origin)} numbers, a {domain.dim}-D run takes {domain.dim} here"
        return
    for n, face in enumerate(wind.walls):
        if "xyz".index(face[0]) >= domain.dim:
            yield f"wind.walls[{n}]: '{face}' does not exist in a 2-D run; use x-, x+, y- or y+"
    if domain.dim == 3 and wind.height is not None:
        yield "wind.height: is for 2-D runs; remove it, or give domain.size two numbers"
    try:
        site = Site(wind, domain.dim, folder)
        site.read(site.files[-1][1])
    except WindFileError as error:
        yield f"wind.files: {error}"
        return
    low, high = site.levels
    if wind.height is not None and not low <= wind.height <= high:
        yield f"wind.height: {wind.height:g} m is outside of the points of {site.first.path}, z {low:g} to {high:g} m"
        return
    if wind.start > site.files[-1][0] and not wind.loop:
        yield (
            f"wind.start: {wind.start:g} s is after the last file, {site.files[-1][1]}, which shows "
            f"{site.files[-1][0]:g} s"
        )
    grid = Grid.of(domain)
    needed = 4.0 * len(site.files) * prod(n + 2 for n in grid.shape) * (domain.dim + 1)
    free = psutil.virtual_memory().available
    if needed > free:
        yield (
            f"wind.files: {len(site.files)} files on this grid need {needed / 1e9:.2g} GB of memory, "
            f"{free / 1e9:.2g} GB are free; use fewer, or raise domain.spacing"
        )
    faults = list(_beyond(site, grid))
    if faults or None in shapes:
        yield from faults
        return
    # outlets lie in the walls, where the files have no points
    air = air_of(shapes, grid, left=site.cubes.shares(grid, outlets=False) if site.cubes else None)
    yield from _without_wind(site, grid, air)
    if site.cubes:
        yield from _in_cubes(scenario, site)


def _beyond(site: Site, grid: Grid) -> Iterator[str]:
    """A domain that is larger than the occupancy grid."""
    if site.cubes is None:
        return
    for a, extent in enumerate(grid.extent):
        low, high = site.cubes.low[a], site.cubes.high[a]
        if low > ROUNDING * grid.dx or extent > high + ROUNDING * grid.dx:
            yield _outside(site, a, (0.0, extent), (low, high), f"{site.wind.occupancy} has cells")


def _without_wind(site: Site, grid: Grid, air: Air) -> Iterator[str]:
    """Air beyond the points."""
    cells = np.argwhere(~air.solid)
    if not len(cells):
        yield f"wind.occupancy: {site.wind.occupancy}: leaves no air in the domain"
        return
    slack = ROUNDING * grid.dx + site.slack
    for a in range(grid.dim):
        low, high = cells[:, a].min() * grid.dx, (cells[:, a].max() + 1) * grid.dx
        if low < site.low[a] - slack or high > site.high[a] + slack:
            have = f"the points of {site.first.path} stand for air"
            yield _outside(site, a, (low, high), (site.low[a], site.high[a]), have)


def _outside(site: Site, axis: int, air: tuple[float, float], known: tuple[float, float], have: str) -> str:
    """A line about the domain along an axis; air, known: from where to where [m], in the domain."""
    x, origin = "xyz"[axis], site.origin[axis]
    (a, b), (low, high) = air, known
    places = [f"{round(origin + place, 6) + 0.0:g}" for place in (a, b, low, high)]
    return (
        f"domain.size[{axis}]: in the files its air reaches from {x} = {places[0]} to {places[1]} m, but {have} only "
        f"from {places[2]} to {places[3]} m; use at most {high - low:.6g} m, with {places[2]} in wind.origin"
    )


def _in_cubes(scenario: Scenario, site: Site) -> Iterator[str]:
    """Sources and robots inside the obstacles of the occupancy grid."""
    file = site.wind.occupancy
    if scenario.robots and scenario.domain.dim == 3:
        floor = int((~site.cubes.solid).any(axis=(0, 1)).argmax())  # the lowest layer with air
        low = site.cubes.low[2] + floor * site.cubes.size
        if low > ROUNDING * scenario.domain.spacing:
            yield (
                f"wind.origin: the floor of {file} is {low:.4g} m above the domain's, where robots drive; give it "
                f"{low + site.origin[2]:.6g} as its third number"
            )
            return
    for path, source in scenario.sources:
        place = np.array([source.position])
        if place.shape[1] == scenario.domain.dim and site.cubes.inside(place)[0]:
            yield f"{path}.position: is inside an obstacle of {file}; move the source"
    for n, group in enumerate(scenario.robots):
        if isinstance(group.start, StartAt):
            height, radius = group.body.height, group.body.radius
            away = site.cubes.horizontal_distance(np.array(group.start.positions), 0.0, height)
            for k in np.flatnonzero(away < radius):
                yield f"robots[{n}].start.positions[{k}]: touches an obstacle of {file}; move the robot"
