"""Anemometers: wind vectors with sensor lag (time constant), noise and a threshold."""

from functools import partial

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.lag import Lag
from taichi_plume.agents.members import Members, sensor_place
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import normal4


class Anemometers:
    """Anemometers of several groups, one per robot, which write `wind` and `wind_known`. dim: dimension of the wind; in
    3-D the anemometers sit at their heights. tick: control period [s].
    """

    STATE = ("felt",)

    def __init__(self, members: Members, dim: int, tick: float):
        self.members, self.swarm, self.dim = members, members.swarm, dim
        self.feels_motion = not all(group.model.sensors.wind.compensated for group in members.groups)
        self.p = Parameters(members, partial(_sensor_numbers, tick), stream="anemometer")
        self.felt = ti.vector_field(2, ti.f32, members.size)  # wind after the lag [m/s]

    @ti.func
    def draw(self, n, tick):
        """Return normal deviates (2,) for the noise of anemometer n along both axes."""
        key, number, now = self.swarm.counter(self.members.robot[n], self.members.number[n], tick)
        g = normal4(key, self.p.stream[n], number, now, 0)
        return ti.Vector([g[0], g[1]])

    @ti.func
    def renew(self, n):
        """Reset anemometer n to the start of a run."""
        self.felt[n] = ti.Vector([0.0, 0.0])

    @ti.func
    def measure(self, wind: Template, n, i, tick, t, g: Template):
        """Measure the wind with anemometer n, on robot i, at time t [s]; g (2,): normal deviates from `draw`."""
        x = sensor_place(self.swarm, self.dim, i, self.p.height[n])
        u = ti.Vector.zero(ti.f32, self.dim)
        if ti.static(not self.swarm.apart):
            u = wind.velocity(x, t)
        else:
            u = wind.velocity_of(i, x, t)
        goal = ti.Vector([u[0], u[1]])
        if ti.static(self.feels_motion):
            if self.p.compensated[n] == 0:
                goal -= self.swarm.velocity[i]
        across = self.felt[n]
        # no lag in the first tick
        across += (goal - across) * ti.select(tick == 1, 1.0, self.p.lag[n])
        self.felt[n] = across
        speed = across.norm()
        self.swarm.wind[i] = ti.Vector([0.0, 0.0])
        self.swarm.wind_known[i] = 0
        if speed > 0.0 and speed >= self.p.threshold[n]:
            noise = self.p.noise[n] + self.p.noise_relative[n] * speed
            across += noise * g
            self.swarm.wind_known[i] = 1
            self.swarm.wind[i] = self.swarm.as_believed(i, across)


def _sensor_numbers(tick: float, group: GroupRange) -> Numbers:
    """Return the parameters of a group's anemometers for kernels: height, threshold, lag and noise."""
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
