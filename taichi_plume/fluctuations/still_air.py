"""Still air for tests of gas sensors: robots stand side by side, each in the gas time series of one point."""

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.fields import Wind
from taichi_plume.grid.kernels import Template


class Floor:
    """Floor without obstacles for robots: signed-distance interface of an arena."""

    @ti.func
    def distance(self, p: Template):
        """Return the distance of point p from obstacles [m]; here without obstacles, a million."""
        return 1e6

    @ti.func
    def normal(self, p: Template):
        """Return the direction away from obstacles; here without obstacles, always x."""
        return ti.Vector([1.0, 0.0])


class Records(Wind):
    """Still air with given concentrations `level` [ppm] of one gas species at the points x = 0, 1, 2 ... m."""

    def __init__(self, level: Field, species: object):
        self.level, self.species = level, species

    def advance(self, t: float, dt: float) -> None:
        """Do nothing: the caller sets the concentrations."""

    @ti.func
    def ppm(self, x: Template, t: float):
        """Return the concentration [ppm] at point x, as a vector of one species."""
        return ti.Vector([self.level[ti.cast(ti.round(x[0]), ti.i32)]])

    @ti.func
    def velocity(self, x: Template, t: float):
        return ti.Vector([0.0, 0.0])
