"""The whole scenario vocabulary as frozen pydantic models. SI units; see `quantities` for texts with units.

``python -m taichi_plume.scenario --schema`` prints the JSON schema for editors.
Cross-field checks that need geometry live in `checks`; reading YAML in `loading`.
"""

import difflib
from bisect import bisect_right
from itertools import pairwise
from math import ceil, hypot, pi, prod
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.quantities import quantity

Coordinate = quantity("m")
Length = quantity("m", gt=0)
Distance = quantity("m", ge=0)
Duration = quantity("s", gt=0)
Time = quantity("s")
Delay = quantity("s", ge=0)
Speed = quantity("m/s", ge=0)
Velocity = quantity("m/s")
Acceleration = quantity("m/s^2")
Rate = quantity("kg/s", ge=0, most=1, likely="mg/s")
Frequency = quantity("1/s", gt=0)
MolarMass = quantity("kg/mol", gt=0, most=1, likely="g/mol")
Pressure = quantity("Pa", gt=0)
FlowRate = quantity("m^3/s", gt=0, most=1000, likely="m^3/h")
TopSpeed = quantity("m/s", gt=0)
Tick = quantity("s", gt=0, le=1)
Diffusivity = quantity("m^2/s", ge=0)
Temperature = quantity("K", least=200, likely="degC", le=500)
Power = quantity("W")
HeatTransfer = quantity("W/m^2/K", gt=0)
HeatCapacity = quantity("J/m^3/K", gt=0)
Expansion = quantity("1/K", ge=0)
Fraction = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Real = Annotated[float, Field(allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=1_000_000)]
Point = Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=3)]
Point2 = tuple[Coordinate, Coordinate]
Convection = Literal["koren", "weno5"]
Face = Literal["x-", "x+", "y-", "y+", "z-", "z+"]


class Model(BaseModel):
    """A frozen section of a scenario that names its keys when one is misspelt."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            allowed = list(cls.model_fields)
            for key in data:
                if key not in allowed:
                    close = difflib.get_close_matches(str(key), allowed, n=1)
                    hint = f"did you mean '{close[0]}'? " if close else ""
                    raise PydanticCustomError(
                        "unknown_key",
                        "unknown key '{key}'; {hint}allowed: {allowed}",
                        {"key": str(key), "hint": hint, "allowed": ", ".join(allowed)},
                    )
        return data


# ---------------------------------------------------------------- domain and obstacles


class Domain(Model):
    """The box that is simulated, with its lower corner at the origin."""

    size: Annotated[tuple[Length, ...], Field(min_length=2, max_length=3)]
    """Extent per axis [m]; two numbers make a 2-D run."""
    spacing: Length
    """Edge of the cubic cells [m]; every extent is rounded to whole cells."""
    depth: Length = 1.0
    """Thickness of the slab that a 2-D run stands for [m]: it turns kg/s into kg/m³."""

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(self.size)

    @property
    def shape(self) -> tuple[int, ...]:
        """Cells per axis."""
        return tuple(max(1, round(extent / self.spacing)) for extent in self.size)

    @property
    def extent(self) -> tuple[float, ...]:
        """Extent per axis in whole cells [m]."""
        return tuple(n * self.spacing for n in self.shape)


class Motion(Model):
    """A walk over the ground: straight and even from way point to way point, without turning.

    The centre is at the obstacle's `center` at t = 0, and before; after the last way point it stands still.
    """

    path: Annotated[tuple[tuple[Time, Coordinate, Coordinate], ...], Field(min_length=1, max_length=10_000)]
    """Way points of the centre after t = 0: [time, x, y]."""
    loop: bool = False
    """Whether it starts over after the last way point, which must be the `center`; it then walks before t = 0 too."""

    @model_validator(mode="after")
    def _ascending(self) -> "Motion":
        times = [0.0, *(point[0] for point in self.path)]
        for n, (a, b) in enumerate(pairwise(times)):
            if not b > a:
                raise PydanticCustomError(
                    "motion",
                    "times must ascend from above 0: path[{n}] has {b} s after {a} s",
                    {"n": n, "a": f"{a:g}", "b": f"{b:g}"},
                )
        return self

    def place(self, center: tuple[float, ...], t: float) -> tuple[float, float]:
        """Where the centre is at time t [s], x and y [m]; `center` at t = 0."""
        times = [0.0, *(point[0] for point in self.path)]
        if self.loop:
            t %= times[-1]
        n = bisect_right(times, t) - 1
        if n < 0:
            return center[0], center[1]
        places = [center[:2], *(point[1:] for point in self.path)]
        if n == len(self.path):
            return self.path[-1][1:]
        share = (t - times[n]) / (times[n + 1] - times[n])
        (x, y), (next_x, next_y) = places[n], places[n + 1]
        return x + share * (next_x - x), y + share * (next_y - y)

    def legs(self, center: tuple[float, ...]) -> list[tuple[float, float, float]]:
        """Of each straight part its begin [s], its end [s] and the speed [m/s]."""
        points = [(0.0, center[0], center[1]), *self.path]
        return [(a[0], b[0], hypot(b[1] - a[1], b[2] - a[2]) / (b[0] - a[0])) for a, b in pairwise(points)]


class Box(Model):
    """An upright box, turned by `yaw_deg` about the vertical."""

    kind: Literal["box"]
    center: Point
    size: Annotated[tuple[Length, ...], Field(min_length=2, max_length=3)]
    yaw_deg: Real = 0.0
    motion: Motion | None = None


class Cylinder(Model):
    """A vertical cylinder; in 3-D it stands on `base` and reaches the ceiling unless `height` says otherwise."""

    kind: Literal["cylinder"]
    center: Point2
    radius: Length
    base: Distance = 0.0
    height: Length | None = None
    motion: Motion | None = None


class Sphere(Model):
    """A sphere (in 2-D a disc)."""

    kind: Literal["sphere"]
    center: Point
    radius: Length
    motion: Motion | None = None


class Prism(Model):
    """A vertical prism over a simple polygon; in 3-D from `base` to the ceiling unless `height` says otherwise."""

    kind: Literal["prism"]
    vertices: Annotated[tuple[Point2, ...], Field(min_length=3, max_length=10_000)]
    base: Distance = 0.0
    height: Length | None = None


class Mesh(Model):
    """A closed triangle mesh (STL, OBJ or PLY); in 2-D its section at `section` [m] above the ground."""

    kind: Literal["mesh"]
    file: str
    """Path, relative to the scenario's folder."""
    scale: Positive = 1.0
    yaw_deg: Real = 0.0
    translate: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    section: Coordinate = 0.0


