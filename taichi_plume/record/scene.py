"""What stands still in a recording: arena, obstacles, openings, sources, bodies, legends, the description.

For rerun, as `recording` and `layout`: every function yields (entity, rerun archetype).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
import rerun as rr

from taichi_plume import __version__
from taichi_plume.files.gaden import Cubes
from taichi_plume.files.run_folder import to_yaml
from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.shapes import Shape
from taichi_plume.record import drawing
from taichi_plume.scenario.gases import AnySource
from taichi_plume.scenario.obstacles import Cylinder, Prism
from taichi_plume.scenario.vocabulary import Color, Point2
from taichi_plume.scenario.windows import Window
from taichi_plume.simulation import Simulation

FLAT = 0.05  # height of the walls of a 2-D arena over its shorter side
BODY = 0.009  # robots are drawn at least this large, over the arena's length
ESTIMATES = {
    "estimate": drawing.VIRIDIS,
    "truth": drawing.VIRIDIS,
    "weight": drawing.EMBER,
    "error": drawing.BLUE_RED,
}
"""What is shown of a map, with its palette."""
WEIGHTS = (10.0, 1e6)
RATIOS = (0.01, 100.0)  # estimate over truth

FLOOR = (44, 48, 58)
GREY = (150, 155, 165)
LINES = (150, 160, 175)
FAINT = (90, 98, 112)
RED = (255, 60, 60)
TEXT = (205, 210, 218)

Entities = Iterator[tuple[str, Any]]


@dataclass(frozen=True)
class Stage:
    """The arena as drawn: floor [m], height of its walls, longer side, gap between what lies on the floor."""

    extent: tuple[float, ...]
    height: float
    length: float
    lift: float

    @staticmethod
    def of(sim: Simulation) -> "Stage":
        """That of a simulation; flat ones get low walls."""
        extent = sim.grid.extent
        length = max(extent[:2])
        return Stage(extent, extent[2] if len(extent) == 3 else FLAT * min(extent), length, 5e-4 * length)


# ---------------------------------------------------------------- arena


def arena(sim: Simulation, stage: Stage) -> Entities:
    """Floor, edges, the robots' part of it, obstacles, sources, openings and screens."""
    (lx, ly), h = stage.extent[:2], stage.height

    def ring(z: float, low: Point2 = (0, 0), high: Point2 = (lx, ly)) -> list[list[float]]:
        (x0, y0), (x1, y1) = low, high
        return [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z], [x0, y0, z]]

    yield "/", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    posts = [[[x, y, 0], [x, y, h]] for x in (0, lx) for y in (0, ly)]
    yield "world/outline", rr.LineStrips3D([ring(0)], colors=LINES, radii=rr.Radius.ui_points(1.5))
    yield "world/walls", rr.LineStrips3D([ring(h), *posts], colors=FAINT, radii=rr.Radius.ui_points(0.8))
    below = rr.Boxes3D(
        centers=[[lx / 2, ly / 2, -3 * stage.lift]],
        half_sizes=[[lx / 2, ly / 2, 2 * stage.lift]],
        fill_mode="solid",
        colors=FLOOR,
    )
    yield "world/floor", below
    if sim.scenario.arena is not None:
        edges = ring(stage.lift, sim.scenario.arena.low, sim.scenario.arena.high)
        yield "world/arena", rr.LineStrips3D([edges], colors=LINES, radii=rr.Radius.ui_points(1.5))
    for n, shape in enumerate(sim.obstacles):
        yield f"world/obstacles/{n}", _solid(shape, stage)
    for n, source in enumerate(source for _, source in sim.scenario.sources):
        yield f"world/sources/{n}", _source(source, stage)
    for n, opening in enumerate(sim.scenario.openings):
        if opening.region is not None:
            name = opening.label if opening.passes else None
            yield from _window(
                f"world/openings/{n}", opening.region, opening.color, opening.straight, name, stage
            )
    for n, screen in enumerate(sim.scenario.screens):
        yield from _window(f"world/screens/{n}", screen, screen.color, True, screen.kind, stage)


def _solid(shape: Any, stage: Stage) -> Any:
    """An obstacle; those of a flat arena are as high as its walls."""
    if isinstance(shape, Cubes):
        centers, half = shape.visible(stage.extent), [shape.size / 2] * 3
        if centers.shape[1] == 2:
            centers = np.column_stack([centers, np.full(len(centers), stage.height / 2)])
            half[2] = stage.height / 2
        return rr.Boxes3D(centers=centers, half_sizes=[half], fill_mode="solid", colors=GREY)
    return SOLIDS[shape.model.kind](shape, stage)


