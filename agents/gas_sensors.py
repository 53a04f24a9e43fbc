"""What gas sensors measure: a signal that lags, drifts and scatters, and what it is taken for.

The law of `gas_laws` makes a signal y of the concentration, which follows it with separate time constants for rise and
decay, solved exactly over a tick; a share of it may decay more slowly. A reading takes y at its moment, or its mean
since the reading before, with drift, white noise of its samples and of itself and what room and heater add, and is what
the sensor's calibration makes of that, in ppm and never negative. Between readings the last one is held.
"""

from collections.abc import Sequence
from functools import partial
from math import sqrt
from typing import Any

import taichi as ti

from taichi_plume.agents.columns import OF_A_GAS_SENSOR
from taichi_plume.agents.gas_laws import Law, numbered
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.lag import Lag
from taichi_plume.agents.members import Members, sensor_place
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.grid.elementary import exp, log
from taichi_plume.grid.fields import Species
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import normal4

HOUR = 3600.0


@ti.data_oriented
class GasSensors:
    """One gas sensor of each robot of some groups, all of one law: they write `true_ppm`, `reading` and `resistance`.

    slot: which of each robot's, from 0 on; the others' columns have their number. dim: of the gas; in 3-D the sensors
    sit at their heights. tick: control period [s]. species: of the gas.
    """

    STATE = ("signal", "slow", "sum", "baseline")

    def __init__(
        self,
        members: Members,
        law: type[Law],
        dim: int,
        tick: float,
        species: Sequence[Species],
        slot: int = 0,
    ):
        self.members, self.swarm, self.dim, self.species = members, members.swarm, dim, len(species)
        self.first = slot == 0
        n = members.size
        self.law: Any = law(members, slot)
        models = [group.model.sensors.noses[slot] for group in members.groups]
        self.ahead, self.left = any(one.ahead for one in models), any(one.left for one in models)
        self.bends = any(model.bend(one.name) for model in models for one in species)
        self.of = Parameters(
            members, partial(_figures, tick, species, slot), stream=numbered("gas sensor", slot)
        )
        self.reading, self.resistance, self.true_ppm = (
            getattr(members.swarm, f"{name}_{slot}" if slot else name) for name in OF_A_GAS_SENSOR
        )
        self.signal = ti.field(ti.f32, n)  # y of each robot, clean air at the start
        self.slow = ti.field(ti.f32, n)  # the same for its slow part
        self.sum = ti.field(ti.f32, n)  # of the tick means since the last reading
        self.baseline = ti.field(ti.f32, n)  # what y has drifted

    def begin(self) -> None:
        """Set the numbers that the groups give."""
        self.of.begin()
        self.law.begin()

    @ti.func
    def _follow(self, signal: Template, n, goal, decay, decay_rest):
        """Let a signal follow its goal for a tick; what it is then, and was in the mean."""
        rises = goal > signal[n]
        way = signal[n] - goal
        signal[n] = goal + way * (1.0 - ti.select(rises, self.of.rise[n], decay))
        return signal[n], goal + way * ti.select(rises, self.of.rise_rest[n], decay_rest)

    @ti.func
    def draw(self, n, tick):
        """Noise of samples, drift and noise of a reading of the n-th sensor, normal; a trial draws the same ones alone
        and among others.
        """
        key, number, now = self.swarm.counter(self.members.robot[n], self.members.number[n], tick)
        g = normal4(key, self.of.stream[n], number, now, 0)
        return g[0], g[1], g[2]

    @ti.func
    def place(self, n, i):
        """Where the n-th of the sensors, robot i's, is [m]."""
        x = sensor_place(self.swarm, self.dim, i, self.of.height[n])
        if ti.static(self.ahead):
            heading = self.swarm.heading[i]
            x[0] += self.of.ahead[n] * ti.cos(heading)
            x[1] += self.of.ahead[n] * ti.sin(heading)
        if ti.static(self.left):
            heading, left = self.swarm.heading[i], self.of.left[n]
            if ti.static(self.swarm.apart):  # in a mirror left is right
                left *= self.swarm.episodes.side[self.swarm.episodes.of(i)]
            x[0] -= left * ti.sin(heading)
            x[1] += left * ti.cos(heading)
        return x

    @ti.func
    def smell(self, gas: Template, n, i, t):
        """What the n-th of the sensors, robot i's, is led by: the concentrations there, each as far as it feels it."""
        x = self.place(n, i)
        ppm = ti.Vector.zero(ti.f32, self.species)
        if ti.static(not self.swarm.apart):
            ppm = ti.max(gas.ppm(x, t), 0.0)
        else:
            ppm = ti.max(gas.ppm_of(i, x, t), 0.0)
        self.true_ppm[i] = ppm.sum()  # type: ignore[misc]
        smelt = 0.0
        for s in ti.static(range(self.species)):
            felt = ppm[s]
            if ti.static(self.bends):
                if self.of.powers[n, s] != 1.0:
                    felt = exp(self.of.powers[n, s] * log(1.0 + ppm[s] * self.of.per_c1[n, s])) - 1.0
            smelt += self.of.weights[n, s] * felt
        return smelt

    @ti.func
    def renew(self, n, unit):
        """The n-th one is put back to the begin of a run, as another unit: a number from 0 to 1."""
        self.signal[n], self.slow[n], self.sum[n], self.baseline[n] = 0.0, 0.0, 0.0, 0.0
        self.law.renew(n, unit)

    @ti.func
    def is_due(self, n, tick):
        """Whether the n-th sensor gives a reading at this tick."""
        return (tick - 1) % self.of.hold[n] == 0

    @ti.func
    def lag(self, n, tick, cold, goal, noise, drift, reading_noise):
        """Signal that the n-th sensor gives while it follows its goal for a tick, with all that adds to it.

        cold: what is left of a start in the cold; noise, drift, reading_noise: what `draw` gives.
        """
        y, mean = self._follow(self.signal, n, goal, self.of.decay[n], self.of.decay_rest[n])
        share = self.of.slow_share[n]
        if share > 0.0:
            slow, slow_mean = self._follow(
                self.slow, n, goal, self.of.slow_decay[n], self.of.slow_decay_rest[n]
            )
            y += share * (slow - y)
            mean += share * (slow_mean - mean)
        return self.told(n, tick, cold, y, mean, noise, drift, reading_noise)

    @ti.func
    def told(self, n, tick, cold, y, mean, noise, drift, reading_noise):
        """What the n-th gives of a signal y, its mean over the tick, with all that adds to it; see `lag`."""
        if self.of.drift[n] > 0.0:
            self.baseline[n] = self.baseline[n] + self.of.drift[n] * drift
        total = self.sum[n] + mean  # `+=` would be an atomic
        if self.is_due(n, tick):
            if self.of.averages[n] == 1:
                y = total / ti.min(tick, self.of.hold[n])
            total = 0.0
            if self.of.reading_noise[n] > 0.0:
                y += self.of.reading_noise[n] * reading_noise
        self.sum[n] = total
        return (
            y + self.baseline[n] + self.of.noise[n] * noise + self.of.room[n] + self.of.cold_start[n] * cold
        )

    @ti.func
    def read(self, n, i, tick, r, ppm):
        """Robot i reads what its sensor, the n-th, is taken for."""
        if self.is_due(n, tick):
            self.reading[i] = ppm
            if ti.static(self.law.HAS_RESISTANCE):
                self.resistance[i] = r


def _figures(tick: float, species: Sequence[Species], slot: int, group: GroupRange) -> Numbers:
    """What the sensors of a group are like."""
    sensor = group.model.sensors.noses[slot]
    signal = sensor.signal
    bends = [sensor.bend(one.name) or (1.0, 1.0) for one in species]
    rise, decay, slow = (Lag(one, tick) for one in (signal.rise, signal.decay, signal.slow_decay))
    return {
        "height": sensor.height,
        "ahead": sensor.ahead,
        "left": sensor.left,
        "hold": max(1, round(sensor.period / tick)),  # ticks per reading
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
        "weights": tuple(sensor.weight(one.name) for one in species) or (0.0,),
        "per_c1": tuple(1.0 / c1 for c1, _ in bends) or (0.0,),
        "powers": tuple(power for _, power in bends) or (1.0,),
    }
