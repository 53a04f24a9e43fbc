"""Radio communication in a team (a group's robots in one trial): short messages to teammates in range, some lost.

A message is a value and a position, with the time and the sender's believed position. Each robot stores the last
message of each teammate.
"""

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.grid.rng import uniform4

NEVER = -1.0  # s, time of a message never received
UNLIMITED = 1e9  # m
MOST_TICKS = 2.0**30  # between two messages


def message_ticks(group: GroupRange, tick: float) -> int:
    """Return the least number of ticks between two messages of a robot; tick: control period [s]."""
    rate = group.model.communication.rate
    return 1 if rate is None else max(1, round(min(1.0 / (rate * tick), MOST_TICKS)))


class Channel:
    """Radio channel of each team: which messages of a robot reach a teammate.

    parameters: must include the entries of `Channel.numbers` and the random stream `radio`.
    """

    def __init__(self, members: Members, parameters: Parameters):
        self.swarm, self.robot, self.number, self.p = members.swarm, members.robot, members.number, parameters
        self.size = members.size

    @staticmethod
    def numbers(group: GroupRange) -> Numbers:
        """Return a group's kernel parameters: robots per team, numbers in the team, range [m], loss probability."""
        model = group.model.communication
        return {
            "count": group.count,  # robots of a team
            "mate": np.arange(group.size) % group.count,  # number of the robot in its team
            "radio_range": UNLIMITED if model.range is None else model.range,  # m
            "loss": model.loss,
        }

    @ti.func
    def mate(self, n, m):
        """Return the index of robot m of the team of robot n."""
        return n - self.p.mate[n] + m

    @ti.func
    def arrives(self, n, m, tick):
        """Return whether a message of robot m of its team reaches robot n in this tick: in range and not lost."""
        i, j = self.robot[n], self.robot[self.mate(n, m)]
        near = (self.swarm.position[i] - self.swarm.position[j]).norm() <= self.p.radio_range[n]
        key, number, now = self.swarm.counter(i, self.number[n], tick)
        u = uniform4(key, self.p.radio[n], number, now, m)
        return near and u[0] > self.p.loss[n]


class Radio(Channel):
    """Radio messages between the robots of each team.

    `value`, `place`, `sender` [m] and `time` [s] of [n, m] are the last message that robot n received from robot m of
    its team; they are valid if `has_heard(n, m)`. At the start of a run call `forget` for all robots.
    """

    STATE = ("value", "place", "sender", "time")

    def __init__(self, members: Members, parameters: Parameters):
        super().__init__(members, parameters)
        shape = (self.size, int(parameters.largest("count")))
        self.value = ti.field(ti.f32, shape)
        self.place = ti.vector_field(2, ti.f32, shape)
        self.sender = ti.vector_field(2, ti.f32, shape)
        self.time = ti.field(ti.f32, shape)
        self.speaks = ti.field(ti.i32, self.size)  # whether the robot sends a message in this tick
        self.said_value = ti.field(ti.f32, self.size)
        self.said_place = ti.vector_field(2, ti.f32, self.size)

    @ti.func
    def say(self, n, value, place):
        """Queue a message (value, position [m]) from robot n to its team; the next `deliver` transmits the message."""
        self.speaks[n], self.said_value[n], self.said_place[n] = 1, value, place

    @ti.func
    def has_heard(self, n, m):
        """Return whether robot n has received a message from robot m of its team."""
        return self.time[n, m] >= 0.0

    @ti.func
    def forget(self, n):
        """Delete the messages received by robot n."""
        for m in range(self.p.count[n]):
            self.time[n, m] = NEVER

    @ti.func
    def receive(self, n, m, tick, t):
        """Store the message that robot m of its team sends to robot n at time t [s], if in range and not lost."""
        other = self.mate(n, m)
        if m < self.p.count[n] and other != n and self.speaks[other] == 1:
            if self.arrives(n, m, tick):
                self.value[n, m], self.place[n, m] = self.said_value[other], self.said_place[other]
                self.sender[n, m] = self.swarm.believed_position[self.robot[other]]
                self.time[n, m] = t

    @ti.kernel
    def deliver(self, tick: int, t: float):
        """Deliver the messages queued in this step, at time t [s], to teammates in range; some are lost at random."""
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n, m in ti.ndrange(*self.value.shape):
            self.receive(n, m, tick, t)
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            self.speaks[n] = 0
