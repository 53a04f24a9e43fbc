"""Line-up: a diagonal line of robots, at equal distances, that sweeps to and fro across the wind.

After Marjovi & Marques, "Optimal swarm formation for odor plume finding", IEEE Trans. Cybernetics 44 (2014) 2302-2315,
and Autonomous Robots 35 (2013) 93-109; its sizes are our choice. a: along the wind, b: across it (to the left), both
from the middle of the floor. Robot i of the N of a team, counted downwind, has the place

    a_i = spacing (i - (N - 1)/2),    b_i = b + tilt stagger ((N - 1)/2 - i),    tilt = ±1

FEEL   stand and measure the wind; the team shares its mean. Without any the line lies along x
FORM   drive to the places at the nearer side of the floor; the upwind end leads
SWEEP  b moves on; where an end of the line comes to the margin, it goes back: with the same tilt, then the other end
       leads, or mirrored, after FORM
WAIT   as SWEEP, but the line stands until stragglers are there

A lone robot sweeps likewise, and after each sweep steps by `stagger` upwind (from the margin on downwind, and so on).
Places beyond the margin, as in a wind askew to the walls, are brought back to it. The line is one: its robots know of
each other whatever the range of their messages.
"""

from math import cos, radians, sin
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.agents.potential import Potential
from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.scenario import algorithms

FEEL, FORM, SWEEP, WAIT = range(4)

MOST_SLANT = 0.5  # of the width of the sweep that the line may take across it
PROGRESS = 0.02  # m
STILL = 1e-3  # m/s
FAR = 1e9  # m


