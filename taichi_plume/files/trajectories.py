"""Reader of recorded robot trajectories and gas readings, from a ROS bag or a run's robots.parquet."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_plume.files import bag_readings, bags
from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.files.readings import MOST
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.safe_open import unopenable

OF_RUN = ("t", "x", "y", "heading", "reading_ppm")
KEYS = {"--topic": "topics", "--pose": "poses"}  # options of the maps command, and the keys of a scenario


class WayError(ValueError):
    """Error: a recording has no usable trajectory; the message is one line."""


@dataclass(frozen=True)
class Way:
    """Trajectory of a robot, sorted by time: t (n,) [s], place (n, 3) [m], heading (n,) [rad], unwrapped.

    Gas readings: read_at (m,) [s], ppm (m,).
    """

    name: str
    t: np.ndarray
    place: np.ndarray
    heading: np.ndarray
    read_at: np.ndarray
    ppm: np.ndarray

    def at(self, t: float) -> tuple[float, ...]:
        """Return x, y, z [m] and heading [rad] interpolated to time t [s], constant outside the recorded times."""
        return tuple(float(np.interp(t, self.t, column)) for column in (*self.place.T, self.heading))


def read(
    path: Path, frame: str = "map", topics: tuple[str, ...] = (), poses: tuple[str, ...] = ()
) -> list[Way]:
    """Return the trajectories in a file. For a bag: frame of the positions, gas topics, pose topics (`poses`).

    Readings that cannot be converted to ppm are left out. Raises WayError.
    """
    is_bag = bags.is_bag(path)
    reason = None if is_bag else unopenable(path)
    if reason:
        raise WayError(f"{path}: {reason}")
    try:
        options = BagOptions(topics, poses, frame=frame, lenient=True)
        ways = _of_bag(path, options) if is_bag else _of_run(path)
    except (bags.BagError, RunFolderError) as error:
        text = str(error)
        for option, key in KEYS.items():
            text = text.replace(option, key)
        raise WayError(text) from None
    if not ways or any(not len(way.t) for way in ways):
        raise WayError(f"{path}: has no pose of a robot")
    for way in ways:
        for what, values, most in (
            ("time", way.t, MOST["t"]),
            ("position", way.place, MOST["x"]),
            ("reading", way.ppm, MOST["reading"]),
        ):
            largest = float(np.abs(values).max(initial=0.0))
            if largest > most:
                raise WayError(f"{path}: a {what} of {way.name} is {largest:g}, a mistake; at most {most:g}")
    return ways


def _of_bag(path: Path, options: BagOptions) -> list[Way]:
    robots = bag_readings.read(path, options)
    return [_way(r.name, r.t, r.place, r.heading, r.read_at, r.ppm) for r in robots]


def _of_run(path: Path) -> list[Way]:
    """Return the robots' trajectories in the first trial of a run, from its robots.parquet."""
    from taichi_plume.files import run_tables

    ways = []
    for (group, number), columns in run_tables.robots_of(path, OF_RUN, 0)[0].items():
        t, x, y, z, heading, ppm = (columns[name].astype(float) for name in (*OF_RUN[:3], "z", *OF_RUN[3:]))
        measured = t > 0.0
        place = np.stack([x, y, z], axis=-1)
        ways.append(_way(f"{group} {number}", t, place, heading, t[measured], ppm[measured]))
    return ways


def _way(
    name: str, t: np.ndarray, place: np.ndarray, heading: np.ndarray, read_at: np.ndarray, ppm: np.ndarray
) -> Way:
    good = np.isfinite(t) & np.isfinite(place).all(axis=1) & np.isfinite(heading)
    t, first = np.unique(t[good], return_index=True)
    known = np.isfinite(ppm) & np.isfinite(read_at)
    ppm = ppm[known].astype(float)
    return Way(name, t, place[good][first], np.unwrap(heading[good][first]), read_at[known], ppm)
