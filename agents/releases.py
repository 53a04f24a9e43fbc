"""Releases: where the patches that a source has released are by now, and how probable a detection of them is.

The plume model of Pang & Farrell, IEEE Trans. Systems, Man, and Cybernetics B 36 (2006) 1068-1080,
doi:10.1109/TSMCB.2006.874689. A patch that a source at s released `age` before is by now about

    s + Σ u Δt over the periods since,  σ² = patch² + 2 D age  per axis

u: wind that the robot measured in each period Δt, taken for that of all the floor. Of the releases, one each period, a
robot at x has a detection with probability

    false_alarm + (1 - false_alarm) detection (1 - Π (1 - min(1, π notice² N(x; s + Σ u Δt, σ²))))

in an update.
"""

from math import pi

import taichi as ti

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.grid.elementary import exp
from taichi_plume.scenario.filter_algorithms import ParticleFilter as Model


@ti.data_oriented
class Releases:
    """What the robots of one group know of the releases of the last `most` periods, each by the wind that it measured.

    period: between releases [s]. parameters: with the `numbers` of this class.
    """

    STATE: tuple[str, ...] = ("wind_way", "drift", "periods")

    def __init__(self, members: Members, parameters: Parameters, most: int, period: float):
        self.swarm, self.robot, self.p = members.swarm, members.robot, parameters
        self.most, self.period = most, period
        low, high = members.swarm.clearance.low, members.swarm.clearance.high
        self.floor = (tuple(low), tuple(high))
        n = members.size
        self.wind_way = ti.Vector.field(2, ti.f32, (n, most))  # Σ u Δt of each period, a ring [m]
        self.drift = ti.Vector.field(2, ti.f32, n)  # of the present period so far [m]
        self.periods = ti.field(ti.i32, n)  # so far
        self.back = ti.Vector.field(2, ti.f32, (n, most + 1))  # way since each release, newest first [m]

    @staticmethod
    def numbers(model: Model) -> Numbers:
        """Those of a group."""
        return {
            "first": model.patch**2,  # variance at the release [m²]
            "growth": 2.0 * model.diffusivity,  # m²/s
            "notice": pi * model.notice**2,  # m²
            "detection": model.detection,
            "false_alarm": model.false_alarm,
        }

    @ti.func
    def drifts(self, n, dt):
        """Take the wind at robot n, where it is known, for that of all the floor in the next dt [s]."""
        i = self.robot[n]
        if self.swarm.wind_known[i] == 1:
            self.drift[n] += dt * self.swarm.wind[i]

    @ti.func
    def look_back(self, n):
        """The way of the air since each release, along the wind of the periods since."""
        self.wind_way[n, self.periods[n] % self.most] = self.drift[n]
        self.periods[n] += 1
        self.drift[n] = ti.Vector([0.0, 0.0])
        way = ti.Vector([0.0, 0.0])
        self.back[n, 0] = way
        for age in range(1, self.released(n)):
            way += self.wind_way[n, (self.periods[n] - age) % self.most]
            self.back[n, age] = way

    @ti.func
    def released(self, n):
        """Number of releases that are looked at; the newest has the age 0."""
        return ti.min(self.periods[n], self.most) + 1

    @ti.func
    def variance(self, n, age):
        """Of a patch that was released so many periods ago, along each axis [m²]."""
        return self.p.first[n] + self.p.growth[n] * self.period * age

    @ti.func
    def patch(self, n, place, age):
        """Density at robot n of a patch that a source at `place` [m] released so many periods ago [1/m²]."""
        variance = self.variance(n, age)
        apart = self.swarm.believed_position[self.robot[n]] - place - self.back[n, age]
        return exp(-0.5 * apart.dot(apart) / variance) / (2.0 * pi * variance)

    @ti.func
    def likelihood(self, n, place):
        """Of a detection by robot n, had the source been there [m]."""
        none = 1.0
        for age in range(self.released(n)):
            none *= 1.0 - ti.min(1.0, self.p.notice[n] * self.patch(n, place, age))
        return self._detected(n, 1.0 - none)

    @ti.func
    def is_on_floor(self, place):
        """Whether a place [m] is on it."""
        return (place >= ti.Vector(self.floor[0])).all() and (place <= ti.Vector(self.floor[1])).all()

    @ti.func
    def _detected(self, n, there):
        """The chance of a detection, where patches are there with a chance."""
        return self.p.false_alarm[n] + (1.0 - self.p.false_alarm[n]) * self.p.detection[n] * there

    @ti.func
    def chance_by_chance(self, n):
        """Of a detection by robot n, had the source been anywhere on the floor: about that of the releases on it."""
        x = self.swarm.believed_position[self.robot[n]]
        low, high = ti.Vector(self.floor[0]), ti.Vector(self.floor[1])
        on_floor = 0
        for age in range(self.released(n)):
            on_floor += ti.cast(self.is_on_floor(x - self.back[n, age]), ti.i32)
        area = (high - low)[0] * (high - low)[1]
        return self._detected(n, 1.0 - exp(-self.p.notice[n] * on_floor / area))
