"""Gas sensors: signal with sensor lag (rise and decay time constants), drift and noise, and the reading from it.

The static law of `gas_laws` maps the concentration to a goal y. The signal follows with separate time constants for
rise and decay, solved exactly over a time step; a fraction may decay more slowly. A reading is the present signal, or
the mean since the previous reading, with drift, white noise of samples and of the reading, room climate and heater
warm-up. The calibration converts a reading to ppm, never negative. Between readings the last reading is held.

Metal oxides also give readings without calibration, by `gives`. Differences in R_air between units do not change them:

    ratio  R0/R - 1 with R0 the largest resistance so far, the cleanest air that the robot has met
    rank   share of the stored readings R_k with ln R_k - ln R > tied: those that were clearly lower

A rank within the readings gathered so far replaces a calibration in Jin, Duranceau, Erünsal & Martinoli (2026),
"Calibration-free gas source localization with mobile robots", arXiv:2605.13208. There all measurements of a survey are
ranked; the limited memory of RANKED readings, and ties, are ours. Data sheets give R over its value in clean air; that
the largest stands for this value is ours.

Where clean air has a background of gas, a sensor starts in equilibrium with it. Algorithms get the reading minus that
of the same sensor in clean air without noise, as after zeroing, but never negative.
"""

from collections.abc import Sequence
from functools import partial
from math import sqrt

from taichi_plume.agents.columns import OF_A_GAS_SENSOR
from taichi_plume.agents.gas_laws import Law, numbered
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.lag import Lag
from taichi_plume.agents.members import Members, sensor_place
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import exp, log
from taichi_plume.grid.fields import Species
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import normal4

HOUR = 3600.0
GIVES = ("ppm", "ratio", "rank")
RANKED = 256  # stored readings of a sensor that gives ranks
LARGEST = 10.0  # standard deviation of fluctuations over the mean, at the edge of a plume: our choice


