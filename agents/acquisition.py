"""Acquisitions: series of gas readings that a robot samples while it stands still."""

from typing import cast

import numpy as np

from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.engine import ti
from taichi_plume.scenario.search_algorithm import Listening


def ticks_between(model: Listening, tick: float) -> int:
    """Return the number of control periods between two samples; tick: control period [s]."""
    return max(1, round(model.sample_period / tick))


MEAN = Decision("mean_ppm", "ppm", "mean reading of the last acquisition", "acquisition.last")
"""Decision quantity of algorithms that decide by the mean of their `acquisition`."""


class Acquisition:
    """Series of gas samples that robots take while standing still; read `mean` once an acquisition is complete.

    parameters: must include the entries of `Acquisition.numbers`. With the key `lag: deconvolved` the samples are the
    gas at the sensor, not its lagging readings: by first-order lag the signal of the gas is y + T dy/dt, y the signal,
    which for metal oxides is the logarithm of the resistance, and T the time constant of its rise or decay.
    """

    STATE: tuple[str, ...] = ("since", "total", "last", "before")

    def __init__(self, members: Members, parameters: Parameters):
        self.swarm, self.robot, self.p = members.swarm, members.robot, parameters
        self.since = ti.field(ti.i32, members.size)  # ticks since standing still
        self.total = ti.field(ti.f32, members.size)  # sum of the samples so far [ppm]
        self.before = ti.field(
            ti.f32, members.size
        )  # reading of the sample before, or as the samples begin [ppm]
        self.last = ti.filled(np.full(members.size, np.nan), ti.f32)  # mean of the last acquisition [ppm]

    @staticmethod
    def numbers(group: GroupRange, tick: float, least: int = 1) -> Numbers:
        """Return kernel parameters of acquisitions; tick: control period [s]; least: smallest number of samples."""
        model = cast(Listening, group.model.algorithm)
        between = ticks_between(model, tick)
        samples = max(least, round(model.acquisition / (between * tick)))
        nose = group.model.sensors.noses[0]
        known = model.lag == "deconvolved"
        return {
            "rise_gain": known * nose.signal.rise / (between * tick),
            "decay_gain": known * nose.signal.decay / (between * tick),
            "bend": nose.bends_at,  # ppm
            "settle": max(0, round(model.settle / tick)),  # ticks
            "between": between,
            "samples": samples,
            "share": float(np.float32(1) / np.float32(samples)),  # weight of a sample in the mean
        }

    @ti.func
    def listen(self, n):
        """Advance robot n's acquisition by a control period of standing; return whether the acquisition is complete."""
        i = self.robot[n]
        if self.since[n] == 0:
            self.total[n] = 0.0
        if self.since[n] == self.p.settle[n]:
            self.before[n] = self.swarm.reading[i]
        self.since[n] += 1
        listened = self.since[n] - self.p.settle[n]
        if listened > 0 and listened % self.p.between[n] == 0:
            self._hear(n, listened // self.p.between[n] - 1, self._gas(n, self.swarm.reading[i]))
            self.before[n] = self.swarm.reading[i]
        over = listened >= self.p.samples[n] * self.p.between[n]
        if over:
            self.since[n] = 0
            self.last[n] = self.mean(n)
            self.swarm.acquisitions[i] += ti.cast(self.swarm.searches(i), ti.i32)
        return over

    @ti.func
    def _hear(self, n, k, ppm):
        """Add the reading `ppm` of robot n as sample k, from 0 on, to the acquisition."""
        self.total[n] += ppm

    @ti.func
    def mean(self, n):
        """Return the mean of the samples of robot n's last acquisition [ppm]."""
        return self.total[n] * self.p.share[n]

    @ti.func
    def _gas(self, n, reading):
        """Return the gas [ppm] at the sensor of robot n whose reading [ppm] this is, or the reading itself."""
        gas, before = reading, self.before[n]
        gain = ti.select(reading > before, self.p.rise_gain[n], self.p.decay_gain[n])
        if gain > 0.0:
            scale = self.p.bend[n]
            if scale > 0.0:
                y = ti.log(1.0 + reading / scale)
                gas = scale * (ti.exp(y + gain * (y - ti.log(1.0 + before / scale))) - 1.0)
            else:
                gas = reading + gain * (reading - before)
            gas = ti.max(gas, 0.0)
        return gas


class Recording(Acquisition):
    """Acquisitions that keep every sample: `heard[n, k]` [ppm] is sample k of robot n."""

    STATE = (*Acquisition.STATE, "heard")

    def __init__(self, members: Members, parameters: Parameters):
        super().__init__(members, parameters)
        self.heard = ti.field(ti.f32, (members.size, int(parameters.largest("samples"))))

    @ti.func
    def _hear(self, n, k, ppm):
        self.total[n] += ppm
        self.heard[n, k] = ppm


class Counting(Acquisition):
    """Acquisitions that count the samples at the threshold or above: `above[n]`. parameters: have a `threshold`."""

    STATE = (*Acquisition.STATE, "above")

    def __init__(self, members: Members, parameters: Parameters):
        super().__init__(members, parameters)
        self.above = ti.field(ti.i32, members.size)

    @ti.func
    def _hear(self, n, k, ppm):
        self.total[n] += ppm
        self.above[n] = ti.select(k == 0, 0, self.above[n]) + ti.cast(ppm >= self.p.threshold[n], ti.i32)
