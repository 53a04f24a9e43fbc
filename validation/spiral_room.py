"""Scenario and table 2 of Ferri, Caselli, Mattoli, Mondini, Mazzolai & Dario, Robotics and Autonomous Systems 57 (2009)
393-402: a room with a dish of ethanol.

Arena, dish, distances, robot, sensor and algorithms are the paper's. The robot drives and turns by the encoders of its
wheels ("for rough odometry"; the webcam only records its path), whose errors are not given: ours are those of a small
robot that is not calibrated. The room around the arena is not described; ours has 50 m³ of air that drifts at a few
cm/s, see solvers/synthetic_flow.py. Its cells of 10 cm carry no smaller eddies, so sensors feel unresolved fluctuations
(`gas.fluctuations`). Section 2 of the paper decided this, not table 2: in six airs of `spiral_gas` readings vary more
with them (0.116 for 0.092 of the mean within 30 s), peaks are more frequent (1.7 for 1.5 in 30 s at 30 cm) and higher,
neighbours are harder to order (0.88 for 0.91 of the time) and longer acquisitions help more (0.011 for 0.004). The
verdicts are the same with and without.
"""

from math import sqrt
from typing import NamedTuple

from scipy.special import stdtrit

from taichi_plume.validation.case import Keys

OPENED = 300.0  # s before the first trial
HOUR = 3600.0  # s, after which a search has failed
PAUSE = 60.0  # s between the trials of a session
SESSION = 4  # trials, after which the room is aired
SOURCE = (3.4, 1.9)  # m
DISTANCES = (180, 150)  # cm
# Noise of a reading of ln R that averaging does not remove (flicker noise of resistive gas sensors: Scandurra, Ciofi &
# Smulko 2024, doi:10.3390/s24020405, abstract). Equal to the noise of a sample of ours, so that the noise does not
# average out. A step of the 10-bit converter of the paper's microcontroller is 0.004 in ln R at the load resistance.
READING_NOISE = 0.003
ALGORITHMS: dict[str, Keys] = {
    "SPIRAL": {"kind": "spiral"},
    "E. coli 3 s": {"kind": "ecoli", "acquisition": 3.0},
    "E. coli 30 s": {"kind": "ecoli", "acquisition": 30.0},
    "random SPIRAL": {"kind": "spiral", "random": True},
}
READINGS: dict[str, Keys] = {
    "right": {"sense": "right"},
    "either side": {"sense": "random"},
    "turn first": {"first_move": "turn"},
    "turn first, to the right": {"first_move": "turn", "sense": "right"},
    "acquisition first": {"first_move": "acquisition"},
    "absolute peaks": {"peak_height": "absolute"},
    "arms of 0.45 m": {"arms": [0.45, 0.45, 0.9, 0.9, 1.35, 1.35]},
}
"""Other readings of the paper's text than the defaults of SPIRAL, as keys that differ from them."""


def reading(name: str) -> Keys:
    """Return the keys of SPIRAL by another reading of the text, one of READINGS."""
    return ALGORITHMS["SPIRAL"] | READINGS[name]


class Sample(NamedTuple):
    """Published mean with its standard deviation over n trials."""

    mean: float
    deviation: float
    n: int

    @property
    def error(self) -> float:
        """Standard error of the mean."""
        return self.deviation / sqrt(self.n)

    @property
    def half(self) -> float:
        """Half width of Student's 95 % confidence interval."""
        return float(stdtrit(self.n - 1, 0.975)) * self.error

    @property
    def variation(self) -> float:
        """Coefficient of variation."""
        return self.deviation / self.mean

    def __str__(self) -> str:
        half = f"{self.half:.0f}" if self.half >= 10 else f"{self.half:.1f}"
        return f"{self.mean:g} +- {half} (n = {self.n})"


class Published(NamedTuple):
    """Row of the paper's table 2: time to the source [s], and number of acquisitions."""

    time: Sample
    acquisitions: Sample


def _row(n: int, *figures: float) -> Published:
    time, its, steps, their = figures
    return Published(Sample(time, its, n), Sample(steps, their, n))