def motion_of(obstacle: Model) -> Motion | None:
    """How an obstacle moves, None if it stands."""
    return getattr(obstacle, "motion", None)


Obstacle = Annotated[Box | Cylinder | Sphere | Prism | Mesh, Field(discriminator="kind")]

# ---------------------------------------------------------------- wind


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


class UniformWind(Model):
    """The same constant velocity everywhere; obstacles do not deflect it."""

    kind: Literal["uniform"]
    velocity: Annotated[tuple[Velocity, ...], Field(min_length=2, max_length=3)]


class FrozenWind(CfdWind):
    """The mean of a computed flow, kept for ever: `cfd` at first, then at no cost. The flow's fluctuations are lost."""

    kind: Literal["frozen"]  # type: ignore[assignment]
    after: Duration = 60.0
    """Time from the start of the warm-up until the flow stands still [s]."""
    average: Duration | None = None
    """The flow is averaged over so long before [s]; unless given, half of `after`."""


class Playback(Model):
    """A recorded run (see `fields`), linear in time between its frames; at its end the last one holds."""

    file: Annotated[str, Field(min_length=1)]
    """Path of a fields.zarr, relative to the scenario's folder."""
    loop: bool = False
    """Start again at the end, blending the last frame into the first."""
    rate: Positive = 1.0
    """Recorded seconds per simulated second; the recorded velocities stay as they are."""
    start: Time = 0.0
    """Recorded time [s] that is shown when the robots start."""


class PlaybackWind(Playback):
    """The air flow of a recorded run."""

    kind: Literal["playback"]


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
    CfdWind | UniformWind | FrozenWind | PlaybackWind | SyntheticWind, Field(discriminator="kind")
]

# ---------------------------------------------------------------- gas


class OtherSpecies(Model):
    """A vapour that is not in the table."""

    name: str = "gas"
    molar_mass: MolarMass
    diffusivity: Diffusivity


class Puffing(Model):
    """A source that is on and off by turns; the durations are drawn anew each time."""

    pulse: Duration
    """Mean duration of an emission [s]."""
    pause: Duration
    """Mean time between emissions [s]."""
    spread: Fraction = 0.5
    """Durations are uniform in mean·(1 ± spread)."""


class Source(Model):
    """A ball (in 2-D a disc) that emits evenly over its volume."""

    position: Point
    rate: Rate
    """Mass per time while it is on [kg/s]."""
    radius: Length = 0.05
    start: Time | None = None
    """First moment of emission [s]; unless given, the start of the warm-up."""
    stop: Time | None = None
    puffing: Puffing | None = None

    @model_validator(mode="after")
    def _ordered(self) -> "Source":
        if self.start is not None and self.stop is not None and self.stop <= self.start:
            raise PydanticCustomError("source", "stop must be later than start")
        return self


