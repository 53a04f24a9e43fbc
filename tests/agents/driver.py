"""What tests of motion share: a swarm that is begun, commanded and looked at."""

import numpy as np

from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.state import State
from taichi_plume.grid.transfer import uploader


class Driver:
    """A swarm, and what tests do with it: begin anew, command, look."""

    def __init__(self, swarm: Swarm):
        self.swarm, self.state = swarm, State(swarm)
        self._put = uploader(swarm.speed_command, swarm.turn_rate_command)
        self.tick = 0

    def begin(self, groups, positions, headings, sources=(), seed=0, **keys):
        self.state.clear()
        self.swarm.begin(
            groups, np.array(positions), np.array(headings), np.reshape(sources, (-1, 2)), seed, **keys
        )
        self.tick = 0

    def command(self, speed, turn_rate):
        self._put(speed, turn_rate)

    def move(self, ticks=1, dt=0.1):
        for _ in range(ticks):
            self.tick += 1
            self.swarm.move(self.tick, self.tick * dt, dt)
        return self.swarm.snapshot()
