"""Static scene of a recording: arena, obstacles, openings, heaters, sources, robots' bodies, outlines of planes.

Functions yield or return rerun archetypes; `Entities` are pairs (entity path, archetype).
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike

from taichi_plume.grid.shapes import Blocks, Shape
from taichi_plume.observed.planes import Plane, Raster
from taichi_plume.record import drawing
from taichi_plume.record.placement import Stage, label, mesh, picture, placed
from taichi_plume.scenario import si
from taichi_plume.scenario.gases import AnySource
from taichi_plume.scenario.heat import Heat
from taichi_plume.scenario.palette import COOL, FOUND, SOLID, SOURCE, WARM, WRONG, rgb
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import Color
from taichi_plume.scenario.windows import Window
from taichi_plume.time_loop import TimeLoop

BODY = 0.009  # robots are drawn at least this large, over the arena's length
ESTIMATES = {
    "estimate": drawing.VIRIDIS,
    "truth": drawing.VIRIDIS,
    "weight": drawing.EMBER,
    "error": drawing.BLUE_RED,
}
"""Pictures of a map with their palettes."""

FLOOR = (44, 48, 58)
LINES = (150, 160, 175)
FAINT = (90, 98, 112)
WALKER = (225, 245, 254)
TEXT = (205, 210, 218)
WHITE = (255, 255, 255)

Entities = Iterator[tuple[str, rr.AsComponents]]


# ---------------------------------------------------------------- arena


def arena(scenario: Scenario, obstacles: Sequence[Shape], stage: Stage) -> Entities:
    """Yield floor, edges, the robots' part of the floor, obstacles, sources, openings and screens."""
    (lx, ly), h = stage.extent[:2], stage.height

    def ring(z: float, low: si.Point2 = (0, 0), high: si.Point2 = (lx, ly)) -> list[list[float]]:
        (x0, y0), (x1, y1) = low, high
        return [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z], [x0, y0, z]]

    yield "/", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    posts = [[[x, y, 0], [x, y, h]] for x in (0, lx) for y in (0, ly)]
    yield "world/outline", rr.LineStrips3D([ring(0)], colors=LINES, radii=rr.Radius.ui_points(1.5))
    yield "world/walls", rr.LineStrips3D([ring(h), *posts], colors=FAINT, radii=rr.Radius.ui_points(0.8))
    half = [lx / 2, ly / 2, 2 * stage.lift]
    yield "world/floor", _boxes([[lx / 2, ly / 2, -3 * stage.lift]], [half], FLOOR)
    if scenario.arena is not None:
        edges = ring(stage.lift, scenario.arena.low, scenario.arena.high)
        yield "world/arena", rr.LineStrips3D([edges], colors=LINES, radii=rr.Radius.ui_points(1.5))
    for n, shape in enumerate(obstacles):
        walks = n < len(scenario.obstacles) and scenario.obstacles[n].motion is not None
        yield f"world/obstacles/{n}", _solid(shape, stage, WALKER if walks else rgb(SOLID))
        if walks:
            yield from _walk(n, shape.model, stage)
    for n, (_, source) in enumerate(scenario.sources):
        if not changes(source):
            yield from source_ball(n, source, source.position, stage)
        yield from _way(n, source, stage)
    for n, opening in enumerate(scenario.openings):
        if (region := opening.region) is not None:
            name = opening.label if opening.passes else None
            yield from _window(f"world/openings/{n}", region, opening.color, opening.straight, name, stage)
    for n, screen in enumerate(scenario.screens):
        yield from _window(f"world/screens/{n}", screen, screen.color, True, screen.kind, stage)
    if scenario.heat is not None:
        yield from _warmth(scenario.heat, stage)


def _walk(n: int, model: Any, stage: Stage) -> Entities:
    """Yield the name of a moving obstacle, and its path."""
    center = np.array(model.center[:2])
    way = np.array([center, *(point[1:] for point in model.motion.path)])
    way = np.column_stack([way, np.full(len(way), stage.lift)])
    yield f"world/walks/{n}", rr.LineStrips3D([way], colors=WALKER, radii=rr.Radius.ui_points(0.7))
    yield f"world/obstacles/{n}/name", label("walker", [*center, stage.height], WALKER)


