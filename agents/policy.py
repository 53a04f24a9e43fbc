"""Learnt policies: every `period` a neural network maps the observations of all robots of a group to actions.

Observations and commands are those of the training environment, see `observation` and `commands`.
"""

from typing import cast

import numpy as np

from taichi_plume.agents.commands import Commands
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.members import Members
from taichi_plume.agents.observation import Observation
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.files.network import Network, NetworkError
from taichi_plume.scenario.policy import Policy


class PolicyAlgorithm:
    """Learnt policy that drives a group. tick: control period [s]. Raises NetworkError if the network does not fit."""

    PER_GROUP: bool = True
    STATE: tuple[str, ...] = ("observation", "commands")
    STATE_NAMES: tuple[str, ...] = ("POLICY",)
    DECISIONS: tuple[Decision, ...] = ()

    def __init__(self, swarm: Swarm, members: Members, tick: float, network: Network):
        self.members, self.size, self.tick, self.network = members, members.size, tick, network
        self.observation, self.commands = Observation(swarm, members, tick), Commands(swarm, members, tick)
        fault = network.fault(self.observation.size, self.commands.size)
        if fault:
            raise NetworkError(f"robots[{members.numbers[0]}].algorithm.file: {fault}")
        self.observations = np.zeros((self.size, self.observation.size), np.float32)
        self.actions = np.zeros((self.size, self.commands.size), np.float32)
        (group,) = members.groups
        self.ticks = cast(Policy, group.model.algorithm).ticks(self.tick)
        self.waits = group.waits(tick) + 1

    def act(self, tick: int, t: float, dt: float) -> None:
        since = tick - self.waits
        decides = since % self.ticks == 0
        self._follow(tick, t, dt, int(decides), since * dt, self.observations)
        if decides:
            self.actions = self.network.act(self.observations, self.commands.size)
        self._command(int(decides), t, dt, self.actions)

    @ti.kernel
    def _follow(
        self,
        tick: int,
        t: float,
        dt: float,
        decides: int,
        elapsed: float,
        table: ti.types.ndarray(dtype=ti.f32, ndim=2),
    ):
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            self.observation.follow(n, dt)
            self.observation.send(n, tick)
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            self.observation.receive(n, tick, t)
            if decides == 1:
                self.observation.write(n, 1.0, n, table, elapsed, t)

    @ti.kernel
    def _command(self, decides: int, t: float, dt: float, actions: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        ti.loop_config(serialize=ti.static(runs_serially(self.size)))
        for n in range(self.size):
            if decides == 1:
                self.commands.take(n, 1.0, n, actions, t)
                self.observation.remember(n, n, actions)
            self.commands.carry_out(n, dt)
