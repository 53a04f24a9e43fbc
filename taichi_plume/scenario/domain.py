"""The simulated box, the rectangle of floor for the robots (arena), positions in the box, and the context of checks."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from taichi_plume.grid.shapes import Shape
from taichi_plume.quantities import fault
from taichi_plume.scenario import si
from taichi_plume.scenario.vocabulary import SHAPE, Model

if TYPE_CHECKING:
    from taichi_plume.scenario.scenario import Scenario

ROUNDING = 0.1  # of an extent: a larger change by whole cells makes another domain than the user wrote


@dataclass(frozen=True)
class Context:
    """Data that every check of a section needs: the scenario, and the shapes of its obstacles by their paths."""

    scenario: "Scenario"
    shapes: Mapping[str, Shape]

    @property
    def domain(self) -> "Domain":
        """The simulated box of the scenario."""
        return self.scenario.domain

    def outside(self, points: np.ndarray) -> str | None:
        """Return a message about the first of points (n, dim) [m] outside the domain; None if all are inside."""
        for axis, length, along in zip("xyz", self.domain.extent, points.T, strict=False):
            beyond = along[(along < 0) | (along > length)]
            if len(beyond):
                return f"{axis} = {beyond[0]:g} m is outside the domain, {span(axis, 0, length)}"
        return None


def span(axis: str, low: float, high: float) -> str:
    """Return a range of coordinates as text, such as "x 0 to 4 m"."""
    return f"{axis} {low:.4g} to {high:.4g} m"


def starts_late(where: str, start: float, context: Context) -> Iterator[str]:
    """Yield an error if the time `start` [s] of a recording, whose path is `where`, is after the end of the run."""
    end = context.scenario.duration
    if start > end:
        yield f"{where}.start: {start:g} s is after the end of the run at {end:g} s; start it earlier"


class Domain(Model):
    """The box that is simulated, with its lower corner at the origin."""

    size: Annotated[tuple[si.Length, ...], Field(min_length=2, max_length=3), SHAPE]
    """Lengths of the room along x and y, and in 3-D along z. Two numbers make a 2-D run, seen from above; three a 3-D
    one."""
    spacing: Annotated[si.Length, SHAPE]
    """Edge of the square or cubic cells of the grid. Half of it shows finer eddies and smaller objects, and takes
    about 8 times as long in 2-D and 16 times in 3-D. The size is rounded to whole cells."""
    depth: Annotated[si.Length, SHAPE] = 1.0
    """Thickness of the layer of air that a 2-D run stands for. It decides how many ppm a source of so many mg/s
    makes: twice the depth halves them. Without effect in 3-D."""

    @property
    def dim(self) -> int:
        """Number of dimensions of the run: 2 or 3."""
        return len(self.size)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of grid cells along each axis."""
        return tuple(max(1, round(extent / self.spacing)) for extent in self.size)

    @property
    def extent(self) -> tuple[float, ...]:
        """Length of the domain along each axis [m], rounded to whole grid cells."""
        return tuple(n * self.spacing for n in self.shape)

    @property
    def box(self) -> str:
        """Extent of the floor as text, such as "x 0 to 4 m, y 0 to 3 m"."""
        return f"{span('x', 0, self.extent[0])}, {span('y', 0, self.extent[1])}"

    def rounded(self, where: str) -> Iterator[str]:
        """Yield an error for each axis with fewer than 2 cells, or that rounding to cells changes by over 10 %."""
        for axis, (extent, n) in enumerate(zip(self.size, self.shape, strict=True)):
            if n < 2:
                advice = "; two numbers in domain.size make a 2-D run" if axis == 2 else ""
                yield (
                    f"{where}.size[{axis}]: {extent:g} m is fewer than two cells of {self.spacing:g} m; "
                    f"lower domain.spacing to {extent / 4:.3g} m or less{advice}"
                )
            elif abs(n * self.spacing - extent) > ROUNDING * extent:
                yield (
                    f"{where}.size[{axis}]: {extent:g} m in cells of {self.spacing:g} m becomes "
                    f"{n * self.spacing:g} m; choose a spacing that divides it, such as {extent / n:.4g} m"
                )


class Arena(Model):
    """Part of the floor that the robots do not leave: its edges stop them as walls do, air passes them."""

    low: Annotated[si.Point2, SHAPE]
    """Lower corner of the part of the floor, x and y."""
    high: Annotated[si.Point2, SHAPE]
    """Upper corner of the part of the floor, x and y."""

    @property
    def size(self) -> tuple[float, float]:
        """Edge lengths of the rectangle along x and y [m]."""
        return self.high[0] - self.low[0], self.high[1] - self.low[1]

    def fault(self, extent: tuple[float, ...]) -> str | None:
        """Return an error if the arena does not lie within a floor of this extent [m]; None if it does."""
        for axis, low, high, length in zip("xy", self.low, self.high, extent, strict=False):
            if not 0 <= low < high <= length + 1e-9:
                return (
                    f"along {axis} low must be below high, both on the floor from 0 to {length:g} m, "
                    f"got {low:g} and {high:g} m"
                )
        return None

    def errors(self, where: str, context: Context) -> Iterator[str]:
        fault = self.fault(context.domain.extent)
        if fault:
            yield f"{where}: {fault}"


class Located(Model):
    """A section with a position in the air."""

    what: ClassVar[str] = "source"
    """Noun for the section in messages."""
    position: si.Point
    """Position of the middle, per axis. It has to be in the air: in the room and outside of all obstacles."""

    @model_validator(mode="before")
    @classmethod
    def _moves(cls, data: object) -> object:
        """Raise an error for a motion of what stays in place, such as the source of a steady plume."""
        if isinstance(data, dict) and "motion" in data and "motion" not in cls.model_fields:
            raise fault(
                f"motion: the {cls.what} stays in place here; sources of eulerian gas and of puffs can move"
            )
        return data

    @property
    def on(self) -> tuple[float, float]:
        """Times [s] from which and until which the source is there; infinite without limit."""
        keys = vars(self)
        start, stop = (
            keys.get("start", keys.get("time")),
            keys.get("stop"),
        )  # a puff has the time of its release
        return -np.inf if start is None else start, np.inf if stop is None else stop

    @property
    def mean_rate(self) -> float:
        """Mean emission while the source is there [kg/s]; NaN if unknown, as of dishes, puffs and given plumes."""
        keys = vars(self)
        rate, puffing = keys.get("rate"), keys.get("puffing")
        if not rate:
            return np.nan
        return rate if puffing is None else rate * puffing.pulse / (puffing.pulse + puffing.pause)

    def places(self, t: float | np.ndarray) -> np.ndarray:
        """Return the positions (..., dim) [m] at times t (...) [s]."""
        return np.broadcast_to(self.position, (*np.shape(t), len(self.position)))

    def errors(self, where: str, context: Context) -> Iterator[str]:
        position = np.array([self.position])
        radius, longest = vars(self).get("radius", 0.0), max(context.domain.extent)
        if outside := context.outside(position):
            yield f"{where}.position: {outside}; move the {self.what} in"
        elif radius > longest:
            yield f"{where}.radius: {radius:g} m is larger than the domain, {longest:g} m; make it smaller"
        else:
            place = ", ".join(f"{x:g}" for x in self.position)
            for obstacle, shape in context.shapes.items():
                if shape.inside(position)[0]:
                    depth = -float(shape.signed_distance(position)[0])
                    yield (
                        f"{where}.position: ({place}) m is inside {obstacle} ({shape.model.kind}), "
                        f"{depth:.3g} m below its surface; move the {self.what} or the obstacle"
                    )
                    return
