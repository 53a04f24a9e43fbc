"""What a run writes: the recording, forces, films and PlumeSim logs."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from pydantic import Field

from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.plumesim import nodes
from taichi_plume.scenario.vocabulary import (
    Distance,
    Duration,
    Frequency,
    FullScale,
    Length,
    Model,
    SomePpm,
    Temperature,
    Time,
    one_or_several,
)

CLOSE = 1e-6  # of a number: as good as whole


class Section(Model):
    """A vertical slice through a 3-D arena, seen from the side."""

    plane: Literal["xz", "yz"] | None = None
    """The axes that it shows; unless given, z and the longer side of the arena."""
    at: Distance | None = None
    """Where it cuts the other axis. Unless given, at the first source and another one at the first heater, and
    without either in the middle."""

    def normal(self, extent: Sequence[float]) -> int:
        """The axis that it cuts, in a domain of `extent`."""
        along_x = extent[0] >= extent[1] if self.plane is None else self.plane == "xz"
        return 1 if along_x else 0

    def problems(self, where: str, context: Context) -> Iterator[str]:
        extent = context.domain.extent
        axis = self.normal(extent)
        if self.at is not None and len(extent) == 3 and self.at > extent[axis]:
            yield f"{where}.at: {self.at:g} m is outside the domain; use at most {extent[axis]:g} m of {'xy'[axis]}"


class Recording(Model):
    """What goes into recording.rrd."""

    rate: Frequency = 5.0
    """Pictures of the gas, and of the temperature, per simulated second."""
    wind_rate: Frequency = 1.0
    """Pictures of the wind, as arrows, per simulated second."""
    volume: bool = True
    """In 3-D, the plume as a volume besides the pictures on planes."""
    slice_height: one_or_several(Distance, 8) | None = None  # type: ignore[valid-type]
    """Height of the horizontal slice in 3-D, or a list of several. Unless given, those of the first source, of
    the gas sensors and of the first heater, as far as they are a cell apart."""
    section: Section | None = Section()
    """In 3-D, the vertical slice; null for none."""
    range_ppm: tuple[SomePpm, SomePpm] = (0.1, 1000.0)
    """Ends of the logarithmic colour scale of the gas: less is shown as the lower, more as the upper end."""
    range_kelvin: tuple[Temperature, Temperature] | None = None
    """Ends of the colour scale of the temperature, where it is computed. Unless given, the coldest and the warmest that
    walls, openings and the air at the begin have, and about what the air over heaters gets."""
    trail: Duration | None = None
    """How long the trail behind a robot lasts. Unless given, as long as a robot takes for twice the longer side of
    the arena, and all of its way where there are but one or two robots."""

    def problems(self, where: str, context: Context) -> Iterator[str]:
        extent = context.domain.extent
        for height in self.slice_height or ():
            if len(extent) == 3 and height > extent[2]:
                yield f"{where}.slice_height: {height:g} m is above the ceiling; use at most {extent[2]:g} m"
        for key in ("range_ppm", "range_kelvin"):
            ends = vars(self)[key]
            if ends is not None and ends[0] >= ends[1]:
                yield f"{where}.{key}: the first must be below the second, got {ends[0]:g} and {ends[1]:g}"


class Checkpoint(Model):
    """How often all that a run needs to be resumed is written to checkpoint.npz."""

    wall: Duration | None = None
    """Time of the clock on the wall between checkpoints; 300 s where neither is given."""
    every: Duration | None = None
    """Simulated time between checkpoints, in whole ticks; instead of `wall`."""

    def problems(self, where: str, context: Context) -> Iterator[str]:
        if self.wall is not None and self.every is not None:
            yield f"{where}: has wall and every; give one of them"


class Forces(Model):
    """What goes into forces.csv: the force of the air on each obstacle."""

    every: Literal["step"] | Duration = 1.0
    """Time between its rows, in whole ticks; step: rows after each step of the air."""

    def problems(self, where: str, context: Context) -> Iterator[str]:
        tick = context.scenario.tick
        if self.every != "step" and self.every < tick * (1 - CLOSE):
            yield f"{where}.every: {self.every:g} s is shorter than a tick of {tick:g} s; use step, or lower tick"


class Fields(Model):
    """What goes into fields.zarr: wind, gas and temperature on the whole grid, to be looked at or played back."""

    rate: Frequency = 2.0
    """Frames per simulated second."""
    start: Time = 0.0
    """Time of the first frame [s]; negative in the warm-up."""
    quantities: Annotated[tuple[Literal["wind", "gas", "temperature"], ...], Field(min_length=1)] = (
        "wind",
        "gas",
        "temperature",
    )
    """What to film; temperature only where it is solved for (`buoyancy: {heat: ...}` of the wind)."""

    def problems(self, where: str, context: Context) -> Iterator[str]:
        tick = context.scenario.tick
        if self.rate * tick > 1 + 1e-9:
            yield (
                f"{where}.rate: {self.rate:g} frames per second are more than one per tick of {tick:g} s; "
                f"use at most {1 / tick:g}, or lower tick"
            )
        buoyancy = getattr(context.scenario.wind, "buoyancy", None)
        if set(self.quantities) == {"temperature"} and (buoyancy is None or buoyancy.heat is None):
            yield f"{where}.quantities: this run solves for no temperature; give wind.buoyancy.heat, or add wind or gas"
        yield from _begins(where, self.start, context)


class PlumeLog(Model):
    """What goes into plume.pslog: gas and wind on the nodes of a lattice, as a log of PlumeSim."""

    rate: Frequency = 1.0
    """Frames per simulated second; each has to last whole ticks and whole milliseconds."""
    start: Time = 0.0
    """Time of the first frame; negative in the warm-up."""
    cell: Length = 0.1
    """Distance of the nodes."""
    full_scale_ppm: FullScale = 100.0
    """How many ppm are written as 100 percent; more gas is written as more."""
    height: Distance = 0.1
    """Height of the nodes over the floor, in 3-D; the log itself is flat."""

    def problems(self, where: str, context: Context) -> Iterator[str]:
        domain, tick = context.domain, context.scenario.tick
        ticks = 1 / (self.rate * tick)
        whole = max(1, round(ticks))
        if abs(ticks - whole) > CLOSE * whole or abs(1000 * tick * whole % 1 - 0.5) < 0.5 - CLOSE:
            yield (
                f"{where}.rate: {self.rate:g} frames per second are {1000 / self.rate:g} ms each, which must be "
                f"whole milliseconds and whole ticks of {1000 * tick:g} ms; use "
                f"{1 / (whole * tick):.6g}, or change tick"
            )
        yield from _begins(where, self.start, context)
        yield from nodes(where, self.cell, domain)
        if domain.dim == 3 and self.height > domain.extent[2]:
            yield f"{where}.height: {self.height:g} m is above the ceiling; use at most {domain.extent[2]:g} m"


def _begins(where: str, start: float, context: Context) -> Iterator[str]:
    end = context.scenario.duration
    if start > end:
        yield f"{where}.start: {start:g} s is after the end at {end:g} s; start it earlier"
