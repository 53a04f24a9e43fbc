"""`python -m taichi_plume.study`: what is wrong is told in a line, before anything heavy is imported."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from taichi_plume.cli.study import main
from taichi_plume.guard.terminal import say

SCENARIO = """
duration: 1
domain: {size: [4, 3], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0]}
gas: {kind: eulerian, sources: [{position: [0.5, 1.5], rate: 1 mg/s}]}
robots: [{count: 1, start: {kind: positions, positions: [[3, 1]]}, algorithm: {kind: casting, threshold_ppm: 5}}]
"""
STUDY = """
name: quick
base: base.yaml
axes: {threshold: {key: robots.0.algorithm.threshold_ppm, values: [1, 2, 3]}}
airs: 2
"""


@pytest.fixture
def case(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "base.yaml").write_text(SCENARIO)
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path


def refused(*line: str) -> int | str | None:
    with pytest.raises(SystemExit) as end:
        main(line)
    return end.value.code


def test_check_tells_what_it_makes(case, capsys):
    assert main(["study.yaml", "--check"]) == 0
    told = capsys.readouterr().out
    assert "runs: 6, at 3 points" in told
    assert "airs: 1; 6 runs share theirs with others" in told
    assert "threshold [ppm]" in told
    assert not (case / "studies").exists()


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (["study.yaml", "--workers", "2", "--scheduler", "tcp://a:1"], "no place beside --scheduler"),
        (["study.yaml", "--dashboard"], "--scheduler ADDRESS"),
        ([], "required: study"),
        (["report"], "required: DIR"),
    ],
)
def test_command_lines(case, capsys, line, told):
    assert refused(*line) == 2
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (["study.yaml", "--out", "base.yaml"], "base.yaml: cannot be written to"),
        (
            ["study.yaml", "--out", "."],
            ".: is not empty, and holds no study (base.yaml); choose another --out",
        ),
        (["study.yaml", "--out", ".", "--force"], "holds no study"),
        (["report", "nowhere"], "nowhere: is not the folder of a study"),
    ],
)
def test_bad_input_is_one_line(case, capsys, line, told):
    assert main(line) == 2
    said = capsys.readouterr()
    assert told in said.err
    assert (said.out + said.err).count("\n") == 1


def test_code_needs_leave(case, capsys):
    (case / "own.py").write_text(
        "class Mine:\n    def act(self, t, sensors):\n        pass\nraise SystemExit('executed')"
    )
    (case / "base.yaml").write_text(
        SCENARIO.replace("{kind: casting, threshold_ppm: 5}", "{kind: own, file: own.py}")
    )
    (case / "study.yaml").write_text(
        STUDY.replace("robots.0.algorithm.threshold_ppm, values: [1, 2, 3]", "duration, values: [1, 2]")
    )
    assert main(["study.yaml"]) == 2
    said = capsys.readouterr().err
    assert "own.py: holds Python code" in said
    assert "--allow-code" in said
    assert not (case / "studies").exists()


def test_bad_input_is_told_before_anything_heavy_is_imported(case):
    (case / "study.yaml").write_text(STUDY.replace("threshold_ppm", "treshold"))
    code = (
        "import sys; from taichi_plume.cli.study import main; code = main(['study.yaml']); "
        "sys.exit(code + 10 * bool({'taichi', 'dask', 'distributed', 'matplotlib', 'zarr'} & sys.modules.keys()))"
    )
    path = os.pathsep.join([str(Path(say.__code__.co_filename).parents[2])])
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=case,
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert done.returncode == 2, done.stderr
    assert "treshold" in done.stderr
