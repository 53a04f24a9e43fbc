"""Particle filter (Bayes): trace gas back along the measured wind by likelihood and particle resampling, then declare.

After Li, Meng, Wang & Zeng, "Odor source localization using a mobile robot in outdoor airflow environments with a
particle filter algorithm", Autonomous Robots 30 (2011) 281-292, doi:10.1007/s10514-011-9219-2: the filter runs beside a
plume tracing behaviour, here `casting`, and the search ends when its estimates lie together. The likelihood is that of
the plume model of `releases`. Particles are drawn at the first detection (importance sampling): half of them where the
gas may have come from, from the mean of the distributions of the releases that were on the floor, seen from the robot.
The rest come from the prior, uniform over the floor unless given. Weights are the likelihood times the prior over the
density of the draw; each update multiplies them by the likelihood. Systematic resampling (Kitagawa 1996,
doi:10.1080/10618600.1996.10474692) follows when the effective number of particles is below half of them, with
roughening (Gordon, Salmond & Smith 1993, doi:10.1049/ip-f-2.1993.0015).

GO  to the estimate by `potential`, when the last estimates and the particles lie together; at the estimate, or as near
as possible, the robot declares the estimate if the belief is sure (see `beliefs`) on a second visit; then IN_PLUME or
LOST, as when the particles spread again

Our choices: the robot drives to the estimate and must come back to the same position before it declares, which rejects
an estimate halfway up the plume. The probability of a detection is bounded as a whole, as misses come in bouts. Five
detections in a row that the particles explain worse than a source anywhere on the floor restart the filter. A continued
search rules positions out. The values of keys suit the scale of a room.
"""

import numpy as np

from taichi_plume.agents.beliefs import Declaring
from taichi_plume.agents.casting import IN_PLUME, LOST, SIDESTEP, Casting
from taichi_plume.agents.decisions import Decision, position
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.potential import NEAR, Potential
from taichi_plume.agents.priors import prior_weights
from taichi_plume.agents.releases import Releases
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.rng import normal4, uniform4
from taichi_plume.scenario.belief_algorithms import ParticleFilter as Model

GO = 5  # after the states of casting
ENOUGH = 0.5  # fraction of the particles; a lower effective number triggers resampling
EVENLY = 0.5  # fraction of the particles drawn from the prior
DOUBTS = 5  # unexplained detections in a row
APART = 2.0  # times `converged`: particles that spread so far have not converged
LEAST = 1e-30  # sum of weights that counts as zero


