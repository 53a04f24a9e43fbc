"""The scenarios that ship: they are valid, and the stories in their headers are true."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from scripts import read_result

from taichi_plume.assembly.preparation import load
from taichi_plume.cli import run
from taichi_plume.cli.statistics import main as statistics
from taichi_plume.studies.plan import load_plan

CONFIGS = Path(__file__).parent.parent / "configs"


def result_of(name: str, out: Path, *options: str) -> dict:
    assert run.main([str(CONFIGS / f"{name}.yaml"), "--out", str(out), "--quiet", *options]) == 0
    return read_result(out)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_configs_are_valid_and_reported(path):
    scenario, resources = load(path)
    assert scenario.name == path.stem
    assert resources.warnings == []
    assert path.read_text().startswith("# "), "its header says what you will see and how long it takes"


@pytest.mark.parametrize("path", sorted((CONFIGS / "studies").glob("*.yaml")), ids=lambda path: path.stem)
def test_studies_are_valid_and_reported(path):
    assert path.read_text().startswith("# "), "its header says what it asks and how long it takes"
    if "base" not in yaml.safe_load(path.read_text()):
        assert load(path).scenario.name == path.stem
        assert load(path).resources.warnings == []
        return
    plan = load_plan(path)
    assert plan.study.name == path.stem
    assert 50 <= len(plan.requests) <= 200


def verified(recording: Path) -> bool:
    rerun = Path(sys.executable).parent / "rerun"
    return subprocess.run([rerun, "rrd", "verify", recording], capture_output=True).returncode == 0


def casting_room(result):
    headline, other = (gas_map["mean_gas"] for gas_map in result["maps"])
    assert headline["correlation"][-1] > 0.5
    assert headline["peak_distance_m"][-1] < 0.7
    assert other["correlation"][-1] > 0.3


def frozen_room(result):
    assert result["groups"][0]["success_rate"] > 0.9


def dapso_arena(result):
    assert result["groups"][0]["success_rate"] == 1.0
    assert result["groups"][0]["per_trial"]["acquisitions"][0] > 20


def odor_mapping(result):
    for gas_map in result["maps"]:
        scores = gas_map["mean_gas"]
        assert scores["time_s"] == pytest.approx(5.0 * np.arange(1, 61))
        assert None not in scores["error_ppm"]
        assert None not in scores["peak_distance_m"]


OPTIONS = {
    "frozen_room": ["--no-recording"],
    "arena_3d": ["--duration", "10"],
    "fan_array": ["--duration", "8"],
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "found", "gas_error", "divergence", "story"),
    [
        ("casting_room", 3, 1e-5, 1e-4, casting_room),
        ("puffs_arena", 1, 1e-6, None, None),
        ("arena_3d", 0, 1e-5, 1e-4, None),
        ("fan_array", 0, 1e-5, None, None),
        ("dapso_arena", 0, None, None, dapso_arena),
        ("odor_mapping_dapso", 0, None, None, odor_mapping),
        ("frozen_room", 0, 1e-5, 1e-4, frozen_room),
    ],
)
def test_a_config_is_the_story_of_its_header(tmp_path, name, found, gas_error, divergence, story):
    """found: least number of robots that find a source; gas_error, divergence: largest ones."""
    options = OPTIONS.get(name, [])
    result = result_of(name, tmp_path, *options)
    assert sum(result["groups"][0]["per_trial"]["found"]) >= found
    assert gas_error is None or abs(result["gas"]["relative_error"]) <= gas_error
    assert divergence is None or result["flow"]["max_divergence"] <= divergence
    if story is not None:
        story(result)
    assert "--no-recording" in options or verified(tmp_path / "recording.rrd")


@pytest.mark.slow
def test_whiffs_is_the_story_of_its_header(tmp_path):
    """Run an eighth of it; the power law needs all, see the validation's cases whiffs and turbulent_whiffs."""
    result = result_of("whiffs", tmp_path, "--no-recording", "--duration", "30")
    assert abs(result["gas"]["relative_error"]) <= 1e-6
    assert statistics([str(tmp_path), "--range", "0.8", "8", "--no-page"]) == 0
    reported = json.loads((tmp_path / "statistics/statistics.json").read_text())
    assert reported["longest_step_s"] == pytest.approx(0.025)
    (plumes,) = (one for one in reported["probes"] if one["name"] == "all")
    assert all(plumes[kind]["law"]["count"] > 30 for kind in ("whiffs", "blanks"))
    slow, fast = reported["sensors"][:2]
    assert slow["share"] < 0.2
    assert fast["share"] > 0.8


@pytest.mark.slow
def test_quiet_room_is_the_story_of_its_header(tmp_path):
    result = result_of("quiet_room", tmp_path)
    assert abs(result["gas"]["relative_error"]) <= 1e-5
    assert result["gas"]["outflow_kg"] == 0.0
    table = pq.read_table(tmp_path / "robots.parquet")
    robot, ppm = (table[name].to_numpy() for name in ("robot", "reading_ppm"))
    readings = np.array([ppm[robot == n] for n in range(5)])
    assert 0.1 < np.mean(readings[1:].max(axis=0) > readings[0]) < 0.9
    assert verified(tmp_path / "recording.rrd")


@pytest.mark.slow
def test_playback_is_the_story_of_its_header(tmp_path):
    result = result_of("playback", tmp_path)
    assert sum(result["groups"][0]["per_trial"]["found"]) >= 1
    assert verified(tmp_path / "recording.rrd")
