"""Columns: the state and readings of every robot, each declared once with its unit, its meaning and its users.

The swarm's Taichi fields, its snapshots (and so results and recordings), `robots.parquet` and the arrays that an
algorithm of the user's own sees are made of this table. To add a quantity, declare it in `Columns` and let its sensor
or algorithm write it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import taichi as ti

from taichi_plume.agents.serial import runs_serially
from taichi_plume.grid.kernels import Field

Dtype = type[np.float32] | type[np.int32] | type[np.bool_]


@dataclass
class Column:
    """A quantity of every robot, of which `Columns` holds a field: f32, or i32 for whole numbers and flags.

    width: 2 for vectors. key: its name in snapshots, * is that of the column; empty if snapshots leave it out.
    tabled: whether `robots.parquet` has it, under its key or under the names in `components`; there NaN is null.
    named: whether its numbers have names, the states of the algorithm. read_as, written_as: its name among the arrays
    that an own algorithm reads, or writes. truth: the column whose field it shares if no robot has odometry errors.
    flies: whether only swarms with drones have it. pushed: whether only swarms among moving obstacles have it.
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

    def __get__(self, instance: object, owner: type) -> Field:
        return self  # of the class; a swarm's own attribute of this name is its field

    @property
    def table(self) -> tuple[str, ...]:
        """Names of the columns of `robots.parquet`, one per component."""
        return self.components or ((self.key,) if self.tabled else ())

    def field(self, n: int) -> Field:
        """Return a field for n robots."""
        dtype = ti.f32 if self.dtype is np.float32 else ti.i32
        return ti.field(dtype, n) if self.width == 1 else ti.Vector.field(self.width, dtype, n)

    def zeros(self, n: int) -> np.ndarray:
        """Return the array that snapshots have for n robots, all zero."""
        return np.zeros(n if self.width == 1 else (n, self.width), self.dtype)


class Columns:
    """The quantities of all robots, a Taichi field of each; those of `robots.parquet` in its order.

    columns: the columns of this swarm: `columns_of`, and `further_gas_sensors` for further gas sensors.
    """

    columns: tuple[Column, ...]

    position = Column("m", "middle of the body", width=2, components=("x", "y"))
    heading = Column("rad", "from x towards y", tabled=True)
    altitude = Column(
        "m", "of the lower end of the body over the floor", components=("z",), read_as="altitude", flies=True
    )
    reading = Column(
        "ppm",
        "of the gas sensor; of a laser that gives the integral in ppm m",
        key="reading_ppm",
        tabled=True,
        read_as="reading",
    )
    resistance = Column("ohm", "of a metal-oxide sensor; others have none", key="resistance_ohm", tabled=True)
    true_ppm = Column(
        "ppm", "of all vapours at the gas sensor; of what a laser sees, the mean along its beam", tabled=True
    )
    wind = Column(
        "m/s",
        "of the anemometer; zero where it knows of none",
        width=2,
        components=("wind_x", "wind_y"),
        read_as="wind",
    )
    believed_position = Column(
        "m",
        "where the robot believes to be",
        width=2,
        components=("believed_x", "believed_y"),
        read_as="position",
        truth="position",
    )
    believed_heading = Column(
        "rad", "that the robot believes to have", tabled=True, read_as="heading", truth="heading"
    )
    state = Column("1", "of the algorithm", np.int32, tabled=True, named=True, written_as="state")
    found = Column("1", "whether it has found a source", np.bool_, tabled=True)
    found_time = Column("s", "when it found a source; NaN before")
    reached_time = Column("s", "when it first came within reach of a source; NaN before")
    declared_position = Column(
        "m",
        "where it said that a source is, as it believes: the first right place, or else the last; NaN before",
        width=2,
        components=("declared_x", "declared_y"),
    )
    declared_time = Column("s", "when it said so; NaN before")
    declarations = Column("1", "how often it said where a source is", np.int32, tabled=True)
    false_declarations = Column(
        "1", "how often there was none within reach of that place", np.int32, tabled=True
    )
    path_length = Column("m", "driven")
    odometer = Column(
        "m", "that the robot believes to have driven", read_as="path_length", truth="path_length"
    )
    blocked = Column("1", "whether the bumper feels something", np.bool_, read_as="blocked")
    bumps = Column("1", "how often it met something", np.int32)
    pushes = Column("1", "how often a moving obstacle ran into the robot", np.int32, tabled=True, pushed=True)
    pinned_time = Column(
        "s",
        "time inside the disc of a moving obstacle that left the robot no way out, or onto which it was put",
        key="pinned_s",
        tabled=True,
        pushed=True,
    )
    touched = Column("1", "whether a moving obstacle touches the robot", np.bool_, key="", pushed=True)
    acquisitions = Column("1", "how often it stopped to measure", np.int32)
    hits = Column("1", "how often it noticed gas", np.int32)
    wind_known = Column("1", "whether the anemometer feels wind", np.bool_, key="", read_as="wind_known")
    velocity = Column("m/s", "over the last tick", key="", width=2)
    speed = Column("m/s", "forward, as commanded and limited", key="")
    speed_command = Column("m/s", "forward, that the algorithm wants", key="", written_as="speed")
    turn_rate_command = Column("rad/s", "that the algorithm wants", key="", written_as="turn_rate")
    ordered_position = Column("m", "to which it is put from outside; NaN before", key="", width=2)
    ordered_heading = Column("rad", "to which it is put from outside", key="")
    ordered_altitude = Column("m", "to which it is put from outside; NaN before", key="", flies=True)
    climb_rate = Column("m/s", "upward, over the last tick", flies=True)
    flight = Column("m/s", "velocity in the room, as commanded and limited", key="", width=3, flies=True)
    acceleration = Column("m/s^2", "of that, by its rotors", key="", width=3, flies=True)
    left_command = Column("m/s", "to its left, that it wants", key="", written_as="left_speed", flies=True)
    climb_command = Column("m/s", "upward, that it wants", key="", written_as="climb_rate", flies=True)
    goal = Column("m", "to which it wants to fly; NaN: it goes by its speeds", key="", width=3, flies=True)
    goal_heading = Column("rad", "to which it turns on the way; NaN: by its turn rate", key="", flies=True)

    def _allocate(self, n: int, errs: bool) -> None:
        """Make the fields of n robots; errs: whether any robot has odometry errors."""
        for column in self.columns:
            shared = bool(column.truth) and not errs
            setattr(self, column.name, getattr(self, column.truth) if shared else column.field(n))


