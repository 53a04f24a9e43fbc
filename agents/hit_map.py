"""Hit map: from hit or miss and the wind tell where the source may be, and measure next where that tells most.

After Ojeda, Monroy & Gonzalez-Jimenez, "Information-driven gas source localization exploiting gas and wind local
measurements for autonomous mobile robots", IEEE Robotics and Automation Letters 6 (2021) 1320-1326,
doi:10.1109/LRA.2021.3057290 (GrGSL), and "Robotic gas source localization with probabilistic mapping and online
dispersion simulation", IEEE Trans. Robotics (2024), arXiv:2304.08879 (PMFS).

ACQUIRE  stand still; a mean reading at the threshold or above is a hit, and the map is updated by it
MOVE     along a free way to the next place

Of GrGSL are the floor's free cells, known to the robot; that gas comes from where the way to the source begins upwind,
as a Gaussian of the angle between the two, with ways that lead around obstacles (`ways`); a Gaussian of the length of
the way, on all sides; Bayes' rule over the cells; and that the search ends when the source's variance is small. Of PMFS
is that hits have a probability, whose complement tells what a miss means. A robot in cell c has a hit from a source in
cell b with probability

    false_alarm + (hit - false_alarm) max(exp(-θ²/2(spread² + cell²/6e²) - d/fading), exp(-d²/2 near²))

of which in calm air the second alone is left. d: way from c to b [m], θ: angle between upwind and its begin, which is
straight for e [m]; cell²/6 is the variance of where in their cells robot and source are. PMFS simulates the gas of
each candidate source in an estimated flow instead, and GrGSL lets a miss speak against the way since the last hit.
Ours are the fading, the wind of the last measurement for the places to come, and the choice of the next place: of the
cells within `range` the one whose expected information on the source (its mutual information with hit or miss) over
the time to go there and measure is largest; but when the belief has converged, the expected place of the source. What
is declared, and that a search that goes on rules places out, is as in `beliefs`."""

from math import radians

import numpy as np
import taichi as ti

from taichi_plume.agents.acquisition import Acquisition
from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.beliefs import LEAST, Beliefs, Declaring
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.potential import NEAR, Potential
from taichi_plume.agents.ways import FAR, Ways
from taichi_plume.grid.elementary import direction, exp, log
from taichi_plume.grid.transfer import reader
from taichi_plume.scenario.belief_algorithms import HitMap as Model

ACQUIRE, MOVE = range(2)

ON_THE_WAY = 0.5  # cells from a corner of the way that count as there


