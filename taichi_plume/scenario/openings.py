"""Openings of a scenario (boundary conditions of the flow): inlets, outlets, fans; slip, moving and periodic walls."""

from collections.abc import Iterator
from itertools import pairwise
from math import hypot
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, Domain
from taichi_plume.scenario.opening_base import AnyOpening, FaceOpening, Scheduled, SpeedAt, VelocityAt, Vent
from taichi_plume.scenario.palette import HONEYCOMB, INLET, MOVING_WALL, OUTLET, rgb
from taichi_plume.scenario.profiles import Profile
from taichi_plume.scenario.vocabulary import SPATIAL, Axis, Color, Model, consistency_check
from taichi_plume.scenario.windows import Region

CARRIED = 3  # cells: convection damps eddies of a shorter integral length too much


class Jet(Scheduled, Vent):
    """Fans, inlets and honeycombs: a prescribed speed that may follow a schedule."""

    inward: ClassVar[bool] = True
    """Whether a negative speed is probably a mistake."""
    speed: si.Velocity | None = None
    """Mean speed of the air into the room; negative draws air out. A honeycomb without it is an outlet."""
    turbulence_intensity: si.Fraction = 0.0
    """Standard deviation of each velocity component over the mean speed. It is that of the eddies that the cells
    carry; 0 blows perfectly smooth air, which keeps plumes narrow."""
    turbulence_length: si.Length | None = None
    """Size of the eddies that are blown in: integral length along the wind. Unless given a fifth of the opening's
    width, and about four cells at least."""
    schedule: tuple[SpeedAt, ...] = ()
    """Speeds from given times on, for fans that are switched; before the first, `speed` holds."""

    @consistency_check
    def _starts(self) -> Iterator[str]:
        if self.schedule and self.speed is None:
            yield "schedule needs a speed to start with"

    @property
    def by_chance(self) -> bool:
        return self.turbulence_intensity > 0

    @property
    def blows(self) -> bool:
        """Whether the opening has a prescribed speed; without one it is an outlet."""
        return self.speed is not None

    @property
    def label(self) -> str:
        return super().label if self.speed is None else f"{super().label} {self.speed:g} m/s"

    @property
    def lets_out(self) -> bool:
        return not self.blows

    def top_speed(self, domain: Domain) -> float:
        return max(abs(speed) for speed in (self.speed or 0.0, *(step.speed for step in self.schedule)))

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from super().errors(where, context)
        most = max(context.domain.extent)
        if self.turbulence_length is not None and self.turbulence_length > most:
            length = self.turbulence_length
            yield f"{where}.turbulence_length: {length:g} m is longer than the room; use at most {most:g} m"

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        yield from super().warnings(where, context)
        length, cell = self.turbulence_length, context.domain.spacing
        if length is not None and self.by_chance and length < CARRIED * cell * (1.0 - 1e-6):
            yield (
                f"{where}.turbulence_length: {length:g} m is too short for cells of {cell:g} m: the eddies will be of "
                f"about {4 * cell:g} m"
            )
        if self.speed is not None and self.speed < 0 and self.inward:
            yield f"{where}.speed: {self.speed:g} m/s draws air out of the room; a positive speed blows it in"

    def speed_at(self, t: float) -> float:
        """Return the scheduled speed [m/s] at time t [s]; each change takes `ramp` seconds."""
        speed = self.speed or 0.0
        for step in self.schedule:
            speed += self.progress(step, t) * (step.speed - speed)
        return speed

    def inflow(self, t: float, domain: Domain) -> float:
        return self.speed_at(t) * self.area(domain.extent, domain.depth)


class FanCurve(Model):
    """Characteristic curve of a fan: pressure rise dp = pressure (1 - (Q/flow)²) at a flow rate Q."""

    pressure: si.Pressure
    """Pressure rise of the fan at zero flow, from its data sheet."""
    flow: si.FlowRate
    """Flow rate at zero pressure rise, from its data sheet; in 2-D through the whole depth."""
    response: si.Duration = 0.2
    """Time in which the fan's speed follows the pressure; the inertia of the air adds to it."""


class Fan(Jet):
    """A fan: a disc (in 2-D a slot) that blows an even jet with a soft edge, which may turn.

    Profile: U/2 (1 - tanh((r - R)/(0.05 R))), scaled to the flow rate of a uniform disc; swirl velocity S U r/R.
    """

    color: ClassVar[Color] = rgb(INLET)
    inward: ClassVar[bool] = False
    kind: Literal["fan"]
    swirl: Annotated[si.Swirl, SPATIAL] = 0.0
    """Swirl of the jet: tangential over axial speed at the rim; 3-D only."""
    curve: FanCurve | None = None
    """Characteristic curve of the fan. Its speed then follows the pressure behind it, and `speed` is the speed at the
    start, 0 unless given."""

    @consistency_check
    def _driven(self) -> Iterator[str]:
        if self.curve is None and self.speed is None:
            yield "needs a speed or a curve"
        if self.curve is not None and self.schedule:
            yield "takes a schedule or a curve, not both: the curve sets the speed"
        if self.curve is not None and (self.speed or 0.0) < 0:
            yield "with a curve it blows into the domain: speed must not be negative"

    blows: ClassVar[bool] = True

    @property
    def follows_pressure(self) -> bool:
        return self.curve is not None

    def top_speed(self, domain: Domain) -> float:
        """Return the largest speed [m/s] of the fan; with a fan curve, its speed at zero pressure rise at least."""
        free = self.curve.flow / self.area(domain.extent, domain.depth) if self.curve else 0.0
        return max(free, super().top_speed(domain))


