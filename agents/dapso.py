"""DAPSO: particle swarm optimisation without a common clock, in which each robot is a particle that drives.

Akat & Gazi, "Decentralized asynchronous particle swarm optimization", IEEE Swarm Intelligence Symposium 2008, used for
gas maps by Turduev, Cabrita, Kırtay, Gazi & Marques, Autonomous Agents and Multi-Agent Systems 28 (2014) 72-100.
Constriction: Clerc & Kennedy, IEEE Trans. Evolutionary Computation 6 (2002) 58-73. Constants are our choice.

MEASURE  stand still and take the mean reading f, then choose a way point
DRIVE    go there by `potential`; there, after way_point_timeout, or where others are in the way: MEASURE
EXPLORE  neither the robot nor its neighbours know of gas: drive to a random place; there, or at a reading of
         threshold_ppm on the way: MEASURE. Not in the paper, and with 0 never; so do Li, Li, Lee & Zhang, PLoS ONE 9
         (2014) e111970, in their hybrid

With x: the robot's place, p: the best it has measured at, f(p) that reading, which fades with age,

    p <- x where f >= f(p);    g: the best of p and of what its neighbours said last (`radio`)
    v <- chi (v + phi1 r1 (p - x) + phi2 r2 (g - x)),    |v| <= longest_step
    w = x + v, kept off walls and obstacles;    v <- w - x

r1, r2: uniform in (0, 1) per component. Then it tells its team p and f(p). After `restart_after` steps in a row shorter
than restart_step it forgets all that it knows and drives to a random place, whatever it smells on the way.
"""

import cmath

import taichi as ti

from taichi_plume.agents.acquisition import Acquisition
from taichi_plume.agents.potential import Potential
from taichi_plume.agents.radio import Radio
from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.grid.rng import stream_id, uniform4
from taichi_plume.scenario import algorithms

MEASURE, DRIVE, EXPLORE = range(3)

UNKNOWN = -1.0  # ppm, f(p) of a robot that knows of no place


def constriction(phi: float, kappa: float = 1.0) -> float:
    """chi = 2 kappa / |2 - phi - sqrt(phi² - 4 phi)|; kappa itself for phi <= 4."""
    return 2 * kappa / abs(2 - phi - cmath.sqrt(phi**2 - 4 * phi))


