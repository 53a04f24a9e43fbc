"""Species, sources and evaporation dishes of gas in a scenario, and the base class of gases of one species."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import BeforeValidator, field_validator, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.quantities import fault, parse
from taichi_plume.scenario import si
from taichi_plume.scenario.changes import shown
from taichi_plume.scenario.domain import Context, Domain, Located
from taichi_plume.scenario.gas_amounts import converted
from taichi_plume.scenario.motion import SourceMotion
from taichi_plume.scenario.species import PRESSURE, SPECIES, TEMPERATURE, Species, SpeciesName
from taichi_plume.scenario.suggestions import hint
from taichi_plume.scenario.vocabulary import Model, exactly_one, stop_after_start


class OtherSpecies(Model):
    """A vapour that is not in the table of species."""

    name: str = "gas"
    """Name of the vapour in files of the run and in keys of sensors."""
    molar_mass: si.MolarMass
    """Mass of a mole. It turns kg/m³ into ppm, and vapours above 0.029 kg/mol are heavier than air."""
    diffusivity: si.Diffusivity
    """Diffusivity of its molecules in still air, about 1e-5 m²/s for vapours."""
    vapour_pressure: si.Pressure | None = None
    """Pressure over the liquid at the temperature of its dish; for sources that are dishes."""
    latent_heat: si.LatentHeat | None = None
    """Latent heat of evaporation; for dishes that cool."""

    @field_validator("name")
    @classmethod
    def _has_no_slash(cls, name: str) -> str:
        """Return the name, or raise an error: in zarr, NetCDF and HDF5 files a slash in it would start a group."""
        if "/" in name or "\\" in name:
            raise fault(f"got '{name}': must be without '/' and '\\', as it names variables in files")
        return name


def _known(value: object) -> object:
    """Return `value` if it is the name of a known species or the data of another one; otherwise raise an error."""
    if value in (None, *SPECIES) or isinstance(value, dict | OtherSpecies):
        return value
    meant = hint(value, SPECIES) if isinstance(value, str) else ""
    other = "any other needs {molar_mass: ..., diffusivity: ...}"
    raise fault(f"got {shown(value)}; {meant}allowed: {', '.join(SPECIES)}; {other}")


def _molar_mass(species: object) -> float | None:
    """Return the molar mass [kg/mol] of a species as in YAML or as a section; None if it is not valid."""
    if isinstance(species, str):
        return SPECIES[species].molar_mass if species in SPECIES else None
    given = species.get("molar_mass") if isinstance(species, dict) else getattr(species, "molar_mass", None)
    try:
        return parse(given, "kg/mol")
    except PydanticCustomError:
        return None


AnySpecies = Annotated[SpeciesName | OtherSpecies, BeforeValidator(_known)]


class Puffing(Model):
    """A source that switches on and off; each duration is drawn at random."""

    pulse: si.Duration
    """Mean time for which the source is on."""
    pause: si.Duration
    """Mean time for which it is off between two emissions."""
    spread: si.Fraction = 0.5
    """Irregularity: each duration is drawn uniformly from mean·(1 ± spread). 0 is strictly periodic."""

    @property
    def by_chance(self) -> bool:
        return self.spread > 0


class Dish(Model):
    """A flat, open dish of liquid, whose evaporation depends on the wind; see solvers/evaporation.py."""

    diameter: si.Length
    """Diameter of the open surface of liquid. The evaporation grows with it, slightly less than the area."""
    temperature: si.Temperature = TEMPERATURE
    """Temperature of the air and, unless evaporation cools it, of the liquid. Warmer evaporates more."""
    cooling: bool = True
    """Whether evaporation cools the liquid, so that less evaporates; otherwise its temperature is constant."""
    air_speed: si.Speed | None = None
    """Speed of the air over the dish. Unless given, of the wind half a diameter above the source (in 2-D: there)."""


class Source(Located):
    """A ball (in 2-D a disc) that emits evenly over its volume, with a given rate or the evaporation of a dish."""

    rate: si.Rate | None = None
    """Mass that it emits per time while it is on, also as 500 sccm, 2 L/min or 3 mmol/h. Give either this or a `dish`.
    Standard volumes (sccm, slpm, NL/min) are at 0 °C and 1 atm, plain volumes at 25 °C and 1 atm. The molar mass of the
    gas's species makes them kg/s."""
    dish: Dish | None = None
    """An open dish of liquid instead of a rate, whose evaporation depends on the wind."""
    radius: si.Length = 0.05
    """Radius of the ball (in 2-D the disc) that emits evenly over its volume. On a grid the gas has a standard
    deviation of at least 0.9 cells, that of a ball with a radius of two cells. With a dish, it is half of the diameter;
    only the vapour of a dish smaller than a cell may be spread over up to a cell."""
    start: si.Time | None = None
    """First moment of emission; unless given, the start of the warm-up."""
    stop: si.Time | None = None
    """Last moment of emission; unless given, the end of the run."""
    puffing: Puffing | None = None
    """Switches the source on and off; unless given, it emits evenly."""
    motion: SourceMotion | None = None
    """Motion of the source along a path; unless given, it stays at its position."""

    _rate_or_dish = exactly_one("rate", "dish")
    _order = stop_after_start()

    @model_validator(mode="after")
    def _radius_of_dish(self) -> "Source":
        if self.dish is not None and "radius" not in self.model_fields_set:
            vars(self)["radius"] = 0.5 * self.dish.diameter
        return self

    def errors(self, where: str, context: Context) -> Iterator[str]:
        lines = list(super().errors(where, context))
        if self.motion is not None and not lines:
            lines += self.motion.point_errors(where, self.position, context)
            lines += [] if lines else self.way_errors(where, context)
        yield from lines
        half = 0.5 * self.dish.diameter if self.dish else self.radius
        spreads = half < self.radius <= context.domain.spacing * (1 + 1e-6)
        if self.dish and abs(self.radius - half) > 0.01 * half and not spreads:
            yield (
                f"{where}: radius = {self.radius:g} m is not half of dish.diameter = {self.dish.diameter:g} m; remove "
                f"radius, or use {half:g} m"
            )

    def way_errors(self, where: str, context: Context) -> Iterator[str]:
        """Yield an error of a path that is too fast or leads through an obstacle."""
        if self.motion is not None:
            yield from self.motion.segment_errors(where, self.position, context)

    def places(self, t: float | np.ndarray) -> np.ndarray:
        return super().places(t) if self.motion is None else self.motion.places(self.position, t)

    def require_air(self, where: str, apart: float, in_air: Callable[[np.ndarray], np.ndarray]) -> None:
        """Raise ValueError if the path of the source leads through cells without air.

        where: path of the source; apart: distance of samples [m]; in_air: function from points (n, dim) [m] to a mask.
        """
        if self.motion is None:
            return
        t, places = self.motion.samples(self.position, apart)
        solid = np.flatnonzero(~in_air(places))
        if len(solid):
            place = ", ".join(f"{x:.4g}" for x in places[solid[0]])
            raise ValueError(
                f"{where}.motion.path: at {t[solid[0]]:.4g} s ({place}) m is not in the air; lead the path around "
                "obstacles, or lower domain.spacing"
            )

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        if self.rate == 0:
            yield f"{where}.rate: 0 kg/s: it emits nothing"
        yield from never_emits(where, self.start, self.stop, context)


