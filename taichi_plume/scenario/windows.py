"""Windows: rectangles and discs in a plane, on the faces of a scenario's domain or across the domain."""

from collections.abc import Iterator
from math import pi, prod
from typing import Annotated

import numpy as np
from pydantic import Field

from taichi_plume.grid.floor_plans import FloorPlan
from taichi_plume.grid.outlines import circle, rectangle
from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, Domain, span
from taichi_plume.scenario.vocabulary import PER_FACE, SHAPE, Face, Model, consistency_check, not_both

LEAST_OPEN = 0.05  # open area fraction of an opening; less is closed
MOSTLY_OPEN = 0.9  # open area fraction; more is open, as walls that meet the face cover some of it
SAMPLES = 4  # points per axis of a cell behind an opening
FACE = 1e-3  # cells: depth at which the face itself is sampled


class Window(Model):
    """Part of a plane: all of it, a rectangle (`center`, `size`) or a disc (`center`, `diameter`).

    `center` and `size` are in the plane's own axes, in their x, y, z order: one number in 2-D, two in 3-D.
    """

    center: (
        Annotated[tuple[si.Coordinate, ...], Field(min_length=1, max_length=2), PER_FACE, SHAPE] | None
    ) = None
    """Middle of the region in its plane: one number in 2-D, two in 3-D, in x, y, z order. It goes with `size` or
    `diameter`; without them the region is the whole face or cross-section."""
    size: Annotated[tuple[si.Length, ...], Field(min_length=1, max_length=2), PER_FACE, SHAPE] | None = None
    """Edges of a rectangular region in its plane: one number in 2-D, two in 3-D."""
    diameter: Annotated[si.Length, SHAPE] | None = None
    """Diameter of a round region; in 2-D, width of a slot. Instead of `size`."""

    _one_form = not_both("size", "diameter")

    @consistency_check
    def _whole_form(self) -> Iterator[str]:
        if (self.size is None and self.diameter is None) != (self.center is None):
            yield "center goes with size (rectangle) or diameter (disc)"

    @property
    def normal(self) -> int:
        """Index of the axis normal to the window's plane (0: x, 1: y, 2: z)."""
        raise NotImplementedError

    def level(self, extent: tuple[float, ...]) -> float:
        """Return the coordinate of the plane along its normal [m], in a domain of this extent."""
        raise NotImplementedError

    def along(self, dim: int) -> list[int]:
        """Return the indices of the axes in the window's plane, in a domain with `dim` dimensions."""
        return [a for a in range(dim) if a != self.normal]

    def rectangle(self, extent: tuple[float, ...]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return centre and half widths [m] of the window, for a disc of the square around it; by default, of all."""
        whole = tuple(extent[a] for a in self.along(len(extent)))
        if self.center is None:
            return tuple(w / 2 for w in whole), tuple(w / 2 for w in whole)
        size = self.size if self.size is not None else (float(self.diameter or 0.0),) * len(whole)
        return self.center, tuple(w / 2 for w in size)

    def outline(
        self, extent: tuple[float, ...], axes: tuple[int, ...] = (0, 1, 2), height: float = 0.0
    ) -> np.ndarray:
        """Return the corners (n, len(axes)) [m] of the window along these axes; seen edge on, its ends (2, 2).

        height: of the walls of a 2-D domain as drawn [m].
        """
        center, half = map(np.array, self.rectangle(extent))
        if self.is_disc(len(extent)):
            flat = circle(center, half[0])
        else:
            flat = rectangle(np.append(center - half, 0.0)[:2], np.append(center + half, height)[:2])
        points = np.insert(flat, self.normal, self.level(extent), axis=1)[:, [*axes]]
        edge_on = len(axes) == 2 and self.normal in axes
        return np.array([points.min(axis=0), points.max(axis=0)]) if edge_on else points

    def is_disc(self, dim: int) -> bool:
        """Return whether the window is round in a run with `dim` dimensions; in 2-D a disc is a slot."""
        return self.diameter is not None and dim == 3

    def area(self, extent: tuple[float, ...], depth: float) -> float:
        """Return the area of the window [m²]; in 2-D, its width times `depth` [m]."""
        _, half = self.rectangle(extent)
        if self.is_disc(len(extent)):
            return pi * half[0] ** 2
        return prod(2 * h for h in half) * (depth if len(extent) == 2 else 1.0)

    def beyond(self, domain: Domain) -> str:
        """Return a message with the range in which the window exceeds the domain, and advice; empty if inside."""
        center, half = self.rectangle(domain.extent)
        for a, c, h in zip(self.along(domain.dim), center, half, strict=True):
            axis, length = "xyz"[a], domain.extent[a]
            # up to half a cell may be due to the rounding of the domain to whole cells
            if c - h < -1e-6 or c + h > length + domain.spacing / 2 + 1e-6:
                return (
                    f"{span(axis, c - h, c + h)}, the face has {span(axis, 0, length)}; "
                    "move its center or make it smaller"
                )
        return ""

    def covered(self, domain: Domain) -> np.ndarray:
        """Return the centres (n, dim - 1) [m] of the grid cells that the window covers, in the plane's own axes."""
        center, half = map(np.array, self.rectangle(domain.extent))
        axes = self.along(domain.dim)
        ranges = [(np.arange(domain.shape[a]) + 0.5) * domain.spacing for a in axes]
        places = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, len(axes))
        if self.is_disc(domain.dim):
            return places[np.linalg.norm(places - center, axis=-1) <= half[0]]
        return places[(np.abs(places - center) <= half).all(axis=-1)]


