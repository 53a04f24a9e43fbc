"""Kinds of gas in a scenario: on the grid (Eulerian convection-diffusion), as puffs, played back, and mixtures."""

from collections.abc import Iterator, Mapping
from math import pi
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.closed_forms import (
    ContinuousGas,
    GaussianPlumeGas,
    GaussianPuffGas,
    MeanderingGas,
    PlumeSource,
    Release,
)
from taichi_plume.scenario.domain import Context, Domain
from taichi_plume.scenario.initial_conditions import InitialGas
from taichi_plume.scenario.own_code import OwnGas
from taichi_plume.scenario.playback import GadenGas, MovieGas, Playback
from taichi_plume.scenario.plumesim import FluentGas, PlumeSimGas, PlumeSimMeander, PlumeSimPuff
from taichi_plume.scenario.sources import AnySpecies, OneGas, PlayedSource, Source, dishes
from taichi_plume.scenario.species import Species
from taichi_plume.scenario.surfaces import GasSurfaces, Inflow, inflow_faults
from taichi_plume.scenario.vocabulary import AT_START, SHAPE, SPATIAL, Convection, Model


class EulerianGas(OneGas):
    """Gas on the grid: the wind carries it, molecules and eddies spread it. The usual kind."""

    kind: Literal["eulerian"]
    on_grid: ClassVar[bool] = True
    solved: ClassVar[bool] = True
    weighs: ClassVar[bool] = True
    convection: Convection = "koren"
    """Scheme that carries the gas. weno5 is of fifth order: it keeps filaments sharper on the same grid and costs
    more."""
    initial: Annotated[InitialGas | None, AT_START] = None
    """Concentration at the start of the warm-up; unless given, the air is clean."""
    sources: Annotated[tuple[Source, ...], Field(min_length=1)]
    """Sources of the gas, at least one; robots search for them."""
    inflow: tuple[Inflow, ...] = ()
    """Gas in the air that flows in through openings; unless named, it is clean."""
    surfaces: GasSurfaces | None = None
    """Walls and obstacles that take up or emit gas; unless named, none do."""
    fluctuations: bool = False
    """Whether gas sensors feel the fluctuations that eddies smaller than a cell make. They are random peaks about the
    mean of the cells, near a source on a coarse grid as large as the mean."""

    def begins_in(self, radius: float, domain: Domain) -> float:
        """Return the cross-section [m²] of a source of this radius [m], which is taken as half a cell at least."""
        r = max(radius, 0.5 * domain.spacing)
        return 2.0 * r * domain.depth if domain.dim == 2 else pi * r**2

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from dishes(where, self.vapour, self.sources)
        yield from inflow_faults(f"{where}.inflow", self.inflow, context)


class DiffusiveGrowth(Model):
    """Puffs whose squared size grows evenly.

    R² = R0² + rate t (Farrell et al. 2002, doi:10.1023/A:1016283702837).
    """

    kind: Literal["diffusive"]
    rate: si.EddyDiffusivity = 1e-4
    """Growth rate of the square of a puff's size."""


class InertialGrowth(Model):
    """Puffs that grow faster the larger they are, as in turbulence.

    R^(2/3) = R0^(2/3) + (g epsilon/6)^(1/3) t, the law of the inertial range.

    g = 0.5 is Richardson's constant: the mean square distance of two particles, 6 R², grows as g epsilon t³ (Ott & Mann
    2000, doi:10.1017/S0022112000001658).
    """

    kind: Literal["inertial"]
    dissipation: si.Dissipation | None = None
    """Turbulent kinetic energy lost per time, epsilon: more makes puffs grow faster. Unless given, that of the wind's
    eddies about each puff, or 1e-3 in a wind without."""