class GasSensors:
    """Gas sensors of several groups, one per robot, all of the same law. Written: the columns `OF_A_GAS_SENSOR`.

    slot: number of the sensor on each robot, from 0 on, which ends the column names of further sensors. dim: dimension
    of the gas grid; in 3-D the sensors sit at their heights. tick: control period [s]. species: of the gas. fluctuates:
    whether the gas has unresolved fluctuations. background: of each species in clean air [ppm]; () for none.
    """

    STATE: tuple[str, ...] = ("signal", "slow", "sum", "baseline")

    def __init__(
        self,
        members: Members,
        law: type[Law],
        dim: int,
        tick: float,
        species: Sequence[Species],
        slot: int = 0,
        fluctuates: bool = False,
        background: Sequence[float] = (),
    ):
        self.zeroed = any(background)
        self.members, self.swarm, self.dim, self.species = members, members.swarm, dim, len(species)
        self.fluctuates, self.tick = fluctuates, tick
        self.first = slot == 0
        n = members.size
        self.law = law(members, slot)
        models = [group.model.sensors.noses[slot] for group in members.groups]
        self.ahead, self.left = any(model.ahead for model in models), any(model.left for model in models)
        gives = {getattr(model, "gives", "ppm") for model in models}
        self.relative, self.ranks = bool(gives & {"ratio", "rank"}), "rank" in gives
        self.bends = any(model.bend(kind.name) for model in models for kind in species)
        self.p = Parameters(
            members,
            partial(_sensor_numbers, tick, species, slot, background),
            stream=numbered("gas sensor", slot),
        )
        self.measured, self.reading, self.resistance, self.true_ppm = (
            getattr(members.swarm, f"{name}_{slot}" if slot else name) for name in OF_A_GAS_SENSOR
        )
        self.signal = ti.field(ti.f32, n)  # signal y, in clean air at the start
        self.slow = ti.field(ti.f32, n)  # signal of the slowly decaying part
        self.sum = ti.field(ti.f32, n)  # sum of the tick means since the last reading
        self.baseline = ti.field(ti.f32, n)  # drift of y
        if self.relative:
            self.cleanest = ti.field(ti.f32, n)  # largest resistance so far [ohm]
            self.past = ti.field(ti.f32, (n, RANKED if self.ranks else 1))  # ln R, a ring buffer
            self.stored = ti.field(ti.i32, n)  # number of stored readings so far
            self.STATE = (*self.STATE, "cleanest", "past", "stored")
        if fluctuates:
            self.fluctuation = ti.field(ti.f32, n)  # of the logarithm of the gas, of unit variance
            self.STATE = (*self.STATE, "fluctuation")

    @ti.func
    def _follow(self, signal: Template, n, goal, decay, decay_rest):
        """Advance sensor n's signal towards `goal` by a time step of lag; return signal and mean of the step."""
        rises = goal > signal[n]
        way = signal[n] - goal
        signal[n] = goal + way * (1.0 - ti.select(rises, self.p.rise[n], decay))
        return signal[n], goal + way * ti.select(rises, self.p.rise_rest[n], decay_rest)

    @ti.func
    def draw(self, n, tick):
        """Return normal deviates of sensor n: for noise of samples, drift, noise of readings, and fluctuations of the
        gas.
        """
        key, number, now = self.swarm.counter(self.members.robot[n], self.members.number[n], tick)
        g = normal4(key, self.p.stream[n], number, now, 0)
        return g[0], g[1], g[2], g[3]

    @ti.func
    def place(self, n, i):
        """Return the position [m] of sensor n, mounted on robot i, a vector with the dimension of the grid."""
        x = sensor_place(self.swarm, self.dim, i, self.p.height[n])
        if ti.static(self.ahead):
            heading = self.swarm.heading[i]
            x[0] += self.p.ahead[n] * ti.cos(heading)
            x[1] += self.p.ahead[n] * ti.sin(heading)
        if ti.static(self.left):
            heading, left = self.swarm.heading[i], self.p.left[n]
            if ti.static(self.swarm.apart):  # in a mirror left is right
                left *= self.swarm.episodes.side[self.swarm.episodes.of(i)]
            x[0] -= left * ti.sin(heading)
            x[1] += left * ti.cos(heading)
        return x

    @ti.func
    def exposure(self, gas: Template, n, i, t, tick, deviate):
        """Return the gas [ppm] at sensor n of robot i at time t [s], summed with its sensitivity to each species.

        deviate: normal deviate from `draw`, for the gas's unresolved fluctuations.
        """
        x = self.place(n, i)
        ppm = ti.Vector.zero(ti.f32, self.species)
        if ti.static(not self.swarm.apart):
            ppm = ti.max(gas.ppm(x, t), 0.0)
        else:
            ppm = ti.max(gas.ppm_of(i, x, t), 0.0)
        if ti.static(self.fluctuates):
            if ti.static(self.zeroed):
                excess = ti.max(gas.excess(x, t), 0.0)
                ppm += excess * (self._fluctuations(excess, gas, n, i, x, t, tick, deviate) - 1.0)
            else:
                ppm *= self._fluctuations(ppm, gas, n, i, x, t, tick, deviate)
        self.true_ppm[i] = ppm.sum()  # type: ignore[misc]
        smelt = 0.0
        for s in ti.static(range(self.species)):
            felt = ppm[s]
            if ti.static(self.bends):
                if self.p.powers[n, s] != 1.0:
                    felt = exp(self.p.powers[n, s] * log(1.0 + ppm[s] * self.p.per_c1[n, s])) - 1.0
            smelt += self.p.weights[n, s] * felt
        return smelt

    @ti.func
    def _fluctuations(self, ppm: Template, gas: Template, n, i, x: Template, t, tick, deviate):
        """Return the gas of each species with its unresolved fluctuations over its mean ppm, log-normal about 1.

        Their logarithm follows an Ornstein-Uhlenbeck process, one for all species.
        """
        v = ti.Vector.zero(ti.f32, self.dim)
        for d in ti.static(range(2)):
            v[d] = self.swarm.velocity[i][d]
        deviation, turnover = gas.fluctuations(x, v, t)
        memory = ti.select(tick == 1, 0.0, exp(-self.tick * turnover))
        y = memory * self.fluctuation[n] + ti.sqrt(1.0 - memory * memory) * deviate
        self.fluctuation[n] = y
        relative = ti.min(deviation / ti.max(ppm, 1e-20), LARGEST)
        variance = ti.log(1.0 + relative * relative)
        return ti.exp(ti.sqrt(variance) * y - 0.5 * variance)

    @ti.func
    def renew(self, n, unit):
        """Reset sensor n to the start of a run; unit: random number from 0 to 1 that selects another sensor unit."""
        self.signal[n], self.slow[n], self.sum[n], self.baseline[n] = 0.0, 0.0, 0.0, 0.0
        if ti.static(self.relative):
            self.cleanest[n], self.stored[n] = 0.0, 0
        self.law.renew(n, unit)

    @ti.func
    def clean(self, n):
        """Return the exposure of sensor n to the background of clean air, as `exposure` does."""
        return self.p.clean[n]

    @ti.func
    def settle(self, n):
        """Put the signal of sensor n into equilibrium with clean air."""
        y = self.law.response(n, self.clean(n))
        self.signal[n], self.slow[n] = y, y

    @ti.func
    def clean_ppm(self, n):
        """Return the reading of sensor n in clean air, without noise, drift and room climate."""
        ppm = self.law.ppm(n, self.law.resistance(n, self.law.response(n, self.clean(n))))
        if ti.static(self.relative):
            ppm = ti.select(self.p.gives[n] > 0, 0.0, ppm)
        return ppm

    @ti.func
    def is_due(self, n, tick):
        """Return whether sensor n takes a reading in control period `tick`; otherwise the last reading is held."""
        return (tick - 1) % self.p.hold[n] == 0

    @ti.func
    def lag(self, n, tick, cold, goal, noise, drift, reading_noise):
        """Return the signal of sensor n after a time step of sensor lag towards `goal`, with drift and noise.

        cold: remaining fraction of the heater warm-up; noise, drift, reading_noise: normal deviates from `draw`.
        """
        y, mean = self._follow(self.signal, n, goal, self.p.decay[n], self.p.decay_rest[n])
        share = self.p.slow_share[n]
        if share > 0.0:
            slow, slow_mean = self._follow(
                self.slow, n, goal, self.p.slow_decay[n], self.p.slow_decay_rest[n]
            )
            y += share * (slow - y)
            mean += share * (slow_mean - mean)
        return self.with_noise(n, tick, cold, y, mean, noise, drift, reading_noise)

    @ti.func
    def with_noise(self, n, tick, cold, y, mean, noise, drift, reading_noise):
        """Return the signal of sensor n with drift, noise, room climate and warm-up added. y: signal after the lag;
        mean: mean of the signal over the time step; other arguments: see `lag`.
        """
        if self.p.drift[n] > 0.0:
            self.baseline[n] = self.baseline[n] + self.p.drift[n] * drift
        total = self.sum[n] + mean  # `+=` would be an atomic
        if self.is_due(n, tick):
            if self.p.averages[n] == 1:
                y = total / ti.min(tick, self.p.hold[n])
            total = 0.0
            if self.p.reading_noise[n] > 0.0:
                y += self.p.reading_noise[n] * reading_noise
        self.sum[n] = total
        return y + self.baseline[n] + self.p.noise[n] * noise + self.p.room[n] + self.p.cold_start[n] * cold

    @ti.func
    def read(self, n, i, tick, r, ppm):
        """Write gas [ppm] and resistance r [ohm] to robot i's columns if its sensor n is due at time step `tick`."""
        if self.is_due(n, tick):
            value = ppm
            if ti.static(self.relative):
                if self.p.gives[n] > 0:
                    value = self._uncalibrated(n, tick, r)
            excess = value
            if ti.static(self.zeroed):
                excess = ti.max(value - self.clean_ppm(n), 0.0)  # type: ignore[operator]
            self.write(i, value, excess)
            if ti.static(self.law.HAS_RESISTANCE):
                self.resistance[i] = r

    @ti.func
    def write(self, i, measured, excess):
        """Write a reading of robot i, and `excess` above clean air for algorithms, as far as its gas is followed."""
        self.measured[i] = measured
        if ti.static(self.zeroed or self.swarm.classifies):
            if ti.static(self.first and self.swarm.classifies):
                excess *= self.swarm.gas_share[i]
            self.reading[i] = excess

    @ti.func
    def _uncalibrated(self, n, tick, r):
        """Return the ratio or rank of sensor n at the resistance r [ohm], and store what later ones are taken from."""
        self.cleanest[n] = ti.max(self.cleanest[n], r)
        value, level = self.cleanest[n] / r - 1.0, log(r)
        if ti.static(self.ranks):
            if self.p.gives[n] == 2:
                lower, count = 0, ti.min(self.stored[n], RANKED)
                for k in range(count):
                    lower += ti.cast(self.past[n, k] - level > self.p.tied[n], ti.i32)
                value = lower / ti.max(1.0, count)
                if (tick - 1) % self.p.stored_each[n] == 0:
                    self.past[n, self.stored[n] % RANKED] = level
                    self.stored[n] += 1
        return value


