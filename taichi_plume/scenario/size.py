"""How large a scenario is: numbers of coordinates, cells, memory, and roughly how long it takes.

Nothing here allocates.
"""

from collections.abc import Iterator
from math import ceil, floor, hypot, log10, prod, sqrt

import psutil

from taichi_plume.scenario.checks_air import buoyancy_of, openings_of, screens_of
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.heat import Heat
from taichi_plume.scenario.maps import KernelMap, Map, MarkovMap, TimeSeriesMap
from taichi_plume.scenario.obstacles import Box, Obstacle, Sphere, motion_of
from taichi_plume.scenario.openings import Fan, Jet, MovingWall, Outlet, Periodic, Region
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import CfdWind, FrozenWind, SyntheticWind, UniformWind

BYTES_PER_CELL = {2: 264, 3: 204}  # all fields of a CFD run with one gas
BYTES_PER_GAS = 16  # and cell, of every further gas
BYTES_OF_FACTORS = 700  # per cell of a 2-D flow solved by sparse factors, at 10⁵ cells; it grows slowly
BYTES_PER_ROBOT = 2000  # state, readings and a few minutes of track
MOST_MAP_CELLS = 4_000_000
MOST_FIELD_COLUMN = 400  # cells: its third power is the work of an update
CELL_STEPS_PER_SECOND = {2: 1.5e6, 3: 2e6}  # rough: wind and gas on a few CPU cores
GUST = 3.5  # largest sum of |u| over the axes, over the largest prescribed speed: 1.2 to 3.7 in the shipped scenarios
ROUNDING = 0.1  # of an extent: more is a scenario for another domain than the one written


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


def _bytes_of_map(gas_map: Map, domain: Domain, trials: int) -> float:
    """Of its fields, and of what it is solved with."""
    long, short = sorted((extent / gas_map.cell for extent in domain.size[:2]), reverse=True)
    each = 40.0 * long * short
    if isinstance(gas_map, MarkovMap):
        each += 8.0 * long * short**2  # a block for each column
    elif isinstance(gas_map, KernelMap):
        each += 70.0 * gas_map.exact
    elif isinstance(gas_map, TimeSeriesMap) and not gas_map.raw_samples:
        lags = gas_map.beta / ((1.0 - gas_map.alpha) * gas_map.time_scale * gas_map.window)
        margin = 2.0 * min(long, gas_map.beta / gas_map.alpha / gas_map.cell)
        each += 8.0 * lags * (long + margin) * (short + margin)
    return trials * each


def _has_factors(scenario: Scenario) -> bool:
    """Whether a 2-D flow is too irregular for fast transforms: obstacles, or faces of the domain open in part."""
    if scenario.domain.dim == 3 or not isinstance(scenario.wind, CfdWind):
        return False
    lets_out = (
        o for o in scenario.wind.openings if isinstance(o, Outlet) or (isinstance(o, Jet) and not o.blows)
    )
    standing = any(motion_of(one) is None for one in scenario.obstacles)
    return standing or any(opening.center is not None for opening in lets_out)


def dimensions(scenario: Scenario) -> Iterator[str]:
    """Vectors of another dimension than the domain's."""
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
    buoyancy = buoyancy_of(scenario)
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
    for n, opening in enumerate(openings_of(scenario)):
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
    for n, screen in enumerate(screens_of(scenario)):
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


def sizes(scenario: Scenario) -> Iterator[str]:
    """Cells and memory that are too many or too few."""
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
    trials = (sum if scenario.rivals else max)([group.trials for group in scenario.robots] or [1])
    for n, gas_map in enumerate(scenario.maps):
        area = domain.size[0] * domain.size[1]
        if area / gas_map.cell > MOST_MAP_CELLS * gas_map.cell:
            yield (
                f"maps[{n}].cell: {gas_map.cell:g} m makes more than {MOST_MAP_CELLS} map cells; "
                f"use {_round_up(sqrt(area / MOST_MAP_CELLS)):g} m or more"
            )
        elif isinstance(gas_map, MarkovMap) and min(domain.size[:2]) / gas_map.cell > MOST_FIELD_COLUMN:
            yield (
                f"maps[{n}].cell: {gas_map.cell:g} m is too fine for a Markov field, which takes {MOST_FIELD_COLUMN} "
                f"cells along the shorter side; use {_round_up(min(domain.size[:2]) / MOST_FIELD_COLUMN):g} m or more"
            )
        elif (of_map := _bytes_of_map(gas_map, domain, trials)) > free:
            yield (
                f"maps[{n}]: needs {_memory(of_map)} of memory for all trials, {_memory(free)} are free; "
                "make its cells larger, or lower the trials"
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
