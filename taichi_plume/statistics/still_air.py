"""Still air for sensor tests: robots stand side by side, each at the concentration time series of a point."""

import taichi as ti

from taichi_plume.grid.fields import Wind
from taichi_plume.grid.kernels import Template


@ti.data_oriented
class Floor:
    """Floor without obstacles."""

    @ti.func
    def distance(self, p: Template):
        """Return the distance of point p from obstacles [m]; here without obstacles, a million."""
        return 1e6

    @ti.func
    def normal(self, p: Template):
        """Direction away from the nearest obstacle."""
        return ti.Vector([1.0, 0.0])


@ti.data_oriented
class Records(Wind):
    """Still air with the field `level` of concentrations [ppm] at x = 0, 1, 2 ... m; an `Odour` of one species."""

    def __init__(self, level: ti.Field, species: object):
        self.level, self.species = level, species

    def begin(self, model: object, t: float, seed: int) -> None:
        """Do nothing."""

    def advance(self, t: float, dt: float) -> None:
        """Do nothing: the caller sets the field."""

    @ti.func
    def ppm(self, x: Template, t: float):
        """Mole fraction at a point."""
        return ti.Vector([self.level[ti.cast(ti.round(x[0]), ti.i32)]])

    @ti.func
    def velocity(self, x: Template, t: float):
        return ti.Vector([0.0, 0.0])