def _sensor_numbers(
    tick: float, species: Sequence[Species], slot: int, background: Sequence[float], group: GroupRange
) -> Numbers:
    """Return the parameters of a group's gas sensors for kernels: mounting, sampling, noise, lag and sensitivities."""
    sensor = group.model.sensors.noses[slot]
    signal = sensor.signal
    bends = [sensor.bend(kind.name) or (1.0, 1.0) for kind in species]
    weights = [sensor.weight(kind.name) for kind in species]
    clean = sum(
        weight * (ppm if power == 1.0 else (1.0 + ppm / c1) ** power - 1.0)
        for weight, ppm, (c1, power) in zip(weights, background, bends, strict=False)
    )
    hold, memory = max(1, round(sensor.period / tick)), getattr(sensor, "memory", 0.0)
    rise, decay, slow = (Lag(time, tick) for time in (signal.rise, signal.decay, signal.slow_decay))
    return {
        "height": sensor.height,
        "ahead": sensor.ahead,
        "left": sensor.left,
        "hold": hold,  # ticks per reading
        "gives": GIVES.index(gives) if (gives := getattr(sensor, "gives", "ppm")) in GIVES else 0,
        "tied": getattr(sensor, "tied", 0.0),
        "stored_each": hold * max(1, round(memory / (RANKED * hold * tick))),  # ticks
        "averages": sensor.averaged > 1,
        "noise": signal.noise / sqrt(sensor.averaged),
        "reading_noise": signal.reading_noise,
        "drift": signal.drift * sqrt(tick / HOUR),
        "room": signal.room,
        "cold_start": signal.cold_start,
        "rise": rise.share,
        "rise_rest": rise.rest,
        "decay": decay.share,
        "decay_rest": decay.rest,
        "slow_share": signal.slow_share,
        "slow_decay": slow.share,
        "slow_decay_rest": slow.rest,
        "clean": clean,
        "weights": tuple(weights) or (0.0,),
        "per_c1": tuple(1.0 / c1 for c1, _ in bends) or (0.0,),
        "powers": tuple(power for _, power in bends) or (1.0,),
    }
