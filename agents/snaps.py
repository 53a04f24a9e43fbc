"""Maps made of snaps: what `time_series` and `inverse_distance` share.

Marjovi & Marques, "Multi-Robot Odor Distribution Mapping in Realistic Time-Variant Conditions", ICRA 2014,
with its equation numbers. Time is cut into snaps of `window` seconds. In snap k the samples (x_i, C_i) of all
robots of a trial, at the places x_i where they believe to be, give in cell j

    w_ij = max(|x_j - x_i|, min_distance)^-power                                                (2)
    C_j(k) = Σ_i w_ij C_i / Σ_i w_ij,      W_j(k) = Σ_i w_ij                                    (1) (3)

and the past snaps forecast the next one, t, from the neighbourhood N_j in space and time (i: cells),

    Dist = α |x_j - x_i| + (1 - α) T,      T = 0.1 (t - k) window       (in m and s)            (4)
    N_j = {(i, k): Dist < β, k < t},       U = 1 / Dist                                         (5) (7)
    S_j(t) = Σ_N C W U / Σ_N W U                                                                (6)
    MAE(t) = mean over j of |S_j(t) - C_j(t)|                                                   (8)

Kept per snap are A = C W = Σ w C_i and B = W. N_j is the same for every cell, so it is a list of (lag,
offset, U), made once; the snaps it reaches back to live in a ring buffer. T >= 0.1 window, so that U is never
infinite.
"""

from math import ceil

import numpy as np
import taichi as ti

from taichi_plume import map_models as models
from taichi_plume.agents.mapping import counts, ratio, shape
from taichi_plume.agents.swarm import Swarm
from taichi_plume.kernels import Template

Stencil = list[tuple[int, int, int, float]]
"""(lag in snaps, offset in cells along x and y, weight) of each member of a cell's neighbourhood."""


class SnapMap:
    """What both maps share: snaps, interpolation, forecast from a neighbourhood, and its error.

    extent: size of the floor [m], covered by nx × ny cells of edge `cell` [m] from the origin on. Axis 0 of
    every array is the trial. `snaps` counts the closed snaps; `errors` holds (time [s], MAE [ppm] (trials,))
    of each but the first, over the cells that had been forecast; NaN where there were none, or no samples.
    """

    def __init__(
        self,
        model: models.TimeSeriesMap | models.InverseDistanceMap,
        extent: tuple[float, float],
        trials: int,
        neighbours: Stencil,
    ):
        self.model, self.cell, self.window, self.power = model, model.cell, model.window, model.power
        self.min_distance = model.cell / 2 if model.min_distance is None else model.min_distance
        self.extent = ti.math.vec2(extent)
        self.shape = shape(extent, model.cell)
        self.snaps = 0
        self.errors: list[tuple[float, np.ndarray]] = []
        self.depth = 1 + max(lag for lag, *_ in neighbours)  # the running snap and those the forecast needs
        # Ring buffer over snaps: snap n (from 0 on) has slot n % depth.
        self.weighted = ti.field(ti.f32, (trials, self.depth, *self.shape))  # A [ppm / m^power]
        self.weights = ti.field(ti.f32, (trials, self.depth, *self.shape))  # B [1 / m^power]
        self.numerator = ti.field(ti.f32, (trials, *self.shape))  # of S for the running snap
        self.denominator = ti.field(ti.f32, (trials, *self.shape))
        self.offsets = ti.Vector.field(3, ti.i32, len(neighbours))
        self.closeness = ti.field(ti.f32, len(neighbours))
        self.offsets.from_numpy(np.array([entry[:3] for entry in neighbours], np.int32))
        self.closeness.from_numpy(np.array([entry[3] for entry in neighbours], np.float32))

    def estimate(self) -> np.ndarray:
        """S for the running snap [ppm], (trials, nx, ny); NaN where nothing is known."""
        return ratio(self.numerator.to_numpy(), self.denominator.to_numpy())

    def weight(self) -> np.ndarray:
        """Σ W U, the weight behind `estimate`, (trials, nx, ny)."""
        return self.denominator.to_numpy()

    def update(self, swarm: Swarm, tick: int, t: float, dt: float) -> None:
        """Take in the readings at time t [s]; the tick that reaches a multiple of the window ends a snap."""
        slack = 1e-6 * dt  # t carries rounding
        while self.snaps < ceil((t - slack) / self.window) - 1:
            self._close()  # nothing came in since it ended
        _accumulate(
            self.weighted, self.weights, self.snaps % self.depth, swarm.members, swarm.team_size,
            swarm.believed_position, swarm.reading, self.extent, self.cell, self.power, self.min_distance,
        )  # fmt: skip
        while self.snaps < int((t + slack) / self.window):
            self._close()

    def _close(self) -> None:
        """End the running snap: judge its forecast, then make the next."""
        slot = self.snaps % self.depth
        if self.snaps > 0:
            truth = ratio(self.weighted.to_numpy()[:, slot], self.weights.to_numpy()[:, slot])
            deviation = np.abs(self.estimate() - truth)
            known = np.isfinite(deviation)
            mae = ratio(np.where(known, deviation, 0.0).sum(axis=(1, 2)), known.sum(axis=(1, 2)))
            self.errors.append(((self.snaps + 1) * self.window, mae))
        self.snaps += 1
        _clear(self.weighted, self.weights, self.snaps % self.depth)
        _forecast(
            self.weighted, self.weights, self.snaps, self.depth, self.offsets, self.closeness,
            self.numerator, self.denominator,
        )  # fmt: skip


@ti.kernel
def _accumulate(
    weighted: Template, weights: Template, slot: int, members: Template, team_size: Template,
    position: Template, reading: Template, extent: ti.math.vec2, cell: float, power: float, min_distance: float,
):  # fmt: skip
    """Add one sample of every robot to the sums A and B of its trial's running snap."""
    for k, i, j in ti.ndrange(weights.shape[0], weights.shape[2], weights.shape[3]):
        center = (ti.Vector([i, j]) + 0.5) * cell
        a = weighted[k, slot, i, j]
        b = weights[k, slot, i, j]
        for m in range(team_size[k]):
            robot = members[k, m]
            if counts(reading[robot], position[robot], extent):
                w = ti.max((position[robot] - center).norm(), min_distance) ** -power
                a += w * reading[robot]
                b += w
        weighted[k, slot, i, j] = a
        weights[k, slot, i, j] = b


@ti.kernel
def _clear(weighted: Template, weights: Template, slot: int):
    for k, i, j in ti.ndrange(weights.shape[0], weights.shape[2], weights.shape[3]):
        weighted[k, slot, i, j] = 0.0
        weights[k, slot, i, j] = 0.0


@ti.kernel
def _forecast(
    weighted: Template, weights: Template, snap: int, depth: int, offsets: Template, closeness: Template,
    numerator: Template, denominator: Template,
):  # fmt: skip
    """Both sums of eq 6 for snap number `snap`; cells beyond the edge contribute nothing."""
    for k, i, j in numerator:
        a = 0.0
        b = 0.0
        for n in range(closeness.shape[0]):
            lag, x, y = offsets[n][0], i + offsets[n][1], j + offsets[n][2]
            if lag <= snap and 0 <= x < numerator.shape[1] and 0 <= y < numerator.shape[2]:
                slot = (snap - lag) % depth
                a += closeness[n] * weighted[k, slot, x, y]
                b += closeness[n] * weights[k, slot, x, y]
        numerator[k, i, j] = a
        denominator[k, i, j] = b
