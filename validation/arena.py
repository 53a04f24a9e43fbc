"""Odour arena of benchmarks and cases, 4 x 3 (x 0.5) m: openings and obstacles."""

from pathlib import Path

from pydantic import TypeAdapter

from taichi_plume.grid.cut_cells import Air, air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.shapes import shape as shape_of

ARENA = (
    {"kind": "honeycomb", "face": "x-", "speed": 0.7},
    {"kind": "honeycomb", "face": "x+", "loss_coefficient": 2.0},
)

OBSTACLES = (
    {"kind": "box", "center": (2.4, 2.35, 0.25), "size": (0.4, 0.3, 0.5)},
    {"kind": "box", "center": (2.3, 0.9, 0.25), "size": (0.36, 0.36, 0.5), "yaw_deg": 20.0},
    {"kind": "cylinder", "center": (1.0, 1.9), "radius": 0.12},
)


def arena(shape: tuple[int, ...], obstacles: bool, periodic: tuple[bool, ...] = ()) -> tuple[Grid, Air]:
    """Return the grid and the air of the odour arena, empty or with two boxes and a pillar."""
    grid = Grid(shape, 4.0 / shape[0], depth=0.5, periodic=periodic)
    domain = Domain(size=grid.extent, spacing=grid.dx)
    bodies = [TypeAdapter(Obstacle).validate_python(o) for o in OBSTACLES] if obstacles else []
    return grid, air_of([shape_of(body, domain, Path()) for body in bodies], grid)
