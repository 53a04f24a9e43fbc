"""Output files of a run as sections of a scenario: recording, checkpoints, forces, films and PlumeSim logs."""

import re
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, starts_late
from taichi_plume.scenario.plumesim import nodes
from taichi_plume.scenario.vocabulary import Model, not_both, one_or_several

RECORDED = re.compile(r"(slice|section)(_\d+)?$")  # planes of a recording
RESERVED = ("wind", "column", "volume", "cells")  # its other views, and its groups
CLOSE = 1e-6  # relative tolerance of whole numbers


class Section(Model):
    """A vertical slice through a 3-D arena, seen from the side."""

    plane: Literal["xz", "yz"] | None = None
    """Axes of the slice; unless given, z and the longer side of the arena."""
    at: si.Distance | None = None
    """Position on the other axis. Unless given, at the first source and another slice at the first heater; without
    either, in the middle."""

    def normal(self, extent: Sequence[float]) -> int:
        """Return the index of the axis normal to the slice (0: x, 1: y), in a domain of this extent [m]."""
        along_x = extent[0] >= extent[1] if self.plane is None else self.plane == "xz"
        return 1 if along_x else 0

    def errors(self, where: str, context: Context) -> Iterator[str]:
        extent = context.domain.extent
        axis = self.normal(extent)
        if self.at is not None and len(extent) == 3 and self.at > extent[axis]:
            yield f"{where}.at: {self.at:g} m is outside the domain; use 0 to {extent[axis]:g} m along {'xy'[axis]}"


class Recording(Model):
    """Content of recording.rrd, and of pictures.zarr, which has the numbers behind its colours."""

    rate: si.Frequency = 5.0
    """Pictures of the gas, and of the temperature, per simulated second."""
    wind_rate: si.Frequency = 1.0
    """Pictures of the wind, as arrows, per simulated second."""
    volume: bool = True
    """In 3-D, the plume as a volume besides the pictures on planes."""
    slice_height: one_or_several(si.Distance, 8) | None = None  # type: ignore[valid-type]
    """Height of the horizontal slice in 3-D, or a list of several. Unless given, those of the first source, of
    the gas sensors and of the first heater, as far as they are a cell apart."""
    section: Section | None = Section()
    """In 3-D, the vertical slice; null for none."""
    range_ppm: tuple[si.SomePpm, si.SomePpm] = (0.1, 1000.0)
    """Ends of the logarithmic colour scale of the gas: less is shown as the lower, more as the upper end."""
    range_kelvin: tuple[si.Temperature, si.Temperature] | None = None
    """Ends of the colour scale of the temperature, where it is computed. Unless given, the extremes of
    walls, openings, air at the start and, about, the air over heaters."""
    trail: si.Duration | None = None
    """Duration of the trail behind a robot. Unless given, the time for twice the longer side of the arena; with
    one or two robots, all of the run."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        extent = context.domain.extent
        for height in self.slice_height or ():
            if len(extent) == 3 and height > extent[2]:
                yield f"{where}.slice_height: {height:g} m is above the ceiling; use at most {extent[2]:g} m"
        for key in ("range_ppm", "range_kelvin"):
            ends = vars(self)[key]
            if ends is not None and ends[0] >= ends[1]:
                yield f"{where}.{key}: the first must be below the second, got {ends[0]:g} and {ends[1]:g}"


class Output(Model):
    """A view of the run that is written by itself: a group of pictures.zarr, or a file of `Simulation.write`."""

    name: Annotated[str, Field(pattern="^[a-z][a-z0-9_]{0,30}$")] = "view"
    """Name of the group."""
    quantity: str = "gas"
    """Shown quantity: gas (the sum), gas_0 and so on (a gas of several), temperature or wind."""
    plane: Literal["xy", "xz", "yz", "column"] = "xy"
    """Axes of the plane; column: from above, the maximum over the height."""
    at: si.Distance | None = None
    """Position of the plane on the third axis, in 3-D; unless given, in the middle of the room."""
    rate: si.Frequency = 1.0
    """Pictures per simulated second."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        extent = context.domain.extent
        if len(extent) == 2 and (self.plane != "xy" or self.at is not None):
            yield f"{where}: a 2-D room has the plane xy alone; leave out plane and at"
        elif len(extent) == 3 and self.plane != "column" and self.at is not None:
            axis = "xyz".index(next(letter for letter in "xyz" if letter not in self.plane))
            if self.at > extent[axis]:
                use = f"use 0 to {extent[axis]:g} m along {'xyz'[axis]}"
                yield f"{where}.at: {self.at:g} m is outside the domain; {use}"
        if self.name in RESERVED or RECORDED.match(self.name):
            yield f"{where}.name: '{self.name}' is a name of the recording; choose another"
        if [output.name for output in context.scenario.outputs].count(self.name) > 1:
            yield f"{where}.name: '{self.name}' is the name of several outputs; give each its own"


