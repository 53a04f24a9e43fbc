"""SPIRAL: spirals of straight arms around positions of a rising proximity index, for rooms without strong wind.

Ferri, Caselli, Mattoli, Mondini, Mazzolai & Dario, Robotics and Autonomous Systems 57 (2009) 393-402.

ARM      turn by 90° in the sense of the search (not before the first arm of a spiral) and drive the arm's length
ACQUIRE  stand still and sample; the proximity index PI of the samples is a HIT or a MISS
ESCAPE   after all arms without a hit: turn by a multiple of 45° and drive away, then a new spiral

HIT (PI >= threshold): PI becomes the threshold, and a new spiral starts straight on. MISS: the next arm; five in a
row, or three below half of the threshold, lower the threshold to the minimum less delta. ESCAPE resets it to the
minimum. Only the first spiral of a search may start otherwise: with a turn, or with an acquisition (`first_move`).

The paper states no lengths of arms, except that they suit the area. Random SPIRAL ignores gas, so that its published
acquisitions, 38.6 and 28.3 from 180 and 150 cm (n = 10), depend on the arms alone: first arms of 0.35, 0.4 (the
default), 0.45 and 0.5 m all agree with them (chi-square 0.4, 0.8, 1.2, 2.5; validation/spiral_floor.py). With a side
drawn for each search 0.45 m comes first (1.3, 0.6, 0.4, 0.8), as it does to the right (3.0, 1.6, 0.7, 0.9).

After a collision the rest of the leg turns aside: in the sense of the spiral, or to the side of the highest PI among
the remembered positions.

PI = k_mean mu + k_peak P of a record with peaks, 2 mu of a record without. mu: mean [ppm]; P: sum over windows of the
largest peak in each; a peak is a local maximum above mu, and counts with its height over mu. (The paper does not define
the reference of the height; but the mean is meant to indicate the distance if peaks are low, and whole peaks are never
lower than the mean.)
"""

from math import pi

from taichi_plume.agents.acquisition import Recording, ticks_between
from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.path_segments import Legs
from taichi_plume.engine import ti
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario import algorithms

ARM, ACQUIRE, ESCAPE = range(3)

MISSES = 5  # misses in a row that lower the threshold
LOW_MISSES = 3  # misses in a row, below LOW times the threshold, that lower the threshold too
LOW = 0.5
TURNS = 8  # directions of an escape
REMEMBERED = 10  # number of remembered acquisitions
FLAT = 2.0  # weight of the mean of a record without a peak
SENSES = {"left": 1.0, "right": -1.0, "random": 0.0}


