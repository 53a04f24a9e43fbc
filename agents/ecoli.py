"""E. coli: run and tumble. On after a rise of the mean reading, else in a random direction.

Russell, Bab-Hadiashar, Shepherd & Wallace, Robotics and Autonomous Systems 45 (2003) 83-97, as run by Ferri et al.,
Robotics and Autonomous Systems 57 (2009) 393-402, table 1.

ACQUIRE  stand still and take the mean reading
RUN      it rose: turn by at most run_angle, drive a step
TUMBLE   it did not, or is the first: turn by any angle, drive a step
"""

from math import pi, radians

import taichi as ti

from taichi_plume.agents.acquisition import Acquisition
from taichi_plume.agents.legs import Legs
from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.grid.rng import stream_id, uniform4
from taichi_plume.scenario import algorithms

ACQUIRE, RUN, TUMBLE = range(3)


@ti.data_oriented
class EColi:
    """The E. coli algorithm for the robots of one group. tick: control period [s]."""

    STATE_NAMES: tuple[str, ...] = ("ACQUIRE", "RUN", "TUMBLE")

    def __init__(self, swarm: Swarm, group: GroupRange, tick: float):
        model = group.model.algorithm
        assert isinstance(model, algorithms.EColi)
        self.swarm, self.start, self.size, self.first = swarm, group.start, group.size, group.first
        self.seed, self.stream = swarm.seed, stream_id(f"group {group.number}/e. coli")
        self.legs = Legs(swarm, group, model.speed)
        self.step, self.scatter = model.step, model.step_spread
        self.run_angle = radians(model.run_angle_deg)
        self.acquisition = Acquisition(swarm, group, model, tick)
        self.before = ti.field(ti.f32, self.size)  # mean of the acquisition before [ppm]
        self.before.fill(float("inf"))

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn the readings at time t [s] into commands for the next dt [s]."""
        self._act(tick, dt)

    @ti.kernel
    def _act(self, tick: int, dt: float):
        for n in range(self.size):
            i = self.start + n
            if self.swarm.state[i] == ACQUIRE:
                if self.acquisition.listen(n):
                    self._choose(n, tick)
            if self.swarm.state[i] != ACQUIRE and not self.legs.advance(n, dt):
                self.swarm.state[i] = ACQUIRE

    @ti.func
    def _choose(self, n, tick):
        """Run or tumble."""
        i = self.start + n
        mean = self.acquisition.mean(n)
        rose = mean > self.before[n]
        self.before[n] = mean
        self.swarm.hits[i] += ti.cast(rose, ti.i32)
        u = uniform4(ti.u32(self.seed), ti.u32(self.stream), self.first + n, tick, 0)
        self.swarm.state[i] = ti.select(rose, RUN, TUMBLE)
        turn = ti.select(rose, self.run_angle, pi) * (2.0 * u[0] - 1.0)
        length = self.step * (1.0 + self.scatter * (2.0 * u[1] - 1.0))
        self.legs.begin(n, turn, length, ti.select(u[2] > 0.5, 1.0, -1.0))
