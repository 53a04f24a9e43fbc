"""Flight of drones: holonomic kinematics with limited acceleration, by velocity commands or to a goal.

Commands of a drone are speeds ahead, to its left and upward and a turn rate, or a goal with an optional heading. The
acceleration of the velocity vector is at most a; speed along the ground is at most `max_speed`, upward `max_climb`,
downward `max_descent`. To a goal the drone flies straight, as fast as it can still stop: with the distance d left, the
next tick takes v dt with

    v dt + v²/(2 a) <= d   so   v = 2 d/(dt + (dt² + 2 d/a)^½),

slower if a component of v exceeds its limit. Attitude and rotor speeds are not computed. In a tick a drone rises
before, and sinks after, its sideways motion: it climbs beside an obstacle before it passes above.
"""

from collections.abc import Callable, Sequence

import numpy as np

from taichi_plume.agents.columns import Columns
from taichi_plume.agents.groups import GroupRange
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin, wrap
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.robots import Group

FREE = 0.9  # fraction of a commanded move; less counts as contact of the bumper

WINGS: dict[str, Callable[[Group], float]] = {
    "wings": lambda group: float(group.body.flies),
    "height": lambda group: group.body.height,
    "max_climb": lambda group: group.body.max_climb or 0.0,
    "max_descent": lambda group: group.body.max_descent or 0.0,
}
"""Functions from a group to each body parameter of drones, by the names of fields that only swarms with drones have."""


def _draw_rises(group: GroupRange, seed: int) -> np.ndarray:
    """Return the altitudes (size,) [m] of a group's robots above the lowest at the start, drawn by trial."""
    model = group.model
    rise = model.start_highest - model.start_altitude
    trials = range(model.first_trial, model.first_trial + model.trials)
    if rise <= 0.0:
        return np.zeros(group.size)
    draws = (generator(seed, f"altitudes of group {group.number}, trial {k}") for k in trials)
    return np.concatenate([rise * rng.random(model.count) for rng in draws])


class Flying(Columns):
    """Mixin of the swarm for the flight of drones."""

    def _set_flight(self, walkers: Sequence[Obstacle]) -> None:
        """Set the fields that only swarms with drones have, at the start of a run."""
        first = self._each(lambda group: group.start_altitude)
        for group in self.groups:
            first[group.start : group.start + group.size] += _draw_rises(group, self.seed)
        self.first_altitude = ti.filled(first, ti.f32)
        self.altitude.copy_from(self.first_altitude)
        for name, value in WINGS.items():
            setattr(self, name, ti.filled(self._each(value), ti.f32))
        self.source_height = ti.field(ti.f32, max(1, self.source_count))
        # lowest, highest point of walkers [m]
        self.spans = ti.filled_vectors(np.reshape([walker.span for walker in walkers], (-1, 2)))
        for field in (self.ordered_altitude, self.goal, self.goal_heading):
            field.fill(np.nan)

    @ti.func
    def _restart_flight(self, i):
        """Reset drone i to its altitude at the start of a run; its other columns have to be zero already."""
        nan = ti.math.nan
        self.altitude[i], self.ordered_altitude[i] = self.first_altitude[i], nan
        self.goal[i], self.goal_heading[i] = ti.Vector([nan, nan, nan]), nan

    @ti.func
    def middle_over(self, i, s):
        """Return the height [m] of the middle of drone i above source s; 0 for ground robots."""
        above = 0.0
        if self.wings[i] == 1.0:
            low = self.source_height[s]
            if ti.static(self.apart):
                low = self.episodes.sources[self.episodes.of(i), s][2]
            above = self.altitude[i] + 0.5 * self.height[i] - low
        return above

    @ti.func
    def _fly(self, i, k, dt):
        """Move drone i of trial k for dt [s]. Return whether contact blocked it, its turn [rad] and path length [m]."""
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
        """Return the commanded velocity (3,) [m/s] of drone i with heading `course` [rad], within its speed limits."""
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
