"""What a scenario's files and obstacles are made of, each opened once."""

from math import inf
from pathlib import Path

from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.shapes import Ball, Shape, UprightBox, UprightCylinder, UprightPrism
from taichi_plume.scenario import obstacles
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.scenario import Scenario


def shape(obstacle: obstacles.Obstacle, domain: Domain, folder: Path) -> Shape:
    """The shape of one obstacle; mesh files lie in `folder`. Raises MeshError."""
    ceiling = domain.extent[2] if domain.dim == 3 else inf
    match obstacle:
        case obstacles.Box():
            return UprightBox(obstacle, domain.dim)
        case obstacles.Cylinder():
            return UprightCylinder(obstacle, domain.dim, ceiling)
        case obstacles.Sphere():
            return Ball(obstacle, domain.dim)
        case obstacles.Prism():
            return UprightPrism(obstacle, domain.dim, ceiling)
        case obstacles.Mesh():
            return Solid(obstacle, domain.dim, folder)


def shapes(scenario: Scenario, folder: Path) -> list[Shape]:
    """The shapes of a scenario's obstacles, in their order; mesh files lie in `folder`. Raises MeshError."""
    return [shape(obstacle, scenario.domain, folder) for obstacle in scenario.obstacles]