class ParticleFilter(Casting):
    """Search algorithm with a particle filter of the source position per robot. tick: control period [s]."""

    PER_GROUP: bool = True  # the numbers of particles and periods are shapes
    STREAM = "particle_filter"
    STATE: tuple[str, ...] = (
        *Casting.STATE,
        *("potential", "declaring", "particle", "weight", "known", "releases", "smelt"),
        *("mean", "spread", "estimate", "estimated", "visit", "visited", "doubts"),
    )
    STATE_NAMES: tuple[str, ...] = (*Casting.STATE_NAMES, "GO")
    DECISIONS: tuple[Decision, ...] = (
        *Casting.DECISIONS,
        Decision("filter_runs", "1", "1: there are particles, 0: none since the last restart", "known"),
        *position("estimate", "mean of the particles: estimated source", "mean"),
        Decision("belief_spread_m", "m", "root mean square distance of the source from its mean", "spread"),
        Decision("estimates", "1", "number of estimates since the robot traces the plume", "estimated"),
        Decision("doubts", "1", "number of unexplained detections in a row"),
    )

    def _allocate(self) -> None:
        super()._allocate()
        model: Model = self.model
        n, self.count, self.kept = self.size, model.particles, model.estimates
        self.between = max(1, round(model.period / self.tick))
        self.particle = ti.vector_field(2, ti.f32, (n, self.count))  # places [m]
        self.spare = ti.vector_field(2, ti.f32, (n, self.count))
        self.weight = ti.field(ti.f32, (n, self.count))
        self.known = ti.field(ti.i32, n)  # whether there are particles
        self.smelt = ti.field(ti.i32, n)  # whether the robot detects gas
        self.mean = ti.vector_field(2, ti.f32, n)  # mean of the particles: the estimate [m]
        self.spread = ti.field(ti.f32, n)  # root mean square distance of the particles from it [m]
        self.estimate = ti.vector_field(2, ti.f32, (n, self.kept))  # last estimates, a ring buffer [m]
        self.estimated = ti.field(ti.i32, n)  # number of estimates so far
        self.visit: Field = ti.vector_field(2, ti.f32, n)  # last estimate visited by the robot [m]
        self.visited = ti.field(ti.i32, n)  # whether there was one
        self.doubts = ti.field(ti.i32, n)  # unexplained detections in a row
        self.mean.fill(np.nan)
        self.spread.fill(np.nan)
        self.belief_cell = model.cell
        clearance = self.swarm.clearance
        self.belief_low = np.array(clearance.low)
        self.floor = (tuple(clearance.low), tuple(clearance.high))
        weights = prior_weights(self.members, model.cell)
        self.prior, self.is_uniform = weights / weights.sum(), bool((weights == 1.0).all())
        self.rows, self.columns = weights.shape
        self.relative = ti.filled(weights, ti.f32)  # prior over the uniform one, of each cell
        self.cumulated = ti.filled(np.cumsum(self.prior.ravel()), ti.f32)
        period = self.between * self.tick
        self.releases = Releases(self.members, self.p, max(1, round(model.memory / period)), period)
        self.potential = Potential(self.members, self.p)
        self.declaring = Declaring(self.members, self.p)

    def numbers(self, group: GroupRange, model: Model) -> Numbers:
        return {
            **super().numbers(group, model),
            **Potential.numbers(self.swarm, group, model.speed, model.avoidance),
            **Declaring.numbers(model, group),
            **Releases.numbers(model),
            "roughening": model.roughening / model.particles**0.5,
            "converged": model.converged,  # m
        }

    def beliefs(self) -> np.ndarray:
        """Return each robot's particle weight per cell, (size, nx, ny), sum 1; the prior before the first detection."""
        low, cells = np.array(self.floor[0]), np.array(self.prior.shape)
        particle, weight, known = self.particle.values, self.weight.values, self.known.values
        belief = np.zeros((self.size, *cells), np.float32)
        at = np.clip(((particle - low) / self.belief_cell).astype(int), 0, cells - 1)
        for n in range(self.size):
            if known[n]:
                np.add.at(belief[n], (at[n, :, 0], at[n, :, 1]), weight[n])
            else:
                belief[n] = self.prior
        belief /= belief.sum(axis=(1, 2), keepdims=True)
        return belief

    def act(self, tick: int, t: float, dt: float) -> None:
        due = tick % self.between == 0
        self._sense(due, dt)
        if due:
            self._weigh(tick)
            self._conclude(tick)
        self._drive(t, dt)

    @ti.kernel
    def _sense(self, due: bool, dt: float):
        """Update wind, gas detection and plume tracing of all robots; if an update of the particles is due, also the
        drift of past releases.
        """
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            i = self.robot[n]
            if not self.swarm.searches(i):
                continue
            self._estimate_wind(n)
            self.releases.drifts(n, dt)
            if self.swarm.state[i] == GO:
                smells = False
                if self.smelt[n] == 1:
                    smells = self._still_smells(n)
                else:
                    smells = self._comes_upon_plume(n)
                self.smelt[n] = ti.cast(smells, ti.i32)
            else:
                self._feel_bumper(n, dt)
                self._decide(n, dt)
                in_plume = self.swarm.state[i] == IN_PLUME or self.swarm.state[i] == SIDESTEP
                self.smelt[n] = ti.cast(in_plume and self._is_strong(n), ti.i32)
            if due:
                self.releases.look_back(n)

    @ti.kernel
    def _weigh(self, tick: int):
        """Multiply all particle weights by the likelihood; robots with a first detection draw their particles."""
        ti.loop_config(serialize=ti.static(runs_serially(10 * self.size * self.count)))
        for n, m in ti.ndrange(*self.weight.shape):
            if not self.swarm.searches(self.robot[n]):
                continue
            if self.known[n] == 1:
                chance = self.releases.likelihood(n, self.particle[n, m])
                apart = self.particle[n, m] - self.swarm.believed_position[self.robot[n]]
                if self.smelt[n] == 0:
                    chance = 1.0 - chance
                if apart.norm() < self.p.ends_at[n]:  # there the search would have ended
                    chance = 0.0
                self.weight[n, m] *= chance
            elif self.smelt[n] == 1:
                self._draw(n, m, tick)

    @ti.func
    def _draw(self, n, m, tick):
        """Draw particle m of robot n and its weight by importance sampling; particles off the floor have weight 0."""
        low, high = ti.Vector(self.floor[0]), ti.Vector(self.floor[1])
        x = self.swarm.believed_position[self.robot[n]]
        u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 1 + 2 * m)
        place = low + ti.Vector([u[0], u[1]]) * (high - low)
        if ti.static(not self.is_uniform):
            cell = self._cell_of_prior(u[3])
            place = low + self.belief_cell * (
                ti.Vector([cell // self.columns, cell % self.columns]) + ti.Vector([u[0], u[1]])
            )
        releases = 1
        for age in range(self.releases.released(n)):
            if self.releases.is_on_floor(x - self.releases.back[n, age]):
                releases = age + 1
        if u[2] >= EVENLY:
            g = normal4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 2 + 2 * m)
            age = ti.min(ti.cast(u[3] * releases, ti.i32), releases - 1)
            variance = self.releases.variance(n, age)
            place = x - self.releases.back[n, age] + ti.sqrt(variance) * ti.Vector([g[0], g[1]])
        density, relative = EVENLY / ((high - low)[0] * (high - low)[1]), 1.0
        if ti.static(not self.is_uniform):
            relative = self._relative_prior(place)
            density = EVENLY * relative / (self.belief_cell**2 * self.rows * self.columns)
        for age in range(releases):
            density += (1.0 - EVENLY) / releases * self.releases.patch(n, place, age)
        self.particle[n, m] = ti.math.clamp(place, low, high)
        self.weight[n, m] = ti.select(
            self.releases.is_on_floor(place), relative * self.releases.likelihood(n, place) / density, 0.0
        )

    @ti.func
    def _cell_of_prior(self, u):
        """Return the cell at the quantile u of the prior: the first cell up to which its sum reaches u."""
        first, last = 0, self.rows * self.columns - 1
        while first < last:
            middle = (first + last) // 2
            if self.cumulated[middle] < u:
                first = middle + 1
            else:
                last = middle
        return first

    @ti.func
    def _relative_prior(self, place):
        """Return the prior at the point `place` [m], as a multiple of the uniform one."""
        at = ti.cast(ti.floor((place - ti.Vector(self.floor[0])) / self.belief_cell), ti.i32)
        at = ti.math.clamp(at, 0, ti.Vector([self.rows, self.columns]) - 1)
        return self.relative[at[0], at[1]]

    @ti.kernel
    def _conclude(self, tick: int):
        """Normalise the particle weights of all robots, estimate the source, and resample degenerate weights."""
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            i = self.robot[n]
            if not self.swarm.searches(i):
                continue
            self.swarm.hits[i] += self.smelt[n]
            if self.known[n] == 0 and self.smelt[n] == 1:
                self.known[n], self.estimated[n], self.doubts[n] = 1, 0, 0
                self._normalise(n)
            elif self.known[n] == 1:
                total = self._normalise(n)
                if (
                    self.smelt[n] == 1
                ):  # total: probability of the observation, as the previous weights sum to 1
                    self.doubts[n] = ti.select(
                        total < self.releases.likelihood_anywhere(n), self.doubts[n] + 1, 0
                    )
                if total <= LEAST or self.doubts[n] >= DOUBTS:
                    self._forget(n)
            if self.known[n] == 1:
                self._estimate(n)
                if self._effective(n) < ENOUGH * self.count:
                    self._resample(n, tick)

    @ti.func
    def _normalise(self, n):
        """Divide the particle weights of robot n by their sum, and return the sum."""
        total = 0.0
        for m in range(self.count):
            total += self.weight[n, m]
        for m in range(self.count):
            self.weight[n, m] /= ti.max(total, LEAST)
        return total

    @ti.func
    def _estimate(self, n):
        """Compute the mean and the spread of robot n's particles, and append the mean to its estimates."""
        mean, spread = ti.Vector([0.0, 0.0]), 0.0
        for m in range(self.count):
            mean += self.weight[n, m] * self.particle[n, m]
        for m in range(self.count):
            apart = self.particle[n, m] - mean
            spread += self.weight[n, m] * apart.dot(apart)  # type: ignore
        self.mean[n], self.spread[n] = mean, ti.sqrt(spread)
        self.estimate[n, self.estimated[n] % self.kept] = mean
        self.estimated[n] += 1

    @ti.func
    def _effective(self, n):
        """Return the effective number of robot n's particles, 1 / Σ weight²."""
        squares = 0.0
        for m in range(self.count):
            squares += self.weight[n, m] ** 2
        return 1.0 / ti.max(squares, LEAST)

    @ti.func
    def _resample(self, n, tick):
        """Resample robot n's particles systematically, then add noise in proportion to their extent."""
        u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 0)
        low, high = ti.Vector(self.floor[1]), ti.Vector(self.floor[0])
        taken, total = 0, self.weight[n, 0]
        for m in range(self.count):
            mark = (m + u[0]) / self.count
            while total < mark and taken < self.count - 1:
                taken += 1
                total += self.weight[n, taken]
            self.spare[n, m] = self.particle[n, taken]
            low, high = ti.min(low, self.spare[n, m]), ti.max(high, self.spare[n, m])
        for m in range(self.count):
            g = normal4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, -1 - m)
            moved = self.spare[n, m] + self.p.roughening[n] * (high - low) * ti.Vector([g[0], g[1]])
            moved = ti.math.clamp(moved, ti.Vector(self.floor[0]), ti.Vector(self.floor[1]))
            if ti.static(not self.is_uniform):
                if self._relative_prior(moved) == 0.0:
                    moved = self.spare[n, m]
            self.particle[n, m] = moved
            self.weight[n, m] = 1.0 / self.count

    @ti.func
    def _forget(self, n):
        """Discard robot n's particles; the filter restarts at the next detection."""
        self.known[n], self.visited[n], self.doubts[n] = 0, 0, 0
        self.mean[n], self.spread[n] = ti.Vector([ti.math.nan, ti.math.nan]), ti.math.nan
        if self.swarm.state[self.robot[n]] == GO:
            self._trace(n)
        self.estimated[n] = 0

    @ti.func
    def _trace(self, n):
        """Let robot n trace the plume from its position again; its list of estimates is cleared."""
        self.estimated[n] = 0
        self.cast[n], self.failed[n] = self.p.cast_distance[n], 0
        self._enter(n, ti.select(self.smelt[n] == 1, IN_PLUME, LOST))

    @ti.func
    def _has_converged(self, n):
        """Return whether robot n's last estimates, and its particles, lie within `converged` of their means."""
        mean, square = ti.Vector([0.0, 0.0]), 0.0
        for k in range(self.kept):
            mean += self.estimate[n, k] / self.kept
        for k in range(self.kept):
            apart = self.estimate[n, k] - mean
            square += apart.dot(apart) / self.kept  # type: ignore
        near = square <= self.p.converged[n] ** 2 and self.spread[n] <= self.p.converged[n]
        return self.known[n] == 1 and self.estimated[n] >= self.kept and near

    @ti.kernel
    def _drive(self, t: float, dt: float):
        """Command all robots for dt [s]: trace the plume, or go to a converged estimate and declare there."""
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            i = self.robot[n]
            if not self.swarm.searches(i):
                continue
            if self.swarm.state[i] != GO and self._has_converged(n):
                self._enter(n, GO)
                self.potential.set_out(n)
            if self.swarm.state[i] == GO:
                goal = self.potential.clear(n, self.mean[n])
                if self.potential.is_over(n, goal, NEAR):
                    if self.visited[n] == 1 and (self.mean[n] - self.visit[n]).norm() <= self.p.converged[n]:
                        self.declaring.consider(n, self.mean[n], self.spread[n], t)
                    self.visit[n], self.visited[n] = self.mean[n], 1
                    self._trace(n)
                elif self.spread[n] > APART * self.p.converged[n]:
                    self._trace(n)
                else:
                    self.potential.drive(n, goal, dt)
            if self.swarm.state[i] != GO:
                self._steer(n, dt)
