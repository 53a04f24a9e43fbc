"""DAPSO: decentralized asynchronous particle swarm optimisation (PSO), in which each robot is a particle that drives.

Akat & Gazi, "Decentralized asynchronous particle swarm optimization", IEEE Swarm Intelligence Symposium 2008, used
for gas maps by Turduev, Cabrita, Kırtay, Gazi & Marques, Autonomous Agents and Multi-Agent Systems 28 (2014) 72-100.
Constriction: Clerc & Kennedy, IEEE Trans. Evolutionary Computation 6 (2002) 58-73. Constants are our choice.

MEASURE  stand still and take the mean reading f, then choose a way point
DRIVE    go there by `potential`; there, after way_point_timeout, or if others are in the way: MEASURE
EXPLORE  neither the robot nor its neighbours know of gas: drive to a random position; there, or at a reading of
         threshold_ppm on the way: MEASURE. Not in the paper, and with 0 never; so do Li, Li, Lee & Zhang, PLoS ONE 9
         (2014) e111970, in their hybrid

With x: the robot's position, p: the position of its best measurement, f(p) that reading, which fades with age,

    p <- x where f >= f(p);    g: the best of p and of the neighbours' last messages (`radio`)
    v <- chi (v + phi1 r1 (p - x) + phi2 r2 (g - x)),    |v| <= longest_step
    w = x + v, kept off walls and obstacles;    v <- w - x

r1, r2: uniform in (0, 1) per component. Then the robot sends p and f(p) to its team. After `restart_after` steps in a
row shorter than restart_step it forgets all measurements and messages and drives to a random position, whatever its
readings on the way.
"""

import cmath

import numpy as np

from taichi_plume.agents.acquisition import MEAN, Acquisition
from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.decisions import Decision, position, way_point
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.potential import Potential
from taichi_plume.agents.radio import Radio
from taichi_plume.engine import ti
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario import algorithms

MEASURE, DRIVE, EXPLORE = range(3)

SEARCH_SPACE, FUNCTION_VALUE, RANDOM = range(3)
NEIGHBOURS = {"search_space": SEARCH_SPACE, "function_value": FUNCTION_VALUE, "random": RANDOM}

UNKNOWN = -1.0  # ppm, f(p) of a robot without a position p


def constriction(phi: float, kappa: float = 1.0) -> float:
    """Return the constriction factor chi = 2 kappa / |2 - phi - sqrt(phi² - 4 phi)|, which is kappa for phi <= 4."""
    return 2 * kappa / abs(2 - phi - cmath.sqrt(phi**2 - 4 * phi))


