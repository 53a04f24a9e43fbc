"""Acquisitions: what robots hear that stand still, as a series of samples."""

import numpy as np
import taichi as ti

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.scenario.listening import Listening


def ticks_between(model: Listening, tick: float) -> int:
    """From sample to sample; tick: control period [s]."""
    return max(1, round(model.sample_period / tick))


@ti.data_oriented
class Acquisition:
    """The acquisitions of robots: `listen` in each tick of standing still, until one is over, then take its `mean`.

    parameters: with the `numbers` of acquisitions.
    """

    STATE: tuple[str, ...] = ("since", "total")

    def __init__(self, members: Members, parameters: Parameters):
        self.swarm, self.robot, self.p = members.swarm, members.robot, parameters
        self.since = ti.field(ti.i32, members.size)  # ticks since standing still
        self.total = ti.field(ti.f32, members.size)  # of the samples so far [ppm]

    @staticmethod
    def numbers(model: Listening, tick: float, least: int = 1) -> Numbers:
        """tick: control period [s]; least: number of samples."""
        between = ticks_between(model, tick)
        samples = max(least, round(model.acquisition / (between * tick)))
        return {
            "settle": max(0, round(model.settle / tick)),  # ticks
            "between": between,
            "samples": samples,
            "share": float(np.float32(1) / np.float32(samples)),  # of a sample in the mean
        }

    @ti.func
    def listen(self, n):
        """The n-th robot listens for a tick; returns whether its acquisition is over."""
        i = self.robot[n]
        if self.since[n] == 0:
            self.total[n] = 0.0
        self.since[n] += 1
        listened = self.since[n] - self.p.settle[n]
        if listened > 0 and listened % self.p.between[n] == 0:
            self._hear(n, listened // self.p.between[n] - 1, self.swarm.reading[i])
        over = listened >= self.p.samples[n] * self.p.between[n]
        if over:
            self.since[n] = 0
            self.swarm.acquisitions[i] += ti.cast(self.swarm.searches(i), ti.i32)
        return over

    @ti.func
    def _hear(self, n, k, ppm):
        """Take in sample k, from 0 on."""
        self.total[n] += ppm

    @ti.func
    def mean(self, n):
        """Of what the n-th robot heard [ppm]."""
        return self.total[n] * self.p.share[n]


@ti.data_oriented
class Recording(Acquisition):
    """Acquisitions of which every sample is kept: `heard[n, k]` [ppm]; how many there are decides its shape."""

    STATE = (*Acquisition.STATE, "heard")

    def __init__(self, members: Members, parameters: Parameters):
        super().__init__(members, parameters)
        self.heard = ti.field(ti.f32, (members.size, int(parameters.largest("samples"))))

    @ti.func
    def _hear(self, n, k, ppm):
        self.total[n] += ppm
        self.heard[n, k] = ppm
