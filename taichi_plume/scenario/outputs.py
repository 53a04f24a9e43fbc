"""What a run writes besides its tables: the recording, films and PlumeSim logs."""

from typing import Annotated, Literal

from pydantic import Field

from taichi_plume.scenario.vocabulary import Distance, Frequency, FullScale, Length, Model, Positive, Time


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


class PlumeLog(Model):
    """What goes into plume.pslog: gas and wind on the nodes of a lattice, as a log of PlumeSim."""

    rate: Frequency = 1.0
    """Frames per simulated second."""
    start: Time = 0.0
    """Time of the first frame [s]; negative in the warm-up."""
    cell: Length = 0.1
    """Distance of the nodes [m]."""
    full_scale_ppm: FullScale = 100.0
    """What is written as 100 percent; more gas is written as more."""
    height: Distance = 0.1
    """Of the nodes, in 3-D [m]; the log itself is flat."""
