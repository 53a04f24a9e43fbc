"""Hit map: the posterior of the source's position from hits, misses and the wind, and the most informative next cell.

After Ojeda, Monroy & Gonzalez-Jimenez, "Information-driven gas source localization exploiting gas and wind local
measurements for autonomous mobile robots", IEEE Robotics and Automation Letters 6 (2021) 1320-1326,
doi:10.1109/LRA.2021.3057290 (GrGSL), and "Robotic gas source localization with probabilistic mapping and online
dispersion simulation", IEEE Trans. Robotics (2024), arXiv:2304.08879 (PMFS).

ACQUIRE  stand still; a mean reading at the threshold or above is a hit, and the map is updated by it
MOVE     along a free path to the next cell

From GrGSL: the floor's free cells, known to the robot; a Gaussian of the angle between upwind and the start of the
path to the source, with paths that lead around obstacles (`shortest_paths`); a Gaussian of the length of the path,
on all sides; Bayes' rule over the cells; and an end of the search when the source's variance is small. From PMFS: hits
have a probability, whose complement makes a miss evidence. A robot in cell c has a hit from a source in cell b with the
likelihood

    false_alarm + (hit - false_alarm) max(exp(-θ²/2(spread² + cell²/6e²) - d/fading), exp(-d²/2 near²))

In calm air only the second term remains. d: path from c to b [m], θ: angle between upwind and the start of the path,
which is straight for e [m]; cell²/6 is the variance of the positions of robot and source in their cells. PMFS simulates
the gas of each candidate source in an estimated flow instead, and in GrGSL a miss is evidence against the path since
the last hit. Our choices are the fading, the use of the last measured wind for further cells, and the next cell: within
`range` the largest expected information on the source (mutual information with hit or miss) over the time to go there
and measure; after convergence the expected position of the source. For declarations, and cells ruled out by a continued
search, see `beliefs`.
"""

from math import radians

import numpy as np

from taichi_plume.agents.acquisition import MEAN, Acquisition
from taichi_plume.agents.beliefs import LEAST, SPREAD, Beliefs, Declaring
from taichi_plume.agents.decisions import Decision, way_point
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.potential import Potential
from taichi_plume.agents.priors import require_prior
from taichi_plume.agents.shared_readings import SharedReadings, TeamInference
from taichi_plume.agents.shortest_paths import FAR, Ways
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.way_points import WayPoints
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import direction, exp, log
from taichi_plume.scenario.belief_algorithms import HitMap as Model

ACQUIRE, MOVE = range(2)


