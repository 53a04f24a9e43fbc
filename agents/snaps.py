"""Maps made of snaps: what `time_series` and `inverse_distance` share.

Marjovi & Marques, "Multi-Robot Odor Distribution Mapping in Realistic Time-Variant Conditions", ICRA 2014, with its
equation numbers. Time is cut into snaps of `window` seconds. In snap k the samples (x_i, C_i) of all robots of a trial,
at the places x_i where they believe to be, give in cell j

    w_ij = max(|x_j - x_i|, min_distance)^-power                                                (2)
    C_j(k) = Σ_i w_ij C_i / Σ_i w_ij,      W_j(k) = Σ_i w_ij                                    (1) (3)

What is known of the past forecasts the running snap t as S_j(t), judged when that snap ends by

    MAE(t) = mean over j of |S_j(t) - C_j(t)|                                                   (8)

Kept of a snap are A = C W = Σ w C_i and B = W.
"""

from math import ceil
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume import map_models as models
from taichi_plume.agents.mapping import counts, ratio, shape
from taichi_plume.kernels import Template

WIDEST = 64  # cells that are worked out together; more no longer fit into registers


class SnapMap:
    """Snaps, their interpolation, and the error of the forecast, which a subclass makes in `_forecast`.

    extent: size of the floor [m]. `snaps` counts the ended snaps; `errors` holds the MAE of each but the first, over
    the cells that had been forecast; NaN where there were none, or no samples.
    """

    kept = 1
    """Snaps whose samples are kept, with the running one."""

    def __init__(
        self,
        model: models.TimeSeriesMap | models.InverseDistanceMap,
        extent: tuple[float, float],
        trials: int,
    ):
        self.model, self.cell, self.window, self.power = model, model.cell, model.window, model.power
        self.min_distance = model.cell / 2 if model.min_distance is None else model.min_distance
        self.extent = ti.math.vec2(extent)
        self.shape = shape(extent, model.cell)
        self.strip = min(WIDEST, 8 * ceil(self.shape[1] / 8))  # whole registers
        self.trials = trials
        self.snaps = 0
        self.errors: list[tuple[float, np.ndarray]] = []
        cells = (trials, *self.shape)
        self.weighted = ti.field(ti.f32, cells)  # A of the last snap [ppm / m^power]
        self.weights = ti.field(ti.f32, cells)  # B [1 / m^power]
        self.numerator = ti.field(ti.f32, cells)  # of S for the running snap
        self.denominator = ti.field(ti.f32, cells)
        self.mae = ti.field(ti.f32, trials)  # of the last forecast [ppm]
        self.samples: Any = None  # (x [m], y [m], C [ppm]) of snap n, from 0 on, at [trial, n % kept]
        self.taken = ti.field(ti.i32, (trials, self.kept))

    def estimate(self) -> np.ndarray:
        """S for the running snap [ppm], (trials, nx, ny); NaN where nothing is known."""
        return ratio(self.numerator.to_numpy(), self.denominator.to_numpy())

    def weight(self) -> np.ndarray:
        """The sum of weights behind `estimate`, (trials, nx, ny)."""
        return self.denominator.to_numpy()

    def update(self, swarm: Any, t: float, dt: float) -> None:
        """Take in the readings at time t [s]; the tick that reaches a multiple of the window ends a snap."""
        if self.samples is None:
            most = swarm.members.shape[1] * (ceil(self.window / dt) + 1)
            self.samples = ti.Vector.field(3, ti.f32, (self.trials, self.kept, most))
        slack = 1e-6 * dt  # t carries rounding
        while self.snaps < ceil((t - slack) / self.window) - 1:
            self._close()  # nothing came in since it ended
        _gather(
            self.samples, self.taken, self.snaps % self.kept, swarm.members, swarm.team_size,
            swarm.believed_position, swarm.reading, self.extent,
        )  # fmt: skip
        while self.snaps < int((t + slack) / self.window):
            self._close()

    def _close(self) -> None:
        """End the running snap: judge its forecast, then make the next."""
        _interpolate(
            self.strip, int(self.power == 2.0), self.samples, self.taken, self.snaps % self.kept, self.cell,
            self.min_distance**2, 0.5 * self.power, self.weighted, self.weights,
        )  # fmt: skip
        if self.snaps > 0:
            _judge(self.numerator, self.denominator, self.weighted, self.weights, self.mae)
            self.errors.append(((self.snaps + 1) * self.window, self.mae.to_numpy()))
        self._forecast()
        self.snaps += 1
        _forget(self.taken, self.snaps % self.kept)

    def _forecast(self) -> None:
        """Write both sums of S for the snap after number `snaps`, which has just ended."""
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
    half_power: float, weighted: Template, weights: Template,
):  # fmt: skip
    """The sums A and B of a snap, along y in strips that fit into registers; least: shortest distance² [m²]."""
    nx, ny = ti.static(weights.shape[1], weights.shape[2])
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
            weighted[k, i, first + s] = a[s]
            weights[k, i, first + s] = b[s]


@ti.kernel
def _judge(numerator: Template, denominator: Template, weighted: Template, weights: Template, mae: Template):
    """Eq 8 for each trial, over the cells that both know; not a number where there are none."""
    for k in mae:
        total = 0.0
        cells = 0
        for i in range(weights.shape[1]):
            row = 0.0  # apart, or rounding would add up
            for j in range(weights.shape[2]):
                if denominator[k, i, j] > 0.0 and weights[k, i, j] > 0.0:
                    row += ti.abs(
                        numerator[k, i, j] / denominator[k, i, j] - weighted[k, i, j] / weights[k, i, j]
                    )
                    cells += 1
            total += row
        mae[k] = ti.select(cells > 0, total / ti.max(cells, 1), ti.math.nan)
