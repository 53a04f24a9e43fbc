"""Gas map of mean and variance by Gaussian kernels: Kernel DM+V and its variants with time and wind.

Lilienthal, Reggente, Trincavelli, Blanco & Gonzalez, IROS 2009 (DM+V); Asadi et al. 2011 (older readings count less);
Reggente & Lilienthal 2009 (DM+V/W: stretched along the wind). A reading r_i of age s_i, taken at x_i in wind u_i, has
in the cell k around x_k the weight

    K_ik = exp(-s_i / memory - (d_along² / a² + d_across² / b²) / 2),   d = x_k - x_i,   0 beyond 4 (a, b)
    a = sigma + wind_stretch |u_i|,     b = sigma² / a

d is along and across u_i; a = b = sigma without wind. On a map with layers the bracket also has d_z² / sigma², d_z over
the height: a Gaussian in three dimensions, as in the 3-D Kernel DM+V/W of Reggente & Lilienthal, IEEE Sensors 2010. Its
width over the height is sigma in any wind, so that a b sigma is constant: ours. Mean, confidence and variance are

    Ω_k = Σ_i K_ik,                              α_k = 1 - exp(-Ω_k² / σ_Ω²)
    m_k = α_k Σ_i K_ik r_i / Ω_k + (1 - α_k) r0,      r0 = mean of all r_i
    v_k = α_k Σ_i K_ik q_i / Ω_k + (1 - α_k) v0,      v0 = mean of all q_i,      q_i = (r_i - m_k(i))²

where k(i) is the cell of x_i and means are weighted by age too. K is 1 at zero distance: the papers' constant factor is
the same for all readings, as a b = sigma², and is part of σ_Ω.

Ω and Σ K r are stored as sums that fade with time: exact for any length of run. The q_i change with the map: they are
recomputed for the `exact` latest readings of a trial; the q_i of older readings no longer change. Runs with fewer
readings have the exact variance.
"""

from math import exp

import numpy as np

from taichi_plume.agents.gas_map import Floor, GasMap, Readers, cell_of, counts, ratio
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.kernels import STRIP, Template
from taichi_plume.scenario import maps as models

CUT_OFF = 4.0  # reach of a kernel, as a multiple of its width


@ti.dataclass
class Sample:
    """Gas reading [ppm], its position [m] and time [s], and the axes of its kernel, each divided by its width [1/m]."""

    place: ti.math.vec2
    along: ti.math.vec2
    across: ti.math.vec2
    reading: ti.f32
    time: ti.f32


NUMBERS = 8  # entries of a sample


@ti.func
def _row(sample):
    """Return the entries of a Sample as a vector of NUMBERS floats, the inverse of `_sample`."""
    p, a, b = sample.place, sample.along, sample.across
    return ti.Vector([p[0], p[1], a[0], a[1], b[0], b[1], sample.reading, sample.time])


@ti.func
def _sample(row):
    """Return the Sample stored in a vector of NUMBERS floats, the inverse of `_row`."""
    place, along = ti.Vector([row[0], row[1]]), ti.Vector([row[2], row[3]])
    return Sample(place, along, ti.Vector([row[4], row[5]]), row[6], row[7])


