"""Infotaxis: drive where a detection, or none, is expected to tell most about where the source is.

Vergassola, Villermaux & Shraiman, Nature 445 (2007) 406-409, doi:10.1038/nature05464.

ACQUIRE  stand still; a mean reading at the threshold or above is a detection, and the belief is updated by it
MOVE     drive by a step in one of four directions, or stay, whichever leaves the least entropy in the mean

The belief is a map of probabilities over the cells of the search area. A source at a displacement r from the robot is
detected with probability 1 - exp(-R(r) T) in an acquisition of T seconds; along and across the mean wind V

    R = rate / ln(lambda/a) exp(-V r_along/2D) K0(|r|/lambda),  lambda = sqrt(D tau/(1 + V² tau/4D))

for a searcher of size a in a plane with an effective diffusivity D and a lifetime tau of gas patches.
"""

from math import hypot, log, pi
from typing import cast

import numpy as np
import taichi as ti
from scipy.special import k0e

from taichi_plume.agents.acquisition import Acquisition
from taichi_plume.agents.few import few
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.legs import Legs
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.swarm import Swarm, wrap
from taichi_plume.grid.rng import uniform4
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario import algorithms

ACQUIRE, MOVE = range(2)

STAY = 4  # after the moves 0 to 3, each by 90° more to the left
FINER = 2  # nodes of the table per cell
LEAST = 1e-12  # probability that counts as none


