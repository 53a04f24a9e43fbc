"""The whole scenario vocabulary as frozen pydantic models. SI units; see `quantities` for texts with units.

``python -m taichi_plume.scenario.scenario --schema`` prints the JSON schema for editors.
Cross-field checks that need geometry live in `checks`; reading YAML in `loading`.
"""

from math import ceil
from typing import Annotated

from pydantic import Field

from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.gases import AnySource, Gas, MixtureGas, PureGas
from taichi_plume.scenario.maps import Map
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.outputs import Fields, PlumeLog, Recording
from taichi_plume.scenario.robots import Arena, Group
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    FREE,
    Delay,
    Duration,
    Model,
    Tick,
)
from taichi_plume.scenario.winds import Wind


class Scenario(Model):
    """One experiment: everything that decides its outcome."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"), FREE] = "run"
    seed: Annotated[int, Field(ge=0, lt=2**32), FREE] = 0
    duration: Duration
    """Time the robots are active [s]."""
    warm_up: Delay = 0.0
    """Flow and gas before the robots start [s]."""
    tick: Annotated[Tick, COMPILED] = 0.1
    """Control period [s]."""
    stop_early: Annotated[bool, FREE] = True
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
    recording: Annotated[Recording, FREE] = Recording()
    fields: Annotated[Fields | None, FREE] = None
    """Unless given, no fields.zarr is written."""
    plumesim_log: Annotated[PlumeLog | None, FREE] = None
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
