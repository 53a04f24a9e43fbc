"""Teams of five look for acetone in the odour arena: DAPSO with and without messages, and simple searches.

Arena, wind, gas and robots are those of configs/dapso_arena.yaml, after Marjovi & Marques, ICRA 2014. No figures are
published for it: what is judged is that DAPSO finds the source. All teams search the same air, so that the intervals
tell of teams, not of airs.
"""

from functools import cache, partial
from typing import Any

from taichi_plume.scores import trial_summary
from taichi_plume.validation.experiment import Condition, Experiment, Mean, Range, Told
from taichi_plume.validation.searches import contest

DURATION = 300.0  # s
RANGE = {"range": 1.5}
TEAMS: dict[str, dict[str, Any]] = {
    "DAPSO": {"algorithm": {"kind": "dapso"}, "communication": RANGE},
    "DAPSO without messages": {"algorithm": {"kind": "dapso"}, "communication": RANGE | {"loss": 1.0}},
    "random walk": {"algorithm": {"kind": "random_walk"}},
    "sweep": {"algorithm": {"kind": "sweep"}},
    "line-up": {"algorithm": {"kind": "lineup"}},
}


def arena(robots: list[dict[str, Any]]) -> dict[str, Any]:
    """The scenario as a YAML file would tell it."""
    inflow = {"speed": 0.7, "turbulence_intensity": 0.14, "turbulence_length": 0.3}
    return {
        "name": "dapso_arena",
        "seed": 1,
        "duration": DURATION,
        "warm_up": 15.0,
        "domain": {"size": [4.0, 3.0], "spacing": 0.05, "depth": 0.5},
        "wind": {
            "kind": "cfd",
            "openings": [
                {"kind": "honeycomb", "face": "x-"} | inflow,
                {"kind": "honeycomb", "face": "x+"},
            ],
        },
        "gas": {
            "kind": "eulerian",
            "species": "acetone",
            "sources": [{"position": [1.7, 2.0], "rate": "20 mg/s", "radius": 0.05}],
        },
        "robots": robots,
    }


def team(name: str, trials: int, keys: dict[str, Any]) -> dict[str, Any]:
    """Five small robots in the corner downwind."""
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
def found(trials: int) -> dict[str, dict[str, list[Any]]]:
    """What `trial_outcomes` tells of all teams."""
    return contest(arena([team(name, trials, keys) for name, keys in TEAMS.items()]))


def one_team(trials: int, name: str) -> Told:
    """How often the first of the team finds the source, and when; failures count with the whole time."""
    summary = trial_summary(found(trials)[name], DURATION)
    return {
        "success": Mean(**summary["success_rate"]),
        "time [s]": Mean(**summary["time_with_failures_s"]),
    }


DAPSO_CASES = (
    Experiment(
        "dapso_arena",
        "teams of five look for a leak in the odour arena, all in one air",
        "Marjovi & Marques 2014, the arena",
        tuple(
            Condition(
                name,
                partial(one_team, name=name),
                expected={"success": Range(least=0.9)} if name == "DAPSO" else {},
            )
            for name in TEAMS
        ),
        trials=100,
        few=0,
    ),
)
