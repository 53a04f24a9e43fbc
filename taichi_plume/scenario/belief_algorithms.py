"""Algorithms that keep a map of how probable a source is in each place, and say where it is."""

from collections.abc import Iterator
from math import sqrt
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from taichi_plume.scenario.listening import AnyAlgorithm, Listening
from taichi_plume.scenario.quantities import fault, ill_sized
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Duration,
    EddyDiffusivity,
    Frequency,
    Length,
    SomePpm,
    Speed,
    Wait,
)

if TYPE_CHECKING:
    from taichi_plume.scenario.arena import Arena
    from taichi_plume.scenario.robots import Group

MOST_BELIEFS = 250_000  # cells of a map of beliefs: a step of a robot looks at all of them five times


class Declares(AnyAlgorithm):
    """What algorithms share that believe in places of the source. See agents/beliefs.py."""

    believes: ClassVar[bool] = True
    declare_spread: Length | None = 0.2
    """Spread of its belief below which a robot says that the source is at the belief's mean. It is the root of the mean
    square distance of the source from there, as it believes: where a belief is normal and right, 0.2 m puts 95 % of
    these places within the usual reach, 0.35 m, of the source. null: it never says so; that is the default too where
    a single cell is less sure."""

    @property
    def may_declare(self) -> bool:
        return self.declare_spread is not None

    @property
    def least_spread(self) -> float:
        """The least that its belief can have [m]."""
        return 0.0

    @model_validator(mode="after")
    def _sayable(self) -> Self:
        """By default it says nothing where it is never sure, and a scenario with all defaults written out is the same
        one again.
        """
        if "declare_spread" not in self.model_fields_set and not self._reaches(self.declare_spread):
            object.__setattr__(self, "declare_spread", None)  # it is not asked for: not by setattr
        return self

    def _reaches(self, spread: float | None) -> bool:
        return spread is None or spread > self.least_spread

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        spread = self.declare_spread
        if group.found == "declared" and "declare_spread" not in self.model_fields_set:
            spread = type(self).model_fields["declare_spread"].default
        if not self._reaches(spread):
            yield (
                f"{where}.algorithm.declare_spread: {spread:g} m is never reached, as a single cell has a "
                f"spread of {self.least_spread:.3g} m; raise it, or lower cell"
            )
        yield from super().in_group(where, group, floor)


class AnyInfotaxis(Listening, Declares):
    """What the kinds of infotaxis share. See agents/infotaxis.py."""

    searches: ClassVar[bool] = True
    kind: str
    acquisition: Wait = 2.0
    threshold_ppm: SomePpm = 5.0
    """Mean reading of an acquisition that counts as a detection."""
    step: Length = 0.25
    """Way driven after each acquisition, unless it stays."""
    cell: Annotated[Length, COMPILED] = 0.1
    """Edge of the cells of the robot's map of beliefs. Smaller ones take longer."""
    rate: Frequency = 1.0
    """Detections per second close to the source, in the model that the robot believes in."""
    diffusivity: Annotated[EddyDiffusivity, Field(ge=1e-9)] = 0.05
    """Diffusivity of patches of gas, in the model that the robot believes in. More makes its plume wider."""
    wind_speed: Speed = 0.5
    """Mean speed of the wind, in the model that the robot believes in."""
    lifetime: Duration = 10.0
    """How long patches of gas last, in the model that the robot believes in."""
    size: Length = 0.05
    """Size of what detects patches, in the model that the robot believes in; small beside the plume."""

    @property
    def threshold(self) -> float:
        return self.threshold_ppm

    @property
    def reach(self) -> float:
        """How far patches get across the wind: lambda [m]."""
        D, V, tau = self.diffusivity, self.wind_speed, self.lifetime
        return sqrt(D * tau / (1.0 + V**2 * tau / (4.0 * D)))

    @property
    def least_spread(self) -> float:
        return self.cell / sqrt(6.0)

    def unfit(self, where: str, floor: "Arena") -> str | None:
        return ill_sized(f"{where}.algorithm.cell", self.cell, floor.size, MOST_BELIEFS)

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """Of the beliefs of every robot, and of the chances of a detection on half cells around it."""
        cells = floor.size[0] * floor.size[1] / self.cell**2
        chances = 16.0 * (floor.size[0] ** 2 + floor.size[1] ** 2) / self.cell**2
        return 4.0 * (group.count * group.trials * cells + chances)

    @model_validator(mode="after")
    def _small(self) -> "AnyInfotaxis":
        if self.size >= self.reach:
            raise fault(
                "size = {size} m must be below lambda = {reach} m; lower it, or raise diffusivity",
                {"size": f"{self.size:g}", "reach": f"{self.reach:.3g}"},
            )
        return self


class Infotaxis(AnyInfotaxis):
    """The way that is expected to tell most about the source (Vergassola et al. 2007). See agents/infotaxis.py."""

    kind: Literal["infotaxis"]  # type: ignore[assignment]


class SpaceAwareInfotaxis(AnyInfotaxis):
    """Infotaxis that also wants to be near the source (Loisy & Eloy 2022). See agents/space_aware_infotaxis.py."""

    kind: Literal["space_aware_infotaxis"]  # type: ignore[assignment]