class PuffGas(OneGas):
    """Puffs that the wind carries and its eddies disperse: whiffs and peaks finer than the grid.

    See solvers/puffs.py.
    """

    kind: Literal["puffs"]
    solved: ClassVar[bool] = True
    sources: Annotated[tuple[Source, ...], Field(min_length=1)]
    """Sources of the puffs, at least one; robots search for them."""
    release_rate: si.Frequency = 50.0
    """Puffs per second and source. Each holds the emission of its source since the previous one; more make a smoother
    plume and take longer."""
    poisson: bool = False
    """Whether puffs are released at random times rather than steadily."""
    initial_size: si.Length = 0.01
    """Size of a new puff, as standard deviation. Smaller ones start with higher peaks."""
    fluctuation: si.Speed | None = None
    """Random velocity of each puff, as standard deviation of a component. It stands for eddies that the wind lacks:
    unless given 0.05 in a uniform wind, which has no eddies, and 0 in the others, which have their own."""
    fluctuation_time: si.Duration = 0.5
    """Time over which that random velocity changes. Longer lets puffs stray farther."""
    growth: Annotated[DiffusiveGrowth | InertialGrowth, Field(discriminator="kind")] | None = None
    """Growth of a puff by eddies smaller than it, besides molecules and the wind's eddy viscosity. Unless given,
    inertial in a wind with eddies, diffusive in a uniform wind and none in the others."""
    handover: bool | None = None
    """Whether puffs that have become wider than a cell go on as gas on the grid. Unless given, in a wind with eddies,
    which then mix it."""
    convection: Convection = "koren"
    """Scheme that carries gas on the grid after the handover, as for an eulerian gas."""
    buoyancy: Annotated[bool, SPATIAL] = False
    """Whether puffs of heavy gas sink; 3-D only."""
    cutoff: Annotated[float, Field(ge=2, le=5), SHAPE] = 3.5
    """Where a puff ends, in standard deviations from its middle. More is more exact and takes longer."""
    most: Annotated[si.Count, Field(ge=100)] = 200_000
    """Puffs at a time: beyond, neighbours are merged. More keep finer filaments and take more memory."""

    @property
    def finest(self) -> float:
        return self.initial_size

    by_chance: ClassVar[bool] = True

    def bytes(self, dim: int) -> float:
        """Return the memory of puffs: twice their positions, velocities, sizes and masses, and arrays to sort and
        sum."""
        return 4.0 * (5 * dim + 11) * self.most

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from dishes(where, self.vapour, self.sources)
        at_once, tick = self.release_rate * len(self.sources), context.scenario.tick
        if at_once * tick > self.most:
            yield (
                f"{where}.release_rate: {at_once:g} puffs per second are {at_once * tick:.3g} in a tick of {tick:g} s, "
                f"more than most: {self.most}; lower it"
            )
        width, buoyancy = min(context.domain.extent), context.scenario.buoyancy
        if self.initial_size > 0.5 * width:
            yield (
                f"{where}.initial_size: puffs of {self.initial_size:g} m do not fit a domain {width:g} m wide; "
                "make them smaller"
            )
        if self.handover and not context.scenario.wind.on_grid:
            yield (
                f"{where}.handover: a wind of kind {context.scenario.wind.kind} cannot carry gas on the grid; remove "
                "it, or use another wind"
            )
        if self.handover and self.buoyancy:
            yield f"{where}.handover: gas on the grid does not sink by itself; remove it, or {where}.buoyancy"
        if buoyancy is not None and buoyancy.solutal:
            yield (
                f"{where}.kind: puffs have no buoyancy force on the air; use eulerian, or wind.buoyancy.solutal: false "
                f"with {where}.buoyancy: true"
            )


class PlaybackGas(OneGas, Playback):
    """Playback of the gas of a recorded run, or of a species of it."""

    part: ClassVar[Literal["wind", "gas"]] = "gas"
    kind: Literal["playback"]
    species: AnySpecies | None = None  # type: ignore[assignment]
    """Species of the gas; unless given, the recorded one."""
    background: si.Concentration | None = None  # type: ignore[assignment]
    """Concentration of the species in clean air, which the record does not contain; unless given, that of its run."""
    sources: tuple[PlayedSource, ...] = ()
    """Places that robots search for; unless given, the recorded ones."""


AnySource = Source | Release | PlumeSource
"""Sources with position and radius, which the robots search for."""


PureGas = (
    EulerianGas
    | PuffGas
    | PlaybackGas
    | GaussianPuffGas
    | ContinuousGas
    | GaussianPlumeGas
    | MeanderingGas
    | PlumeSimGas
    | FluentGas
    | PlumeSimPuff
    | PlumeSimMeander
    | MovieGas
    | GadenGas
    | OwnGas
)


class MixtureGas(Model):
    """Several gases at once, of any kinds and species; equal species add up."""

    kind: Literal["mixture"]
    parts: Annotated[
        tuple[Annotated[PureGas, Field(discriminator="kind")], ...], Field(min_length=1, max_length=16)
    ]
    """The gases, each with all keys of a `gas` section of its own. Equal species add up."""

    def alone(self, where: str) -> "tuple[tuple[str, PureGas], ...]":
        """Return (path, gas) of each part of the mixture, a gas of one species; where: path of the mixture."""
        return tuple((f"{where}.parts[{n}]", part) for n, part in enumerate(self.parts))

    def replaced(self, where: str, others: "Mapping[str, PureGas]") -> "MixtureGas":
        """Return a copy in which the gases at the paths in `others` are replaced; where: path of the mixture."""
        parts = tuple(others.get(path, part) for path, part in self.alone(where))
        return self.model_copy(update={"parts": parts})

    def errors(self, where: str, context: Context) -> Iterator[str]:
        names: dict[str, Species] = {}
        backgrounds: dict[str, tuple[str, float]] = {}
        for path, gas in self.alone(where):
            first, ppm = backgrounds.setdefault(gas.vapour.name, (path, gas.background or 0.0))
            if ppm and gas.background and gas.background != ppm:
                yield (
                    f"{path}.background: {gas.background:g} ppm, but {first}.background is {ppm:g} ppm; the "
                    f"air has one background of {gas.vapour.name}, give it once"
                )
            elif not ppm:
                backgrounds[gas.vapour.name] = path, gas.background or 0.0
            other = names.setdefault(gas.vapour.name, gas.vapour)
            if other != gas.vapour:
                yield f"{path}.species.name: '{other.name}' is another species of this scenario; use another name"


Gas = Annotated[PureGas | MixtureGas, Field(discriminator="kind")]
