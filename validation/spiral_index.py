"""Proximity indices at fixed positions in the SPIRAL room: share of records without a peak, order and variation.

As in the paper (section 2): five robots in a row, 30 to 130 cm from the dish, from 15 minutes after its opening. Here
in three directions, for which the arena has room, and two more at the starts of the searches. The robots acquire
indices repeatedly without moving. In the first half minute other robots, farther than 2 m from the dish, acquire the
indices whose mean is the least index of a hit (section 3.2).
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.agents.spiral import FLAT, Spiral
from taichi_plume.assembly.assemble import assemble
from taichi_plume.time_loop import Every, TimeLoop
from taichi_plume.validation.case import Keys
from taichi_plume.validation.experiment import SHARE, Mean, Results, over_airs
from taichi_plume.validation.searches import afresh, scenario_of
from taichi_plume.validation.spiral_room import DISTANCES, OPENED, SOURCE, momo, room

BEGIN = 900.0 - OPENED  # s
LISTENED = 600.0  # s
ROW = (30, 55, 80, 105, 130)  # cm
DIRECTIONS = (135, 180, 225)  # deg
PLACES = tuple((d, a) for a in DIRECTIONS for d in ROW) + tuple((d, 180) for d in DISTANCES)
FAR = {"kind": "area", "low": [1.1, 0.95], "high": [1.4, 2.85]}  # more than 2 m from the dish
FAR_PLACES = 20
FIRST = 40.0  # s, in which these robots have acquired an index
TIMES = (10, 20, 30)  # s, of an acquisition
SHORT = 3  # s, of E. coli
HEIGHTS = ("above_mean", "absolute")
STILL = 1e-3  # m, length of the arms of a robot that stays
Scene = Callable[[int, list[Keys], float], Keys]
"""Function that returns a scenario, as keys of a YAML file, for an air, groups of robots and a duration [s]."""


class Records(NamedTuple):
    """Proximity indices and means [ppm] of successive acquisitions at all positions, (k, positions)."""

    index: np.ndarray
    mean: np.ndarray


class Heard:
    """Log of the proximity indices and means of a team's robots at the end of every acquisition."""

    def __init__(self, team: Any, swarm: Any):
        assert isinstance(team.algorithm, Spiral)
        self.algorithm, self.swarm, self.members = team.algorithm, swarm, team.members
        self.rows: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        self.robots = self.members.robot.to_numpy()
        self.before = np.zeros(self.members.size, int)

    def note(self, sim: TimeLoop) -> None:
        """Append the acquisitions that have ended since the last call to the log."""
        now = self.swarm.acquisitions.to_numpy()[self.robots]
        if (now == self.before).all():
            return
        index, mean = self.algorithm.index.to_numpy(), self.algorithm.acquisition.last.to_numpy()
        end = 0
        for group in self.members.groups:
            begin, end = end, end + group.size
            if (now[begin:end] > self.before[begin:end]).all():
                self.rows.setdefault(group.name, []).append((index[begin:end], mean[begin:end]))
                self.before[begin:end] = now[begin:end]

    def records(self, name: str) -> Records:
        """Return the logged acquisitions of the group called `name`."""
        return Records(*(np.array(part) for part in zip(*self.rows[name], strict=True)))


def _listener(name: str, start: Keys, begin: float, trials: int = 1, **keys: Any) -> Keys:
    """Return a group of robots that acquire indices without moving, as no index is a hit, as keys of a YAML file."""
    stays = {"kind": "spiral", "arms": [STILL] * 100, "minimum_ppm": 1e6}
    return momo(name, trials, start, stays | keys, begin)


def _start() -> Keys:
    angles = np.radians([a for _, a in PLACES])
    reach = np.array([d for d, _ in PLACES]) / 100
    places = np.array(SOURCE) + reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return {"kind": "positions", "positions": np.round(places, 4).tolist(), "heading_deg": 90}


@cache
def heard(air: int, scene: Scene = room) -> tuple[np.ndarray, dict[tuple[int, str], Records]]:
    """Return of an air the first indices far from the dish, and the records by acquisition time and peak height."""
    kinds = [(SHORT, HEIGHTS[0]), *((time, height) for time in TIMES for height in HEIGHTS)]
    groups = [
        _listener(f"{time} {height}", _start(), BEGIN, acquisition=time, peak_height=height)
        for time, height in kinds
    ]
    far = _listener("far", FAR, 0.0, FAR_PLACES)
    data = scene(air, [*groups, far], BEGIN + LISTENED) | {"rivals": True, "stop_early": False}
    afresh()
    sim = assemble(scenario_of(data))
    near, alone = (Heard(team, sim.swarm) for team in sim.teams)
    sim.observers += [Every(sim.dt, log.note) for log in (near, alone)]
    sim.run()
    return alone.records("far").index[0], {kind: near.records(f"{kind[0]} {kind[1]}") for kind in kinds}


def least_index(airs: int, scene: Scene = room) -> float:
    """Return the mean proximity index [ppm] far from the dish, 5 minutes after its opening."""
    return float(np.mean([heard(air, scene)[0] for air in range(airs)]))


def in_order(index: np.ndarray) -> float:
    """Return the fraction of pairs of positions in a direction of which the nearer has the higher index."""
    rows = index[:, : len(ROW) * len(DIRECTIONS)].reshape(len(index), len(DIRECTIONS), len(ROW))
    nearer, farther = np.triu_indices(len(ROW), 1)
    return float((rows[..., nearer] > rows[..., farther]).mean())


def spread(values: np.ndarray) -> np.ndarray:
    """Return the standard deviation in time of ln(values), (k, positions), about its linear trend, per position."""
    log = np.log(np.maximum(values, 1e-6))
    basis = np.column_stack([np.ones(len(log)), np.arange(len(log))])
    rest = log - basis @ np.linalg.lstsq(basis, log, rcond=None)[0]
    return np.sqrt((rest**2).sum(axis=0) / (len(log) - 2))


def indices(trials: int, airs: int, scene: Scene = room) -> Results:
    """Return the statistics of the indices in the room, with intervals over the airs."""
    results: dict[str, Mean] = {}
    records = [heard(air, scene)[1] for air in range(airs)]

    def of(place: tuple[int, int], values: Sequence[np.ndarray]) -> Mean:
        return over_airs([float(spread(record)[PLACES.index(place)]) for record in values])

    usual = [record[TIMES[-1], HEIGHTS[0]] for record in records]
    results["records without a peak"] = over_airs(
        [float((abs(record.index - FLAT * record.mean) <= 1e-4 * record.mean).mean()) for record in usual],
        limits=SHARE,
    )
    for height in HEIGHTS:
        for time in TIMES:
            name = f"pairs in order, {time} s, peaks {height.replace('_', ' ')}"
            results[name] = over_airs(
                [in_order(record[time, height].index) for record in records], limits=SHARE
            )
    for d in (*DISTANCES, ROW[0]):
        results[f"spread of ln(index), {d} cm"] = of((d, 180), [record.index for record in usual])
        short = [record[SHORT, HEIGHTS[0]].mean for record in records]
        results[f"spread of ln(reading of 3 s), {d} cm"] = of((d, 180), short)
    results["least index of a hit [ppm]"] = over_airs(
        [float(heard(air, scene)[0].mean()) for air in range(airs)]
    )
    return results
