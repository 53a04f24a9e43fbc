"""Metal oxide gas sensors with a pulsed heater: a square wave between two temperatures, for fast readings.

The film reacts at a rate that grows with its temperature. The signal y follows its goal (sensor lag) by

    dy/dt = (y* - y) k(t)/tau,      k = k_hot in the first part of a cycle, k_cold = slowness k_hot in the rest,

with k of mean 1, so that tau is the time constant over whole cycles. While the goal is constant, y is solved exactly:
y approaches the goal by exp(-H/tau) with H the integral of k, for time steps and cycles of any length. The reading is y
at the end of the last hot part.
"""

from collections.abc import Sequence
from functools import partial
from typing import cast

from taichi_plume.agents.gas_laws import Law
from taichi_plume.agents.gas_sensors import GasSensors
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.engine import ti
from taichi_plume.grid.elementary import exp
from taichi_plume.grid.fields import Species
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.metal_oxides import MoxSensor

PARTS = 65536  # parts of a cycle in which ticks are counted: exact in 32 bits for any count
FASTEST = 1e-6  # s, smallest time constant


class HeatedSensors(GasSensors):
    """Metal-oxide gas sensors with heater cycles, of several groups; arguments as for `GasSensors`."""

    def __init__(
        self,
        members: Members,
        law: type[Law],
        dim: int,
        tick: float,
        species: Sequence[Species],
        slot: int = 0,
        fluctuates: bool = False,
        background: Sequence[float] = (),
    ):
        super().__init__(members, law, dim, tick, species, slot, fluctuates, background)
        self.STATE = (*self.STATE, "held", "slow_held")
        self.cycle = Parameters(members, partial(_cycle, tick, slot))
        self.held = ti.field(ti.f32, members.size)  # y at the end of the last hot part
        self.slow_held = ti.field(ti.f32, members.size)

    @ti.func
    def renew(self, n, unit):
        self.held[n], self.slow_held[n] = 0.0, 0.0
        GasSensors.renew(self, n, unit)

    @ti.func
    def settle(self, n):
        y = self.law.response(n, self.clean(n))
        self.signal[n], self.slow[n], self.held[n], self.slow_held[n] = y, y, y, y

    @ti.func
    def phase(self, n, tick):
        """Return the phase (0 to 1) of the heater cycle of sensor n after `tick` control periods."""
        parts = (tick * self.cycle.parts[n]) & (PARTS - 1)
        rest = tick * self.cycle.rest[n]
        at = ti.cast(parts, ti.f32) / PARTS + rest - ti.floor(rest)
        return at - ti.floor(at)

    @ti.func
    def reacted(self, n, q):
        """Return the integral of the relative reaction rate k over the first q heater cycles of sensor n [s]."""
        whole = ti.floor(q)
        hot, part = self.cycle.hot_share[n], q - whole
        return self.cycle.period[n] * (
            whole + self.cycle.k_hot[n] * ti.min(part, hot) + self.cycle.k_cold[n] * ti.max(part - hot, 0.0)
        )

    @ti.func
    def _go(self, signal: Template, held: Template, n, tick, goal, per_decay):
        """Advance sensor n's signal by a time step of lag; return the signal at the end of the last hot part."""
        begin = self.phase(n, tick - 1)
        end = begin + self.cycle.turn[n]
        per = ti.select(goal > signal[n], self.cycle.per_rise[n], per_decay)
        way, before = signal[n] - goal, self.reacted(n, begin)
        hot = ti.floor(end - self.cycle.hot_share[n]) + self.cycle.hot_share[n]
        if hot > begin:
            held[n] = goal + way * exp(-(self.reacted(n, hot) - before) * per)
        signal[n] = goal + way * exp(-(self.reacted(n, end) - before) * per)
        return held[n]

    @ti.func
    def lag(self, n, tick, cold, goal, noise, drift, reading_noise):
        y = self._go(self.signal, self.held, n, tick, goal, self.cycle.per_decay[n])
        share = self.p.slow_share[n]
        if share > 0.0:
            slow = self._go(self.slow, self.slow_held, n, tick, goal, self.cycle.per_slow_decay[n])
            y += share * (slow - y)
        return self.with_noise(n, tick, cold, y, y, noise, drift, reading_noise)


def _cycle(tick: float, slot: int, group: GroupRange) -> Numbers:
    """Return a group's heater parameters for kernels: period, hot fraction, reaction rates, time constants."""
    sensor = cast(MoxSensor, group.model.sensors.noses[slot])
    heater, signal = sensor.heater, sensor.signal
    assert heater is not None
    turn, hot = tick / heater.period, heater.hot_share
    k_hot = 1.0 / (hot + (1.0 - hot) * heater.slowness)
    parts = int(turn % 1.0 * PARTS)
    return {
        "period": heater.period,
        "hot_share": hot,
        "k_hot": k_hot,
        "k_cold": k_hot * heater.slowness,
        "turn": turn,
        "parts": parts,
        "rest": turn % 1.0 - parts / PARTS,
        "per_rise": 1.0 / max(signal.rise, FASTEST),
        "per_decay": 1.0 / max(signal.decay, FASTEST),
        "per_slow_decay": 1.0 / max(signal.slow_decay, FASTEST),
    }
