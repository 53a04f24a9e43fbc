"""Motion along a path from way point to way point: of obstacles over the floor, and of gas sources."""

from bisect import bisect_right
from collections.abc import Iterator
from itertools import pairwise
from math import ceil, dist, hypot
from typing import Annotated

import numpy as np
from pydantic import Discriminator, Field, Tag

from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, Domain, span
from taichi_plume.scenario.vocabulary import Model, consistency_check

FASTEST_BODY = 20.0  # m/s: the air does not count as incompressible much beyond
NEAREST = 1e-3  # cells: shortest step along a path past obstacles
MOST_STEPS = 10_000  # along each path segment past obstacles


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


def _axes(point: object) -> str:
    """Return the number of dimensions that a way point [time, x, y, z] or [time, x, y] is meant for, as a tag."""
    return "3" if isinstance(point, list | tuple) and len(point) == 4 else "2"


class SourceMotion(Motion):
    """Motion of a source: straight and uniform from way point to way point.

    The source is at its `position` at t = 0, and before; after the last way point it stands still.
    """

    path: Annotated[  # type: ignore[assignment]
        tuple[
            Annotated[
                Annotated[tuple[si.Time, si.Coordinate, si.Coordinate], Tag("2")]
                | Annotated[tuple[si.Time, si.Coordinate, si.Coordinate, si.Coordinate], Tag("3")],
                Discriminator(_axes),
            ],
            ...,
        ],
        Field(min_length=1, max_length=10_000),
    ]
    """Way points after t = 0, each [time, x, y] or in 3-D [time, x, y, z] in s and m. Straight and uniform motion from
    point to point."""
    loop: bool = False
    """Start again after the last way point, which must be the `position`; it then moves before t = 0 too."""

    def places(self, position: tuple[float, ...], t: float | np.ndarray) -> np.ndarray:
        """Return the positions (..., dim) [m] at times t (...) [s]; position: the position at t = 0."""
        return self._between(position, np.asarray(t, float) % self.path[-1][0] if self.loop else t)

    def _between(self, position: tuple[float, ...], t: float | np.ndarray) -> np.ndarray:
        """Return the positions (..., dim) [m] between the way points at times t (...) [s]."""
        times = np.array([0.0, *(point[0] for point in self.path)])
        points = np.array([position, *(point[1:] for point in self.path)])
        return np.stack([np.interp(t, times, along) for along in points.T], axis=-1)

    def samples(self, position: tuple[float, ...], apart: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times (n,) [s] and positions (n, dim) [m] on the path, at most `apart` [m] from one to the next."""
        points = [(0.0, *position), *self.path]
        parts = [
            np.linspace(a[0], b[0], max(2, ceil(dist(a[1:], b[1:]) / apart) + 1)) for a, b in pairwise(points)
        ]
        times = np.concatenate(parts)
        return times, self._between(position, times)

    def point_errors(self, where: str, position: tuple[float, ...], context: Context) -> Iterator[str]:
        """Yield errors of way points: a wrong dimension, outside the domain, a loop that does not return.

        where: path of the source; position: its position at t = 0, which lies in the air.
        """
        for k, point in enumerate(self.path):
            if len(point) != len(position) + 1:
                axes = "time, x and y" if len(position) == 2 else "time, x, y and z"
                yield f"{where}.motion.path[{k}]: has {len(point)} numbers, takes {len(position) + 1} here: {axes}"
                return
            if outside := context.outside(np.array([point[1:]])):
                yield f"{where}.motion.path[{k}]: at {point[0]:g} s {outside}; keep the source inside"
                return
        if self.loop and dist(self.path[-1][1:], position) > 1e-6:
            last = len(self.path) - 1
            yield (
                f"{where}.motion.path[{last}]: a loop must end at the position ({_shown(position)}) m, got "
                f"({_shown(self.path[-1][1:])}) m"
            )

    def segment_errors(self, where: str, position: tuple[float, ...], context: Context) -> Iterator[str]:
        """Yield an error of the first segment that is too fast or meets a standing obstacle; see `point_errors`."""
        points = [(0.0, *position), *self.path]
        for k, (a, b) in enumerate(pairwise(points)):
            speed = dist(a[1:], b[1:]) / (b[0] - a[0])
            if speed > FASTEST_BODY:
                yield (
                    f"{where}.motion.path[{k}]: moves at {speed:.3g} m/s from {a[0]:g} to {b[0]:g} s; at most "
                    f"{FASTEST_BODY:g} m/s"
                )
                return
        met = self._met(np.array(points), context)
        if met is not None:
            k, t, place, obstacle = met
            yield (
                f"{where}.motion.path[{k}]: at {t:.4g} s the source meets {obstacle} "
                f"({context.shapes[obstacle].model.kind}) at ({_shown(place)}) m; lead the path around it"
            )

    def _met(self, points: np.ndarray, context: Context) -> tuple[int, float, np.ndarray, str] | None:
        """Return segment, time [s] and position of the first standing obstacle on the way, and its path; else None.

        Each segment is followed in steps as long as the distance to the obstacle, which no obstacle can be within
        (sphere tracing). points: (n, 1 + dim), times and positions.
        """
        first = None
        begin, way = points[:-1], np.diff(points, axis=0)
        length = np.linalg.norm(way[:, 1:], axis=1)
        least = NEAREST * context.domain.spacing
        for name, shape in context.shapes.items():
            if shape.model.motion is not None:
                continue
            gone, active = np.zeros(len(way)), np.arange(len(way))
            for _ in range(MOST_STEPS):
                part = (gone[active] / np.maximum(length[active], 1e-12))[:, None]
                places = begin[active] + part * way[active]
                away = shape.signed_distance(places[:, 1:])
                inside = np.flatnonzero(away < 0.0)
                if len(inside):
                    n = inside[0]
                    if first is None or places[n, 0] < first[1]:
                        first = int(active[n]), float(places[n, 0]), places[n, 1:], name
                    active, away = active[:n], away[:n]  # later segments do not matter
                gone[active] = np.minimum(gone[active] + np.maximum(away, least), length[active])
                ended = part[: len(active), 0] >= 1.0
                active = active[~ended & (length[active] > 0.0)]
                if not len(active):
                    break
        return first


def _shown(place: "tuple[float, ...] | np.ndarray") -> str:
    """Return a position as text, such as "3, 1.5"."""
    return ", ".join(f"{float(x):.4g}" for x in place)
