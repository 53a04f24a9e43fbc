"""SPIRAL's room with two persons and a computer, and with ethanol that is heavier than air, see `spiral_room`.

Ferri, Caselli, Mattoli, Mondini, Mazzolai & Dario, Robotics and Autonomous Systems 57 (2009) 393-402, section 5: doors
and windows were shut, and two persons were at a computer in the room. The room of table 2 has none; its air is
synthetic. Here it is computed: the persons give off 50 W each and the computer 100 W to the air, outside the arena, and
walls, floor and ceiling take up the heat. Where and how long they sat is not known. Vapour makes the air heavier.

Robots acquire indices in the same places as in `spiral_index`, and first trials of SPIRAL and of E. coli with 3 s
search the same air. Searches end after 1200 s here, so that those of failures count with fewer acquisitions than in
table 2; `success` says how many failed. The other starts were added after the first run, and are not judged.

Wanted, as written down before any run. Table 2 asks for air in which indices of 30 s scatter much less than readings of
3 s, as its gas fluctuates in seconds (`spiral_cases`). If persons make it so, then from 180 and from 150 cm the scatter
of indices is at most 0.7 times that of readings, and SPIRAL takes the acquisitions of table 2, within two standard
errors.
"""

from collections.abc import Mapping
from functools import cache, partial

import numpy as np

from taichi_plume.validation.case import Comparison, Keys
from taichi_plume.validation.experiment import Condition, Experiment, Mean, Range, Results, over_airs
from taichi_plume.validation.searches import first_trials
from taichi_plume.validation.spiral_cases import NEAR_SPIRAL
from taichi_plume.validation.spiral_index import (
    HEIGHTS,
    PLACES,
    SHORT,
    TIMES,
    heard,
    indices,
    least_index,
)
from taichi_plume.validation.spiral_index import spread as scatter
from taichi_plume.validation.spiral_room import ALGORITHMS, DISTANCES, TABLE_2, at, momo, reading, room

DISCUSSION = """\
Not met: indices of 30 s vary as much as readings of 3 s, as without persons (0.96 and 0.98 times; standard deviation of
the logarithm 0.34 and 0.35 for 0.25 without persons). SPIRAL takes 25 and 22 acquisitions, more than published, and 29
and 15 % of its searches fail within 1200 s.

Met, though not judged: E. coli with 3 s takes the published acquisitions, 64 and 52 (67.8 and 50.3), and the published
time, 433 and 348 s (463 and 353 s), where it takes 39 and 36 without persons. The intervals over four airs are wide (46
to 90 and 40 to 67). Longer acquisitions order the sensors better, by 0.03 of the pairs from 10 to 30 s, without persons
by 0.01.

How SPIRAL starts decides here too: with a first turn towards the dish it takes 9 and 6 acquisitions, with one away from
it 23 and 24. Half of each would take 16 and 15, more than published. So the air of `spiral_room` misses E. coli's rows,
and this air SPIRAL's.
"""
AIRS = 4
LIMIT = 1200.0  # s, after which a search has failed here
PERSON, COMPUTER = 50.0, 100.0  # W, by convection
WALLS = {"temperature": 294.15, "transfer": 3.0}  # K, W/(m² K)
STEADIER = Range(most=0.7)
NAMES = ("SPIRAL", "E. coli 3 s")
STARTS = ("turn first", "turn first, to the right")  # readings of SPIRAL: away from the dish, and towards it
Columns = Mapping[str, np.ndarray]


def occupied(air: int, robots: list[Keys], duration: float) -> Keys:
    """Return the scenario of the room with persons in it, as keys of a YAML file."""
    places = [([0.6, 0.4, 0.7], PERSON), ([1.4, 0.4, 0.7], PERSON), ([1.0, 0.4, 0.4], COMPUTER)]
    heat = {
        "reference": WALLS["temperature"],
        "walls": [{"face": face, **WALLS} for face in ("x-", "x+", "y-", "y+", "z-", "z+")],
        "heaters": [{"position": place, "radius": 0.25, "power": power} for place, power in places],
    }
    wind = {"kind": "cfd", "buoyancy": {"solutal": True, "heat": heat}}
    return room(air, robots, duration) | {"name": "spiral_persons", "wind": wind}