def _warmth(heat: Heat, stage: Stage) -> Entities:
    """Yield heaters, and walls that keep a temperature, in one colour if warmer than the air and another if cooler."""
    for n, heater in enumerate(heat.heaters):
        center = [*heater.position, *[stage.height / 2] * (3 - len(heater.position))]
        color = rgb(WARM if heater.power >= 0 else COOL)
        half = [min(heater.radius, stage.height / 2 if len(stage.extent) == 2 else heater.radius)] * 3
        ball = rr.Ellipsoids3D(
            centers=[center], half_sizes=[half], colors=color, line_radii=rr.Radius.ui_points(0.8)
        )
        yield f"world/heaters/{n}", ball
        below = [*center[:2], max(0.0, center[2] - heater.radius)]
        yield f"world/heaters/{n}/name", label(f"heater {heater.power:g} W", below, color)
    for n, wall in enumerate(heat.walls):
        color = rgb(WARM if wall.temperature >= heat.reference else COOL)
        name = f"{wall.temperature:.4g} K"
        yield from _window(f"world/tempered/{n}", wall, color, False, name, stage)


def _boxes(centers: ArrayLike, halves: ArrayLike, color: Color) -> rr.Boxes3D:
    return rr.Boxes3D(centers=centers, half_sizes=halves, fill_mode="solid", colors=color)


def _solid(shape: Shape, stage: Stage, color: Color) -> rr.AsComponents:
    """Return the drawn shape of an obstacle; in a flat arena obstacles are as high as the walls."""
    if isinstance(shape, Blocks):  # boxes take a tenth of the bytes of their mesh
        low, high = np.moveaxis(shape.boxes_in(stage.size), 1, 0)
        return _boxes((low + high) / 2, (high - low) / 2, color)
    return mesh(shape.mesh(stage.size), color)


def changes(source: AnySource) -> bool:
    """Return whether a source moves, appears or ends, so that it cannot be drawn once for the whole run."""
    return vars(source).get("motion") is not None or source.on != (-np.inf, np.inf)


def _way(n: int, source: AnySource, stage: Stage) -> Entities:
    """Yield the path of a source that moves."""
    motion = vars(source).get("motion")
    if motion is not None:
        way = np.array([source.position, *(point[1:] for point in motion.path)])
        way = np.column_stack([way, np.full((len(way), 3 - way.shape[1]), stage.height / 2)])
        yield f"world/ways/{n}", rr.LineStrips3D([way], colors=rgb(SOURCE), radii=rr.Radius.ui_points(0.7))


def source_ball(n: int, source: AnySource, place: Sequence[float] | np.ndarray, stage: Stage) -> Entities:
    """Yield gas source n at a place [m]: a crimson ball with the source's name above in white."""
    entity, position = f"world/sources/{n}", [*place, *[stage.height / 2] * (3 - len(place))]
    radius = max(source.radius, 0.006 * stage.length)
    if len(stage.extent) == 2:
        radius = min(radius, 0.02 * stage.length)
    yield entity, rr.Points3D([position], radii=radius, colors=rgb(SOURCE))
    y = min(position[1] + radius + 0.1 * stage.length, stage.extent[1])
    yield f"{entity}/name", label("source", [position[0], y, position[2] + radius], WHITE)


def _window(
    entity: str, window: Window, color: Color, combed: bool, name: str | None, stage: Stage
) -> Entities:
    """Yield an opening or a screen; combed: with lines across it; name: of an opening that lets air pass, else None."""
    outline = np.clip(window.outline(stage.extent, height=stage.height), 0.0, stage.size)
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
    across = 0.0 < outline[:, window.normal].mean() < stage.size[window.normal]
    yield f"{entity}/name", label(name, _within(outline, stage, across), color)


def _within(outline: np.ndarray, stage: Stage, near: bool) -> np.ndarray:
    """Return the position of an opening's name: at its far or near end, inside the arena so that it is not cut off."""
    x, y = outline[:, 0].mean(), outline[:, 1].min() if near else outline[:, 1].max()
    margin = np.minimum(np.array([0.13, 0.04]) * stage.length, np.array(stage.extent[:2]) / 2)
    place = np.clip([x, y], margin, np.array(stage.extent[:2]) - margin)
    return np.array([*place, outline[:, 2].max()])


