"""What the benchmark of studies tells of a small room."""

import json

import pytest

from taichi_plume.validation.benchmark import __main__ as benchmark
from tests.study.rooms import ROOM, UNIFORM, changed

pytestmark = pytest.mark.slow


def test_a_shared_air_is_compared_with_runs_of_their_own(tmp_path, capsys):
    (tmp_path / "room.yaml").write_text(json.dumps(changed(ROOM)))
    assert not benchmark.main(
        ["studies", "shared", str(tmp_path / "room.yaml"), "--searches", "3", "--alone", "2"]
    )
    told = capsys.readouterr().out
    assert "one air, filmed: 21 frames" in told
    assert "the same to the bit: 2 of 2" in told


def test_an_air_that_cannot_be_shared_is_told(tmp_path, capsys):
    (tmp_path / "room.yaml").write_text(json.dumps(changed(UNIFORM)))
    assert benchmark.main(["studies", "shared", str(tmp_path / "room.yaml")]) == 2
    assert "cost nothing" in capsys.readouterr().err


def test_the_memory_over_many_runs_is_told(tmp_path, capsys):
    (tmp_path / "room.yaml").write_text(json.dumps(changed(UNIFORM)))
    assert not benchmark.main(["studies", "overhead", str(tmp_path / "room.yaml"), "--runs", "20"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 10
    assert all("MB" in line for line in lines)
