"""What is known of every robot, declared once: its unit, its meaning, and who is told.

The swarm's fields, its snapshots (and so results and recordings), `robots.parquet` and what an algorithm of the user's
own sees are made of this. To add a quantity: declare it in `Columns`, and let its sensor or algorithm write it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.agents.few import few

Dtype = type[np.float32] | type[np.int32] | type[np.bool_]


@dataclass
class Column:
    """A quantity of every robot, of which `Columns` holds a field: f32, or i32 for whole numbers and flags.

    width: 2 for vectors. key: its name in snapshots, which do not hold it without one. table: its names in
    `robots.parquet`, one per component; there NaN is null. named: whether its numbers have names, the states of the
    algorithm. shown, told: its name among what an own algorithm reads, or writes. truth: the column that it is one with
    where no robot errs. flies: whether there is one only in swarms some of whose robots fly. pushed: whether there is
    one only where obstacles move.
    """

    unit: str
    meaning: str
    dtype: Dtype = np.float32
    width: int = 1
    key: str = ""
    table: tuple[str, ...] = ()
    named: bool = False
    shown: str = ""
    told: str = ""
    truth: str = ""
    flies: bool = False
    pushed: bool = False
    name: str = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def field(self, n: int) -> Any:
        """A field of it for n robots."""
        dtype = ti.f32 if self.dtype is np.float32 else ti.i32
        return ti.field(dtype, n) if self.width == 1 else ti.Vector.field(self.width, dtype, n)

    def zeros(self, n: int) -> np.ndarray:
        """What snapshots have of it for n robots, all zero."""
        return np.zeros(n if self.width == 1 else (n, self.width), self.dtype)


class Columns:
    """The quantities of all robots, a Taichi field of each; those of `robots.parquet` in its order.

    columns: those that there are: `COLUMNS`, and those of further gas sensors, see `of_noses`.
    """

    columns: "tuple[Column, ...]"

    position: Any = Column("m", "middle of the body", width=2, key="position", table=("x", "y"))
    heading: Any = Column("rad", "from x towards y", key="heading", table=("heading",))
    altitude: Any = Column(
        "m",
        "of the lower end of the body over the floor",
        key="altitude",
        table=("z",),
        shown="altitude",
        flies=True,
    )
    reading: Any = Column(
        "ppm",
        "of the gas sensor; of a laser that gives the integral in ppm m",
        key="reading_ppm",
        table=("reading_ppm",),
        shown="reading",
    )
    resistance: Any = Column(
        "ohm", "of a metal-oxide sensor; others have none", key="resistance_ohm", table=("resistance_ohm",)
    )
    true_ppm: Any = Column(
        "ppm",
        "of all vapours at the gas sensor; of what a laser sees, the mean along its beam",
        key="true_ppm",
        table=("true_ppm",),
    )
    wind: Any = Column(
        "m/s",
        "of the anemometer; zero where it knows of none",
        width=2,
        key="wind",
        table=("wind_x", "wind_y"),
        shown="wind",
    )
    believed_position: Any = Column(
        "m",
        "where the robot believes to be",
        width=2,
        key="believed_position",
        table=("believed_x", "believed_y"),
        shown="position",
        truth="position",
    )
    believed_heading: Any = Column(
        "rad",
        "that the robot believes to have",
        key="believed_heading",
        table=("believed_heading",),
        shown="heading",
        truth="heading",
    )
    state: Any = Column(
        "1", "of the algorithm", np.int32, key="state", table=("state",), named=True, told="state"
    )
    found: Any = Column("1", "whether it has found a source", np.bool_, key="found", table=("found",))

    found_time: Any = Column("s", "when it found a source; NaN before", key="found_time")
    reached_time: Any = Column(
        "s", "when it first came within reach of a source; NaN before", key="reached_time"
    )
    declared_position: Any = Column(
        "m",
        "where it said that a source is, as it believes: the first right place, or else the last; NaN before",
        width=2,
        key="declared_position",
        table=("declared_x", "declared_y"),
    )
    declared_time: Any = Column("s", "when it said so; NaN before", key="declared_time")
    declarations: Any = Column(
        "1", "how often it said where a source is", np.int32, key="declarations", table=("declarations",)
    )
    false_declarations: Any = Column(
        "1",
        "how often there was none within reach of that place",
        np.int32,
        key="false_declarations",
        table=("false_declarations",),
    )
    path_length: Any = Column("m", "driven", key="path_length")
    odometer: Any = Column(
        "m",
        "that the robot believes to have driven",
        key="odometer",
        shown="path_length",
        truth="path_length",
    )
    blocked: Any = Column("1", "whether the bumper feels something", np.bool_, key="blocked", shown="blocked")
    bumps: Any = Column("1", "how often it met something", np.int32, key="bumps")
    pushes: Any = Column(
        "1",
        "how often a moving obstacle ran into the robot",
        np.int32,
        key="pushes",
        table=("pushes",),
        pushed=True,
    )
    pinned_time: Any = Column(
        "s",
        "time inside the disc of a moving obstacle that left the robot no way out, or onto which it was put",
        key="pinned_s",
        table=("pinned_s",),
        pushed=True,
    )
    touched: Any = Column("1", "whether a moving obstacle touches the robot", np.bool_, pushed=True)
    acquisitions: Any = Column("1", "how often it stopped to measure", np.int32, key="acquisitions")
    hits: Any = Column("1", "how often it noticed gas", np.int32, key="hits")
    wind_known: Any = Column("1", "whether the anemometer feels wind", np.bool_, shown="wind_known")
    velocity: Any = Column("m/s", "over the last tick", width=2)
    speed: Any = Column("m/s", "forward, as commanded and limited")
    speed_command: Any = Column("m/s", "forward, that the algorithm wants", told="speed")
    turn_rate_command: Any = Column("rad/s", "that the algorithm wants", told="turn_rate")
    ordered_position: Any = Column("m", "to which it is put from outside; NaN before", width=2)
    ordered_heading: Any = Column("rad", "to which it is put from outside")
    ordered_altitude: Any = Column("m", "to which it is put from outside; NaN before", flies=True)
    climb_rate: Any = Column("m/s", "upward, over the last tick", key="climb_rate", flies=True)
    flight: Any = Column("m/s", "velocity in the room, as commanded and limited", width=3, flies=True)
    acceleration: Any = Column("m/s^2", "of that, by its rotors", width=3, flies=True)
    left_command: Any = Column("m/s", "to its left, that it wants", told="left_speed", flies=True)
    climb_command: Any = Column("m/s", "upward, that it wants", told="climb_rate", flies=True)
    goal: Any = Column("m", "to which it wants to fly; NaN: it goes by its speeds", width=3, flies=True)
    goal_heading: Any = Column("rad", "to which it turns on the way; NaN: by its turn rate", flies=True)

    def _allocate(self, n: int, errs: bool) -> None:
        """Make the fields, of n robots; errs: whether any robot errs in what it believes."""
        for column in self.columns:
            shared = bool(column.truth) and not errs
            setattr(self, column.name, getattr(self, column.truth) if shared else column.field(n))


ALL: tuple[Column, ...] = tuple(one for one in vars(Columns).values() if isinstance(one, Column))
COLUMNS = tuple(one for one in ALL if not one.flies and not one.pushed)
"""Of every swarm."""


def columns_of(flies: bool, pushed: bool = False) -> tuple[Column, ...]:
    """Columns of a swarm; flies: whether any of its robots flies; pushed: whether obstacles move."""
    return tuple(one for one in ALL if one.flies <= flies and one.pushed <= pushed)


OF_A_NOSE = ("reading", "resistance", "true_ppm")
"""What each gas sensor writes."""


def of_noses(most: int) -> tuple[Column, ...]:
    """Columns of the gas sensors behind the first, where the robot with the most has so many: three of each.

    They are those of the first one, with the sensor's number in their names; NaN of robots that have fewer.
    """
    return tuple(
        replace(
            one,
            meaning=f"{one.meaning}; of sensor {k}, from 0 on",
            name=f"{one.name}_{k}",
            key=_numbered(one.key, k),
            table=(_numbered(one.key, k),),
            shown="",
        )
        for k in range(1, most)
        for one in COLUMNS
        if one.name in OF_A_NOSE
    )


def _numbered(key: str, k: int) -> str:
    """``reading_1_ppm`` of ``reading_ppm``."""
    name, _, unit = key.rpartition("_")
    return f"{name}_{k}_{unit}"


class Rows:
    """Some columns of the robots from number `start` on, `size` of them: read or written in one launch."""

    def __init__(self, robots: Columns, columns: Sequence[Column], start: int, size: int):
        self.columns, self.size = tuple(columns), size
        self.begins = tuple(np.cumsum([0, *[one.width for one in columns]]).tolist())
        fields = tuple(getattr(robots, one.name) for one in columns)
        self._get, self._put = _kernels(fields, self.columns, self.begins, start, size)

    def read(self) -> list[np.ndarray]:
        """An array of each column over the robots, (size,) or (size, width)."""
        table = np.empty((self.begins[-1], self.size), np.float32)
        if self.size:
            self._get(table)
        return [self._column(table, c) for c in range(len(self.columns))]

    def _column(self, table: np.ndarray, c: int) -> np.ndarray:
        one, rows = self.columns[c], table[self.begins[c] : self.begins[c + 1]]
        if one.dtype is not np.float32:
            rows = rows.view(np.int32).astype(one.dtype)
        return rows[0].copy() if one.width == 1 else rows.T.copy()

    def write(self, values: Sequence[np.ndarray]) -> None:
        """Set each column."""
        table = np.empty((self.begins[-1], self.size), np.float32)
        for c, (one, array) in enumerate(zip(self.columns, values, strict=True)):
            rows = table[self.begins[c] : self.begins[c + 1]]
            (rows if one.dtype is np.float32 else rows.view(np.int32))[...] = np.asarray(array).T
        if self.size:
            self._put(table)


def _kernels(
    fields: tuple[Any, ...], columns: tuple[Column, ...], begins: tuple[int, ...], start: int, size: int
) -> tuple[Callable[[np.ndarray], None], Callable[[np.ndarray], None]]:
    """Robots' rows to and from a table of f32 (columns, size), whole numbers by their bits."""
    parts = [
        (fields[c], begins[c] + d, d if one.width > 1 else -1, one.dtype is np.float32)
        for c, one in enumerate(columns)
        for d in range(one.width)
    ]

    @ti.kernel
    def get(table: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        ti.loop_config(serialize=ti.static(few(size)))
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
        ti.loop_config(serialize=ti.static(few(size)))
        for n in range(size):
            for field, row, d, real in ti.static(parts):
                if ti.static(not real):
                    field[start + n] = ti.bit_cast(table[row, n], ti.i32)
                elif ti.static(d < 0):
                    field[start + n] = table[row, n]
                else:
                    field[start + n][d] = table[row, n]

    return get, put