@ti.data_oriented
class HitMap(KernelAlgorithm):
    """The hit map of the robots of one group, each with a belief of its own. tick: control period [s]."""

    PER_GROUP: bool = True  # has one map of ways
    WORK = 4
    STATE: tuple[str, ...] = ("potential", "acquisition", "declaring", "belief", "felt", "goal", "next")
    STATE_NAMES: tuple[str, ...] = ("ACQUIRE", "MOVE")

    def _allocate(self) -> None:
        self.potential = Potential(self.members, self.p)
        self.acquisition = Acquisition(self.members, self.p)
        self.declaring = Declaring(self.members, self.p)
        self.belief = Beliefs(self.members, self.model.cell)
        self.gas = Ways(self.swarm.clearance, self.model.cell, 0.0)  # for air
        self.roads = Ways(self.swarm.clearance, self.model.cell, self._room)  # for robots
        self.count, self.columns, self.cell = self.gas.count, self.gas.shape[1], self.gas.cell
        self.felt = ti.Vector.field(2, ti.f32, self.size)  # sum of the wind while it listens [m/s]
        self.home = ti.field(ti.i32, self.size)  # cell where it starts
        self.goal = ti.field(ti.i32, self.size)  # cell to measure in
        self.next = ti.field(ti.i32, self.size)  # cell on the way there
        self.belief_cell, self.belief_low = self.cell, np.array(self.gas.low)
        self._read = reader(self.belief.p)

    @property
    def _room(self) -> float:
        """What robots keep from all that stands [m]."""
        return self.members.groups[0].model.body.radius + self.model.avoidance

    def numbers(self, group: GroupRange, model: Model) -> Numbers:
        return {
            **Potential.numbers(self.swarm, group, model.speed, model.avoidance),
            **Acquisition.numbers(model, self.tick),
            **Declaring.numbers(model, group),
            "threshold": model.threshold_ppm,
            "calm": model.calm,  # m/s
            "angles": radians(model.spread_deg) ** 2,  # rad²
            "fading": 1.0 / model.fading,  # 1/m
            "near": 0.5 / model.near**2,  # 1/m²
            "hit": model.hit,
            "false_alarm": model.false_alarm,
            "range": model.range,  # m
            "pause": model.settle + model.acquisition,  # s
            "converged": model.converged,  # m
        }

    def begin(self) -> None:
        self.roads.begin(self._room)
        super().begin()

    def beliefs(self) -> np.ndarray:
        """Probabilities of the source's place, (size, nx, ny)."""
        return self._read()[0]

    @ti.func
    def _start(self, n):
        self.home[n] = self.gas.free_cell_of(self.swarm.believed_position[self.robot[n]])
        self._forget(n)

    @ti.func
    def _step(self, n, tick, t, dt):
        i = self.robot[n]
        if self.swarm.searches(i):
            if self.swarm.state[i] == ACQUIRE:
                self.potential.stand(n)
                if self.swarm.wind_known[i] == 1:
                    self.felt[n] += self.swarm.wind[i]
                ticks = self.acquisition.since[n] + 1
                if self.acquisition.listen(n):
                    wind = self.felt[n] / ticks
                    self.felt[n] = ti.Vector([0.0, 0.0])
                    here = self.gas.free_cell_of(self.swarm.believed_position[i])
                    hit = self.acquisition.mean(n) >= self.p.threshold[n]
                    self.swarm.hits[i] += ti.cast(hit, ti.i32)
                    if here >= 0:
                        self._learn(n, here, hit, wind)
                        self._go_on(n, wind, t)
            if self.swarm.state[i] == MOVE:
                self._follow(n, dt)

    @ti.func
    def _forget(self, n):
        """All cells to which there is a way are equally probable; all there are, where no cell is free."""
        total = 0
        for b in range(self.count):
            total += self._is_reached(n, b)
        for b in range(self.count):
            now = ti.select(total > 0, self._is_reached(n, b) / ti.max(1.0, total), self.belief.even)
            self.belief.p[n, b // self.columns, b % self.columns] = now

    @ti.func
    def _is_reached(self, n, b):
        """1 where gas from cell b can come to where robot n began, else 0."""
        return ti.cast(self.home[n] >= 0 and self.gas.length[ti.max(self.home[n], 0), b] < FAR, ti.i32)

    @ti.func
    def _chance(self, n, c, b, wind):
        """Of a hit in cell c from a source in cell b."""
        way, share = self.gas.length[c, b], 0.0
        if way < FAR:
            share = exp(-self.p.near[n] * way * way)
            if wind.norm() > self.p.calm[n] and b != c:
                e = self.gas.center(ti.cast(self.gas.via[c, b], ti.i32)) - self.gas.center(c)
                # the angle between the begin of the way and upwind, and its variance
                angle = direction(e[0] * wind[1] - e[1] * wind[0], -e.dot(wind))  # type: ignore
                variance = self.p.angles[n] + self.cell * self.cell / (6.0 * e.norm_sqr())  # type: ignore
                share = ti.max(share, exp(-0.5 * angle * angle / variance - self.p.fading[n] * way))
        return self.p.false_alarm[n] + (self.p.hit[n] - self.p.false_alarm[n]) * share

    @ti.func
    def _learn(self, n, here, hit, wind):
        """Bayes' rule; a search that goes on though it would end near the source rules out what is near."""
        total = 0.0
        x = self.swarm.believed_position[self.robot[n]]
        for b in range(self.count):
            chance = self._chance(n, here, b, wind)
            chance = ti.select(hit, chance, 1.0 - chance)
            if self.belief.is_within(self.gas.center(b) - x, self.p.ends_at[n]):
                chance = 0.0
            now = chance * self.belief.p[n, b // self.columns, b % self.columns]
            self.belief.p[n, b // self.columns, b % self.columns] = now
            total += now
        if total > LEAST:
            self.belief.normalize(n, total)
        else:
            self._forget(n)

    @ti.func
    def _information(self, n, c, wind):
        """What a measurement in cell c is expected to tell of the source's place [nat]."""
        hit, doubt = 0.0, 0.0
        for b in range(self.count):
            now = self.belief.p[n, b // self.columns, b % self.columns]
            if now > LEAST:
                chance = self._chance(n, c, b, wind)
                hit += now * chance
                doubt += now * self._entropy(chance)
        return self._entropy(hit) - doubt

    @ti.func
    def _entropy(self, chance):
        """Of what happens with that chance [nat]."""
        yes = ti.math.clamp(chance, LEAST, 1.0 - 1e-6)
        return -yes * log(yes) - (1.0 - yes) * log(1.0 - yes)

    @ti.func
    def _go_on(self, n, wind, t):
        """Say where the source is, if sure; go there, or to where a measurement tells most."""
        i = self.robot[n]
        mean = self.belief.mean(n)
        spread = self.belief.spread(n, mean)
        mean += ti.Vector(self.belief.low)
        self.declaring.consider(n, mean, spread, t)
        start = self.roads.free_cell_of(self.swarm.believed_position[i])
        if start >= 0:
            goal = -1
            if spread <= self.p.converged[n]:
                goal = self._nearest_to(start, mean)
            if goal < 0 or goal == start:
                goal = self._most_telling(n, start, wind)
            if goal >= 0:
                self.goal[n] = goal
                self.next[n] = ti.cast(self.roads.via[start, goal], ti.i32)
                self.potential.set_out(n)
                self.swarm.state[i] = MOVE

    @ti.func
    def _nearest_to(self, start, place):
        """The cell next to a place [m] of those that a robot in cell `start` can get to."""
        best, nearest = start, FAR
        for c in range(self.count):
            distance = (self.gas.center(c) - place).norm()
            if self.roads.length[start, c] < FAR and distance < nearest:
                best, nearest = c, distance
        return best

    @ti.func
    def _most_telling(self, n, start, wind):
        """The other cell in range where a measurement tells most in its time; -1 where there is none."""
        best, most = -1, -1.0
        for c in range(self.count):
            way = self.roads.length[start, c]
            here = self.gas.free[c] == 1 and c != start  # again at the same place, gas is the same as before
            if here and way <= self.p.range[n]:
                gain = self._information(n, c, wind) / (self.p.pause[n] + way / self.p.speed[n])
                if gain > most:
                    best, most = c, gain
        return best

    @ti.func
    def _follow(self, n, dt):
        """Drive to the next cell of the way; at its end, or where it is blocked, listen."""
        i = self.robot[n]
        last = self.next[n] == self.goal[n]
        place = self.roads.center(self.next[n])
        if self.potential.is_over(n, place, ti.select(last, NEAR, ON_THE_WAY * self.cell)):
            if last or self.potential.is_stuck(n):
                self.swarm.state[i] = ACQUIRE
            else:
                self.next[n] = ti.cast(self.roads.via[self.next[n], self.goal[n]], ti.i32)
                self.potential.set_out(n)
        if self.swarm.state[i] == MOVE:
            self.potential.drive(n, self.roads.center(self.next[n]), dt)
        else:
            self.potential.stand(n)
