"""Searches of teams of five for acetone in the odour arena: DAPSO with and without messages, and simple searches.

Arena, wind, gas and robots are those of configs/dapso_arena.yaml, after Marjovi & Marques, ICRA 2014. No figures are
published for it: the only judged result is that DAPSO finds the source. All teams search the same airs (flow
realisations), and the intervals are over these.
"""

from functools import cache, partial

import numpy as np

from taichi_plume.validation.case import Keys
from taichi_plume.validation.experiment import Condition, Experiment, Range, Results, over_airs
from taichi_plume.validation.mapping_scenario import MARJOVI_WIND
from taichi_plume.validation.searches import contest, pooled, spread

AIRS = 8
DURATION = 300.0  # s
RANGE = {"range": 1.5}  # m, of messages
TEAMS: dict[str, Keys] = {
    "DAPSO": {"algorithm": {"kind": "dapso"}, "communication": RANGE},
    "DAPSO without messages": {"algorithm": {"kind": "dapso"}, "communication": RANGE | {"loss": 1.0}},
    "random walk": {"algorithm": {"kind": "random_walk"}},
    "sweep": {"algorithm": {"kind": "sweep"}},
    "line-up": {"algorithm": {"kind": "lineup"}},
}


def arena(robots: list[Keys]) -> Keys:
    """Return the scenario of the odour arena with these groups of robots, as keys of a YAML file."""
    return {
        "name": "dapso_arena",
        "seed": 1,
        "duration": DURATION,
        "warm_up": 15.0,
        "domain": {"size": [4.0, 3.0], "spacing": 0.05, "depth": 0.5},
        "wind": MARJOVI_WIND,
        "gas": {
            "kind": "eulerian",
            "species": "acetone",
            "sources": [{"position": [1.7, 2.0], "rate": "20 mg/s", "radius": 0.05}],
        },
        "robots": robots,
    }


def team(name: str, trials: int, keys: Keys) -> Keys:
    """Return a group of five small robots that start in a downwind corner, as keys of a YAML file."""
    return {
        "name": name,
        "count": 5,
        "trials": trials,
        "start": {"kind": "area", "low": [3.0, 0.2], "high": [3.8, 0.9]},
        "body": {"radius": 0.05, "height": 0.08, "max_speed": 0.1},
        "sensors": {"gas": {"kind": "mox", "model": "mics5524"}, "wind": {"kind": "ultrasonic"}},
        "reach": 0.3,
    } | keys


@cache
def found(trials: int) -> dict[str, dict[str, np.ndarray]]:
    """Return the outcomes of all teams' searches, an equal share of trials per air, and the `air` of each trial."""
    parts = []
    for air, share in enumerate(spread(trials, AIRS)):
        teams = [team(name, share, keys) for name, keys in TEAMS.items()]
        outcomes = contest(arena(teams) | {"seed": air + 1})
        parts += [(name, columns | {"air": [air] * share}) for name, columns in outcomes.items()]
    return pooled(parts)


def one_team(trials: int, name: str) -> Results:
    """Return the success rate of a team and its mean time to the source; failures count with the whole duration."""
    columns = found(trials)[name]
    time = np.where(columns["success"], columns["time_s"], DURATION)
    return {
        "success": over_airs(columns["success"], columns["air"], share=True),
        "time [s]": over_airs(time, columns["air"]),
    }


DISCUSSION = """\
The paper drives its robots by DAPSO, but gives no search times. So only the success is judged: a team of five finds
the source. DAPSO is not shown to search better than others. A sweep across the wind is quicker, as it meets the plume
on its first path segment, and without messages the team is not slower than with them: in 4 x 3 m a robot that meets
the plume can follow it alone.
"""

CASES = (
    Experiment(
        "dapso_arena",
        f"teams of five look for a leak in the odour arena, in {AIRS} airs",
        "Marjovi & Marques 2014, the arena",
        tuple(
            Condition(
                name,
                partial(one_team, name=name),
                expected={"success": Range(least=0.9)} if name == "DAPSO" else {},
            )
            for name in TEAMS
        ),
        evidence="published",
        compared="the paper gives no search times and no shares",
        trials=96,
        test_trials=0,
        discussion=DISCUSSION,
    ),
)
