"""Planes and volumes that views show, and their pixels from the cells of a grid. Plain arrays, no Taichi kernel.

A picture is an array (first axis, second axis[, third axis]) of its plane; pixels without air are NaN.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, hypot

import numpy as np

from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.outputs import Output
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.size import MOST_PIXELS, MOST_VOXELS

SLIGHT = 1e-9  # weight of solids beside air
FLOOR = 0.1  # m: height of the slice without sources and sensors
ARROWS = 26  # wind arrows along the diagonal of a plane


@dataclass(frozen=True)
class Plane:
    """Plane, or volume, of a picture. axes: axes of the picture; normal: third axis of a plane, None in 2-D.

    level: position along the normal [m]; None for the maximum along the normal. text: description.
    """

    name: str
    axes: tuple[int, ...]
    normal: int | None
    level: float | None
    text: str

    def within(self, points: np.ndarray) -> np.ndarray:
        """Return points (..., 2) in the plane's axes as points of the domain, (..., dim) [m]."""
        if self.normal is None or self.level is None:
            return points
        return np.insert(points, self.normal, self.level, axis=-1)

    @property
    def over_height(self) -> bool:
        """Whether the picture shows the maximum over the height, not a plane at a level."""
        return self.normal is not None and self.level is None

    @property
    def letters(self) -> str:
        """Names of the plane's axes, such as "xz"."""
        return "".join("xyz"[d] for d in self.axes)


VOLUME = Plane("volume", (0, 1, 2), None, None, "the room")
"""Volume of a 3-D room, as voxels of several cells."""


def cells_of(dim: int) -> Plane:
    """Return all cells of a room, each as a pixel."""
    return Plane("cells", tuple(range(dim)), None, None, "")


def planes(scenario: Scenario, extent: Sequence[float]) -> list[Plane]:
    """Return the planes of a recording by the scenario's `recording` section."""
    if len(extent) == 2:
        return [Plane("slice", (0, 1), None, None, "")]
    found = []
    for n, height in enumerate(heights(scenario, extent)):
        found.append(Plane(_nth("slice", n), (0, 1), 2, height, f"{height:g} m above the floor"))
    found.append(Plane("column", (0, 1), 2, None, "maximum over the height"))
    for n, (normal, level) in enumerate(cuts(scenario, extent)):
        text = f"{'xy'[normal]} = {level:g} m"
        found.append(Plane(_nth("section", n), (1 - normal, 2), normal, level, text))
    return found


def plane_of(output: Output, extent: Sequence[float]) -> Plane:
    """Return the plane of a view that is written by itself; its name is that of the output."""
    if len(extent) == 2:
        return Plane(output.name, (0, 1), None, None, "")
    if output.plane == "column":
        return Plane(output.name, (0, 1), 2, None, "maximum over the height")
    axes = tuple(map("xyz".index, output.plane))
    normal = 3 - sum(axes)
    level = extent[normal] / 2 if output.at is None else output.at
    return Plane(output.name, axes, normal, level, f"{'xyz'[normal]} = {level:g} m")


def _nth(name: str, n: int) -> str:
    return name if n == 0 else f"{name}_{n + 1}"


def heights(scenario: Scenario, extent: Sequence[float]) -> list[float]:
    """Return the heights of the slices [m]; by default of the first source, sensors and heater, if different."""
    if scenario.recording.slice_height is not None:
        return list(scenario.recording.slice_height)
    sources, heaters = _first(scenario)
    sensors = [group.sensors.nose.height for group in scenario.robots[:1]]
    levels = [place[2] for place in sources] + sensors + [place[2] for place in heaters]
    return _apart([min(max(level, 0.0), extent[2]) for level in levels or [FLOOR]], scenario.domain.spacing)


def cuts(scenario: Scenario, extent: Sequence[float]) -> list[tuple[int, float]]:
    """Return normal axis and position [m] of each section; by default at the first source and the first heater."""
    section = scenario.recording.section
    if section is None:
        return []
    normal = section.normal(extent)
    if section.at is not None:
        return [(normal, section.at)]
    sources, heaters = _first(scenario)
    levels = [place[normal] for place in (*sources, *heaters)] or [extent[normal] / 2]
    return [(normal, level) for level in _apart(levels, scenario.domain.spacing)]


def _first(scenario: Scenario) -> tuple[list[tuple[float, ...]], list[tuple[float, ...]]]:
    """Return the positions of the first source and of the first heater, each as a list that may be empty."""
    sources = [source.position for _, source in scenario.sources[:1]]
    return sources, [heater.position for heater in scenario.heat.heaters[:1]] if scenario.heat else []


def _apart(levels: Sequence[float], distance: float) -> list[float]:
    """Return levels (positions [m] on an axis) without those closer than a distance to an earlier level."""
    found: list[float] = []
    for level in levels:
        if all(abs(level - other) > distance for other in found):
            found.append(level)
    return found


