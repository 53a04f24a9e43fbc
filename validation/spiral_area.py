"""SPIRAL and E. coli in an area of twice the length and width, in a room with as much more floor.

Ferri, Caselli, Mattoli, Mondini, Mazzolai & Dario, Robotics and Autonomous Systems 57 (2009) 393-402, end of section 5:
SPIRAL rarely touched the borders, so that a larger area would hardly change its results. E. coli often did and was led
by them to the dish, so that it would lose time in areas with little gas. Section 6 leaves it to future work.

Room and arena of spiral_room are scaled by the same factor, at the same height of the room. The dish stays 0.9 m east
of the arena's middle, and the robots start as far from it as in table 2, so that the borders alone move away. Arms and
escapes keep their lengths. The least index of a hit is determined in each room, as in the paper. Only the first trial
of a session is run: all searches start five minutes after the dish is opened. Failures count with the whole hour.

Wanted, as written down before any run: from both distances the mean time of SPIRAL in the larger area is 0.75 to 1.25
times that in the usual one, that of E. coli with 3 s is at least 1.25 times. Collisions are reported.
"""

from collections.abc import Mapping
from functools import cache, partial

import numpy as np

from taichi_plume.agents.spiral import Spiral
from taichi_plume.assembly.assemble import assemble
from taichi_plume.validation.case import Keys
from taichi_plume.validation.experiment import (
    Condition,
    Experiment,
    Range,
    Results,
    over_airs,
    ratio_over_airs,
)
from taichi_plume.validation.searches import afresh, first_trials, scenario_of
from taichi_plume.validation.spiral_room import ALGORITHMS, DISTANCES, HOUR, at, momo, room

DISCUSSION = """\
Reproduced in part: in the larger area E. coli takes 2.6 and 2.3 times as long from 180 and 150 cm, as wanted, and
SPIRAL 1.3 and 1.8 times. In the usual area SPIRAL takes 1.8 and 1.9 times as long as E. coli, in the larger one 0.9 and
1.5 times.

Not reproduced: SPIRAL's times were wanted within a quarter of those in the usual area. The intervals of their ratios
are wide (0.8 to 1.9 and 1.1 to 2.5), as airs differ. SPIRAL touches a border 1.4 and 1.0 times a search in the usual
area, and 0.3 and 1.0 times in the larger one, so that borders alone do not explain it.
"""
AIRS = 8
LARGER = 2  # times the length and width of the usual area
NAMES = ("SPIRAL", "E. coli 3 s")
MIDDLE, SIZE, DISH = (
    np.array([2.5, 1.9]),
    np.array([3.0, 2.1]),
    np.array([0.9, 0.0]),
)  # m; DISH: from the middle
WALL = 0.1  # m, thickness of the polystyrene walls
FAR, FAR_PLACES = 2.1, 20  # m from the dish, and positions there, of the least index of a hit
FIRST = 40.0  # s, in which a robot completes one acquisition
TIME = "time, larger / usual area"


def area(air: int, robots: list[Keys], duration: float, factor: int) -> Keys:
    """Return the room with an arena of `factor` times the length and width, as keys of a YAML file."""
    data, (low, high) = room(air, robots, duration), _arena(factor)
    length, width, height = data["domain"]["size"]
    (source,) = data["gas"]["sources"]
    x, walls = factor * MIDDLE[0], np.round([low[1] - 0.5 * WALL, high[1] + 0.5 * WALL], 3)
    return data | {
        "domain": data["domain"] | {"size": [factor * length, factor * width, height]},
        "obstacles": [
            box | {"center": [x, y, box["center"][2]], "size": [factor * SIZE[0], *box["size"][1:]]}
            for box, y in zip(data["obstacles"], walls, strict=True)
        ],
        "arena": {"low": low.tolist(), "high": high.tolist()},
        "gas": data["gas"] | {"sources": [source | {"position": [*_dish(factor), source["position"][2]]}]},
    }


def _arena(factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the arena with the least and the largest coordinates [m]."""
    return np.round(factor * (MIDDLE - 0.5 * SIZE), 3), np.round(factor * (MIDDLE + 0.5 * SIZE), 3)


def _dish(factor: int) -> list[float]:
    """Return the position of the dish [m]."""
    return np.round(factor * MIDDLE + DISH, 3).tolist()


def start(distance: int, factor: int) -> Keys:
    """Return a start, as keys, at a distance [cm] from the dish, heading across the direction to the dish."""
    x, y = _dish(factor)
    return at(distance) | {"positions": [[round(x - distance / 100, 3), y]]}


def least_index(factor: int) -> float:
    """Return the mean proximity index [ppm] far from the dish, 5 minutes after its opening."""
    low, high = _arena(factor)
    places = {"kind": "area", "low": (low + 0.1).tolist(), "high": [_dish(factor)[0] - FAR, high[1] - 0.1]}
    stays = {"kind": "spiral", "arms": [1e-3] * 3, "minimum_ppm": 1e6}
    means = []
    for air in range(AIRS):
        afresh()
        far = momo("far", FAR_PLACES, places, stays)
        sim = assemble(scenario_of(area(air, [far], FIRST, factor)))
        sim.run()
        algorithm = sim.teams[0].algorithm
        assert isinstance(algorithm, Spiral)
        means.append(algorithm.index.to_numpy().mean())
    return float(np.mean(means))


@cache
def searched(trials: int, factor: int) -> Mapping[tuple[str, int], Mapping[str, np.ndarray]]:
    """Return the outcomes of each algorithm and distance with so many trials, in all airs, with `time` and `air`."""
    least = {"SPIRAL": {"minimum_ppm": least_index(factor)}}
    groups = {
        (name, d): partial(
            momo, f"{name} {d}", start=start(d, factor), algorithm=ALGORITHMS[name] | least.get(name, {})
        )
        for name in NAMES
        for d in DISTANCES
    }
    return first_trials(partial(area, factor=factor), groups, trials, AIRS, HOUR)


def compare(trials: int, row: tuple[str, int]) -> Results:
    """Return the results for an algorithm from a distance [cm] in both areas."""
    usual, larger = (searched(trials, factor)[row] for factor in (1, LARGER))
    results = {TIME: ratio_over_airs(larger["time"], usual["time"], larger["air"], usual["air"])}
    for name, columns in (("usual", usual), ("larger", larger)):
        air = columns["air"]
        results |= {
            f"success, {name} area": over_airs(columns["success"], air, share=True),
            f"time [s], {name} area": over_airs(columns["time"], air),
            f"acquisitions, {name} area": over_airs(columns["acquisitions"], air),
            f"bumps, {name} area": over_airs(columns["bumps"], air),
        }
    return results


EXPECTED = {"SPIRAL": Range(0.75, 1.25), "E. coli 3 s": Range(least=1.25)}
CASES = (
    Experiment(
        "spiral_table2_larger_area",
        f"SPIRAL and E. coli in an area of {LARGER} times the length and width, in {AIRS} airs",
        "Ferri et al. 2009, section 5",
        tuple(
            Condition(f"{name}, {d} cm", partial(compare, row=(name, d)), expected={TIME: EXPECTED[name]})
            for name in NAMES
            for d in DISTANCES
        ),
        evidence="published",
        compared="the paper gives the larger area no times, only that they changed or not",
        trials=16 * AIRS,
        test_trials=0,
        discussion=DISCUSSION,
    ),
)
