"""Gases with closed-form solutions: Gaussian puffs and plumes in a uniform wind."""

from collections.abc import Iterator
from math import pi, sqrt
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, Domain, Located
from taichi_plume.scenario.sources import OneGas
from taichi_plume.scenario.vocabulary import Face, exactly_one, stop_after_start
from taichi_plume.scenario.winds import UniformWind

PARALLEL = 1e-9  # fraction of the wind through a wall that counts as zero


class ClosedForm(OneGas):
    """A gas with a closed-form solution: in a uniform wind, without obstacles, reflected by walls."""

    swept: ClassVar[bool] = False
    """Whether gusts carry the gas along as a whole; they may move the centre line of a plume to and fro."""
    walls: tuple[Face, ...] | None = None
    """Faces of the room that reflect the gas. Unless given the ground, z-, in 3-D and none in 2-D: gas leaves through
    the others."""

    jumps: ClassVar[bool] = False
    """Whether the concentration jumps at the source: none upwind, the peak just downwind."""

    @property
    def finest(self) -> float:
        least = min(source.radius for source in self.sources)
        return least / 16.0 if self.jumps else least

    def reflecting(self, dim: int) -> tuple[Face, ...]:
        """Return the faces of the domain that reflect the gas: `walls` or, by default, in 3-D the floor ("z-")."""
        return (("z-",) if dim == 3 else ()) if self.walls is None else self.walls

    def begins_in(self, radius: float, domain: Domain) -> float:
        """Return the effective cross-section [m²] of a Gaussian plume of this standard deviation [m] at its source."""
        return sqrt(2.0 * pi) * radius * domain.depth if domain.dim == 2 else 2.0 * pi * radius**2

    def errors(self, where: str, context: Context) -> Iterator[str]:
        wind = context.scenario.wind
        if wind.uniform is None:
            yield (
                f"{where}.kind: {vars(self)['kind']} takes a uniform wind, but wind.kind is {wind.kind}; "
                f"use wind.kind: uniform, or {where}.kind: eulerian"
            )
        else:
            yield from self.in_wind(where, wind.uniform, context)

    def in_wind(self, where: str, wind: UniformWind, context: Context) -> Iterator[str]:
        """Yield errors of this gas in a uniform wind, which must not blow through a reflecting face of the domain."""
        dim = context.domain.dim
        for face in self.reflecting(dim):
            d = "xyz".index(face[0])
            default = " (the default of walls)" if self.walls is None else ""
            if abs(wind.velocity[d]) > PARALLEL * wind.speed:
                yield (
                    f"{where}.walls: the wind blows through {face}{default} with {wind.velocity[d]:g} m/s; "
                    f"take {face} out of walls or turn the wind"
                )
            elif wind.gusts is not None and self.swept:
                deviations = np.array(wind.gusts.deviations(dim)) @ np.abs(wind.frame[1:])
                if deviations[d] > PARALLEL:
                    yield (
                        f"{where}.walls: gusts blow through {face}{default}; take {face} out of walls, or set this "
                        "component of wind.gusts to 0"
                    )


class Release(Located):
    """A puff, at first a Gaussian of standard deviation `radius`."""

    mass: si.Mass
    """Mass of gas in the puff; a volume (mL at 25 °C and 1 atm, scc at 0 °C) or moles become kg by the species."""
    time: si.Time = 0.0
    """Time of the release; the robots start at 0."""
    radius: si.Length = 0.05
    """Size of the new puff, as standard deviation."""

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        if self.time >= context.scenario.duration:
            yield f"{where}.time: {self.time:g} s is not before the end at {context.scenario.duration:g} s"


class GaussianPuffGas(ClosedForm):
    """Single puffs that drift with a uniform wind and spread: one Gaussian each."""

    swept: ClassVar[bool] = True
    kind: Literal["gaussian_puff"]
    sources_key: ClassVar[str] = "releases"
    releases: Annotated[tuple[Release, ...], Field(min_length=1)]
    """The puffs, each with position, time and mass; robots search for these positions."""
    diffusivity: si.Diffusivities | None = None
    """Diffusivity of the puffs: one number for all axes or one per axis. Unless given, the species' in still air."""

    @property
    def sources(self) -> tuple[Release, ...]:
        """The releases of puffs: the positions that robots search for."""
        return self.releases

    def in_wind(self, where: str, wind: UniformWind, context: Context) -> Iterator[str]:
        yield from super().in_wind(where, wind, context)
        yield from _numbers(f"{where}.diffusivity", self.diffusivity, context.domain.dim, "")
        begin = context.scenario.first_tick * context.scenario.tick
        for n, release in enumerate(self.releases):
            if wind.gusts is not None and release.time < begin:
                yield (
                    f"{where}.releases[{n}].time: {release.time:g} s is before the start of the gusts at {begin:g} s; "
                    "release it later or raise warm_up"
                )


class PlumeSource(Located):
    """A steady source: at its position a Gaussian of standard deviation `radius`."""

    rate: si.Rate
    """Mass that it emits per time, also as 500 sccm (0 °C and 1 atm), 2 L/min (25 °C and 1 atm) or 3 mmol/h."""
    radius: si.Length = 0.05
    """Size of the plume at the source, as standard deviation."""


class ContinuousSource(PlumeSource):
    """A source that emits evenly from `start` to `stop`; by default for ever."""

    start: si.Time | None = None
    """Time when the emission starts; unless given, it has lasted for ever."""
    stop: si.Time | None = None
    """Time when the emission ends; unless given, never."""

    _order = stop_after_start()