def _box(shape: Shape, stage: Stage) -> Any:
    center, size = list(shape.model.center), list(shape.model.size)
    if len(center) == 2:
        center, size = [*center, stage.height / 2], [*size, stage.height]
    return rr.Boxes3D(
        centers=[center],
        half_sizes=[np.array(size) / 2],
        rotation_axis_angles=[rr.RotationAxisAngle([0, 0, 1], degrees=shape.model.yaw_deg)],
        fill_mode="solid",
        colors=GREY,
    )


def _ball(shape: Shape, stage: Stage) -> Any:
    center, half = list(shape.model.center), [shape.model.radius] * 3
    if len(center) == 2:
        center, half[2] = [*center, stage.height / 2], stage.height / 2
    return rr.Ellipsoids3D(centers=[center], half_sizes=[half], fill_mode="solid", colors=GREY)


def _upright(model: Cylinder | Prism, stage: Stage) -> tuple[float, float]:
    """Where it stands and how high it reaches [m], of the walls' height in a flat arena."""
    if len(stage.extent) == 2:
        return 0.0, stage.height
    return model.base, stage.height if model.height is None else min(stage.height, model.base + model.height)


def _cylinder(shape: Shape, stage: Stage) -> Any:
    base, top = _upright(shape.model, stage)
    return rr.Cylinders3D(
        lengths=[top - base],
        radii=[shape.model.radius],
        centers=[[*shape.model.center, (base + top) / 2]],
        fill_mode="solid",
        colors=GREY,
    )


def _prism(shape: Shape, stage: Stage) -> Any:
    return mesh(
        *drawing.prism_mesh(np.array(shape.model.vertices, float), *_upright(shape.model, stage)), GREY
    )


def _mesh(shape: Solid, stage: Stage) -> Any:
    return mesh(*drawing.faceted(shape.vertices, shape.triangles), GREY)


SOLIDS: dict[str, Callable[[Any, Stage], Any]] = {
    "box": _box,
    "sphere": _ball,
    "cylinder": _cylinder,
    "prism": _prism,
    "mesh": _mesh,
}
"""How the obstacles of each kind are drawn."""


def _source(source: AnySource, stage: Stage) -> Any:
    position = [*source.position, *[stage.height / 2] * (3 - len(source.position))]
    radius = max(source.radius, 0.006 * stage.length)
    if len(stage.extent) == 2:
        radius = min(radius, 0.02 * stage.length)
    return rr.Points3D([position], radii=radius, colors=RED, labels=["source"], show_labels=True)


def _window(
    entity: str, window: Window, color: Color, combed: bool, name: str | None, stage: Stage
) -> Entities:
    """An opening or a screen; combed: with lines across it. name: of one that air goes through."""
    outline = drawing.opening(window, stage.extent, stage.height)
    lines, width = [np.vstack([outline, outline[:1]])], 2.0
    if combed:
        lines += drawing.comb(window, stage.extent, stage.height)
        width = 0.8
    yield entity, rr.LineStrips3D(lines, colors=color, radii=rr.Radius.ui_points(width))
    if name is None:
        return
    triangles = [[0, i, i + 1] for i in range(1, len(outline) - 1)]
    pane = rr.Mesh3D(vertex_positions=outline, triangle_indices=triangles, albedo_factor=[*color, 45])
    yield f"{entity}/pane", pane
    middle = [*outline.mean(axis=0)[:2], outline[:, 2].max()]
    yield f"{entity}/name", _label(name, middle, color)


# ---------------------------------------------------------------- robots and series


def body(radius: float, height: float, color: tuple[int, ...], stage: Stage) -> rr.Mesh3D:
    """A robot's body, pointed in front; in large arenas larger than it is."""
    grown = max(radius, BODY * stage.length)
    return mesh(*drawing.robot_mesh(grown, max(height * grown / radius, 0.5 * grown)), color)


def ghost(radius: float, color: tuple[int, ...], stage: Stage) -> rr.LineStrips3D:
    """Where a robot believes to be: the outline of its body, with a line to the front."""
    grown = max(radius, BODY * stage.length)
    angles = np.linspace(0, 2 * np.pi, 33)
    ring = grown * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    front = [[0, 0, 0], [1.6 * grown, 0, 0]]
    return rr.LineStrips3D([ring, front], colors=color, radii=rr.Radius.ui_points(1.2))


def lanes(states: tuple[str, ...]) -> rr.StateConfiguration:
    """Colours of a robot's states, of which the last is "found"."""
    colors = np.resize(drawing.STATES, len(states))
    colors[-1] = drawing.FOUND
    return rr.StateConfiguration(values=list(states), labels=list(states), colors=colors)


# ---------------------------------------------------------------- legends and description


