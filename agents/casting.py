"""Casting: upwind at an angle while in the plume, crosswind sweeps when it is lost.

After Lochmatter & Martinoli, "Tracking odor plumes in a laminar wind field with bio-inspired algorithms",
ISER 2008. U: unit vector upwind, V: U turned left by 90°, s = ±1: the robot's side.

FIND      sweep along s V until blocked, then UPWIND
UPWIND    step along U by find_step, then FIND on the other side; when blocked, later steps go the other way
IN_PLUME  drive along U turned by upwind_angle towards s; out of the plume for lost_distance: other side,
          LOST; blocked for PATIENCE: SIDESTEP
LOST      sweep along s V, back to where the plume was; after cast_distance, or blocked: other side, twice as
          far; after CASTS sweeps FIND
SIDESTEP  along s V by lost_distance, then IN_PLUME; blocked for PATIENCE: other side

Out of the plume: reading below 70 % of the threshold, or below peak_fraction of the largest since entering,
so that a slow sensor notices in time. Into it: reading at the threshold or more, and (where peak_fraction is
in use) up by 15 % from the smallest since the loss.
"""

from math import expm1, radians

import taichi as ti

from taichi_plume import robots
from taichi_plume.agents.swarm import GroupRange, Swarm, wrap
from taichi_plume.rng import stream_id, uniform4

FIND, UPWIND, IN_PLUME, LOST, SIDESTEP = range(5)

LEAVE = 0.7  # of the threshold
RISE = 1.15  # of the trough
CASTS = 4  # failed sweeps before the search starts anew
PATIENCE = 1.0  # s blocked before giving way
STEER = 0.25  # s in which the robot tries to turn to its course
ON_COURSE = 0.98  # cosine of the heading error; below, contact is with what the robot turns away from


