"""Motion of obstacles along a path over the floor."""

from bisect import bisect_right
from collections.abc import Iterator
from itertools import pairwise
from math import hypot
from typing import Annotated

from pydantic import Field

from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Domain, span
from taichi_plume.scenario.vocabulary import Model, consistency_check

FASTEST_BODY = 20.0  # m/s: the air does not count as incompressible much beyond


class Motion(Model):
    """Motion over the floor: straight and uniform from way point to way point, without turning.

    The centre is at the obstacle's `center` at t = 0, and before; after the last way point it stands still.
    """

    path: Annotated[
        tuple[tuple[si.Time, si.Coordinate, si.Coordinate], ...], Field(min_length=1, max_length=10_000)
    ]
    """Way points of the centre after t = 0, each [time, x, y] in s and m. Straight and uniform motion from
    point to point."""
    loop: bool = False
    """Start again after the last way point, which must be the `center`; it then moves before t = 0 too."""

    @consistency_check
    def _ascending(self) -> Iterator[str]:
        times = [0.0, *(point[0] for point in self.path)]
        for n, (a, b) in enumerate(pairwise(times)):
            if not b > a:
                yield f"times must ascend from above 0: path[{n}] has {b:g} s after {a:g} s"

    def place(self, center: tuple[float, ...], t: float) -> tuple[float, float]:
        """Return the centre x, y [m] of the obstacle at time t [s]; center: the centre at t = 0."""
        times = [0.0, *(point[0] for point in self.path)]
        if self.loop:
            t %= times[-1]
        n = bisect_right(times, t) - 1
        if n < 0:
            return center[0], center[1]
        points = [center[:2], *(point[1:] for point in self.path)]
        if n == len(self.path):
            return self.path[-1][1:]
        part = (t - times[n]) / (times[n + 1] - times[n])
        (x, y), (next_x, next_y) = points[n], points[n + 1]
        return x + part * (next_x - x), y + part * (next_y - y)

    def legs(self, center: tuple[float, ...]) -> list[tuple[float, float, float]]:
        """Return start [s], end [s] and speed [m/s] of each path segment; center: the obstacle's centre at t = 0."""
        points = [(0.0, center[0], center[1]), *self.path]
        return [(a[0], b[0], hypot(b[1] - a[1], b[2] - a[2]) / (b[0] - a[0])) for a, b in pairwise(points)]

    def placement_errors(
        self, where: str, center: tuple[float, ...], shape: Shape, domain: Domain
    ) -> Iterator[str]:
        """Yield errors: path outside the domain, body too fast or too thin for the grid; where: the obstacle's path."""
        for k, point in enumerate(self.path):
            for axis, x, length in zip("xy", point[1:], domain.extent, strict=False):
                if not 0 <= x <= length:
                    beyond = f"{axis} = {x:g} m is outside the domain, {span(axis, 0, length)}"
                    yield f"{where}.motion.path[{k}]: {beyond}; keep the centre inside"
                    return
        if self.loop and hypot(self.path[-1][1] - center[0], self.path[-1][2] - center[1]) > 1e-6:
            yield (
                f"{where}.motion.path[{len(self.path) - 1}]: a loop must end at the center "
                f"({center[0]:g}, {center[1]:g}) m, got ({self.path[-1][1]:g}, {self.path[-1][2]:g}) m"
            )
        for k, (start, end, speed) in enumerate(self.legs(center)):
            if speed > FASTEST_BODY:
                yield (
                    f"{where}.motion.path[{k}]: moves at {speed:.3g} m/s from {start:g} to {end:g} s; "
                    f"at most {FASTEST_BODY:g} m/s"
                )
                break
        width = float((shape.high - shape.low).min())
        if width < domain.spacing:
            yield (
                f"{where}: is {width:.3g} m thin, less than a cell of {domain.spacing:g} m: it would not move the air; "
                "make it larger or lower domain.spacing"
            )
