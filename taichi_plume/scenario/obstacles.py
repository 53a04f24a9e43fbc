"""The obstacles of a scenario: shapes that stand in the air or walk through it."""

from bisect import bisect_right
from itertools import pairwise
from math import hypot
from typing import Annotated, Literal

from pydantic import Field, model_validator

from taichi_plume.scenario.quantities import fault
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Coordinate,
    Distance,
    Length,
    Model,
    Point,
    Point2,
    Positive,
    Real,
    Time,
)


class Motion(Model):
    """A walk over the ground: straight and even from way point to way point, without turning.

    The centre is at the obstacle's `center` at t = 0, and before; after the last way point it stands still.
    """

    path: Annotated[tuple[tuple[Time, Coordinate, Coordinate], ...], Field(min_length=1, max_length=10_000)]
    """Way points of the centre after t = 0: [time, x, y]."""
    loop: bool = False
    """Whether it starts over after the last way point, which must be the `center`; it then walks before t = 0 too."""

    @model_validator(mode="after")
    def _ascending(self) -> "Motion":
        times = [0.0, *(point[0] for point in self.path)]
        for n, (a, b) in enumerate(pairwise(times)):
            if not b > a:
                raise fault(
                    "times must ascend from above 0: path[{n}] has {b} s after {a} s",
                    {"n": n, "a": f"{a:g}", "b": f"{b:g}"},
                )
        return self

    def place(self, center: tuple[float, ...], t: float) -> tuple[float, float]:
        """Where the centre is at time t [s], x and y [m]; `center` at t = 0."""
        times = [0.0, *(point[0] for point in self.path)]
        if self.loop:
            t %= times[-1]
        n = bisect_right(times, t) - 1
        if n < 0:
            return center[0], center[1]
        places = [center[:2], *(point[1:] for point in self.path)]
        if n == len(self.path):
            return self.path[-1][1:]
        share = (t - times[n]) / (times[n + 1] - times[n])
        (x, y), (next_x, next_y) = places[n], places[n + 1]
        return x + share * (next_x - x), y + share * (next_y - y)

    def legs(self, center: tuple[float, ...]) -> list[tuple[float, float, float]]:
        """Of each straight part its begin [s], its end [s] and the speed [m/s]."""
        points = [(0.0, center[0], center[1]), *self.path]
        return [(a[0], b[0], hypot(b[1] - a[1], b[2] - a[2]) / (b[0] - a[0])) for a, b in pairwise(points)]


class Box(Model):
    """An upright box, turned by `yaw_deg` about the vertical."""

    kind: Literal["box"]
    center: Annotated[Point, COMPILED]
    size: Annotated[tuple[Length, ...], Field(min_length=2, max_length=3), COMPILED]
    yaw_deg: Annotated[Real, COMPILED] = 0.0
    motion: Motion | None = None


class Cylinder(Model):
    """A vertical cylinder; in 3-D it stands on `base` and reaches the ceiling unless `height` says otherwise."""

    kind: Literal["cylinder"]
    center: Annotated[Point2, COMPILED]
    radius: Annotated[Length, COMPILED]
    base: Annotated[Distance, COMPILED] = 0.0
    height: Annotated[Length, COMPILED] | None = None
    motion: Motion | None = None


class Sphere(Model):
    """A sphere (in 2-D a disc)."""

    kind: Literal["sphere"]
    center: Annotated[Point, COMPILED]
    radius: Annotated[Length, COMPILED]
    motion: Motion | None = None


class Prism(Model):
    """A vertical prism over a simple polygon; in 3-D from `base` to the ceiling unless `height` says otherwise."""

    kind: Literal["prism"]
    vertices: Annotated[tuple[Point2, ...], Field(min_length=3, max_length=10_000), COMPILED]
    base: Annotated[Distance, COMPILED] = 0.0
    height: Annotated[Length, COMPILED] | None = None


class Mesh(Model):
    """A closed triangle mesh (STL, OBJ or PLY); in 2-D its section at `section` [m] above the ground."""

    kind: Literal["mesh"]
    file: str
    """Path, relative to the scenario's folder."""
    scale: Annotated[Positive, COMPILED] = 1.0
    yaw_deg: Annotated[Real, COMPILED] = 0.0
    translate: Annotated[tuple[Coordinate, Coordinate, Coordinate], COMPILED] = (0.0, 0.0, 0.0)
    section: Annotated[Coordinate, COMPILED] = 0.0


def motion_of(obstacle: Model) -> Motion | None:
    """How an obstacle moves, None if it stands."""
    return getattr(obstacle, "motion", None)


Obstacle = Annotated[Box | Cylinder | Sphere | Prism | Mesh, Field(discriminator="kind")]
