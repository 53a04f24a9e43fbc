"""Where gas comes from: species, sources and dishes of a scenario, and what every gas of one species has."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Self

from pydantic import BeforeValidator, field_validator, model_validator

from taichi_plume.scenario.changes import shown
from taichi_plume.scenario.domain import Context, Domain, Located
from taichi_plume.scenario.quantities import fault
from taichi_plume.scenario.species import PRESSURE, SPECIES, TEMPERATURE, Species, SpeciesName
from taichi_plume.scenario.suggestions import hint
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Diffusivity,
    Duration,
    Fraction,
    LatentHeat,
    Length,
    Model,
    MolarMass,
    Pressure,
    Rate,
    Speed,
    Temperature,
    Time,
)


class OtherSpecies(Model):
    """A vapour that is not in the table."""

    name: str = "gas"
    """What the vapour is called, in files of the run and in what sensors are told of it."""
    molar_mass: MolarMass
    """Mass of a mole. It turns kg/m³ into ppm, and vapours above 0.029 kg/mol are heavier than air."""
    diffusivity: Diffusivity
    """Diffusivity of its molecules in still air, about 1e-5 m²/s for vapours."""
    vapour_pressure: Pressure | None = None
    """Pressure over the liquid at the temperature of its dish; for sources that are dishes."""
    latent_heat: LatentHeat | None = None
    """Heat that evaporation takes per mass; for dishes that cool."""

    @field_validator("name")
    @classmethod
    def _is_one_name(cls, name: str) -> str:
        """It names variables in zarr, NetCDF and HDF5, where a slash begins a group of others."""
        if "/" in name or "\\" in name:
            raise fault(
                "got '{got}': must be without '/' and '\\', as it names variables in files", {"got": name}
            )
        return name


def _known(value: Any) -> Any:
    """A name that there is, or the figures of another species."""
    if value in (None, *SPECIES) or isinstance(value, dict | OtherSpecies):
        return value
    raise fault(
        "got {got}; {hint}allowed: {names}; any other needs {figures}",
        {
            "got": shown(value),
            "hint": hint(value, SPECIES) if isinstance(value, str) else "",
            "names": ", ".join(SPECIES),
            "figures": "{molar_mass: ..., diffusivity: ...}",
        },
    )


AnySpecies = Annotated[SpeciesName | OtherSpecies, BeforeValidator(_known)]


class Puffing(Model):
    """A source that is on and off by turns; the durations are drawn anew each time."""

    pulse: Duration
    """Mean time for which the source is on."""
    pause: Duration
    """Mean time for which it is off between two emissions."""
    spread: Fraction = 0.5
    """How irregular it is: durations are uniform in mean·(1 ± spread), drawn anew each time. 0 is a strict rhythm."""

    @property
    def by_chance(self) -> bool:
        return self.spread > 0


class Dish(Model):
    """A flat, open dish of liquid: the wind over it says how much evaporates; see solvers/evaporation.py."""

    diameter: Length
    """Diameter of the open surface of liquid. What evaporates grows with it, somewhat less than the area."""
    temperature: Temperature = TEMPERATURE
    """Temperature of the air and, unless evaporation cools it, of the liquid. Warmer evaporates more."""
    cooling: bool = True
    """Whether evaporation cools the liquid, so that less evaporates; otherwise something keeps its temperature."""
    air_speed: Speed | None = None
    """Speed of the air over the dish. Unless given, of the wind half a diameter above the source (in 2-D: there)."""


class Source(Located):
    """A ball (in 2-D a disc) that emits evenly over its volume, with a given rate or what a dish gives off."""

    rate: Rate | None = None
    """Mass that it emits per time while it is on. Give either this or a `dish`."""
    dish: Dish | None = None
    """An open dish of liquid instead of a rate: the wind over it says how much evaporates."""
    radius: Annotated[Length, COMPILED] = 0.05
    """Radius of the ball (in 2-D the disc) that emits evenly over its volume. On a grid its gas is read with a standard
    deviation of 0.9 cells at least, that of a ball with a radius of two cells. With a dish: half of its diameter unless
    given, and no other value except to spread the vapour of a dish smaller than a cell over up to a cell."""
    start: Time | None = None
    """First moment of emission; unless given, the start of the warm-up."""
    stop: Time | None = None
    """Last moment of emission; unless given, it goes on to the end."""
    puffing: Puffing | None = None
    """Switches the source on and off by turns; unless given, it emits evenly."""

    @model_validator(mode="after")
    def _ordered(self) -> "Source":
        if (self.rate is None) == (self.dish is None):
            got = "neither" if self.dish is None else "both"
            raise fault("takes a rate or a dish, got {got}", {"got": got})
        if self.start is not None and self.stop is not None and self.stop <= self.start:
            raise fault("stop must be later than start")
        if self.dish is not None and "radius" not in self.model_fields_set:
            vars(self)["radius"] = 0.5 * self.dish.diameter
        return self

    def problems(self, where: str, context: Context) -> Iterator[str]:
        yield from super().problems(where, context)
        half = 0.5 * self.dish.diameter if self.dish else self.radius
        spreads = half < self.radius <= context.domain.spacing * (1 + 1e-6)
        if self.dish and abs(self.radius - half) > 0.01 * half and not spreads:
            yield (
                f"{where}: radius = {self.radius:g} m and dish.diameter = {self.dish.diameter:g} m disagree: half of "
                f"the diameter is {half:g} m; remove radius or change one of them"
            )

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        if self.rate == 0:
            yield f"{where}.rate: 0 kg/s: it emits nothing"
        yield from unheard(where, self.start, self.stop, context)


class Target(Source):
    """A source of a plume that is given: robots search for it, here it emits nothing."""

    rate: Rate = 0.0
    """Without effect here: the plume is given, and robots search for this place."""

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        yield from ()


def unheard(where: str, start: float | None, stop: float | None, context: Context) -> Iterator[str]:
    """What is emitted after the end, or has ended before the begin, of a run."""
    scenario, begin = context.scenario, 0.0 - context.scenario.warm_up
    if start is not None and start >= scenario.duration:
        yield f"{where}.start: {start:g} s is not before the end at {scenario.duration:g} s: it emits nothing"
    if stop is not None and stop <= begin:
        yield f"{where}.stop: {stop:g} s is before the begin at {begin:g} s: it emits nothing"


def dishes(where: str, species: Species, sources: Sequence[Source]) -> Iterator[str]:
    """The species of a dish has to be known as a liquid, which must not boil; `where` is the gas."""
    for n, source in enumerate(sources):
        dish = source.dish
        if dish is None:
            continue
        path = f"{where}.sources[{n}].dish"
        if species.antoine is None and species.vapour_pressure is None:
            if species.name in SPECIES:
                yield f"{path}: {species.name} is no liquid that stands in a dish; give the source a rate instead"
                continue
            yield f"{where}.species: missing key 'vapour_pressure', at the temperature of {path}"
        elif species.saturation(dish.temperature, dish.temperature) >= PRESSURE:
            pressure = species.saturation(dish.temperature, dish.temperature)
            yield (
                f"{path}.temperature: at {dish.temperature:g} K {species.name} boils, its vapour pressure is "
                f"{pressure / 1e3:.4g} kPa; must be below {PRESSURE / 1e3:g} kPa"
            )
        if dish.cooling and species.latent_heat is None:
            yield f"{where}.species: missing key 'latent_heat'; without it, set {path}.cooling: false"


class OneGas(Model):
    """What every gas of one species has."""

    sources_key: ClassVar[str] = "sources"
    """Where a scenario lists what the robots search for."""
    on_grid: ClassVar[bool] = False
    """Whether the wind has to be known on the grid, to carry it."""
    weighs: ClassVar[bool] = False
    """Whether its weight can act on the air."""
    solved: ClassVar[bool] = False
    """Whether it is computed from step to step, which takes time; else it is known beforehand."""
    species: AnySpecies = "ethanol"
    """Which gas it is, by its name or by the figures of another one. It decides what a kg is in ppm, how it diffuses,
    and whether it sinks or rises."""

    @property
    def vapour(self) -> Species:
        """The species."""
        if isinstance(self.species, str):
            return SPECIES[self.species]
        return Species(**self.species.model_dump())

    def begins_in(self, radius: float, domain: Domain) -> float | None:
        """Area across the wind [m²] that what a source of that radius [m] emits goes through at first, if known."""
        return None

    @property
    def finest(self) -> float | None:
        """Distance [m] of points on a line whose mean tells its integral to a percent; None: that of cells."""
        return None

    def bytes(self, dim: int) -> float:
        """What it needs of memory besides fields on the grid."""
        return 0.0

    def alone(self, where: str) -> tuple[tuple[str, Self], ...]:
        """Every gas of one species in it, with its path: itself."""
        return ((where, self),)

    def replaced(self, where: str, others: Mapping[str, Any]) -> Any:
        """With other gases in place of those of some paths."""
        return others.get(where, self)
