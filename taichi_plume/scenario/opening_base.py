"""Base classes of the openings, which are boundary conditions of the flow."""

from collections.abc import Iterator
from math import hypot
from typing import ClassVar

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, Domain
from taichi_plume.scenario.palette import OPENING, rgb
from taichi_plume.scenario.vocabulary import Color, Model, ordered_schedule
from taichi_plume.scenario.windows import LEAST_OPEN, MOSTLY_OPEN, Region


class Change(Model):
    """Step of a schedule."""

    at: si.Time
    """Time when the change starts. The robots start at 0, the warm-up is before."""


class SpeedAt(Change):
    """Change of the speed: from `at` on the opening blows with `speed`."""

    speed: si.Velocity
    """Mean speed into the room from then on; negative draws air out."""


class VelocityAt(Change):
    """Change of the velocity: from `at` on the wall slides with `velocity`."""

    velocity: si.Velocities
    """Velocity of the sliding wall from then on, per axis; 0 along the axis through it."""

    @property
    def speed(self) -> float:
        """Magnitude of the velocity [m/s]."""
        return hypot(*self.velocity)


class AnyOpening(Model):
    """Base class of the openings: their properties."""

    color: ClassVar[Color] = rgb(OPENING)
    """Colour in recordings; on paper it is darker."""
    straight: ClassVar[bool] = False
    """Whether a honeycomb makes the incoming air parallel."""
    blows: ClassVar[bool] = False
    """Whether the air speed is prescribed, or follows the curve of a fan."""
    lets_out: ClassVar[bool] = False
    """Whether air may leave freely, driven by the pressure."""
    warms: ClassVar[bool] = False
    """Whether the incoming air has a temperature of its own."""
    region: "ClassVar[Region | None]" = None
    """Part of a face; None if the opening takes both faces of an axis."""
    wraps: ClassVar[str | None] = None
    """Axis along which the opening makes the domain periodic."""
    changes: "ClassVar[tuple[SpeedAt | VelocityAt, ...]]" = ()
    """Scheduled changes of the speed."""
    follows_pressure: ClassVar[bool] = False
    """Whether the speed follows the curve of a fan."""
    knots: ClassVar[tuple[float, ...]] = ()
    """Times between which the speed changes linearly [s]."""

    @property
    def label(self) -> str:
        """Name of the opening in recordings; by default, its kind."""
        return vars(self)["kind"]

    @property
    def passes(self) -> bool:
        """Whether air goes through the opening."""
        return self.blows or self.lets_out

    @property
    def direction(self) -> int:
        """Direction of the air: 1 into the room, -1 out of the room, 0 if no air passes."""
        if not self.passes:
            return 0
        return 1 if self.blows and (vars(self).get("speed") or 0.0) >= 0 else -1

    def top_speed(self, domain: Domain) -> float:
        """Return the largest speed [m/s] that the opening prescribes at any time; 0 if it prescribes none."""
        return 0.0

    def inflow(self, t: float, domain: Domain) -> float:
        """Return the flow rate [m³/s] that the opening blows into the room at time t [s]; negative if drawn out."""
        return 0.0

    def placement_errors(self, where: str, number: int, context: Context) -> Iterator[str]:
        """Yield errors of this opening's position. number: its index in the list; where: its path, for messages."""
        raise NotImplementedError


class Scheduled(AnyOpening):
    """An opening whose `schedule` of changes comes with its kind."""

    ramp: si.Delay = 0.5
    """Time that each scheduled change takes. 0 switches at once."""

    _ordered = ordered_schedule()

    @property
    def changes(self) -> "tuple[SpeedAt | VelocityAt, ...]":
        return vars(self)["schedule"]

    @property
    def knots(self) -> tuple[float, ...]:
        return tuple(time for step in self.changes for time in (step.at, step.at + self.ramp))

    def progress(self, step: Change, t: float) -> float:
        """Return the completed fraction of a change at time t [s]."""
        if t < step.at:
            return 0.0
        return min(1.0, (t - step.at) / self.ramp) if self.ramp else 1.0

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        yield from super().warnings(where, context)
        end = context.scenario.duration
        for n, step in enumerate(self.changes):
            if step.at >= end:
                yield f"{where}.schedule[{n}].at: {step.at:g} s is not before the end at {end:g} s"


class FaceOpening(AnyOpening, Region):
    """An opening on a part of a face."""

    @property
    def region(self) -> Region:
        return self

    def placement_errors(self, where: str, number: int, context: Context) -> Iterator[str]:
        yield from self.on_its_face(where, context)
        for m, other in enumerate(context.scenario.openings[:number]):
            if other.region is not None and self.overlaps(other.region, context.domain):
                yield (
                    f"{where}: overlaps wind.openings[{m}] ({other.kind}) on face {self.face}; "
                    "give both a center and a size that leave them apart"
                )


class Vent(FaceOpening):
    """An opening through which air may come in."""

    temperature: si.Temperature | None = None
    """Temperature of the air that comes in; unless given, `buoyancy.heat.reference`. It takes a wind with
    `buoyancy.heat`."""

    @property
    def warms(self) -> bool:
        return self.temperature is not None

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        yield from super().warnings(where, context)
        fraction = self.open_share(context, with_plates=False)
        if LEAST_OPEN <= fraction < MOSTLY_OPEN:
            flow = f"; the flow through the rest is {1 / fraction:.2g} times as fast" if self.blows else ""
            yield f"{where}: obstacles cover a part of it, {100 * fraction:.0f} % of its area are open{flow}"

    def errors(self, where: str, context: Context) -> Iterator[str]:
        if self.warms and context.scenario.heat is None:
            yield f"{where}.temperature: has no effect without wind.buoyancy.heat; add that or remove it"
