"""What plume tracking algorithms share: where upwind is, whether there is gas, how to find a plume, how to steer.

U: unit vector upwind, V: U turned left by 90°, s = ±1: the robot's side.

FIND      sweep along s V until blocked, then UPWIND
UPWIND    step along U by find_step, then FIND on the other side; when blocked, later steps go the other way

Out of the plume: reading below 70 % of the threshold, or below peak_fraction of the largest since entering,
so that a slow sensor notices in time. Into it: reading at the threshold or more, and (where peak_fraction is
in use) up by 15 % from the smallest since the loss.
"""

import taichi as ti

from taichi_plume.agents.sensors import Lag
from taichi_plume.agents.swarm import GroupRange, Swarm, wrap
from taichi_plume.grid.rng import stream_id, uniform4
from taichi_plume.scenario import algorithms

FIND, UPWIND = range(2)

LEAVE = 0.7  # of the threshold
RISE = 1.15  # of the trough
PATIENCE = 1.0  # s blocked before giving way
STEER = 0.25  # s in which the robot tries to turn to its course
ON_COURSE = 0.98  # cosine of the heading error; below, contact is with what the robot turns away from


@ti.data_oriented
class PlumeTracker:
    """The part of a plume tracking algorithm that they share, for the robots of one group. tick: control period [s].

    A tracker adds its own states and overrides `_decide`, which changes them, and `_course`, where each one leads.
    """

    def __init__(self, swarm: Swarm, group: GroupRange, tick: float):
        model = group.model.algorithm
        assert isinstance(model, algorithms.PlumeTracking)
        self.swarm, self.start, self.size = swarm, group.start, group.size
        self.seed, self.first = swarm.seed, group.first
        self.stream = stream_id(f"group {group.number}/{model.kind}")
        self.speed = group.speed(model.speed)
        self.threshold, self.peak_fraction = model.threshold_ppm, model.peak_fraction
        self.lost_distance, self.find_step = model.lost_distance, model.find_step
        self.averaging = Lag(model.wind_memory, tick).share
        n = self.size
        self.wind = ti.Vector.field(2, ti.f32, n)  # average of the measured wind [m/s]
        self.upwind = ti.Vector.field(2, ti.f32, n)  # U; the first heading until wind is felt
        self.side = ti.field(ti.f32, n)  # s
        self.step_sign = ti.field(ti.f32, n)  # +1: find upwind, -1: downwind
        self.peak = ti.field(ti.f32, n)  # largest reading since entering the plume [ppm]
        self.trough = ti.field(ti.f32, n)  # smallest reading since losing it [ppm]
        self.mark = ti.field(ti.f32, n)  # odometer [m] at the begin of the leg; in the plume, at the last gas
        self.stuck = ti.field(ti.f32, n)  # time blocked in a row [s]
        self.bump = ti.field(ti.i32, n)  # whether what it drives towards is in the way
        self._begin()

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn the readings at time t [s] into commands for the next dt [s]."""
        self._act(dt)

    @ti.kernel
    def _begin(self):
        for n in range(self.size):
            i = self.start + n
            heading = self.swarm.believed_heading[i]
            self.upwind[n] = ti.Vector([ti.cos(heading), ti.sin(heading)])
            u = uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, 0, 0)
            self.side[n] = ti.select(u.x > 0.5, 1.0, -1.0)  # type: ignore[operator]
            self.step_sign[n] = 1.0
            self.swarm.state[i] = FIND

    @ti.kernel
    def _act(self, dt: float):
        for n in range(self.size):
            self._estimate_wind(n)
            self._feel_bumper(n, dt)
            self._decide(n, dt)
            self._steer(n, dt)

    @ti.func
    def _decide(self, n, dt):
        """Change the state of robot n where the readings say so."""
        self._find(n)

    @ti.func
    def _course(self, n):
        """Unit vector along which the robot wants to drive."""
        return self._finding_course(n)

    @ti.func
    def _finding_course(self, n):
        """That of FIND and UPWIND, and of any sweep along s V."""
        U = self.upwind[n]
        V = ti.Vector([-U[1], U[0]])
        course = self.side[n] * V
        if self.swarm.state[self.start + n] == UPWIND:
            course = self.step_sign[n] * U
        return course

    @ti.func
    def _estimate_wind(self, n):
        i = self.start + n
        if self.swarm.wind_known[i] == 1:
            self.wind[n] += self.averaging * (self.swarm.wind[i] - self.wind[n])
            speed = self.wind[n].norm()
            if speed > 0.0:
                self.upwind[n] = -self.wind[n] / speed

    @ti.func
    def _feel_bumper(self, n, dt):
        i = self.start + n
        self.bump[n] = 0
        if self.swarm.blocked[i] == 1:
            heading = self.swarm.believed_heading[i]
            if ti.Vector([ti.cos(heading), ti.sin(heading)]).dot(self._course(n)) > ON_COURSE:
                self.bump[n] = 1
                self.stuck[n] += dt
        else:
            self.stuck[n] = 0.0

    @ti.func
    def _driven(self, n):
        """Way [m] since the begin of the leg; in the plume, since the last gas."""
        return self.swarm.odometer[self.start + n] - self.mark[n]

    @ti.func
    def _still_smells(self, n):
        """Whether a robot that is in the plume still smells it; marks where it does."""
        c = self.swarm.reading[self.start + n]
        self.peak[n] = ti.max(self.peak[n], c)
        self.trough[n] = c
        smells = c >= LEAVE * self.threshold and c >= self.peak_fraction * self.peak[n]
        if smells:
            self.mark[n] = self.swarm.odometer[self.start + n]
        return smells

    @ti.func
    def _comes_upon_plume(self, n):
        """Whether a robot that is not in the plume has come into it."""
        c = self.swarm.reading[self.start + n]
        self.trough[n] = ti.min(self.trough[n], c)
        enters = c >= self.threshold and (self.peak_fraction == 0.0 or c >= RISE * self.trough[n])
        if enters:
            self.peak[n] = c
            self.step_sign[n] = 1.0
        return enters

    @ti.func
    def _find(self, n):
        """FIND and UPWIND by turns."""
        bump = self.bump[n] == 1
        if self.swarm.state[self.start + n] == FIND:
            if bump:
                self._enter(n, UPWIND)
        elif bump or self._driven(n) >= self.find_step:
            if bump:
                self.step_sign[n] = -self.step_sign[n]
            self.side[n] = -self.side[n]
            self._enter(n, FIND)

    @ti.func
    def _enter(self, n, state):
        self.swarm.state[self.start + n] = state
        self.mark[n] = self.swarm.odometer[self.start + n]
        self.stuck[n] = 0.0

    @ti.func
    def _steer(self, n, dt):
        """Turn towards the course; the less it faces it, the slower it drives."""
        i = self.start + n
        course = self._course(n)
        error = wrap(ti.atan2(course.y, course.x) - self.swarm.believed_heading[i])
        self.swarm.turn_rate_command[i] = error / ti.max(dt, STEER)
        self.swarm.speed_command[i] = self.speed * ti.max(0.0, ti.cos(error))
