"""Trials that begin anew on their own: a clock, a seed and sources of each, for the episodes of environments.

In an ordinary run all trials have one clock, one seed and the scenario's sources; there is nothing of this then.
"""

from typing import Any

import taichi as ti

from taichi_plume.grid.rng import philox
from taichi_plume.grid.transfer import uploader

FAR = 1e6  # m, where the places of sources lie that a trial has not
EPISODE = 0x45504953  # counts what is drawn for an episode apart from what is drawn in it


@ti.data_oriented
class Trials:
    """Of `count` trials, each of `team` robots that lie one after the other, with up to `sources` sources; tick: [s].

    age: ticks since a trial began. goes: whether it goes on in this tick; those that rest neither move nor sense. seed:
    two words each, of the whole trial; its episodes follow from it, by their `episode`, from 0 on. key, salt: what the
    streams of an episode are keyed by and counted from. side: -1 where the world is seen in a mirror, else 1.
    """

    STATE = ("age", "goes", "seed", "episode", "key", "salt", "sources", "side")

    def __init__(self, count: int, team: int, sources: int, tick: float):
        self.count, self.team, self.most_sources = count, team, max(1, sources)
        self.age, self.goes, self.episode = (ti.field(ti.i32, count) for _ in range(3))
        self.seed: Any = ti.Vector.field(2, ti.u32, count)
        self.key, self.salt = ti.field(ti.u32, count), ti.field(ti.u32, count)
        self.sources: Any = ti.Vector.field(2, ti.f32, (count, self.most_sources))
        self.tick, self.side = ti.field(ti.f32, ()), ti.field(ti.f32, count)
        uploader(self.sources, self.tick)(FAR, tick)

    @ti.func
    def of(self, i):
        """The trial of robot i."""
        return i if ti.static(self.team == 1) else i // self.team

    @ti.func
    def mate(self, i):
        """Number of robot i in its team."""
        return 0 if ti.static(self.team == 1) else i % self.team

    @ti.func
    def draw(self, e, episode, index, draw):
        """Four random words of an episode of trial e; see `rng.philox`."""
        seed = self.seed[e]
        return philox(seed[0], seed[1] ^ ti.u32(EPISODE), episode, index, draw)

    @ti.func
    def renew(self, e):
        """Begin the next episode of trial e."""
        self.age[e] = 0
        words = self.draw(e, self.episode[e], 0, 0)
        self.key[e], self.salt[e] = words[0], words[1]

    @ti.func
    def counter(self, i):
        """What the streams of robot i are keyed by, and its number and tick, by which they are counted."""
        e = self.of(i)
        return self.key[e], ti.cast(self.salt[e], ti.i32) ^ self.mate(i), self.age[e]


class OwnClocks:
    """What a swarm knows of its trials where each begins anew on its own, `episodes`: then it is `apart`."""

    key: Any
    episodes: Any
    apart: bool

    @ti.func
    def counter(self, i, number, tick):
        """Key of the random streams of robot i, and what they are counted by: its number (unless trials begin on their
        own, that among all trials there could be) and the tick.
        """
        key, counted, now = self.key[None], number, tick
        if ti.static(self.apart):
            key, counted, now = self.episodes.counter(i)
        return key, counted, now

    @ti.func
    def takes_part(self, i):
        """Whether the trial of robot i goes on."""
        result = True
        if ti.static(self.apart):
            result = self.episodes.goes[self.episodes.of(i)] == 1
        return result

    @ti.func
    def clock(self, i, tick, t):
        """Tick and time [s] of the trial of robot i, where `tick` and `t` are those of a run."""
        now, at = tick, t
        if ti.static(self.apart):
            now = self.episodes.age[self.episodes.of(i)]
            at = now * self.episodes.tick[None]
        return now, at
