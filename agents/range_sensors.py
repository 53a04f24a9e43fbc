"""Range sensors, such as sonars: distance from the rim of a robot to the nearest surface within a cone, with noise.

The cone of a sensor is sampled by horizontal rays at most RAYS_DEG apart, of which the shortest counts. Rays end at
walls of the domain and at obstacles (sphere tracing, as beams of lasers do), and at moving obstacles and robots of the
trial. A robot inside the cone, between two rays, is found exactly.
"""

from math import ceil, cos, radians

import numpy as np

from taichi_plume.agents.columns import RANGE
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.line_sensors import Surroundings
from taichi_plume.agents.members import Members, sensor_place
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin
from taichi_plume.grid.rng import normal4

RAYS_DEG = 5.0  # largest angle between neighbouring rays of a cone


class RangeSensors:
    """Range sensors of several groups, which write the columns `range_0`, `range_1` ... of each robot.

    dim: dimension of the grid; in 3-D the sensors sit at their heights. around: surfaces that end the rays.
    """

    def __init__(self, members: Members, dim: int, around: Surroundings):
        self.members, self.swarm, self.dim, self.around = members, members.swarm, dim, around
        self.p = Parameters(members, _sensor_numbers, stream="range sensors")
        self.most = max(group.model.sensors.ranges for group in members.groups)
        self.readings = tuple(getattr(members.swarm, f"{RANGE}_{k}") for k in range(self.most))

    @ti.kernel
    def measure(self, tick: int):
        """Write the readings of all sensors of all robots; tick: number of the control period."""
        for n, k in ti.ndrange(self.members.size, self.most):
            i = self.members.robot[n]
            if k < self.p.count[n] and self.swarm.takes_part(i):
                reading = self._reading(n, k, i, tick)
                for sensor in ti.static(range(self.most)):
                    if k == sensor:
                        self.readings[sensor][i] = reading

    @ti.func
    def _reading(self, n, k, i, tick):
        """Return the reading [m] of sensor k of robot i, member n; the largest range if nothing is nearer."""
        most = self.p.largest_range[n]
        bearing = self.swarm.heading[i] + self.p.bearings[n, k]
        axis = cos_sin(bearing)
        x = sensor_place(self.swarm, self.dim, i, self.p.height[n])
        x[0] += self.swarm.radius[i] * axis[0]
        x[1] += self.swarm.radius[i] * axis[1]
        end = self._to_robots(n, i, x, axis, self.p.cosine[n], most)
        for ray in range(self.p.rays[n]):
            level = cos_sin(bearing + self.p.first_ray[n] + ray * self.p.between[n])
            e = ti.Vector.zero(ti.f32, self.dim)
            e[0], e[1] = level[0], level[1]
            end = self.around.reach(self.swarm, x, e, end)
            end = self._to_robots(n, i, x, level, 1.0, end)
        if end < most:
            key, number, now = self.swarm.counter(i, self.members.number[n], tick)
            end += self.p.noise[n] * normal4(key, self.p.stream[n], number, now, k)[0]
        return ti.math.clamp(end, self.p.least_range[n], most)

    @ti.func
    def _to_robots(self, n, i, x, axis, cosine, end):
        """Return the distance [m] from x, at most `end`, to the other robots of robot i's trial along `axis`.

        cosine: of half the angle of a cone around the axis, in which the nearest point of a robot counts; 1: of the
        axis alone.
        """
        p = ti.Vector([x[0], x[1]])
        trial = self.p.trial[n]
        for m in range(self.swarm.team_size[trial]):
            j = self.swarm.members[trial, m]
            if j != i and self._is_level(j, x):
                to = self.swarm.position[j] - p
                along, r = to.dot(axis), self.swarm.radius[j]
                if cosine < 1.0 and along >= cosine * to.norm():
                    end = ti.min(end, to.norm() - r)
                inside = r * r - (to.norm_sqr() - along * along)
                if along > 0.0 and inside > 0.0:
                    end = ti.min(end, along - ti.sqrt(inside))
        return ti.max(end, 0.0)

    @ti.func
    def _is_level(self, j, x):
        """Return whether the body of robot j reaches the height of x; always True without drones."""
        result = True
        if ti.static(self.swarm.flies and self.dim == 3):
            low = self.swarm.altitude[j]
            result = low <= x[2] and x[2] <= low + self.swarm.height[j]
        return result


def _sensor_numbers(group: GroupRange) -> Numbers:
    """Return the parameters of a group's range sensors for kernels; trial: row of each robot in `Swarm.members`."""
    sensor = group.model.sensors.range
    assert sensor is not None
    view = sensor.field_of_view_deg
    rays = 1 + ceil(view / RAYS_DEG)
    return {
        "bearings": tuple(np.radians(sensor.bearings_deg).tolist()),
        "count": len(sensor.bearings_deg),
        "rays": rays,
        "first_ray": -0.5 * radians(view),
        "between": radians(view) / max(1, rays - 1),
        "cosine": cos(0.5 * radians(view)),
        "least_range": sensor.min_range,
        "largest_range": sensor.max_range,
        "noise": sensor.noise,
        "height": sensor.height,
        "trial": group.row + np.arange(group.size) // group.count,
    }
