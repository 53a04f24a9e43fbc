"""Table of columns: state and readings of every robot, each declared once with unit, meaning and users.

From this table come the swarm's Taichi fields, its snapshots (and so results and recordings), `robots.parquet` and the
arrays that a user's own algorithm sees. To add a quantity, declare it in `Columns` and let its sensor or algorithm
write the quantity.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field

Dtype = type[np.float32] | type[np.int32] | type[np.bool_]


@dataclass
class Column:
    """Quantity of every robot, stored by `Columns` in a field: f32, or i32 for whole numbers and flags.

    width: 2 for vectors. key: name in snapshots, * is the column's name; empty if not in snapshots. tabled: whether
    `robots.parquet` has the column, named by key or `components`; there NaN is null. named: whether the numbers stand
    for names, the states of the algorithm. read_as, written_as: name among the arrays that an own algorithm reads, or
    writes. truth: column whose field is shared if all robots know their poses, and for readings if clean air has no
    background. flies: column of swarms with drones only. pushed: column of swarms among moving obstacles only.
    """

    unit: str
    meaning: str
    dtype: Dtype = np.float32
    width: int = 1
    key: str = "*"
    tabled: bool = False
    components: tuple[str, ...] = ()
    named: bool = False
    read_as: str = ""
    written_as: str = ""
    truth: str = ""
    flies: bool = False
    pushed: bool = False
    name: str = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name, self.key = name, self.key.replace("*", name)

    def __get__(self, instance: object, owner: type) -> Any:
        return self  # of the class; a swarm's own attribute of this name is its field

    @property
    def table(self) -> tuple[str, ...]:
        """Names of the columns in `robots.parquet`, one per component of the quantity."""
        return self.components or ((self.key,) if self.tabled else ())

    def field(self, n: int) -> Field:
        """Return a new Taichi field of this quantity for n robots."""
        dtype = ti.f32 if self.dtype is np.float32 else ti.i32
        return ti.field(dtype, n) if self.width == 1 else ti.vector_field(self.width, dtype, n)

    def zeros(self, n: int) -> np.ndarray:
        """Return an array of zeros with this quantity's shape for n robots."""
        return np.zeros(n if self.width == 1 else (n, self.width), self.dtype)


class Columns:
    """Quantities of all robots, each a Taichi field; the columns of `robots.parquet` are in file order.

    columns: the columns of this swarm: `columns_of`, and `further_gas_sensors` for further gas sensors.
    """

    columns: tuple[Column, ...]

    position = Column("m", "middle of the body", width=2, components=("x", "y"))
    heading = Column("rad", "from x towards y", tabled=True)
    altitude = Column(
        "m", "of the lower end of the body over the floor", components=("z",), read_as="altitude", flies=True
    )
    measured = Column(
        "ppm",
        "of the gas sensor, with the background; in ppm m for a laser that measures the integral",
        key="reading_ppm",
        tabled=True,
    )
    reading = Column(
        "ppm",
        "of the gas sensor above that in clean air; in ppm m for a laser that measures the integral",
        key="above_ppm",
        read_as="reading",
        truth="measured",
    )
    resistance = Column("ohm", "of a metal-oxide sensor; NaN for others", key="resistance_ohm", tabled=True)
    true_ppm = Column(
        "ppm",
        "true mole fraction of all vapours at the gas sensor; for a laser the mean of its gas along the beam",
        tabled=True,
    )
    wind = Column(
        "m/s",
        "of the anemometer; zero while no wind is known",
        width=2,
        components=("wind_x", "wind_y"),
        read_as="wind",
    )
    believed_position = Column(
        "m",
        "believed position",
        width=2,
        components=("believed_x", "believed_y"),
        read_as="position",
        truth="position",
    )
    believed_heading = Column("rad", "believed heading", tabled=True, read_as="heading", truth="heading")
    state = Column("1", "of the algorithm", np.int32, tabled=True, named=True, written_as="state")
    found = Column("1", "whether the robot has found a source", np.bool_, tabled=True)
    found_time = Column("s", "time of finding a source; NaN before")
    reached_time = Column("s", "time of first coming within reach of a source; NaN before")
    declared_position = Column(
        "m",
        "declared position of a source, as believed: the first right one, or else the last; NaN before",
        width=2,
        components=("declared_x", "declared_y"),
    )
    declared_rate = Column(
        "kg/s",
        "rate of this source, and the limits of its interval of 90 %; NaN without an estimate",
        width=3,
    )
    declared_time = Column("s", "time of this declaration; NaN before")
    declarations = Column("1", "number of declarations of a source's position", np.int32, tabled=True)
    false_declarations = Column(
        "1", "number of declarations without a source within reach", np.int32, tabled=True
    )
    path_length = Column("m", "true distance driven")
    odometer = Column("m", "distance driven by odometry", read_as="path_length", truth="path_length")
    blocked = Column("1", "whether the bumper is pressed (collision)", np.bool_, read_as="blocked")
    bumps = Column("1", "number of collisions", np.int32)
    pushes = Column(
        "1", "number of times that a moving obstacle ran into the robot", np.int32, tabled=True, pushed=True
    )
    pinned_time = Column(
        "s",
        "time inside the disc of a moving obstacle, without a way out or after placement there",
        key="pinned_s",
        tabled=True,
        pushed=True,
    )
    touched = Column("1", "whether a moving obstacle touches the robot", np.bool_, key="", pushed=True)
    acquisitions = Column("1", "number of stops to measure", np.int32)
    hits = Column("1", "number of detections of gas", np.int32)
    wind_known = Column("1", "whether the anemometer measures wind", np.bool_, key="", read_as="wind_known")
    velocity = Column("m/s", "mean over the last tick", key="", width=2)
    speed = Column("m/s", "forward, as commanded and limited", key="")
    speed_command = Column("m/s", "forward, commanded by the algorithm", key="", written_as="speed")
    turn_rate_command = Column("rad/s", "commanded by the algorithm", key="", written_as="turn_rate")
    ordered_position = Column("m", "position set from outside; NaN before", key="", width=2)
    ordered_heading = Column("rad", "heading set from outside", key="")
    ordered_altitude = Column("m", "altitude set from outside; NaN before", key="", flies=True)
    climb_rate = Column("m/s", "upward, over the last tick", flies=True)
    flight = Column("m/s", "velocity in the room, as commanded and limited", key="", width=3, flies=True)
    acceleration = Column("m/s^2", "acceleration of the drone by its rotors", key="", width=3, flies=True)
    left_command = Column("m/s", "to the left, commanded", key="", written_as="left_speed", flies=True)
    climb_command = Column("m/s", "upward, commanded", key="", written_as="climb_rate", flies=True)
    goal = Column("m", "commanded goal of flight; NaN: flight by speeds", key="", width=3, flies=True)
    goal_heading = Column("rad", "commanded heading on the way; NaN: by turn rate", key="", flies=True)

    def _allocate(self, n: int, errs: bool, background: bool) -> None:
        """Allocate the fields of n robots; errs: whether the believed pose of any robot has errors; background: whether
        readings for algorithms differ from measured ones, by a background of gas or by a classifier."""
        for column in self.columns:
            differs = background if column.truth.startswith("measured") else errs
            shared = bool(column.truth) and not differs
            setattr(self, column.name, getattr(self, column.truth) if shared else column.field(n))


