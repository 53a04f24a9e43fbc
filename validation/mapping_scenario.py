"""Scenario of Marjovi & Marques, ICRA 2014: teams of robots map the gas of an arena; errors of their maps in one air.

Arena, wind, sources, robots, sensors, maps and the measure of the error (eq 8) are the paper's. The paper does not give
the duration of a run, the speed of the robots, their sampling rate, or details of the navigation. Assumed here:

- air in 3-D on cells of 6.25 cm, with gusts of 0.1 m/s and 0.3 m as the paper's honeycombs and height allow;
- gas in turbulent puffs of 1 cm, which become gas on the grid when they are as wide as a cell;
- a bubbler: a ball of 3 cm radius, a small wash bottle, which emits 20 mg/s (published: 10 to 30) at 0.1 m over the
  floor. A bottle on the floor lets its vapour out at about its height, which is also that of the robots' sensors;
- robots of DAPSO repel each other within NEAR. By the paper they are spread through space (section II), but with the
  default of 0.2 m they crowd at the source, and the map is of one colour. Readings, written down before they ran in
  configs/odor_mapping_dapso.yaml: this one; no fading, exploring and restarts, which are ours; phi1 = phi2 = 2, so that
  the speed limit alone bounds the steps; random neighbours. Wanted was a spread of NEAR, so that no neighbourhood holds
  the whole team. None reaches it. This one is nearest: in eight runs of that configuration 0.36 m instead of 0.28 m,
  and a correlation with the true mean of 0.46 instead of 0.28.

All teams share one air (flow realisation), without interaction. Both sources emit in it, as two gases with the
properties of acetone, and the sensors of a team respond to one of them. So each air is solved once for all teams.
"""

from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from taichi_plume.assembly.assemble import assemble
from taichi_plume.grid import fields
from taichi_plume.grid.grid import centers
from taichi_plume.scoring import trials as scores
from taichi_plume.scoring.map_quality import gradient_to_source, relative_change
from taichi_plume.scoring.maps import LOOKS
from taichi_plume.scoring.trials import SETTLED
from taichi_plume.time_loop import Every, TimeLoop
from taichi_plume.validation.case import Keys
from taichi_plume.validation.searches import scenario_of

DURATION = 300.0  # s; alpha = 0.98 looks back 250 s
TICK = 0.2  # s
WINDOW = 5.0  # s, in the paper
WINDOWS = (WINDOW, 2.5, 10.0)
STOP = 120.0  # s, of a source that stops under a map
CHANGED_DURATION = {"stops": 180.0, "slows": DURATION}  # s
"""Durations of the runs with a source that stops at STOP, or slows from the highest to the lowest published rate."""
CELL = 0.25  # m, of the maps
ALPHAS = (0.4, 0.6, 0.8, 0.9, 0.95, 0.98)
SOURCES = ((1.7, 2.0), (2.5, 1.2))
SPEEDS = (0.05, 0.1, 0.2, 0.3)  # m/s
HEIGHT = 0.1  # m, of sensors and sources
MET = 1.0  # ppm: threshold of gas; about the detection limit of the MiCS-5524
NEAR = 0.55  # m, radius of the neighbourhood with alpha = 0.9: a robot within it has passed the source
GASES = ("acetone", "other acetone")
SENSORS: dict[str, Keys] = {
    "MiCS-5524": {},
    "a quarter of its lags": {"rise_time": 0.375, "decay_time": 2.0},
    "no lag": {"rise_time": 0.0, "decay_time": 0.0},
}
MARJOVI_WIND: Keys = {
    "kind": "cfd",
    "openings": [
        {"kind": "honeycomb", "face": "x-"}
        | {"speed": 0.7, "turbulence_intensity": 0.14, "turbulence_length": 0.3},
        {"kind": "honeycomb", "face": "x+"},
    ],
}
LINEUP = "line-up"
NAVIGATIONS: dict[str, Keys] = {
    "DAPSO": {"count": 5, "algorithm": {"kind": "dapso", "avoidance": NEAR}},
    LINEUP: {"count": 4, "algorithm": {"kind": "lineup", "wind_direction_deg": 0.0}},
}


