"""Text document of a recording: legend of forms and colours, key facts of the run, resolved scenario."""

from collections.abc import Iterable, Iterator, Sequence
from math import prod

import rerun as rr

from taichi_plume.observed.planes import Plane
from taichi_plume.observed.quantities import Quantity
from taichi_plume.record.scene import Entities
from taichi_plume.scenario.readable_yaml import all_keys
from taichi_plume.scoring.beliefs import believers
from taichi_plume.scoring.declarations import may_declare
from taichi_plume.time_loop import TimeLoop
from taichi_plume.version import __version__


def about(
    sim: TimeLoop, backend: str, recorded: int, seen: Sequence[Plane], quantities: Sequence[Quantity]
) -> Entities:
    """Yield the recording's text document (Markdown). backend: Taichi's; recorded: number of recorded robots."""
    name = "".join(f"\\{sign}" if sign in "\\`*_{}[]()<>#+-.!|~" else sign for sign in sim.scenario.name)
    parts = [
        f"# {name}",
        "## What you see",
        _table(_legend(sim, seen, quantities)),
        "## The run",
        _table(_facts(sim, backend, recorded).items()),
        f"```yaml\n{all_keys(sim.scenario)}```",
    ]
    yield "about", rr.TextDocument("\n\n".join(parts), media_type=rr.MediaType.MARKDOWN)


def _table(rows: Iterable[tuple[str, str]]) -> str:
    return "| | |\n|---|---|\n" + "\n".join(f"| {key} | {value} |" for key, value in rows)


def _legend(
    sim: TimeLoop, seen: Sequence[Plane], quantities: Sequence[Quantity]
) -> Iterator[tuple[str, str]]:
    """Yield pairs of texts, the look and the meaning, for each kind of item drawn in a recording."""
    scenario, deep = sim.scenario, sim.grid.dim == 3
    if scenario.sources:
        yield "crimson ball", "a source of gas"
    for quantity in quantities:
        low, high = quantity.scale.low, quantity.scale.high
        colors = "black to yellow" if quantity.unit == "ppm" else "blue to red"
        ends = f"{low:.4g} to {high:.4g} {quantity.unit}, {quantity.scale.kind} scale"
        yield colors, f"{quantity.name}, {ends}; a pixel shows the largest of the cells that it covers"
    if deep and quantities:
        if scenario.recording.volume:
            yield "cloud", "the plume in 3-D: each voxel is the largest of its cells, whatever its height"
        yield "floor below it", "the largest of the gas over the height"
        yield "tabs beside it", "; ".join(dict.fromkeys(plane.text for plane in seen))
    plane = seen[0].text
    where = f", {plane}, drawn on the floor" if deep else ""
    yield (
        "grey arrows",
        f"wind{where}: the length is the speed of the air, on the scale of the key beside the colour bar",
    )
    if sim.swarm.count:
        yield (
            "pointed discs",
            "robots, each in the colour of its trail, its sensor's curve and its events; large arenas show them larger",
        )
        if any(group.localization for group in scenario.robots):
            yield "pale outlines and trails", "estimated positions of robots (odometry or camera)"
        if any(may_declare(group) for group in scenario.robots):
            yield (
                "rings with a cross",
                "declared source positions, the last or the first right position of a robot: green right, orange wrong",
            )
        yield "bars of behaviour", "state of each robot; green: the robot has found a source"
    if any(obstacle.motion for obstacle in scenario.obstacles):
        yield "white, named walker", "a moving obstacle, with its path as a thin line"
    if scenario.obstacles:
        yield "grey", "obstacles"
    if sim.maps:
        yield (
            "map tabs",
            "left the estimate from the robots' readings (its weight, its error), right the truth: the mean of the gas "
            "since the start; purple to yellow, on the gas's scale",
        )
    if believers(sim):
        yield (
            "belief tabs",
            "belief of the first robot of a group about the source, as probability per square metre; black to pale",
        )


def _facts(sim: TimeLoop, backend: str, recorded: int) -> dict[str, str]:
    """Return key figures of the run as texts by name: arena, cells, time, wind, gas, robots, maps, seeds, version."""
    scenario, grid = sim.scenario, sim.grid
    robots = "none"
    if sim.swarm.count:
        robots = f"{recorded} of {sim.swarm.count} recorded (of several trials the first)"
    return {
        "arena": " x ".join(f"{length:g}" for length in grid.extent) + " m",
        "cells": " x ".join(str(n) for n in grid.shape) + f" = {prod(grid.shape):,} of {grid.dx:g} m",
        "time": f"{scenario.duration:g} s after {scenario.warm_up:g} s of warm-up, tick {sim.dt:g} s",
        "wind": scenario.wind.kind,
        "gas": f"{scenario.gas.kind}, {len(scenario.sources)} source(s)",
        "robots": robots,
        "maps": ", ".join(gas_map.kind for gas_map in scenario.maps) or "none",
        **{name: str(seed) for name, seed in scenario.seeds.items()},
        "backend": backend,
        "version": f"taichi_plume {__version__}",
    }