class Spiral(KernelAlgorithm):
    """SPIRAL search algorithm. tick: control period [s]."""

    STREAM = "spiral"
    STATE: tuple[str, ...] = (
        *("legs", "acquisition", "indices", "places", "arm", "sense", "threshold", "index", "misses", "low"),
        *("needed", "hit", "escapes"),
    )
    STATE_NAMES: tuple[str, ...] = ("ARM", "ACQUIRE", "ESCAPE")
    DECISIONS: tuple[Decision, ...] = (
        Decision("proximity_index", "ppm", "proximity index PI of the last acquisition", "index"),
        Decision("index_needed", "ppm", "threshold that this index had to reach for a HIT", "needed"),
        Decision("index_hit", "1", "1: the last acquisition was a HIT, 0: a MISS", "hit"),
        Decision("index_threshold", "ppm", "threshold T_PI for the next acquisition", "threshold"),
        Decision("misses", "1", "number of misses in a row"),
        Decision("low_misses", "1", "number of misses in a row below half of the threshold", "low"),
        Decision("arm", "1", "number of the arm in the spiral, from 0 on"),
        Decision("escapes", "1", "number of escapes"),
    )

    def _allocate(self) -> None:
        n = self.size
        self.legs = Legs(self.members, self.p)
        self.acquisition = Recording(self.members, self.p)
        self.heard = self.acquisition.heard
        self.indices = ti.field(ti.f32, (n, REMEMBERED))  # PI of the last acquisitions [ppm]
        self.places = ti.vector_field(2, ti.f32, (n, REMEMBERED))  # positions of these acquisitions [m]
        self.arm = ti.field(ti.i32, n)  # number of the arm in the present spiral, from 0 on
        self.sense = ti.field(ti.f32, n)  # +1: turns left, -1: right
        self.threshold = ti.field(ti.f32, n)  # T_PI [ppm]
        self.index = ti.field(ti.f32, n)  # last PI [ppm]
        self.misses = ti.field(ti.i32, n)  # misses in a row
        self.low = ti.field(ti.i32, n)  # misses in a row below half of the threshold
        self.needed = ti.field(ti.f32, n)  # threshold of the last PI [ppm]
        self.hit = ti.field(ti.f32, n)  # whether the last PI was a HIT; NaN before
        self.escapes = ti.field(ti.i32, n)

    def numbers(self, group: GroupRange, model: algorithms.Spiral) -> Numbers:
        between = ticks_between(model, self.tick)
        return {
            **Legs.numbers(group, model.speed),
            **Recording.numbers(group, self.tick, least=3),
            "window": max(1, round(model.peak_window / (between * self.tick))),  # samples
            "minimum": model.minimum_ppm,
            "lowered": model.minimum_ppm - model.delta * model.minimum_ppm,  # ppm
            "k_mean": model.mean_weight,
            "k_peak": model.peak_weight,
            "above_mean": model.peak_height == "above_mean",
            "by_gradient": model.bump_side == "gradient",
            "random": model.random,
            "strict": model.strict_minimum,
            "sense": SENSES[model.sense],
            "first_turn": 0.5 * pi if model.first_move == "turn" else 0.0,  # rad
            "acquires_first": model.first_move == "acquisition",
            "arms": model.arms,  # m
            "arm_count": len(model.arms),
            "escape_length": model.escape_length,  # m
        }

    @ti.func
    def _start(self, n):
        self.sense[n] = self.p.sense[n]
        if self.sense[n] == 0.0:
            self.sense[n] = ti.select(self._uniform(n, 0)[2] > 0.5, 1.0, -1.0)
        self.threshold[n] = self.p.minimum[n]
        self.index[n], self.needed[n], self.hit[n] = ti.math.nan, ti.math.nan, ti.math.nan
        if self.p.acquires_first[n] == 1:
            self.arm[n] = -1
            self.swarm.state[self.robot[n]] = ACQUIRE
        else:
            self._set_out(n, self.p.first_turn[n] * self.sense[n])

    @ti.func
    def _step(self, n, tick, t, dt):
        i = self.robot[n]
        if self.swarm.state[i] == ACQUIRE:
            if self.acquisition.listen(n):
                self._rate_acquisition(n, tick)
        if self.p.by_gradient[n] == 1 and self.swarm.blocked[i] == 1:
            self.legs.aside[n] = self._better_side(n)
        if self.swarm.state[i] != ACQUIRE and not self.legs.advance(n, dt):
            if self.swarm.state[i] == ESCAPE:
                self._set_out(n, 0.0)
                self.legs.advance(n, dt)
            else:
                self.swarm.state[i] = ACQUIRE

    @ti.func
    def _uniform(self, n, tick):
        return uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 0)

    @ti.func
    def _set_out(self, n, turn):
        """Start a new spiral of robot n with a turn by `turn` [rad] and its first arm."""
        self.arm[n] = 0
        self.swarm.state[self.robot[n]] = ARM
        self.legs.set_out(n, turn, self.p.arms[n, 0], self.sense[n])

    @ti.func
    def _better_side(self, n):
        """Return +1 if robot n measured its highest remembered proximity index to its left, -1 if to its right."""
        i = self.robot[n]
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
        """Return whether sample k of robot n is a local maximum above `mean`; of a plateau only the first sample is."""
        after = k + 1
        last = self.p.samples[n] - 1  # `and` evaluates both sides
        while after <= last and self.heard[n, ti.min(after, last)] == self.heard[n, k]:
            after += 1
        peak = k > 0 and after <= last and self.heard[n, k] > mean
        if peak:
            peak = self.heard[n, k] > self.heard[n, k - 1] and self.heard[n, k] > self.heard[n, after]
        return peak

    @ti.func
    def _proximity_index(self, n):
        """Return the proximity index PI [ppm] of robot n's last acquisition."""
        mean = self.acquisition.mean(n)
        peaks, has_peak = 0.0, 0
        samples, window = self.p.samples[n], self.p.window[n]
        for w in range((samples + window - 1) // window):
            largest = 0.0
            for k in range(w * window, ti.min((w + 1) * window, samples)):
                if self._is_peak(n, k, mean):
                    has_peak = 1
                    largest = ti.max(
                        largest, self.heard[n, k] - ti.select(self.p.above_mean[n] == 1, mean, 0.0)
                    )
            peaks += largest
        return ti.select(has_peak == 1, self.p.k_mean[n] * mean + self.p.k_peak[n] * peaks, FLAT * mean)

    @ti.func
    def _rate_acquisition(self, n, tick):
        """Rate the acquisition of robot n as HIT or MISS by its proximity index, and choose the next action."""
        i = self.robot[n]
        index = self._proximity_index(n)
        if self.p.random[n] == 1:
            index = self._uniform(n, tick)[0]
        self.index[n] = index
        slot = (self.swarm.acquisitions[i] - 1) % REMEMBERED
        self.indices[n, slot], self.places[n, slot] = index, self.swarm.believed_position[i]
        needed = self.threshold[n]
        if self.p.strict[n] == 1:
            needed = ti.max(needed, self.p.minimum[n])
        self.needed[n], self.hit[n] = needed, ti.cast(index >= needed, ti.f32)
        if index >= needed:
            self.swarm.hits[i] += ti.cast(self.swarm.searches(i), ti.i32)
            self.threshold[n] = index
            self._forget(n)
            self._set_out(n, 0.0)
        else:
            self._miss(n, index, tick)

    @ti.func
    def _miss(self, n, index, tick):
        i = self.robot[n]
        self.misses[n] += 1
        self.low[n] = ti.select(index < LOW * self.threshold[n], self.low[n] + 1, 0)
        if self.misses[n] >= MISSES or self.low[n] >= LOW_MISSES:
            self.threshold[n] = ti.min(self.threshold[n], self.p.lowered[n])
            self._forget(n)
        self.arm[n] += 1
        if self.arm[n] < self.p.arm_count[n]:
            self.swarm.state[i] = ARM
            turn = ti.select(self.arm[n] > 0, 0.5 * pi * self.sense[n], 0.0)
            self.legs.set_out(n, turn, self.p.arms[n, self.arm[n]], self.sense[n])
        else:
            self.threshold[n] = self.p.minimum[n]
            self._forget(n)
            self.swarm.state[i] = ESCAPE
            self.escapes[n] += ti.cast(self.swarm.searches(i), ti.i32)
            turn = ti.floor(self._uniform(n, tick)[1] * TURNS) * ti.static(2.0 * pi / TURNS)
            self.legs.set_out(n, turn, self.p.escape_length[n], self.sense[n])

    @ti.func
    def _forget(self, n):
        self.misses[n] = 0
        self.low[n] = 0
