"""The whole scenario vocabulary as frozen pydantic models. SI units; see `quantities` for texts with units.

``python -m taichi_plume.scenario --schema`` prints the JSON schema for editors.
Cross-field checks that need geometry live in `checks`; reading YAML in `loading`.
"""

from math import ceil
from typing import Annotated, Literal

from pydantic import Field

from taichi_plume.gases import AnySource, Gas, MixtureGas, PureGas
from taichi_plume.map_models import Map
from taichi_plume.obstacles import Obstacle
from taichi_plume.robots import Arena, Group
from taichi_plume.vocabulary import (
    Delay,
    Distance,
    Duration,
    Frequency,
    FullScale,
    Length,
    Model,
    Positive,
    Tick,
    Time,
)
from taichi_plume.winds import Wind


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
    arena: Arena | None = None
    """Where robots may be; unless given, on the whole floor."""
    robots: tuple[Group, ...] = ()
    rivals: bool = False
    """Whether each group searches as if the others were not there: to compare them in the same air."""
    maps: tuple[Map, ...] = ()
    recording: Recording = Recording()
    fields: Fields | None = None
    """Unless given, no fields.zarr is written."""
    plumesim_log: PlumeLog | None = None
    """Unless given, no plume.pslog is written."""

    @property
    def floor(self) -> Arena:
        """Where robots may be."""
        width, length = self.domain.extent[:2]
        return self.arena or Arena(low=(0.0, 0.0), high=(width, length))

    @property
    def gases(self) -> tuple[tuple[str, PureGas], ...]:
        """Every gas of one species, with its path in the scenario."""
        if isinstance(self.gas, MixtureGas):
            return tuple((f"gas.parts[{n}]", part) for n, part in enumerate(self.gas.parts))
        return (("gas", self.gas),)

    @property
    def sources(self) -> tuple[tuple[str, AnySource], ...]:
        """Every source of every gas, with its path in the scenario."""
        return tuple(
            (f"{path}.{gas.sources_key}[{n}]", source)
            for path, gas in self.gases
            for n, source in enumerate(gas.sources)
        )

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
