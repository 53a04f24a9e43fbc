"""No input is waited for: pipes, devices and folders in place of files are reported at once."""

import os
from pathlib import Path

import pytest
from scripts import refusal

SCENARIO = """
duration: 1
domain: {{size: [4, 3], spacing: 0.1}}
wind: {wind}
obstacles: {obstacles}
gas: {gas}
robots: [{{count: 1, start: {{kind: positions, positions: [[3, 1]]}}, algorithm: {robot}}}]
"""
USUAL = {
    "wind": "{kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.5}, {kind: outlet, face: x+}]}",
    "obstacles": "[]",
    "gas": "{kind: eulerian, sources: [{position: [0.5, 1.5], rate: 1 mg/s}]}",
    "robot": "{kind: casting}",
}
SOURCES = "sources: [{position: [1, 1]}]"
INPUTS = {
    "mesh": {"obstacles": "[{kind: mesh, file: NAME.stl, section: 0.1}]"},
    "own": {"robot": "{kind: own, file: NAME.py}"},
    "film": {"wind": "{kind: playback, file: NAME}"},
    "film's part": {"wind": "{kind: playback, file: FOLDER}"},
    "log": {"gas": f"{{kind: plumesim_log, file: NAME, {SOURCES}}}"},
    "fluent": {"gas": f"{{kind: fluent, files: NAME%d.txt, {SOURCES}}}"},
    "imported": {"wind": "{kind: imported, files: NAME.csv}"},
    "several": {"wind": "{kind: imported, files: NAME%d.csv}"},
}


@pytest.fixture(params=["pipe", "zero", "folder"])
def case(tmp_path, request) -> Path:
    """A folder in which every name is a pipe, an endless device, or a folder."""
    for name in ("NAME", "NAME.stl", "NAME.py", "NAME.csv", "NAME1.csv", "NAME1.txt", "NAME.parquet"):
        if request.param == "pipe":
            os.mkfifo(tmp_path / name)
        elif request.param == "zero":
            (tmp_path / name).symlink_to("/dev/zero")
        else:
            (tmp_path / name).mkdir()
    (tmp_path / "FOLDER").mkdir()
    os.mkfifo(tmp_path / "FOLDER" / "zarr.json")
    return tmp_path


@pytest.mark.parametrize("what", INPUTS)
def test_inputs_of_scenarios(case, what, capsys):
    (case / "s.yaml").write_text(SCENARIO.format(**USUAL | INPUTS[what]))
    reported = refusal(capsys, "run", str(case / "s.yaml"), "--check", "--allow-outside")
    assert "NAME" in reported or "FOLDER" in reported


def test_the_scenario_itself(case, capsys):
    assert "cannot be read" in refusal(capsys, "run", str(case / "NAME"), "--check")


@pytest.mark.parametrize("name", ["NAME", "NAME.csv", "NAME.parquet"])
def test_readings(case, capsys, name):
    line = ["maps", str(case / name), "--size", "4", "3", "--out", str(case / "map")]
    assert refusal(capsys, *line).startswith(f"{case / name}: ")
