"""Openings and screens of a scenario: where air comes in and out, and what straightens it."""

from math import pi, prod
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from taichi_plume.scenario.quantities import fault
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Coordinate,
    Delay,
    Distance,
    Duration,
    Face,
    FlowRate,
    Fraction,
    Length,
    Model,
    NonNegative,
    Pressure,
    Real,
    Temperature,
    Time,
    Velocity,
)


class SpeedAt(Model):
    """One step of a schedule: from `at` on, blow with `speed`."""

    at: Time
    """Simulated time [s]; the robots start at 0, the warm-up is before."""
    speed: Velocity


class Window(Model):
    """Part of a plane: all of it, a rectangle (`center`, `size`) or a disc (`center`, `diameter`).

    `center` and `size` are in the plane's own axes, in their x, y, z order: one number in 2-D, two in 3-D.
    """

    center: Annotated[tuple[Coordinate, ...], Field(min_length=1, max_length=2), COMPILED] | None = None
    size: Annotated[tuple[Length, ...], Field(min_length=1, max_length=2), COMPILED] | None = None
    diameter: Annotated[Length, COMPILED] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if self.size is not None and self.diameter is not None:
            raise fault("takes size or diameter, not both")
        if (self.size is None and self.diameter is None) != (self.center is None):
            raise fault("center goes with size (rectangle) or diameter (disc)")
        return self

    @property
    def normal(self) -> int:
        """The axis through the plane."""
        raise NotImplementedError

    def level(self, extent: tuple[float, ...]) -> float:
        """Where the plane cuts that axis [m], in a domain of `extent`."""
        raise NotImplementedError

    def along(self, dim: int) -> list[int]:
        """The axes of the plane, in x, y, z order."""
        return [a for a in range(dim) if a != self.normal]

    def rectangle(self, extent: tuple[float, ...]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Centre and half widths [m] of the window, or of the square around the disc, in a domain of `extent`."""
        whole = tuple(extent[a] for a in self.along(len(extent)))
        if self.center is None:
            return tuple(w / 2 for w in whole), tuple(w / 2 for w in whole)
        size = self.size if self.size is not None else (float(self.diameter or 0.0),) * len(whole)
        return self.center, tuple(w / 2 for w in size)

    def is_disc(self, dim: int) -> bool:
        """Whether the window is round: in 2-D a disc is a slot."""
        return self.diameter is not None and dim == 3

    def area(self, extent: tuple[float, ...], depth: float) -> float:
        """Area of the window [m²]; in 2-D, its width times the slab's `depth`."""
        _, half = self.rectangle(extent)
        if self.is_disc(len(extent)):
            return pi * half[0] ** 2
        return prod(2 * h for h in half) * (depth if len(extent) == 2 else 1.0)


class Region(Window):
    """Where an opening lies on a face of the domain."""

    face: Face

    @property
    def axis(self) -> int:
        """The axis through the face."""
        return "xyz".index(self.face[0])

    @property
    def normal(self) -> int:
        """The same."""
        return self.axis

    @property
    def side(self) -> int:
        """0 at the lower end of the axis, 1 at the upper."""
        return int(self.face[1] == "+")

    def level(self, extent: tuple[float, ...]) -> float:
        """Where the face is along its axis [m]."""
        return extent[self.axis] if self.side else 0.0


class Vent(Region):
    """An opening through which air may come in."""

    temperature: Temperature | None = None
    """Of the air that comes in [K]; unless given, `buoyancy.heat.reference`."""


class Jet(Vent):
    """What fans, inlets and honeycombs share: a prescribed speed that may follow a schedule."""

    speed: Velocity | None = None
    """Mean speed into the domain [m/s]; negative extracts."""
    turbulence_intensity: Fraction = 0.0
    """Standard deviation of each velocity component over the mean speed."""
    turbulence_length: Length | None = None
    """Integral length of the fluctuations [m]; a fifth of the opening's width unless given."""
    schedule: tuple[SpeedAt, ...] = ()
    """Speeds from given times on; before the first, `speed` holds."""
    ramp: Delay = 0.5
    """Time over which a scheduled change takes place [s]."""

    @model_validator(mode="after")
    def _ordered(self) -> "Jet":
        times = [step.at for step in self.schedule]
        if times != sorted(times):
            raise fault("schedule must be ordered by 'at'")
        if self.schedule and self.speed is None:
            raise fault("schedule needs a speed to start with")
        return self

    @property
    def blows(self) -> bool:
        """Whether the speed is prescribed; otherwise the opening is an outlet."""
        return self.speed is not None

    @property
    def knots(self) -> tuple[float, ...]:
        """Times between which the speed changes linearly [s]."""
        return tuple(time for step in self.schedule for time in (step.at, step.at + self.ramp))

    def speed_at(self, t: float) -> float:
        """Scheduled speed [m/s] at time t [s]: each change takes `ramp` seconds."""
        speed = self.speed or 0.0
        for step in self.schedule:
            if t >= step.at:
                share = min(1.0, (t - step.at) / self.ramp) if self.ramp else 1.0
                speed += share * (step.speed - speed)
        return speed


class FanCurve(Model):
    """What a fan can do against a pressure: dp = pressure (1 - (Q/flow)²)."""

    pressure: Pressure
    """That it builds up when no air gets through [Pa]."""
    flow: FlowRate
    """That it blows against no pressure [m³/s]; in 2-D through the whole `depth` of the slab."""
    response: Duration = 0.2
    """Time in which its speed follows the pressure [s]; the inertia of the air adds to it."""


class Fan(Jet):
    """A disc (in 2-D a slot) blowing a top-hat jet with a soft edge, optionally swirling.

    Profile: U/2 (1 - tanh((r - R)/(0.05 R))), scaled to the flow rate of a uniform disc; swirl velocity S U r/R.
    """

    kind: Literal["fan"]
    swirl: Real = 0.0
    """Tangential over axial speed at the rim; 3-D only."""
    curve: FanCurve | None = None
    """The speed follows the pressure behind the fan; `speed` is then the one that it starts with, 0 unless given."""

    @model_validator(mode="after")
    def _driven(self) -> "Fan":
        if self.curve is None and self.speed is None:
            raise fault("needs a speed or a curve")
        if self.curve is not None and self.schedule:
            raise fault("takes a schedule or a curve, not both: the curve sets the speed")
        if self.curve is not None and (self.speed or 0.0) < 0:
            raise fault("with a curve it blows into the domain: speed must not be negative")
        return self

    @property
    def blows(self) -> bool:
        """A fan always blows."""
        return True


class Inlet(Jet):
    """Air blown in with a uniform or parabolic profile of mean `speed`."""

    kind: Literal["inlet"]
    speed: Velocity  # type: ignore[assignment]
    profile: Literal["uniform", "parabolic"] = "uniform"


class Honeycomb(Jet):
    """A flow straightener: with `speed` it blows parallel air, without it is an outlet with a pressure loss."""

    kind: Literal["honeycomb"]
    loss_coefficient: NonNegative = 2.0
    """Pressure loss over the dynamic pressure, for the outlet."""


class Outlet(Vent):
    """An opening to still air at ambient pressure."""

    kind: Literal["outlet"]


class Slip(Region):
    """A frictionless, closed face."""

    kind: Literal["slip"]


class MovingWall(Region):
    """A no-slip wall that slides with `velocity` (its component through the face must be zero)."""

    kind: Literal["wall"]
    velocity: Annotated[tuple[Velocity, ...], Field(min_length=2, max_length=3)]


class Periodic(Model):
    """What leaves through one face of the axis enters through the other."""

    kind: Literal["periodic"]
    axis: Literal["x", "y", "z"]


Opening = Annotated[
    Fan | Inlet | Honeycomb | Outlet | Slip | MovingWall | Periodic, Field(discriminator="kind")
]


class Screen(Window):
    """Something in the way of the air that it goes through: a slab across `axis` with its middle at `at`."""

    axis: Literal["x", "y", "z"]
    at: Annotated[Coordinate, COMPILED]
    thickness: Annotated[Distance, COMPILED] = 0.05
    """Along the axis [m], in whole cells, at least one."""
    transverse: NonNegative = 1000.0
    """Resistance along the slab over the one through it: large values straighten the flow."""

    @property
    def normal(self) -> int:
        """The axis through the screen."""
        return "xyz".index(self.axis)

    def level(self, extent: tuple[float, ...]) -> float:
        """Where its middle is along the axis [m]."""
        return self.at

    def losses(self, viscosity: float) -> tuple[float, float]:
        """(a, b) of the pressure drop (a + b |u|) u over the density, u [m/s] through it: [m/s] and a number."""
        raise NotImplementedError


class Straightener(Screen):
    """A honeycomb flow straightener: friction in its channels, and what is lost at their ends."""

    kind: Literal["honeycomb"]
    loss_coefficient: NonNegative | None = None
    """Pressure drop over the dynamic pressure; 2 unless `cell` is given."""
    cell: Length | None = None
    """Width of a channel [m], in place of the loss coefficient: laminar friction in hexagons, f Re = 60.2
    (Shah & London 1978, Laminar Flow Forced Convection in Ducts), and 1.2 dynamic pressures at both ends."""

    @model_validator(mode="after")
    def _one_loss(self) -> "Straightener":
        if self.loss_coefficient is not None and self.cell is not None:
            raise fault("takes loss_coefficient or cell, not both")
        return self

    def losses(self, viscosity: float) -> tuple[float, float]:
        """(a, b) of the pressure drop (a + b |u|) u over the density."""
        if self.cell is None:
            return 0.0, (2.0 if self.loss_coefficient is None else self.loss_coefficient) / 2.0
        return 60.2 / 2.0 * viscosity * self.thickness / self.cell**2, 0.6


class Perforated(Screen):
    """A thin sheet with holes or a wire gauze."""

    kind: Literal["perforated"]
    loss_coefficient: NonNegative = 2.0
    """Pressure drop over the dynamic pressure."""
    thickness: Annotated[Distance, COMPILED] = 0.0
    transverse: NonNegative = 1.0

    def losses(self, viscosity: float) -> tuple[float, float]:
        """(a, b) of the pressure drop (a + b |u|) u over the density."""
        return 0.0, self.loss_coefficient / 2.0