class Inlet(Jet):
    """Inlet: air that is blown in with a given mean speed and profile, such as from the next room."""

    color: ClassVar[Color] = rgb(INLET)
    kind: Literal["inlet"]
    speed: si.Velocity  # type: ignore[assignment]
    """Mean speed of the air into the room; negative draws air out."""
    profile: Literal["uniform", "parabolic"] | Profile = "uniform"
    """Velocity profile over the opening. uniform, parabolic, or by the height over walls: {kind: log}, power or
    table."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from super().errors(where, context)
        if not isinstance(self.profile, str):
            yield from self.profile.region_errors(f"{where}.profile", self, context.domain)


class Honeycomb(Jet):
    """A flow straightener: with `speed` it blows parallel air, without it is an outlet with a pressure loss."""

    color: ClassVar[Color] = rgb(HONEYCOMB)
    straight: ClassVar[bool] = True
    kind: Literal["honeycomb"]
    loss_coefficient: si.Coefficient = 2.0
    """Pressure loss over the dynamic pressure, where it is an outlet. More spreads the outflow more evenly."""


class Outlet(Vent):
    """Outlet: an opening to still air outside, through which the pressure drives air in or out."""

    color: ClassVar[Color] = rgb(OUTLET)
    lets_out: ClassVar[bool] = True
    kind: Literal["outlet"]


class Slip(FaceOpening):
    """Slip wall, without friction. It stands for a plane of symmetry, or the air far above."""

    kind: Literal["slip"]


class MovingWall(Scheduled, FaceOpening):
    """Moving wall: slides in its own plane and drags the air along (no-slip)."""

    color: ClassVar[Color] = rgb(MOVING_WALL)
    kind: Literal["wall"]
    velocity: si.Velocities
    """Velocity with which the wall slides, per axis; 0 along the axis through it. It drags the air along."""
    schedule: tuple[VelocityAt, ...] = ()
    """Velocities from given times on; before the first, `velocity` holds."""

    def top_speed(self, domain: Domain) -> float:
        return max(hypot(*self.velocity), *(step.speed for step in self.schedule), 0.0)

    def _velocity_at(self, t: float) -> np.ndarray:
        velocity = np.array(self.velocity)
        for step in self.schedule:
            velocity += self.progress(step, t) * (np.array(step.velocity) - velocity)
        return velocity

    def mean_velocity(self, begin: float, end: float) -> np.ndarray:
        """Return the wall's mean velocity [m/s] between two times, per axis; if these are equal, its velocity then."""
        if not begin < end:
            return self._velocity_at(end)
        times = [begin, *sorted(time for time in self.knots if begin < time < end), end]
        parts = [(b - a) * self._velocity_at(0.5 * (a + b)) for a, b in pairwise(times)]  # linear in between
        return np.sum(parts, axis=0) / (end - begin)

    def placement_errors(self, where: str, number: int, context: Context) -> Iterator[str]:
        yield from super().placement_errors(where, number, context)
        given = [(f"{where}.velocity", self.velocity)]
        given += [(f"{where}.schedule[{n}].velocity", step.velocity) for n, step in enumerate(self.schedule)]
        for place, velocity in given:
            if velocity[self.axis] != 0:
                yield (
                    f"{place}: the wall {self.face} slides in its own plane: the {'xyz'[self.axis]} component must be "
                    f"0, got {velocity[self.axis]:g} m/s; to blow air use kind: inlet"
                )


class Periodic(AnyOpening):
    """Periodic boundary condition along an axis: what leaves through one face enters through the other."""

    kind: Literal["periodic"]
    axis: Axis
    """Axis of periodicity: air that leaves at one end enters at the other, as in an endless duct."""

    @property
    def wraps(self) -> str:
        return self.axis

    @property
    def faces(self) -> tuple[Region, Region]:
        """Both faces of the axis."""
        low, high = (Region.model_validate({"face": f"{self.axis}{side}"}) for side in "-+")
        return low, high

    def placement_errors(self, where: str, number: int, context: Context) -> Iterator[str]:
        if any(other.wraps == self.axis for other in context.scenario.openings[:number]):
            yield f"{where}: axis {self.axis} is periodic already; remove one"
        for m, other in enumerate(context.scenario.openings):
            if other.region is not None and other.region.face[0] == self.axis:
                yield (
                    f"{where}: axis {self.axis} cannot be periodic while wind.openings[{m}] "
                    f"({other.kind}) is on face {other.region.face}; remove one of them"
                )


Opening = Annotated[
    Fan | Inlet | Honeycomb | Outlet | Slip | MovingWall | Periodic, Field(discriminator="kind")
]