class Dapso(KernelAlgorithm):
    """DAPSO search algorithm, in which each robot is a particle of a swarm optimisation. tick: control period [s]."""

    STREAM = "dapso"
    TALKS = True
    STATE: tuple[str, ...] = (
        *("radio", "potential", "acquisition", "under_way", "step", "way_point"),
        *("best", "best_time", "best_place", "goal", "short", "most", "odour_known"),
    )
    STATE_NAMES: tuple[str, ...] = ("MEASURE", "DRIVE", "EXPLORE")
    DECISIONS: tuple[Decision, ...] = (
        MEAN,
        Decision("own_best_ppm", "ppm", "f(p), best reading of the robot", "best", none=UNKNOWN),
        *position("own_best", "p, where the robot had its best reading", "best_place"),
        Decision(
            "known_best_ppm", "ppm", "best reading of the robot and its neighbours", "most", none=UNKNOWN
        ),
        *position("known_best", "g, where the robot or a neighbour had this reading", "goal"),
        Decision("odour_known", "1", "1: this reading reaches the threshold, 0: not, the robot explores"),
        *way_point(),
        Decision("short_steps", "1", "number of steps in a row shorter than `restart_step`", "short"),
    )

    def _allocate(self) -> None:
        n = self.size
        self.radio = Radio(self.members, self.p)
        self.potential = Potential(self.members, self.p)
        self.acquisition = Acquisition(self.members, self.p)
        self.under_way = ti.field(ti.i32, n)  # ticks since the last acquisition
        self.step = ti.vector_field(2, ti.f32, n)  # v [m]
        self.way_point = ti.vector_field(2, ti.f32, n)  # w [m]
        self.best = ti.field(ti.f32, n)  # f(p) at the last update [ppm]
        self.best_time = ti.field(ti.f32, n)  # time of that update [s]
        self.best_place = ti.vector_field(2, ti.f32, n)  # p [m]
        self.goal = ti.vector_field(2, ti.f32, n)  # g at the last update [m]
        for place in (self.way_point, self.best_place, self.goal):
            place.fill(np.nan)
        self.short = ti.field(ti.i32, n)  # short steps in a row
        self.most = ti.filled(np.full(n, UNKNOWN), ti.f32)  # f(g) at the last update [ppm]
        self.odour_known = ti.filled(np.full(n, np.nan), ti.f32)  # whether it reaches the threshold

    def numbers(self, group: GroupRange, model: algorithms.Dapso) -> Numbers:
        return {
            **Radio.numbers(group),
            **Potential.numbers(self.swarm, group, model.speed, model.avoidance),
            **Acquisition.numbers(group, self.tick),
            "phi1": model.phi1,
            "phi2": model.phi2,
            "chi": constriction(model.phi1 + model.phi2, model.kappa),
            "fading": 1.0 / model.memory if model.memory > 0 else 0.0,  # 1/s
            "longest": model.longest_step,  # m
            "tolerance": model.way_point_tolerance,  # m
            "timeout": model.way_point_timeout,  # s
            "threshold": model.threshold_ppm,
            "restart_after": model.restart_after,  # steps
            "restart_step": model.restart_step,  # m
            "neighbours": NEIGHBOURS[model.neighbourhood.kind],
            "within": model.neighbourhood.limit,
        }

    def act(self, tick: int, t: float, dt: float) -> None:
        super().act(tick, t, dt)
        self.radio.deliver(tick, t)

    @ti.func
    def _start(self, n):
        self.best[n] = UNKNOWN
        self.radio.forget(n)
        u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], 0, 0)
        inwards = self._inside(n, ti.Vector([u[0], u[1]])) - self.swarm.believed_position[self.robot[n]]
        self.step[n] = u[2] * self.p.longest[n] * inwards / ti.max(inwards.norm(), 1e-6)

    @ti.func
    def _step(self, n, tick, t, dt):
        i = self.robot[n]
        if self.swarm.state[i] == MEASURE:
            self.potential.stand(n)
            if self.acquisition.listen(n):
                self._learn(n, t)
                self._choose(n, tick, t)
                self.potential.set_out(n)
                self.under_way[n] = 0
        if self.swarm.state[i] != MEASURE:
            if self._is_there(n, dt):
                self.potential.stand(n)
                self.swarm.state[i] = MEASURE
            else:
                self.under_way[n] += 1
                self.potential.drive(n, self.way_point[n], dt)

    @ti.func
    def _is_there(self, n, dt):
        """Return whether robot n has to measure: at its way point, after a timeout, stuck, or at gas in EXPLORE."""
        i = self.robot[n]
        there = self.potential.is_over(n, self.way_point[n], self.p.tolerance[n])
        if self.swarm.state[i] == DRIVE:
            there = there or self.under_way[n] * dt >= self.p.timeout[n] or self.potential.tries[n] > 0
        else:
            there = there or self.swarm.reading[i] >= self.p.threshold[n]
        return there

    @ti.func
    def _learn(self, n, t):
        """Fade robot n's best reading f(p), and replace p and f(p) if its new measurement is at least as high."""
        i = self.robot[n]
        f = self.acquisition.mean(n)
        self.best[n] *= ti.exp(-self.p.fading[n] * (t - self.best_time[n]))
        self.best_time[n] = t
        if f >= self.best[n]:
            self.best[n], self.best_place[n] = f, self.swarm.believed_position[i]
            self.swarm.hits[i] += ti.cast(self.swarm.searches(i), ti.i32)

    @ti.func
    def _choose(self, n, tick, t):
        """Choose robot n's next way point w and its state, and send its best position p and f(p) to teammates."""
        i = self.robot[n]
        x, p = self.swarm.believed_position[i], self.best_place[n]
        most, g = self._best_known(n, tick, t)
        self.goal[n] = g
        u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 0)
        r1, r2 = ti.Vector([u[0], u[1]]), ti.Vector([u[2], u[3]])
        v = self.p.chi[n] * (self.step[n] + self.p.phi1[n] * r1 * (p - x) + self.p.phi2[n] * r2 * (g - x))
        w = self.potential.clear(n, x + self._shortened(n, v))
        self.radio.say(n, self.best[n], p)
        self.short[n] = ti.select((w - x).norm() < self.p.restart_step[n], self.short[n] + 1, 0)
        restarts = self.p.restart_after[n] > 0 and self.short[n] >= self.p.restart_after[n]
        explores = most < self.p.threshold[n]
        self.most[n], self.odour_known[n] = most, 1.0 - ti.cast(explores, ti.f32)
        if restarts or explores:
            u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 1)
            w = self.potential.clear(n, self._inside(n, ti.Vector([u[0], u[1]])))
            self.short[n] = 0
        if restarts:
            self.best[n] = UNKNOWN
            self.radio.forget(n)
        self.swarm.state[i] = ti.select(explores, EXPLORE, DRIVE)
        self.way_point[n] = w
        self.step[n] = self._shortened(n, w - x)

    @ti.func
    def _shortened(self, n, v):
        return v * ti.min(1.0, self.p.longest[n] / ti.max(v.norm(), 1e-6))

    @ti.func
    def _inside(self, n, u):
        """Return the point (2,) [m] at the fractions u (2,), 0 to 1, of robot n's area of way points."""
        low = self.potential.low(n)
        return low + u * (self.potential.high(n) - low)

    @ti.func
    def _best_known(self, n, tick, t):
        """Return the best reading [ppm] that robot n and its neighbours know, and its position g [m]."""
        best, g = self.best[n], self.best_place[n]
        for m in range(self.p.count[n]):
            if self.radio.has_heard(n, m) and self._is_neighbour(n, m, tick, t):
                f = self._faded(n, m, t)
                if f > best:
                    best, g = f, self.radio.place[n, m]
        return best, g

    @ti.func
    def _faded(self, n, m, t):
        """Return the value [ppm], faded with age, of the last message that robot n received from teammate m."""
        return self.radio.value[n, m] * ti.exp(-self.p.fading[n] * (t - self.radio.time[n, m]))

    @ti.func
    def _is_neighbour(self, n, m, tick, t):
        """Return 1 if teammate m, who has sent a message, is now a neighbour of robot n, else 0."""
        result = 0
        if self.p.neighbours[n] == SEARCH_SPACE:
            apart = self.radio.sender[n, m] - self.swarm.believed_position[self.robot[n]]
            result = ti.cast(apart.norm() <= self.p.within[n], ti.i32)
        elif self.p.neighbours[n] == FUNCTION_VALUE:
            apart = ti.abs(self._faded(n, m, t) - self.best[n])
            closer = 0
            for k in range(self.p.count[n]):
                if k != m and self.radio.has_heard(n, k):
                    other = ti.abs(self._faded(n, k, t) - self.best[n])
                    closer += ti.cast(other < apart or (other == apart and k < m), ti.i32)
            result = ti.cast(closer < self.p.within[n], ti.i32)
        else:
            u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 2 + m)
            result = ti.cast(u[0] < self.p.within[n], ti.i32)
        return result
