"""Readings that one robot of each trial receives, for the maps that this robot makes.

Each robot sends each of its readings to the others of its trial. A reading arrives within the range of the receiver's
`communication`, unless the reading is lost, as messages of search algorithms do (see `Radio`).
"""

import numpy as np

from taichi_plume.agents.radio import UNLIMITED
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.rng import stream_id, uniform4


class ReceivedReadings:
    """Readings of a trial that its robot with number `robot`, counted over all groups, receives; see `Readers`.

    `reading` is NaN for robots whose reading of the present time step does not arrive.
    """

    def __init__(self, swarm: Swarm, robot: int):
        self.swarm, self.robot = swarm, robot
        self.members, self.team_size = swarm.members, swarm.team_size
        self.believed_position, self.wind, self.wind_known = (
            swarm.believed_position,
            swarm.wind,
            swarm.wind_known,
        )
        n = max(1, swarm.count)
        ranges, losses = np.zeros(n), np.zeros(n)
        numbers, streams = np.zeros(n), np.zeros(n, np.uint32)
        for group in swarm.groups:
            model = group.model.communication
            ranges[group.slice] = UNLIMITED if model.range is None else model.range
            losses[group.slice] = model.loss
            numbers[group.slice] = group.first + np.arange(group.size)
            streams[group.slice] = stream_id(f"group {group.number}/map of robot {robot}")
        self.range, self.loss = ti.filled(ranges, ti.f32), ti.filled(losses, ti.f32)  # m, probability
        self.number = ti.filled(numbers, ti.i32)  # of the robot in its group, among all possible trials
        self.stream = ti.filled(streams, ti.u32)
        self.reading = ti.filled(np.full(n, np.nan), ti.f32)  # ppm

    @ti.kernel
    def receive(self, tick: int):
        """Receive the readings of time step `tick`."""
        ti.loop_config(serialize=ti.static(runs_serially(self.swarm.count)))
        for k, m in ti.ndrange(*self.members.shape):
            if m < self.team_size[k]:
                i, receiver = self.members[k, m], self.members[k, self.robot]
                apart = (self.swarm.position[i] - self.swarm.position[receiver]).norm()
                key, number, now = self.swarm.counter(i, self.number[i], tick)
                u = uniform4(key, self.stream[i], number, now, 0)
                arrives = apart <= self.range[receiver] and u[0] > self.loss[receiver]
                self.reading[i] = ti.select(i == receiver or arrives, self.swarm.reading[i], ti.math.nan)
