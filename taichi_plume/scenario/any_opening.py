"""What is asked of every opening."""

from collections.abc import Iterator, Sequence
from math import hypot
from typing import TYPE_CHECKING, ClassVar, Self

from pydantic import model_validator

from taichi_plume.scenario.domain import Context, Domain
from taichi_plume.scenario.quantities import fault
from taichi_plume.scenario.vocabulary import Color, Delay, Model, Temperature, Time, Velocities, Velocity
from taichi_plume.scenario.windows import LEAST_OPEN, MOSTLY_OPEN, Region

if TYPE_CHECKING:
    from taichi_plume.scenario.openings import Opening


class Change(Model):
    """One step of a schedule."""

    at: Time
    """When the change begins. The robots start at 0, the warm-up is before."""


class SpeedAt(Change):
    """From `at` on, blow with `speed`."""

    speed: Velocity
    """Mean speed into the room from then on; negative draws air out."""


class VelocityAt(Change):
    """From `at` on, slide with `velocity`."""

    velocity: Velocities
    """Velocity of the sliding wall from then on, per axis; 0 along the axis through it."""

    @property
    def speed(self) -> float:
        """Its magnitude [m/s]."""
        return hypot(*self.velocity)


class AnyOpening(Model):
    """What is asked of every opening."""

    color: ClassVar[Color] = (144, 164, 174)
    """In recordings."""

    straight: ClassVar[bool] = False
    """Whether its air comes in parallel, through a honeycomb."""

    @property
    def label(self) -> str:
        """What it is called."""
        return vars(self)["kind"]

    @property
    def blows(self) -> bool:
        """Whether the speed of its air is prescribed, or follows a fan's curve."""
        return False

    @property
    def lets_out(self) -> bool:
        """Whether air may leave through it as the pressure wants."""
        return False

    @property
    def passes(self) -> bool:
        """Whether air goes through it at all."""
        return self.blows or self.lets_out

    @property
    def warms(self) -> bool:
        """Whether the air that comes in has a temperature of its own."""
        return False

    @property
    def region(self) -> Region | None:
        """Where it lies; None where it takes both faces of an axis."""
        return None

    @property
    def wraps(self) -> str | None:
        """The axis along which it makes the domain periodic."""
        return None

    @property
    def changes(self) -> "tuple[SpeedAt | VelocityAt, ...]":
        """When its speed changes, and to what."""
        return ()

    @property
    def follows_pressure(self) -> bool:
        """Whether its speed follows a fan's curve."""
        return False

    @property
    def knots(self) -> tuple[float, ...]:
        """Times between which its speed changes linearly [s]."""
        return ()

    def top_speed(self, domain: Domain) -> float:
        """Largest speed that is prescribed for it [m/s]."""
        return 0.0

    def inflow(self, t: float, domain: Domain) -> float:
        """Air that is blown in at time t [m³/s]."""
        return 0.0

    def clashes(
        self, where: str, number: int, openings: "Sequence[Opening]", context: Context
    ) -> Iterator[str]:
        """What is wrong with its place, as one of several openings."""
        raise NotImplementedError


class Scheduled(AnyOpening):
    """An opening whose `schedule` of changes comes with its kind."""

    ramp: Delay = 0.5
    """Time that each scheduled change takes. 0 switches at once."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        times = [step.at for step in self.changes]
        if times != sorted(times):
            raise fault("schedule must be ordered by 'at'")
        return self

    @property
    def changes(self) -> "tuple[SpeedAt | VelocityAt, ...]":
        return vars(self)["schedule"]

    @property
    def knots(self) -> tuple[float, ...]:
        return tuple(time for step in self.changes for time in (step.at, step.at + self.ramp))

    def share(self, step: Change, t: float) -> float:
        """How much of a change has taken place at time t [s]."""
        if t < step.at:
            return 0.0
        return min(1.0, (t - step.at) / self.ramp) if self.ramp else 1.0

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        yield from super().remarks(where, context)
        end = context.scenario.duration
        for n, step in enumerate(self.changes):
            if step.at >= end:
                yield f"{where}.schedule[{n}].at: {step.at:g} s is not before the end at {end:g} s"


class FaceOpening(AnyOpening, Region):
    """An opening on a part of a face."""

    @property
    def region(self) -> Region:
        return self

    def clashes(
        self, where: str, number: int, openings: "Sequence[Opening]", context: Context
    ) -> Iterator[str]:
        yield from self.on_its_face(where, context)
        for m, other in enumerate(openings[:number]):
            if other.region is not None and self.overlaps(other.region, context.domain):
                yield (
                    f"{where}: overlaps wind.openings[{m}] ({other.kind}) on face {self.face}; "
                    "give both a center and a size that leave them apart"
                )


class Vent(FaceOpening):
    """An opening through which air may come in."""

    temperature: Temperature | None = None
    """Temperature of the air that comes in; unless given, `buoyancy.heat.reference`. It takes a wind with
    `buoyancy.heat`."""

    @property
    def warms(self) -> bool:
        return self.temperature is not None

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        yield from super().remarks(where, context)
        share = self.open_share(context, with_plates=False)
        if LEAST_OPEN <= share < MOSTLY_OPEN:
            flow = (
                f"; the same flow goes through the rest, {1 / share:.2g} times as fast" if self.blows else ""
            )
            yield f"{where}: obstacles cover a part of it, {100 * share:.0f} % of its area are open{flow}"

    def problems(self, where: str, context: Context) -> Iterator[str]:
        buoyancy = context.scenario.buoyancy
        if self.warms and (buoyancy is None or buoyancy.heat is None):
            yield (
                f"{where}.temperature: has no effect as the temperature of the air is not computed; "
                "add wind.buoyancy.heat or remove it"
            )