class Checkpoint(Model):
    """Interval of checkpoints, from which a run can be resumed, in checkpoint.npz."""

    wall: si.Duration | None = None
    """Wall-clock time between checkpoints; 300 s if neither is given."""
    every: si.Duration | None = None
    """Simulated time between checkpoints, in whole ticks; instead of `wall`."""

    _one_interval = not_both("wall", "every")


class Forces(Model):
    """Content of forces.csv: the force of the air on each obstacle."""

    every: Literal["step"] | si.Duration = 1.0
    """Time between rows, in whole ticks; step: rows after each step of the air."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        tick = context.scenario.tick
        if self.every != "step" and self.every < tick * (1 - CLOSE):
            yield f"{where}.every: {self.every:g} s is shorter than a tick of {tick:g} s; use step, or lower tick"


class Fields(Model):
    """Content of fields.zarr: wind, gas and temperature on the whole grid, to view or play back."""

    rate: si.Frequency = 2.0
    """Frames per simulated second."""
    start: si.Time = 0.0
    """Time of the first frame [s]; negative in the warm-up."""
    quantities: Annotated[tuple[Literal["wind", "gas", "temperature"], ...], Field(min_length=1)] = (
        "wind",
        "gas",
        "temperature",
    )
    """Quantities to film. Temperature stands for all besides wind and gas, and is filmed only if it is computed
    (`buoyancy: {heat: ...}` of the wind)."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        tick = context.scenario.tick
        if self.rate * tick > 1 + 1e-9:
            yield (
                f"{where}.rate: {self.rate:g} frames per second are more than one per tick of {tick:g} s; "
                f"use at most {1 / tick:g}, or lower tick"
            )
        if set(self.quantities) == {"temperature"} and context.scenario.heat is None:
            yield f"{where}.quantities: no temperature is computed; give wind.buoyancy.heat, or add wind or gas"
        yield from starts_late(where, self.start, context)


class PlumeLog(Model):
    """Content of plume.pslog: gas and wind on the nodes of a lattice, as a log of PlumeSim."""

    rate: si.Frequency = 1.0
    """Frames per simulated second; each has to last whole ticks and whole milliseconds."""
    start: si.Time = 0.0
    """Time of the first frame; negative in the warm-up."""
    cell: si.Length = 0.1
    """Distance of the nodes."""
    full_scale_ppm: si.FullScale = 100.0
    """Concentration in ppm that is written as 100 percent; more gas is written as more."""
    height: si.Distance = 0.1
    """Height of the nodes over the floor, in 3-D; the log itself is flat."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        domain, tick = context.domain, context.scenario.tick
        ticks = 1 / (self.rate * tick)
        whole = max(1, round(ticks))
        if abs(ticks - whole) > CLOSE * whole or abs(1000 * tick * whole % 1 - 0.5) < 0.5 - CLOSE:
            yield (
                f"{where}.rate: {self.rate:g} frames per second are {1000 / self.rate:g} ms each, which must be "
                f"whole milliseconds and whole ticks of {1000 * tick:g} ms; use "
                f"{1 / (whole * tick):.6g}, or change tick"
            )
        yield from starts_late(where, self.start, context)
        yield from nodes(where, self.cell, domain)
        if domain.dim == 3 and self.height > domain.extent[2]:
            yield f"{where}.height: {self.height:g} m is above the ceiling; use at most {domain.extent[2]:g} m"
