"""Points at which a run notes what the air does, as instruments that disturb nothing."""

from collections.abc import Iterator
from math import prod
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from taichi_plume.scenario.domain import Context, span
from taichi_plume.scenario.vocabulary import PER_AXIS, Count, Duration, Model, Point, Time

if TYPE_CHECKING:
    from taichi_plume.scenario.scenario import Scenario

MOST_POINTS = 100_000
MANY_BYTES = 2e9  # of probes.parquet, beyond which it is noted
BYTES_PER_NUMBER = 3.5  # measured: f32 of turbulent air, compressed
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]


class Probe(Model):
    """One point, or several in their order."""

    what: ClassVar[tuple[str, ...]]
    """The keys that say where."""
    name: Name
    """What the probe is called in the table; each needs its own."""

    @property
    def places(self) -> np.ndarray:
        """Of its points, (n, dim) [m]."""
        raise NotImplementedError

    @property
    def size(self) -> int:
        """Number of its points."""
        return 1

    def problems(self, where: str, context: Context) -> Iterator[str]:
        if self.size > MOST_POINTS:
            return  # all probes together are told
        places, extent = self.places, context.domain.extent
        keys = " and ".join(self.what)
        for axis, length in zip("xyz", extent, strict=False):
            along = places[:, "xyz".index(axis)]
            beyond = along[(along < 0) | (along > length)]
            if len(beyond):
                yield (
                    f"{where}.{keys}: {axis} = {beyond[0]:g} m is outside the domain, {span(axis, 0, length)}; "
                    "move the probe in"
                )
                return
        for obstacle, one in context.resources.shapes.items():
            inside = np.flatnonzero(one.inside(places) & (one.model.motion is None))
            if len(inside):
                place = ", ".join(f"{x:g}" for x in places[inside[0]])
                yield (
                    f"{where}.{keys}: ({place}) m is inside {obstacle} ({one.model.kind}); move the probe or the "
                    "obstacle"
                )
                return


class ProbePoint(Probe):
    """A single point, as one instrument."""

    kind: Literal["point"]
    what = ("at",)
    at: Point
    """Where the point is, per axis."""

    @property
    def places(self) -> np.ndarray:
        return np.array([self.at])


class ProbeLine(Probe):
    """Points at even distances, both ends among them."""

    kind: Literal["line"]
    what = ("start", "end")
    start: Point
    """First point of the line, per axis."""
    end: Point
    """Last point of the line, per axis."""
    count: Annotated[Count, Field(ge=2)]
    """Number of points, both ends among them."""

    @property
    def size(self) -> int:
        return self.count

    @property
    def places(self) -> np.ndarray:
        return np.linspace(self.start, self.end, self.count)


class ProbeGrid(Probe):
    """Points on a lattice that fills a box, its corners among them; the last axis changes first."""

    kind: Literal["grid"]
    what = ("low", "high")
    low: Point
    """Lower corner of the box, per axis."""
    high: Point
    """Upper corner of the box, per axis."""
    counts: Annotated[tuple[Count, ...], Field(min_length=2, max_length=3), PER_AXIS]
    """Points along each axis; a single one lies in the middle."""

    @property
    def size(self) -> int:
        return prod(self.counts)

    @property
    def places(self) -> np.ndarray:
        """In the order of an array of shape `counts`."""
        axes = [
            np.linspace(a, b, n) if n > 1 else np.array([(a + b) / 2])
            for a, b, n in zip(self.low, self.high, self.counts, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


class Probes(Model):
    """What goes into probes.parquet: wind, pressure, gas and temperature at points, up to every step of the air."""

    points: Annotated[
        tuple[Annotated[ProbePoint | ProbeLine | ProbeGrid, Field(discriminator="kind")], ...],
        Field(min_length=1),
    ]
    """The points, lines and grids of points, each with a name."""
    every: Literal["step"] | Duration = 0.1
    """Time between samples, linear between the steps of the air; step: one after each of them."""
    start: Time = 0.0
    """Time of the first sample; negative in the warm-up."""

    @property
    def size(self) -> int:
        """Number of points."""
        return sum(one.size for one in self.points)

    def samples(self, scenario: "Scenario") -> float:
        """How often they are sampled, about."""
        step = min(scenario.tick, scenario.wind.longest_step(scenario))
        return (scenario.duration - self.start) / (step if self.every == "step" else self.every)

    def bytes(self, scenario: "Scenario") -> float:
        """Size of probes.parquet, about."""
        numbers = scenario.domain.dim + 1 + len(scenario.gases)
        return self.samples(scenario) * self.size * numbers * BYTES_PER_NUMBER

    def problems(self, where: str, context: Context) -> Iterator[str]:
        if self.size > MOST_POINTS:
            yield f"{where}.points: are {self.size:,} points, at most {MOST_POINTS:,} are taken; use fewer"
        first: dict[str, int] = {}
        for n, one in enumerate(self.points):
            if first.setdefault(one.name, n) != n:
                yield (
                    f"{where}.points[{n}].name: '{one.name}' is the name of points[{first[one.name]}] too; "
                    "give each its own"
                )
        if self.start > context.scenario.duration:
            yield (
                f"{where}.start: {self.start:g} s is after the end at {context.scenario.duration:g} s; start earlier"
            )

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        scenario = context.scenario
        step = min(scenario.tick, scenario.wind.longest_step(scenario))
        if self.every != "step" and self.every < 0.5 * step:
            yield (
                f"{where}.every: {self.every:g} s is shorter than the air's steps of about {step:.2g} s, between which "
                "rows are linear in time; lower tick for more"
            )
        size = self.bytes(scenario)
        if size > MANY_BYTES:
            yield f"{where}: probes.parquet will have about {size / 1e9:.2g} GB; use fewer points or a longer every"
