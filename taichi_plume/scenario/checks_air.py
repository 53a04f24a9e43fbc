"""Openings, screens, warm surfaces and closed rooms that make no sense, and air that cannot get out."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario.checks_obstacles import in_the_air, span
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.heat import Buoyancy
from taichi_plume.scenario.openings import (
    Fan,
    Jet,
    MovingWall,
    Opening,
    Outlet,
    Periodic,
    Region,
    Screen,
    Vent,
    Window,
)
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import CfdWind, FrozenWind, SyntheticWind


def problems(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    """What is wrong with the wind."""
    yield from _eddies(scenario)
    yield from _heat(scenario, shapes)
    yield from _screens(scenario)
    yield from list(_openings(scenario, shapes)) or _net_inflow(scenario)
    yield from _frozen(scenario)


def buoyancy_of(scenario: Scenario) -> Buoyancy | None:
    """Of a wind that has it."""
    return scenario.wind.buoyancy if isinstance(scenario.wind, CfdWind) else None


def _heat(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    buoyancy = buoyancy_of(scenario)
    heat = buoyancy.heat if buoyancy else None
    openings = openings_of(scenario)
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
        yield from in_the_air(path, "heater", heater.position, scenario, shapes)
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


def openings_of(scenario: Scenario) -> tuple[Opening, ...]:
    """Those of a computed flow."""
    return scenario.wind.openings if isinstance(scenario.wind, CfdWind) else ()


def _openings(scenario: Scenario, shapes: list[Shape | None]) -> Iterator[str]:
    openings = openings_of(scenario)
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
                f"{span(axis, c - h, c + h)}, the face has {span(axis, 0, length)}; "
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


def screens_of(scenario: Scenario) -> tuple[Screen, ...]:
    """Those of a computed flow."""
    return scenario.wind.screens if isinstance(scenario.wind, CfdWind) else ()


def _screens(scenario: Scenario) -> Iterator[str]:
    domain = scenario.domain
    for n, screen in enumerate(screens_of(scenario)):
        path = f"wind.screens[{n}]"
        half = max(screen.thickness, domain.spacing) / 2
        low, high = half + domain.spacing, domain.extent[screen.normal] - half - domain.spacing
        if not low - 1e-6 <= screen.at <= high + 1e-6:
            yield (
                f"{path}.at: {screen.axis} = {screen.at:g} m leaves less than a cell of air on each side of "
                f"it; use {span(screen.axis, low, high)}"
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
    for opening in openings_of(scenario):
        if isinstance(opening, Outlet) or (isinstance(opening, Jet) and not opening.blows):
            return
        if isinstance(opening, Jet):
            jets.append(opening)
    for n, opening in enumerate(openings_of(scenario)):
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
