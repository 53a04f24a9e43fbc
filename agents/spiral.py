"""SPIRAL: spirals of straight arms around places of a rising proximity index, for rooms without strong wind.

Ferri, Caselli, Mattoli, Mondini, Mazzolai & Dario, Robotics and Autonomous Systems 57 (2009) 393-402.

ARM      turn by 90° (not before the first arm of a spiral) and drive the arm's length
ACQUIRE  stand still and listen; the proximity index PI of what was heard is a HIT or a MISS
ESCAPE   all arms were in vain: turn by a multiple of 45° and drive away, then a new spiral

HIT (PI >= threshold): it becomes the threshold, and a new spiral begins straight on. MISS: the next arm; five in a row,
or three below half of the threshold, lower it to the minimum less delta. ESCAPE sets it back to the minimum.

At a bump the rest of the leg turns aside: as the spiral turns, or to the side of the place where, of those remembered,
the highest PI was heard.

PI = k_mean mu + k_peak P of a record with peaks, 2 mu of one without. mu: mean [ppm]; P: sum over windows of the
largest peak in each; a peak is a local maximum above mu.
"""

from math import pi

import numpy as np
import taichi as ti

from taichi_plume.agents.acquisition import Acquisition
from taichi_plume.agents.legs import Legs
from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.grid.rng import stream_id, uniform4
from taichi_plume.scenario import algorithms

ARM, ACQUIRE, ESCAPE = range(3)

MISSES = 5  # in a row, that lower the threshold
LOW_MISSES = 3  # in a row and below LOW of it, that do so too
LOW = 0.5
TURNS = 8  # directions of an escape
REMEMBERED = 10  # acquisitions
FLAT = 2.0  # weight of the mean of a record without a peak


