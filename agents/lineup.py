"""Line-up (swarm formation): a diagonal line of robots, at equal distances, that sweeps to and fro across the wind.

After Marjovi & Marques, "Optimal swarm formation for odor plume finding", IEEE Trans. Cybernetics 44 (2014)
2302-2315, and Autonomous Robots 35 (2013) 93-109; its sizes are our choice. a: along the wind, b: across it (to the
left), both from the middle of the floor. Robot i of the N of a team, counted downwind, has the position

    a_i = spacing (i - (N - 1)/2),    b_i = b + tilt stagger ((N - 1)/2 - i),    tilt = ±1

FEEL   stand and measure the wind; the team shares its mean. Without wind the line lies along x
FORM   drive to the positions at the nearer side of the floor; the upwind end leads
SWEEP  b moves on; when an end of the line reaches the margin, the line goes back: with the same tilt, so that the
       other end leads, or mirrored, after FORM
WAIT   as SWEEP, but the line stands until stragglers are there

A lone robot sweeps likewise, and after each sweep steps by `stagger` upwind (from the margin on downwind, and so on).
Positions beyond the margin, as in a wind oblique to the walls, are moved back to the margin. The robots of a line know
each other's positions at any range of their messages.
"""

from math import cos, radians, sin

import numpy as np

from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.potential import Potential
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import long_kernel
from taichi_plume.scenario import algorithms

FEEL, FORM, SWEEP, WAIT = range(4)

MOST_SLANT = 0.5  # largest width of the line over the width of the sweep
PROGRESS = 0.02  # m
STILL = 1e-3  # m/s
FAR = 1e9  # m


