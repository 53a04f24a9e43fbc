"""Exchange of readings in a team: each acquisition is sent once, and updates the belief of each robot that receives it.

The merge rule is the fusion of measurements, not of posteriors: a robot multiplies its belief by the likelihood of a
received reading at the sender's place and wind, as of its own. Beliefs whose readings are independent so become the
posterior of the union of all readings, and no reading counts twice, as robots neither repeat nor forward messages.
Averages of posteriors (consensus) would count shared readings again. With messages that all arrive, the beliefs of a
team are equal: the replicated fusion of Ristic, Angley, Moran & Palmer, Sensors 17 (2017) 918, doi:10.3390/s17040918.
Losses, ranges and rates are ours: a robot sends no reading within 1 / rate after its last message, and readings that do
not arrive are not sent again.
"""

from typing import Any

import numpy as np

from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.radio import Channel, message_ticks
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import long_kernel

LONG_AGO = -(2**30)  # tick of the last message before the first


class SharedReadings(Channel):
    """Readings of the acquisitions that end in the present time step, and which robots of the team take them.

    `ended[n]`: whether robot n has a reading now; `value[n]`, `place[n]` [m], `wind[n]`: that reading. parameters: must
    include the entries of `SharedReadings.numbers` and the random stream `radio`.
    """

    STATE = ("sent",)

    def __init__(self, members: Members, parameters: Parameters):
        super().__init__(members, parameters)
        self.count = int(parameters.largest("count"))
        self.are_shared = self.count > 1 and members.groups[0].model.algorithm.share == "readings"
        self.ended = ti.field(ti.i32, self.size)
        self.sends = ti.field(ti.i32, self.size)  # whether the reading is sent
        self.sent = ti.filled(np.full(self.size, LONG_AGO), ti.i32)  # tick of the last message
        self.value = ti.field(ti.f32, self.size)
        self.place, self.wind = (ti.vector_field(2, ti.f32, self.size) for _ in range(2))

    @staticmethod
    def numbers(group: GroupRange, tick: float) -> Numbers:
        """Return a group's kernel parameters; tick: control period [s]."""
        return {**Channel.numbers(group), "every": message_ticks(group, tick)}

    @ti.func
    def end(self, n, tick, value, wind):
        """Store the reading of robot n, whose acquisition ends in this tick at its believed position, and send it."""
        self.ended[n], self.value[n], self.wind[n] = 1, value, wind
        self.place[n] = self.swarm.believed_position[self.robot[n]]
        self.sends[n] = ti.cast(tick - self.sent[n] >= self.p.every[n], ti.i32)
        if self.sends[n] == 1:
            self.sent[n] = tick

    @ti.func
    def takes(self, n, m, tick):
        """Return whether robot n takes a reading of robot m of its team in this tick: its own, or one that arrives."""
        k = self.mate(n, m)
        taken = self.ended[k] == 1
        if taken and k != n:
            taken = self.sends[k] == 1 and self.arrives(n, m, tick)
        return taken


class TeamInference(KernelAlgorithm):
    """Base class of algorithms whose robots keep a belief, stand still to measure, and share `readings` in a team.

    A subclass defines `_measure`, which calls `readings.end` when an acquisition ends; `_learn`, which updates the
    belief; and `_proceed`, which decides and drives. It adds `SharedReadings.numbers` to its numbers.
    """

    TALKS = True

    def _allocate(self) -> None:
        self.readings = SharedReadings(self.members, self.p)

    def act(self, tick: int, t: float, dt: float) -> Any:
        super().act(tick, t, dt)
        if self.readings.are_shared:
            self._exchange(tick, t, dt)

    @ti.func
    def _step(self, n, tick, t, dt):
        self.readings.ended[n] = 0
        if self.swarm.searches(self.robot[n]):
            self._measure(n, tick)
            if ti.static(not self.readings.are_shared):
                if self.readings.ended[n] == 1:
                    self._learn(n, n)
                self._proceed(n, tick, t, dt)

    @long_kernel
    def _exchange(self, tick: int, t: float, dt: float):
        """Update the beliefs of all robots by the readings that they take in this tick; then let them proceed."""
        ti.loop_config(serialize=ti.static(runs_serially(self.WORK * self.size)))
        for n in range(self.size):
            if self.swarm.searches(self.robot[n]):
                for m in range(self.p.count[n]):
                    if self.readings.takes(n, m, tick):
                        self._learn(n, self.readings.mate(n, m))
                self._proceed(n, tick, t, dt)

    @ti.func
    def _measure(self, n, tick):
        """Advance the acquisition of robot n by a control period."""

    @ti.func
    def _learn(self, n, k):
        """Update the belief of robot n by the present reading of robot k, and by its not having found the source."""

    @ti.func
    def _proceed(self, n, tick, t, dt):
        """Decide if an acquisition of robot n has ended, and drive."""
