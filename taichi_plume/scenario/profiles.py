"""Velocity profiles of an inlet by the distance from adjacent walls: log law, power law, table."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.vocabulary import (
    SHAPE,
    Face,
    Model,
    consistency_check,
    exactly_one,
    one_or_several,
)
from taichi_plume.scenario.windows import Region

KARMAN = 0.41
ENTRIES = Field(min_length=2, max_length=10_000)
ROWS = 65  # sample points along each axis of an opening


class HeightProfile(Model):
    """Speed by height; the opening's `speed` stays the mean, so only ratios count."""

    walls: one_or_several(Face, 4)  # type: ignore[valid-type]
    """Faces from which heights are measured, such as z- for the floor; with several, from the nearest."""

    def height_at(self, points: Sequence[np.ndarray], extent: Sequence[float]) -> np.ndarray:
        """Return the distance [m] of points from the nearest of `walls`; points: coordinates along each axis [m]."""
        faces = [("xyz".index(face[0]), face[1] == "+") for face in self.walls]
        return np.min([extent[a] - points[a] if far else points[a] for a, far in faces], axis=0)

    def shape(self, heights: np.ndarray, inside: np.ndarray) -> np.ndarray:
        """Return the speed at these heights [m] over their largest speed; 0 where `inside` (of the inlet) is False."""
        speeds = np.where(inside, np.maximum(self._speeds(heights, heights[inside]), 0.0), 0.0)
        return speeds / max(float(speeds.max(initial=0.0)), 1e-30)

    def _speeds(self, heights: np.ndarray, of_opening: np.ndarray) -> np.ndarray:
        """Return the speed at `heights` [m] in any unit; of_opening: heights of points all over the inlet."""
        raise NotImplementedError

    def region_errors(self, where: str, region: Region, domain: Domain) -> Iterator[str]:
        """Yield errors of the profile for an inlet that covers this region of a face; where: the profile's path."""
        if any(wall[0] == region.face[0] for wall in self.walls):
            yield f"{where}.walls: the inlet is on face {region.face} itself; name an adjacent face"
            return
        center, half = region.rectangle(domain.extent)
        axes = [np.linspace(c - h, c + h, ROWS) for c, h in zip(center, half, strict=True)]
        points = list(np.meshgrid(*axes, indexing="ij"))
        points.insert(region.axis, np.zeros_like(points[0]))
        yield from self._mismatches(where, self.height_at(points, domain.extent), domain)

    def _mismatches(self, where: str, heights: np.ndarray, domain: Domain) -> Iterator[str]:
        """Yield an error if no air flows in at points of the inlet with these heights over the walls [m]."""
        if not self.shape(heights, np.ones(heights.shape, bool)).any():
            yield f"{where}: is zero {self._over(heights)}: no air comes in"

    def _over(self, heights: np.ndarray) -> str:
        return f"at {max(0.0, heights.min()):.4g} to {heights.max():.4g} m over {', '.join(self.walls)}"


class LogProfile(HeightProfile):
    """Speed that grows with the logarithm of the height, as over a wall far from the other side: u ~ ln(h/z0)."""

    kind: Literal["log"]
    roughness: Annotated[si.Length, SHAPE] | None = None
    """Roughness length z0, the height at which the speed is 0. Of a smooth wall about 2e-6 m²/s over the friction
    velocity."""
    friction: Annotated[si.SomeFraction, SHAPE] | None = None
    """Friction velocity over the mean speed, instead of the roughness."""

    _one_parameter = exactly_one("roughness", "friction")

    def _speeds(self, heights: np.ndarray, of_opening: np.ndarray) -> np.ndarray:
        """Return ln(h/z0) at heights h. By a friction factor u*/U, z0 is such that u*/0.41 ln(h/z0) has the mean U."""
        logs = np.log(np.maximum(heights, 1e-12))
        if self.roughness is not None:
            return logs - np.log(self.roughness)
        return logs - np.mean(np.log(np.maximum(of_opening, 1e-12))) + KARMAN / (self.friction or 1.0)


class PowerProfile(HeightProfile):
    """Speed that grows with a power of the height: u ~ h^exponent."""

    kind: Literal["power"]
    exponent: Annotated[si.Exponent, SHAPE] = 1 / 7
    """Exponent of the height: 1/7 is usual over smooth ground, more makes a slower layer below."""

    def _speeds(self, heights: np.ndarray, of_opening: np.ndarray) -> np.ndarray:
        return (np.maximum(heights, 0.0) / max(float(of_opening.max()), 1e-12)) ** self.exponent


class TableProfile(HeightProfile):
    """Speeds at heights, linear in between."""

    kind: Literal["table"]
    heights: Annotated[tuple[si.Distance, ...], ENTRIES, SHAPE]
    """Heights over the walls at which speeds are given, ascending; they have to cover the opening."""
    speeds: Annotated[tuple[si.Speed, ...], ENTRIES, SHAPE]
    """Speed at each height, linear in between. Only their ratios count, the opening's `speed` stays the mean."""

    @consistency_check
    def _equal_lengths(self) -> Iterator[str]:
        if len(self.heights) != len(self.speeds):
            yield f"has {len(self.heights)} heights and {len(self.speeds)} speeds; give one speed per height"
        if any(a >= b for a, b in pairwise(self.heights)):
            yield "heights must grow from each to the next"

    def _speeds(self, heights: np.ndarray, of_opening: np.ndarray) -> np.ndarray:
        return np.interp(heights, self.heights, self.speeds)

    def _mismatches(self, where: str, heights: np.ndarray, domain: Domain) -> Iterator[str]:
        rounded = 0.5 * domain.spacing + 1e-6  # of the domain to whole cells
        if self.heights[0] > heights.min() + 1e-6 or self.heights[-1] < heights.max() - rounded:
            yield (
                f"{where}.heights: {self.heights[0]:g} to {self.heights[-1]:g} m do not cover the inlet, "
                f"{self._over(heights)}; add the missing heights"
            )
        else:
            yield from super()._mismatches(where, heights, domain)


Profile = Annotated[LogProfile | PowerProfile | TableProfile, Field(discriminator="kind")]