class Raster:
    """Pixels of a plane on a grid: at most MOST_PIXELS along each axis; a pixel is the largest covered value.

    split: samples per cell along each axis, of a quantity known between the cells' centres; finer: whether more than
    one; details: pixels per cell of such a quantity, within MOST_PIXELS. shape: number of pixels; cell, origin: size of
    a pixel and lower left corner, along the plane's axes [m]. Voxels of VOLUME are twice as wide as cells, at most
    MOST_VOXELS along each axis.
    """

    def __init__(self, plane: Plane, grid: Grid, solid: np.ndarray, split: int = 1, details: int = 1):
        self.plane, self.grid, self.finer = plane, grid, split > 1
        cells = [grid.shape[d] for d in plane.axes]
        self.block = split // details
        if max(cells) * details > MOST_PIXELS and plane.name != "cells":
            self.block = split * ceil(max(cells) / MOST_PIXELS)
        self.samples = tuple(n * split for n in cells)
        self.step = grid.dx / split
        if plane == VOLUME:
            self.shape = tuple(min(ceil(n / 2), MOST_VOXELS) for n in cells)
            self.cell = tuple(length / n for length, n in zip(grid.extent, self.shape, strict=True))
        else:
            self.shape = tuple(ceil(n / self.block) for n in self.samples)
            self.cell = (self.step * self.block,) * len(cells)
        self.origin = (0.0,) * len(cells)
        self._layers: list[tuple[tuple, np.ndarray | float]] = []
        if plane.normal is not None and plane.level is not None:
            self._layers = _between(plane.normal, plane.level, grid, solid)
        self.solid = self._solid(solid)

    def _solid(self, solid: np.ndarray) -> np.ndarray:
        """Return the mask of the pixels that cover no air."""
        if self.plane.over_height:
            closed = np.asarray(solid.all(axis=self.plane.normal))
        elif self._layers:
            closed = np.all([solid[layer] for layer, _ in self._layers], axis=0)
        else:
            closed = solid
        for axis, n in enumerate(self.samples):
            closed = np.repeat(closed, n // closed.shape[axis], axis=axis)
        return ~self._pooled(~np.asarray(closed))

    @property
    def points(self) -> np.ndarray:
        """Positions at which a quantity is sampled for the plane's pixels, (*samples, dim) [m]."""
        axes = [(np.arange(n) + 0.5) * self.step for n in self.samples]
        flat = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return self.plane.within(flat)

    def of_cells(self, values: np.ndarray) -> np.ndarray:
        """Return the pixels of a quantity in all cells, (*grid.shape); only without a `split`."""
        if self._layers:
            return self.of_samples(np.asarray(sum(values[layer] * weight for layer, weight in self._layers)))
        return self.of_samples(values.max(axis=self.plane.normal) if self.plane.over_height else values)

    def of_samples(self, values: np.ndarray) -> np.ndarray:
        """Return the pixels of a plane's picture from a quantity's values at the sampling points (`points`)."""
        return np.where(self.solid, np.float32(np.nan), self._pooled(values))

    def _pooled(self, values: np.ndarray) -> np.ndarray:
        if values.shape == self.shape:
            return values
        if self.plane == VOLUME:
            return largest(values, self.shape)
        beyond = [(0, n * self.block - have) for n, have in zip(self.shape, values.shape, strict=True)]
        return largest(np.pad(values, beyond, mode="edge"), self.shape)


class Lattice:
    """Positions of the wind arrows of a plane. shape: their number, cell: their distance [m], along the plane's axes.

    finer: True, as no cell has its centre there. origin: lower left corner [m]; points: positions (*shape, dim) [m];
    step: distance by which arrows are scaled [m].
    """

    def __init__(self, plane: Plane, extent: Sequence[float]):
        sides = [extent[d] for d in plane.axes]
        self.plane, self.step, self.finer = plane, hypot(*sides) / ARROWS, True
        self.shape = tuple(max(1, round(length / self.step)) for length in sides)
        self.cell = tuple(length / n for length, n in zip(sides, self.shape, strict=True))
        self.origin = (0.0,) * len(sides)
        axes = [(np.arange(n) + 0.5) * cell for n, cell in zip(self.shape, self.cell, strict=True)]
        self.points = plane.within(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))


def _between(
    normal: int, level: float, grid: Grid, solid: np.ndarray
) -> list[tuple[tuple, np.ndarray | float]]:
    """Return the layers of cells beside a level and their weights: linear between the centres of cells that hold air.

    Solid cells count only if all cells there are solid: a temperature in solids is not zero.
    """
    at = level / grid.dx - 0.5
    first = int(np.clip(np.floor(at), 0, max(0, grid.shape[normal] - 2)))
    share = float(np.clip(at - first, 0.0, 1.0))
    layers = []
    total: np.ndarray | float = 0.0
    for n, weight in ((first, 1.0 - share), (first + 1, share)):
        if weight > 0.0:
            layer = tuple(n if d == normal else slice(None) for d in range(grid.dim))
            weights = np.where(solid[layer], SLIGHT * weight, weight)
            total = total + weights
            layers.append((layer, weights))
    return [(layer, (weights / total).astype(np.float32)) for layer, weights in layers]


def largest(values: np.ndarray, counts: Sequence[int]) -> np.ndarray:
    """Return the largest value of the cells touched by each of `counts` equal parts per axis."""
    for axis, (n, count) in enumerate(zip(values.shape, counts, strict=True)):
        if n == count:
            continue
        if n % count == 0:
            parts = [np.s_[k :: n // count] for k in range(n // count)]
        else:
            begin, end = np.arange(count) * n // count, -(-np.arange(1, count + 1) * n // count)
            parts = [np.minimum(begin + k, end - 1) for k in range(int((end - begin).max()))]
        index = (slice(None),) * axis
        picked = values[(*index, parts[0])]
        for part in parts[1:]:
            picked = np.maximum(picked, values[(*index, part)])
        values = picked
    return values
