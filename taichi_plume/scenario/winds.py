"""The air flow of a scenario: its kinds, and how eddies too small for the grid are modelled."""

from math import hypot
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.scenario.heat import Buoyancy
from taichi_plume.scenario.openings import Opening, Perforated, Straightener
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Acceleration,
    Convection,
    Coordinate,
    Diffusivity,
    Duration,
    Face,
    Length,
    Model,
    NonNegative,
    Point,
    Point2,
    Positive,
    Speed,
    Time,
    Velocity,
)


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
    interval: Annotated[Duration, COMPILED] = 1.0
    """Time from one numbered file to the next [s]; the first shows the time 0."""
    origin: Annotated[Point, COMPILED] | None = None
    """Where the domain's lower corner lies in the files [m]; unless given, the lower corner of the occupancy grid, or
    without one that of the points."""
    height: Annotated[Coordinate, COMPILED] | None = None
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