class Target(Source):
    """A source of a given plume, for which robots search; it emits nothing."""

    rate: si.Rate = 0.0
    """Rate without effect: the plume is given, and robots search for this position."""

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        yield from ()


class PlayedSource(Source):
    """A source of a recorded gas, for which robots search; the record has the gas."""

    def way_errors(self, where: str, context: Context) -> Iterator[str]:
        yield from ()  # a film in a loop takes its source from the end of the path to the start


def never_emits(where: str, start: float | None, stop: float | None, context: Context) -> Iterator[str]:
    """Yield warnings of a source that starts after the end of the run, or stops before its start [s]."""
    scenario, first = context.scenario, 0.0 - context.scenario.warm_up
    if start is not None and start >= scenario.duration:
        yield f"{where}.start: {start:g} s is not before the end at {scenario.duration:g} s: it emits nothing"
    if stop is not None and stop <= first:
        yield f"{where}.stop: {stop:g} s is before the start at {first:g} s: it emits nothing"


def dishes(where: str, species: Species, sources: Sequence[Source]) -> Iterator[str]:
    """Yield errors of evaporating sources whose species is no liquid, boils or lacks data; where: path of the gas."""
    for n, source in enumerate(sources):
        dish = source.dish
        if dish is None:
            continue
        path = f"{where}.sources[{n}].dish"
        if species.antoine is None and species.vapour_pressure is None:
            if species.name in SPECIES:
                yield f"{path}: {species.name} is no liquid; give the source a rate instead"
                continue
            yield f"{where}.species: missing key 'vapour_pressure', at the temperature of {path}"
        elif species.saturation(dish.temperature, dish.temperature) >= PRESSURE:
            pressure = species.saturation(dish.temperature, dish.temperature)
            yield (
                f"{path}.temperature: at {dish.temperature:g} K {species.name} boils, with a vapour pressure of "
                f"{pressure / 1e3:.4g} kPa; must be below {PRESSURE / 1e3:g} kPa"
            )
        if dish.cooling and species.latent_heat is None:
            yield f"{where}.species: missing key 'latent_heat'; without it, set {path}.cooling: false"


