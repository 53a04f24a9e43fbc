"""Small scenarios for studies, and study files of them."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.studies.plan import load_plan

ROOM: dict[str, Any] = {
    "name": "room",
    "seed": 3,
    "duration": 4.0,
    "domain": {"size": [2.0, 1.0], "spacing": 0.1},
    "wind": {
        "kind": "cfd",
        "openings": [
            {"kind": "inlet", "face": "x-", "speed": 0.5, "turbulence_intensity": 0.1},
            {"kind": "outlet", "face": "x+"},
        ],
    },
    "gas": {"kind": "eulerian", "sources": [{"position": [0.3, 0.5], "rate": "1 mg/s"}]},
    "robots": [
        {
            "name": "team",
            "count": 2,
            "start": {"kind": "area", "low": [1.4, 0.1], "high": [1.9, 0.9]},
            "algorithm": {"kind": "casting", "threshold_ppm": 5},
            "sensors": {"gas": {"kind": "pid"}},
        }
    ],
    "maps": [{"kind": "gmrf", "cell": 0.2}],
}
SPEED = {"key": "wind.openings.0.speed", "values": [0.2, 0.4]}


def write(folder: Path, room: dict[str, Any] = ROOM, **keys: Any) -> Path:
    """A study of the room along one axis, with other keys; its file."""
    (folder / "room.yaml").write_text(yaml.safe_dump(room, sort_keys=False))
    study = {"name": "a", "base": "room.yaml", "axes": {"speed": SPEED}} | keys
    (folder / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False))
    return folder / "study.yaml"


def faults(file: Path) -> list[str]:
    """What is wrong with a study, without the file's name, with which each line has to begin."""
    with pytest.raises(ScenarioError) as caught:
        load_plan(file)
    lines = caught.value.faults
    assert all(line.startswith(f"{file}: ") and "\n" not in line for line in lines)
    return [line.removeprefix(f"{file}: ") for line in lines]
