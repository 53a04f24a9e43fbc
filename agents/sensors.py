"""What a robot measures: gas with a lagging, noisy sensor, and wind with an anemometer that has a threshold.

Gas: the law of `gas_sensors` makes a signal y of the concentration, which follows it with separate time constants for
rise and decay, solved exactly over a tick; a share of it may decay more slowly. A reading takes y at its moment, or its
mean since the reading before, with drift, white noise and what room and heater add, and is what the sensor's
calibration makes of that, in ppm and never negative. Between readings the last one is held.
"""

from math import expm1, sqrt
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.agents.gas_sensors import LinearLaw, MoxLaw
from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.grid.fields import Odour, Wind
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import normal4, stream_id
from taichi_plume.scenario.sensors import GasSensor, IdealGasSensor, MoxSensor, PidSensor

# Thresholds: Ishida, Workshop on Robotic Olfaction, ICRA 2007, quoted by Ferri et al., Robotics and
# Autonomous Systems 57 (2009) 393-402. Noise and lag: our choice.
WIND_THRESHOLD = {"ultrasonic": 0.01, "thermal": 0.05, "ideal": 0.0}  # m/s
WIND_LAG = {"ultrasonic": 0.1, "thermal": 0.5, "ideal": 0.0}  # s
WIND_NOISE = 0.01  # m/s
WIND_NOISE_RELATIVE = 0.02
PID_LAG = 0.5  # s
HOUR = 3600.0


class Lag:
    """A first-order lag that is solved exactly over ticks of dt [s] in which its goal stands still.

    share: of the way to the goal that is covered in a tick; rest: mean of the rest of the way over the tick, over the
    whole of it.
    """

    def __init__(self, time_constant: float, dt: float):
        self.share = -expm1(-dt / time_constant) if time_constant > 0 else 1.0
        self.rest = self.share * time_constant / dt