class ContinuousGas(ClosedForm):
    """Exact plume of steady or switched sources in a uniform wind, with a constant diffusivity in all directions."""

    kind: Literal["continuous"]
    sources: Annotated[tuple[ContinuousSource, ...], Field(min_length=1)]
    """Where gas is emitted evenly, at least one place; robots search for these."""
    diffusivity: si.Diffusivities | None = None
    """Diffusivity of the plume: one number for all axes or one per axis. Unless given, the species' in still air.
    """

    def in_wind(self, where: str, wind: UniformWind, context: Context) -> Iterator[str]:
        if wind.gusts is not None:
            yield f"{where}.kind: continuous takes no wind.gusts; remove them, or use meandering or gaussian_puff"
        yield from super().in_wind(where, wind, context)
        yield from _numbers(f"{where}.diffusivity", self.diffusivity, context.domain.dim, "")
        if self.diffusivity is not None and not all(self.diffusivity):
            yield f"{where}.diffusivity: must be above 0; a plume of no width is kind: gaussian_plume"
        for n, source in enumerate(self.sources):
            if source.start is None and not wind.speed:
                start = -context.scenario.warm_up
                yield f"{where}.sources[{n}].start: must be given in still air, such as {start:g} s"


class WindPlume(ClosedForm):
    """Base class of plumes that exist only in moving air."""

    jumps: ClassVar[bool] = True
    sources: Annotated[tuple[PlumeSource, ...], Field(min_length=1)]
    """Where gas is emitted evenly, at least one place; robots search for these."""

    def in_wind(self, where: str, wind: UniformWind, context: Context) -> Iterator[str]:
        if wind.speed:
            yield from super().in_wind(where, wind, context)
        else:
            yield f"wind.velocity: is 0, but {where}.kind: {vars(self)['kind']} is a plume; give it a speed"


class GaussianPlumeGas(WindPlume):
    """The mean Gaussian plume of textbooks, which widens with the distance in a uniform wind."""

    kind: Literal["gaussian_plume"]
    width_fluctuation: ClassVar[float] = 0.0
    intensity: si.Intensities | None = None
    """Widening with the distance x: standard deviation = radius + intensity x. One number, or two: horizontal and
    vertical. Turbulence makes about 0.05 to 0.15."""
    diffusivity: si.Diffusivities | None = None
    """Widening by diffusion, instead of `intensity`: variance = radius² + 2 diffusivity x/U. One number, or two:
    horizontal and vertical."""

    _one_law = exactly_one("intensity", "diffusivity")

    def in_wind(self, where: str, wind: UniformWind, context: Context) -> Iterator[str]:
        if wind.gusts is not None:
            yield (
                f"{where}.kind: gaussian_plume is a mean over gusts and does not follow them; remove wind.gusts, or "
                "use kind: meandering"
            )
        yield from super().in_wind(where, wind, context)
        across = context.domain.dim - 1
        yield from _numbers(f"{where}.intensity", self.intensity, across, " across the wind")
        yield from _numbers(f"{where}.diffusivity", self.diffusivity, across, " across the wind")

    def growth(self, axes: int, speed: float) -> np.ndarray:
        """Return b, c, d (axes, 3) of the variance radius² + (b radius + c) x + d x² at a distance x downwind."""
        zero = np.zeros(axes)
        if self.intensity is not None:  # (radius + intensity x)²
            intensity = np.broadcast_to(self.intensity, axes)
            return np.stack([2.0 * intensity, zero, intensity**2], axis=1)
        assert self.diffusivity is not None
        return np.stack([zero, 2.0 * np.broadcast_to(self.diffusivity, axes) / speed, zero], axis=1)


class MeanderingGas(WindPlume):
    """A plume that gusts sweep to and fro: thin at every moment, wide in the mean.

    Across, Q/(U w h) exp(-(y - y_c)²/(2 s_y²)), w = sqrt(2 pi) s_y, h = sqrt(2 pi) s_z; s² = radius² + (slope x)².
    """

    kind: Literal["meandering"]
    width_slope: si.Intensity = 0.08
    """Growth of the horizontal standard deviation with the distance from the source."""
    height_slope: si.Intensity = 0.06
    """Growth of the vertical standard deviation with the distance from the source."""
    width_fluctuation: si.Intensity = 0.0
    """Variation of the width over time, as of the gusts: standard deviation of its logarithm."""

    @property
    def by_chance(self) -> bool:
        return self.width_fluctuation > 0

    def in_wind(self, where: str, wind: UniformWind, context: Context) -> Iterator[str]:
        if wind.gusts is None and wind.speed:
            yield f"wind.gusts: must be given for {where}.kind: meandering, such as gusts: {{intensity: 0.15}}"
        yield from super().in_wind(where, wind, context)

    def growth(self, axes: int, speed: float) -> np.ndarray:
        """Return (axes, 3) coefficients 0, 0, slope² of the variance radius² + (slope x)² at a distance x downwind."""
        zero, slope = np.zeros(axes), np.array([self.width_slope, self.height_slope])[:axes]
        return np.stack([zero, zero, slope**2], axis=1)


def _numbers(path: str, given: tuple[float, ...] | None, most: int, where: str) -> Iterator[str]:
    """Yield an error if a list has neither one number nor `most` numbers. path, where: parts of the message."""
    if given is not None and len(given) not in (1, most):
        each = f", or one for each of the {most} axes{where}" if most > 1 else ""
        yield f"{path}: has {len(given)} numbers; give one{each}"