def detection_rate(model: algorithms.Infotaxis, along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """R [1/s] of a source at (along, across) [m] from the robot, `along` to where the wind blows."""
    D, V, reach = model.diffusivity, model.wind_speed, model.reach
    r = np.maximum(np.hypot(along, across), model.size)
    return model.rate / log(reach / model.size) * np.exp(-V * along / (2.0 * D) - r / reach) * k0e(r / reach)


@ti.data_oriented
class Infotaxis:
    """The infotaxis algorithm for the robots of one group, each with a belief of its own. tick: control period [s]."""

    PER_GROUP: bool = True  # has one table of chances and one size of cells
    STATE: tuple[str, ...] = ("legs", "acquisition", "belief", "downwind")
    STATE_NAMES: tuple[str, ...] = ("ACQUIRE", "MOVE")

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        self.swarm, self.members, self.size, self.tick = swarm, members, members.size, tick
        self.robot, self.number = members.robot, members.number
        self.p = Parameters(members, self.numbers, stream="infotaxis")
        self.legs = Legs(members, self.p)
        self.acquisition = Acquisition(members, self.p)
        self.low, high = swarm.clearance.low, swarm.clearance.high
        self.extent = tuple(high[d] - self.low[d] for d in range(2))
        self.cell = self.model.cell
        self.cells = tuple(max(1, round(length / self.cell)) for length in self.extent)
        self.spacing = self.cell / FINER
        self.half = int(np.ceil(hypot(*self.extent) / self.spacing)) + 1
        self.chance = ti.field(ti.f32, (2 * self.half + 1, 2 * self.half + 1))
        self.belief = ti.field(ti.f32, (self.size, *self.cells))
        self.downwind = ti.Vector.field(2, ti.f32, self.size)  # mean of the wind felt so far
        self._upload = uploader(self.chance, self.belief)
        self.begin()

    @property
    def model(self) -> algorithms.Infotaxis:
        """The group's, as it is now."""
        return cast(algorithms.Infotaxis, self.members.groups[0].model.algorithm)

    def numbers(self, group: GroupRange) -> Numbers:
        """Those of a group that kernels read."""
        return {
            **Legs.numbers(group, self.model.speed),
            **Acquisition.numbers(self.model, self.tick),
            "threshold": self.model.threshold_ppm,
            "step": self.model.step,  # m
        }

    def begin(self) -> None:
        """Set the numbers; all robots begin to listen and take all places for equally probable."""
        self.p.begin()
        self._upload(self._chances(), 1.0 / (self.cells[0] * self.cells[1]))

    def _chances(self) -> np.ndarray:
        """Probability of a detection over displacements of the source, along and across the wind."""
        places = (np.arange(2 * self.half + 1) - self.half) * self.spacing
        rate = detection_rate(self.model, *np.meshgrid(places, places, indexing="ij"))
        return -np.expm1(-rate * self.model.acquisition)

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn the readings at time t [s] into commands for the next dt [s]."""
        self._act(tick, dt)

    @ti.kernel
    def _act(self, tick: int, dt: float):
        ti.loop_config(serialize=ti.static(few(4 * self.size)))
        for n in range(self.size):
            i = self.robot[n]
            if self.swarm.wind_known[i] == 1:
                self.downwind[n] += self.swarm.wind[i]
            if self.swarm.state[i] == ACQUIRE:
                if self.acquisition.listen(n):
                    detected = self.acquisition.mean(n) >= self.p.threshold[n]
                    self.swarm.hits[i] += ti.cast(detected, ti.i32)
                    self._learn(n, detected)
                    self._choose(n, tick)
            if self.swarm.state[i] == MOVE and not self.legs.advance(n, dt):
                self.swarm.state[i] = ACQUIRE

    @ti.func
    def _wind_axis(self, n):
        """Unit vector downwind; along x until wind is felt."""
        v = self.downwind[n]
        length = v.norm()
        e = ti.Vector([1.0, 0.0])
        if length > 0.0:
            e = v / length
        return e

    @ti.func
    def _place(self, n):
        """Of robot n, from the lower corner of the search area on [m]."""
        return self.swarm.believed_position[self.robot[n]] - ti.Vector(self.low)

    @ti.func
    def _chance_at(self, p, e, a, b):
        """Probability that a robot at p detects a source in cell (a, b)."""
        r = (ti.Vector([a, b]) + 0.5) * self.cell - p
        along = (r[0] * e[0] + r[1] * e[1]) / self.spacing + self.half
        across = (r[1] * e[0] - r[0] * e[1]) / self.spacing + self.half
        k = ti.math.clamp(ti.cast(along + 0.5, ti.i32), 0, 2 * self.half)
        m = ti.math.clamp(ti.cast(across + 0.5, ti.i32), 0, 2 * self.half)
        return self.chance[k, m]

    @ti.func
    def _learn(self, n, detected):
        """Bayes' rule."""
        p, e = self._place(n), self._wind_axis(n)
        total = 0.0
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                chance = self._chance_at(p, e, a, b)
                now = self.belief[n, a, b] * ti.select(detected, chance, 1.0 - chance)
                self.belief[n, a, b] = now
                total += now
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                even = 1.0 / (self.cells[0] * self.cells[1])  # where nothing explains it: begin anew
                self.belief[n, a, b] = ti.select(
                    total > LEAST, self.belief[n, a, b] / ti.max(total, LEAST), even
                )

    @ti.func
    def _expected_entropy(self, n, p):
        """Mean entropy of the belief after an acquisition at p; none is left if the source is there."""
        e = self._wind_axis(n)
        hit, log_hit, log_none = 0.0, 0.0, 0.0
        for a in range(self.cells[0]):
            for b in range(self.cells[1]):
                chance, now = self._chance_at(p, e, a, b), self.belief[n, a, b]
                both, none = now * chance, now * (1.0 - chance)
                hit += both
                log_hit += both * ti.log(ti.max(both, LEAST))
                log_none += none * ti.log(ti.max(none, LEAST))
        miss = 1.0 - hit
        of_both = hit * ti.log(ti.max(hit, LEAST)) + miss * ti.log(ti.max(miss, LEAST))
        there = ti.math.clamp(ti.cast(p / self.cell, ti.i32), 0, ti.Vector(self.cells) - 1)
        return (1.0 - self.belief[n, there[0], there[1]]) * (of_both - log_hit - log_none)

    @ti.func
    def _choose(self, n, tick):
        """The step of least mean entropy; of equal ones any."""
        i = self.robot[n]
        here = self._place(n)
        u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 0)
        turn = ti.floor(u[0] * 4.0)
        best, least = -1, 1e30
        for k in range(STAY + 1):
            move = ti.cast((k + turn) % 4, ti.i32)
            angle = 0.5 * pi * move
            target = here + self.p.step[n] * ti.Vector([ti.cos(angle), ti.sin(angle)])
            if k == STAY:
                move, target = STAY, here
            room = self.swarm.radius[i]
            for d in ti.static(range(2)):
                room = ti.min(room, ti.min(target[d], self.extent[d] - target[d]))
            if room == self.swarm.radius[i] or move == STAY:
                entropy = self._expected_entropy(n, target)
                if entropy < least - 1e-6:
                    best, least = move, entropy
        if best != STAY:
            turn_by = wrap(0.5 * pi * best - self.swarm.believed_heading[i])
            self.legs.set_out(n, turn_by, self.p.step[n], ti.select(u[1] > 0.5, 1.0, -1.0))
            self.swarm.state[i] = MOVE