# ---------------------------------------------------------------- robots and series


def body(radius: float, height: float, color: tuple[int, ...], stage: Stage) -> rr.Mesh3D:
    """Return a robot's body, pointed in front; in large arenas it is enlarged."""
    grown = max(radius, BODY * stage.length)
    return mesh(drawing.robot_mesh(grown, max(height * grown / radius, 0.5 * grown)), color)


def ghost(radius: float, color: tuple[int, ...], stage: Stage) -> rr.LineStrips3D:
    """Return the estimated pose of a robot: the outline of its body, with a line to the front."""
    grown = max(radius, BODY * stage.length)
    angles = np.linspace(0, 2 * np.pi, 33)
    ring = grown * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    front = [[0, 0, 0], [1.6 * grown, 0, 0]]
    return rr.LineStrips3D([ring, front], colors=color, radii=rr.Radius.ui_points(1.2))


def declared(place: np.ndarray, right: bool, text: str, stage: Stage) -> rr.LineStrips3D:
    """Return the mark of a declared source position, (2,) [m]: a named ring and cross, coloured by right or wrong."""
    size, height = 2.2 * BODY * stage.length, 4 * stage.lift
    angles = np.linspace(0, 2 * np.pi, 33)
    strips = [size * np.column_stack([np.cos(angles), np.sin(angles)])]
    strips += [size * np.array([[-s, -1.0], [s, 1.0]]) / np.sqrt(2) for s in (1, -1)]
    return rr.LineStrips3D(
        [np.column_stack([place + strip, np.full(len(strip), height)]) for strip in strips],
        colors=rgb(FOUND if right else WRONG),
        radii=rr.Radius.ui_points(2.2),
        labels=[text, "", ""],
        show_labels=True,
    )


def lanes(states: tuple[str, ...], colors: Mapping[str, str]) -> rr.StateConfiguration:
    """Return the colours of a robot's states; colors: by name, see `palette.state_colors`; the last is "found"."""
    shown = [rgb(colors[name]) for name in states[:-1]] + [rgb(FOUND)]
    packed = np.array([int.from_bytes((*color, 255)) for color in shown], np.uint32)
    return rr.StateConfiguration(values=list(states), labels=list(states), colors=packed)


# ---------------------------------------------------------------- vertical sections


def section(sim: TimeLoop, raster: Raster, stage: Stage) -> Entities:
    """Yield the edges of a vertical section, its solid part, and the names of the sources beside it."""
    plane, name = raster.plane, f"outlines/{raster.plane.name}"
    u, v = (stage.extent[d] for d in plane.axes)
    edges = placed(plane, [[0, 0], [u, 0], [u, v], [0, v], [0, 0]], stage, 4)
    yield f"{name}/edges", rr.LineStrips3D([edges], colors=LINES, radii=rr.Radius.ui_points(1.5))
    solid = raster.solid
    if solid.any():
        pixels = np.zeros((*solid.shape, 4), np.uint8)
        pixels[solid] = (*rgb(SOLID), 255)
        how = {"color": True, "above": 3.0, "data": drawing.rows(pixels)}
        yield f"{name}/solid", picture(plane, solid.shape, raster.cell[0], raster.origin, stage, **how)
    near = beside(sim, plane)
    for n, (_, source) in enumerate(sim.scenario.sources):
        if f"sources/{n}" in near and not changes(source):
            x, z = (source.position[d] for d in plane.axes)
            above = placed(plane, [[x, min(z + source.radius + 0.14 * stage.length, v)]], stage, 8)[0]
            yield f"{name}/sources/{n}", label("source", above, WHITE)


def beside(sim: TimeLoop, plane: Plane) -> list[str]:
    """Return the entity names of sources and heaters that touch or nearly touch a vertical section, or move."""
    heat = sim.scenario.heat
    there = [(f"sources/{n}", thing) for n, (_, thing) in enumerate(sim.scenario.sources)]
    there += [(f"heaters/{n}", heater) for n, heater in enumerate(heat.heaters if heat is not None else ())]
    normal, level = plane.normal or 0, plane.level or 0.0
    return [
        name
        for name, thing in there
        if vars(thing).get("motion") is not None
        or abs(thing.position[normal] - level) < thing.radius + sim.grid.dx
    ]
