"""What is wrong with a scenario beyond single keys: dimensions, geometry, air that cannot get out, memory.

Every fault is one line: the YAML path, what is wrong, what would be right.
"""

from collections.abc import Iterator
from pathlib import Path

from taichi_plume.scenario import (
    checks_air,
    checks_dishes,
    checks_films,
    checks_imports,
    checks_obstacles,
    checks_plumes,
    checks_plumesim,
    checks_puffs,
    checks_robots,
    checks_teams,
)
from taichi_plume.scenario import size as checks_size
from taichi_plume.scenario.gases import PlaybackGas
from taichi_plume.scenario.scenario import Scenario


def problems(scenario: Scenario, folder: Path) -> list[str]:
    """All faults as lines ``path: message``; `folder` is where mesh files lie.

    Wrong dimensions or sizes are told alone, and so are films: the other checks need them right.
    """
    for part in (checks_size.dimensions, checks_size.sizes):
        lines = list(part(scenario))
        if lines:
            return lines
    shapes, lines = checks_obstacles.shapes_of(scenario, folder)
    films = [
        *checks_films.problems(scenario, folder, shapes),
        *checks_plumesim.point_plumes(scenario, folder),
        *checks_imports.imports(scenario, folder, shapes),
    ]
    if films:
        return lines + films
    if any(isinstance(gas, PlaybackGas) for _, gas in scenario.gases):
        from taichi_plume.files.film import completed

        scenario = completed(scenario, folder)
    for part in (checks_obstacles, checks_robots, checks_air):
        lines += part.problems(scenario, shapes)
    lines += checks_robots.own_algorithms(scenario, folder)
    return [
        *lines,
        *_names(scenario),
        *_recording(scenario),
        *_fields(scenario),
        *checks_dishes.dishes(scenario),
        *checks_plumes.plume_problems(scenario),
        *checks_puffs.puffs(scenario),
        *checks_plumesim.plume_logs(scenario),
        *checks_teams.problems(scenario),
    ]


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
