"""Environment step as one Taichi kernel: reset, motion, sensors, reward and observation of all environments.

Environments are independent: each thread advances a strip of environments through all ticks of a decision.
"""

from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.trials import FAR
from taichi_plume.engine import ti
from taichi_plume.engine.fields import on_cpu
from taichi_plume.grid.kernels import Template, long_kernel
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.starts import GAP, StartArea
from taichi_plume.solvers.film_bank import FilmBank

if TYPE_CHECKING:
    from taichi_plume.envs.bank import Bank
    from taichi_plume.envs.episodes import Array, Episodes

REST, KEEP, STEP, BEGIN, BEGIN_AGAIN, FIRST = range(6)
"""Tasks of an environment: none; none, observations already valid; a step; begin the next episode; begin the next
episode and keep the outcome of the last one; begin the first episode of a seed."""

INFO = ("found", "time_s", "path_m", "distance_m", "episode_number", "film", "source", "mirror", "return")
"""State of an episode: whether a robot has found a source; time until then, else now [s]; total path length [m];
smallest distance of a robot from a source [m]; number of the episode among those of the seed; film; number of the gas,
-1 for all; whether the world is mirrored; sum of the rewards, mean over the robots."""

TRIES = 64  # positions drawn for a robot before the team starts at a fallback
WORLD, PLACE, LOOK, UNIT = 1, 2, 3, 4  # random numbers of an episode: world, position, heading, sensor unit


class Starts:
    """Start positions in episodes: random in an area, or those of teams in `fallback` (teams, robots, 2) [m]."""

    def __init__(self, group: Group, fallback: np.ndarray):
        self.fallback = fallback
        start = group.start
        self.drawn = isinstance(start, StartArea)
        low, high = (start.low, start.high) if isinstance(start, StartArea) else ((0.0, 0.0), (0.0, 0.0))
        looks = start.heading_deg
        self.rises = group.start_highest > group.start_altitude
        self.numbers = {
            "low_x": low[0],
            "low_y": low[1],
            "wide_x": high[0] - low[0],
            "wide_y": high[1] - low[1],
            "looks": 0.0 if looks is None else np.radians(looks),
            "turns": 2.0 * np.pi if looks is None else 0.0,
            "lowest": group.start_altitude,
            "rise": group.start_highest - group.start_altitude,
        }


