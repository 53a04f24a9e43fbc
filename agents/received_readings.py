"""Readings that one robot of each trial receives, for the maps that this robot makes.

Each robot sends each of its readings to the others of its trial. A reading arrives within the range of the receiver's
`communication`, unless the reading is lost, as messages of search algorithms do (see `Radio`).
"""

import numpy as np

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Parameters
from taichi_plume.agents.radio import Radio
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.rng import uniform4


class ReceivedReadings:
    """Readings of a trial that its robot with number `robot`, counted over all groups, receives; see `Readers`.

    `reading` is NaN, and `wind_known` 0, for robots whose reading of the present time step does not arrive.
    """

    def __init__(self, swarm: Swarm, robot: int):
        self.swarm, self.robot = swarm, robot
        self.members, self.team_size = swarm.members, swarm.team_size
        self.believed_position = swarm.believed_position
        self.wind = swarm.wind
        self.flies, self.altitude = swarm.flies, getattr(swarm, "altitude", None)
        everyone = Members(swarm, range(len(swarm.groups)))  # with the indices of the swarm
        self.number = everyone.number
        self.p = Parameters(everyone, Radio.numbers, stream=f"map of robot {robot}")
        self.reading = ti.filled(np.full(swarm.count, np.nan), ti.f32)  # ppm
        self.wind_known = ti.field(ti.i32, swarm.count)

    @ti.kernel
    def receive(self, tick: int):
        """Receive the readings of time step `tick`."""
        ti.loop_config(serialize=ti.static(runs_serially(self.swarm.count)))
        for k, m in ti.ndrange(*self.members.shape):
            if m < self.team_size[k]:
                i, receiver = self.members[k, m], self.members[k, self.robot]
                apart = (self.swarm.position[i] - self.swarm.position[receiver]).norm()
                key, number, now = self.swarm.counter(i, self.number[i], tick)
                u = uniform4(key, self.p.stream[i], number, now, 0)
                arrives = apart <= self.p.radio_range[receiver] and u[0] > self.p.loss[receiver]
                arrives = i == receiver or arrives
                self.reading[i] = ti.select(arrives, self.swarm.reading[i], ti.math.nan)
                self.wind_known[i] = ti.select(arrives, self.swarm.wind_known[i], 0)
