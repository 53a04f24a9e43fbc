"""Robots that clients drive through `taichi_plume.serve` (hybrid experiments): readings and orders.

AWAITED   no order has arrived for the robot yet: the robot stands
DRIVEN    the robot carries out the last order
LOST      no order has arrived for too long: the robot stands

Only the service knows which client drives which robot; the service sets the orders after every time step.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np

from taichi_plume.agents.columns import Columns, Rows, further_gas_sensors
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.members import Members
from taichi_plume.agents.swarm import Swarm
from taichi_plume.scenario.external import External

AWAITED, DRIVEN, LOST = range(3)

READ = (
    Columns.believed_position, Columns.believed_heading, Columns.wind, Columns.wind_known, Columns.blocked,
    Columns.found, Columns.declarations, Columns.measured, Columns.resistance,
)  # fmt: skip
SENSED = {
    "measured": "reading",
    "resistance": "resistance",
}  # columns of each gas sensor, and their names in a sample
ORDERED = (
    Columns.state, Columns.speed_command, Columns.turn_rate_command, Columns.ordered_position,
    Columns.ordered_heading,
)  # fmt: skip
FLOWN = (Columns.left_command, Columns.climb_command, Columns.ordered_altitude)


@dataclass
class Orders:
    """Commands of clients to the robots of a group, trial by trial, for the next time step.

    state (size,): AWAITED, DRIVEN or LOST; speed [m/s] and turn_rate [rad/s] (size,). For placed robots: position
    (size, 2) [m], NaN: stays, and heading (size,) [rad]. declared (size, 2) [m]: source positions, NaN: none. For
    drones also left and climb (size,) [m/s], or altitude (size,) [m] of placed drones, NaN: stays.
    """

    state: np.ndarray
    speed: np.ndarray
    turn_rate: np.ndarray
    position: np.ndarray
    heading: np.ndarray
    declared: np.ndarray
    left: np.ndarray
    climb: np.ndarray
    altitude: np.ndarray

    @classmethod
    def none(cls, size: int) -> "Orders":
        """Return orders that let `size` robots wait."""
        state, (speed, turn_rate, heading, left, climb) = np.zeros(size, int), np.zeros((5, size))
        position, declared = np.full((2, size, 2), np.nan)
        altitude = np.full(size, np.nan)
        return cls(state, speed, turn_rate, position, heading, declared, left, climb, altitude)


class ExternalAlgorithm:
    """Adapter for a group of robots that clients drive from outside."""

    PER_GROUP: bool = True
    STATE: tuple[str, ...] = ()
    STATE_NAMES: tuple[str, ...] = ("AWAITED", "DRIVEN", "LOST")
    DECISIONS: tuple[Decision, ...] = ()

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        self.members, self.size = members, members.size
        (group,) = members.groups
        self.flies = group.model.body.flies
        self.noses = len(group.model.sensors.noses)
        further = [
            column for column in further_gas_sensors(self.noses) if column.name.startswith(tuple(SENSED))
        ]
        read = (*READ, *further, *((Columns.altitude,) if self.flies else ()))
        self._read = Rows(swarm, read, group.start, group.size)
        self._ordered = Rows(swarm, (*ORDERED, *(FLOWN if self.flies else ())), group.start, group.size)
        self._swarm, self._start = swarm, group.start

    @property
    def model(self) -> External:
        """Scenario section of the group's algorithm."""
        return cast(External, self.members.groups[0].model.algorithm)

    def act(self, tick: int, t: float, dt: float) -> None:
        """Do nothing: the last orders hold until the next ones."""

    def sample(self) -> dict[str, np.ndarray]:
        """Return the robots' readings, with the background, by column name: (size,), (size, 2), or (size, sensors) for
        gas sensors. Altitude is 0 for robots on the floor.
        """
        names = (column.name for column in self._read.columns)
        read = dict(zip(names, self._read.read(), strict=True))
        for column, name in SENSED.items():
            each = [read.pop(column if k == 0 else f"{column}_{k}") for k in range(self.noses)]
            read[name] = np.stack(each, axis=-1)
        return {"altitude": np.zeros(self.size, np.float32)} | read

    def order(self, orders: Orders, t: float) -> None:
        """Write the clients' orders for the next time step to the robots; t: present time [s]."""
        ordered = [orders.state, orders.speed, orders.turn_rate, orders.position, orders.heading]
        if self.flies:
            ordered += [orders.left, orders.climb, orders.altitude]
        self._ordered.write(ordered)
        self._swarm.declare_all(self._start, orders.declared, t)
