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

from dataclasses import dataclass
from math import ceil, inf
from typing import Any, Self

import numpy as np
import taichi as ti

from taichi_plume.agents.few import few
from taichi_plume.agents.gas_map import Floor, GasMap, Readers, counts, ratio, shape, window_of, windows
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.transfer import reader
from taichi_plume.scenario import maps as models

WIDEST = 64  # cells that are worked out together; more no longer fit into registers


@dataclass
class Needs:
    """What the maps that share snaps need: how many snaps' samples, how many snaps' cells, and cells around the map."""

    kept: int = 1
    depth: int = 1
    margin: int = 0
    snaps: "Snaps | None" = None
    """The snaps, once a map has been made of them."""

    def add(self, other: "Needs") -> None:
        """Fit those of another map too."""
        self.kept, self.depth = max(self.kept, other.kept), max(self.depth, other.depth)
        self.margin = max(self.margin, other.margin)


def alike(model: models.Snaps) -> tuple:
    """The same for the models of maps whose snaps are the same."""
    return "snaps", model.cell, model.window, model.power, model.min_distance


class Snaps:
    """The samples of the latest snaps and what they tell of each cell.

    `ended` counts the ended snaps. Number n, from 0 on, has its samples (x [m], y [m], C [ppm]) at
    ``samples[trial, n % kept]``, `taken` of them, and ``weighted[trial, n % depth]`` and `weights` hold A
    [ppm / m^power] and B [1 / m^power], (nx, ny) and on every side `margin` cells of zeros: no cells, no weight.
    """

    STATE = ("samples", "taken", "weighted", "weights", "ended", "time")

    def __init__(self, model: models.Snaps, floor: Floor, needs: Needs):
        self.cell, self.window, self.power = model.cell, model.window, model.power
        self.min_distance = model.cell / 2 if model.min_distance is None else model.min_distance
        self.extent = ti.math.vec2(floor.extent)
        self.shape = shape(floor.extent, model.cell)
        self.strip = min(WIDEST, 8 * ceil(self.shape[1] / 8))  # whole registers
        self.kept, self.depth, self.margin = needs.kept, needs.depth, needs.margin
        self.maps: list[SnapMap] = []  # are told when a snap ends
        trials, most = floor.trials, floor.robots * (ceil(model.window / floor.tick) + 1)
        self.samples = ti.Vector.field(3, ti.f32, (trials, self.kept, most))
        self.taken = ti.field(ti.i32, (trials, self.kept))
        rows = self.shape[0] + 2 * self.margin
        columns = -(-self.shape[1] // self.strip) * self.strip + 2 * self.margin
        self.weighted = ti.field(ti.f32, (trials, self.depth, rows, columns))
        self.weights = ti.field(ti.f32, (trials, self.depth, rows, columns))
        self.begin()

    def begin(self) -> None:
        """Begin a run."""
        self.ended = 0
        self.time = -inf  # of the last update [s]

    @property
    def last(self) -> int:
        """Slot of A and B of the last snap."""
        return (self.ended - 1) % self.depth

    def update(self, swarm: Readers, t: float, dt: float) -> None:
        """Take in the readings at time t [s], once; the tick that reaches a multiple of the window ends a snap."""
        if t <= self.time:
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


class SnapMap(GasMap):
    """What is forecast of the running snap, which a subclass makes in `_forecast`, and how far that was off.

    snaps: those of other maps, to share. `errors` holds the MAE of each snap but the first, over the cells that had
    been forecast; NaN where there were none, or no samples.
    """

    STATE = ("errors", "snaps", "numerator", "denominator")

    def __init__(self, model: models.Snaps, floor: Floor, snaps: Snaps | None = None):
        super().__init__(model.cell, floor)
        self.snaps = snaps or Snaps(model, floor, self.needs(model, floor))
        self.snaps.maps.append(self)
        self.window = model.window
        self.numerator = ti.field(ti.f32, (floor.trials, *self.shape))  # of S for the running snap
        self.denominator = ti.field(ti.f32, (floor.trials, *self.shape))
        self.mae = ti.field(ti.f32, floor.trials)  # of the last forecast [ppm]
        self._sums, self._error = reader(self.numerator, self.denominator), reader(self.mae)
        self.begin(model)

    @classmethod
    def needs(cls, model: Any, floor: Floor) -> Needs:
        """What it needs of snaps: the last one unless a subclass says more."""
        return Needs()

    @classmethod
    def reserve(cls, model: Any, floor: Floor, shared: dict) -> None:
        shared.setdefault(alike(model), Needs()).add(cls.needs(model, floor))

    @classmethod
    def made(cls, model: Any, floor: Floor, shared: dict) -> Self:
        needs = shared[alike(model)]
        needs.snaps = needs.snaps or Snaps(model, floor, needs)
        return cls(model, floor, needs.snaps)

    def begin(self, model: models.Snaps) -> None:
        """Begin a run; no number of the model may have changed, as snaps are shared by them."""
        super().begin(model)
        self.window = model.window
        self.snaps.begin()

    def estimate(self) -> np.ndarray:
        """S for the running snap [ppm], (trials, nx, ny); NaN where nothing is known."""
        return ratio(*self._sums())

    def weight(self) -> np.ndarray:
        """The sum of weights behind `estimate`, (trials, nx, ny)."""
        return self._sums()[1]

    def update(self, swarm: Readers, t: float, dt: float) -> None:
        self.snaps.update(swarm, t, dt)

    def remembered(self, t: np.ndarray, place: np.ndarray, dt: float) -> np.ndarray:
        """See `GasMap`; what the running snap has is as fresh as that of the last."""
        lag = np.maximum(self.snaps.ended - window_of(t, self.snaps.window, dt), 1)
        return self.remembered_of(lag, place)

    def remembered_of(self, lag: np.ndarray, place: np.ndarray) -> np.ndarray:
        """The same of readings that were taken so many snaps ago, the last being 1."""
        raise NotImplementedError

    def close(self) -> None:
        """A snap has ended: judge its forecast, then make the next."""
        snaps = self.snaps
        if snaps.ended > 1:
            _judge(
                self.numerator, self.denominator, snaps.weighted, snaps.weights, snaps.last, snaps.margin, self.mae,
            )  # fmt: skip
            self.errors.append((snaps.ended * snaps.window, self._error()[0]))
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
    ti.loop_config(serialize=ti.static(few(team_size.shape[0])))
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
    ti.loop_config(serialize=ti.static(few(taken.shape[0])))
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