READINGS: dict[str, Keys] = {
    "age from the forecast snap": {"time_from": "forecast"},
    "one reading per robot and snap": {"samples": "newest"},
}
"""Readings of the paper's text that are not our defaults, as keys of maps."""
BEST = 0.9  # alpha of the least error in the paper
BETAS = (0.25, 0.5, 1.0, 2.0)  # with BEST: 0.28 m, 25 s to 2.2 m, 200 s; the arena is 4 x 3 m
PAPER = (0.1, "MiCS-5524")  # speed [m/s] and sensor that we assume for the paper


class Team(NamedTuple):
    """Team of robots: navigation, speed [m/s], sensor and position of the source [m]."""

    navigation: str
    speed: float
    sensor: str
    source: tuple[float, float]


TEAMS = tuple(Team(*row) for row in product(NAVIGATIONS, SPEEDS, SENSORS, SOURCES))
PAPER_TEAMS = tuple(Team(navigation, *PAPER, source) for navigation, source in product(NAVIGATIONS, SOURCES))


def maps(window: float, reading: Keys | None = None) -> list[Keys]:
    """Return map sections: pure interpolation, and a time series for each of ALPHAS; reading: further keys."""
    how, reading = {"cell": CELL, "window": window}, reading or {}
    of_snaps = {key: value for key, value in reading.items() if key == "samples"}
    return [
        {"kind": "inverse_distance"} | how | of_snaps,
        *({"kind": "time_series", "alpha": alpha} | how | reading for alpha in ALPHAS),
    ]


def map_sets() -> dict[float | str, list[Keys]]:
    """Return the map sections of a run: `maps` by window and by reading, and time series of BEST by BETAS, "beta"."""
    of_beta = {"kind": "time_series", "cell": CELL, "window": WINDOW, "alpha": BEST}
    return {
        **{window: maps(window) for window in WINDOWS},
        **{name: maps(WINDOW, reading) for name, reading in READINGS.items()},
        "beta": [of_beta | {"beta": beta} for beta in BETAS],
    }


def remembering_alphas(window: float) -> tuple[float, ...]:
    """Return the ALPHAS that use two past snapshots of `window` [s] or more; beta = 0.5, time scale 0.1 m/s."""
    return tuple(alpha for alpha in ALPHAS if (1.0 - alpha) * 0.1 * window < 0.5 - 1e-6)


def robots(number: int, team: Team) -> Keys:
    """Return team `number` as a group of the scenario, with sensors blind to the gas of the other source."""
    navigation = NAVIGATIONS[team.navigation]
    algorithm = navigation["algorithm"] | ({"line_speed": team.speed} if team.navigation == LINEUP else {})
    blind = {GASES[1 - SOURCES.index(team.source)]: 0.0}
    return {
        "name": f"team {number}",
        "count": navigation["count"],
        "algorithm": algorithm,
        "body": {"kind": "miniq", "max_speed": team.speed},
        "sensors": {
            "gas": {"kind": "mox", "model": "mics5524", "height": HEIGHT, "sensitivity": blind}
            | SENSORS[team.sensor]
        },
        "start": {"kind": "area", "low": [3.0, 0.2], "high": [3.8, 0.9]},
        "reach": 0.0,
    }


def emitting(source: Keys, change: str = "") -> list[Keys]:
    """Return the sources, as keys, that emit 20 mg/s; or until STOP if it "stops"; or in steps from 30 to 10 mg/s, as
    a bubbler that cools, if it "slows".
    """
    if change == "slows":
        ends = DURATION * np.arange(1, 5) / 5
        parts = [{"rate": "10 mg/s"}, *({"rate": "5 mg/s", "stop": float(end)} for end in ends)]
    else:
        parts = [{"rate": "20 mg/s"} | ({"stop": STOP} if change == "stops" else {})]
    return [source | part for part in parts]


def arena(air: int = 0, teams: Sequence[Team] = TEAMS, duration: float = DURATION, change: str = "") -> Keys:
    """Return the scenario of the arena with these teams in one air, as keys of a YAML file; change: see `emitting`."""
    species = (GASES[0], {"name": GASES[1], "molar_mass": 0.05808, "diffusivity": 1.1e-5})
    return {
        "name": "odor_mapping",
        "seed": air + 1,
        "duration": duration,
        "warm_up": 15.0,  # the air is renewed 2.6 times
        "tick": TICK,
        "domain": {"size": [4.0, 3.0, 0.5], "spacing": 0.0625},
        "wind": MARJOVI_WIND,
        "gas": {
            "kind": "mixture",
            "parts": [
                {
                    "kind": "puffs",
                    "species": gas,
                    "release_rate": 100,
                    "sources": emitting({"position": (*source, HEIGHT), "radius": 0.03}, change),
                }
                for gas, source in zip(species, SOURCES, strict=True)
            ],
        },
        "robots": [robots(number, team) for number, team in enumerate(teams)],
        "rivals": True,
        "maps": [keys for sections in map_sets().values() for keys in sections],
    }


