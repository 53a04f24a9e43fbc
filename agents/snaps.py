"""Snaps, and the maps made of them: what `time_series` and `inverse_distance` share.

Marjovi & Marques, "Multi-Robot Odor Distribution Mapping in Realistic Time-Variant Conditions", ICRA 2014, with its
equation numbers. Time is cut into snaps of `window` seconds. In snap k the samples (x_i, C_i) of all robots of a trial,
at the places x_i where they believe to be, give in cell j

    w_ij = max(|x_j - x_i|, min_distance)^-power                                                (2)
    C_j(k) = Σ_i w_ij C_i / Σ_i w_ij,      W_j(k) = Σ_i w_ij                                    (1) (3)

What is known of the past forecasts the running snap t as S_j(t), judged when that snap ends by

    MAE(t) = mean over j of |S_j(t) - C_j(t)|                                                   (8)

Kept of a snap are A = C W = Σ w C_i and B = W. Maps that differ in what they make of the snaps alone, in alpha say,
share them.
"""

from math import ceil
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.agents.mapping import counts, ratio, shape, windows
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario import maps as models

WIDEST = 64  # cells that are worked out together; more no longer fit into registers


class Snaps:
    """The samples of the latest snaps and what they tell of each cell.

    extent: size of the floor [m]. `ended` counts the ended snaps. Number n, from 0 on, has its samples (x [m], y [m],
    C [ppm]) at ``samples[trial, n % kept]``, `taken` of them, and ``weighted[trial, n % depth]`` and `weights` hold A
    [ppm / m^power] and B [1 / m^power], (nx, ny) and on every side `margin` cells of zeros: no cells, no weight.
    """

    def __init__(self, model: models.Snaps, extent: tuple[float, float], trials: int):
        self.cell, self.window, self.power = model.cell, model.window, model.power
        self.min_distance = model.cell / 2 if model.min_distance is None else model.min_distance
        self.extent, self.trials = ti.math.vec2(extent), trials
        self.shape = shape(extent, model.cell)
        self.strip = min(WIDEST, 8 * ceil(self.shape[1] / 8))  # whole registers
        self.ended = 0
        self.time = 0.0  # of the last update [s]
        self.maps: list[SnapMap] = []  # are told when a snap ends
        self.kept, self.depth, self.margin = 1, 1, 0  # what the maps need
        self.samples: Any = None

    @property
    def last(self) -> int:
        """Slot of A and B of the last snap."""
        return (self.ended - 1) % self.depth

    def need(self, kept: int = 1, depth: int = 1, margin: int = 0) -> None:
        """Keep at least so much; before the first update."""
        self.kept, self.depth = max(self.kept, kept), max(self.depth, depth)
        self.margin = max(self.margin, margin)

    def update(self, swarm: Any, t: float, dt: float) -> None:
        """Take in the readings at time t [s], once; the tick that reaches a multiple of the window ends a snap."""
        if self.samples is None:
            self._allocate(swarm.members.shape[1] * (ceil(self.window / dt) + 1))
        elif t <= self.time:
            return  # another map has seen to it
        self.time = t
        before, now = windows(t, self.window, dt)
        while self.ended < before:
            self._close()  # nothing came in since it ended
        _gather(
            self.samples, self.taken, self.ended % self.kept, swarm.members, swarm.team_size,
            swarm.believed_position, swarm.reading, self.extent,
        )  # fmt: skip
        if self.ended < now:
            self._close()

    def _allocate(self, most: int) -> None:
        """Make room for so many samples a snap."""
        self.samples = ti.Vector.field(3, ti.f32, (self.trials, self.kept, most))
        self.taken = ti.field(ti.i32, (self.trials, self.kept))
        rows = self.shape[0] + 2 * self.margin
        columns = -(-self.shape[1] // self.strip) * self.strip + 2 * self.margin
        self.weighted = ti.field(ti.f32, (self.trials, self.depth, rows, columns))
        self.weights = ti.field(ti.f32, (self.trials, self.depth, rows, columns))

    def _close(self) -> None:
        """End the running snap."""
        _interpolate(
            self.strip, int(self.power == 2.0), self.samples, self.taken, self.ended % self.kept, self.cell,
            self.min_distance**2, 0.5 * self.power, self.shape, self.margin, self.ended % self.depth, self.weighted,
            self.weights,
        )  # fmt: skip
        self.ended += 1
        for one in self.maps:
            one.close()
        _forget(self.taken, self.ended % self.kept)


class SnapMap:
    """What is forecast of the running snap, which a subclass makes in `_forecast`, and how far that was off.

    snaps: those of other maps, to share. `errors` holds the MAE of each snap but the first, over the cells that had
    been forecast; NaN where there were none, or no samples.
    """

    def __init__(
        self, model: models.Snaps, extent: tuple[float, float], trials: int, snaps: Snaps | None = None
    ):
        self.snaps = snaps or Snaps(model, extent, trials)
        self.snaps.maps.append(self)
        self.cell, self.window, self.shape = model.cell, model.window, self.snaps.shape
        self.errors: list[tuple[float, np.ndarray]] = []
        self.numerator = ti.field(ti.f32, (trials, *self.shape))  # of S for the running snap
        self.denominator = ti.field(ti.f32, (trials, *self.shape))
        self.mae = ti.field(ti.f32, trials)  # of the last forecast [ppm]

    def estimate(self) -> np.ndarray:
        """S for the running snap [ppm], (trials, nx, ny); NaN where nothing is known."""
        return ratio(self.numerator.to_numpy(), self.denominator.to_numpy())

    def weight(self) -> np.ndarray:
        """The sum of weights behind `estimate`, (trials, nx, ny)."""
        return self.denominator.to_numpy()

    def update(self, swarm: Any, t: float, dt: float) -> None:
        """Take in the readings at time t [s]."""
        self.snaps.update(swarm, t, dt)

    def close(self) -> None:
        """A snap has ended: judge its forecast, then make the next."""
        snaps = self.snaps
        if snaps.ended > 1:
            _judge(
                self.numerator, self.denominator, snaps.weighted, snaps.weights, snaps.last, snaps.margin, self.mae,
            )  # fmt: skip
            self.errors.append((snaps.ended * self.window, self.mae.to_numpy()))
        self._forecast()

    def _forecast(self) -> None:
        """Write both sums of S for the snap after the one that has ended."""
        raise NotImplementedError


@ti.kernel
def _gather(
    samples: Template, taken: Template, slot: int, members: Template, team_size: Template, position: Template,
    reading: Template, extent: ti.math.vec2,
):  # fmt: skip
    """Note one sample of every robot in its trial's running snap."""
    for k in team_size:
        n = taken[k, slot]
        for m in range(team_size[k]):
            robot = members[k, m]
            if counts(reading[robot], position[robot], extent):
                if n < samples.shape[2]:
                    samples[k, slot, n] = ti.Vector([position[robot][0], position[robot][1], reading[robot]])
                    n += 1
        taken[k, slot] = n


@ti.kernel
def _forget(taken: Template, slot: int):
    for k in range(taken.shape[0]):
        taken[k, slot] = 0


@ti.kernel
def _interpolate(
    strip: Template, squared: Template, samples: Template, taken: Template, slot: int, cell: float, least: float,
    half_power: float, shape: Template, margin: Template, kept: int, weighted: Template, weights: Template,
):  # fmt: skip
    """The sums A and B of a snap, kept in that slot, along y in strips that fit into registers; least: shortest
    distance² [m²].
    """
    nx, ny = ti.static(shape[0], shape[1])
    for k, i, part in ti.ndrange(weights.shape[0], nx, (ny + strip - 1) // strip):
        first = part * strip
        a = ti.Vector([0.0] * strip)
        b = ti.Vector([0.0] * strip)
        for n in range(taken[k, slot]):
            sample = samples[k, slot, n]
            dx = (i + 0.5) * cell - sample[0]
            begin = (first + 0.5) * cell - sample[1]
            for s in range(strip):
                dy = begin + s * cell
                r2 = ti.max(dx * dx + dy * dy, least)
                w = 0.0
                if ti.static(squared):
                    w = 1.0 / r2
                else:
                    w = r2**-half_power
                a[s] += w * sample[2]
                b[s] += w
        for s in range(ti.min(strip, ny - first)):
            weighted[k, kept, margin + i, margin + first + s] = a[s]
            weights[k, kept, margin + i, margin + first + s] = b[s]


@ti.kernel
def _judge(
    numerator: Template, denominator: Template, weighted: Template, weights: Template, slot: int, margin: Template,
    mae: Template,
):  # fmt: skip
    """Eq 8 for each trial, over the cells that both know; not a number where there are none."""
    for k in mae:
        total = 0.0
        cells = 0
        for i in range(numerator.shape[1]):
            row = 0.0  # apart, or rounding would add up
            for j in range(numerator.shape[2]):
                W = weights[k, slot, margin + i, margin + j]
                if denominator[k, i, j] > 0.0 and W > 0.0:
                    C = weighted[k, slot, margin + i, margin + j] / W
                    row += ti.abs(numerator[k, i, j] / denominator[k, i, j] - C)
                    cells += 1
            total += row
        mae[k] = ti.select(cells > 0, total / ti.max(cells, 1), ti.math.nan)
