"""Reader of recorded robot trajectories and gas readings, from a ROS bag or a run's robots.parquet."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files import bag_readings, bags
from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.files.conventions import FileFacts, spans, when
from taichi_plume.files.readings import MOST
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.scenario.external import Replay

OF_RUN = ("t", "x", "y", "heading", "reading_ppm")
KEYS = {  # options of the maps command, and the keys of a scenario
    "--topic": "topics",
    "--pose": "poses",
    "--reading": "readings",
    "--frame": "frame",
    "--units": "units",
}


class WayError(ValueError):
    """Error: a recording has no usable trajectory; the message is one line."""


@dataclass(frozen=True)
class Way:
    """Trajectory of a robot, sorted by time: t (n,) [s], place (n, 3) [m], heading (n,) [rad], unwrapped.

    Gas readings: read_at (m,) [s], ppm (m,). frame: frame of the positions in a bag, None for those of a domain.
    remarks: what was assumed.
    """

    name: str
    t: np.ndarray
    place: np.ndarray
    heading: np.ndarray
    read_at: np.ndarray
    ppm: np.ndarray
    frame: str | None = None
    remarks: tuple[str, ...] = ()

    def moved(self, origin: Sequence[float]) -> "Way":
        """Return the path in axes in which the origin of its frame lies at `origin`, x and y [m]."""
        return replace(self, place=self.place + np.array([*origin, 0.0]))

    def at(self, t: float) -> tuple[float, ...]:
        """Return x, y, z [m] and heading [rad] interpolated to time t [s], constant outside the recorded times."""
        return tuple(float(np.interp(t, self.t, column)) for column in (*self.place.T, self.heading))


def chosen(replay: Replay, recorded: Sequence[Way], count: int) -> list[Way]:
    """Return the recorded paths for `count` robots: those listed in `robots`, otherwise the first ones."""
    if not replay.robots:
        return list(recorded[:count])
    by_name = {path.name: path for path in recorded}
    return [by_name[name] for name in replay.robots]


def begin_of(replay: Replay, chosen: Sequence[Way]) -> float:
    """Return the time [s] in the recording at which the run starts: its earliest pose plus `start`."""
    return float(min(path.t[0] for path in chosen)) + replay.start


def read(path: Path, options: BagOptions | None = None) -> list[Way]:
    """Return the trajectories in a file; options: for a bag. Readings that cannot be converted to ppm are left out.

    Raises WayError, whose text names the keys of a scenario.
    """
    is_bag = bags.is_bag(path)
    reason = None if is_bag else unopenable(path)
    if reason:
        raise WayError(f"{path}: {reason}")
    try:
        ways = _of_bag(path, options or BagOptions()) if is_bag else _of_run(path)
    except (bags.BagError, RunFolderError) as error:
        raise WayError(_by_keys(str(error))) from None
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


def facts(ways: Sequence[Way], origins: Sequence[Sequence[float]]) -> FileFacts:
    """Return what was read of recorded robots: times, frame, range of positions, readings.

    origins: position [m] in the domain of the origin of the frame of each path.
    """
    low, high = (end(np.stack([end(way.place, axis=0) for way in ways]), axis=0) for end in (np.min, np.max))
    dim = 3 if low[2] or high[2] else 2
    frames = {
        ("the domain" if way.frame is None else f"frame {way.frame}")
        + (f" (origin at ({x:.4g}, {y:.4g}) m of the domain)" if x or y else "")
        for way, (x, y) in zip(ways, origins, strict=True)
    }
    ppm = np.concatenate([way.ppm for way in ways])
    text = [
        f"{len(ways)} robot{'s' if len(ways) > 1 else ''}",
        when(np.sort(np.concatenate([way.t for way in ways]))),
        f"positions in {' and '.join(sorted(frames))}",
        spans(low[:dim], high[:dim]),
        f"{len(ppm):,} readings of at most {ppm.max():.4g} ppm" if len(ppm) else "no readings",
    ]
    assumed = [f"{way.name}: {_by_keys(remark)}" for way in ways for remark in way.remarks]
    return FileFacts(", ".join(text), tuple(assumed))


def _by_keys(text: str) -> str:
    for option, key in KEYS.items():
        text = text.replace(option, key)
    return text


def _of_bag(path: Path, options: BagOptions) -> list[Way]:
    return [
        _way(
            robot.name,
            robot.t,
            robot.place,
            robot.heading,
            robot.read_at,
            robot.ppm,
            robot.frame,
            robot.remarks,
        )
        for robot in bag_readings.read(path, replace(options, lenient=True))
    ]


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
    name: str,
    t: np.ndarray,
    place: np.ndarray,
    heading: np.ndarray,
    read_at: np.ndarray,
    ppm: np.ndarray,
    *more: Any,
) -> Way:
    good = np.isfinite(t) & np.isfinite(place).all(axis=1) & np.isfinite(heading)
    t, first = np.unique(t[good], return_index=True)
    known = np.isfinite(ppm) & np.isfinite(read_at)
    heading = np.unwrap(heading[good][first])
    return Way(name, t, place[good][first], heading, read_at[known], ppm[known].astype(float), *more)