class StepKernel:
    """Kernel that advances all environments of `Episodes`. films: FilmBank of `bank`; ticks: number per decision."""

    STATE = ("trials", "films", "mirror", "steps", "total", "counted")

    def __init__(self, of: "Episodes", films: FilmBank, bank: "Bank", starts: Starts, ticks: int):
        self.swarm, self.sensors, self.films = of.swarm, of.sensors, films
        self.observation, self.commands = of.observation, of.commands
        self.nose, self.vane = of.sensors.noses[0], of.sensors.vanes[0]
        self.trials = of.swarm.episodes
        self.count, self.robots, self.drawn = of.count, of.robots, starts.drawn
        self.dim, self.rises = films.dim, starts.rises
        self.strip, self.teams = of.sensors.strip, len(starts.fallback)
        self.ticks, self.dt, self.begun = ticks, of.scenario.tick, False
        self.mirror, self.steps = ti.field(ti.i32, of.count), ti.field(ti.i32, of.count)
        self.total = ti.field(ti.f32, of.count)
        # of each robot at the last reward: path length, bumps, false declarations, distance from the nearest source
        self.counted = ti.vector_field(4, ti.f32, of.count * of.robots)
        self.fallback = ti.filled_vectors(starts.fallback, ti.f32)
        task = of.scenario.task
        rewards = {f"for_{name}": value for name, value in task.reward.model_dump().items()}
        numbers = {
            **starts.numbers,
            **rewards,
            "step": of.step_s,
            "most": of.most_steps,
            "slack": max(0.0, bank.length - (of.most_steps * ticks + 1) * self.dt),
            "mirrors": 0.5 if task.mirror else 0.0,
            "units": float(task.units),
        }
        self.n = SimpleNamespace(**{name: ti.filled(float(value)) for name, value in numbers.items()})
        self._list_sources(bank, task.sources == "one")

    def _list_sources(self, bank: "Bank", single: bool) -> None:
        """Fill place[film, s] [m] and gas[film, s] of the sources, and `choice`, the gases that an episode may have."""
        most = self.trials.most_sources
        places, of_gas = np.full((bank.films, most, self.dim), FAR), np.full((bank.films, most), -2)
        for f, film in enumerate(bank.sources):
            counts = [len(sources) for sources in film]
            if any(counts):
                places[f, : sum(counts)] = np.concatenate(film)
                of_gas[f, : sum(counts)] = np.repeat(np.arange(len(film)), counts)
        choices = np.unique(of_gas[of_gas >= 0]) if single and (of_gas >= 0).any() else np.array([-1])
        self.choices = len(choices)
        self.place = ti.filled_vectors(places)
        self.gas, self.choice = ti.filled(of_gas), ti.filled(choices)

    def sow(self, seeds: np.ndarray) -> None:
        """Set the 64-bit seed of each environment."""
        low = (seeds & np.uint64(0xFFFFFFFF)).astype(np.uint32)
        self.trials.seed.from_numpy(np.stack([low, (seeds >> np.uint64(32)).astype(np.uint32)], axis=1))

    def run(self, side: int, flags: "Array", actions: "Array", table: "Array", outcomes: "Array") -> None:
        """Execute the tasks flags[0] of all environments. side: half of `table` to which observations are written."""
        self._run(side, self.ticks, self.dt, flags, actions, table, outcomes)
        self.begun = True
        if not on_cpu():  # torch uses another CUDA stream
            ti.sync()

    @long_kernel
    def _run(
        self,
        side: int,
        ticks: int,
        dt: float,
        flags: ti.types.ndarray(dtype=ti.u8, ndim=2),
        actions: ti.types.ndarray(dtype=ti.f32, ndim=2),
        table: ti.types.ndarray(dtype=ti.f32, ndim=2),
        outcomes: ti.types.ndarray(dtype=ti.f32, ndim=1),
    ):
        ti.loop_config(serialize=ti.static(runs_serially(4 * self.count * self.robots)))
        for e in range(self.count):  # a thread gets at least 512 iterations, hence several strips
            if e % self.strip == 0:
                end = ti.min(e + self.strip, self.count)
                for k in range(e, end):
                    self._set_out(k, side, flags, actions, table)
                for s in range(ticks):
                    self._tick(e, end, s, dt, flags)
                for k in range(e, end):
                    self._come_in(k, side, flags, table, outcomes)

    @ti.func
    def _set_out(self, e, side, flags: Template, actions: Template, table: Template):
        """Execute the first part of environment e's task: begin an episode, or take the robots' actions."""
        what = ti.cast(flags[0, e], ti.i32)
        if what >= BEGIN:
            if what == BEGIN_AGAIN:
                n = self.count * self.robots
                for i in range(e * self.robots, (e + 1) * self.robots):
                    for k in range(self.observation.size):
                        table[2 * n + i, k] = table[side * n + i, k]
            self._begin(e, what == FIRST)
        elif what == STEP:
            t = self.trials.age[e] * self.trials.tick
            for i in range(e * self.robots, (e + 1) * self.robots):
                self.commands.take(i, self._flip(e), i, actions, t)
                self.observation.remember(i, i, actions)

    @ti.func
    def _flip(self, e):
        """Return -1 if environment e is mirrored, else 1."""
        return 1.0 - 2.0 * self.mirror[e]

    @ti.func
    def _tick(self, first, end, s, dt, flags: Template):
        """Advance environments first, ..., end - 1 by tick s of a decision; new episodes only sense, in one tick."""
        going = 0
        for e in range(first, end):
            what = ti.cast(flags[0, e], ti.i32)
            goes = ti.cast(what == STEP or (what >= BEGIN and s == 0), ti.i32)
            self.trials.goes[e] = goes
            if goes == 1:
                going = 1
                self.trials.age[e] = self.trials.age[e] + 1
                t = self.trials.age[e] * dt
                self.films.now[e] = t
                for i in range(e * self.robots, (e + 1) * self.robots):
                    if what == STEP:
                        self.commands.carry_out(i, dt)
                    self.swarm.go(i, e, 0, t, dt)
        if going == 1:
            for q in range(self.robots):
                self.sensors.sense_strip(
                    self.nose,
                    self.vane,
                    self.films,
                    self.films,
                    first * self.robots + q * self.strip,
                    0,
                    0.0,
                    0.0,
                )
                for nose in ti.static(self.sensors.others):
                    self.sensors.sense_strip(
                        nose, None, self.films, self.films, first * self.robots + q * self.strip, 0, 0.0, 0.0
                    )
            for e in range(first, end):
                if self.trials.goes[e] == 1:
                    for i in range(e * self.robots, (e + 1) * self.robots):
                        self.observation.follow(i, dt)
                        self.observation.send(i, 0)
                    for i in range(e * self.robots, (e + 1) * self.robots):
                        self.observation.receive(i, 0, 0.0)

    @ti.func
    def _come_in(self, e, side, flags: Template, table: Template, outcomes: Template):
        """Execute the last part of environment e's task: write the robots' rewards and observations."""
        what = ti.cast(flags[0, e], ti.i32)
        n = self.count * self.robots
        if what == FIRST or (what >= STEP and what <= BEGIN):
            self._reward(e, what, flags, outcomes)
        for i in range(e * self.robots, (e + 1) * self.robots):
            if what == REST:  # copy the last observation
                for k in range(self.observation.size):
                    table[side * n + i, k] = table[(1 - side) * n + i, k]
            elif what != KEEP:
                elapsed = self.steps[e] * self.n.step[None]
                self.observation.write(i, self._flip(e), side * n + i, table, elapsed)

    @ti.func
    def _reward(self, e, what, flags: Template, outcomes: Template):
        """Compute rewards, end flags and info of environment e after a step or at the start of an episode."""
        found, searching, way, near = 0, 0, 0.0, FAR
        # the first tick of an episode, in which robots stand still, does not count
        time = ti.min(self.trials.age[e] * self.trials.tick, self.n.most[None] * self.n.step[None])
        for i in range(e * self.robots, (e + 1) * self.robots):
            searching = ti.max(searching, ti.cast(self.swarm.searches(i), ti.i32))
            if self.swarm.found[i] == 1:
                found = 1
                time = ti.min(time, self.swarm.found_time[i])
        total = 0.0
        for i in range(e * self.robots, (e + 1) * self.robots):
            before = self.counted[i]
            now = self._count(i)
            way += now[0]
            near = ti.min(near, now[3])
            reward = 0.0
            if what == STEP:
                change = now - before
                gas = self.n.for_gas[None] * self.observation.gas(i)
                reward = self.n.step[None] * (self.n.for_time[None] + gas)
                reward += self.n.for_path[None] * change[0] + self.n.for_bump[None] * change[1]
                reward += (
                    self.n.for_false_declaration[None] * change[2] - self.n.for_progress[None] * change[3]
                )
                reward += self.n.for_found[None] * found
            self.counted[i] = now
            outcomes[i] = reward
            total += reward
        if what == STEP:
            self.steps[e] = self.steps[e] + 1
        ends = what == STEP and (found == 1 or searching == 0)
        late = what == STEP and not ends and self.steps[e] >= ti.cast(self.n.most[None], ti.i32)
        flags[1, e], flags[2, e] = ti.cast(ends, ti.u8), ti.cast(late, ti.u8)
        self.total[e] = self.total[e] + total / self.robots
        info = ti.Vector(
            [
                ti.cast(found, ti.f32),
                time,
                way,
                near,
                ti.cast(self.trials.episode[e], ti.f32),
                ti.cast(self.films.film[e], ti.f32),
                ti.cast(self.films.gas_of[e], ti.f32),
                ti.cast(self.mirror[e], ti.f32),
                self.total[e],
            ]
        )
        for k in ti.static(range(len(INFO))):
            outcomes[self.count * (self.robots + k) + e] = info[k]

    @ti.func
    def _count(self, i):
        """Return the quantities of robot i whose changes are rewarded: path length [m], bumps, false declarations, and
        distance from the nearest source [m].
        """
        near = FAR
        for s in range(self.swarm.source_count):
            apart = (self.swarm.position[i] - self.swarm.source(i, s)).norm()
            if ti.static(self.dim == 3):
                above = self.swarm.middle_over(i, s)
                apart = ti.sqrt(apart * apart + above * above)
            near = ti.min(near, apart)
        bumps, false = self.swarm.bumps[i], self.swarm.false_declarations[i]
        return ti.Vector([self.swarm.path_length[i], ti.cast(bumps, ti.f32), ti.cast(false, ti.f32), near])

    @ti.func
    def _uniform(self, e, index, draw):
        """Return four random numbers, uniform in (0, 1), of environment e's present episode; index, draw: counters."""
        return _uniform(self.trials.draw(e, self.trials.episode[e], index, draw))

    @ti.func
    def _begin(self, e, first):
        """Begin the next episode of environment e, or with `first` the first episode of its seed."""
        self.trials.episode[e] = 0 if first else self.trials.episode[e] + 1
        self.trials.renew(e)
        u = self._uniform(e, WORLD, 0)
        film = _part(u[0], self.films.films)
        gas = self.choice[_part(u[1], self.choices)]
        self.films.film[e], self.films.gas_of[e] = film, gas
        self.films.begin[e], self.films.now[e] = u[2] * self.n.slack[None], 0.0
        self.mirror[e] = ti.cast(u[3] < self.n.mirrors[None], ti.i32)
        self.trials.side[e] = self._flip(e)
        self.steps[e], self.total[e] = 0, 0.0
        for s in range(self.swarm.source_count):
            there = gas < 0 or self.gas[film, s] == gas
            self.trials.sources[e, s] = ti.select(there, self.place[film, s], ti.Vector([FAR] * self.dim))
        self._put(e)
        for i in range(e * self.robots, (e + 1) * self.robots):
            v = self._uniform(e, LOOK, i - e * self.robots)
            heading = self.n.looks[None] + (v[0] - 0.5) * self.n.turns[None]
            self.swarm.renew(i, self.swarm.position[i], heading)
            if ti.static(self.rises):
                self.swarm.altitude[i] = self.n.lowest[None] + v[1] * self.n.rise[None]
            # unless each episode has its own sensor units, those of the first episode
            episode = self.trials.episode[e] * ti.cast(self.n.units[None], ti.i32)
            self.sensors.renew(i, _uniform(self.trials.draw(e, episode, UNIT, i - e * self.robots))[0])
            self.observation.clear(i)
            self.commands.clear(i)
            self.counted[i] = self._count(i)

    @ti.func
    def _put(self, e):
        """Set the robots' start positions in environment e. Random positions obey the rules of `placement.place`."""
        start = e * self.robots
        full = 0 if ti.static(self.drawn) else 1
        if ti.static(self.drawn):
            low = ti.Vector([self.n.low_x[None], self.n.low_y[None]])
            wide = ti.Vector([self.n.wide_x[None], self.n.wide_y[None]])
            for r in range(self.robots):
                radius = self.swarm.radius[start + r]
                fits, tried = 0, 0
                while fits == 0 and tried < TRIES:
                    u = self._uniform(e, PLACE, r * TRIES + tried)
                    tried += 1
                    p = low + wide * ti.Vector([u[0], u[1]])
                    fits = ti.cast(self.swarm.clearance.distance(p) >= radius + GAP, ti.i32)
                    for m in range(r):
                        apart = (p - self.swarm.position[start + m]).norm()
                        if apart < radius + self.swarm.radius[start + m] + GAP:
                            fits = 0
                    self.swarm.position[start + r] = p
                if fits == 0:
                    full = 1
        if full == 1:
            row = _part(self._uniform(e, PLACE, -1)[0], self.teams)
            for r in range(self.robots):
                self.swarm.position[start + r] = self.fallback[row, r]


@ti.func
def _uniform(words):
    """Convert random 32-bit words to numbers uniform in (0, 1)."""
    return (ti.cast(words >> ti.u32(8), ti.f32) + 0.5) * (1.0 / 16777216.0)


@ti.func
def _part(u, parts):
    """Return the index of the part, of `parts` equal parts of (0, 1), that contains u."""
    return ti.min(ti.cast(u * parts, ti.i32), parts - 1)