class OneGas(Model):
    """Base class of the gases of one species."""

    sources_key: ClassVar[str] = "sources"
    """Key of the sources that the robots search for."""
    on_grid: ClassVar[bool] = False
    """Whether the gas needs a wind on the grid, which carries it."""
    weighs: ClassVar[bool] = False
    """Whether the weight of the gas can act on the air."""
    solved: ClassVar[bool] = False
    """Whether a solver advances the gas, which takes time; otherwise it is known in advance."""
    species: AnySpecies = "ethanol"
    """Species of the gas, by name or by the data of another one. It decides the ppm of a kg, the diffusion, and whether
    the gas sinks or rises."""
    background: si.Concentration = 0.0
    """Concentration of the species in clean air, the same everywhere and always, such as 420 ppm of carbon dioxide.
    Gas sensors and probes measure the sum of background and sources. Robots know the background, as a sensor is zeroed
    in clean air: their thresholds, and gas maps and fields, count from the background on. Weight, uptake by surfaces
    and the keys `inflow` and `initial` concern the gas above the background alone. Gases of one species share one
    background."""

    searched: bool = True
    """Whether robots search for the sources of the gas. With false the gas distracts: its sources count nowhere as
    found, reached or rightly declared, but sensors respond to it."""

    @model_validator(mode="before")
    @classmethod
    def _amounts(cls, data: object) -> object:
        """Return the gas's keys with volumes and moles of its sources, such as "500 sccm", as kg/s and kg."""
        if not isinstance(data, dict) or cls.sources_key not in data:
            return data
        molar_mass = _molar_mass(data.get("species", cls.model_fields["species"].default))
        if molar_mass is None:
            return data
        return data | {cls.sources_key: converted(data[cls.sources_key], molar_mass)}

    @property
    def vapour(self) -> Species:
        """Properties of the species of the gas."""
        if isinstance(self.species, str):
            return SPECIES[self.species]
        return Species(**self.species.model_dump())

    def begins_in(self, radius: float, domain: Domain) -> float | None:
        """Return the plume's cross-section [m²] at a source of this radius [m]; None if unknown."""
        return None

    finest: ClassVar[float | None] = None
    """Distance [m] of sample points for line integrals to a percent; None: the spacing of cells."""

    def bytes(self, dim: int) -> float:
        """Return the memory [bytes] that the gas needs besides fields on the grid, in a `dim`-dimensional run."""
        return 0.0

    def alone(self, where: str) -> tuple[tuple[str, Self], ...]:
        """Return (path, gas) of each gas of one species: here only the gas itself, whose path is `where`."""
        return ((where, self),)

    def replaced(self, where: str, others: "Mapping[str, OneGas]") -> "OneGas":
        """Return the gas that `others` has for the path `where` of this gas; by default this gas."""
        return others.get(where, self)
