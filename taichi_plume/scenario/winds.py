"""Kinds of wind in a scenario: computed (Navier-Stokes), uniform with gusts, frozen, synthetic; turbulence models."""

from collections.abc import Iterator
from itertools import pairwise
from math import hypot, prod
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from taichi_plume.quantities import number
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.heat import Buoyancy
from taichi_plume.scenario.imported_wind import ImportedWind
from taichi_plume.scenario.initial_conditions import InitialWind
from taichi_plume.scenario.openings import Opening
from taichi_plume.scenario.own_code import OwnWind
from taichi_plume.scenario.playback import PlaybackWind, PlumeSimWind
from taichi_plume.scenario.screens import AnyScreen
from taichi_plume.scenario.vocabulary import AT_START, SPATIAL, Model, MomentumConvection
from taichi_plume.scenario.wind_base import GUST, AnyWind

if TYPE_CHECKING:
    from taichi_plume.scenario.scenario import Scenario

MOST_KNOTS = 1_000_000  # of the gusts, which are drawn at the start


class Smagorinsky(Model):
    """Smagorinsky's model, the usual one: an eddy viscosity that grows with the shear.

    (C_s dx)² |S| (Smagorinsky 1963, doi:10.1175/1520-0493(1963)091<0099:GCEWTP>2.3.CO;2). Surfaces slow the air by the
    law of the wall where the cells are thicker than its viscous layer.
    """

    kind: Literal["smagorinsky"]
    constant: si.Intensity = 0.13
    """Strength C_s of the model: size of the small eddies over that of a cell. More damps the flow more: 0.15 keeps a
    channel's middle 9 to 11 % too fast, 0.1 makes a fan's jet spread by 0.106 (measured 0.095)."""
    schmidt: si.Prandtl = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas. A smaller one mixes gas more."""


class Vreman(Model):
    """Vreman's model: an eddy viscosity that vanishes in laminar flow.

    Vreman 2004, doi:10.1063/1.1785131. Surfaces slow the air by the law of the wall where the cells are thicker than
    its viscous layer.
    """

    kind: Literal["vreman"]
    constant: si.Intensity = 0.07
    """Strength of the model, about 2.5 times the square of Smagorinsky's constant. More damps the flow more."""
    schmidt: si.Prandtl = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas. A smaller one mixes gas more."""


class NoModel(Model):
    """Molecular viscosity only, also at surfaces: for flows that the cells resolve."""

    kind: Literal["none"]


Eddies = Annotated[Smagorinsky | Vreman | NoModel, Field(discriminator="kind")]


class CfdWind(AnyWind):
    """Air flow computed on the grid by the incompressible Navier-Stokes equations."""

    kind: Literal["cfd"]
    solved: ClassVar[bool] = True
    viscosity: si.Viscosity = 1.56e-5
    """Kinematic viscosity: the default is air at 25 °C."""
    turbulence: Eddies = Smagorinsky(kind="smagorinsky")
    """Model of the eddies that are too small for the cells. Use none where the cells resolve all of them, as in slow
    air."""
    roughness: si.Distance | None = None
    """Roughness of walls and obstacles: equivalent sand grain size. It slows the air beside them;
    smooth unless given. Without effect with `turbulence: {kind: none}`."""
    openings: tuple[Opening, ...] = ()
    """Boundary conditions: inlets and outlets, and walls that slip, slide or are periodic. The rest are walls at
    rest."""
    screens: tuple[AnyScreen, ...] = ()
    """Flow straighteners and perforated sheets inside the room, with a pressure drop."""
    acceleration: si.Accelerations | None = None
    """Body force per mass, per axis, which drives the flow along a periodic duct. Unless given there is none."""
    convection: MomentumConvection = "upwind5"
    """Scheme that carries momentum. weno5 is more accurate on the same grid and costs more; koren is of lower order.
    """
    buoyancy: Buoyancy | None = None
    """Buoyancy: warm air rises and heavy gas sinks; unless given, neither does."""
    courant: Annotated[float, *number(0.01, 1.4)] = 1.2
    """Courant number (CFL): largest sum over the axes of |u| dt/dx in a step. Less makes shorter steps: more exact in
    time, and slower. """
    tolerance: Annotated[float, *number(1e-7, 1e-2)] = 2e-5
    """Tolerance of the pressure solver: divergence over the largest |u|/dx. Less is more exact and, with an iterative
    solver, slower."""
    initial: Annotated[InitialWind | None, AT_START] = None
    """Velocity of the air at the start of the warm-up; unless given, zero except for the flow of the openings."""

    @property
    def by_chance(self) -> bool:
        heat = self.buoyancy.heat if self.buoyancy is not None else None
        puffs = heat is not None and bool(heat.heaters) and heat.unsteadiness > 0.0
        return super().by_chance or (puffs and self.turbulence.kind != "none")

    @property
    def computed(self) -> "CfdWind":
        return self

    def top_speed(self, scenario: "Scenario") -> float:
        speeds = [opening.top_speed(scenario.domain) for opening in self.openings]
        for obstacle in scenario.obstacles:
            if obstacle.motion is not None:
                speeds += [speed for _, _, speed in obstacle.motion.legs(obstacle.center)]
        if self.buoyancy is not None and self.buoyancy.heat is not None:
            speeds.append(self.buoyancy.heat.top_speed(max(scenario.domain.extent)))
        if self.initial is not None:
            speeds.append(self.initial.top_speed(scenario.domain))
        return max(speeds, default=0.0)

    def longest_step(self, scenario: "Scenario") -> float:
        return self.courant * super().longest_step(scenario)

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        if self.roughness and self.turbulence.kind == "none":
            yield f"{where}.roughness: needs a model of eddies; use turbulence: {{kind: smagorinsky}}"
        elif (self.roughness or 0.0) > 0.5 * context.domain.spacing:
            yield (
                f"{where}.roughness: {self.roughness:g} m is more than half a cell of {context.domain.spacing:g} m, "
                "too much for the law of the wall; lower it, or use obstacles"
            )
        yield from super().warnings(where, context)

    def errors(self, where: str, context: Context) -> Iterator[str]:
        lines = [
            line
            for n, opening in enumerate(self.openings)
            for line in opening.placement_errors(f"{where}.openings[{n}]", n, context)
        ]
        yield from lines or self._net_inflow(where, context)

    def _net_inflow(self, where: str, context: Context) -> Iterator[str]:
        """Yield an error if, without an outlet, the openings at any time blow in more or less air than out."""
        if any(opening.lets_out for opening in self.openings):
            return
        for n, opening in enumerate(self.openings):
            if opening.follows_pressure:
                yield f"{where}.openings[{n}].curve: needs an outlet; add {{kind: outlet, face: ...}} or use speed"
                return
        scenario, domain = context.scenario, context.domain
        start = 0.0 - scenario.warm_up
        ends = {start, scenario.duration, *(time for opening in self.openings for time in opening.knots)}
        times = sorted(t for t in ends if start <= t <= scenario.duration)
        times = sorted([*times, *((a + b) / 2 for a, b in pairwise(times))])
        for t in times:
            flows = [opening.inflow(t, domain) for opening in self.openings]
            if abs(sum(flows)) > 1e-6 * sum(abs(flow) for flow in flows):
                change = "blown in" if sum(flows) > 0 else "drawn out"
                yield (
                    f"{where}.openings: an outlet is missing: at t = {t:g} s a net {abs(sum(flows)):.4g} m³/s is "
                    f"{change}; add {{kind: outlet, face: ...}} or balance the speeds"
                )
                return


class Gusts(Model):
    """Gusts across a uniform wind, everywhere the same: an Ornstein-Uhlenbeck process.

    See solvers/gusts.py.
    """

    intensity: si.Intensity = 0.15
    """Strength of the gusts to the left and right: standard deviation over the mean speed."""
    vertical: Annotated[si.Intensity, SPATIAL] = 0.0
    """Strength of the gusts up and down: standard deviation over the mean speed; 3-D only."""
    time: si.Duration = 5.0
    """Duration of a gust (integral time scale). Long gusts sweep the plume far to the side, short ones shake it."""

    @property
    def by_chance(self) -> bool:
        return self.intensity > 0 or self.vertical > 0

    def deviations(self, dim: int) -> tuple[float, ...]:
        """Return the standard deviations of the crosswind gusts over the mean speed: lateral and, in 3-D, vertical."""
        return (self.intensity, self.vertical)[: dim - 1]


class UniformWind(AnyWind):
    """The same velocity everywhere, constant except for gusts; obstacles do not deflect it."""

    kind: Literal["uniform"]
    velocity: si.Velocities
    """Mean velocity of the air, per axis: the direction of motion."""
    gusts: Gusts | None = None
    """Gusts across the wind, which sweep plumes to and fro; unless given, the wind is steady."""

    @property
    def speed(self) -> float:
        """Magnitude of the mean velocity [m/s]."""
        return hypot(*self.velocity)

    @property
    def frame(self) -> np.ndarray:
        """Rows are unit vectors: along the mean wind (x if still), level across it and, in 3-D, across both."""
        dim = len(self.velocity)
        along = np.array(self.velocity) / self.speed if self.speed else np.eye(dim)[0]
        level = hypot(*along[:2])
        lateral = np.zeros(dim)
        lateral[:2] = (-along[1] / level, along[0] / level) if level > 1e-9 else (0.0, 1.0)
        rows = [along, lateral]
        return np.array(rows if dim == 2 else [*rows, np.cross(along, lateral)])

    @property
    def uniform(self) -> "UniformWind":
        return self

    def top_speed(self, scenario: "Scenario") -> float:
        return self.speed

    def axes_speed(self, scenario: "Scenario") -> float:
        return sum(abs(v) for v in self.velocity)

    def errors(self, where: str, context: Context) -> Iterator[str]:
        if context.scenario.obstacles:
            yield f"{where}.kind: a uniform wind blows through obstacles; remove them, or use kind: cfd or synthetic"
        if self.gusts is None:
            return
        if not self.speed:
            yield f"{where}.gusts: are relative to the wind speed, which is 0; give {where}.velocity or remove gusts"
            return
        crossing = float(np.abs(self.frame[0]) @ context.domain.extent) / self.speed
        if crossing > self.gusts.time * MOST_KNOTS / 20:
            yield (
                f"{where}.gusts.time: {self.gusts.time:g} s is too short for air that takes {crossing:.3g} s through "
                f"the domain; use {20 * crossing / MOST_KNOTS:.2g} s or more, or a faster wind"
            )


class FrozenWind(CfdWind):
    """The mean of a computed flow, kept for ever: `cfd` at first, then at no cost. The flow's fluctuations are lost."""

    kind: Literal["frozen"]  # type: ignore[assignment]
    after: si.Duration = 60.0
    """Time from the start of the warm-up until the flow is frozen. Until then it is computed, then its mean is kept at
    no cost."""
    average: si.Duration | None = None
    """Averaging time before the flow is frozen; unless given, half of `after`."""

    def moving(self, whole: float) -> float:
        return min(whole, self.after)

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from super().errors(where, context)
        whole = context.scenario.warm_up + context.scenario.duration
        if self.after > whole:
            yield (
                f"{where}.after: {self.after:g} s is longer than warm_up + duration = {whole:g} s; lower it, raise "
                "warm_up, or use kind: cfd"
            )
        if self.average is not None and self.average > self.after:
            yield f"{where}.average: {self.average:g} s is longer than after: {self.after:g} s; lower it"


