"""Robots that are driven from outside: what is told of them, and what they are told.

AWAITED   nothing has been heard of the robot yet: it stands
DRIVEN    it does what it was told last
LOST      nothing was heard of it for too long: it stands

Who is heard of, and when, is known outside alone: `taichi_plume.serve` gives its orders after every tick.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np

from taichi_plume.agents.columns import Columns, Rows, further_gas_sensors
from taichi_plume.agents.members import Members
from taichi_plume.agents.swarm import Swarm
from taichi_plume.scenario.external import External

AWAITED, DRIVEN, LOST = range(3)

TOLD = (
    Columns.believed_position, Columns.believed_heading, Columns.wind, Columns.wind_known, Columns.blocked,
    Columns.found, Columns.declarations,
)  # fmt: skip
SENSED = ("reading", "resistance")  # of each gas sensor
ORDERED = (
    Columns.state, Columns.speed_command, Columns.turn_rate_command, Columns.ordered_position,
    Columns.ordered_heading,
)  # fmt: skip

FLOWN = (Columns.left_command, Columns.climb_command, Columns.ordered_altitude)


@dataclass
class Orders:
    """What the robots of a group, trial by trial, are told for the next tick.

    state (size,): AWAITED, DRIVEN or LOST; speed [m/s] and turn_rate [rad/s] (size,); position (size, 2) [m], NaN:
    stays, and heading (size,) [rad] of those that are placed; declared (size, 2) [m], NaN: says nothing. Of drones also
    left and climb (size,) [m/s], or altitude (size,) [m] of those that are placed, NaN: stays.
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
        """All wait."""
        state, (speed, turn_rate, heading, left, climb) = np.zeros(size, int), np.zeros((5, size))
        position, declared = np.full((2, size, 2), np.nan)
        altitude = np.full(size, np.nan)
        return cls(state, speed, turn_rate, position, heading, declared, left, climb, altitude)


class ExternalAlgorithm:
    """The robots of one group, at the disposal of what drives them."""

    PER_GROUP: bool = True
    STATE: tuple[str, ...] = ()
    STATE_NAMES: tuple[str, ...] = ("AWAITED", "DRIVEN", "LOST")

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        self.members, self.size = members, members.size
        (group,) = members.groups
        self.flies = group.model.body.flies
        ordered = (*ORDERED, *(FLOWN if self.flies else ()))
        self.noses = len(group.model.sensors.noses)
        noses = [one for one in further_gas_sensors(self.noses) if one.name.startswith(SENSED)]
        told = (
            *TOLD,
            Columns.reading,
            Columns.resistance,
            *noses,
            *((Columns.altitude,) if self.flies else ()),
        )
        self._told, self._ordered = (Rows(swarm, some, group.start, group.size) for some in (told, ordered))
        self._swarm, self._start = swarm, group.start
        self.begin()

    @property
    def model(self) -> External:
        """What the scenario says of them."""
        return cast(External, self.members.groups[0].model.algorithm)

    def begin(self) -> None:
        """All wait to be driven."""

    def act(self, tick: int, t: float, dt: float) -> None:
        """Go on as ordered last."""

    def told(self) -> dict[str, np.ndarray]:
        """What is told of each robot, by the names of the columns: (size,), (size, 2), or (size, noses) of what gas
        sensors tell. Altitude: 0 on the floor.
        """
        told = {one.name: values for one, values in zip(self._told.columns, self._told.read(), strict=True)}
        for name in SENSED:
            each = [told.pop(name if k == 0 else f"{name}_{k}") for k in range(self.noses)]
            told[name] = np.stack(each, axis=-1)
        return {"altitude": np.zeros(self.size, np.float32)} | told

    def order(self, orders: Orders, t: float) -> None:
        """Tell the robots what to do in the next tick; t: now [s]."""
        ordered = [orders.state, orders.speed, orders.turn_rate, orders.position, orders.heading]
        if self.flies:
            ordered += [orders.left, orders.climb, orders.altitude]
        self._ordered.write(ordered)
        self._swarm.declare_all(self._start, orders.declared, t)
