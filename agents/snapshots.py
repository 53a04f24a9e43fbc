"""Gas maps from snapshots of time windows: inverse distance weighting, and the base class of `time_series`.

Marjovi & Marques, "Multi-Robot Odor Distribution Mapping in Realistic Time-Variant Conditions", ICRA 2014, with its
equation numbers. Time is cut into snapshots of `window` seconds. In snapshot k the samples (x_i, C_i) of all robots
of a trial, or with `samples: newest` the last one of each, at believed positions x_i, give in cell j

    w_ij = max(|x_j - x_i|, min_distance)^-power                                                (2)
    C_j(k) = Σ_i w_ij C_i / Σ_i w_ij,      W_j(k) = Σ_i w_ij                                    (1) (3)

The past forecasts the running snapshot t as S_j(t), judged at its end by

    MAE(t) = mean over j of |S_j(t) - C_j(t)|                                                   (8)

A snapshot stores A = C W = Σ w C_i and B = W. Maps with equal snapshots share them.
"""

from dataclasses import dataclass
from math import ceil, inf
from typing import Self

import numpy as np

from taichi_plume.agents.gas_map import Floor, GasMap, Readers, counts, ratio, shape, window_of, windows
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario import maps as models

WIDEST = 64  # cells computed together; more cells do not fit into registers


@dataclass
class Needs:
    """Storage that maps with shared snapshots need: number of snapshots with samples (`sampled`) and with cells
    (`depth`), and number of additional cells on each side of the map (`margin`).
    """

    sampled: int = 1
    depth: int = 1
    margin: int = 0
    snapshots: "Snapshots | None" = None
    """The shared `Snapshots`, once a map uses them."""

    def add(self, other: "Needs") -> None:
        """Extend the storage to that which another map needs too."""
        self.sampled, self.depth = max(self.sampled, other.sampled), max(self.depth, other.depth)
        self.margin = max(self.margin, other.margin)


def alike(model: models.SnapshotMap) -> tuple:
    """Return a key that is equal for map sections whose snapshots are equal, so that their maps can share snapshots."""
    return "snaps", model.cell, model.window, model.power, model.min_distance, model.samples, model.robot


