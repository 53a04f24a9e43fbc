"""Odometry (dead reckoning): believed pose by wheel encoders, with systematic and random errors.

Systematic errors after Borenstein & Feng, IEEE Trans. Robotics and Automation 12 (1996) 869-880, doi:10.1109/70.544770:
wrong wheel size (a), wrong wheel base (b) and unequal wheels (c). Random errors as in the odometry motion model of
Thrun, Burgard & Fox, Probabilistic Robotics (2005), section 5.4: turns and distances both cause errors of heading and
of distance. For a time step in which a robot turns by w [rad] and drives s [m] (backwards s < 0), the odometer reads

    w' = (1 + b) w + c s + N(0, k1 |w| + k2 |s|)
    s' = (1 + a) s + N(0, k3 |s| + k4 |w|)

Variances grow with |w| and |s|, not with their squares as in the book, so that errors do not depend on the step (as in
Kleeman, Odometry error covariance estimation for two wheel robot vehicles, 1995). Wheels do not slip: at contact the
odometer reads the true distance.
"""

from collections.abc import Callable, Sequence

import numpy as np

from taichi_plume.agents.columns import Columns
from taichi_plume.agents.groups import GroupRange
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin, turned, wrap
from taichi_plume.grid.rng import normal4, stream_id
from taichi_plume.scenario.localization import Odometry as Model


class Odometry:
    """Odometers of `count` robots, with random systematic errors; exact unless a group's `localization` is odometry.

    counter: function as `Swarm.counter`; groups: all groups of the swarm.
    """

    def __init__(self, count: int, counter: Callable, groups: Sequence[GroupRange], seed: int):
        self.counter = counter
        errors, variances, deviations = np.zeros((count, 3)), np.zeros((count, 4)), np.zeros((count, 3))
        errs, numbers, streams = np.zeros(count), np.zeros(count), np.zeros(count, np.uint32)
        for group in groups:
            model = group.model.localization
            if not isinstance(model, Model):
                continue
            errors[group.slice] = _drawn(model, group, seed)
            variances[group.slice], deviations[group.slice] = model.variances, model.deviations
            errs[group.slice] = 1
            numbers[group.slice] = group.first + np.arange(group.size)
            streams[group.slice] = stream_id(f"group {group.number}/odometry")
        self.errs = ti.filled(errs, ti.i32)
        self.number = ti.filled(numbers, ti.i32)  # of the robot in its group, among all possible trials
        self.stream = ti.filled(streams, ti.u32)
        self.kept = ti.filled_vectors(errors)  # a, b [1], c [rad/m]
        self.variances = ti.filled_vectors(variances)  # k1 [rad], k2 [rad²/m], k3 [m], k4 [m²/rad]
        self.deviations = ti.filled_vectors(deviations)  # standard deviations of a, b and c

    @ti.func
    def measured(self, i, tick, w, s):
        """Return robot i's measured turn w' [rad], factor 1 + a and random error of s' [m]; w, s: true values."""
        key, number, now = self.counter(i, self.number[i], tick)
        g = normal4(key, self.stream[i], number, now, 0)
        errors, k = self.kept[i], self.variances[i]
        turn = (1.0 + errors[1]) * w + errors[2] * s + ti.sqrt(k[0] * ti.abs(w) + k[1] * ti.abs(s)) * g[0]
        return turn, 1.0 + errors[0], ti.sqrt(k[2] * ti.abs(s) + k[3] * ti.abs(w)) * g[1]

    @ti.func
    def renew(self, i):
        """Draw new systematic errors of robot i at the start of an episode."""
        key, number, now = self.counter(i, self.number[i], 0)
        g = normal4(key, self.stream[i], number, now, 0)
        self.kept[i] = self.deviations[i] * ti.Vector([g[0], g[1], g[2]])


def _drawn(model: Model, group: GroupRange, seed: int) -> np.ndarray:
    """Return random systematic errors a, b and c [rad/m] of each robot of the group, (size, 3)."""
    return np.concatenate(
        [rng.normal(0.0, model.deviations, (group.count, 3)) for rng in group.generators(seed, "wheels")]
    )


class Reckoning(Columns):
    """Mixin of the swarm for believed poses: by odometry, from a camera, or the true poses."""

    @ti.func
    def _reckon(self, i, tick, turn, way, moved):
        """Update robot i's believed pose after a true turn [rad] and displacement `moved`; way: path [m], < 0 back."""
        if self.odometry.errs[i] == 1:
            measured, scale, stray = self.odometry.measured(i, tick, turn, way)
            heading = self.believed_heading[i]
            self.believed_heading[i] = wrap(heading + measured)
            course = heading + 0.5 * measured  # as the chord of its arc
            off = course - (self.heading[i] - 0.5 * turn)
            ahead = cos_sin(course)
            self.believed_position[i] = self.believed_position[i] + scale * turned(moved, off) + stray * ahead
            self.odometer[i] = self.odometer[i] + scale * ti.abs(way) + ti.select(way < 0.0, -stray, stray)
        else:
            self.believed_position[i] = self.position[i]
            self.believed_heading[i] = self.heading[i]
            self.odometer[i] = self.path_length[i]

    @ti.func
    def _true_pose(self, i):
        """Return the true pose (x [m], y [m], heading [rad]) of robot i; zeros in swarms without cameras."""
        result = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.sees):
            place = self.position[i]
            result = ti.Vector([place[0], place[1], self.heading[i]])
        return result

    @ti.func
    def _look(self, i, tick, dt, before):
        """Update the believed pose of robot i, if a camera sees it; before: true pose before the time step."""
        if ti.static(self.sees):
            if self.camera.sees[i] == 1:
                pose = self.camera.pose(i, tick, dt, before, self._true_pose(i))
                self.believed_position[i], self.believed_heading[i] = ti.Vector([pose[0], pose[1]]), pose[2]

    @ti.func
    def turn_time(self, i, least):
        """Return the time [s] in which robot i turns to a course: `least`, or longer if its camera is slow."""
        result = least
        if ti.static(self.sees):
            result = ti.max(least, self.camera.turn_time[i])
        return result

    @ti.func
    def as_believed(self, i, v):
        """Return a sensed vector v (2,) in the map of robot i, rotated by the error of its believed heading."""
        result = v
        if ti.static(self.reckons):
            result = turned(v, self.believed_heading[i] - self.heading[i])
        return result