def legends(sim: Simulation, stage: Stage) -> Entities:
    """A colour bar for every scale in use."""
    low, high = sim.scenario.recording.range_ppm
    scale = drawing.decades(low, high)
    where = f", {sim.scenario.recording.slice_height:g} m above the floor" if sim.grid.dim == 3 else ""
    name = " + ".join(species.name for species in sim.gas.species)
    yield from _legend("gas", f"{name} [ppm]{where}", scale, None, stage)
    if sim.maps:
        ratios = [(at, f"{label} x") for at, label in drawing.decades(*RATIOS)]
        weights = drawing.decades(*WEIGHTS)
        yield from _legend("estimate", "estimate [ppm]", scale, drawing.VIRIDIS, stage)
        yield from _legend("truth", "true mean since the start [ppm]", scale, drawing.VIRIDIS, stage)
        yield from _legend("weight", "weight of the estimate", weights, drawing.EMBER, stage)
        yield from _legend("error", "estimate over true mean", ratios, drawing.BLUE_RED, stage)


def _legend(name: str, title: str, scale: list[tuple[float, str]], palette: Any, stage: Stage) -> Entities:
    """A colour bar in front of the arena: the viewer has none of its own. palette: None is inferno."""
    width, left = 0.6 * stage.extent[0], 0.2 * stage.extent[0]
    pixel = width / 256
    thick = max(1, round(0.022 * stage.length / pixel))
    bottom = -0.03 * stage.length - thick * pixel
    ramp = np.tile(np.arange(256, dtype=np.uint8)[:, None], (1, thick))
    bar = rr.GridMap(
        data=drawing.rows(ramp if palette is None else drawing.painted(ramp / 255.0, palette)),
        format=picture_format(256, thick, palette is not None),
        cell_size=pixel,
        translation=[left, bottom, 0],
        colormap="inferno" if palette is None else None,
    )
    yield f"legend/{name}/bar", bar
    below = bottom - 0.012 * stage.length
    ticks = rr.Points3D(
        [[left + at * width, below, 0] for at, _ in scale],
        radii=rr.Radius.ui_points(1.0),
        colors=TEXT,
        labels=[label for _, label in scale],
        show_labels=True,
    )
    yield f"legend/{name}/ticks", ticks
    yield f"legend/{name}/title", _label(title, [left + width / 2, below - 0.045 * stage.length, 0], TEXT)


def about(sim: Simulation, backend: str, recorded: int) -> Entities:
    """The run's key facts and its resolved scenario."""
    scenario, grid = sim.scenario, sim.grid
    robots = "none"
    if sim.swarm.count:
        robots = f"{recorded} of {sim.swarm.count} recorded (of several trials the first)"
        if any(group.odometry for group in scenario.robots):
            robots += "; pale outlines and trails: where they believe to be"
    facts = {
        "arena": " x ".join(f"{length:g}" for length in grid.extent) + " m",
        "cells": " x ".join(str(n) for n in grid.shape) + f" = {prod(grid.shape):,} of {grid.dx:g} m",
        "time": f"{scenario.duration:g} s after {scenario.warm_up:g} s of warm-up, tick {sim.dt:g} s",
        "wind": f"{scenario.wind.kind}; the length of its arrows grows with the root of the speed",
        "gas": f"{scenario.gas.kind}, {len(scenario.sources)} source(s)",
        "robots": robots,
        "maps": ", ".join(gas_map.kind for gas_map in scenario.maps) or "none",
        "seed": str(scenario.seed),
        "backend": backend,
        "version": f"taichi_plume {__version__}",
    }
    table = "\n".join(f"| {key} | {value} |" for key, value in facts.items())
    text = f"# {scenario.name}\n\n| | |\n|---|---|\n{table}\n\n```yaml\n{to_yaml(scenario)}```\n"
    yield "about", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


# ---------------------------------------------------------------- small conversions


def _label(text: str, position: Any, color: tuple[int, ...]) -> rr.Points3D:
    return rr.Points3D(
        [position], radii=rr.Radius.ui_points(0.0), colors=color, labels=[text], show_labels=True
    )


def mesh(
    vertices: np.ndarray, triangles: np.ndarray, normals: np.ndarray, color: tuple[int, ...]
) -> rr.Mesh3D:
    """A mesh of one colour."""
    return rr.Mesh3D(
        vertex_positions=vertices, triangle_indices=triangles, vertex_normals=normals, albedo_factor=color
    )


def picture_format(width: int, height: int, color: bool) -> rr.components.ImageFormat:
    """Of a GridMap's bytes: RGBA, or one byte that the viewer colours."""
    model = "RGBA" if color else "L"
    return rr.components.ImageFormat(width=width, height=height, color_model=model, channel_datatype="U8")