@ti.data_oriented
class Spiral:
    """The SPIRAL algorithm for the robots of one group. tick: control period [s]."""

    STATE_NAMES: tuple[str, ...] = ("ARM", "ACQUIRE", "ESCAPE")

    def __init__(self, swarm: Swarm, group: GroupRange, tick: float):
        model = group.model.algorithm
        assert isinstance(model, algorithms.Spiral)
        self.swarm, self.start, self.size, self.first = swarm, group.start, group.size, group.first
        self.seed, self.stream = swarm.seed, stream_id(f"group {group.number}/spiral")
        self.legs = Legs(swarm, group, model.speed)
        self.minimum, self.delta = model.minimum_ppm, model.delta * model.minimum_ppm
        self.random, self.strict = model.random, model.strict_minimum
        self.k_mean, self.k_peak = model.mean_weight, model.peak_weight
        self.above_mean = model.peak_height == "above_mean"
        self.escape_length = model.escape_length
        self.acquisition = Acquisition(swarm, group, model, tick, least=3)
        self.heard, self.samples = self.acquisition.heard, self.acquisition.samples
        self.window = max(1, round(model.peak_window / (self.acquisition.between * tick)))  # samples
        self.arm_count = len(model.arms)
        self.arms = ti.field(ti.f32, self.arm_count)
        self.arms.from_numpy(np.array(model.arms, np.float32))
        n = self.size
        self.by_gradient = model.bump_side == "gradient"
        slots = (n if self.by_gradient else 1, REMEMBERED)
        self.indices = ti.field(
            ti.f32, slots
        )  # of the last acquisitions [ppm], negative where there was none
        self.places = ti.Vector.field(2, ti.f32, slots)  # where they were [m]
        self.indices.fill(-1.0)
        self.arm = ti.field(ti.i32, n)  # of the present spiral, from 0 on
        self.sense = ti.field(ti.f32, n)  # +1: turns left, -1: right
        self.threshold = ti.field(ti.f32, n)  # T_PI [ppm]
        self.index = ti.field(ti.f32, n)  # last PI [ppm]
        self.misses = ti.field(ti.i32, n)  # in a row
        self.low = ti.field(ti.i32, n)  # of them below half of the threshold, in a row
        self._begin()

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn the readings at time t [s] into commands for the next dt [s]."""
        self._act(tick, dt)

    @ti.kernel
    def _begin(self):
        for n in range(self.size):
            u = self._uniform(n, 0)
            self.sense[n] = ti.select(u[2] > 0.5, 1.0, -1.0)
            self.threshold[n] = self.minimum
            self._set_out(n)

    @ti.kernel
    def _act(self, tick: int, dt: float):
        for n in range(self.size):
            i = self.start + n
            if self.swarm.state[i] == ACQUIRE:
                if self.acquisition.listen(n):
                    self._judge(n, tick)
            if ti.static(self.by_gradient):
                if self.swarm.blocked[i] == 1:
                    self.legs.aside[n] = self._better_side(n)
            if self.swarm.state[i] != ACQUIRE and not self.legs.advance(n, dt):
                if self.swarm.state[i] == ESCAPE:
                    self._set_out(n)
                    self.legs.advance(n, dt)
                else:
                    self.swarm.state[i] = ACQUIRE

    @ti.func
    def _uniform(self, n, tick):
        return uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, tick, 0)

    @ti.func
    def _set_out(self, n):
        """Begin a spiral straight on."""
        self.arm[n] = 0
        self.swarm.state[self.start + n] = ARM
        self.legs.begin(n, 0.0, self.arms[0], self.sense[n])

    @ti.func
    def _better_side(self, n):
        """+1: the highest index was heard to the left of the robot's line of travel, -1: to the right."""
        i = self.start + n
        best, place = 0.0, self.swarm.believed_position[i]
        for k in range(REMEMBERED):
            if self.indices[n, k] > best:
                best, place = self.indices[n, k], self.places[n, k]
        apart = place - self.swarm.believed_position[i]
        heading = self.swarm.believed_heading[i]
        left = ti.cos(heading) * apart[1] - ti.sin(heading) * apart[0]
        return ti.select(left > 0.0, 1.0, ti.select(left < 0.0, -1.0, self.sense[n]))

    @ti.func
    def _is_peak(self, n, k, mean):
        """Whether sample k is a local maximum above the mean; of a plateau the first one."""
        after = k + 1
        last = self.samples - 1  # `and` works out both sides
        while after <= last and self.heard[n, ti.min(after, last)] == self.heard[n, k]:
            after += 1
        peak = k > 0 and after < self.samples and self.heard[n, k] > mean
        if peak:
            peak = self.heard[n, k] > self.heard[n, k - 1] and self.heard[n, k] > self.heard[n, after]
        return peak

    @ti.func
    def _proximity_index(self, n):
        """PI [ppm] of what was heard."""
        mean = self.acquisition.mean(n)
        peaks, found = 0.0, 0
        for w in range((self.samples + self.window - 1) // self.window):
            largest = 0.0
            for k in range(w * self.window, ti.min((w + 1) * self.window, self.samples)):
                if self._is_peak(n, k, mean):
                    found = 1
                    largest = ti.max(largest, self.heard[n, k] - ti.select(self.above_mean, mean, 0.0))
            peaks += largest
        return ti.select(found == 1, self.k_mean * mean + self.k_peak * peaks, FLAT * mean)

    @ti.func
    def _judge(self, n, tick):
        """HIT or MISS."""
        i = self.start + n
        index = self._proximity_index(n)
        if ti.static(self.random):
            index = self._uniform(n, tick)[0]
        self.index[n] = index
        if ti.static(self.by_gradient):
            slot = (self.swarm.acquisitions[i] - 1) % REMEMBERED
            self.indices[n, slot], self.places[n, slot] = index, self.swarm.believed_position[i]
        needed = self.threshold[n]
        if ti.static(self.strict):
            needed = ti.max(needed, self.minimum)
        if index >= needed:
            self.swarm.hits[i] += 1
            self.threshold[n] = index
            self._forget(n)
            self._set_out(n)
        else:
            self._miss(n, index, tick)

    @ti.func
    def _miss(self, n, index, tick):
        i = self.start + n
        self.misses[n] += 1
        self.low[n] = ti.select(index < LOW * self.threshold[n], self.low[n] + 1, 0)
        if self.misses[n] >= MISSES or self.low[n] >= LOW_MISSES:
            self.threshold[n] = ti.min(self.threshold[n], self.minimum - self.delta)
            self._forget(n)
        self.arm[n] += 1
        if self.arm[n] < self.arm_count:
            self.swarm.state[i] = ARM
            self.legs.begin(n, 0.5 * pi * self.sense[n], self.arms[self.arm[n]], self.sense[n])
        else:
            self.threshold[n] = self.minimum
            self._forget(n)
            self.swarm.state[i] = ESCAPE
            turn = ti.floor(self._uniform(n, tick)[1] * TURNS) * ti.static(2.0 * pi / TURNS)
            self.legs.begin(n, turn, self.escape_length, self.sense[n])

    @ti.func
    def _forget(self, n):
        self.misses[n] = 0
        self.low[n] = 0