@ti.data_oriented
class Dapso:
    """The DAPSO algorithm for the robots of one group. tick: control period [s]."""

    STATE_NAMES: tuple[str, ...] = ("MEASURE", "DRIVE", "EXPLORE")

    def __init__(self, swarm: Swarm, group: GroupRange, tick: float):
        model = group.model.algorithm
        assert isinstance(model, algorithms.Dapso)
        self.swarm, self.start, self.size, self.count = swarm, group.start, group.size, group.count
        self.seed, self.first = swarm.seed, group.first
        self.stream = stream_id(f"group {group.number}/dapso")
        self.radio = Radio(swarm, group)
        self.potential = Potential(swarm, group, model.speed, model.avoidance)
        self.phi1, self.phi2 = model.phi1, model.phi2
        self.chi = constriction(model.phi1 + model.phi2, model.kappa)
        self.fading = 1.0 / model.memory if model.memory > 0 else 0.0  # 1/s
        self.longest = model.longest_step
        self.tolerance, self.timeout = model.way_point_tolerance, model.way_point_timeout
        self.threshold = model.threshold_ppm
        self.restart_after, self.restart_step = model.restart_after, model.restart_step
        self.neighbourhood = model.neighbourhood
        self.acquisition = Acquisition(swarm, group, model, tick)
        n = self.size
        self.under_way = ti.field(ti.i32, n)  # ticks since the last acquisition
        self.step = ti.Vector.field(2, ti.f32, n)  # v [m]
        self.way_point = ti.Vector.field(2, ti.f32, n)  # w [m]
        self.best = ti.field(ti.f32, n)  # f(p) at the last update [ppm]
        self.best_time = ti.field(ti.f32, n)  # of that update [s]
        self.best_place = ti.Vector.field(2, ti.f32, n)  # p [m]
        self.goal = ti.Vector.field(2, ti.f32, n)  # g at the last update [m]
        self.short = ti.field(ti.i32, n)  # short steps in a row
        self._begin()

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn the readings at time t [s] into commands for the next dt [s]."""
        self._act(tick, t, dt)
        self.radio.deliver(tick, t)

    @ti.kernel
    def _begin(self):
        for n in range(self.size):
            self.best[n] = UNKNOWN
            u = uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, 0, 0)
            inwards = self._inside(ti.Vector([u[0], u[1]])) - self.swarm.believed_position[self.start + n]
            self.step[n] = u[2] * self.longest * inwards / ti.max(inwards.norm(), 1e-6)

    @ti.kernel
    def _act(self, tick: int, t: float, dt: float):
        for n in range(self.size):
            i = self.start + n
            if self.swarm.state[i] == MEASURE:
                self.potential.stand(n)
                if self.acquisition.listen(n):
                    self._learn(n, t)
                    self._choose(n, tick, t)
                    self.potential.begin(n)
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
        """Whether it is time to measure."""
        i = self.start + n
        there = self.potential.is_over(n, self.way_point[n], self.tolerance)
        if self.swarm.state[i] == DRIVE:
            there = there or self.under_way[n] * dt >= self.timeout or self.potential.tries[n] > 0
        else:
            there = there or self.swarm.reading[i] >= self.threshold
        return there

    @ti.func
    def _learn(self, n, t):
        """Keep the best of what it measured."""
        i = self.start + n
        f = self.acquisition.mean(n)
        self.best[n] *= ti.exp(-self.fading * (t - self.best_time[n]))
        self.best_time[n] = t
        if f >= self.best[n]:
            self.best[n], self.best_place[n] = f, self.swarm.believed_position[i]
            self.swarm.hits[i] += 1

    @ti.func
    def _choose(self, n, tick, t):
        """The next way point, and the state to drive there."""
        i = self.start + n
        x, p = self.swarm.believed_position[i], self.best_place[n]
        most, g = self._best_known(n, tick, t)
        self.goal[n] = g
        u = uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, tick, 0)
        r1, r2 = ti.Vector([u[0], u[1]]), ti.Vector([u[2], u[3]])
        v = self.chi * (self.step[n] + self.phi1 * r1 * (p - x) + self.phi2 * r2 * (g - x))
        w = self.potential.clear(x + self._shortened(v))
        self.radio.say(n, self.best[n], p)
        self.short[n] = ti.select((w - x).norm() < self.restart_step, self.short[n] + 1, 0)
        restarts = self.restart_after > 0 and self.short[n] >= self.restart_after
        explores = most < self.threshold
        if restarts or explores:
            u = uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, tick, 1)
            w = self.potential.clear(self._inside(ti.Vector([u[0], u[1]])))
            self.short[n] = 0
        if restarts:
            self.best[n] = UNKNOWN
            self.radio.forget(n)
        self.swarm.state[i] = ti.select(explores, EXPLORE, DRIVE)
        self.way_point[n] = w
        self.step[n] = self._shortened(w - x)

    @ti.func
    def _shortened(self, v):
        return v * ti.min(1.0, self.longest / ti.max(v.norm(), 1e-6))

    @ti.func
    def _inside(self, u):
        """The place with the shares u of the way from corner to corner of where way points can be."""
        low = ti.Vector([self.potential.low[0], self.potential.low[1]])
        return low + u * (ti.Vector([self.potential.high[0], self.potential.high[1]]) - low)

    @ti.func
    def _best_known(self, n, tick, t):
        """The best reading that robot n and its neighbours know of, and g, where that was."""
        best, g = self.best[n], self.best_place[n]
        for m in range(self.count):
            if self.radio.has_heard(n, m) and self._is_neighbour(n, m, tick, t):
                f = self._told(n, m, t)
                if f > best:
                    best, g = f, self.radio.place[n, m]
        return best, g

    @ti.func
    def _told(self, n, m, t):
        """What robot n makes of the value it heard last from robot m of its team [ppm]."""
        return self.radio.value[n, m] * ti.exp(-self.fading * (t - self.radio.time[n, m]))

    @ti.func
    def _is_neighbour(self, n, m, tick, t):
        """Whether robot n now listens to robot m of its team, of which it has heard."""
        result = 0
        if ti.static(self.neighbourhood.kind == "search_space"):
            apart = self.radio.sender[n, m] - self.swarm.believed_position[self.start + n]
            result = ti.cast(apart.norm() <= ti.static(self.neighbourhood.distance), ti.i32)
        elif ti.static(self.neighbourhood.kind == "function_value"):
            apart = ti.abs(self._told(n, m, t) - self.best[n])
            closer = 0
            for k in range(self.count):
                if k != m and self.radio.has_heard(n, k):
                    other = ti.abs(self._told(n, k, t) - self.best[n])
                    closer += ti.cast(other < apart or (other == apart and k < m), ti.i32)
            result = ti.cast(closer < ti.static(self.neighbourhood.number), ti.i32)
        else:
            u = uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, tick, 2 + m)
            result = ti.cast(u[0] < ti.static(self.neighbourhood.probability), ti.i32)
        return result
