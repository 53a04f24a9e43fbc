"""Probes: points at which a run records the air, without disturbing it."""

from collections.abc import Iterator
from math import prod
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, starts_late
from taichi_plume.scenario.vocabulary import PER_AXIS, Model

if TYPE_CHECKING:
    from taichi_plume.scenario.scenario import Scenario

MOST_POINTS = 100_000
MANY_BYTES = 2e9  # of probes.parquet: more causes a warning
BYTES_PER_NUMBER = 3.5  # measured: f32 of turbulent air, compressed
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]


class Probe(Model):
    """Base class of the probes: a point, or several in a fixed order."""

    what: ClassVar[tuple[str, ...]]
    """Keys of the position."""
    name: Name
    """Name of the probe in the table; each needs its own."""

    @property
    def places(self) -> np.ndarray:
        """Positions of the probe's points (n, dim) [m]."""
        raise NotImplementedError

    @property
    def size(self) -> int:
        """Number of points of the probe."""
        return 1

    def errors(self, where: str, context: Context) -> Iterator[str]:
        if self.size > MOST_POINTS:
            return  # reported for all probes together
        places, keys = self.places, " and ".join(self.what)
        if outside := context.outside(places):
            yield f"{where}.{keys}: {outside}; move the probe in"
            return
        for obstacle, shape in context.shapes.items():
            inside = np.flatnonzero(shape.inside(places) & (shape.model.motion is None))
            if len(inside):
                place = ", ".join(f"{x:g}" for x in places[inside[0]])
                yield f"{where}.{keys}: ({place}) m is inside {obstacle} ({shape.model.kind}); move one of them"
                return


class ProbePoint(Probe):
    """A single point, as one instrument."""

    kind: Literal["point"]
    what = ("at",)
    at: si.Point
    """Position of the point, per axis."""

    @property
    def places(self) -> np.ndarray:
        return np.array([self.at])


class ProbeLine(Probe):
    """Points at even distances, with both ends."""

    kind: Literal["line"]
    what = ("start", "end")
    start: si.Point
    """First point of the line, per axis."""
    end: si.Point
    """Last point of the line, per axis."""
    count: Annotated[si.Count, Field(ge=2)]
    """Number of points, both ends among them."""

    @property
    def size(self) -> int:
        return self.count

    @property
    def places(self) -> np.ndarray:
        return np.linspace(self.start, self.end, self.count)


class ProbeGrid(Probe):
    """Points on a lattice in a box, with its corners; the last axis changes first."""

    kind: Literal["grid"]
    what = ("low", "high")
    low: si.Point
    """Lower corner of the box, per axis."""
    high: si.Point
    """Upper corner of the box, per axis."""
    counts: Annotated[tuple[si.Count, ...], Field(min_length=2, max_length=3), PER_AXIS]
    """Points along each axis; a single one lies in the middle."""

    @property
    def size(self) -> int:
        return prod(self.counts)

    @property
    def places(self) -> np.ndarray:
        axes = [
            np.linspace(a, b, n) if n > 1 else np.array([(a + b) / 2])
            for a, b, n in zip(self.low, self.high, self.counts, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


class Probes(Model):
    """Content of probes.parquet: wind, pressure, gas and temperature at points, up to every step of the air."""

    points: Annotated[
        tuple[Annotated[ProbePoint | ProbeLine | ProbeGrid, Field(discriminator="kind")], ...],
        Field(min_length=1),
    ]
    """The points, lines and grids of points, each with a name."""
    every: Literal["step"] | si.Duration = 0.1
    """Time between samples, interpolated linearly between steps of the air; step: a sample after each step."""
    start: si.Time = 0.0
    """Time of the first sample; negative in the warm-up."""

    @property
    def size(self) -> int:
        """Number of points of all probes together."""
        return sum(probe.size for probe in self.points)

    def samples(self, scenario: "Scenario") -> float:
        """Return about how many times a run samples every point."""
        step = min(scenario.tick, scenario.wind.longest_step(scenario))
        return (scenario.duration - self.start) / (step if self.every == "step" else self.every)

    def bytes(self, scenario: "Scenario") -> float:
        """Return about the size [bytes] of the file probes.parquet of a run."""
        numbers = scenario.domain.dim + 1 + len(scenario.gases)
        return self.samples(scenario) * self.size * numbers * BYTES_PER_NUMBER

    def errors(self, where: str, context: Context) -> Iterator[str]:
        if self.size > MOST_POINTS:
            yield f"{where}.points: are {self.size:,} points, at most {MOST_POINTS:,} are taken; use fewer"
        first: dict[str, int] = {}
        for n, probe in enumerate(self.points):
            if (m := first.setdefault(probe.name, n)) != n:
                yield f"{where}.points[{n}].name: '{probe.name}' is the name of points[{m}] too; give each its own"
        yield from starts_late(where, self.start, context)

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        scenario = context.scenario
        step = min(scenario.tick, scenario.wind.longest_step(scenario))
        if self.every != "step" and self.every < 0.5 * step:
            yield (
                f"{where}.every: {self.every:g} s is shorter than the air's steps of about {step:.2g} s, between which "
                "samples are interpolated; lower tick for more"
            )
        size = self.bytes(scenario)
        if size > MANY_BYTES:
            yield f"{where}: probes.parquet will have about {size / 1e9:.2g} GB; use fewer points or a longer every"
