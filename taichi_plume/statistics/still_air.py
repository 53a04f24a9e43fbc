"""Air in which robots stand side by side, each at the record of a point."""

from typing import Any

import taichi as ti

from taichi_plume.grid.fields import Wind
from taichi_plume.grid.kernels import Template


@ti.data_oriented
class Floor:
    """Nothing in the way."""

    @ti.func
    def distance(self, p: Template):
        """Of what is next [m]."""
        return 1e6

    @ti.func
    def normal(self, p: Template):
        """Away from it."""
        return ti.Vector([1.0, 0.0])


@ti.data_oriented
class Records(Wind):
    """Still air, with as much gas [ppm] at x = n m as stands in the field `level`; an `Odour` of one species."""

    def __init__(self, level: Any, species: Any):
        self.level, self.species = level, species

    def begin(self, model: Any, t: float, seed: int) -> None:
        """Nothing to begin with."""

    def advance(self, t: float, dt: float) -> None:
        """What the field holds is set from outside."""

    @ti.func
    def ppm(self, x: Template, t: float):
        """Mole fraction at a point."""
        return ti.Vector([self.level[ti.cast(ti.round(x[0]), ti.i32)]])

    @ti.func
    def velocity(self, x: Template, t: float):
        return ti.Vector([0.0, 0.0])
