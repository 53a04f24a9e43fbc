"""SPIRAL experiment, parameters that the paper leaves open: do any of them give the published acquisitions?

Ferri et al., Robotics and Autonomous Systems 57 (2009) 393-402, table 2: 11.5 acquisitions (standard deviation 4.3)
from 180 cm and 9.2 (2.7) from 150 cm in 15 trials each. Reached is what lies within two standard errors of both means.

Given, and not varied: arena, dish, distances, heading, 0.2 m/s, acquisitions of 30 s of samples of 0.5 s, windows of
5 s, weights 1 and 0.5 (2 without a peak). So are misses (5, or 3 below half), 5 minutes before the first trial, and
four trials in a session.

Open, with bounds set before any run of this scan:

    arm             length of the first arm [m]: suits an arena of 2.1 m.
    growth          growth of the arms every second arm, over the first: figure 5 shows a spiral, without lengths.
    arms            number of arms: more than five, or five misses in a row never come about.
    reach           half of the square that the robot reaches [m]: its centre (0.1) or its edge (0.185).
    settle          time of standing before an acquisition [s]: published times leave up to 2 s.
    delta           lowering of the threshold, over the minimum: a "positive design parameter".
    minimum         minimum threshold, over the mean index of 20 places: the paper's places and day are not given.
    strict          whether an index below the minimum is never a hit: section 3.2 can be read both ways.
    absolute        whether the whole height of a peak counts, or that above the mean: section 3.1 does not say.
    gradient        side of turning at a bump, by the spiral or by the best index: section 3.2 names both.
    escape          length of an escape [m]: a "design parameter".
    rise, decay     time constants of the TGS 800 [s]: its sheet has none; recovery takes tens of seconds at most.
    noise           noise of a reading, of ln R: 0 to 1 %.
    height          height of the sensor over the floor [m]: the robot is about 0.2 m high.
    pause           time between the trials of a session [s]. The scan runs first trials, which it does not affect.
    speed           root mean square of the eddies [m/s]: below or about what anemometers detect (1 to 5 cm/s).
    longest         largest eddies [m]: from the size of people to that of the room.
    circulation     rolls that fill the room [m/s].
    turning         time in which the rolls change [s].
    unsteadiness    rate of change of eddies over that of their own turning.
    temperature     of the dish [K]: 15 to 30 degrees C, evaporation by a factor of 2.4.
    length          of the room [m], which sets its volume: the drawing has no scale besides the arena.

The usual air mixes the room as one with 1.3 air changes per hour, about twice as much as that of `spiral_table2`; its
values were the defaults of `synthetic` when the scan was made. A search ends after 1200 s, and counts with its
acquisitions until then: fewer than in the end, in favour of the paper.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from taichi_plume.assembly.assemble import assemble
from taichi_plume.scoring.trials import mean_with_interval
from taichi_plume.time_loop import Every, TimeLoop
from taichi_plume.validation.case import Keys
from taichi_plume.validation.experiment import (
    Condition,
    Experiment,
    Mean,
    Results,
    over_airs,
    ratio_over_airs,
)
from taichi_plume.validation.parameter_scan import (
    Open,
    Point,
    blocks,
    one_at_a_time,
    rank_correlations,
    usual,
    way_to_least,
)
from taichi_plume.validation.searches import afresh, contest, race, scenario_of
from taichi_plume.validation.spiral_floor import searched_on_floor
from taichi_plume.validation.spiral_index import FAR, FAR_PLACES, STILL, Heard
from taichi_plume.validation.spiral_room import (
    ALGORITHMS,
    DISTANCES,
    OPENED,
    SESSION,
    TABLE_2,
    at,
    momo,
    room,
)

LIMIT = 1200.0  # s, of a search
BLOCKS, EACH = 16, 32  # airs of the joint space, and points in each
AIRS = 4  # of the usual values
AIRS_OF_SIDES = 1  # of each side of a parameter of the air
PAIRED = 4  # airs of promising points
AIRS_OF_BEST = 8
WAY = (0.5, 0.75, 1.0)  # shares of the way from the usual values to the fewest acquisitions
PUBLISHED = np.array([TABLE_2["SPIRAL", d].acquisitions.mean for d in DISTANCES])
ERRORS = np.array([TABLE_2["SPIRAL", d].acquisitions.error for d in DISTANCES])
TICK = 0.5  # s, of a sample; half as many as in spiral_room
FIRST = 40.0  # s before the searches, in which robots far from the dish have acquired an index

PARAMETERS = (
    Open("arm", 0.3, 0.6, 0.4),
    Open("growth", 0.5, 1.0, 1.0),
    Open("arms", 6, 8, 6, "whole"),
    Open("reach", 0.1, 0.185, 0.185),
    Open("settle", 0.0, 2.0, 1.0),
    Open("delta", 0.05, 0.9, 0.2, "log"),
    Open("minimum", 0.5, 2.0, 1.0, "log"),
    Open("strict", 0, 1, 0, "whole"),
    Open("absolute", 0, 1, 0, "whole"),
    Open("gradient", 0, 1, 0, "whole"),
    Open("escape", 0.4, 1.5, 0.75),
    Open("rise", 1.0, 10.0, 4.0, "log"),
    Open("decay", 5.0, 40.0, 20.0, "log"),
    Open("noise", 0.0, 0.01, 0.003),
    Open("height", 0.05, 0.2, 0.1),
    Open("pause", 0.0, 180.0, 60.0),
    Open("speed", 0.01, 0.05, 0.03, "log", of_air=True),
    Open("longest", 0.7, 2.5, 1.4, "log", of_air=True),
    Open("circulation", 0.002, 0.02, 0.0075, "log", of_air=True),
    Open("turning", 30.0, 180.0, 60.0, "log", of_air=True),
    Open("unsteadiness", 0.25, 1.0, 0.5, "log", of_air=True),
    Open("temperature", 288.15, 303.15, 294.15, of_air=True),
    Open("length", 4.5, 7.0, 5.0, of_air=True),
)


def air_of(point: Point, air: int, robots: list[Keys], duration: float) -> Keys:
    """Return the scenario of the room with the parameters `of_air` of a point, in control periods of TICK."""
    keys = room(air, robots, duration)
    keys["warm_up"] = OPENED - FIRST
    keys["domain"]["size"] = [round(point["length"], 1), 4.0, 2.5]
    keys["wind"] |= {
        "speed": point["speed"],
        "longest": point["longest"],
        "circulation": point["circulation"],
        "circulation_time": point["turning"],
        "unsteadiness": point["unsteadiness"],
    }
    keys["gas"]["sources"][0]["dish"]["temperature"] = point["temperature"]
    return keys | {"rivals": True, "tick": TICK}


def spiral_of(point: Point) -> Keys:
    """Return the algorithm of a point, without the minimum threshold, which `Minimum` sets."""
    return {
        "kind": "spiral",
        "settle": point["settle"],
        "delta": point["delta"],
        "arms": [
            round(point["arm"] * (1.0 + point["growth"] * (k // 2)), 4) for k in range(int(point["arms"]))
        ],
        "escape_length": point["escape"],
        "strict_minimum": bool(point["strict"]),
        "peak_height": "absolute" if point["absolute"] else "above_mean",
        "bump_side": "gradient" if point["gradient"] else "spiral",
    }


def searcher(name: str, point: Point, trials: int, start: Keys, algorithm: Keys, begin: float = 0.0) -> Keys:
    """Return a group of robots with the sensor and the goal of a point."""
    group = momo(name, trials, start, algorithm, begin) | {"reach": point["reach"]}
    group["sensors"]["gas"] |= {
        "rise_time": point["rise"],
        "decay_time": point["decay"],
        "reading_noise": point["noise"],
        "height": point["height"],
    }
    return group


class Minimum:
    """Observer that sets the minimum of each point to its mean index far from the dish, before searches begin.

    sim: with the searches of `points` in groups called "point distance place", and in "point far" robots that stay.
    """

    def __init__(self, sim: TimeLoop, points: Sequence[Point]):
        *self.teams, far = sorted(sim.teams, key=lambda team: "far" in team.members.groups[0].name)
        self.points, self.log, self.is_set = points, Heard(far, sim.swarm), False
        sim.observers.append(Every(sim.dt, self.note))

    def note(self, sim: TimeLoop) -> None:
        """Log the acquisitions, and set the minima at FIRST."""
        if self.is_set:
            return
        self.log.note(sim)
        if sim.t >= FIRST:
            for team in self.teams:
                for group in team.members.groups:
                    number = int(group.name.split()[0])
                    index = float(self.log.records(f"{number} far").index[0].mean())
                    vars(group.model.algorithm)["minimum_ppm"] = self.points[number]["minimum"] * index
                team.algorithm = type(team.algorithm)(sim.swarm, team.members, sim.dt)
            self.is_set = True


def begins(point: Point, distance: int, places: Sequence[int]) -> list[float]:
    """Return the starts [s] of trials by their `places` in a session, a mean published time and a pause apart."""
    between = TABLE_2["SPIRAL", distance].time.mean + point["pause"]
    return [round(FIRST + TICK + k * between, 1) for k in places]


def searched(points: Sequence[Point], air: int, trials: int, places: Sequence[int] = (0,)) -> np.ndarray:
    """Return the acquisitions of searches in the air of the first point, (points, distances, trials).

    trials: of each distance and place in a session.
    """
    stays = {"arms": [STILL] * 100, "minimum_ppm": 1e6}
    far = [
        searcher(f"{n} far", point, FAR_PLACES, FAR, spiral_of(point) | stays)
        for n, point in enumerate(points)
    ]
    groups = [
        searcher(f"{n} {d} {k}", point, trials, at(d), spiral_of(point), begin)
        for n, point in enumerate(points)
        for d in DISTANCES
        for k, begin in zip(places, begins(point, d, places), strict=True)
    ]
    end = max(group["begin"] for group in groups) + LIMIT
    afresh()
    sim = assemble(scenario_of(air_of(points[0], air, groups + far, end)))
    Minimum(sim, points)
    columns = race(sim, LIMIT)
    rows = [columns[group["name"]]["acquisitions"] for group in groups]
    return np.array(rows, float).reshape(len(points), len(DISTANCES), -1)


def chi_square(means: np.ndarray) -> np.ndarray:
    """Return the sum over distances, the last axis, of squared deviations in published standard errors."""
    return (((means - PUBLISHED) / ERRORS) ** 2).sum(axis=-1)


def reaches(means: np.ndarray) -> np.ndarray:
    """Return whether the means of both distances, on the last axis, lie within two published standard errors."""
    return np.all(abs(means - PUBLISHED) <= 2.0 * ERRORS, axis=-1)


# ---------------------------------------------------------------- conditions


def one_by_one(trials: int) -> Results:
    """Return the ratio of acquisitions, of both distances together, between the two sides of each parameter."""
    pairs = one_at_a_time(PARAMETERS)
    of_robots = [pair for pair in pairs if not pair[0].of_air]
    points = [usual(PARAMETERS), *(side for _, *sides in of_robots for side in sides)]
    found = np.array([searched(points, air, trials) for air in range(AIRS)])
    means = found.mean(axis=-1)  # (airs, points, distances)
    results = _of_distances("usual values", means[:, 0])
    ratios = {
        parameter.name: (means[:, 1 + 2 * n].mean(axis=-1), means[:, 2 + 2 * n].mean(axis=-1))
        for n, (parameter, *_) in enumerate(of_robots)
    }
    for parameter, *sides in pairs:
        if parameter.of_air:
            low, high = (
                np.array([searched([side], air, 2 * trials).mean() for air in range(AIRS_OF_SIDES)])
                for side in sides
            )
            ratios[parameter.name] = low, high
    for parameter, low, high in pairs:
        below, above = ratios[parameter.name]
        name = f"{parameter.name}, {high[parameter.name]:.3g} / {low[parameter.name]:.3g}"
        results[name] = ratio_over_airs(above, below)
    return results


@cache
def joint(trials: int) -> tuple[list[Point], np.ndarray]:
    """Return points of the joint space, and their mean acquisitions (points, distances), each block in its own air."""
    parts = blocks(PARAMETERS, BLOCKS, EACH)
    found = [searched(part, air, trials).mean(axis=-1) for air, part in enumerate(parts)]
    return [point for part in parts for point in part], np.concatenate(found)


def joint_space(trials: int) -> Results:
    """Return rank correlations of acquisitions with each parameter, and the share of points that reach both means."""
    points, means = joint(trials)
    number = len(points)
    results: dict[str, Mean] = {
        "points that reach both means, by chance or not": Mean(
            float(reaches(means).mean()), None, None, number
        )
    }
    for name, part in zip(
        ("least", "median", "largest"), np.quantile(means, (0.0, 0.5, 1.0), axis=0), strict=True
    ):
        for d, value in zip(DISTANCES, part, strict=True):
            results[f"{name} acquisitions of a point, {d} cm"] = Mean(float(value), None, None, number)
    for name, rank in rank_correlations(PARAMETERS, points, means.mean(axis=-1)).items():
        results[f"rank correlation with {name}"] = Mean(rank, None, None, number)
    return results


@cache
def promising(trials: int) -> list[Point]:
    """Return points on the way from the usual values to the fewest acquisitions by the response surface."""
    return way_to_least(PARAMETERS, *joint(trials), WAY)


@cache
def repeated(trials: int) -> tuple[np.ndarray, ...]:
    """Return the mean acquisitions (airs, distances) of each point of `promising` in new airs."""
    return tuple(
        np.array([searched([point], BLOCKS + air, 2 * trials)[0].mean(axis=-1) for air in range(PAIRED)])
        for point in promising(trials)
    )


def promising_points(trials: int) -> Results:
    """Return the acquisitions of the promising points in new airs."""
    results: dict[str, Mean] = {}
    for share, means in zip(WAY, repeated(trials), strict=True):
        results |= _of_distances(f"{share:g} of the way to the fewest", means)
    return results


def best_point(trials: int) -> Results:
    """Return the best of the promising points: its values, and rows of table 2 by it, SPIRAL's in full sessions."""
    point = promising(trials)[int(np.argmin([chi_square(means.mean(axis=0)) for means in repeated(trials)]))]
    results: dict[str, Mean] = {name: Mean(float(value), None, None, 1) for name, value in point.items()}
    airs = range(BLOCKS + PAIRED, BLOCKS + PAIRED + AIRS_OF_BEST)
    spiral = [searched([point], air, trials, range(SESSION))[0].mean(axis=-1) for air in airs]
    bacteria = [ecoli(point, air, 4 * trials) for air in airs]
    results |= _of_distances("SPIRAL", np.array(spiral)) | _of_distances("E. coli 3 s", np.array(bacteria))
    for d, steps in zip(DISTANCES, blind(point, 32 * trials), strict=True):
        results[f"random SPIRAL, {d} cm"] = Mean(**mean_with_interval(steps))
    return results