@ti.data_oriented
class Sensors:
    """The sensors of one group: they write `true_ppm`, `reading`, `resistance`, `wind` and `wind_known` of its robots.

    dim: of gas and wind; in 3-D the sensors sit at their heights. tick: control period [s].
    """

    def __init__(self, swarm: Swarm, group: GroupRange, dim: int, tick: float):
        gas, wind = group.model.sensors.gas, group.model.sensors.wind
        self.swarm, self.dim, self.start, self.size = swarm, dim, group.start, group.size
        self.seed, self.first = swarm.seed, group.first
        self.gas_stream = stream_id(f"group {group.number}/gas sensor")
        self.wind_stream = stream_id(f"group {group.number}/anemometer")
        self.gas_height, self.wind_height, self.ahead = gas.height, wind.height, gas.ahead
        self.is_mox = isinstance(gas, MoxSensor)
        self.law: Any = _law(gas, group, swarm.seed)
        noise = gas.noise if isinstance(gas, MoxSensor) else gas.noise_ppm
        self.noise = noise / sqrt(gas.averaged)
        self.drift = gas.drift * sqrt(tick / HOUR) if isinstance(gas, MoxSensor) else 0.0
        rise, decay = self._time_constants(gas)
        self.rise, self.decay = Lag(rise, tick), Lag(decay, tick)
        self.slow_share = gas.slow_share if isinstance(gas, MoxSensor) else 0.0
        self.slow_decay = Lag(gas.slow_decay_time, tick) if isinstance(gas, MoxSensor) else self.decay
        self.hold = max(1, round(gas.period / tick))  # ticks per reading
        self.averages = gas.averaged > 1
        self.threshold = WIND_THRESHOLD[wind.kind] if wind.threshold is None else wind.threshold
        self.wind_lag = Lag(WIND_LAG[wind.kind] if wind.lag is None else wind.lag, tick)
        self.compensated = wind.compensated
        self.wind_noise, self.wind_noise_relative = WIND_NOISE, WIND_NOISE_RELATIVE
        if wind.noise is not None or wind.kind == "ideal":
            self.wind_noise, self.wind_noise_relative = wind.noise or 0.0, 0.0
        self.signal = ti.field(ti.f32, self.size)  # y of each robot, clean air at the start
        self.slow = ti.field(ti.f32, self.size)  # the same for its slow part
        self.sum = ti.field(ti.f32, self.size)  # of the tick means since the last reading
        self.baseline = ti.field(ti.f32, self.size)  # what y has drifted
        self.felt: Any = ti.Vector.field(2, ti.f32, self.size)  # wind behind the lag [m/s]

    def _time_constants(self, gas: GasSensor) -> tuple[float, float]:
        """Of rise and decay [s]."""
        own = (self.law.model.rise, self.law.model.decay) if self.is_mox else (0.0, 0.0)
        if isinstance(gas, PidSensor):
            own = (PID_LAG, PID_LAG)
        return (
            own[0] if gas.rise_time is None else gas.rise_time,
            own[1] if gas.decay_time is None else gas.decay_time,
        )

    def measure(self, gas: Odour, wind: Wind, tick: int, t: float) -> None:
        """Update the group's readings at tick `tick` (from 1 on), time t [s]."""
        self._sense(gas, wind, tick, t, self.law.offset(t))

    @ti.kernel
    def _sense(self, gas: Template, wind: Template, tick: int, t: float, offset: float):
        for n in range(self.size):
            self._smell(gas, n, tick, t, offset)
            self._feel(wind, n, tick, t)

    @ti.func
    def _at(self, n, height, ahead):
        """Where a sensor of robot n of the group is: a point of the domain's dimension."""
        p = self.swarm.position[self.start + n]
        x = ti.Vector.zero(ti.f32, self.dim)
        x[0] = p[0]
        x[1] = p[1]
        if ahead != 0.0:
            heading = self.swarm.heading[self.start + n]
            x[0] += ahead * ti.cos(heading)
            x[1] += ahead * ti.sin(heading)
        if ti.static(self.dim == 3):
            x[2] = height
        return x

    @ti.func
    def _random(self, stream, n, tick):
        """Four normal numbers of robot n; a trial draws the same ones alone and among others."""
        return normal4(ti.u32(self.seed), stream, self.first + n, tick, 0)

    @ti.func
    def _follow(self, signal: Template, n, goal, decay: Template):
        """Let a signal follow its goal for a tick; what it is then, and was in the mean."""
        rises = goal > signal[n]
        way = signal[n] - goal
        signal[n] = goal + way * (1.0 - ti.select(rises, self.rise.share, decay.share))
        return signal[n], goal + way * ti.select(rises, self.rise.rest, decay.rest)

    @ti.func
    def _smell(self, gas: Template, n, tick, t, offset):
        i = self.start + n
        ppm = ti.max(gas.ppm(self._at(n, self.gas_height, self.ahead), t), 0.0)
        smelt = 0.0
        for s, weight in ti.static(enumerate(self.law.weights(gas.species))):
            smelt += weight * ppm[s]
        goal = self.law.response(n, smelt)
        y, mean = self._follow(self.signal, n, goal, self.decay)
        if ti.static(self.slow_share > 0.0):
            slow, slow_mean = self._follow(self.slow, n, goal, self.slow_decay)
            y += self.slow_share * (slow - y)
            mean += self.slow_share * (slow_mean - mean)
        self.swarm.true_ppm[i] = ppm.sum()  # type: ignore[misc]
        if ti.static(self.averages):
            self.sum[n] += mean
        g = ti.Vector.zero(ti.f32, 4)
        due = (tick - 1) % self.hold == 0
        if ti.static(self.drift > 0.0):
            g = self._random(ti.u32(self.gas_stream), n, tick)
            self.baseline[n] += self.drift * g[1]
        elif due:
            g = self._random(ti.u32(self.gas_stream), n, tick)
        if due:
            if ti.static(self.averages):
                y = self.sum[n] / ti.min(tick, self.hold)
                self.sum[n] = 0.0
            r = self.law.resistance(n, y + self.baseline[n] + self.noise * g[0] + offset)
            self.swarm.reading[i] = self.law.ppm(n, r)
            if ti.static(self.is_mox):
                self.swarm.resistance[i] = r

    @ti.func
    def _feel(self, wind: Template, n, tick, t):
        i = self.start + n
        u = wind.velocity(self._at(n, self.wind_height, 0.0), t)
        goal = ti.Vector([u[0], u[1]])
        if ti.static(not self.compensated):
            goal -= self.swarm.velocity[i]
        across = self.felt[n]
        across += (goal - across) * (
            1.0 if tick == 1 else self.wind_lag.share
        )  # it starts in the robot's air
        self.felt[n] = across
        speed = across.norm()
        known = speed > 0.0 and speed >= self.threshold
        noise = self.wind_noise + self.wind_noise_relative * speed
        g = self._random(ti.u32(self.wind_stream), n, tick)
        self.swarm.wind_known[i] = ti.cast(known, ti.i32)
        self.swarm.wind[i] = ti.Vector([0.0, 0.0])
        if known:
            self.swarm.wind[i] = self.swarm.as_believed(i, across + noise * ti.Vector([g[0], g[1]]))


def _law(gas: MoxSensor | PidSensor | IdealGasSensor, group: GroupRange, seed: int) -> MoxLaw | LinearLaw:
    if not isinstance(gas, MoxSensor):
        return LinearLaw(gas)
    units = group.generators(seed, "units")
    return MoxLaw(gas, np.concatenate([rng.uniform(-1.0, 1.0, (group.count, 2)) for rng in units]))
