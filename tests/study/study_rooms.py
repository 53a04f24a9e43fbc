"""Small rooms in which robots search."""

from copy import deepcopy
from typing import Any

ROOM: dict[str, Any] = {
    "duration": 2.0,
    "warm_up": 0.5,
    "domain": {"size": [2.0, 1.5], "spacing": 0.1, "depth": 0.5},
    "wind": {
        "kind": "cfd",
        "openings": [
            {"kind": "honeycomb", "face": "x-", "speed": 0.5, "turbulence_intensity": 0.1},
            {"kind": "outlet", "face": "x+"},
        ],
    },
    "obstacles": [{"kind": "cylinder", "center": [0.9, 1.1], "radius": 0.17}],
    "gas": {"kind": "eulerian", "sources": [{"position": [0.3, 0.6], "rate": 1e-4, "start": -0.4, "stop": 1.0}]},
    "robots": [
        {
            "name": "casters",
            "count": 2,
            "trials": 3,
            "body": {"radius": 0.03, "max_speed": 0.5},
            "start": {"kind": "area", "low": [0.5, 0.05], "high": [1.95, 0.8]},
            "algorithm": {"kind": "casting", "threshold_ppm": 1},
            "sensors": {"gas": {"kind": "pid"}, "wind": {"kind": "ultrasonic"}},
        }
    ],
    "maps": [{"kind": "kernel_dmv", "cell": 0.2}, {"kind": "time_series", "cell": 0.2, "window": 0.5}],
}  # fmt: skip
UNIFORM: dict[str, Any] = {
    "duration": 3.0,
    "domain": {"size": [2.0, 1.5], "spacing": 0.1, "depth": 0.5},
    "wind": {"kind": "uniform", "velocity": [0.5, 0.05]},
    "gas": {
        "kind": "gaussian_plume",
        "diffusivity": 5e-3,
        "sources": [{"position": [0.3, 0.6], "rate": 1e-5}],
    },
    "robots": ROOM["robots"],
}


def changed(base: dict[str, Any], **sections: Any) -> dict[str, Any]:
    """A copy of a scenario with other sections."""
    return deepcopy(base) | sections
