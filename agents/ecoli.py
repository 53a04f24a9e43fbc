"""E. coli run and tumble (chemotaxis): straight on after a rise of the mean reading, else in a random direction.

Russell, Bab-Hadiashar, Shepherd & Wallace, Robotics and Autonomous Systems 45 (2003) 83-97, as run by Ferri et al.,
Robotics and Autonomous Systems 57 (2009) 393-402, table 1.

ACQUIRE  stand still and take the mean reading
RUN      the mean rose: turn by at most run_angle, drive a step
TUMBLE   no rise, or the first mean: turn by any angle, drive a step
"""

from math import pi, radians

import numpy as np

from taichi_plume.agents.acquisition import MEAN, Acquisition
from taichi_plume.agents.algorithm import KernelAlgorithm
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.path_segments import Legs
from taichi_plume.engine import ti
from taichi_plume.grid.rng import uniform4
from taichi_plume.scenario import algorithms

ACQUIRE, RUN, TUMBLE = range(3)


class EColi(KernelAlgorithm):
    """E. coli (run and tumble) search algorithm. tick: control period [s]."""

    STREAM = "e. coli"
    STATE: tuple[str, ...] = ("legs", "acquisition", "before", "rise")
    STATE_NAMES: tuple[str, ...] = ("ACQUIRE", "RUN", "TUMBLE")
    DECISIONS: tuple[Decision, ...] = (
        MEAN,
        Decision("rise_ppm", "ppm", "mean of the last acquisition less that of the one before", "rise"),
        Decision("course", "rad", "direction of the path segment", "legs.course"),
    )

    def _allocate(self) -> None:
        self.legs = Legs(self.members, self.p)
        self.acquisition = Acquisition(self.members, self.p)
        self.before = ti.field(ti.f32, self.size)  # mean of the previous acquisition [ppm]
        self.rise = ti.filled(np.full(self.size, np.nan), ti.f32)  # rise of the mean [ppm]; NaN before

    def numbers(self, group: GroupRange, model: algorithms.EColi) -> Numbers:
        return {
            **Legs.numbers(group, model.speed),
            **Acquisition.numbers(group, self.tick),
            "step": model.step,  # m
            "scatter": model.step_spread,
            "run_angle": radians(model.run_angle_deg),
        }

    @ti.func
    def _step(self, n, tick, t, dt):
        i = self.robot[n]
        if self.swarm.state[i] == ACQUIRE:
            if self.acquisition.listen(n):
                self._choose(n, tick)
        if self.swarm.state[i] != ACQUIRE and not self.legs.advance(n, dt):
            self.swarm.state[i] = ACQUIRE

    @ti.func
    def _choose(self, n, tick):
        i = self.robot[n]
        mean = self.acquisition.mean(n)
        rose = mean > self.before[n] and self.swarm.acquisitions[i] > 1
        if self.swarm.acquisitions[i] > 1:
            self.rise[n] = mean - self.before[n]
        self.before[n] = mean
        self.swarm.hits[i] += ti.cast(rose and self.swarm.searches(i), ti.i32)
        u = uniform4(self.swarm.key[None], self.p.stream[n], self.number[n], tick, 0)
        self.swarm.state[i] = ti.select(rose, RUN, TUMBLE)
        turn = ti.select(rose, self.p.run_angle[n], pi) * (2.0 * u[0] - 1.0)
        length = self.p.step[n] * (1.0 + self.p.scatter[n] * (2.0 * u[1] - 1.0))
        self.legs.set_out(n, turn, length, ti.select(u[2] > 0.5, 1.0, -1.0))
