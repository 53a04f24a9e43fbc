"""Trials that each restart on their own, each with its own clock, seed and sources: episodes of environments.

In an ordinary run all trials share the clock, the seed and the scenario's sources, and this module is unused.
"""

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.rng import philox

FAR = 1e6  # m, position of the sources that a trial lacks
EPISODE = 0x45504953  # separates the draws for an episode from the draws in it


class Trials:
    """Clocks, seeds and sources of `count` trials that restart independently, each with `team` consecutive robots.

    age: ticks of `tick` [s] since the start of the episode. goes: whether the trial takes part in this time step; other
    robots neither move nor sense. seed: two words of the trial; its episodes follow from them, numbered by `episode`.
    key, salt: key and offset of the episode's random streams. side: -1 where the world is mirrored, else 1. sources:
    positions [m], of drones in space.
    """

    STATE = ("age", "goes", "seed", "episode", "key", "salt", "sources", "side")

    def __init__(self, count: int, team: int, sources: int, tick: float, dim: int = 2):
        self.count, self.team, self.most_sources = count, team, max(1, sources)
        self.age, self.goes, self.episode = (ti.field(ti.i32, count) for _ in range(3))
        self.seed = ti.vector_field(2, ti.u32, count)
        self.key, self.salt = ti.field(ti.u32, count), ti.field(ti.u32, count)
        self.sources = ti.filled_vectors(np.full((count, self.most_sources, dim), FAR))
        self.tick, self.side = tick, ti.field(ti.f32, count)

    @ti.func
    def of(self, i):
        """Return the index of the trial of robot i."""
        return i if ti.static(self.team == 1) else i // self.team

    @ti.func
    def mate(self, i):
        """Return the index of robot i within its team."""
        return 0 if ti.static(self.team == 1) else i % self.team

    @ti.func
    def draw(self, e, episode, index, draw):
        """Return four random words for an episode of trial e; index, draw: counters of `rng.philox`."""
        seed = self.seed[e]
        return philox(seed[0], seed[1] ^ ti.u32(EPISODE), episode, index, draw)

    @ti.func
    def renew(self, e):
        """Start the next episode of trial e: reset its age, and draw the key of its random streams."""
        self.age[e] = 0
        words = self.draw(e, self.episode[e], 0, 0)
        self.key[e], self.salt[e] = words[0], words[1]

    @ti.func
    def counter(self, i):
        """Return the key of robot i's random streams, and the robot number and tick that count random numbers."""
        e = self.of(i)
        return self.key[e], ti.cast(self.salt[e], ti.i32) ^ self.mate(i), self.age[e]


class OwnClocks:
    """Mixin of the swarm for clocks and random counters, per trial if trials restart on their own (`apart`)."""

    @ti.func
    def counter(self, i, number, tick):
        """Return the key of robot i's random streams, and the robot number and tick that count random numbers.

        number: index of the robot among all possible trials, used unless each trial restarts on its own.
        """
        key, counted, now = self.key[None], number, tick
        if ti.static(self.apart):
            key, counted, now = self.episodes.counter(i)
        return key, counted, now

    @ti.func
    def takes_part(self, i):
        """Return whether the trial of robot i takes part in this time step; other robots neither move nor sense."""
        result = True
        if ti.static(self.apart):
            result = self.episodes.goes[self.episodes.of(i)] == 1
        return result

    @ti.func
    def clock(self, i, tick, t):
        """Return the time step's index and the time [s] in robot i's trial, which may restart; tick, t: of the run."""
        now, at = tick, t
        if ti.static(self.apart):
            now = self.episodes.age[self.episodes.of(i)]
            at = now * self.episodes.tick
        return now, at
