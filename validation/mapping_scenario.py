"""Scenario of Marjovi & Marques, ICRA 2014: teams of robots map the gas of an arena; errors of their maps in one air.

Arena, wind, sources, robots, sensors, maps and the measure of the error (eq 8) are the paper's. It tells neither how
long a run took, how fast the robots drove, how often they read their sensors, nor of its navigation more than the
names. These are ours:

- air in 3-D on cells of 6.25 cm, with gusts of 0.1 m/s and 0.3 m as the paper's honeycombs and height allow;
- gas in turbulent puffs of 1 cm, which go on as gas on the grid once they are as wide as a cell;
- a bubbler: a ball of 3 cm radius, a small wash bottle, which emits 20 mg/s (published: 10 to 30) at 0.1 m over the
  floor. A bottle on the floor lets its vapour out at about its height, which is also that of the robots' sensors.

All teams are in one air, each as if alone. Both sources are in it too: they emit two gases with the numbers of acetone,
and a team's sensors are blind to one of them. So each air is solved once, and what is compared is in the same air.
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
from taichi_plume.scoring.maps import LOOKS
from taichi_plume.scoring.trials import SETTLED
from taichi_plume.simulation import Every, Simulation
from taichi_plume.validation.case import Keys
from taichi_plume.validation.searches import scenario_of

DURATION = 300.0  # s; alpha = 0.98 looks back 250 s
TICK = 0.2  # s
WINDOW = 5.0  # s, in the paper
WINDOWS = (WINDOW, 2.5, 10.0)
CELL = 0.25  # m, of the maps
ALPHAS = (0.4, 0.6, 0.8, 0.9, 0.95, 0.98)
SOURCES = ((1.7, 2.0), (2.5, 1.2))
SPEEDS = (0.05, 0.1, 0.2, 0.3)  # m/s
HEIGHT = 0.1  # m, of sensors and sources
MET = 1.0  # ppm: above it there is gas; the MiCS-5524 begins to tell gas from air at about as much
NEAR = 0.55  # m, radius of the neighbourhood with alpha = 0.9: what passes so close tells of the source
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
    "DAPSO": {"count": 5, "algorithm": {"kind": "dapso"}},
    LINEUP: {"count": 4, "algorithm": {"kind": "lineup", "wind_direction_deg": 0.0}},
}


class Team(NamedTuple):
    """Who maps what: navigation, speed [m/s], sensor and place of the source [m]."""

    navigation: str
    speed: float
    sensor: str
    source: tuple[float, float]


TEAMS = tuple(Team(*row) for row in product(NAVIGATIONS, SPEEDS, SENSORS, SOURCES))


def maps(window: float) -> list[Keys]:
    """The pure interpolation, then a time series for each alpha that sees a past snap of this length [s]."""
    how = {"cell": CELL, "window": window}
    return [
        {"kind": "inverse_distance"} | how,
        *({"kind": "time_series", "alpha": alpha} | how for alpha in alphas(window)),
    ]


def alphas(window: float, snapshots: int = 1) -> tuple[float, ...]:
    """Return the ALPHAS that see `snaps` past snapshots of this length [s]; beta = 0.5, time scale 0.1 m/s."""
    return tuple(alpha for alpha in ALPHAS if (1.0 - alpha) * 0.1 * snapshots * window < 0.5 - 1e-6)


def robots(number: int, team: Team) -> Keys:
    """A team as a group of the scenario, whose sensors are blind to the gas of the other source."""
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


def arena(air: int = 0, teams: Sequence[Team] = TEAMS, duration: float = DURATION) -> Keys:
    """The scenario, as a YAML file would tell it."""
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
                    "sources": [{"position": (*source, HEIGHT), "rate": "20 mg/s", "radius": 0.03}],
                }
                for gas, source in zip(species, SOURCES, strict=True)
            ],
        },
        "robots": [robots(number, team) for number, team in enumerate(teams)],
        "rivals": True,
        "maps": [keys for window in WINDOWS for keys in maps(window)],
    }


class Fared(NamedTuple):
    """Errors of the maps of all teams in an air, `teams` on the last axis.

    times: ends of the snaps of WINDOW that count [s]. errors: of each window, (maps, snaps, teams) [ppm] by eq 8.
    off, alike, peak: (maps, snaps, teams) of WINDOW: error against the true mean gas since the start [ppm], correlation
    with it, distance of the peak from the source [m]. passed: when a robot first came within NEAR of the source [s],
    inf if none did. kept, scatter, endless: see `persistence`. met: share of time in gas at the sensors. way: driven in
    a snap [m] per robot.
    """

    times: np.ndarray
    errors: dict[float, np.ndarray]
    off: np.ndarray
    alike: np.ndarray
    peak: np.ndarray
    passed: np.ndarray
    correlation: np.ndarray
    scatter: np.ndarray
    endless: np.ndarray
    met: np.ndarray
    way: np.ndarray


class Judge:
    """Watches maps and robots of a run."""

    def __init__(self, sim: Simulation, teams: Sequence[Team]):
        self.teams, self.groups = teams, sim.swarm.groups
        self.maps = sim.maps[: 1 + len(alphas(WINDOW))]
        cells = np.shape(self.maps[0].estimate())[1:]
        self.shape = (cells[0], cells[1])
        self.rows = np.array([group.row for group in self.groups])  # of a team in the maps
        self.of = np.array([SOURCES.index(team.source) for team in teams])  # its gas
        self.robot_of = np.repeat(np.arange(len(teams)), [group.count for group in self.groups])
        self.points = np.concatenate([centers(self.shape, CELL), np.full((*self.shape, 1), HEIGHT)], axis=-1)
        self.sum, self.looks = np.zeros((*self.shape, len(SOURCES))), 0
        self.scores: list[np.ndarray] = []  # (3, maps, teams)
        self.interpolated: list[np.ndarray] = []  # (teams, nx, ny)
        self.met, self.near, self.ticks = np.zeros(len(self.robot_of)), np.full(len(teams), np.inf), 0
        self.driven = np.zeros(len(self.robot_of))
        sim.observers += [Every(TICK, self.follow), Every(LOOKS, self.look), Every(WINDOW, self.score)]

    def follow(self, sim: Simulation) -> None:
        """Note where the robots are, and whether in gas."""
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

    def look(self, sim: Simulation) -> None:
        """Take in the true gas."""
        self.sum += fields.ppm_at(sim.gas, self.points, sim.t)
        self.looks += 1

    def score(self, sim: Simulation) -> None:
        """A snap has ended: compare the maps with the true mean gas."""
        truth = self.sum / self.looks
        estimates = np.stack([np.asarray(gas_map.estimate())[self.rows] for gas_map in self.maps])
        values = np.full((3, *estimates.shape[:2]), np.nan)
        for gas, source in enumerate(SOURCES):
            mine = self.of == gas
            for n, estimate in enumerate(estimates[:, mine]):
                score = scores.map_score(estimate, truth[..., gas])
                peak = scores.peak_distance(estimate, CELL, np.array([source]))
                values[:, n, mine] = score.mae, score.correlation, peak
        self.scores.append(values)
        self.interpolated.append(estimates[0])

    def fared(self, sim: Simulation) -> Fared:
        """Return the errors at the end of the run."""
        ends = WINDOW * np.arange(len(self.scores))
        counted = ends > SETTLED + 1e-6
        off, alike, peak = np.stack(self.scores, axis=2)[:, :, counted]
        per_robot = np.bincount(self.robot_of)
        return Fared(
            ends[counted],
            {window: self._errors(sim, window) for window in WINDOWS},
            off,
            alike,
            peak,
            self.near,
            *persistence(np.stack(self.interpolated)[counted]),
            np.bincount(self.robot_of, self.met) / per_robot / self.ticks,
            np.bincount(self.robot_of, self.driven) / per_robot / (sim.t / WINDOW),
        )

    def _errors(self, sim: Simulation, window: float) -> np.ndarray:
        """Return the forecast errors of the snapshots that count, (maps, snaps, teams)."""
        of_maps = [list(gas_map.errors) for gas_map in sim.maps if gas_map.window == window]
        return np.array([[error for t, error in errors if t > SETTLED + 1e-6] for errors in of_maps])[
            ..., self.rows
        ]


def persistence(snapshots: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return correlation and scatter of consecutive snapshots, interpolations (snaps, teams, nx, ny).

    The correlation of a cell's deviation from its mean over time with that one snap later; the standard deviation over
    the mean, both with the variances of all cells together; and how far snaps are from that mean over how far they are
    from the snap before, as eq 8 counts: what a map that forgets nothing would come to, (teams,) each.
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
def in_airs(airs: int) -> tuple[Fared, ...]:
    """All teams in each of so many airs."""
    sim, results = assemble(scenario_of(arena(0, TEAMS, DURATION))), []
    for air in range(airs):
        if air:
            sim.reset(scenario_of(arena(air, TEAMS, DURATION)))
        judge = Judge(sim, TEAMS)
        sim.run()
        results.append(judge.fared(sim))
    return tuple(results)
