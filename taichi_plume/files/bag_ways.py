"""The ways of recorded robots, with what their gas sensors read there: of a bag of ROS or a run's robots.parquet."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_plume.files import bag_readings, bags
from taichi_plume.files.bag_readings import Wanted
from taichi_plume.files.readings import MOST
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.opening import unopenable

OF_RUN = ("t", "group", "trial", "robot", "x", "y", "heading", "reading_ppm")


KEYS = {"--topic": "topics", "--pose": "poses"}
"""What options of the maps' command are called in a scenario."""


class WayError(ValueError):
    """A recording that no way is in; the message is one line."""


@dataclass(frozen=True)
class Way:
    """Of one robot, in order of time: t (n,) [s], place (n, 3) [m], heading (n,) [rad], without jumps at half turns.

    Its readings: read_at (m,) [s], ppm (m,); none where they are not known.
    """

    name: str
    t: np.ndarray
    place: np.ndarray
    heading: np.ndarray
    read_at: np.ndarray
    ppm: np.ndarray

    def at(self, t: float) -> tuple[float, ...]:
        """x, y, z [m] and heading [rad] at a time [s]; before the first and after the last that of these."""
        return tuple(float(np.interp(t, self.t, one)) for one in (*self.place.T, self.heading))


def read(
    path: Path, frame: str = "map", topics: tuple[str, ...] = (), poses: tuple[str, ...] = ()
) -> list[Way]:
    """The ways that are in a file. Of a bag, frame: in which places are taken; topics: of gas; poses: topics of them.

    Readings that cannot be turned into ppm are left out. Raises WayError.
    """
    reason = None if bags.is_bag(path) else unopenable(path)
    if reason:
        raise WayError(f"{path}: {reason}")
    try:
        ways = (
            _of_bag(path, Wanted(topics, poses, frame=frame, lenient=True))
            if bags.is_bag(path)
            else _of_run(path)
        )
    except (bags.BagError, RunFolderError) as error:
        text = str(error)
        for option, key in KEYS.items():
            text = text.replace(option, key)
        raise WayError(text) from None
    if not ways or any(not len(one.t) for one in ways):
        raise WayError(f"{path}: has no pose of a robot")
    for one in ways:
        for key, values in (("t", one.t), ("x", one.place), ("reading", one.ppm)):
            largest = float(np.abs(values).max(initial=0.0))
            if largest > MOST[key]:
                what = {"t": "time", "x": "position", "reading": "reading"}[key]
                raise WayError(
                    f"{path}: a {what} of {one.name} is {largest:g}, a mistake: at most {MOST[key]:g} is taken"
                )
    return ways


def _of_bag(path: Path, wanted: Wanted) -> list[Way]:
    return [
        _way(one.name, one.t, one.place, one.heading, one.read_at, one.ppm)
        for one in bag_readings.read(path, wanted)
    ]


def _of_run(path: Path) -> list[Way]:
    """Of the first trial of a run."""
    import pyarrow as pa
    import pyarrow.compute as pc

    from taichi_plume.files import table_parts

    rows = table_parts.batches(path, OF_RUN, optional=("z",))  # of drones
    kept = [batch.filter(pc.equal(batch["trial"], 0)) for batch in rows]
    table = pa.Table.from_batches(kept).unify_dictionaries()
    groups = np.array(table["group"].cast(pa.string()).to_pylist(), object)
    columns = {name: table[name].to_numpy() for name in table.column_names if name != "group"}
    columns["z"] = np.nan_to_num(columns.get("z", np.zeros(len(table))))  # 0 on the floor
    ways = []
    for group in dict.fromkeys(groups):
        for number in np.unique(columns["robot"][groups == group]):
            rows = np.flatnonzero((groups == group) & (columns["robot"] == number))
            t, x, y, z, heading, ppm = (
                columns[name][rows].astype(float) for name in ("t", "x", "y", "z", "heading", "reading_ppm")
            )
            measured = t > 0.0
            place = np.stack([x, y, z], axis=-1)
            ways.append(_way(f"{group} {number}", t, place, heading, t[measured], ppm[measured]))
    return ways


def _way(
    name: str, t: np.ndarray, place: np.ndarray, heading: np.ndarray, read_at: np.ndarray, ppm: np.ndarray
) -> Way:
    good = np.isfinite(t) & np.isfinite(place).all(axis=1) & np.isfinite(heading)
    t, first = np.unique(t[good], return_index=True)
    told = np.isfinite(ppm) & np.isfinite(read_at)
    return Way(
        name, t, place[good][first], np.unwrap(heading[good][first]), read_at[told], ppm[told].astype(float)
    )