class LineUp(KernelAlgorithm):
    """Line-up search algorithm, with one line of robots per team. tick: control period [s]."""

    STATE: tuple[str, ...] = (
        *("potential", "mode", "wind", "slant", "gap", "a", "b", "tilt", "way", "step"),
        *("rank", "least", "late"),
    )
    STATE_NAMES: tuple[str, ...] = ("FEEL", "FORM", "SWEEP", "WAIT")
    DECISIONS: tuple[Decision, ...] = (
        Decision("rank", "1", "number of the robot in its line, counted downwind from 0 on"),
        Decision("line_across_m", "m", "b, position of the line's middle across the wind", "across"),
        Decision("line_tilt", "1", "tilt of the line: 1 or -1; 0 before", "line_tilt"),
        Decision("late_s", "s", "time since the robot came closer to its position", "late"),
    )

    def _allocate(self) -> None:
        self.potential = Potential(self.members, self.p)
        counts = np.array(
            [group.count for group in self.members.groups for _ in range(group.trials)], np.int32
        )
        self.lines = len(counts)
        self.first = ti.filled(np.cumsum(counts) - counts)  # first robot of a line; the others follow
        self.line = ti.filled(np.repeat(np.arange(self.lines), counts))  # number of each robot's line
        n = self.lines
        self.mode = ti.field(ti.i32, n)
        self.wind = ti.vector_field(2, ti.f32, n)  # sum of the measured wind, then its direction
        self.slant = ti.field(ti.f32, n)  # b from robot to robot [m]
        self.gap = ti.field(ti.f32, n)  # a from robot to robot [m]
        self.a = ti.field(ti.f32, n)  # position of the line's middle along the wind [m]
        self.b = ti.field(ti.f32, n)
        self.tilt = ti.field(ti.f32, n)
        self.way = ti.field(ti.f32, n)  # +1: b grows, -1: it shrinks
        self.step = ti.field(ti.f32, n)  # step of a lone robot along the wind [m]
        self.rank = ti.field(ti.i32, self.size)  # i
        self.least = ti.field(
            ti.f32, self.size
        )  # smallest distance to the position since the last arrival [m]
        self.late = ti.field(ti.f32, self.size)  # time since the robot came closer [s]

    def numbers(self, group: GroupRange, model: algorithms.LineUp) -> Numbers:
        low, high = np.array(self.swarm.clearance.low), np.array(self.swarm.clearance.high)
        angle = radians(model.wind_direction_deg or 0.0)
        return {
            **Potential.numbers(self.swarm, group, model.speed, model.avoidance),
            "count": group.count,
            "per_gap": float(np.float32(1) / np.float32(max(group.count - 1, 1))),  # 1 / number of gaps
            "line_speed": model.line_speed,  # m/s
            "mirror": model.mirror,
            "spacing": model.spacing or 0.0,  # m
            "stagger": model.stagger,  # m
            "tolerance": model.tolerance,  # m
            "patience": model.patience,  # s
            "middle": tuple((low + high) / 2),  # centre of the area of the line [m]
            "half": tuple((high - low) / 2 - model.margin),  # half its edges [m]
            "feeling": group.waits(self.tick) + max(1, round(model.listen / self.tick)),  # last tick of FEEL
            "given": model.wind_direction_deg is not None,
            "direction": (cos(angle), sin(angle)),
        }

    @property
    def across(self) -> np.ndarray:
        """Position b of each robot's line across the wind, (size,) [m]."""
        return self.b.values[self.line.values]

    @property
    def line_tilt(self) -> np.ndarray:
        """Tilt of each robot's line, (size,)."""
        return self.tilt.values[self.line.values]

    @long_kernel
    def act(self, tick: int, t: float, dt: float):
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for k in range(self.lines):
            if self.mode[k] == FEEL:
                self._feel(k, tick)
            if self.mode[k] != FEEL:
                self._advance(k, dt)
            first = self.first[k]
            for n in range(first, first + self.p.count[first]):
                self.swarm.state[self.robot[n]] = self.mode[k]
                if self.mode[k] == FEEL:
                    self.potential.stand(n)
                else:
                    self.potential.drive(n, self.place(n), dt)

    @ti.func
    def place(self, n):
        """Return the position (2,) [m] that robot n has to take in its line."""
        k = self.line[n]
        w = self.wind[k]
        behind = self.rank[n] - 0.5 * (self.p.count[n] - 1)
        a, b = self.a[k] + self.gap[k] * behind, self.b[k] - self.tilt[k] * self.slant[k] * behind
        middle, half = self._middle(n), ti.Vector([self.p.half[n, 0], self.p.half[n, 1]])
        spot = middle + a * w + b * ti.Vector([-w[1], w[0]])
        return self.potential.clear(n, ti.math.clamp(spot, middle - half, middle + half))

    @ti.func
    def _middle(self, n):
        """Return the centre (2,) [m] of the floor area in which the line of robot n may move."""
        return ti.Vector([self.p.middle[n, 0], self.p.middle[n, 1]])

    @ti.func
    def _feel(self, k, tick):
        first = self.first[k]
        for n in range(first, first + self.p.count[first]):
            self.wind[k] += self.swarm.wind[self.robot[n]]  # zero if unknown
        given = self.p.given[first] == 1
        if given or tick >= self.p.feeling[first]:
            speed = self.wind[k].norm()
            if given or speed == 0.0:
                self.wind[k] = ti.Vector([self.p.direction[first, 0], self.p.direction[first, 1]])
            else:
                self.wind[k] /= speed
            self._form_first(k)

    @ti.func
    def _extent(self, k, axis):
        """Return half the extent of the floor area of line k along the unit vector `axis` [m]."""
        first = self.first[k]
        return ti.abs(axis[0]) * self.p.half[first, 0] + ti.abs(axis[1]) * self.p.half[first, 1]

    @ti.func
    def _across(self, k):
        """Return the largest |b| [m] of line k: half the floor's extent across the wind less half the line's."""
        w = self.wind[k]
        gaps = self.p.count[self.first[k]] - 1
        return self._extent(k, ti.Vector([-w[1], w[0]])) - 0.5 * self.slant[k] * gaps

    @ti.func
    def _form_first(self, k):
        """Set spacing, slant, order of the robots and first side of line k, by the measured wind."""
        w = self.wind[k]
        along, across = self._extent(k, w), self._extent(k, ti.Vector([-w[1], w[0]]))
        first = self.first[k]
        count, per_gap = self.p.count[first], self.p.per_gap[first]
        self.gap[k] = self.p.spacing[first]
        if self.gap[k] == 0.0:
            self.gap[k] = 2.0 * along * per_gap
        self.slant[k] = ti.min(self.p.stagger[first], 2.0 * MOST_SLANT * across * per_gap)
        if count == 1:
            self.a[k], self.step[k] = along, -self.p.stagger[first]
        side = 0.0
        for n in range(first, first + count):
            x = self.swarm.believed_position[self.robot[n]]
            side += (x - self._middle(n)).dot(ti.Vector([-w[1], w[0]]))
            rank = 0
            for other in range(first, first + count):
                behind = (self.swarm.believed_position[self.robot[other]] - x).dot(w)
                rank += ti.cast(behind < 0.0 or (behind == 0.0 and other < n), ti.i32)
            self.rank[n] = rank
        self.way[k] = ti.select(side > 0.0, -1.0, 1.0)
        self.tilt[k] = self.way[k]
        self.b[k] = -self.way[k] * self._across(k)
        self._form(k)

    @ti.func
    def _form(self, k):
        self.mode[k] = FORM
        first = self.first[k]
        for n in range(first, first + self.p.count[first]):
            self.late[n], self.least[n] = 0.0, FAR
            self.potential.set_out(n)

    @ti.func
    def _advance(self, k, dt):
        """Move team k's line across the wind for a time step dt [s]; the line stands while stragglers are missing."""
        waits = 0
        first = self.first[k]
        for n in range(first, first + self.p.count[first]):
            waits = ti.max(waits, self._is_awaited(n, dt))
        if waits == 1:
            self.mode[k] = ti.select(self.mode[k] == FORM, FORM, WAIT)
        else:
            self.mode[k] = SWEEP
            self.b[k] += self.way[k] * self.p.line_speed[first] * dt
            most = self._across(k)
            if self.way[k] * self.b[k] >= most:
                self.b[k] = self.way[k] * most
                self.way[k] = -self.way[k]
                self._turn_back(k)

    @ti.func
    def _turn_back(self, k):
        first = self.first[k]
        if self.p.count[first] == 1:
            along = self._extent(k, self.wind[k])
            if ti.abs(self.a[k] + self.step[k]) > along + PROGRESS:
                self.step[k] = -self.step[k]
            self.a[k] = ti.math.clamp(self.a[k] + self.step[k], -along, along)
            self._form(k)
        elif self.p.mirror[first] == 1:
            self.tilt[k] = -self.tilt[k]
            self._form(k)

    @ti.func
    def _is_awaited(self, n, dt):
        """Return 1 if robot n is off its position in the line but may still reach the position, else 0."""
        i = self.robot[n]
        off = (self.place(n) - self.swarm.believed_position[i]).norm()
        comes = off <= self.p.tolerance[n] or off < self.least[n] - PROGRESS
        if comes and self.swarm.velocity[i].norm() > STILL:  # otherwise the line comes to the robot
            self.late[n], self.least[n] = 0.0, off
        else:
            self.late[n] = self.late[n] + dt
        return ti.cast(off > self.p.tolerance[n] and self.late[n] <= self.p.patience[n], ti.i32)