class EulerianGas(Model):
    """Convection and diffusion of a concentration on the grid."""

    kind: Literal["eulerian"]
    species: Literal["ethanol", "acetone"] | OtherSpecies = "ethanol"
    convection: Convection = "koren"
    """Scheme of convection; weno5 keeps filaments sharper on the same grid and costs more."""
    sources: Annotated[tuple[Source, ...], Field(min_length=1)]


class PlaybackGas(Playback):
    """The gas of a recorded run."""

    kind: Literal["playback"]
    species: Literal["ethanol", "acetone"] | OtherSpecies | None = None
    """Unless given, the recorded one."""
    sources: tuple[Source, ...] = ()
    """What the robots search for; unless given, the recorded ones."""


Gas = Annotated[EulerianGas | PlaybackGas, Field(discriminator="kind")]

# ---------------------------------------------------------------- robots


class StartAt(Model):
    """Robots at given places."""

    kind: Literal["positions"]
    positions: Annotated[tuple[Point2, ...], Field(min_length=1)]
    heading_deg: Real | None = None
    """Unless given, each robot starts with a random heading."""


class StartLine(Model):
    """Robots at equal distances from `begin` to `end`."""

    kind: Literal["line"]
    begin: Point2
    end: Point2
    heading_deg: Real | None = None


class StartArea(Model):
    """Robots at random free places of a rectangle."""

    kind: Literal["area"]
    low: Point2
    high: Point2
    heading_deg: Real | None = None


Start = Annotated[StartAt | StartLine | StartArea, Field(discriminator="kind")]


class Body(Model):
    """A disc that drives like a unicycle. Defaults: a small indoor robot."""

    radius: Length = 0.08
    height: Length = 0.15
    max_speed: TopSpeed = 0.2
    max_turn_rate_deg: Positive = 180.0
    """Degrees per second."""


class MoxSensor(Model):
    """A metal-oxide gas sensor: power-law response that lags, faster on the rise than on the decay."""

    kind: Literal["mox"]
    model: Literal["tgs2620", "mics5524"] = "mics5524"
    noise: NonNegative = 0.003
    """Standard deviation of ln R per sample."""
    rise_time: Delay | None = None
    """Time constants [s]; unless given, the model's."""
    decay_time: Delay | None = None
    period: Duration = 0.1
    """Time between samples [s]."""
    height: Distance = 0.1
    """Above the ground, in 3-D [m]."""


class IdealGasSensor(Model):
    """Reads the true concentration, with an optional lag and noise."""

    kind: Literal["ideal"]
    noise_ppm: NonNegative = 0.0
    rise_time: Delay = 0.0
    decay_time: Delay = 0.0
    period: Duration = 0.1
    height: Distance = 0.1


class Anemometer(Model):
    """Wind relative to the ground (own motion removed). Below its threshold it reads no wind."""

    kind: Literal["ultrasonic", "thermal", "ideal"]
    threshold: Speed | None = None
    """Smallest speed it sees [m/s]; unless given 0.01 (ultrasonic), 0.05 (thermal), 0 (ideal)."""
    noise: Speed | None = None
    """Standard deviation per component [m/s]; unless given 0.01 + 2 % of the speed (ideal: 0)."""
    height: Distance = 0.1


class Sensors(Model):
    """What a robot carries."""

    gas: Annotated[MoxSensor | IdealGasSensor, Field(discriminator="kind")] = MoxSensor(kind="mox")
    wind: Anemometer = Anemometer(kind="ultrasonic")


class Casting(Model):
    """Upwind while in the plume, crosswind when it is lost (Lochmatter & Martinoli's family). See agents/casting.py."""

    kind: Literal["casting"]
    speed: Speed | None = None
    """Unless given, the body's largest."""
    threshold_ppm: Positive = 5.0
    """Reading that means plume; it is left at 70 % of it."""
    upwind_angle_deg: Annotated[float, Field(ge=0, le=80)] = 20.0
    """Between the course in the plume and straight upwind."""
    lost_distance: Length = 0.3
    """Travelled without gas before the plume counts as lost [m]."""
    cast_distance: Length = 0.6
    """First crosswind search [m]; doubled at each failure."""
    find_step: Length = 0.3
    """Upwind step between sweeps of the plume finding [m]."""
    peak_fraction: Fraction = 0.7
    """Also out of the plume below this share of the last peak, so that a slow sensor notices; 0 switches it off."""
    wind_memory: Delay = 1.0
    """Time constant of the average of the measured wind direction [s]."""