ALL: tuple[Column, ...] = tuple(column for column in vars(Columns).values() if isinstance(column, Column))
COLUMNS = tuple(column for column in ALL if not column.flies and not column.pushed)
"""Columns of every swarm, without those for drones or moving obstacles."""


def columns_of(flies: bool, pushed: bool = False) -> tuple[Column, ...]:
    """Return the columns of a swarm; flies: whether any robot flies; pushed: whether obstacles move."""
    return tuple(column for column in ALL if column.flies <= flies and column.pushed <= pushed)


def with_excess(columns: Sequence[Column]) -> tuple[Column, ...]:
    """Return columns with the readings above clean air in `robots.parquet`, for runs with a background of gas."""
    return tuple(
        replace(column, tabled=True) if column.truth.startswith("measured") else column for column in columns
    )


OF_A_GAS_SENSOR = ("measured", "reading", "resistance", "true_ppm")
"""Names of the columns that each gas sensor writes."""


def further_gas_sensors(most: int) -> tuple[Column, ...]:
    """Return four columns for each gas sensor but the first; most: largest number of gas sensors of a robot.

    The columns are the first sensor's with the sensor's number in their names; NaN for robots with fewer sensors.
    """
    return tuple(
        replace(
            column,
            meaning=f"{column.meaning}; of sensor {k}, from 0 on",
            name=f"{column.name}_{k}",
            key=f"_{k}_".join(column.key.rsplit("_", 1)),  # reading_1_ppm
            read_as="",
            truth=column.truth and f"{column.truth}_{k}",
        )
        for k in range(1, most)
        for column in COLUMNS
        if column.name in OF_A_GAS_SENSOR
    )


GAS_SHARE = Column(
    "1",
    "share of the reading that algorithms get, by the classifier of gases; 1 without a classifier",
    key="gas_share",
    tabled=True,
    name="gas_share",
)
"""Column of swarms in which any group has a classifier of gases."""
RANGE = "range"
"""First part of the names of the columns that range sensors write."""


def range_columns(most: int) -> tuple[Column, ...]:
    """Return a column for each range sensor; most: largest number of range sensors of a robot."""
    return tuple(
        Column(
            "m",
            f"distance that range sensor {k} measures, from 0 on; the largest range if nothing is nearer",
            key=f"{RANGE}_{k}_m",
            tabled=True,
            name=f"{RANGE}_{k}",
        )
        for k in range(most)
    )


class Rows:
    """Selected columns of `size` robots from index `start` on."""

    def __init__(self, robots: Columns, columns: Sequence[Column], start: int, size: int):
        self.columns, self.part = tuple(columns), slice(start, start + size)
        self.fields = tuple(getattr(robots, column.name) for column in columns)

    def read(self) -> list[np.ndarray]:
        """Return an array of each column over the robots, (size,) or (size, width)."""
        return [
            field.values[self.part].astype(column.dtype)
            for field, column in zip(self.fields, self.columns, strict=True)
        ]

    def write(self, values: Sequence[np.ndarray]) -> None:
        for field, array in zip(self.fields, values, strict=True):
            field[self.part] = array