TABLE_2: dict[tuple[str, int], Published] = {
    ("SPIRAL", 180): _row(15, 398.2, 151.5, 11.5, 4.3),
    ("SPIRAL", 150): _row(15, 306.3, 91.2, 9.2, 2.7),
    ("E. coli 3 s", 180): _row(15, 463.3, 93.0, 67.8, 14.7),
    ("E. coli 3 s", 150): _row(15, 353.1, 73.2, 50.3, 11.3),
    ("E. coli 30 s", 180): _row(4, 1671.2, 134.9, 49.3, 4.1),
    ("E. coli 30 s", 150): _row(4, 1184.1, 158.1, 35.7, 5.1),
    ("random SPIRAL", 180): _row(10, 1351.0, 291.0, 38.6, 8.1),
    ("random SPIRAL", 150): _row(10, 991.0, 193.0, 28.3, 5.2),
}


def begins(row: tuple[str, int]) -> list[float]:
    """Return the start times of a session's trials [s], a mean published time and a pause apart; row: of table 2."""
    return [round(k * (TABLE_2[row].time.mean + PAUSE), 1) for k in range(SESSION)]


def at(distance: int) -> Keys:
    """Return a start, as keys, at a distance [cm] from the dish, heading across the direction to the dish."""
    place = [round(SOURCE[0] - distance / 100, 2), SOURCE[1]]
    return {"kind": "positions", "positions": [place], "heading_deg": 90}


def momo(name: str, trials: int, start: Keys, algorithm: Keys, begin: float = 0.0) -> Keys:
    """Return a group of the paper's robots, as keys of a YAML file."""
    gas = {"kind": "mox", "model": "tgs800", "period": 0.5, "averaged": 500, "calibration": "cubic"}
    return {
        "name": name,
        "count": len(start.get("positions", [0])),
        "trials": trials,
        "begin": begin,
        "start": start,
        "algorithm": algorithm,
        "body": {"kind": "momo"},
        "localization": {"kind": "odometry"},
        "reach": 0.185,  # half of the square of 20 cm around the dish, and half of the robot
        "capture": "square",
        "sensors": {"gas": gas | {"reading_noise": READING_NOISE}},
    }


def room(air: int, robots: list[Keys], duration: float) -> Keys:
    """Return the scenario of the room, as keys of a YAML file; the warm-up is the time since the dish was opened."""
    return {
        "name": "spiral_room",
        "seed": air + 1,
        "duration": duration,
        "warm_up": OPENED,
        "tick": 0.25,
        "domain": {"size": [5.0, 4.0, 2.5], "spacing": 0.1},
        "wind": {"kind": "synthetic"},
        "obstacles": [  # of polystyrene, north and south of the arena
            {"kind": "box", "center": [2.5, y, 0.1], "size": [3.0, 0.1, 0.2]} for y in (0.8, 3.0)
        ],
        "arena": {"low": [1.0, 0.85], "high": [4.0, 2.95]},
        "gas": {
            "kind": "eulerian",
            "fluctuations": True,
            "sources": [
                {
                    "position": [*SOURCE, 0.05],
                    "dish": {"diameter": 0.085, "temperature": 294.15},
                    "radius": 0.08,
                }
            ],
        },
        "robots": robots,
    }


def floor(robots: list[Keys], duration: float) -> Keys:
    """Return the scenario of the arena alone in 2-D, for searches that do not depend on the air."""
    return {
        "name": "spiral_floor",
        "duration": duration,
        "tick": 0.25,
        "domain": {"size": [5.0, 4.0], "spacing": 0.1},
        "wind": {"kind": "uniform", "velocity": [0.1, 0.0]},
        "arena": {"low": [1.0, 0.85], "high": [4.0, 2.95]},
        "gas": {
            "kind": "gaussian_plume",
            "intensity": 0.1,
            "sources": [{"position": list(SOURCE), "rate": 1e-6}],
        },
        "robots": robots,
    }