def ecoli(point: Point, air: int, trials: int) -> np.ndarray:
    """Return the mean acquisitions of E. coli with 3 s in the air of a point, (distances,)."""
    algorithm = ALGORITHMS["E. coli 3 s"] | {"settle": point["settle"]}
    groups = [searcher(str(d), point, trials, at(d), algorithm, FIRST) for d in DISTANCES]
    afresh()
    columns = contest(air_of(point, air, groups, FIRST + LIMIT), limit=LIMIT)
    return np.array([np.mean(columns[str(d)]["acquisitions"]) for d in DISTANCES])


def blind(point: Point, trials: int) -> list[np.ndarray]:
    """Return the acquisitions of random SPIRAL along the arms of a point, for each distance."""
    algorithm = spiral_of(point) | {"random": True}
    groups = [searcher(str(d), point, trials, at(d), algorithm) for d in DISTANCES]
    afresh()
    return [columns["acquisitions"] for columns in searched_on_floor(groups, [0.0] * len(groups))]


def _of_distances(name: str, means: np.ndarray) -> dict[str, Mean]:
    """Return the mean over airs for each distance; means: (airs, distances)."""
    return {f"{name}, {d} cm": over_airs(part) for d, part in zip(DISTANCES, means.T, strict=True)}


DISCUSSION = """\
Within what the paper leaves open SPIRAL comes near to the published means, but reaches one of the two: 10.0
acquisitions from 180 cm (published: 11.5; two standard errors: 9.3 to 13.7) and 11.2 from 150 cm (9.2; 7.8 to 10.6), in
eight airs. From 150 cm it misses by 0.6. This point was chosen for its acquisitions, and lies three quarters of the way
from our usual values to those that the response surface expects to be best. At its end SPIRAL takes 15 again.

The air of this point is stiller than the usual: eddies of 1.3 cm/s and up to 0.8 m, a quarter of its mixing, and rolls
that are weak and change in half a minute. In closed rooms without ventilation about as little mixing was measured (see
`SyntheticWind`). Of the robot the first arm and the square matter (rank correlations of 512 points: -0.21 and -0.27);
for all others, thresholds, sensor and the reading of peaks among them, the rank is below 0.07 and within chance (0.09).
Ranks of the air are of 16 airs: the largest are those of the eddies' size (0.32) and of the rolls.

The assumption needed: an index that is a function of the place. On a smooth field without noise SPIRAL took 11.6 and
10.5 with a side drawn for each search, as in this scan, within two standard errors of both. Side and start of the
spirals were not varied here; `spiral_table2_readings` does.

The experiment keeps its usual values. At the point above E. coli takes 29 and 27 acquisitions, where 67.8 and 50.3 are
published, and 38 by the usual values: what helps SPIRAL helps E. coli more. Random SPIRAL takes 38.6 and 34.7
(published: 38.6 and 28.3), so that the paper does not exclude the arms.

Differences one at a time are of four airs, those of the air's parameters of one. They show no more than an order of
magnitude: the pause, which has no effect on first trials, gives 0.97, two more arms give 1.05.
"""

CASES = (
    Experiment(
        "spiral_scan",
        f"{len(PARAMETERS)} parameters that the paper of SPIRAL leaves open: sensitivities, and points that reach it",
        "Ferri et al. 2009, table 2",
        (
            Condition("joint space", joint_space),
            Condition("promising points", promising_points),
            Condition("best point", best_point),
            Condition("one at a time", one_by_one),
        ),
        trials=8,
        test_trials=0,
        evidence="published",
        compared="varies the parameters of `spiral_table2`, which are not judged",
        discussion=DISCUSSION,
    ),
)