class HitMap(TeamInference):
    """Search algorithm that infers the source from hits, misses and wind. tick: control period [s]."""

    PER_GROUP: bool = True  # has a single map of paths
    WORK = 4
    STATE: tuple[str, ...] = (
        *("potential", "acquisition", "declaring", "belief", "felt", "course"),
        *("detection", "entropy", "information", "readings"),
    )
    STATE_NAMES: tuple[str, ...] = ("ACQUIRE", "MOVE")
    DECISIONS: tuple[Decision, ...] = (
        MEAN,
        Decision("detection", "1", "1: the last acquisition was a detection, 0: not"),
        Decision("entropy", "nat", "entropy of the belief after the last acquisition"),
        SPREAD,
        *way_point(),
        Decision("information", "nat/s", "expected information there per time; null on the way to the mean"),
    )

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        super().__init__(swarm, members, tick)
        require_prior(members, self.beliefs())

    def _allocate(self) -> None:
        super()._allocate()
        self.potential = Potential(self.members, self.p)
        self.acquisition = Acquisition(self.members, self.p)
        self.declaring = Declaring(self.members, self.p)
        self.belief = Beliefs(self.members, self.model.cell)
        self.gas = Ways(self.swarm.clearance, self.model.cell, 0.0)  # paths of air
        room = self.members.groups[0].model.body.radius + self.model.avoidance
        self.roads = Ways(self.swarm.clearance, self.model.cell, room)  # paths of robots
        self.course = WayPoints(self.members, self.roads, self.potential)
        self.count, self.columns, self.cell = self.gas.count, self.gas.shape[1], self.gas.cell
        self.felt = ti.vector_field(2, ti.f32, self.size)  # sum of the wind during an acquisition [m/s]
        self.home = ti.field(ti.i32, self.size)  # cell of the start position
        self.detection, self.entropy, self.information = (
            ti.filled(np.full(self.size, np.nan), ti.f32) for _ in range(3)
        )  # of the last acquisition; NaN before
        self.belief_cell, self.belief_low = self.cell, np.array(self.gas.low)

    def numbers(self, group: GroupRange, model: Model) -> Numbers:
        return {
            **Potential.numbers(self.swarm, group, model.speed, model.avoidance),
            **Acquisition.numbers(group, self.tick),
            **Declaring.numbers(model, group),
            **SharedReadings.numbers(group, self.tick),
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

    def beliefs(self) -> np.ndarray:
        return self.belief.p.to_numpy()

    @property
    def way_point(self) -> np.ndarray:
        """Centre of the cell to which each robot drives (size, 2) [m]; NaN before the first."""
        return np.where(np.isnan(self.entropy.values)[:, None], np.nan, self.course.places)

    @ti.func
    def _start(self, n):
        self.home[n] = self.gas.free_cell_of(self.swarm.believed_position[self.robot[n]])
        self._forget(n)

    @ti.func
    def _measure(self, n, tick):
        i = self.robot[n]
        if self.swarm.state[i] == ACQUIRE:
            self.potential.stand(n)
            if self.swarm.wind_known[i] == 1:
                self.felt[n] += self.swarm.wind[i]
            ticks = self.acquisition.since[n] + 1
            if self.acquisition.listen(n):
                wind = self.felt[n] / ticks
                self.felt[n] = ti.Vector([0.0, 0.0])
                hit = self.acquisition.mean(n) >= self.p.threshold[n]
                self.swarm.hits[i] += ti.cast(hit, ti.i32)
                if self.gas.free_cell_of(self.swarm.believed_position[i]) >= 0:
                    self.readings.end(n, tick, ti.cast(hit, ti.f32), wind)

    @ti.func
    def _proceed(self, n, tick, t, dt):
        i = self.robot[n]
        if self.readings.ended[n] == 1:
            self.detection[n], self.entropy[n] = self.readings.value[n], self.belief.entropy(n)
            self._go_on(n, self.readings.wind[n], t)
        if self.swarm.state[i] == MOVE:
            if self.course.follow(n, dt):
                self.swarm.state[i] = ACQUIRE

    @ti.func
    def _forget(self, n):
        """Reset robot n's belief to the prior in all cells with a path to its start; in all cells if there are none."""
        total, everywhere = 0.0, self.belief.even * ti.cast(self.home[n] < 0, ti.f32)
        for b in range(self.count):
            total += self._is_reached(n, b) * self.belief.weight[b // self.columns, b % self.columns]
        for b in range(self.count):
            weight = self.belief.weight[b // self.columns, b % self.columns]
            now = ti.select(
                total > 0.0, self._is_reached(n, b) * weight / ti.max(LEAST, total), everywhere * weight
            )
            self.belief.p[n, b // self.columns, b % self.columns] = now

    @ti.func
    def _is_reached(self, n, b):
        """Return 1 if a path leads from cell b to the start of robot n, so that gas can reach it, else 0."""
        return ti.cast(self.home[n] >= 0 and self.gas.length[ti.max(self.home[n], 0), b] < FAR, ti.i32)

    @ti.func
    def _chance(self, n, c, b, wind):
        """Return the likelihood of a hit of robot n in cell c for a source in cell b; wind (2,): measured [m/s]."""
        way, share = self.gas.length[c, b], 0.0
        if way < FAR:
            share = exp(-self.p.near[n] * way * way)
            if wind.norm() > self.p.calm[n] and b != c:
                e = self.gas.center(ti.cast(self.gas.via[c, b], ti.i32)) - self.gas.center(c)
                # the angle between the start of the path and upwind, and its variance
                angle = direction(e[0] * wind[1] - e[1] * wind[0], -e.dot(wind))  # type: ignore
                variance = self.p.angles[n] + self.cell * self.cell / (6.0 * e.norm_sqr())  # type: ignore
                share = ti.max(share, exp(-0.5 * angle * angle / variance - self.p.fading[n] * way))
        return self.p.false_alarm[n] + (self.p.hit[n] - self.p.false_alarm[n]) * share

    @ti.func
    def _learn(self, n, k):
        total = 0.0
        x, hit, wind = self.readings.place[k], self.readings.value[k] > 0.0, self.readings.wind[k]
        here = self.gas.free_cell_of(x)
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
        """Return the expected information [nat] about the source from a measurement of robot n in cell c."""
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
        """Return the entropy [nat] of an event with this probability."""
        yes = ti.math.clamp(chance, LEAST, 1.0 - 1e-6)
        return -yes * log(yes) - (1.0 - yes) * log(1.0 - yes)

    @ti.func
    def _go_on(self, n, wind, t):
        """Declare if robot n's belief is sure; then set out for its mean or the most informative cell."""
        i = self.robot[n]
        mean = self.belief.mean(n)
        spread = self.belief.spread(n, mean)
        mean += ti.Vector(self.belief.low)
        self.declaring.consider(n, mean, spread, t)
        start = self.roads.free_cell_of(self.swarm.believed_position[i])
        if start >= 0:
            goal = -1
            self.information[n] = ti.math.nan
            if spread <= self.p.converged[n]:
                goal = self.course.nearest_to(start, mean)
            if goal < 0 or goal == start:
                goal = self._most_telling(n, start, wind)
            if goal >= 0:
                self.course.set_out(n, start, goal)
                self.swarm.state[i] = MOVE

    @ti.func
    def _most_telling(self, n, start, wind):
        """Return the other cell in range with the most expected information per time; -1 if there is none."""
        best, most = -1, -1.0
        for c in range(self.count):
            way = self.roads.length[start, c]
            here = (
                self.gas.free[c] == 1 and c != start
            )  # a second measurement at the same position brings no information
            if here and way <= self.p.range[n]:
                gain = self._information(n, c, wind) / (self.p.pause[n] + way / self.p.speed[n])
                if gain > most:
                    best, most = c, gain
        if best >= 0:
            self.information[n] = most
        return best