Algorithm = Casting


class Group(Model):
    """Robots of one kind. `trials` independent copies of the team run at once in the same air."""

    name: str = "robots"
    count: Count
    trials: Count = 1
    start: Start
    algorithm: Algorithm
    body: Body = Body()
    sensors: Sensors = Sensors()
    reach: Distance = 0.35
    """A robot whose centre comes this close to a source has found it and stops [m]; the robot itself does not know."""
    wake: bool = False
    """Whether the robots disturb the air: in 3-D as solid bodies, in 2-D by their drag; of one trial only."""


# ---------------------------------------------------------------- maps, recording, scenario


class TimeSeriesMap(Model):
    """Spatio-temporal gas map (Marjovi & Marques, ICRA 2014, eq 1-7)."""

    kind: Literal["time_series"]
    cell: Length = 0.25
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.9
    """Weight of distance against age in the neighbourhood."""
    beta: Positive = 0.5
    """Size of the neighbourhood."""
    window: Duration = 5.0
    """Length of a snap [s]."""
    power: Positive = 2.0
    """Exponent of the inverse distance."""
    min_distance: Length | None = None
    """Distances below it count as it [m]; unless given, half a cell."""
    time_scale: Positive = 0.1
    """Distance that a second of age counts as [m/s]."""

    @model_validator(mode="after")
    def _has_neighbours(self) -> "TimeSeriesMap":
        age = (1.0 - self.alpha) * self.time_scale * self.window
        if age >= self.beta:
            raise PydanticCustomError(
                "neighbourhood",
                "sees no past snap: (1 - alpha) time_scale window = {age} must be below beta = {beta}",
                {"age": f"{age:g}", "beta": f"{self.beta:g}"},
            )
        return self


class IdwMap(Model):
    """Inverse-distance interpolation of each snap's readings (Marjovi & Marques, ICRA 2014, eq 1-3)."""

    kind: Literal["inverse_distance"]
    cell: Length = 0.25
    window: Duration = 5.0
    power: Positive = 2.0
    min_distance: Length | None = None


Map = Annotated[TimeSeriesMap | IdwMap, Field(discriminator="kind")]


class Recording(Model):
    """What goes into recording.rrd."""

    rate: Frequency = 5.0
    """Pictures of the gas per simulated second."""
    wind_rate: Frequency = 1.0
    volume: bool = True
    """In 3-D, the plume as a volume besides the floor slice."""
    slice_height: Distance = 0.1
    """Height of the slice in 3-D [m]."""
    range_ppm: tuple[Positive, Positive] = (0.1, 1000.0)
    """Ends of the logarithmic colour scale."""


class Fields(Model):
    """What goes into fields.zarr: wind and gas on the whole grid, to be looked at or played back by later runs."""

    rate: Frequency = 2.0
    """Frames per simulated second."""
    start: Time = 0.0
    """Time of the first frame [s]; negative in the warm-up."""
    quantities: Annotated[tuple[Literal["wind", "gas"], ...], Field(min_length=1)] = ("wind", "gas")


class Scenario(Model):
    """One experiment: everything that decides its outcome."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")] = "run"
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    duration: Duration
    """Time the robots are active [s]."""
    warm_up: Delay = 0.0
    """Flow and gas before the robots start [s]."""
    tick: Tick = 0.1
    """Control period [s]."""
    stop_early: bool = True
    """End once every robot of every group has found a source."""
    domain: Domain
    wind: Wind
    obstacles: tuple[Obstacle, ...] = ()
    gas: Gas
    robots: tuple[Group, ...] = ()
    maps: tuple[Map, ...] = ()
    recording: Recording = Recording()
    fields: Fields | None = None
    """Unless given, no fields.zarr is written."""

    @property
    def first_tick(self) -> int:
        """Tick at which the run begins: the warm-up in whole ticks, negative."""
        return -ceil(self.warm_up / self.tick - 1e-9)

    @property
    def last_tick(self) -> int:
        """Tick at which the run ends: the duration in whole ticks."""
        return ceil(self.duration / self.tick - 1e-9)


if __name__ == "__main__":
    import json
    import signal
    import sys

    if hasattr(signal, "SIGPIPE"):  # Windows has none
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # a reader such as `head` may leave early
    if sys.argv[1:] != ["--schema"]:
        sys.exit("usage: python -m taichi_plume.scenario --schema")
    print(json.dumps(Scenario.model_json_schema(), indent=2))