@ti.data_oriented
class LineUp:
    """The line-up of the robots of one group, one line per trial. tick: control period [s]."""

    STATE_NAMES: tuple[str, ...] = ("FEEL", "FORM", "SWEEP", "WAIT")

    def __init__(self, swarm: Swarm, group: GroupRange, tick: float):
        model = group.model.algorithm
        assert isinstance(model, algorithms.LineUp)
        self.swarm, self.start, self.count, self.trials = swarm, group.start, group.count, group.trials
        self.potential = Potential(swarm, group, model.speed, model.avoidance)
        self.line_speed, self.mirror = model.line_speed, model.mirror
        self.spacing, self.stagger = model.spacing or 0.0, model.stagger
        self.tolerance, self.patience = model.tolerance, model.patience
        low, high = np.array(swarm.clearance.low), np.array(swarm.clearance.high)
        self.middle = tuple((low + high) / 2)
        self.half = tuple((high - low) / 2 - model.margin)  # of where the line may be [m]
        self.feeling = max(1, round(model.listen / tick))  # ticks
        self.mode = ti.field(ti.i32, self.trials)
        self.wind: Any = ti.Vector.field(
            2, ti.f32, self.trials
        )  # sum of what was measured, then the direction
        self.slant = ti.field(ti.f32, self.trials)  # b from robot to robot [m]
        self.gap = ti.field(ti.f32, self.trials)  # a from robot to robot [m]
        self.a = ti.field(ti.f32, self.trials)  # of the line's middle [m]
        self.b = ti.field(ti.f32, self.trials)
        self.tilt = ti.field(ti.f32, self.trials)
        self.way = ti.field(ti.f32, self.trials)  # +1: b grows, -1: it shrinks
        self.step = ti.field(ti.f32, self.trials)  # of a lone robot, along the wind [m]
        n = group.size
        self.rank = ti.field(ti.i32, n)  # i
        self.least = ti.field(ti.f32, n)  # smallest distance to its place since it had reached it [m]
        self.late = ti.field(ti.f32, n)  # time since it came closer [s]
        self.given = model.wind_direction_deg is not None
        angle = radians(model.wind_direction_deg or 0.0)
        self.direction = (cos(angle), sin(angle))

    def act(self, tick: int, t: float, dt: float) -> None:
        """Command the next dt [s]."""
        self._act(tick, dt)

    @ti.kernel
    def _act(self, tick: int, dt: float):
        for k in range(self.trials):
            if self.mode[k] == FEEL:
                self._feel(k, tick)
            if self.mode[k] != FEEL:
                self._advance(k, dt)
            for m in range(self.count):
                n = k * self.count + m
                self.swarm.state[self.start + n] = self.mode[k]
                if self.mode[k] == FEEL:
                    self.potential.stand(n)
                else:
                    self.potential.drive(n, self.place(n), dt)

    @ti.func
    def place(self, n):
        """Where robot n of the group belongs [m]."""
        k = n // self.count
        w = self.wind[k]
        behind = self.rank[n] - 0.5 * (self.count - 1)
        a, b = self.a[k] + self.gap[k] * behind, self.b[k] - self.tilt[k] * self.slant[k] * behind
        middle, half = ti.Vector([self.middle[0], self.middle[1]]), ti.Vector([self.half[0], self.half[1]])
        spot = middle + a * w + b * ti.Vector([-w[1], w[0]])
        return self.potential.clear(ti.math.clamp(spot, middle - half, middle + half))

    @ti.func
    def _feel(self, k, tick):
        for m in range(self.count):
            self.wind[k] += self.swarm.wind[self.start + k * self.count + m]  # zero where it is not known
        if ti.static(self.given) or tick >= self.feeling:
            speed = self.wind[k].norm()
            if ti.static(self.given) or speed == 0.0:
                self.wind[k] = ti.Vector([self.direction[0], self.direction[1]])
            else:
                self.wind[k] /= speed
            self._form_first(k)

    @ti.func
    def _extent(self, axis):
        """Half the extent of where the line may be, along a unit vector [m]."""
        return ti.abs(axis[0]) * self.half[0] + ti.abs(axis[1]) * self.half[1]

    @ti.func
    def _across(self, k):
        """Half the extent across the wind, less half of the line's own [m]: b stays within it."""
        w = self.wind[k]
        return self._extent(ti.Vector([-w[1], w[0]])) - 0.5 * self.slant[k] * (self.count - 1)

    @ti.func
    def _form_first(self, k):
        """Measures, order and side of the line."""
        w = self.wind[k]
        along, across = self._extent(w), self._extent(ti.Vector([-w[1], w[0]]))
        gaps = ti.max(self.count - 1, 1)
        self.gap[k] = self.spacing
        if ti.static(self.spacing == 0.0):
            self.gap[k] = 2.0 * along / gaps
        self.slant[k] = ti.min(self.stagger, 2.0 * MOST_SLANT * across / gaps)
        if ti.static(self.count == 1):
            self.a[k], self.step[k] = along, -self.stagger
        side = 0.0
        for m in range(self.count):
            n = k * self.count + m
            x = self.swarm.believed_position[self.start + n]
            side += (x - ti.Vector([self.middle[0], self.middle[1]])).dot(ti.Vector([-w[1], w[0]]))
            self.rank[n] = 0
            for other in range(self.count):
                behind = (self.swarm.believed_position[self.start + k * self.count + other] - x).dot(w)
                self.rank[n] += ti.cast(behind < 0.0 or (behind == 0.0 and other < m), ti.i32)
        self.way[k] = ti.select(side > 0.0, -1.0, 1.0)
        self.tilt[k] = self.way[k]
        self.b[k] = -self.way[k] * self._across(k)
        self._form(k)

    @ti.func
    def _form(self, k):
        self.mode[k] = FORM
        for m in range(self.count):
            n = k * self.count + m
            self.late[n], self.least[n] = 0.0, FAR
            self.potential.begin(n)

    @ti.func
    def _advance(self, k, dt):
        """Move the line on, unless it waits."""
        waits = 0
        for m in range(self.count):
            n = k * self.count + m
            waits = ti.max(waits, self._is_awaited(n, dt))
        if waits == 1:
            self.mode[k] = ti.select(self.mode[k] == FORM, FORM, WAIT)
        else:
            self.mode[k] = SWEEP
            self.b[k] += self.way[k] * self.line_speed * dt
            most = self._across(k)
            if self.way[k] * self.b[k] >= most:
                self.b[k] = self.way[k] * most
                self.way[k] = -self.way[k]
                self._turn_back(k)

    @ti.func
    def _turn_back(self, k):
        if ti.static(self.count == 1):
            along = self._extent(self.wind[k])
            if ti.abs(self.a[k] + self.step[k]) > along + PROGRESS:
                self.step[k] = -self.step[k]
            self.a[k] = ti.math.clamp(self.a[k] + self.step[k], -along, along)
            self._form(k)
        elif ti.static(self.mirror):
            self.tilt[k] = -self.tilt[k]
            self._form(k)

    @ti.func
    def _is_awaited(self, n, dt):
        """Whether robot n is off its place, but may still come."""
        i = self.start + n
        off = (self.place(n) - self.swarm.believed_position[i]).norm()
        comes = off <= self.tolerance or off < self.least[n] - PROGRESS
        if comes and self.swarm.velocity[i].norm() > STILL:  # not that the line comes to it
            self.late[n], self.least[n] = 0.0, off
        else:
            self.late[n] += dt
        return ti.cast(off > self.tolerance and self.late[n] <= self.patience, ti.i32)
