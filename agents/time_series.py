"""Time-series gas map from a neighbourhood in space and time: eq 4-7 of Marjovi & Marques, ICRA 2014 (see `snapshots`).

The past snapshots k forecast the next one, t, from the neighbourhood N_j in space and time,

    Dist = α |x_j - x_i| + (1 - α) T,      T = time_scale (t0 - k) window      (in m and s)     (4)
    N_j = {(i, k): Dist < β, k < t},       U = 1 / Dist                                         (5) (7)
    S_j(t) = Σ_N C W U / Σ_N W U                                                                (6)

where i counts the cells, with their C and W, or with `raw_samples` the samples, with their readings and W = 1. With
cells N_j is the same everywhere: a list of (lag, offset, U), computed once. A ring buffer holds the snapshots within
reach, so that runs of any length fit.

`time_from` chooses t0. By `newest` t0 = t - 1: T = 0 in the newest snapshot. The paper lists the neighbourhoods by
their radius at the current snapshot and their age, as 1 m and 10 s for α = β = 0.5, which only holds for t0 = t - 1.
U would be infinite in a cell's own newest value: distances below `min_distance` count as `min_distance` in U, as in
eq 2. By `forecast` t0 = t, and U is never infinite.
"""

from functools import lru_cache
from math import hypot

import numpy as np

from taichi_plume.agents.gas_map import Floor, shape
from taichi_plume.agents.snapshots import Needs, SnapMap, Snapshots
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario import maps as models

Stencil = list[tuple[int, int, int, float]]
"""(lag in snapshots, offset in cells along x and y, weight) of each member of a cell's neighbourhood."""