class KernelMap(GasMap):
    """Gas map with mean and variance in each cell by Gaussian kernels (Kernel DM+V).

    Reading n of a trial, from 0 on, has slot n % exact in `kept` while among the latest; `left` holds the reading
    replaced by reading n.
    """

    STATE = ("errors", "time", "weights", "weighted", "old", "totals", "kept", "end")
    noise = 0.0
    window: float | None = None

    def __init__(self, model: models.KernelMap, floor: Floor):
        super().__init__(model.cell, floor, model.levels(floor.room))
        self.exact, trials = model.exact, floor.trials
        self.parts = -(-self.shape[1] // STRIP)  # strips of a column of cells
        # sums that grow with the run are in f64, or their rounding would
        self.weights = ti.field(ti.f64, (self.rows, *self.shape))  # Ω
        self.weighted = ti.field(ti.f64, (self.rows, *self.shape))  # Σ K r [ppm]
        self.old = ti.field(ti.f64, (self.rows, *self.shape))  # Σ K q of readings without a slot [ppm²]
        self.squares = ti.field(ti.f32, (self.rows, *self.shape))  # Σ K q of all readings [ppm²]
        # Σ of the weights of age, times 1, r, and q of the readings without a slot
        self.totals = ti.field(ti.f64, (trials, 3))
        self.kept = ti.vector_field(NUMBERS, ti.f32, (trials, self.exact))
        self.left = ti.vector_field(NUMBERS, ti.f32, (trials, self.exact))
        if self.levels:
            self.STATE = (*self.STATE, "kept_height")
            self.kept_height, self.left_height = (ti.field(ti.f32, (trials, self.exact)) for _ in range(2))
        self.deviation = ti.field(ti.f32, (trials, self.exact))  # q times the weight of its age [ppm²]
        self.fresh: Field = ti.field(ti.i32, trials)  # number of the first new reading
        self.end: Field = ti.field(ti.i32, trials)
        self.fading = 0.0 if model.memory is None else 1.0 / model.memory  # 1/s
        self.time = 0.0  # time of the last update [s]
        self._sigma, self._sigma2 = ti.filled(model.sigma), ti.filled(model.sigma**2)
        self._sigma_omega, self.sigma_omega = ti.filled(model.sigma_omega), model.sigma_omega
        self._wind_stretch, self._fading = ti.filled(model.wind_stretch), ti.filled(self.fading)

    def update(self, swarm: Readers, t: float, dt: float) -> None:
        fade = exp(-self.fading * (t - self.time))
        self.time = t
        for first in range(
            0, swarm.members.shape[1], self.exact
        ):  # at most as many at once as there are slots
            self._take_in(swarm, first, t, fade if first == 0 else 1.0)

    def estimate(self) -> np.ndarray:
        """Return the mean gas map [ppm], (trials, nx, ny); NaN in cells beyond the reach of every reading."""
        totals = self.totals.values
        return self._blend(self.weighted, ratio(totals[:, 1], totals[:, 0]))

    def variance(self) -> np.ndarray:
        """Return the variance of readings about the mean gas map [ppm²], (trials, nx, ny); NaN in cells beyond the
        reach of every reading.
        """
        self._update_deviations(self.time)
        totals, deviation = self.totals.values, self.deviation.values
        prior = ratio(totals[:, 2] + deviation.sum(axis=1, dtype=float), totals[:, 0])
        return self._blend(self.squares, prior)

    def remembered(self, t: np.ndarray, place: np.ndarray, dt: float) -> np.ndarray:
        return np.exp(-self.fading * (self.time - t))

    def weight(self) -> np.ndarray:
        """Return the confidence α of each cell's mean, from 0 to 1, (trials, nx, ny)."""
        return -np.expm1(-((self.by_trial(self.weights.values) / self.sigma_omega) ** 2))

    def _blend(self, sums: Field, prior: np.ndarray) -> np.ndarray:
        """Return local means sums / weights, blended by confidence with `prior` (trials,), the mean of all readings."""
        trust = self.weight()
        local = self.by_trial(ratio(sums.values, self.weights.values))
        return trust * local + (1.0 - trust) * prior.reshape(-1, *[1] * (trust.ndim - 1))

    @ti.kernel
    def _take_in(self, swarm: Template, first: int, t: float, fade: ti.f64):
        """Fade all weights by the factor `fade`, and add the readings of each trial's robots from index `first` on."""
        ti.loop_config(serialize=ti.static(runs_serially(self.fresh.shape[0])))
        for k in range(self.fresh.shape[0]):
            for m in ti.static(range(3)):
                self.totals[k, m] *= fade
            n = self.end[k]
            self.fresh[k] = n
            for m in range(first, ti.min(swarm.team_size[k], first + self.exact)):
                i = swarm.members[k, m]
                z = self.height(swarm, i)
                if counts(swarm.reading[i], swarm.believed_position[i], self.extent) and self.on_layers(z):
                    slot = n % self.exact
                    if n >= self.exact:
                        left = _sample(self.kept[k, slot])
                        q = self._weight_of_age(left, t) * self._deviation(
                            k, left, self._kept_height(k, slot)
                        )
                        self.left[k, slot] = self.kept[k, slot]
                        if ti.static(self.layered):
                            self.left_height[k, slot] = self.kept_height[k, slot]
                        self.deviation[k, slot] = q
                        self.totals[k, 2] += q
                    self.kept[k, slot] = _row(self._taken(swarm, i, t))
                    if ti.static(self.layered):
                        self.kept_height[k, slot] = z
                    n += 1
            self.end[k] = n
            for at in range(self.fresh[k], n):  # after all replaced readings were compared with the same map
                self.totals[k, 0] += 1.0
                self.totals[k, 1] += _sample(self.kept[k, at % self.exact]).reading
        strips = ti.static(self.weights.shape[0] * self.shape[0] * self.parts)
        ti.loop_config(serialize=ti.static(runs_serially(4 * strips)))
        for row, x, part in ti.ndrange(self.weights.shape[0], self.shape[0], self.parts):
            k, y0 = self.trial(row), part * STRIP
            weights = ti.Vector([0.0] * STRIP)
            weighted = ti.Vector([0.0] * STRIP)
            old = ti.Vector([0.0] * STRIP)
            for n in range(self.fresh[k], self.end[k]):
                slot = n % self.exact
                sample = _sample(self.kept[k, slot])
                apart = self._layers_apart(row, self._kept_height(k, slot))
                for s in range(STRIP):
                    w = self._kernel(sample, x, y0 + s, apart)
                    weights[s] += w
                    weighted[s] += w * sample.reading
                if n >= self.exact:
                    left = _sample(self.left[k, slot])
                    deviation = self.deviation[k, slot]
                    if ti.static(self.layered):
                        apart = self._layers_apart(row, self.left_height[k, slot])
                    for s in range(STRIP):
                        old[s] += self._kernel(left, x, y0 + s, apart) * deviation
            for s in range(ti.min(STRIP, self.shape[1] - y0)):
                y = y0 + s
                self.weights[row, x, y] = fade * self.weights[row, x, y] + weights[s]
                self.weighted[row, x, y] = fade * self.weighted[row, x, y] + weighted[s]
                self.old[row, x, y] = fade * self.old[row, x, y] + old[s]

    @ti.kernel
    def _update_deviations(self, t: float):
        """Recompute the squared deviations q of the readings in slots, and Σ K q in each cell; t: present time [s]."""
        for k, slot in ti.ndrange(*self.deviation.shape):
            self.deviation[k, slot] = 0.0
            if slot < self.end[k]:
                sample = _sample(self.kept[k, slot])
                q = self._deviation(k, sample, self._kept_height(k, slot))
                self.deviation[k, slot] = self._weight_of_age(sample, t) * q
        for row, x, part in ti.ndrange(self.squares.shape[0], self.shape[0], self.parts):
            k, y0 = self.trial(row), part * STRIP
            total = ti.Vector([0.0] * STRIP)
            for slot in range(ti.min(self.end[k], self.exact)):
                sample = _sample(self.kept[k, slot])
                deviation = self.deviation[k, slot]
                apart = self._layers_apart(row, self._kept_height(k, slot))
                for s in range(STRIP):
                    total[s] += self._kernel(sample, x, y0 + s, apart) * deviation
            for s in range(ti.min(STRIP, self.shape[1] - y0)):
                self.squares[row, x, y0 + s] = self.old[row, x, y0 + s] + total[s]

    @ti.func
    def _taken(self, swarm: Template, i, t):
        """Return the reading of robot i at time t [s] as a Sample, its kernel stretched along the wind."""
        along = ti.Vector([1.0, 0.0])
        width = self._sigma[None]
        if self._wind_stretch[None] > 0.0:
            wind = swarm.wind[i]
            speed = wind.norm()
            if swarm.wind_known[i] == 1 and speed > 0.0:
                along = wind / speed
                width += self._wind_stretch[None] * speed
        across = ti.Vector([-along[1], along[0]]) * width / self._sigma2[None]
        return Sample(swarm.believed_position[i], along / width, across, swarm.reading[i], t)

    @ti.func
    def _kept_height(self, k, slot):
        """Return the height [m] of the sample in a slot; 0 on a map of the floor."""
        z = 0.0
        if ti.static(self.layered):
            z = self.kept_height[k, slot]
        return z

    @ti.func
    def _layers_apart(self, row, z):
        """Return d_z² / sigma² from the height z [m] to the middle of the layer of a row; 0 on the floor."""
        apart = 0.0
        if ti.static(self.layered):
            middle = self.low + (row % self.depth + 0.5) * self.layer
            apart = (middle - z) ** 2 / self._sigma2[None]
        return apart

    @ti.func
    def _kernel(self, sample, x, y, apart):
        """Return the kernel weight K of a sample of age 0 in cell (x, y); apart: see `_layers_apart`."""
        d = (ti.Vector([x, y]) + 0.5) * self.cell - sample.place
        r2 = d.dot(sample.along) ** 2 + d.dot(sample.across) ** 2
        if ti.static(self.layered):
            r2 += apart
        # exp(-r2 / 2) as the 16th power of a Taylor series, which unlike exp fits into vector registers: within 2e-6
        z = -r2 / 32.0
        series = 1.0
        for n in ti.static(range(7, 0, -1)):
            series = 1.0 + series * z * ti.static(1.0 / n)
        for _ in ti.static(range(4)):
            series *= series
        return ti.select(r2 < CUT_OFF**2, series, 0.0)

    @ti.func
    def _weight_of_age(self, sample, t):
        return ti.exp(-self._fading[None] * (t - sample.time))

    @ti.func
    def _deviation(self, k, sample, z):
        """Return the squared deviation q [ppm²] of a sample of trial k, at height z, from the mean of its cell."""
        I, row = cell_of(sample.place, self.cell, self.shape), self.row(k, z)
        weight = self.weights[row, I[0], I[1]]
        prior = self.totals[k, 1] / self.totals[k, 0]
        share = ti.cast(weight / self._sigma_omega[None], ti.f32)  # Vulkan has no exp of f64
        trust = 1.0 - ti.exp(-(share**2))
        mean = prior
        if weight > 0.0:
            mean += trust * (self.weighted[row, I[0], I[1]] / weight - prior)
        return ti.cast((sample.reading - mean) ** 2, ti.f32)