ROOMS = {"without persons": room, "with persons": occupied}


def airs_of(trials: int) -> int:
    """Return the number of airs of so many trials."""
    return min(AIRS, trials)


@cache
def searched(trials: int, name: str, starts: bool = False) -> Mapping[tuple[str, int], Columns]:
    """Return the outcomes of each algorithm and distance in a room of ROOMS, with `time` [s] and `air`.

    starts: whether SPIRAL searches by STARTS, instead of the algorithms of NAMES.
    """
    algorithms = {key: reading(key) for key in STARTS} if starts else {key: ALGORITHMS[key] for key in NAMES}
    least = {"minimum_ppm": least_index(airs_of(trials), ROOMS[name])}
    groups = {
        (key, d): partial(
            momo,
            f"{key} {d}",
            start=at(d),
            algorithm=algorithm | (least if algorithm["kind"] == "spiral" else {}),
        )
        for key, algorithm in algorithms.items()
        for d in DISTANCES
    }
    return first_trials(ROOMS[name], groups, trials, AIRS, LIMIT)


def steadiness(airs: int, name: str, distance: int) -> np.ndarray:
    """Return the scatter of ln(index) of 30 s over that of ln(reading) of 3 s, at a distance [cm], (airs,)."""
    place, ratios = PLACES.index((distance, 180)), []
    for air in range(airs):
        records = heard(air, ROOMS[name])[1]
        long, short = records[TIMES[-1], HEIGHTS[0]].index, records[SHORT, HEIGHTS[0]].mean
        ratios.append(float(scatter(long)[place] / scatter(short)[place]))
    return np.array(ratios)


RATIO = "ln(index) / ln(reading of 3 s), scatter, {} cm".format


def searches(trials: int, name: str, starts: bool = False) -> dict[str, Mean]:
    """Return the results of the searches in a room of ROOMS; starts: see `searched`."""
    results: dict[str, Mean] = {}
    for (key, d), columns in searched(trials, name, starts).items():
        air, label = columns["air"], f"{key}, {d} cm"
        results[f"acquisitions, {label}"] = over_airs(columns["acquisitions"], air)
        results[f"time [s], {label}"] = over_airs(columns["time"], air)
        results[f"success, {label}"] = over_airs(columns["success"], air, share=True)
    return results


def rows(trials: int, name: str) -> Results:
    """Return the searches in a room of ROOMS, and the statistics of its indices."""
    airs = airs_of(trials)
    ratios = {RATIO(d): over_airs(steadiness(airs, name, d)) for d in DISTANCES}
    return {**searches(trials, name), **ratios, **indices(trials, airs, ROOMS[name])}


def _condition(name: str, judged: bool) -> Condition:
    published = {}
    for algorithm in NAMES:
        for d in DISTANCES:
            time, acquisitions = TABLE_2[algorithm, d]
            published[f"acquisitions, {algorithm}, {d} cm"] = str(acquisitions)
            published[f"time [s], {algorithm}, {d} cm"] = str(time)
    expected = {f"acquisitions, SPIRAL, {d} cm": NEAR_SPIRAL[d] for d in DISTANCES}
    expected |= {RATIO(d): STEADIER for d in DISTANCES}
    return Condition(name, partial(rows, name=name), published, expected if judged else {})


CASES = (
    Experiment(
        "spiral_persons",
        "SPIRAL and E. coli in the closed room with two persons and a computer",
        "Ferri et al. 2009, section 5 and table 2",
        (
            *(_condition(name, name == "with persons") for name in ROOMS),
            Condition("with persons, other starts", partial(searches, name="with persons", starts=True)),
        ),
        evidence="published",
        compared=(Comparison("time of searches", r"time \[s\], .*", "with persons"),),
        trials=24 * AIRS,
        test_trials=0,
        discussion=DISCUSSION,
    ),
)
