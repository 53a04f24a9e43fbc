"""Search algorithms that follow a plume upwind: casting, surge-cast, surge-spiral."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.quantities import number
from taichi_plume.scenario import si
from taichi_plume.scenario.search_algorithm import AnyAlgorithm

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Arena
    from taichi_plume.scenario.robots import Group


class PlumeTracking(AnyAlgorithm):
    """Algorithms that follow a plume upwind. See agents/tracking.py."""

    searches: ClassVar[bool] = True
    kind: str
    speed: si.Speed | None = None
    """Speed at which they drive; unless given, the body's largest. With 0 they stand and keep their heading."""
    threshold_ppm: si.SomePpm = 5.0
    """Reading above which a robot is in the plume; it leaves it at 70 % of that. Set it above the sensor's noise and
    below the plume's concentration in the search area."""
    lost_distance: si.Length = 0.3
    """Distance travelled without gas before the plume counts as lost. Longer bridges gaps between whiffs."""
    find_step: si.Length = 0.3
    """Step upwind between crosswind sweeps, while no plume has been found."""
    peak_fraction: si.Fraction = 0.7
    """Fraction of the last peak below which a robot is out of the plume too, for slow sensors; 0 switches it off."""
    wind_memory: si.Delay = 1.0
    """Time constant of the average of the measured wind's direction. Longer ignores gusts."""


class Casting(PlumeTracking):
    """Upwind while in the plume, crosswind when it is lost (Lochmatter & Martinoli's family). See agents/casting.py."""

    kind: Literal["casting"]  # type: ignore[assignment]
    upwind_angle_deg: Annotated[float, *number(0, 80, "deg")] = 20.0
    """Angle between the course in the plume and straight upwind; 0 surges."""
    cast_distance: si.Length = 0.6
    """First crosswind search after the loss of the plume; doubled at each failure."""


class Casting3D(PlumeTracking):
    """Upwind in the plume, casts both ways across the wind when it is lost: for drones. See agents/casting_3d.py."""

    in_space: ClassVar[bool] = True
    kind: Literal["casting_3d"]  # type: ignore[assignment]
    cast_distance: si.Length = 0.3
    """First crosswind cast along the ground, when the plume is lost; later ones are twice, three times as far."""
    cast_rise: si.Length = 0.2
    """First cast upward or downward, when the plume is lost; later ones are twice, three times as far."""
    turns: Annotated[int, Field(ge=1, le=100)] = 3
    """Number of rounds about the position where the plume was lost before the search starts again."""
    find_rise: si.Length = 0.4
    """Rise between crosswind sweeps, while no plume has been found."""
    lowest: si.Distance = 0.3
    """Lowest altitude at which it searches, of the lower end of the body."""
    highest: si.Distance = 2.0
    """Highest altitude at which it searches; below the ceiling."""

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        if not group.body.flies:
            yield f"{where}.algorithm: casting_3d is for drones; give body.kind: drone, or use casting"
        if self.lowest >= self.highest:
            yield f"{where}.algorithm.lowest: {self.lowest:g} m must be below highest = {self.highest:g} m"


class SurgeCast(PlumeTracking):
    """Straight upwind in the plume, crosswind to both sides when it is lost. See agents/surge_cast.py."""

    kind: Literal["surge_cast"]  # type: ignore[assignment]
    cast_distance: si.Length = 0.4
    """First crosswind search after the loss of the plume. The next goes back and as far to the other side, and each
    pair twice as far."""


class SurgeSpiral(PlumeTracking):
    """Straight upwind in the plume, along a spiral when it is lost. See agents/surge_spiral.py."""

    kind: Literal["surge_spiral"]  # type: ignore[assignment]
    gap: si.Length = 0.3
    """Distance between two turns of the spiral; less than a plume's width finds it."""
    turns: si.SomeCoefficient = 4.0
    """Turns of a spiral before the search starts again."""
