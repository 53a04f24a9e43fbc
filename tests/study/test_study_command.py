"""`python -m taichi_plume.study`: what is wrong is reported in a line, before anything heavy is imported."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_study import ROOM, write

from taichi_plume.cli.study import main
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say
from taichi_plume.scenario.key_facts import first_sentence
from taichi_plume.scenario.keys import all_keys, look_up, print_key, print_schema
from taichi_plume.studies import plan
from taichi_plume.studies.plan import load_plan
from taichi_plume.studies.scenario_checks import Checks
from taichi_plume.studies.study_keys import Study

THRESHOLD = {"key": "robots.0.algorithm.threshold_ppm", "values": [1, 2, 3]}


@pytest.fixture
def case(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, axes={"threshold": THRESHOLD}, airs=2)
    return tmp_path


def refused(*line: str) -> int | str | None:
    with pytest.raises(SystemExit) as end:
        main(line)
    return end.value.code


def test_check_tells_what_it_makes(case, capsys):
    assert main(["study.yaml", "--check"]) == 0
    expected = capsys.readouterr().out
    assert "runs: 6, at 3 points" in expected
    assert "airs: 2; 6 runs share their air with other runs" in expected
    assert "threshold [ppm]" in expected
    assert not (case / "studies").exists()


def test_check_of_many_points_checks_the_ends_and_a_sample(tmp_path, monkeypatch, capsys):
    """And says so; nothing is checked twice, and what a sampled value spoils is found at its end."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plan, "SAMPLE", 30)
    looked = []
    checked = Checks.checked
    monkeypatch.setattr(Checks, "checked", lambda self, one: looked.append(one) or checked(self, one))
    axes = {"rate": {"key": "gas.sources.0.rate", "low": 1e-6, "high": 1e-5}, "threshold": THRESHOLD}
    write(tmp_path, axes=axes, sampling={"kind": "latin", "count": 60}, airs=2)
    assert main(["study.yaml", "--check"]) == 0
    expected = capsys.readouterr().out
    assert "runs: 360, at 180 points" in expected
    assert f"checked: {len(looked)} of these points" in expected
    assert "all before its first run" in " ".join(expected.split())
    assert "... and 170 points more" in expected
    assert len(looked) < 50
    rates = {one.gas.sources[0].rate for one in looked}
    every = load_plan(tmp_path / "study.yaml").requests
    drawn = {one.values["rate"] for one in every}
    assert {min(drawn), max(drawn)} <= rates <= drawn
    assert {one.robots[0].algorithm.threshold_ppm for one in looked} == {
        one.values["threshold"] for one in every
    }
    some = load_plan(tmp_path / "study.yaml", most=30).requests
    numbers = {(one.point, one.run, one.seed) for one in every}
    assert {(one.point, one.run, one.seed) for one in some} < numbers


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (["study.yaml", "--workers", "2", "--scheduler", "tcp://a:1"], "it cannot go with --scheduler"),
        (["study.yaml", "--dashboard"], "--scheduler ADDRESS"),
        ([], "required: STUDY"),
        (["report"], "required: DIR"),
    ],
)
def test_command_lines(case, capsys, line, expected):
    assert refused(*line) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (["study.yaml", "--out", "room.yaml"], "room.yaml: cannot be written to"),
        (
            ["study.yaml", "--out", "."],
            ".: is not empty, and holds no study (room.yaml); choose another --out",
        ),
        (["study.yaml", "--out", ".", "--force"], "holds no study"),
        (["report", "nowhere"], "nowhere: is not the folder of a study"),
    ],
)
def test_bad_input_is_one_line(case, capsys, line, expected):
    assert main(line) == 2
    said = capsys.readouterr()
    assert expected in said.err
    assert (said.out + said.err).count("\n") == 1


def test_code_needs_leave(case, capsys):
    code = "class Mine:\n    def act(self, t, sensors):\n        pass\nraise SystemExit('executed')"
    (case / "own.py").write_text(code)
    robot = ROOM["robots"][0] | {"algorithm": {"kind": "own", "file": "own.py"}}
    write(case, ROOM | {"robots": [robot]})
    assert main(["study.yaml"]) == 2
    said = capsys.readouterr().err
    assert "own.py holds Python code" in said
    assert "--allow-code" in said
    assert not (case / "studies").exists()


def test_bad_input_is_reported_before_anything_heavy_is_imported(case):
    write(case, axes={"threshold": THRESHOLD | {"key": "robots.0.algorithm.treshold"}})
    code = (
        "import sys; from taichi_plume.cli.study import main; code = main(['study.yaml']); "
        "sys.exit(code + 10 * bool({'taichi', 'dask', 'distributed', 'matplotlib', 'zarr'} & sys.modules.keys()))"
    )
    env = os.environ | {"PYTHONPATH": str(Path(say.__code__.co_filename).parents[2])}
    line = [sys.executable, "-c", code]
    done = subprocess.run(line, cwd=case, capture_output=True, text=True, env=env)
    assert done.returncode == 2, done.stderr
    assert "treshold" in done.stderr


# ---------------------------------------------------------------- keys


def test_the_schema_describes_every_key(capsys):
    assert print_schema(Study) == 0
    schema = json.loads(capsys.readouterr().out)
    sections = [schema, *schema["$defs"].values()]
    expected = [one["description"] for section in sections for one in section["properties"].values()]
    assert len(expected) == len(list(all_keys(Study))) >= 20
    for text in expected:
        meaning = text.split("\n\n")[0]
        assert len(meaning.split()) >= 4
        assert len(first_sentence(meaning)) <= 115, meaning
        assert meaning[0].isupper()


def test_a_key_is_found_by_its_name_and_what_is_near_is_suggested(capsys):
    assert print_key("axes.values", Study) == 0
    assert capsys.readouterr().out.startswith("axes[].values\n  List of the key's values")
    with pytest.raises(InputError, match="share_air"):
        print_key("shareair", Study)
    assert look_up("wind.openings.speed", Study) == ([], [])
