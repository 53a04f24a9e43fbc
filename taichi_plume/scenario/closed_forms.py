"""Gases of a scenario that a formula tells: puffs and plumes in a uniform wind."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.scenario.sources import OneGas
from taichi_plume.scenario.vocabulary import (
    Diffusivities,
    Face,
    Intensities,
    Length,
    Mass,
    Model,
    NonNegative,
    Point,
    Rate,
    Time,
)


class ClosedForm(OneGas):
    """A gas that a formula tells at any place and time: in a uniform wind, without obstacles, reflected by walls."""

    walls: tuple[Face, ...] | None = None
    """Faces of the domain that let no gas through; unless given the ground, z-, in 3-D and none in 2-D."""

    def reflecting(self, dim: int) -> tuple[Face, ...]:
        """The faces that let no gas through, in `dim` dimensions."""
        return (("z-",) if dim == 3 else ()) if self.walls is None else self.walls


class Release(Model):
    """A puff, at first a Gaussian of standard deviation `radius`."""

    position: Point
    mass: Mass
    time: Time = 0.0
    """When it is released [s]; the robots start at 0."""
    radius: Length = 0.05


class GaussianPuffGas(ClosedForm):
    """Puffs that drift and spread: one Gaussian each."""

    kind: Literal["gaussian_puff"]
    sources_key: ClassVar[str] = "releases"
    releases: Annotated[tuple[Release, ...], Field(min_length=1)]
    diffusivity: Diffusivities | None = None
    """One for all axes or one per axis [m²/s]; unless given, the species' in still air."""

    @property
    def sources(self) -> tuple[Release, ...]:
        """What the robots search for."""
        return self.releases


class PlumeSource(Model):
    """A steady source, at its place a Gaussian of standard deviation `radius`."""

    position: Point
    rate: Rate
    """Mass per time [kg/s]."""
    radius: Length = 0.05


class ContinuousSource(PlumeSource):
    """A source that emits evenly from `start` to `stop`, from and for ever unless they are given."""

    start: Time | None = None
    stop: Time | None = None

    @model_validator(mode="after")
    def _ordered(self) -> "ContinuousSource":
        if self.start is not None and self.stop is not None and self.stop <= self.start:
            raise PydanticCustomError("source", "stop must be later than start")
        return self


class ContinuousGas(ClosedForm):
    """What steady sources emit drifts and spreads: the exact solution for constant diffusivities."""

    kind: Literal["continuous"]
    sources: Annotated[tuple[ContinuousSource, ...], Field(min_length=1)]
    diffusivity: Diffusivities | None = None
    """One for all axes or one per axis [m²/s]; unless given, the species' in still air."""


class GaussianPlumeGas(ClosedForm):
    """Mean plume: a Gaussian across the wind whose standard deviation grows with the distance x from the source."""

    kind: Literal["gaussian_plume"]
    width_fluctuation: ClassVar[float] = 0.0
    sources: Annotated[tuple[PlumeSource, ...], Field(min_length=1)]
    intensity: Intensities | None = None
    """sigma = radius + intensity x; one number, or two: horizontal and vertical. Of turbulence, about 0.05 to 0.15."""
    diffusivity: Diffusivities | None = None
    """sigma² = radius² + 2 diffusivity x/U [m²/s]; one number, or two: horizontal and vertical."""

    @model_validator(mode="after")
    def _one_law(self) -> "GaussianPlumeGas":
        if (self.intensity is None) == (self.diffusivity is None):
            raise PydanticCustomError(
                "spread", "takes either intensity or diffusivity, which widen the plume"
            )
        return self

    def growth(self, axes: int, speed: float) -> np.ndarray:
        """b, c and d of so many axes across a wind of that speed [m/s], (axes, 3): sigma² = radius² + (b radius + c) x
        + d x².
        """
        zero = np.zeros(axes)
        if self.intensity is not None:  # (radius + intensity x)²
            intensity = np.broadcast_to(self.intensity, axes)
            return np.stack([2.0 * intensity, zero, intensity**2], axis=1)
        assert self.diffusivity is not None
        return np.stack([zero, 2.0 * np.broadcast_to(self.diffusivity, axes) / speed, zero], axis=1)


class MeanderingGas(ClosedForm):
    """A plume that the gusts of the wind sweep to and fro: it is thin in every moment, and wide in the mean.

    Across, Q/(U w h) exp(-(y - y_c)²/(2 s_y²)), w = sqrt(2 pi) s_y, h = sqrt(2 pi) s_z; s² = radius² + (slope x)².
    """

    kind: Literal["meandering"]
    sources: Annotated[tuple[PlumeSource, ...], Field(min_length=1)]
    width_slope: NonNegative = 0.08
    """Growth of the horizontal standard deviation with the distance from the source."""
    height_slope: NonNegative = 0.06
    """Growth of the vertical one."""
    width_fluctuation: NonNegative = 0.0
    """Standard deviation of the logarithm of the width, which varies as the gusts do."""

    def growth(self, axes: int, speed: float) -> np.ndarray:
        """As of `GaussianPlumeGas.growth`."""
        zero, slope = np.zeros(axes), np.array([self.width_slope, self.height_slope])[:axes]
        return np.stack([zero, zero, slope**2], axis=1)
