"""Plume model of releases: positions of the gas patches from a source, and the likelihood of a detection.

The plume model of Pang & Farrell, IEEE Trans. Systems, Man, and Cybernetics B 36 (2006) 1068-1080,
doi:10.1109/TSMCB.2006.874689. A patch that a source at s released `age` before has now the mean and variance

    s + Σ u Δt over the periods since,  σ² = patch² + 2 D age  per axis

u: wind that the robot measured in each period Δt, used for the whole floor. With a release each period,
the likelihood of a detection in an update by a robot at x is

    false_alarm + (1 - false_alarm) detection (1 - Π (1 - min(1, π notice² N(x; s + Σ u Δt, σ²))))
"""

from math import pi

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import exp
from taichi_plume.scenario.belief_algorithms import ParticleFilter as Model


class Releases:
    """Gas patches released in the last `most` periods, tracked by the wind that each robot of a group measures.

    period: time between releases [s]. parameters: must include the entries of `Releases.numbers`.
    """

    STATE: tuple[str, ...] = ("wind_way", "drift", "periods")

    def __init__(self, members: Members, parameters: Parameters, most: int, period: float):
        self.swarm, self.robot, self.p = members.swarm, members.robot, parameters
        self.most, self.period = most, period
        low, high = members.swarm.clearance.low, members.swarm.clearance.high
        self.floor = (tuple(low), tuple(high))
        n = members.size
        self.wind_way = ti.vector_field(2, ti.f32, (n, most))  # Σ u Δt of each period, a ring buffer [m]
        self.drift = ti.vector_field(2, ti.f32, n)  # Σ u Δt of the present period so far [m]
        self.periods = ti.field(ti.i32, n)  # number of periods so far
        self.back = ti.vector_field(2, ti.f32, (n, most + 1))  # drift since each release, newest first [m]

    @staticmethod
    def numbers(model: Model) -> Numbers:
        """Return the kernel parameters of the plume model: patch variance and growth, detection probabilities."""
        return {
            "first": model.patch**2,  # variance at the release [m²]
            "growth": 2.0 * model.diffusivity,  # m²/s
            "notice": pi * model.notice**2,  # m²
            "detection": model.detection,
            "false_alarm": model.false_alarm,
        }

    @ti.func
    def drifts(self, n, dt):
        """Add robot n's measured wind, if known, times dt [s] to the displacement of the air in this period."""
        i = self.robot[n]
        if self.swarm.wind_known[i] == 1:
            self.drift[n] += dt * self.swarm.wind[i]

    @ti.func
    def look_back(self, n):
        """End a period for robot n: update the displacements `back` of the air since each release."""
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
        """Return the number of releases that robot n considers; the newest has the age 0."""
        return ti.min(self.periods[n], self.most) + 1

    @ti.func
    def variance(self, n, age):
        """Return the variance [m²] along each axis of a gas patch released `age` periods ago."""
        return self.p.first[n] + self.p.growth[n] * self.period * age

    @ti.func
    def patch(self, n, place, age):
        """Return the density [1/m²], at robot n, of a gas patch released at `place` [m] `age` periods ago."""
        variance = self.variance(n, age)
        apart = self.swarm.believed_position[self.robot[n]] - place - self.back[n, age]
        return exp(-0.5 * apart.dot(apart) / variance) / (2.0 * pi * variance)

    @ti.func
    def likelihood(self, n, place):
        """Return the likelihood that robot n detects gas from a source at `place` [m]."""
        none = 1.0
        for age in range(self.released(n)):
            none *= 1.0 - ti.min(1.0, self.p.notice[n] * self.patch(n, place, age))
        return self._probability(n, 1.0 - none)

    @ti.func
    def is_on_floor(self, place):
        """Return whether the point `place` [m] lies on the floor."""
        return (place >= ti.Vector(self.floor[0])).all() and (place <= ti.Vector(self.floor[1])).all()

    @ti.func
    def _probability(self, n, there):
        """Return the probability that robot n's sensor detects gas if patches are present with probability `there`."""
        return self.p.false_alarm[n] + (1.0 - self.p.false_alarm[n]) * self.p.detection[n] * there

    @ti.func
    def likelihood_anywhere(self, n):
        """Return the likelihood that robot n detects gas from a source with a uniform distribution over the floor."""
        x = self.swarm.believed_position[self.robot[n]]
        low, high = ti.Vector(self.floor[0]), ti.Vector(self.floor[1])
        on_floor = 0
        for age in range(self.released(n)):
            on_floor += ti.cast(self.is_on_floor(x - self.back[n, age]), ti.i32)
        area = (high - low)[0] * (high - low)[1]
        return self._probability(n, 1.0 - exp(-self.p.notice[n] * on_floor / area))
