"""What is asked of every wind."""

from math import inf
from typing import TYPE_CHECKING, ClassVar

from taichi_plume.scenario.vocabulary import Model

if TYPE_CHECKING:
    from taichi_plume.scenario.scenario import Scenario
    from taichi_plume.scenario.winds import CfdWind, UniformWind

GUST = 3.5  # largest sum of |u| over the axes, over the largest prescribed speed: 1.2 to 3.7 in the shipped scenarios


class AnyWind(Model):
    """What every wind answers."""

    on_grid: ClassVar[bool] = True
    """Whether it is known everywhere on the grid, to carry gas and to be recorded."""

    solved: ClassVar[bool] = False
    """Whether it is computed from step to step, which takes time; else it is known beforehand."""

    @property
    def computed(self) -> "CfdWind | None":
        """Itself where it is a computed flow."""
        return None

    @property
    def uniform(self) -> "UniformWind | None":
        """Itself where it is the same everywhere."""
        return None

    def top_speed(self, scenario: "Scenario") -> float | None:
        """Largest prescribed speed [m/s]; None where only its files tell."""
        return None

    def axes_speed(self, scenario: "Scenario") -> float:
        """Largest sum of |u| over the axes [m/s] that is to be expected; 0 where steps do not depend on it."""
        return GUST * (self.top_speed(scenario) or 0.0)

    def longest_step(self, scenario: "Scenario") -> float:
        """How long a step [s] it will allow, about."""
        speed = self.axes_speed(scenario)
        return scenario.domain.spacing / speed if speed else inf

    def moving(self, whole: float) -> float:
        """For how long of the `whole` time [s] it changes."""
        return whole