ALL: tuple[Column, ...] = tuple(column for column in vars(Columns).values() if isinstance(column, Column))
COLUMNS = tuple(column for column in ALL if not column.flies and not column.pushed)
"""Columns of every swarm."""


def columns_of(flies: bool, pushed: bool = False) -> tuple[Column, ...]:
    """Return the columns of a swarm; flies: whether any robot flies; pushed: whether obstacles move."""
    return tuple(column for column in ALL if column.flies <= flies and column.pushed <= pushed)


OF_A_GAS_SENSOR = ("reading", "resistance", "true_ppm")
"""Columns that each gas sensor writes."""


def further_gas_sensors(most: int) -> tuple[Column, ...]:
    """Return the columns of all gas sensors but the first, three each; most: largest number of gas sensors of a robot.

    They are the first sensor's columns with the sensor's number in their names; NaN for robots with fewer sensors.
    """
    return tuple(
        replace(
            column,
            meaning=f"{column.meaning}; of sensor {k}, from 0 on",
            name=f"{column.name}_{k}",
            key=f"_{k}_".join(column.key.rsplit("_", 1)),  # reading_1_ppm
            read_as="",
        )
        for k in range(1, most)
        for column in COLUMNS
        if column.name in OF_A_GAS_SENSOR
    )


class Rows:
    """Some columns of `size` robots from number `start` on: read or written in one launch."""

    def __init__(self, robots: Columns, columns: Sequence[Column], start: int, size: int):
        self.columns, self.size = tuple(columns), size
        self.begins = tuple(np.cumsum([0, *[column.width for column in columns]]).tolist())
        fields = tuple(getattr(robots, column.name) for column in columns)
        self._get, self._put = _kernels(fields, self.columns, self.begins, start, size)

    def read(self) -> list[np.ndarray]:
        """Return an array of each column over the robots, (size,) or (size, width)."""
        table = np.empty((self.begins[-1], self.size), np.float32)
        if self.size:
            self._get(table)
        return [self._column(table, c) for c in range(len(self.columns))]

    def _column(self, table: np.ndarray, c: int) -> np.ndarray:
        column, rows = self.columns[c], table[self.begins[c] : self.begins[c + 1]]
        if column.dtype is not np.float32:
            rows = rows.view(np.int32).astype(column.dtype)
        return rows[0].copy() if column.width == 1 else rows.T.copy()

    def write(self, values: Sequence[np.ndarray]) -> None:
        table = np.empty((self.begins[-1], self.size), np.float32)
        for c, (column, array) in enumerate(zip(self.columns, values, strict=True)):
            rows = table[self.begins[c] : self.begins[c + 1]]
            (rows if column.dtype is np.float32 else rows.view(np.int32))[...] = np.asarray(array).T
        if self.size:
            self._put(table)


def _kernels(
    fields: tuple[Field, ...], columns: tuple[Column, ...], begins: tuple[int, ...], start: int, size: int
) -> tuple[Callable[[np.ndarray], None], Callable[[np.ndarray], None]]:
    """Return kernels that copy the columns to and from a table of f32 (components, size), integers by their bits."""
    parts = [
        (fields[c], begins[c] + d, d if column.width > 1 else -1, column.dtype is np.float32)
        for c, column in enumerate(columns)
        for d in range(column.width)
    ]

    @ti.kernel
    def get(table: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        ti.loop_config(serialize=ti.static(runs_serially(size)))
        for n in range(size):
            for field, row, d, real in ti.static(parts):
                if ti.static(not real):
                    table[row, n] = ti.bit_cast(field[start + n], ti.f32)
                elif ti.static(d < 0):
                    table[row, n] = field[start + n]
                else:
                    table[row, n] = field[start + n][d]

    @ti.kernel
    def put(table: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        ti.loop_config(serialize=ti.static(runs_serially(size)))
        for n in range(size):
            for field, row, d, real in ti.static(parts):
                if ti.static(not real):
                    field[start + n] = ti.bit_cast(table[row, n], ti.i32)
                elif ti.static(d < 0):
                    field[start + n] = table[row, n]
                else:
                    field[start + n][d] = table[row, n]

    return get, put