TURNOVER, LARGEST = 300.0, 0.38
"""Edge of a cube as large as a room over the speed of its eddies [s], and wavelength of the largest over the edge."""


class Scales(NamedTuple):
    """Scales of the air's motion in a closed room: speed of the eddies [m/s] and of rolls, longest wave [m]."""

    speed: float
    longest: float
    circulation: float


class SyntheticWind(AnyWind):
    """Weak convection of a closed room: random eddies and a slowly turning circulation. Nothing is solved.

    All faces of the domain are walls. It costs little; see solvers/synthetic_flow.py. Runs report the mixing of gas,
    as an eddy diffusivity K, which is proportional to the speeds and to the eddies' length. In homes 0.001 to
    0.013 m²/s were measured with less than 0.2 to more than 5 air changes per hour n, by
    K = V^(2/3) (0.52 n + 0.31) per hour in a room of volume V (Cheng et al. 2011, doi:10.1021/es103080p). By default
    speeds and lengths grow with the room, such that K is that of rooms with 0 to 0.5 air changes: 0.0015 m²/s in 50 m³.
    """

    kind: Literal["synthetic"]
    speed: si.Speed | None = None
    """Root mean square of the eddies' speed over the room. Unless given, the edge of a cube (in 2-D a square) as large
    as the room, over 300 s: 1.2 cm/s in 50 m³."""
    longest: si.Length | None = None
    """Wavelength of the largest eddies: about the size of their cause, or of the room. Unless given 0.38 of that
    edge, 1.4 m in 50 m³; at least 0.2 m and eight cells. Eddies of twice the length mix about twice as fast."""
    shortest: si.Length | None = None
    """Wavelength of the smallest eddies. Unless given 0.1 m, or four cells if larger. Shorter ones mix gas as
    an eddy viscosity."""
    schmidt: si.Prandtl = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas. A smaller one mixes gas more."""
    modes: Annotated[int, Field(ge=1, le=10_000)] = 64
    """Number of random waves that make up the eddies, spread evenly over the logarithm of the wavelength. More waves
    are less repetitive and take longer."""
    unsteadiness: si.Coefficient = 0.5
    """Rate of change of the eddies: frequency of each wave over that of eddies of its size, sqrt(k³ E(k)). 0 keeps them
    constant."""
    circulation: si.Speed | None = None
    """Root mean square speed of the rolls that fill the room, over room and time. They carry gas from one end to the
    other. Unless given a quarter of `speed`."""
    circulation_time: si.Duration = 120.0
    """Time over which the rolls change their strength and direction."""
    wall_layer: si.Length = 0.3
    """Distance from walls and obstacles at which the eddies have about three quarters of their strength."""

    walled: ClassVar[bool] = True
    by_chance: ClassVar[bool] = True

    def shortest_on(self, spacing: float) -> float:
        """Return the wavelength [m] of the smallest eddies on grid cells of `spacing` [m]."""
        return self.shortest or max(0.1, 4 * spacing)

    def scales(self, extent: tuple[float, ...], spacing: float) -> Scales:
        """Return the scales of the air's motion in a room of this extent [m] on grid cells of `spacing` [m]."""
        edge = prod(extent) ** (1.0 / len(extent))
        speed = edge / TURNOVER if self.speed is None else self.speed
        longest = max(LARGEST * edge, 0.2, 8.0 * spacing) if self.longest is None else self.longest
        return Scales(speed, longest, 0.25 * speed if self.circulation is None else self.circulation)

    def _fastest(self, scenario: "Scenario") -> float:
        speed, _, circulation = self.scales(scenario.domain.extent, scenario.domain.spacing)
        return hypot(speed, circulation)

    def top_speed(self, scenario: "Scenario") -> float:
        """Return a speed [m/s] that only one position in ten thousand exceeds."""
        return 2.0 * self._fastest(scenario)

    def axes_speed(self, scenario: "Scenario") -> float:
        return GUST * self._fastest(scenario)

    def errors(self, where: str, context: Context) -> Iterator[str]:
        spacing = context.domain.spacing
        shortest = self.shortest_on(spacing)
        if shortest < 2 * spacing:
            yield (
                f"{where}.shortest: {shortest:g} m is less than two cells of {spacing:g} m; "
                f"use {4 * spacing:g} m or more, or lower domain.spacing"
            )
        elif shortest >= (longest := self.scales(context.domain.extent, spacing).longest):
            yield (
                f"{where}.longest: {longest:.3g} m is not above the shortest wavelength, {shortest:g} m; "
                f"make it longer, or give a {where}.shortest below it"
            )


Wind = Annotated[
    CfdWind | UniformWind | FrozenWind | PlaybackWind | ImportedWind | SyntheticWind | PlumeSimWind | OwnWind,
    Field(discriminator="kind"),
]
