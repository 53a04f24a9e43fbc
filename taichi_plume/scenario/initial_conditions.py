"""Initial conditions of wind, gas and temperature: formulas of the position, or a frame of a recorded run (film)."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.formulas import AXES, FormulaError, evaluate, formula
from taichi_plume.scenario.species import Species
from taichi_plume.scenario.vocabulary import PER_AXIS, FileName, Model, consistency_check

if TYPE_CHECKING:
    from taichi_plume.scenario.domain import Domain

FASTEST, COLDEST, WARMEST = 100.0, 200.0, 500.0  # limits as in si.Speed and si.Temperature


Units = dict[str, np.ndarray]
NO_UNITS: Units = {}


def units_of(species: Species) -> Units:
    """Return the size [kg/m³] of units such as ppm that formulas of this species' concentration may contain."""
    return {"ppm": np.array(1.0 / species.ppm_per_density)}


class Initial(Model):
    """Initial condition of a quantity at the start of the warm-up."""

    unit: ClassVar[str]
    least: ClassVar[float]
    most: ClassVar[float]

    key: ClassVar[str]
    """Key of the formula or formulas."""

    @property
    def formulas(self) -> tuple[tuple[str, str], ...]:
        """Key and text of each formula: one per axis for a vector; none if a recorded film gives the values."""
        given = vars(self)[self.key]
        if isinstance(given, tuple):
            return tuple((f"{self.key}[{d}]", text) for d, text in enumerate(given))
        return () if given is None else ((self.key, given),)

    def values(self, points: np.ndarray, units: Units = NO_UNITS) -> np.ndarray:
        """Return the values of all formulas (formulas, ...) at points (..., dim) [m]; nan or inf if undefined."""
        places = dict(zip(AXES, np.moveaxis(points, -1, 0), strict=False)) | units
        arrays = [evaluate(text, places) for _, text in self.formulas]
        return np.array([np.broadcast_to(values, points.shape[:-1]) for values in arrays])

    def on_grid(
        self, domain: "Domain", units: Units = NO_UNITS
    ) -> Iterator[tuple[str, list[np.ndarray], np.ndarray]]:
        """Yield the key, coordinates and values of each formula on the grid. Raises FormulaError."""
        for d, (key, text) in enumerate(self.formulas):
            places = self._places(domain, d)
            values = evaluate(text, dict(zip(AXES, places, strict=False)) | units)
            yield key, places, np.broadcast_to(values, np.broadcast_shapes(*(axis.shape for axis in places)))

    def _units(self, where: str, context: Context) -> Units:
        """Return the sizes of units such as ppm that the formulas may contain, by name; where: path of the section."""
        return NO_UNITS

    def _places(self, domain: "Domain", d: int) -> list[np.ndarray]:
        """Return the coordinates [m] of the cell centres along each axis, shaped for broadcasting."""
        return _lattice([(np.arange(n) + 0.5) * domain.spacing for n in domain.shape])

    def errors(self, where: str, context: Context) -> Iterator[str]:
        try:
            for key, places, values in self.on_grid(context.domain, self._units(where, context)):
                bad = ~((values >= self.least) & (values <= self.most))
                if bad.any() and (line := _first(bad, places, values, context)) is not None:
                    yield (
                        f"{where}.{key}: {line} {self.unit}; must be {self.least:g} to {self.most:g} {self.unit} "
                        "wherever there is air"
                    )
        except FormulaError as error:
            yield f"{where}: {error}"


class FilmedInitial(Initial):
    """Initial condition that a film may give as well."""

    part: ClassVar[Literal["wind", "gas"]]
    film: FileName | None = None
    """Path of a fields.zarr with the initial state, instead of a formula; its grid may differ."""
    at: si.Time | None = None
    """Time in the film, with linear interpolation between frames; unless given, the last frame."""

    @consistency_check
    def _either(self) -> Iterator[str]:
        given = [key for key, _ in self.formulas][:1]
        if (self.film is None) == (not given):
            yield f"takes {self.key} or film, got {'both' if given else 'neither'}"
        if self.film is None and self.at is not None:
            yield "at: is a time of a film; remove it, or give a film"


class InitialWind(FilmedInitial):
    """Velocity of the air; the solver makes it free of divergence."""

    part, key, unit = "wind", "velocity", "m/s"
    least, most = -FASTEST, FASTEST
    velocity: Annotated[tuple[formula("m/s"), ...] | None, Field(min_length=2, max_length=3), PER_AXIS] = None  # type: ignore[valid-type]
    """Components per axis, each a number or a formula of x, y and z. Such as "0.2*sin(pi*x)"; the solver makes the
    whole free of divergence."""

    def _places(self, domain: "Domain", d: int) -> list[np.ndarray]:
        """Return the coordinates [m] of the cell faces normal to axis d, along each axis, shaped for broadcasting."""
        shape = [n + (a == d) for a, n in enumerate(domain.shape)]
        return _lattice([(np.arange(n) + 0.5 * (a != d)) * domain.spacing for a, n in enumerate(shape)])

    def top_speed(self, domain: "Domain") -> float:
        """Return the largest magnitude [m/s] of a velocity component that the formulas give on the grid."""
        try:
            arrays = [np.abs(values) for _, _, values in self.on_grid(domain)]
        except FormulaError:
            return 0.0
        return max((float(values[np.isfinite(values)].max(initial=0.0)) for values in arrays), default=0.0)


class InitialGas(FilmedInitial):
    """Concentration of the gas."""

    part, key, unit = "gas", "concentration", "kg/m^3"
    least, most = 0.0, 10.0  # heavier than any vapour
    concentration: formula("kg/m^3", ppm=1e6) | None = None  # type: ignore[valid-type]
    """A number or a formula of x, y and z, such as "420 ppm" or "1e-5*exp(-((x-1)**2 + (y-1)**2)/0.02)". In a formula
    ppm is the density of one, so that "420*ppm + 1e-5*x" adds both."""

    def _units(self, where: str, context: Context) -> Units:
        """Return the size [kg/m³] of one ppm of the gas to which this section belongs, by the name "ppm"."""
        return units_of(dict(context.scenario.gases)[where.removesuffix(".initial")].vapour)


class InitialHeat(Initial):
    """Temperature of the air."""

    key, unit, least, most = "temperature", "K", COLDEST, WARMEST
    temperature: formula("K")  # type: ignore[valid-type]
    """A number or a formula of x, y and z, such as "295 + 2*z" for air that is warmer above."""


def _lattice(axes: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the coordinates of each axis, shaped so that they broadcast to a grid."""
    return [axis.reshape([-1 if a == b else 1 for b in range(len(axes))]) for a, axis in enumerate(axes)]


def _first(bad: np.ndarray, places: list[np.ndarray], values: np.ndarray, context: Context) -> str | None:
    """Return the value and position, in words, of the first bad grid point outside all standing obstacles, or None."""
    where = np.argwhere(bad)
    points = np.stack([axis.ravel()[where[:, a]] for a, axis in enumerate(places)], axis=-1)
    free = np.ones(len(points), bool)
    for shape in context.shapes.values():
        if shape.model.motion is None:
            free &= ~shape.inside(points)
    if not free.any():
        return None
    n = int(np.argmax(free))
    place = ", ".join(f"{x:.4g}" for x in points[n])
    return f"at ({place}) m it is {values[tuple(where[n])]:.4g}"
