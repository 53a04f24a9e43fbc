"""The shapes that obstacles have."""

from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.shapes import Ball, Shape, UprightBox, UprightCylinder, UprightPrism
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Obstacle

# Of each kind: how its shape is made of the model, the dimension, the height of the ceiling [m] and the folder of files
SHAPES: dict[str, Callable[[Any, int, float, Path], Shape]] = {
    "box": lambda box, dim, ceiling, folder: UprightBox(box, dim),
    "cylinder": lambda cylinder, dim, ceiling, folder: UprightCylinder(cylinder, dim, ceiling),
    "sphere": lambda sphere, dim, ceiling, folder: Ball(sphere, dim),
    "prism": lambda prism, dim, ceiling, folder: UprightPrism(prism, dim, ceiling),
    "mesh": lambda mesh, dim, ceiling, folder: Solid(mesh, dim, folder),
}


def shape(obstacle: Obstacle, domain: Domain, folder: Path) -> Shape:
    """The shape of one obstacle; mesh files lie in `folder`. Raises MeshError."""
    ceiling = domain.extent[2] if domain.dim == 3 else inf
    return SHAPES[obstacle.kind](obstacle, domain.dim, ceiling, folder)
