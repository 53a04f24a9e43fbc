"""Base class of the winds of a scenario: expected air speeds and time steps (CFL condition)."""

from math import inf
from typing import TYPE_CHECKING, ClassVar

from taichi_plume.scenario.vocabulary import Model

if TYPE_CHECKING:
    from taichi_plume.scenario.scenario import Scenario
    from taichi_plume.scenario.winds import CfdWind, UniformWind

GUST = 3.5  # largest sum of |u| over the axes, over the largest prescribed speed: 1.2 to 3.7 in the shipped scenarios


class AnyWind(Model):
    """Base class of the winds: their properties."""

    on_grid: ClassVar[bool] = True
    """Whether the wind is known everywhere on the grid, to carry gas and to be recorded."""

    solved: ClassVar[bool] = False
    """Whether a solver advances the wind, which takes time; otherwise it is known in advance."""

    walled: ClassVar[bool] = False
    """Whether walls close all faces of the domain but for the openings."""
    computed: ClassVar["CfdWind | None"] = None
    """The wind itself if it is a computed flow."""

    uniform: ClassVar["UniformWind | None"] = None
    """The wind itself if it is uniform."""

    def top_speed(self, scenario: "Scenario") -> float | None:
        """Return the largest prescribed wind speed [m/s] of a scenario; None if only recorded files decide it."""
        return None

    def axes_speed(self, scenario: "Scenario") -> float:
        """Return the expected largest |u| + |v| + |w| [m/s], gusts included; 0 if time steps do not depend on it."""
        return GUST * (self.top_speed(scenario) or 0.0)

    def longest_step(self, scenario: "Scenario") -> float:
        """Return about the longest time step [s] that the CFL condition allows; infinite without a speed."""
        speed = self.axes_speed(scenario)
        return scenario.domain.spacing / speed if speed else inf

    def moving(self, whole: float) -> float:
        """Return for how much of a run of `whole` seconds the wind changes [s]; here, all of it."""
        return whole
