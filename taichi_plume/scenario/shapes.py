"""Geometric shapes of a scenario's obstacles, by the kind of obstacle."""

from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

from taichi_plume.grid.floor_plans import FloorPlan
from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.shapes import Ball, Shape, UprightBox, UprightCylinder, UprightPrism
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Obstacle

# Shape of each kind by its model, the extent of the domain [m] and the folder of input files
SHAPES: dict[str, Callable[[Any, tuple[float, ...], Path], Shape]] = {
    "box": lambda box, extent, folder: UprightBox(box, len(extent)),
    "cylinder": lambda cylinder, extent, folder: UprightCylinder(cylinder, len(extent), _ceiling(extent)),
    "sphere": lambda sphere, extent, folder: Ball(sphere, len(extent)),
    "prism": lambda prism, extent, folder: UprightPrism(prism, len(extent), _ceiling(extent)),
    "mesh": lambda mesh, extent, folder: Solid(mesh, len(extent), folder),
    "map": lambda plan, extent, folder: FloorPlan(plan, extent, folder),
}


def shape(obstacle: Obstacle, domain: Domain, folder: Path) -> Shape:
    """Return the geometric shape of an obstacle; folder: where its input file lies, if any. Raises ShapeError."""
    return SHAPES[obstacle.kind](obstacle, domain.extent, folder)


def _ceiling(extent: tuple[float, ...]) -> float:
    """Return the height of the ceiling [m] of a domain of this extent [m]; infinite in 2-D."""
    return extent[2] if len(extent) == 3 else inf
