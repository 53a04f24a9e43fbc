"""What anemometers measure: a wind that lags and scatters, and none below their threshold."""

from functools import partial

import taichi as ti

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.lag import Lag
from taichi_plume.agents.members import Members, sensor_place
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import normal4


@ti.data_oriented
class Anemometers:
    """The anemometers of some groups: they write `wind` and `wind_known`.

    dim: of the wind; in 3-D they sit at their heights. tick: control period [s].
    """

    STATE = ("felt",)

    def __init__(self, members: Members, dim: int, tick: float):
        self.members, self.swarm, self.dim = members, members.swarm, dim
        self.feels_motion = not all(group.model.sensors.wind.compensated for group in members.groups)
        self.of = Parameters(members, partial(_figures, tick), stream="anemometer")
        self.felt = ti.Vector.field(2, ti.f32, members.size)  # wind behind the lag [m/s]

    def begin(self) -> None:
        """Set the numbers that the groups give."""
        self.of.begin()

    @ti.func
    def draw(self, n, tick):
        """Noise of the n-th anemometer along both axes, normal."""
        key, number, now = self.swarm.counter(self.members.robot[n], self.members.number[n], tick)
        g = normal4(key, self.of.stream[n], number, now, 0)
        return ti.Vector([g[0], g[1]])

    @ti.func
    def renew(self, n):
        """The n-th one is put back to the begin of a run."""
        self.felt[n] = ti.Vector([0.0, 0.0])

    @ti.func
    def feel(self, wind: Template, n, i, tick, t, g: Template):
        """Measure with the n-th of the anemometers, robot i's; g: what `draw` gives."""
        x = sensor_place(self.swarm, self.dim, i, self.of.height[n])
        u = ti.Vector.zero(ti.f32, self.dim)
        if ti.static(not self.swarm.apart):
            u = wind.velocity(x, t)
        else:
            u = wind.velocity_of(i, x, t)
        goal = ti.Vector([u[0], u[1]])
        if ti.static(self.feels_motion):
            if self.of.compensated[n] == 0:
                goal -= self.swarm.velocity[i]
        across = self.felt[n]
        # it starts in the robot's air
        across += (goal - across) * ti.select(tick == 1, 1.0, self.of.lag[n])
        self.felt[n] = across
        speed = across.norm()
        self.swarm.wind[i] = ti.Vector([0.0, 0.0])
        self.swarm.wind_known[i] = 0
        if speed > 0.0 and speed >= self.of.threshold[n]:
            noise = self.of.noise[n] + self.of.noise_relative[n] * speed
            across += noise * g
            self.swarm.wind_known[i] = 1
            self.swarm.wind[i] = self.swarm.as_believed(i, across)


def _figures(tick: float, group: GroupRange) -> Numbers:
    """What the anemometers of a group are like."""
    sensor = group.model.sensors.wind
    noise, noise_relative = sensor.scatter
    return {
        "height": sensor.height,
        "threshold": sensor.least,
        "lag": Lag(sensor.time_constant, tick).share,
        "noise": noise,
        "noise_relative": noise_relative,
        "compensated": sensor.compensated,
    }
