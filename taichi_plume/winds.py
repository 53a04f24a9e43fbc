"""The air flow of a scenario: its kinds, and what a computed flow is driven and resisted by."""

from math import hypot, pi, prod
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.vocabulary import (
    Acceleration,
    Convection,
    Coordinate,
    Delay,
    Diffusivity,
    Distance,
    Duration,
    Expansion,
    Face,
    FlowRate,
    Fraction,
    HeatCapacity,
    HeatTransfer,
    Length,
    Model,
    NonNegative,
    Point,
    Point2,
    Positive,
    Power,
    Pressure,
    Real,
    Speed,
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

    center: Annotated[tuple[Coordinate, ...], Field(min_length=1, max_length=2)] | None = None
    size: Annotated[tuple[Length, ...], Field(min_length=1, max_length=2)] | None = None
    diameter: Length | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if self.size is not None and self.diameter is not None:
            raise PydanticCustomError("region", "takes size or diameter, not both")
        if (self.size is None and self.diameter is None) != (self.center is None):
            raise PydanticCustomError("region", "center goes with size (rectangle) or diameter (disc)")
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
            raise PydanticCustomError("schedule", "schedule must be ordered by 'at'")
        if self.schedule and self.speed is None:
            raise PydanticCustomError("schedule", "schedule needs a speed to start with")
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
            raise PydanticCustomError("fan", "needs a speed or a curve")
        if self.curve is not None and self.schedule:
            raise PydanticCustomError(
                "fan", "takes a schedule or a curve, not both: the curve sets the speed"
            )
        if self.curve is not None and (self.speed or 0.0) < 0:
            raise PydanticCustomError(
                "fan", "with a curve it blows into the domain: speed must not be negative"
            )
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
    at: Coordinate
    thickness: Distance = 0.05
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
            raise PydanticCustomError("loss", "takes loss_coefficient or cell, not both")
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
    thickness: Distance = 0.0
    transverse: NonNegative = 1.0

    def losses(self, viscosity: float) -> tuple[float, float]:
        """(a, b) of the pressure drop (a + b |u|) u over the density."""
        return 0.0, self.loss_coefficient / 2.0


class Smagorinsky(Model):
    """Eddy viscosity (C_s dx)² |S| (Smagorinsky 1963, doi:10.1175/1520-0493(1963)091<0099:GCEWTP>2.3.CO;2)."""

    kind: Literal["smagorinsky"]
    constant: NonNegative = 0.15
    schmidt: Positive = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas."""


class Vreman(Model):
    """Eddy viscosity that vanishes in laminar shear and at walls (Vreman 2004, doi:10.1063/1.1785131)."""

    kind: Literal["vreman"]
    constant: NonNegative = 0.07
    """About 2.5 times the square of Smagorinsky's."""
    schmidt: Positive = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas."""


class NoModel(Model):
    """Only the molecular viscosity."""

    kind: Literal["none"]


class Heater(Model):
    """A ball (in 2-D a disc) that warms the air evenly over its volume: a person, a computer, a lamp."""

    position: Point
    power: Power
    """Heat that goes into the air [W], without what is radiated: half of a person's 100 W. Negative cools."""
    radius: Length = 0.1


class TemperedSurface(Model):
    """A surface that keeps its temperature whatever the air does."""

    temperature: Temperature
    transfer: HeatTransfer | None = None
    """Heat given to the air per area and kelvin [W/(m² K)]; unless given, conduction across half a cell. Cells of a
    room's size are thicker than the film of air at its walls, which passes 1 to 4 W/(m² K)."""


class TemperedWall(TemperedSurface, Region):
    """A face of the domain, or a region of it, with a temperature; where an opening is, there is no wall."""


class TemperedObstacle(TemperedSurface):
    """An obstacle with a temperature."""

    number: Annotated[int, Field(ge=0)]
    """Its place in `obstacles`, counted from 0."""


class Heat(Model):
    """Temperature of the air. Walls and obstacles that are not named let no heat through."""

    reference: Temperature = 298.15
    """Of the air at the start, of the still air outside and of what comes in [K]."""
    expansion: Expansion | None = None
    """Relative change of the volume per kelvin [1/K]; unless given, an ideal gas's: 1/reference."""
    diffusivity: Diffusivity = 2.2e-5
    """Of heat in still air [m²/s]."""
    prandtl_turbulent: Positive = 0.85
    """Eddy viscosity over eddy diffusivity of heat."""
    capacity: HeatCapacity = 1191.0
    """Heat per volume and kelvin, density times c_p [J/(m³ K)]; the default is air at 25 °C."""
    walls: tuple[TemperedWall, ...] = ()
    obstacles: tuple[TemperedObstacle, ...] = ()
    heaters: tuple[Heater, ...] = ()

    @property
    def volume_expansion(self) -> float:
        """Relative change of the volume per kelvin [1/K]."""
        return 1.0 / self.reference if self.expansion is None else self.expansion


class Buoyancy(Model):
    """Weight of what makes air lighter or heavier (Boussinesq): rho/rho0 = 1 - (T - T0)/T0 + (M/M_air - 1) x."""

    gravity: Annotated[tuple[Acceleration, ...], Field(min_length=2, max_length=3)] | None = None
    """[m/s²]; in 3-D (0, 0, -9.81) unless given. A 2-D run is a view from above unless it is given."""
    solutal: bool = True
    """Whether the gas weighs: x is its mole fraction, M its molar mass."""
    heat: Heat | None = None
    """Whether temperature counts, and what warms the air."""

    def pull(self, dim: int) -> tuple[float, ...]:
        """Gravity [m/s²] in `dim` dimensions."""
        return self.gravity or (0.0,) * (dim - 1) + (-9.81,)

    @model_validator(mode="after")
    def _acts(self) -> "Buoyancy":
        if not self.solutal and self.heat is None:
            raise PydanticCustomError("buoyancy", "has no effect: give heat, or leave out solutal: false")
        return self


class CfdWind(Model):
    """Air flow computed on the grid by the incompressible Navier-Stokes equations."""

    kind: Literal["cfd"]
    viscosity: Diffusivity = 1.56e-5
    """Kinematic viscosity [m²/s]; the default is air at 25 °C."""
    turbulence: Annotated[Smagorinsky | Vreman | NoModel, Field(discriminator="kind")] = Smagorinsky(
        kind="smagorinsky"
    )
    openings: tuple[Opening, ...] = ()
    """What no opening covers is no-slip wall."""
    screens: tuple[Annotated[Straightener | Perforated, Field(discriminator="kind")], ...] = ()
    """Flow straighteners and perforated sheets inside the domain."""
    acceleration: Annotated[tuple[Acceleration, ...], Field(min_length=2, max_length=3)] | None = None
    """Force per mass on all the air [m/s²]: what drives the flow along a periodic duct."""
    convection: Convection = "koren"
    """Scheme of convection; weno5 is more accurate on the same grid and costs more."""
    buoyancy: Buoyancy | None = None
    """Unless given, neither warm air rises nor heavy gas sinks."""
    courant: Annotated[float, Field(gt=0, le=1)] = 0.8
    """Largest sum over the axes of |u| dt/dx in one step; 0.4 with weno5 unless given."""
    tolerance: Annotated[float, Field(gt=0, le=1e-2)] = 2e-5
    """Divergence left by the pressure solver, over the largest |u|/dx."""

    @model_validator(mode="before")
    @classmethod
    def _steps_of_weno5(cls, data: Any) -> Any:
        """Heun's method needs shorter steps for it, see solvers/convection.py."""
        if isinstance(data, dict) and data.get("convection") == "weno5":
            return {"courant": 0.4} | data
        return data


class Gusts(Model):
    """Gusts across a uniform wind, everywhere the same: an Ornstein-Uhlenbeck process, see solvers/gusts.py."""

    intensity: NonNegative = 0.15
    """Standard deviation of the horizontal crosswind over the mean speed."""
    vertical: NonNegative = 0.0
    """The same of the crosswind upward; 3-D only."""
    time: Duration = 5.0
    """Integral time: how long a gust lasts [s]."""

    def deviations(self, dim: int) -> tuple[float, ...]:
        """Of each crosswind over the mean speed."""
        return (self.intensity, self.vertical)[: dim - 1]


class UniformWind(Model):
    """The same velocity everywhere, constant but for gusts; obstacles do not deflect it."""

    kind: Literal["uniform"]
    velocity: Annotated[tuple[Velocity, ...], Field(min_length=2, max_length=3)]
    """Mean velocity [m/s]."""
    gusts: Gusts | None = None
    """Unless given, the wind is steady."""

    @property
    def speed(self) -> float:
        """Of the mean velocity [m/s]."""
        return hypot(*self.velocity)

    @property
    def frame(self) -> np.ndarray:
        """Unit vectors along the mean wind, horizontally across it and, in 3-D, upward across both; x in still air."""
        dim = len(self.velocity)
        along = np.array(self.velocity) / self.speed if self.speed else np.eye(dim)[0]
        level = hypot(*along[:2])
        lateral = np.zeros(dim)
        lateral[:2] = (-along[1] / level, along[0] / level) if level > 1e-9 else (0.0, 1.0)
        rows = [along, lateral]
        return np.array(rows if dim == 2 else [*rows, np.cross(along, lateral)])


class FrozenWind(CfdWind):
    """The mean of a computed flow, kept for ever: `cfd` at first, then at no cost. The flow's fluctuations are lost."""

    kind: Literal["frozen"]  # type: ignore[assignment]
    after: Duration = 60.0
    """Time from the start of the warm-up until the flow stands still [s]."""
    average: Duration | None = None
    """The flow is averaged over so long before [s]; unless given, half of `after`."""


class Played(Model):
    """Frames that were made before; at the end the last one holds."""

    loop: bool = False
    """Start again at the end."""
    rate: Positive = 1.0
    """Seconds of the frames per simulated second; their velocities stay as they are."""
    start: Time = 0.0
    """Time of the frames [s] that is shown when the robots start."""


class Playback(Played):
    """A recorded run (see `fields`), linear in time between its frames, also from the last one to the first."""

    file: Annotated[str, Field(min_length=1)]
    """Path of a fields.zarr, relative to the scenario's folder."""


class PlaybackWind(Playback):
    """The air flow of a recorded run."""

    kind: Literal["playback"]


class PointPlayback(Played):
    """Frames of points, played back as PlumeSim does: each holds until the next one, and the last for good.

    Points lie in a plane; in 3-D they are the same at every height. What is read at a place is the value of the nearest
    point that is closer than the cell, else zero.
    """

    offset: Point2 = (0.0, 0.0)
    """Added to the points' places [m]."""
    interpolate: bool = False
    """Read between points, bilinear on a lattice as wide as the cell; zero at a cell from the last of them."""


class PlumeSimLog(PointPlayback):
    """A log of PlumeSim: text; see point_frames.py. `plumesim_log` makes a run write one."""

    file: Annotated[str, Field(min_length=1)]
    """Its path, relative to the scenario's folder."""


class PlumeSimWind(PlumeSimLog):
    """The wind of a log, as sensors feel it; no gas on the grid can be carried by it."""

    kind: Literal["plumesim_log"]


class ImportedWind(Played):
    """Air flow from elsewhere, such as OpenFOAM, ParaView, Fluent or GADEN; `wind_files` tells the formats.

    Between its points it is linear, between its files linear in time. It is made divergence-free; through the faces of
    the domain air goes as in the files, but for an even share that balances what comes in and what goes out.
    """

    kind: Literal["imported"]
    files: Annotated[str, Field(min_length=1)]
    """A file, relative to the scenario's folder, or several: %d stands for numbers that count up by one, such as in
    wind_at_cell_centers_%d.csv, %g for times [s], such as in postProcessing/cloud/%g/points_U.xy."""
    interval: Duration = 1.0
    """Time from one numbered file to the next [s]; the first shows the time 0."""
    origin: Point | None = None
    """Where the domain's lower corner lies in the files [m]; unless given, the lower corner of the occupancy grid, or
    without one that of the points."""
    height: Coordinate | None = None
    """z in the files of the section that a 2-D run takes [m]; unless given, the middle of the points."""
    occupancy: Annotated[str, Field(min_length=1)] | None = None
    """Path of an OccupancyGrid3D.csv of GADEN's: obstacles besides the scenario's own."""
    walls: tuple[Face, ...] = ()
    """Faces of the domain that let no air through."""
    viscosity: Diffusivity = 1.56e-5
    """Kinematic viscosity [m²/s]; the default is air at 25 °C."""
    eddy_viscosity: Diffusivity | None = None
    """Of the turbulence that the files do not resolve [m²/s]; unless given, their column nut, or none."""
    schmidt: Positive = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas."""


class SyntheticWind(Model):
    """Weak convection of a closed room: random eddies and a slowly turning circulation; see solvers/synthetic.py.

    All faces of the domain are walls. Nothing is solved, so it costs little.
    """

    kind: Literal["synthetic"]
    speed: Speed = 0.03
    """Root mean square of the eddies' speed over the room [m/s]."""
    longest: Length = 2.0
    """Wavelength of the largest eddies [m]."""
    shortest: Length | None = None
    """Wavelength of the smallest eddies [m]; unless given 0.1 m, or four cells where that is more."""
    modes: Annotated[int, Field(ge=1, le=10_000)] = 64
    """Number of waves, spread evenly over the logarithm of the wavelength."""
    unsteadiness: NonNegative = 0.5
    """Frequency of each wave over that of the eddies of its size, sqrt(k³ E(k))."""
    circulation: Speed = 0.015
    """Root mean square speed of the rolls that fill the room, over room and time [m/s]."""
    circulation_time: Duration = 60.0
    """Time over which the circulation turns [s]."""
    wall_layer: Length = 0.3
    """How far from walls and obstacles the eddies have about three quarters of their strength [m]."""

    @model_validator(mode="after")
    def _ordered(self) -> "SyntheticWind":
        if self.shortest is not None and self.shortest >= self.longest:
            raise PydanticCustomError("waves", "shortest must be below longest")
        return self

    def shortest_on(self, spacing: float) -> float:
        """Wavelength of the smallest eddies [m] on cells of `spacing` [m]."""
        return self.shortest or max(0.1, 4 * spacing)


Wind = Annotated[
    CfdWind | UniformWind | FrozenWind | PlaybackWind | ImportedWind | SyntheticWind | PlumeSimWind,
    Field(discriminator="kind"),
]
