"""Acquisitions: what robots hear that stand still, as a series of samples."""

import taichi as ti

from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.scenario.listening import Listening


@ti.data_oriented
class Acquisition:
    """The acquisitions of a group's robots: `listen` in each tick of standing still, until one is over.

    tick: control period [s]; least: number of samples.
    """

    def __init__(self, swarm: Swarm, group: GroupRange, model: Listening, tick: float, least: int = 1):
        self.swarm, self.start = swarm, group.start
        self.settle = max(0, round(model.settle / tick))  # ticks
        self.between = max(1, round(model.sample_period / tick))  # ticks from sample to sample
        self.samples = max(least, round(model.acquisition / (self.between * tick)))
        self.ticks = self.settle + self.samples * self.between
        self.since = ti.field(ti.i32, group.size)  # ticks since standing still
        self.heard = ti.field(ti.f32, (group.size, self.samples))  # ppm

    @ti.func
    def listen(self, n):
        """Robot n of the group listens for a tick; returns whether its acquisition is over."""
        i = self.start + n
        self.since[n] += 1
        listened = self.since[n] - self.settle
        if listened > 0 and listened % self.between == 0:
            self.heard[n, listened // self.between - 1] = self.swarm.reading[i]
        over = self.since[n] >= self.ticks
        if over:
            self.since[n] = 0
            self.swarm.acquisitions[i] += 1
        return over

    @ti.func
    def mean(self, n):
        """Of what robot n heard [ppm]."""
        total = 0.0
        for k in range(self.samples):
            total += self.heard[n, k]
        return total / self.samples