@ti.data_oriented
class Casting:
    """The casting algorithm for the robots of one group. tick: control period [s]."""

    STATE_NAMES: tuple[str, ...] = ("FIND", "UPWIND", "IN_PLUME", "LOST", "SIDESTEP")

    def __init__(self, swarm: Swarm, group: GroupRange, tick: float):
        model: robots.Casting = group.model.algorithm
        self.swarm, self.start, self.size = swarm, group.start, group.size
        self.seed, self.stream = swarm.seed, stream_id(f"group {group.number}/casting")
        self.first = group.first
        self.speed = group.model.body.max_speed if model.speed is None else model.speed
        self.threshold = model.threshold_ppm
        self.angle = radians(model.upwind_angle_deg)
        self.lost_distance, self.cast_distance = model.lost_distance, model.cast_distance
        self.find_step = model.find_step
        self.peak_fraction = model.peak_fraction
        self.averaging = -expm1(-tick / model.wind_memory) if model.wind_memory > 0 else 1.0
        n = self.size
        self.wind = ti.Vector.field(2, ti.f32, n)  # average of the measured wind [m/s]
        self.upwind = ti.Vector.field(2, ti.f32, n)  # U; the first heading until wind is felt
        self.side = ti.field(ti.f32, n)  # s
        self.step_sign = ti.field(ti.f32, n)  # +1: find upwind, -1: downwind
        self.peak = ti.field(ti.f32, n)  # largest reading since entering the plume [ppm]
        self.trough = ti.field(ti.f32, n)  # smallest reading since losing it [ppm]
        self.mark = ti.field(ti.f32, n)  # odometer [m] at the begin of the leg; in the plume, at the last gas
        self.cast = ti.field(ti.f32, n)  # length of the present sweep [m]
        self.failed = ti.field(ti.i32, n)  # sweeps without gas
        self.stuck = ti.field(ti.f32, n)  # time blocked in a row [s]
        self._begin()

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn the readings at time t [s] into commands for the next dt [s]."""
        self._act(dt)

    @ti.kernel
    def _begin(self):
        for n in range(self.size):
            i = self.start + n
            heading = self.swarm.heading[i]
            self.upwind[n] = ti.Vector([ti.cos(heading), ti.sin(heading)])
            u = uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, 0, 0)
            self.side[n] = ti.select(u.x > 0.5, 1.0, -1.0)  # type: ignore[operator]
            self.step_sign[n] = 1.0
            self.swarm.state[i] = FIND

    @ti.kernel
    def _act(self, dt: float):
        for n in range(self.size):
            self._estimate_wind(n)
            self._decide(n, dt)
            self._steer(n, dt)

    @ti.func
    def _estimate_wind(self, n):
        i = self.start + n
        if self.swarm.wind_known[i] == 1:
            self.wind[n] += self.averaging * (self.swarm.wind[i] - self.wind[n])
            speed = self.wind[n].norm()
            if speed > 0.0:
                self.upwind[n] = -self.wind[n] / speed

    @ti.func
    def _course(self, n):
        """Unit vector along which the robot wants to drive."""
        state, s = self.swarm.state[self.start + n], self.side[n]
        U = self.upwind[n]
        V = ti.Vector([-U[1], U[0]])
        course = s * V
        if state == UPWIND:
            course = self.step_sign[n] * U
        elif state == IN_PLUME:
            course = ti.cos(self.angle) * U + s * ti.sin(self.angle) * V
        return course

    @ti.func
    def _decide(self, n, dt):
        i = self.start + n
        state, c = self.swarm.state[i], self.swarm.reading[i]
        heading = self.swarm.heading[i]
        facing = ti.Vector([ti.cos(heading), ti.sin(heading)]).dot(self._course(n))
        blocked = self.swarm.blocked[i] == 1 and facing > ON_COURSE
        if blocked:
            self.stuck[n] += dt
        elif self.swarm.blocked[i] == 0:
            self.stuck[n] = 0.0
        driven = self.swarm.path_length[i] - self.mark[n]

        if state == IN_PLUME or state == SIDESTEP:  # noqa: SIM109 (Taichi knows no `in`)
            self.peak[n] = ti.max(self.peak[n], c)
            self.trough[n] = c
        else:
            self.trough[n] = ti.min(self.trough[n], c)
        risen = self.peak_fraction == 0.0 or c >= RISE * self.trough[n]

        if state == IN_PLUME:
            out = c < LEAVE * self.threshold or c < self.peak_fraction * self.peak[n]
            if not out:
                self.mark[n] = self.swarm.path_length[i]
            if out and driven >= self.lost_distance:
                self.side[n] = -self.side[n]
                self.cast[n] = self.cast_distance
                self.failed[n] = 0
                self._enter(n, LOST)
            elif self.stuck[n] > PATIENCE:
                self._enter(n, SIDESTEP)
        elif state == SIDESTEP:
            if driven >= self.lost_distance:
                self._enter(n, IN_PLUME)
            elif self.stuck[n] > PATIENCE:
                self.side[n] = -self.side[n]
                self._enter(n, SIDESTEP)
        elif c >= self.threshold and risen:
            self.peak[n] = c
            self.step_sign[n] = 1.0
            self._enter(n, IN_PLUME)
        elif state == LOST:
            if blocked or driven >= self.cast[n]:
                self.side[n] = -self.side[n]
                self.cast[n] *= 2.0
                self.failed[n] += 1
                self._enter(n, ti.select(self.failed[n] >= CASTS, FIND, LOST))
        elif state == FIND:
            if blocked:
                self._enter(n, UPWIND)
        elif blocked or driven >= self.find_step:  # UPWIND
            if blocked:
                self.step_sign[n] = -self.step_sign[n]
            self.side[n] = -self.side[n]
            self._enter(n, FIND)

    @ti.func
    def _enter(self, n, state):
        self.swarm.state[self.start + n] = state
        self.mark[n] = self.swarm.path_length[self.start + n]
        self.stuck[n] = 0.0

    @ti.func
    def _steer(self, n, dt):
        """Turn towards the course; the less it faces it, the slower it drives."""
        i = self.start + n
        course = self._course(n)
        error = wrap(ti.atan2(course.y, course.x) - self.swarm.heading[i])
        self.swarm.turn_rate_command[i] = error / ti.max(dt, STEER)
        self.swarm.speed_command[i] = self.speed * ti.max(0.0, ti.cos(error))
