"""Plume tracking: the base class of casting, surge-cast and surge-spiral; upwind estimate, plume detection, steering.

U: unit vector upwind, V: U turned left by 90°, s = ±1: the robot's side.

FIND      sweep along s V until blocked, then UPWIND
UPWIND    step along U by find_step, then FIND on the other side; when blocked, later steps go the other way

Out of the plume: reading below 70 % of the threshold, or below peak_fraction of the largest since entering, in time for
a slow sensor. Into the plume: reading at the threshold or more, and (if peak_fraction is in use) up by 15 % from the
smallest since the loss.
"""

import numpy as np

from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.lag import Lag
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.swarm import wrap
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin, direction
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario.plume_tracking import PlumeTracking

FIND, UPWIND = range(2)

LEAVE = 0.7  # fraction of the threshold below which a robot is out of the plume
RISE = 1.15  # multiple of the smallest reading since the loss, required to enter the plume
PATIENCE = 1.0  # s blocked before the robot gives way
STEER = 0.25  # s in which the robot tries to turn to its course
ON_COURSE = 0.98  # cosine of the heading error; below, the robot turns away from the contact


class PlumeTracker(KernelAlgorithm):
    """Base class of plume-tracking algorithms. tick: control period [s].

    A subclass adds its own states and `numbers`, and overrides `_decide`, which changes the state, and `_course`, the
    driving direction in each state.
    """

    STATE: tuple[str, ...] = (
        *("wind", "upwind", "side", "step_sign", "peak", "trough", "needed", "mark", "stuck"),
    )
    DECISIONS: tuple[Decision, ...] = (
        Decision("needed_ppm", "ppm", "reading needed to enter the plume or, in it, to stay", "needed"),
        Decision("upwind_x", "1", "estimated unit vector upwind", "upwind", 0),
        Decision("upwind_y", "1", "estimated unit vector upwind", "upwind", 1),
        Decision("cast_side", "1", "side of crosswind motion: 1 left of upwind, -1 right", "side"),
    )

    def _allocate(self) -> None:
        n = self.size
        self.wind = ti.vector_field(2, ti.f32, n)  # average of the measured wind [m/s]
        self.upwind = ti.vector_field(2, ti.f32, n)  # U; the first heading until wind is measured
        self.side = ti.field(ti.f32, n)  # s
        self.step_sign = ti.field(ti.f32, n)  # +1: find upwind, -1: downwind
        self.peak = ti.field(ti.f32, n)  # largest reading since entering the plume [ppm]
        self.trough = ti.field(ti.f32, n)  # smallest reading since losing the plume [ppm]
        self.needed = ti.filled(np.full(n, np.nan), ti.f32)  # reading that was needed in the last test [ppm]
        self.mark = ti.field(ti.f32, n)  # odometer at the start of the state, or at the last gas [m]
        self.stuck = ti.field(ti.f32, n)  # time blocked in a row [s]
        self.bump = ti.field(ti.i32, n)  # whether an obstacle is ahead on the robot's course

    def numbers(self, group: GroupRange, model: PlumeTracking) -> Numbers:
        return {
            "speed": group.speed(model.speed),  # m/s
            "threshold": model.threshold_ppm,
            "leave": LEAVE * model.threshold_ppm,
            "peak_fraction": model.peak_fraction,
            "lost_distance": model.lost_distance,  # m
            "find_step": model.find_step,  # m
            "averaging": Lag(model.wind_memory, self.tick).share,
        }

    @ti.func
    def _start(self, n):
        i = self.robot[n]
        heading = self.swarm.believed_heading[i]
        self.upwind[n] = ti.Vector([ti.cos(heading), ti.sin(heading)])
        u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], 0, 0)
        self.side[n] = ti.select(u.x > 0.5, 1.0, -1.0)  # type: ignore[operator]
        self.step_sign[n] = 1.0
        self.swarm.state[i] = FIND

    @ti.func
    def _step(self, n, tick, t, dt):
        self._estimate_wind(n)
        self._feel_bumper(n, dt)
        self._decide(n, dt)
        self._steer(n, dt)

    @ti.func
    def _decide(self, n, dt):
        """Change the state of robot n, if necessary, by its gas reading, bumper and distance driven."""
        self._find(n)

    @ti.func
    def _course(self, n):
        """Return the unit vector (2,) along which robot n intends to drive."""
        return self._finding_course(n)

    @ti.func
    def _finding_course(self, n):
        """Return robot n's driving direction (2,): along the wind in UPWIND, across the wind in all other states."""
        U = self.upwind[n]
        V = ti.Vector([-U[1], U[0]])
        course = self.side[n] * V
        if self.swarm.state[self.robot[n]] == UPWIND:
            course = self.step_sign[n] * U
        return course

    @ti.func
    def _estimate_wind(self, n):
        i = self.robot[n]
        if self.swarm.wind_known[i] == 1:
            self.wind[n] += self.p.averaging[n] * (self.swarm.wind[i] - self.wind[n])
            speed = self.wind[n].norm()
            if speed > 0.0:
                self.upwind[n] = -self.wind[n] / speed

    @ti.func
    def _feel_bumper(self, n, dt):
        i = self.robot[n]
        self.bump[n] = 0
        if self.swarm.blocked[i] == 1:
            heading = self.swarm.believed_heading[i]
            if cos_sin(heading).dot(self._course(n)) > ON_COURSE:
                self.bump[n] = 1
                self.stuck[n] += dt
        else:
            self.stuck[n] = 0.0

    @ti.func
    def _driven(self, n):
        """Return the distance [m] that robot n drove since it entered its state, or since the last gas in the plume."""
        return self.swarm.odometer[self.robot[n]] - self.mark[n]

    @ti.func
    def _still_smells(self, n):
        """Return whether robot n, which was in the plume, still detects gas; if so, mark its odometer."""
        c = self.swarm.reading[self.robot[n]]
        self.peak[n] = ti.max(self.peak[n], c)
        self.trough[n] = c
        needed = self._needed_to_stay(n)
        self.needed[n] = needed
        smells = c >= needed
        if smells:
            self.mark[n] = self.swarm.odometer[self.robot[n]]
        return smells

    @ti.func
    def _is_strong(self, n):
        """Return whether robot n's reading is high enough, relative to threshold and peak, to be in the plume."""
        return self.swarm.reading[self.robot[n]] >= self._needed_to_stay(n)

    @ti.func
    def _needed_to_stay(self, n):
        """Return the smallest reading [ppm] with which robot n is still in the plume."""
        return ti.max(self.p.leave[n], self.p.peak_fraction[n] * self.peak[n])

    @ti.func
    def _comes_upon_plume(self, n):
        """Return whether robot n, which was out of the plume, has entered the plume by its reading."""
        c = self.swarm.reading[self.robot[n]]
        self.trough[n] = ti.min(self.trough[n], c)
        rise = ti.select(self.p.peak_fraction[n] > 0.0, RISE * self.trough[n], 0.0)
        needed = ti.max(self.p.threshold[n], rise)
        self.needed[n] = needed
        enters = c >= needed
        if enters:
            self.peak[n] = c
            self.step_sign[n] = 1.0
        return enters

    @ti.func
    def _find(self, n):
        """Search for the plume with robot n: alternate crosswind sweeps (FIND) and steps along the wind (UPWIND)."""
        bump = self.bump[n] == 1
        if self.swarm.state[self.robot[n]] == FIND:
            if bump:
                self._enter(n, UPWIND)
        elif bump or self._driven(n) >= self.p.find_step[n]:
            if bump:
                self.step_sign[n] = -self.step_sign[n]
            self.side[n] = -self.side[n]
            self._enter(n, FIND)

    @ti.func
    def _enter(self, n, state):
        self.swarm.state[self.robot[n]] = state
        self.mark[n] = self.swarm.odometer[self.robot[n]]
        self.stuck[n] = 0.0

    @ti.func
    def _steer(self, n, dt):
        """Command robot n to turn to its driving direction, and to drive slower the larger the heading error is."""
        i = self.robot[n]
        course = self._course(n)
        error = wrap(direction(course.y, course.x) - self.swarm.believed_heading[i])
        self.swarm.turn_rate_command[i] = error / self.swarm.turn_time(i, ti.max(dt, STEER))
        self.swarm.speed_command[i] = self.p.speed[n] * ti.max(0.0, cos_sin(error)[0])