class Fared(NamedTuple):
    """Errors of the maps of all teams in an air, `teams` on the last axis.

    times: ends of the counted snapshots of WINDOW [s]. errors: by key of `map_sets`, (maps, snapshots, teams) [ppm] by
    eq 8.
    off, alike, peak: (maps, snapshots, teams) of WINDOW: error against the true mean gas since the start [ppm],
    correlation with it, distance of the peak from the source [m]. towards, change: of WINDOW, see `gradient_to_source`
    and `relative_change`. level: of WINDOW, mean over the cells [ppm]. passed: first time of a robot within NEAR of the
    source [s], inf if none. correlation, scatter, endless: see `persistence`. met: share of time in gas. way: path per
    robot and snapshot [m]. spread: mean of `spread` over the snapshots [m].
    """

    times: np.ndarray
    errors: dict[float | str, np.ndarray]
    off: np.ndarray
    alike: np.ndarray
    peak: np.ndarray
    towards: np.ndarray
    change: np.ndarray
    level: np.ndarray
    passed: np.ndarray
    correlation: np.ndarray
    scatter: np.ndarray
    endless: np.ndarray
    met: np.ndarray
    way: np.ndarray
    spread: np.ndarray


class Scorer:
    """Observer that scores the maps and robots of a run."""

    def __init__(self, sim: TimeLoop, teams: Sequence[Team]):
        self.teams, self.groups = teams, sim.swarm.groups
        self.maps = sim.maps[: 1 + len(ALPHAS)]
        cells = np.shape(self.maps[0].estimate())[1:]
        self.shape = (cells[0], cells[1])
        self.rows = np.array([group.row for group in self.groups])  # row of each team in the maps
        self.of = np.array([SOURCES.index(team.source) for team in teams])  # gas of each team
        self.robot_of = np.repeat(np.arange(len(teams)), [group.count for group in self.groups])
        self.points = np.concatenate([centers(self.shape, CELL), np.full((*self.shape, 1), HEIGHT)], axis=-1)
        self.sum, self.looks = np.zeros((*self.shape, len(SOURCES))), 0
        self.scores: list[np.ndarray] = []  # (6, maps, teams)
        self.before: np.ndarray | None = None  # estimates of the snapshot before, (maps, teams, nx, ny)
        self.interpolated: list[np.ndarray] = []  # (teams, nx, ny)
        self.spreads: list[np.ndarray] = []  # (teams,)
        self.met, self.near, self.ticks = np.zeros(len(self.robot_of)), np.full(len(teams), np.inf), 0
        self.driven = np.zeros(len(self.robot_of))
        sim.observers += [Every(TICK, self.follow), Every(LOOKS, self.look), Every(WINDOW, self.score)]

    def follow(self, sim: TimeLoop) -> None:
        """Record positions of the robots, path lengths and time in gas."""
        now = sim.swarm.snapshot()
        place = now["position"]
        points = np.column_stack([place, np.full(len(place), HEIGHT)])
        own = self.of[self.robot_of]
        ppm = fields.ppm_at(sim.gas, points, sim.t)[np.arange(len(place)), own]
        self.met += ppm > MET
        self.ticks += 1
        self.driven = now["path_length"]
        apart = np.linalg.norm(place - np.array(SOURCES)[own], axis=1)
        close = self.robot_of[apart <= NEAR]
        self.near[close] = np.minimum(self.near[close], sim.t)

    def look(self, sim: TimeLoop) -> None:
        """Add the true gas to its time average."""
        self.sum += fields.ppm_at(sim.gas, self.points, sim.t)
        self.looks += 1

    def score(self, sim: TimeLoop) -> None:
        """Compare the maps with the true mean gas at the end of a snapshot."""
        truth = self.sum / self.looks
        estimates = np.stack([np.asarray(gas_map.estimate())[self.rows] for gas_map in self.maps])
        values = np.full((6, *estimates.shape[:2]), np.nan)
        for gas, source in enumerate(SOURCES):
            mine = self.of == gas
            for n, estimate in enumerate(estimates[:, mine]):
                score = scores.map_score(estimate, truth[..., gas])
                peak = scores.peak_distance(estimate, CELL, np.array([source]))
                towards = gradient_to_source(estimate, CELL, np.array(source))
                values[:4, n, mine] = score.mae, score.correlation, peak, towards
        if self.before is not None:
            values[4] = [relative_change(*pair) for pair in zip(self.before, estimates, strict=True)]
        values[5] = estimates.mean(axis=(2, 3))
        self.before = estimates
        self.scores.append(values)
        self.interpolated.append(estimates[0])
        self.spreads.append(spread(sim.swarm.snapshot()["position"], self.robot_of))

    def fared(self, sim: TimeLoop) -> Fared:
        """Return the maps' errors of all teams at the end of the run."""
        ends = WINDOW * np.arange(len(self.scores))
        counted = ends > SETTLED + 1e-6
        off, alike, peak, towards, change, level = np.stack(self.scores, axis=2)[:, :, counted]
        per_robot = np.bincount(self.robot_of)
        return Fared(
            ends[counted],
            self._errors(sim),
            off,
            alike,
            peak,
            towards,
            change,
            level,
            self.near,
            *persistence(np.stack(self.interpolated)[counted]),
            np.bincount(self.robot_of, self.met) / per_robot / self.ticks,
            np.bincount(self.robot_of, self.driven) / per_robot / (sim.t / WINDOW),
            np.stack(self.spreads)[counted].mean(axis=0),
        )

    def _errors(self, sim: TimeLoop) -> dict[float | str, np.ndarray]:
        """Return the forecast errors of the counted snapshots, (maps, snapshots, teams), by key of `map_sets`."""
        sections, each = iter(sim.maps), {}
        for name, part in map_sets().items():
            of_maps = [[error for t, error in next(sections).errors if t > SETTLED + 1e-6] for _ in part]
            each[name] = np.array(of_maps)[..., self.rows]
        return each


