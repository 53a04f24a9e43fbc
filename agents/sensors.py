"""What a robot measures: gas with a lagging, noisy sensor, and wind with an anemometer that has a threshold.

Gas sensor: a static law y(c), a first-order lag on y with separate time constants for rise and decay, solved
exactly over a tick, and white noise on y at each sample. Between samples the reading is held. The reading is
what the inverse of the static law makes of the noisy y, in ppm and never negative.
"""

from dataclasses import dataclass
from math import expm1
from typing import Any

import taichi as ti

from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.fields import Odour, Wind
from taichi_plume.kernels import Template
from taichi_plume.rng import normal4, stream_id
from taichi_plume.robots import MoxSensor


@dataclass(frozen=True)
class MoxModel:
    """A metal-oxide sensor, R = R_air (1 + c/c0)^-b. c0 [ppm]; b; rise and decay: time constants [s]."""

    c0: float
    b: float
    rise: float
    decay: float


MOX_MODELS = {
    # b: power law that GADEN (Monroy et al. 2017, doi:10.3390/s17071479) fits to the datasheet's ethanol
    # curve; c0 from its R_air/R(300 ppm) = 21; time constants as given there, from experiments.
    "tgs2620": MoxModel(c0=4.32, b=0.7155, rise=2.96, decay=15.71),
    # R/R0 = (c/1.62)^-0.644 in common drivers of its sensing element (in the MiCS-6814) for ethanol, other
    # vapours taken alike; the time constants are our estimate for a micro-hotplate.
    "mics5524": MoxModel(c0=1.6, b=0.644, rise=1.5, decay=8.0),
}

# Thresholds: Ishida, Workshop on Robotic Olfaction, ICRA 2007, quoted by Ferri et al., Robotics and
# Autonomous Systems 57 (2009) 393-402. Noise: our choice.
WIND_THRESHOLD = {"ultrasonic": 0.01, "thermal": 0.05, "ideal": 0.0}  # m/s
WIND_NOISE = 0.01  # m/s
WIND_NOISE_RELATIVE = 0.02


@ti.data_oriented
class MoxLaw:
    """y = ln(R_air/R) = b ln(1 + c/c0): finite in clean air, a power law far above c0."""

    def __init__(self, model: MoxModel):
        self.c0, self.b = model.c0, model.b

    @ti.func
    def response(self, ppm):
        """Steady y at a concentration."""
        return self.b * ti.log(1.0 + ppm / self.c0)

    @ti.func
    def ppm(self, y):
        """The concentration with the steady response y."""
        return self.c0 * (ti.exp(y / self.b) - 1.0)


@ti.data_oriented
class LinearLaw:
    """y = c."""

    @ti.func
    def response(self, ppm):
        """Steady y at a concentration."""
        return ppm

    @ti.func
    def ppm(self, y):
        """The concentration with the steady response y."""
        return y


def _share(dt: float, time_constant: float) -> float:
    """Part of the way to a steady target that a first-order lag covers in dt."""
    return -expm1(-dt / time_constant) if time_constant > 0 else 1.0


@ti.data_oriented
class Sensors:
    """The sensors of one group: they write `true_ppm`, `reading`, `wind` and `wind_known` of its robots.

    dim: of gas and wind; in 3-D the sensors sit above the robot's centre at their heights. tick: control
    period [s].
    """

    def __init__(self, swarm: Swarm, group: GroupRange, dim: int, tick: float):
        gas, wind = group.model.sensors.gas, group.model.sensors.wind
        self.swarm, self.dim, self.start, self.size = swarm, dim, group.start, group.size
        self.seed = swarm.seed
        self.gas_stream = stream_id(f"group {group.number}/gas sensor")
        self.wind_stream = stream_id(f"group {group.number}/anemometer")
        self.gas_height, self.wind_height = gas.height, wind.height
        if isinstance(gas, MoxSensor):
            model = MOX_MODELS[gas.model]
            self.law: Any = MoxLaw(model)
            rise = model.rise if gas.rise_time is None else gas.rise_time
            decay = model.decay if gas.decay_time is None else gas.decay_time
            self.noise = gas.noise
        else:
            self.law = LinearLaw()
            rise, decay, self.noise = gas.rise_time, gas.decay_time, gas.noise_ppm
        self.rise, self.decay = _share(tick, rise), _share(tick, decay)
        self.hold = max(1, round(gas.period / tick))  # ticks per sample
        self.threshold = WIND_THRESHOLD[wind.kind] if wind.threshold is None else wind.threshold
        self.wind_noise, self.wind_noise_relative = WIND_NOISE, WIND_NOISE_RELATIVE
        if wind.noise is not None or wind.kind == "ideal":
            self.wind_noise, self.wind_noise_relative = wind.noise or 0.0, 0.0
        self.response = ti.field(ti.f32, self.size)  # y of each robot, clean air at the start

    def measure(self, gas: Odour, wind: Wind, tick: int, t: float) -> None:
        """Update the group's readings at tick `tick` (from 1 on), time t [s]."""
        self._sense(gas, wind, tick, t)

    @ti.kernel
    def _sense(self, gas: Template, wind: Template, tick: int, t: float):
        for n in range(self.size):
            self._smell(gas, n, tick, t)
            self._feel(wind, n, tick, t)

    @ti.func
    def _at(self, n, height):
        """Where the sensor of robot n of the group is: a point of the domain's dimension."""
        p = self.swarm.position[self.start + n]
        x = ti.Vector.zero(ti.f32, self.dim)
        x[0] = p[0]
        x[1] = p[1]
        if ti.static(self.dim == 3):
            x[2] = height
        return x

    @ti.func
    def _smell(self, gas: Template, n, tick, t):
        i = self.start + n
        ppm = ti.max(gas.ppm(self._at(n, self.gas_height), t).sum(), 0.0)
        steady = self.law.response(ppm)
        y = self.response[n]
        y += (steady - y) * ti.select(steady > y, self.rise, self.decay)
        self.response[n] = y
        self.swarm.true_ppm[i] = ppm
        if (tick - 1) % self.hold == 0:
            noise = self.noise * normal4(ti.u32(self.seed), ti.u32(self.gas_stream), n, tick, 0)[0]
            self.swarm.reading[i] = ti.max(self.law.ppm(y + noise), 0.0)

    @ti.func
    def _feel(self, wind: Template, n, tick, t):
        i = self.start + n
        u = wind.velocity(self._at(n, self.wind_height), t)
        across = ti.Vector([u[0], u[1]])
        speed = across.norm()
        known = speed > 0.0 and speed >= self.threshold
        noise = self.wind_noise + self.wind_noise_relative * speed
        g = normal4(ti.u32(self.seed), ti.u32(self.wind_stream), n, tick, 0)
        self.swarm.wind_known[i] = ti.cast(known, ti.i32)
        self.swarm.wind[i] = ti.Vector([0.0, 0.0])
        if known:
            self.swarm.wind[i] = across + noise * ti.Vector([g[0], g[1]])