class Snapshots:
    """Samples of the latest snapshots (time windows) and their interpolation to the cells.

    `ended` counts the ended snapshots. Snapshot n, from 0 on, has its samples (x [m], y [m], C [ppm]) at
    ``samples[trial, n % kept]``, `taken` of them; `place` is the index of each robot's newest sample in the running
    snapshot, -1 without, if only these count. ``weighted[trial, n % depth]`` and `weights` hold its A [ppm /
    m^power] and B [1 / m^power], (nx, ny) with `margin` cells of zeros on every side.
    """

    STATE = ("samples", "taken", "place", "weighted", "weights", "ended", "time")

    def __init__(self, model: models.SnapshotMap, floor: Floor, needs: Needs):
        self.cell, self.window, self.power = model.cell, model.window, model.power
        self.min_distance = model.least_distance
        self.extent = ti.math.vec2(floor.extent)
        self.shape = shape(floor.extent, model.cell)
        self.strip = min(WIDEST, 8 * ceil(self.shape[1] / 8))  # whole registers
        self.kept, self.depth, self.margin = needs.sampled, needs.depth, needs.margin
        self.maps: list[SnapMap] = []  # maps to update at the end of a snapshot
        self.newest = model.samples == "newest"
        trials, each = floor.trials, 1 if self.newest else ceil(model.window / floor.tick) + 1
        most = floor.robots * each
        self.samples = ti.vector_field(3, ti.f32, (trials, self.kept, most))
        self.taken = ti.field(ti.i32, (trials, self.kept))
        self.place = ti.filled(np.full(trials * floor.robots if self.newest else 1, -1))
        rows = self.shape[0] + 2 * self.margin
        columns = -(-self.shape[1] // self.strip) * self.strip + 2 * self.margin
        self.weighted = ti.field(ti.f32, (trials, self.depth, rows, columns))
        self.weights = ti.field(ti.f32, (trials, self.depth, rows, columns))
        self.ended = 0
        self.time = -inf  # time of the last update [s]

    @property
    def last(self) -> int:
        """Index of the last ended snapshot in the ring buffers of A and B."""
        return (self.ended - 1) % self.depth

    def last_cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Return A and B of the last ended snapshot, (trials, nx, ny)."""
        cells = tuple(slice(self.margin, self.margin + n) for n in self.shape)
        return self.weighted.values[:, self.last, *cells], self.weights.values[:, self.last, *cells]

    def update(self, swarm: Readers, t: float, dt: float) -> None:
        """Add the readings at time t [s], once; a snapshot (time window) ends if t reaches a multiple of its length."""
        if t <= self.time:
            return  # done for another map
        self.time = t
        before, now = windows(t, self.window, dt)
        while self.ended < before:
            self._close()  # no readings since the snapshot ended
        _gather(
            int(self.newest), self.samples, self.taken, self.place, self.ended % self.kept, swarm.members,
            swarm.team_size,
            swarm.believed_position, swarm.reading, self.extent,
        )  # fmt: skip
        if self.ended < now:
            self._close()

    def _close(self) -> None:
        """End the running snapshot: interpolate its samples to the cells, and update the maps."""
        _interpolate(
            self.strip, int(self.power == 2.0), self.samples, self.taken, self.ended % self.kept, self.cell,
            self.min_distance**2, 0.5 * self.power, self.shape, self.margin, self.ended % self.depth, self.weighted,
            self.weights,
        )  # fmt: skip
        self.ended += 1
        for gas_map in self.maps:
            gas_map.close()
        self.taken[:, self.ended % self.kept] = 0
        if self.newest:
            self.place.fill(-1)


class SnapMap(GasMap):
    """Base class of gas maps that forecast the running snapshot, and measure the error of the forecast.

    A subclass writes both sums of S for the next snapshot in `_forecast()`, and returns `remembered` for readings of
    `lag` snapshots ago, 1 for the last one, in `remembered_of(lag, place)`. snapshots: snapshots to share with other
    maps. `errors` holds the MAE of each snapshot but the first, over the forecast cells; NaN without forecast or
    samples.
    """

    STATE = ("errors", "snaps", "numerator", "denominator")

    def __init__(self, model: models.SnapshotMap, floor: Floor, snapshots: Snapshots | None = None):
        super().__init__(model.cell, floor)
        self.snaps = snapshots or Snapshots(model, floor, self.needs(model, floor))
        self.snaps.maps.append(self)
        self.window = model.window
        self.numerator = ti.field(ti.f32, (floor.trials, *self.shape))  # sums of S for the running snapshot
        self.denominator = ti.field(ti.f32, (floor.trials, *self.shape))
        self.mae = ti.field(ti.f32, floor.trials)  # error of the last forecast [ppm]

    @classmethod
    def needs(cls, model: models.SnapshotMap, floor: Floor) -> Needs:
        """Return the storage that the map of `model` needs: by default the last snapshot only."""
        return Needs()

    @classmethod
    def reserve(cls, model: models.SnapshotMap, floor: Floor, shared: dict) -> None:
        shared.setdefault(alike(model), Needs()).add(cls.needs(model, floor))

    @classmethod
    def made(cls, model: models.SnapshotMap, floor: Floor, shared: dict) -> Self:
        needs = shared[alike(model)]
        needs.snapshots = needs.snapshots or Snapshots(model, floor, needs)
        return cls(model, floor, needs.snapshots)

    def estimate(self) -> np.ndarray:
        """Return the forecast S of the running snapshot [ppm], (trials, nx, ny); NaN in unknown cells."""
        return ratio(self.numerator.values, self.denominator.values)

    def weight(self) -> np.ndarray:
        """Return the sum of weights of the readings behind `estimate`, (trials, nx, ny)."""
        return self.denominator.to_numpy()

    def update(self, swarm: Readers, t: float, dt: float) -> None:
        self.snaps.update(swarm, t, dt)

    def remembered(self, t: np.ndarray, place: np.ndarray, dt: float) -> np.ndarray:
        """Return the result of `GasMap.remembered`; readings of the running snapshot count as those of the last one."""
        lag = np.maximum(self.snaps.ended - window_of(t, self.snaps.window, dt), 1)
        return self.remembered_of(lag, place)

    def close(self) -> None:
        """Record the error of the forecast for the snapshot that has just ended, then compute the next forecast."""
        snapshots = self.snaps
        if snapshots.ended > 1:
            _forecast_mae(
                self.numerator, self.denominator, snapshots.weighted, snapshots.weights, snapshots.last,
                snapshots.margin, self.mae,
            )  # fmt: skip
            self.errors.append((snapshots.ended * snapshots.window, self.mae.to_numpy()))
        self._forecast()


class InverseDistanceMap(SnapMap):
    """Gas map by inverse distance weighting of the last snapshot alone, S(t) = C(t - 1), a baseline."""

    def remembered_of(self, lag: np.ndarray, place: np.ndarray) -> np.ndarray:
        return np.where(lag == 1, 1.0, 0.0)

    def _forecast(self) -> None:
        weighted, weights = self.snaps.last_cells()
        self.numerator.from_numpy(weighted)
        self.denominator.from_numpy(weights)


@ti.kernel
def _gather(
    newest: Template, samples: Template, taken: Template, place: Template, slot: int, members: Template,
    team_size: Template, position: Template, reading: Template, extent: ti.math.vec2,
):  # fmt: skip
    """Append a sample of every robot with a valid reading to the running snapshot of its trial.

    newest: 1 if the sample replaces an earlier one of the robot, at the index `place`.
    """
    ti.loop_config(serialize=ti.static(runs_serially(team_size.shape[0])))
    for k in range(team_size.shape[0]):
        n = taken[k, slot]
        for m in range(team_size[k]):
            robot = members[k, m]
            if counts(reading[robot], position[robot], extent):
                at = n
                if ti.static(newest):
                    at = ti.select(place[robot] < 0, n, place[robot])
                    place[robot] = at
                if at < samples.shape[2]:
                    samples[k, slot, at] = ti.Vector([position[robot][0], position[robot][1], reading[robot]])
                    n = ti.max(n, at + 1)
        taken[k, slot] = n


@ti.kernel
def _interpolate(
    strip: Template, squared: Template, samples: Template, taken: Template, slot: int, cell: float, least: float,
    half_power: float, shape: Template, margin: Template, place: int, weighted: Template, weights: Template,
):  # fmt: skip
    """Compute A and B of a snapshot from its samples, along y in strips that fit into registers; slot, place: its
    indices in the ring buffers of samples and cells; least: lower bound of squared distances [m²].
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
            weighted[k, place, margin + i, margin + first + s] = a[s]
            weights[k, place, margin + i, margin + first + s] = b[s]


@ti.kernel
def _forecast_mae(
    numerator: Template, denominator: Template, weighted: Template, weights: Template, slot: int, margin: Template,
    mae: Template,
):  # fmt: skip
    """Compute the MAE of eq 8 for each trial, over cells known to forecast and snapshot; NaN without such cells."""
    for k in range(mae.shape[0]):
        total = 0.0
        cells = 0
        for i in range(numerator.shape[1]):
            row = 0.0  # separate sums, or rounding would add up
            for j in range(numerator.shape[2]):
                W = weights[k, slot, margin + i, margin + j]
                if denominator[k, i, j] > 0.0 and W > 0.0:
                    C = weighted[k, slot, margin + i, margin + j] / W
                    row += ti.abs(numerator[k, i, j] / denominator[k, i, j] - C)
                    cells += 1
            total += row
        mae[k] = ti.select(cells > 0, total / ti.max(cells, 1), ti.math.nan)