def spread(position: np.ndarray, team_of: np.ndarray) -> np.ndarray:
    """Return the root mean square distance of each team's robots from their centroid, (teams,) [m].

    position: (robots, 2) [m]; team_of: number of the team of each robot.
    """
    count = np.bincount(team_of)
    centroid = np.stack([np.bincount(team_of, part) / count for part in position.T], axis=-1)
    apart = position - centroid[team_of]
    return np.sqrt(np.bincount(team_of, (apart**2).sum(axis=-1)) / count)


def persistence(snapshots: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return statistics of consecutive snapshots, interpolations (snapshots, teams, nx, ny); (teams,) each.

    Lag-1 correlation of a cell's deviation from its mean over time, and standard deviation over the mean, both with the
    variances of all cells pooled. Third, mean distance of snapshots from their mean over that from the previous
    snapshot, as in eq 8: the error of a map without forgetting.
    """
    deviation = snapshots - snapshots.mean(axis=0)
    variance = (deviation**2).mean(axis=(0, 2, 3))
    together = (deviation[1:] * deviation[:-1]).mean(axis=(0, 2, 3))
    steps = np.abs(np.diff(snapshots, axis=0)).mean(axis=(0, 2, 3))
    return (
        together / variance,
        np.sqrt(variance) / snapshots.mean(axis=(0, 2, 3)),
        np.abs(deviation).mean(axis=(0, 2, 3)) / steps,
    )


@cache
def in_airs(airs: int, change: str = "") -> tuple[Fared, ...]:
    """Run all teams, or PAPER_TEAMS if the sources change, in each of several airs and return their errors.

    change: see `emitting`.
    """
    teams, duration = (PAPER_TEAMS, CHANGED_DURATION[change]) if change else (TEAMS, DURATION)
    sim, results = assemble(scenario_of(arena(0, teams, duration, change))), []
    for air in range(airs):
        if air:
            sim.reset(scenario_of(arena(air, teams, duration, change)))
        scorer = Scorer(sim, teams)
        sim.run()
        results.append(scorer.fared(sim))
    return tuple(results)
