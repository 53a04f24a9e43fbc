"""How robots fly: as holonomic bodies that keep a velocity in the room, or fly to a place.

A robot that flies is told how fast to go ahead, to its left and upward and to turn, or a place and perhaps a heading to
go to. Its velocity in the room follows within its largest acceleration, as a vector; along the ground it is no faster
than `max_speed`, upward than `max_climb` and downward than `max_descent`. It flies straight to a place, as fast as lets
it stop there: of the way d that is left it takes v dt in the next tick with

    v dt + v²/(2 a) <= d   so   v = 2 d/(dt + (dt² + 2 d/a)^½),   a its largest acceleration,

slower where a part of v is beyond its limit. How it tilts and what turns its rotors is not computed. Of a tick's way
the part upward comes first, and the part downward last, so that it rises beside an obstacle before it passes above it.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.agents.columns import Columns
from taichi_plume.agents.contact import Heights
from taichi_plume.grid.elementary import cos_sin, wrap
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.robots import Group

FREE = 0.9  # share of a commanded move below which the bumper feels contact

WINGS: dict[str, Callable[[Group], float]] = {
    "wings": lambda group: float(group.body.flies),
    "height": lambda group: group.body.height,
    "max_climb": lambda group: group.body.max_climb or 0.0,
    "max_descent": lambda group: group.body.max_descent or 0.0,
}
"""What the robots of a group that may fly are like: fields of these names, where any of the swarm does."""


class Flying(Columns):
    """What a swarm some of whose robots fly has more than others."""

    contact: Any
    radius: Any
    max_speed: Any
    max_turn_rate: Any
    max_acceleration: Any
    wings: Any
    height: Any
    max_climb: Any
    max_descent: Any

    def _grow_wings(self, robots: int, walkers: int, sources: int) -> Heights:
        """The fields of robots that fly; what `Contact` needs of them."""
        for name in WINGS:
            setattr(self, name, ti.field(ti.f32, robots))
        self.first_altitude = ti.field(ti.f32, robots)
        self.source_height = ti.field(ti.f32, max(1, sources))
        self.spans: Any = ti.Vector.field(2, ti.f32, max(1, walkers))
        return Heights(self.altitude, self.height, self.wings, self.spans)

    def _flight_fields(self) -> list[Any]:
        """Those that `_flight_numbers` fills, in its order."""
        never = [self.ordered_altitude, self.goal, self.goal_heading]
        bodies = [getattr(self, name) for name in WINGS]
        return [self.altitude, self.first_altitude, self.source_height, self.spans, *never, *bodies]

    def _flight_numbers(
        self, each: Callable[..., np.ndarray], sources: np.ndarray, walkers: Sequence[Obstacle]
    ) -> list[Any]:
        """What a run begins with; each: makes a number per robot, sources: (m, 3) [m]."""
        altitude = each(lambda group: group.start_altitude)
        spans = [one.span for one in walkers] or 0
        heights = sources[:, 2] if len(sources) else 0
        return [
            altitude,
            altitude,
            heights,
            spans,
            *(np.nan,) * 3,
            *(each(value) for value in WINGS.values()),
        ]

    @ti.func
    def _rest(self, i):
        """Robot i has not moved yet in this tick."""
        self.climb_rate[i] = 0.0
        self.acceleration[i] = ti.Vector([0.0, 0.0, 0.0])

    @ti.func
    def _take_off(self, i):
        """Put robot i, all of whose columns are zero, to its altitude at the begin of a run."""
        nan = ti.math.nan
        self.altitude[i], self.ordered_altitude[i] = self.first_altitude[i], nan
        self.goal[i], self.goal_heading[i] = ti.Vector([nan, nan, nan]), nan

    @ti.func
    def middle_over(self, i, s):
        """How high [m] the middle of robot i is above the source number s; 0 on the floor, where heights count not."""
        above = 0.0
        if self.wings[i] == 1.0:
            above = self.altitude[i] + 0.5 * self.height[i] - self.source_height[s]
        return above

    @ti.func
    def _fly(self, i, k, dt):
        """Move robot i of trial k for dt [s]; whether contact cut it short, its turn [rad] and its way [m]."""
        before = self.flight[i]
        heading_rate = self.turn_rate_command[i]
        if not ti.math.isnan(self.goal_heading[i]):
            heading_rate = wrap(self.goal_heading[i] - self.heading[i]) / dt
        limit = self.max_turn_rate[i]
        turn = ti.math.clamp(heading_rate, -limit, limit) * dt
        change = self._wanted_velocity(i, self.heading[i] + 0.5 * turn, dt) - before
        size, most = change.norm(), self.max_acceleration[i] * dt
        if size > most:
            change *= most / size
        v = before + change
        begin, low = self.position[i], self.altitude[i]
        up, met_up = 0.0, 0
        if v[2] > 0.0:
            up, met_up = self.contact.rise(i, k, begin, v[2] * dt)
            self.altitude[i] = low + up
        p, path, met = self.contact.slide(i, k, begin, ti.Vector([v[0], v[1]]) * dt)
        if v[2] < 0.0:
            up, met_up = self.contact.rise(i, k, p, v[2] * dt)
            self.altitude[i] = low + up
        moved = ti.Vector([p[0] - begin[0], p[1] - begin[1], up]) / dt
        self.flight[i], self.acceleration[i] = v, change / dt
        blocked = 0
        if met == 1 or met_up == 1:
            self.flight[i] = moved
            blocked = ti.cast(moved.dot(v) < FREE * v.dot(v), ti.i32)
        self.position[i] = p
        self.velocity[i] = ti.Vector([moved[0], moved[1]])
        self.climb_rate[i] = moved[2]
        self.speed[i] = cos_sin(self.heading[i] + turn).dot(self.velocity[i])
        return blocked, turn, ti.sqrt(path * path + up * up)

    @ti.func
    def _wanted_velocity(self, i, course, dt):
        """Velocity in the room [m/s] that robot i, which looks along `course` [rad], wants and may have."""
        e = cos_sin(course)
        ahead, left = self.speed_command[i], self.left_command[i]
        v = ti.Vector([ahead * e[0] - left * e[1], ahead * e[1] + left * e[0], self.climb_command[i]])
        goal = self.goal[i]
        goes = not ti.math.isnan(goal[0])
        if goes:
            p = self.position[i]
            apart = goal - ti.Vector([p[0], p[1], self.altitude[i]])
            away = apart.norm()
            v = apart * (2.0 / (dt + ti.sqrt(dt * dt + 2.0 * away / self.max_acceleration[i])))
        along = ti.sqrt(v[0] * v[0] + v[1] * v[1])
        slower = ti.min(1.0, self.max_speed[i] / ti.max(along, 1e-9))
        upward = ti.math.clamp(v[2], -self.max_descent[i], self.max_climb[i])
        if goes and ti.abs(v[2]) > 1e-9:  # straight on
            slower = ti.min(slower, upward / v[2])
            upward = slower * v[2]
        return ti.Vector([slower * v[0], slower * v[1], upward])