class TimeSeriesMap(SnapMap):
    """Gas map that forecasts each cell from earlier snapshots in its neighbourhood in space and time."""

    def __init__(self, model: models.TimeSeriesMap, floor: Floor, snapshots: Snapshots | None = None):
        self.model = model
        super().__init__(model, floor, snapshots)
        neighbours = neighbourhood(model, max(self.shape) - 1)
        self.depth = max(lag for lag, *_ in neighbours)
        # Σ U of the cells per lag in snapshots, from 0 on
        self.total = np.bincount([lag for lag, *_ in neighbours], [U for *_, U in neighbours])
        if model.raw_samples:
            return
        # By symmetry a quadrant is enough; offsets on an axis count twice, the origin four times.
        quadrant = [
            (lag, x, y, U / ((1 + (x == 0)) * (1 + (y == 0))))
            for lag, x, y, U in neighbours
            if x >= 0 and y >= 0
        ]
        table = np.array(quadrant)
        self.offsets = ti.filled_vectors(table[:, :3], ti.i32)
        self.closeness = ti.filled(table[:, 3])

    @classmethod
    def needs(cls, model: models.TimeSeriesMap, floor: Floor) -> Needs:
        """Return the number of past snapshots and the margin of cells that the map of `model` needs to store."""
        neighbours = neighbourhood(model, max(shape(floor.extent, model.cell)) - 1)
        depth = max(lag for lag, *_ in neighbours)
        if model.raw_samples:
            return Needs(sampled=depth + 1)
        return Needs(depth=depth, margin=max(max(abs(x), abs(y)) for _, x, y, _ in neighbours))

    def remembered_of(self, lag: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Return the forecast weight of readings at `place` [m], `lag` snapshots old, relative to those of lag 1."""
        if not self.model.raw_samples:
            return np.where(lag <= self.depth, self.total[np.minimum(lag, self.depth)] / self.total[1], 0.0)
        cell = np.minimum(place // self.cell, np.array(self.shape) - 1)
        model, apart = self.model, np.linalg.norm(place - (cell + 0.5) * self.cell, axis=-1)
        way = model.alpha * np.maximum(apart, _least_distance(model))
        fresh, age = (
            (1 - model.alpha) * model.time_scale * (model.first_age + (n - 1) * model.window)
            for n in (1, lag)
        )
        within = model.alpha * apart + age < model.beta - models.BORDER
        return np.where(within, (way + fresh) / (way + age), 0.0)

    def _forecast(self) -> None:
        model, snapshots = self.model, self.snaps
        if model.raw_samples:
            lag_age = (1 - model.alpha) * model.time_scale * model.window  # contribution of a lag to Dist
            _from_samples(
                snapshots.samples, snapshots.taken, snapshots.ended, self.depth, self.cell, model.alpha,
                model.beta - models.BORDER,
                lag_age, int(model.time_from == "newest"), _least_distance(model), self.numerator, self.denominator,
            )  # fmt: skip
            return
        _from_cells(
            snapshots.strip, snapshots.weighted, snapshots.weights, snapshots.ended, self.offsets, self.closeness,
            snapshots.margin,
            self.numerator, self.denominator,
        )  # fmt: skip


def neighbourhood(model: models.TimeSeriesMap, farthest: int) -> Stencil:
    """Return the stencil of eq 4, 5, 7: lag, offset and weight U per neighbour; farthest: largest offset [cells]."""
    newest, least = int(model.time_from == "newest"), _least_distance(model)
    numbers = model.alpha, model.beta, model.cell, model.time_scale, model.window
    return _stencil(*numbers, newest, least, farthest)


def _least_distance(model: models.TimeSeriesMap) -> float:
    """Return the least distance [m] in U: 0 if age keeps U finite."""
    return model.least_distance if model.first_age == 0.0 else 0.0


@lru_cache(maxsize=64)
def _stencil(
    alpha: float, beta: float, cell: float, time_scale: float, window: float, newest: int, least: float,
    farthest: int,
) -> Stencil:  # fmt: skip
    """Return the stencil of `neighbourhood`. newest: lag of age 0; least: least distance in U [m]."""
    reach = min(farthest, int(beta / alpha / cell) + 1)
    result: Stencil = []
    lag = 1
    while (age := (1 - alpha) * time_scale * (lag - newest) * window) < beta - models.BORDER:
        for dx in range(-reach, reach + 1):
            for dy in range(-reach, reach + 1):
                apart = cell * hypot(dx, dy)
                if alpha * apart + age < beta - models.BORDER:
                    result.append((lag, dx, dy, 1 / (alpha * max(apart, least) + age)))
        lag += 1
    return result


@ti.kernel
def _from_cells(
    strip: Template, weighted: Template, weights: Template, snap: int, offsets: Template, closeness: Template,
    margin: int, numerator: Template, denominator: Template,
):  # fmt: skip
    """Compute numerator and denominator of eq 6 at snapshot (time window) `snap` from cells of earlier snapshots."""
    nx, ny = ti.static(numerator.shape[1], numerator.shape[2])
    for k, i, part in ti.ndrange(numerator.shape[0], nx, (ny + strip - 1) // strip):
        first = part * strip
        a = ti.Vector([0.0] * strip)
        b = ti.Vector([0.0] * strip)
        for n in range(closeness.shape[0]):
            lag, dx, dy = offsets[n][0], offsets[n][1], offsets[n][2]
            if lag <= snap:
                slot = (snap - lag) % weights.shape[1]
                left, right = margin + i - dx, margin + i + dx
                below, above = margin + first - dy, margin + first + dy
                U = closeness[n]
                for s in range(strip):
                    a[s] += U * (
                        weighted[k, slot, left, below + s]
                        + weighted[k, slot, left, above + s]
                        + weighted[k, slot, right, below + s]
                        + weighted[k, slot, right, above + s]
                    )
                    b[s] += U * (
                        weights[k, slot, left, below + s]
                        + weights[k, slot, left, above + s]
                        + weights[k, slot, right, below + s]
                        + weights[k, slot, right, above + s]
                    )
        for s in range(ti.min(strip, ny - first)):
            numerator[k, i, first + s] = a[s]
            denominator[k, i, first + s] = b[s]


@ti.kernel
def _from_samples(
    samples: Template, taken: Template, snap: int, depth: int, cell: float, alpha: float, beta: float, lag_age: float,
    newest: int, least: float, numerator: Template, denominator: Template,
):  # fmt: skip
    """Compute numerator and denominator of eq 6 at snapshot (time window) `snap` from `depth` earlier snapshots.

    newest: lag of age 0; least: least distance in U [m].
    """
    for k, i, j in ti.ndrange(*numerator.shape):
        center = (ti.Vector([i, j]) + 0.5) * cell
        a = 0.0
        b = 0.0
        for lag in range(1, ti.min(snap, depth) + 1):
            slot = (snap - lag) % taken.shape[1]
            for n in range(taken[k, slot]):
                sample = samples[k, slot, n]
                apart = ti.math.length(ti.Vector([sample[0], sample[1]]) - center)
                age = lag_age * (lag - newest)
                if alpha * apart + age < beta:
                    dist = alpha * ti.max(apart, least) + age
                    a += sample[2] / dist
                    b += 1.0 / dist
        numerator[k, i, j] = a
        denominator[k, i, j] = b