class Region(Window):
    """A window on a face of the domain."""

    face: Annotated[Face, SHAPE]
    """Side of the room: x- is at x = 0, x+ at the other end, likewise y, and in 3-D z."""

    @property
    def axis(self) -> int:
        """Index of the axis normal to the face (0: x, 1: y, 2: z)."""
        return "xyz".index(self.face[0])

    @property
    def normal(self) -> int:
        return self.axis

    @property
    def side(self) -> int:
        """0 for the face at the lower end of the axis, 1 for that at the upper end."""
        return int(self.face[1] == "+")

    def level(self, extent: tuple[float, ...]) -> float:
        return extent[self.axis] if self.side else 0.0

    def on_its_face(self, where: str, context: Context) -> Iterator[str]:
        """Yield an error if the region exceeds its face of the domain, or covers no grid cells with air."""
        domain = context.domain
        beyond = self.beyond(domain)
        if beyond:
            yield f"{where}: reaches beyond its face {self.face}: {beyond}"
            return
        covered = self.covered(domain)
        _, half = map(np.array, self.rectangle(domain.extent))
        if not len(covered) and (2 * half < domain.spacing).any():
            yield (
                f"{where}: is smaller than a cell of {domain.spacing:g} m and covers none; "
                "make it larger or lower domain.spacing"
            )
            return
        share = self.open_share(context)
        if share < LEAST_OPEN:
            area = self.area(domain.extent, domain.depth)
            yield (
                f"{where}: obstacles cover it: {share * area:.2g} of {area:.3g} m² are open on cells of "
                f"{domain.spacing:g} m; move one of them or lower domain.spacing"
            )

    def open_share(self, context: Context, with_plates: bool = True) -> float:
        """Return which fraction of the region's grid faces no standing obstacle closes; 1 without obstacles.

        A face is closed if obstacles cover more than half of the face or of the cell behind, at sampled points.
        with_plates: whether obstacles thinner than half a cell close a face. The flow solver resolves only walls of
        maps that are so thin.
        """
        domain, step = context.domain, context.domain.spacing / SAMPLES

        def is_near(shape: Shape) -> bool:
            width = domain.extent[self.axis]
            away = width - shape.high[self.axis] if self.side else shape.low[self.axis]
            return away <= domain.spacing + step

        shapes = [shape for shape in context.shapes.values() if shape.model.motion is None and is_near(shape)]
        centers = self.covered(domain)
        if not shapes or not len(centers):
            return 1.0
        parts = (np.arange(SAMPLES) + 0.5) / SAMPLES
        depths = np.array([FACE, *parts])  # on the face, and in the cell
        shifts = np.stack(np.meshgrid(*[parts - 0.5] * centers.shape[1], indexing="ij"), axis=-1)
        points = centers[:, None] + domain.spacing * shifts.reshape(-1, centers.shape[1])
        solid = np.zeros((len(depths), *points.shape[:2]))
        for level, depth in zip(solid, depths, strict=True):
            away = depth * domain.spacing
            at = domain.shape[self.axis] * domain.spacing - away if self.side else away
            here = np.insert(points.reshape(-1, points.shape[-1]), self.axis, at, axis=1)
            for shape in shapes:
                if depth == FACE and not (with_plates or isinstance(shape, FloorPlan)):
                    continue
                near = ((here >= shape.low - step) & (here <= shape.high + step)).all(axis=1)
                if not near.any():
                    continue
                if depth == FACE:
                    filled = shape.inside(here[near])
                else:  # part of the volume of the sample, exact for a plane along the cells
                    filled = np.clip(0.5 - shape.signed_distance(here[near]) / step, 0.0, 1.0)
                flat = level.reshape(-1)
                flat[near] = np.maximum(flat[near], filled)
        face, cell = solid[0].mean(axis=1), solid[1:].mean(axis=(0, 2))
        return float(((face <= 0.5) & (cell <= 0.5 + 1e-6)).mean())

    def overlaps(self, other: "Region", domain: Domain) -> bool:
        """Return whether this and another region are on the same face and share more than their rims."""
        if self.face != other.face:
            return False
        rim = 1e-6 * domain.spacing
        center, half = map(np.array, self.rectangle(domain.extent))
        other_center, other_half = map(np.array, other.rectangle(domain.extent))
        apart = np.abs(center - other_center)
        disc, other_disc = self.is_disc(domain.dim), other.is_disc(domain.dim)
        if disc and other_disc:
            return bool(np.linalg.norm(apart) < half[0] + other_half[0] - rim)
        if disc or other_disc:
            radius, sides = (half[0], other_half) if disc else (other_half[0], half)
            return bool(np.linalg.norm(np.maximum(apart - sides, 0.0)) < radius - rim)
        return bool((apart < half + other_half - rim).all())
