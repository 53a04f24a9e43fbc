"""Localisation by a camera over the floor or by motion capture: poses frame by frame, late and with noise.

Cameras over the arena track the robots of many laboratories, and tell them their poses as an indoor GPS would
(SwisTrack: Lochmatter et al., IROS 2008, doi:10.1109/IROS.2008.4650937). Frame m = 1, 2, ... is exposed at m / rate and
reaches the robots `delay` later. Until the next one arrives, the believed pose holds:

    believed(t) = pose(m / rate) + N(0, σ²),      m = floor((t - delay) rate)

with independent errors of x, y and heading in each frame. Poses between two time steps are interpolated. Before the
first frame arrives, a robot believes its pose at the start of the run.
"""

from collections.abc import Callable, Sequence

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import wrap
from taichi_plume.grid.rng import normal4, stream_id
from taichi_plume.scenario.localization import Camera as Model

MICRO = 1e6  # microseconds in a second: time is counted in them, as sums of f32 steps would drift
SLACK = 1e-6  # frames: tolerance of rounding


class Camera:
    """Camera over `count` robots, seen by the groups whose `localization` is a camera.

    counter: function as `Swarm.counter`; groups: all groups of the swarm. frames[i, m % slots]: true pose of robot i in
    frame m (x [m], y [m], heading [rad]); the pose at the start of the run counts as frame 0.
    """

    STATE = ("frames",)

    def __init__(self, count: int, counter: Callable, groups: Sequence[GroupRange]):
        self.counter = counter
        sees, numbers, times = np.zeros((3, count))
        streams = np.zeros(count, np.uint32)
        rates, delays, noises = np.ones(count), np.zeros(count), np.zeros((count, 3))
        slots = 2
        for group in groups:
            times[group.slice] = group.model.turn_time
            model = group.model.localization
            if not isinstance(model, Model):
                continue
            sees[group.slice] = 1
            numbers[group.slice] = group.first + np.arange(group.size)
            streams[group.slice] = stream_id(f"group {group.number}/camera")
            rates[group.slice], delays[group.slice] = model.rate, model.delay
            noises[group.slice] = model.position_noise, model.position_noise, model.heading_scatter
            slots = max(slots, model.frames)
        self.sees = ti.filled(sees, ti.i32)
        self.number = ti.filled(numbers, ti.i32)  # of the robot in its group, among all possible trials
        self.stream = ti.filled(streams, ti.u32)
        self.rate, self.delay = ti.filled(rates, ti.f64), ti.filled(delays, ti.f64)  # 1/s, s
        self.noise = ti.filled_vectors(noises)  # standard deviations of x, y [m] and heading [rad]
        self.turn_time = ti.filled(times, ti.f32)  # s
        self.frames = ti.vector_field(3, ti.f32, (count, slots))

    @ti.func
    def start(self, i, place, heading):
        """Set robot i's pose at the start of a run or an episode."""
        self.frames[i, 0] = ti.Vector([place[0], place[1], heading])

    @ti.func
    def _seconds(self, now, dt):
        """Return the time [s], in f64, at which time step `now` of dt [s] ends."""
        return ti.floor(MICRO * ti.cast(dt, ti.f64) + 0.5) * ti.cast(now, ti.f64) / MICRO

    @ti.func
    def _frame(self, i, seconds):
        """Return the number of the last frame of robot i's camera at time `seconds` [s]."""
        return ti.cast(ti.floor(seconds * self.rate[i] + SLACK), ti.i32)

    @ti.func
    def pose(self, i, tick, dt, before, after):
        """Return the pose that robot i believes in after time step `tick` of dt [s].

        before, after: true poses of the robot (x [m], y [m], heading [rad]) before and after the step.
        """
        key, number, now = self.counter(i, self.number[i], tick)
        slots, seconds = self.frames.shape[1], self._seconds(now, dt)
        newest = self._frame(i, seconds)
        first = ti.max(self._frame(i, self._seconds(now - 1, dt)), newest - slots) + 1
        moved = after - before
        moved[2] = wrap(moved[2])
        for m in range(first, newest + 1):
            rest = ti.cast((seconds - m / self.rate[i]) / dt, ti.f32)  # part of the step after the exposure
            self.frames[i, m % slots] = after - rest * moved
        m = ti.max(self._frame(i, seconds - self.delay[i]), 0)
        pose = self.frames[i, m % slots]
        if m > 0:
            g = normal4(key, self.stream[i], number, m, 0)
            pose += self.noise[i] * ti.Vector([g[0], g[1], g[2]])
        pose[2] = wrap(pose[2])
        return pose
