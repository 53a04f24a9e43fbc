"""Decision quantities: the numbers by which search algorithms decide, as columns of `robots.parquet`.

An algorithm lists its quantities in `DECISIONS`, a line or two each: name, unit and meaning of the column, and the
attribute of the algorithm that holds the numbers. Kernels are the same with and without the list. A run has the columns
of the algorithms that drive its robots, and no others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Protocol

import numpy as np

from taichi_plume.agents.columns import Column
from taichi_plume.scenario.loading import ScenarioError

KEYS = ("t", "group", "trial", "robot")
"""First columns of `robots.parquet`."""


class Driven(Protocol):
    """Protocol of an algorithm together with the robots that it drives, see `team.Team`."""

    algorithm: Any
    members: Any


@dataclass(frozen=True)
class Decision:
    """Quantity by which an algorithm decides, f32; NaN (null in tables) while there is none.

    name: of the column. source: attribute of the algorithm that holds a number per robot, a field or a NumPy array, by
    default `name`; dotted for an attribute of a part. axis: component, if the attribute holds vectors. none: number
    that stands for a missing one.
    """

    name: str
    unit: str
    meaning: str
    source: str = ""
    axis: int | None = None
    none: float = np.nan

    def read(self, algorithm: Any) -> np.ndarray:
        """Return the quantity of each robot of an algorithm, (size,)."""
        held = attrgetter(self.source or self.name)(algorithm)
        values = held if isinstance(held, np.ndarray) else held.values
        values = np.array(values if self.axis is None else values[..., self.axis], np.float32)
        values[values == self.none] = np.nan
        return values


def position(name: str, meaning: str, source: str) -> tuple[Decision, Decision]:
    """Return the two components [m] of a position, as columns `name`_x and `name`_y."""
    return Decision(f"{name}_x", "m", meaning, source, 0), Decision(f"{name}_y", "m", meaning, source, 1)


def way_point(source: str = "way_point") -> tuple[Decision, Decision]:
    """Return the two components of a robot's way point, which the attribute `source` of the algorithm holds."""
    return position("way_point", "point to which the robot drives", source)


def columns(teams: Sequence[Driven]) -> tuple[Decision, ...]:
    """Return the decision quantities of the algorithms of some teams; a name that several share counts once."""
    shared = {each.name: each for team in teams for each in team.algorithm.DECISIONS}
    return tuple(shared.values())


def require_distinct(teams: Sequence[Driven], others: Sequence[Column]) -> None:
    """Raise ScenarioError if a user's algorithm gives a decision quantity the name of another column of the table."""
    known = {name: (column.unit, column.meaning) for column in others for name in column.table}
    known |= dict.fromkeys(KEYS, ("1", "identifies the row"))
    for team in teams:
        for each in team.algorithm.DECISIONS:
            unit, meaning = known.setdefault(each.name, (each.unit, each.meaning))
            if (unit, meaning) != (each.unit, each.meaning):
                raise ScenarioError(
                    [f"robots[{team.members.numbers[0]}].algorithm: DECISIONS has the name {each.name!r} of another "
                     f"column of robots.parquet: {meaning} [{unit}]; take another name"]
                )  # fmt: skip


def values(teams: Sequence[Driven], count: int) -> dict[str, np.ndarray]:
    """Return the decision quantities of `count` robots, (count,) by name; NaN for robots of other algorithms."""
    result = {each.name: np.full(count, np.nan, np.float32) for each in columns(teams)}
    for team in teams:
        for each in team.algorithm.DECISIONS:
            result[each.name][team.members.robot.values] = each.read(team.algorithm)
    return result
