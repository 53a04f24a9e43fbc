"""What the checks of a section may look at, and what several of them say."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taichi_plume.assembly.resources import Resources
    from taichi_plume.scenario.domain import Domain
    from taichi_plume.scenario.scenario import Scenario


@dataclass(frozen=True)
class Context:
    """What a check may look at."""

    scenario: "Scenario"
    resources: "Resources"

    @property
    def domain(self) -> "Domain":
        """The box that is simulated."""
        return self.scenario.domain


def span(axis: str, low: float, high: float) -> str:
    """Where something lies along an axis, in words."""
    return f"{axis} {low:.4g} to {high:.4g} m"
