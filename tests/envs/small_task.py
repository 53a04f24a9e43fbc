"""A task that costs next to nothing: two sources, a gusty wind that nothing is solved for, two short films."""

from typing import Any

SOURCE = {"kind": "meandering", "species": "acetone", "width_slope": 0.1}
TASK: dict[str, Any] = {
    "seed": 3,
    "duration": 4.0,
    "warm_up": 1.0,
    "domain": {"size": [2.0, 1.2], "spacing": 0.1, "depth": 0.5},
    "wind": {"kind": "uniform", "velocity": [0.5, 0.0], "gusts": {"intensity": 0.3, "time": 1.0}},
    "gas": {
        "kind": "mixture",
        "parts": [
            {**SOURCE, "sources": [{"position": [0.4, 0.4], "rate": "10 mg/s", "radius": 0.05}]},
            {**SOURCE, "sources": [{"position": [0.5, 0.8], "rate": "10 mg/s", "radius": 0.05}]},
        ],
    },
    "robots": [
        {
            "name": "learners",
            "count": 2,
            "start": {"kind": "area", "low": [0.7, 0.2], "high": [1.6, 1.0]},
            "algorithm": {"kind": "policy", "memory": [1.0], "period": 0.5},
            "body": {"radius": 0.04, "max_speed": 0.4},
            "sensors": {"gas": {"kind": "pid"}},
            "reach": 0.2,
        }
    ],
    "task": {"episode": 4.0, "airs": 2, "film": 6.0, "frame": 0.2, "sources": "one"},
}


def task(**keys: Any) -> dict[str, Any]:
    """The task with other sections."""
    return {**TASK, **keys}
