"""Benchmarks in small: each row holds what it should, and faults are reported."""

import json

import numpy as np
import pytest

from taichi_plume.validation.benchmark import envs, pressure, puffs, start
from taichi_plume.validation.benchmark.__main__ import main
from taichi_plume.validation.benchmark.pressure import cluttered, right_sides
from tests.study.study_rooms import ROOM, UNIFORM, changed


def test_right_sides_can_be_solved():
    """In a closed room what enters the air has to leave it; obstacles have no equations."""
    grid, solid = cluttered(16)
    sides = right_sides(grid, ~solid)
    assert set(sides) == {"random", "smooth", "both"}
    for values in sides.values():
        assert np.abs(values).max() == pytest.approx(1.0)
        assert abs(values.sum()) <= 1e-9 * np.abs(values).sum()
        assert np.all(values[solid] == 0.0)


@pytest.mark.slow
def test_the_pressure_is_solved_as_reported(monkeypatch, capsys):
    monkeypatch.setattr(pressure, "SIDES", (24,))
    assert main(["--pressure", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["right_side"] for row in rows[::2]] == ["random", "smooth", "both"]
    assert [row["solver"] for row in rows] == ["Capacitance", "Multigrid"] * 3
    for row in rows:
        assert (row["N"], row["cells"]) == (24, 24**3)
        assert 1 <= row["iterations"] < 20
        assert row["residual"] <= 3 * row["tolerance"]  # reckoned anew from the solution, with its rounding


@pytest.mark.slow
def test_puffs_are_measured():
    rows = [
        *puffs.step("step", "cpu", puffs.in_room, 2000),
        *puffs.query("query", "cpu", puffs.in_room, 2000),
    ]
    assert [type(row).__name__ for row in rows] == ["PuffStep", "PuffQuery", "PuffQuery"]
    anywhere, in_plume = rows[1:]
    assert 0 < rows[0].puffs <= 4000
    assert in_plume.seeing > anywhere.seeing
    assert all("puffs" in str(row) for row in rows)


@pytest.mark.slow
def test_starts_are_measured_cold_and_warm(tmp_path, capsys):
    config = tmp_path / "still.yaml"
    config.write_text(json.dumps(changed(UNIFORM) | {"name": "still", "warm_up": 1000}))
    assert main(["start", str(config), "--json"]) == 0
    cold, warm = json.loads(capsys.readouterr().out)
    assert (cold["config"], cold["cold"], warm["cold"]) == ("still", True, False)
    assert cold["kernels"] == warm["kernels"] > 3
    assert 0.0 < warm["cpu_seconds"] < cold["cpu_seconds"] + 1.0


@pytest.mark.slow
def test_a_start_that_fails_tells_why(tmp_path):
    with pytest.raises(RuntimeError, match=r"nowhere.yaml: cannot be read"):
        next(start.starts([start.ROOT], [str(tmp_path / "nowhere.yaml")]))


def test_no_environments_are_refused_in_a_line(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["envs", "--count", "0"])
    assert ended.value.code == 2
    assert "--count: 0 is below 1" in capsys.readouterr().err


@pytest.mark.slow
def test_environments_are_measured_beside_what_is_wanted(monkeypatch, capsys):
    monkeypatch.setattr(envs, "RESETS", 200)
    monkeypatch.setattr(envs, "FRAMES", 141)
    assert main(["envs", "--count", "20", "--seconds", "0.1", "--json"]) == 0
    rows = {row["case"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows.keys() >= {"reset of one of them", "reset of all", "memory over 200 resets"}
    for case in ("steps of 20 environments", "steps of a single environment"):
        assert rows[case]["figure"] > 0.0 < rows[case]["cpu_us"]
        assert rows[case]["target"].startswith(">= ")


@pytest.mark.slow
def test_a_shared_air_is_compared_with_runs_of_their_own(tmp_path, capsys):
    (tmp_path / "room.yaml").write_text(json.dumps(changed(ROOM)))
    assert not main(["studies", "shared", str(tmp_path / "room.yaml"), "--searches", "3", "--alone", "2"])
    reported = capsys.readouterr().out
    assert "one air, filmed: 21 frames" in reported
    assert "the same to the bit: 2 of 2" in reported


@pytest.mark.slow
def test_an_air_that_cannot_be_shared_is_reported(tmp_path, capsys):
    (tmp_path / "room.yaml").write_text(json.dumps(changed(UNIFORM)))
    assert main(["studies", "shared", str(tmp_path / "room.yaml")]) == 2
    assert "neither wind nor gas is solved" in capsys.readouterr().err


@pytest.mark.slow
def test_the_memory_over_many_runs_is_reported(tmp_path, capsys):
    (tmp_path / "room.yaml").write_text(json.dumps(changed(UNIFORM)))
    assert not main(["studies", "overhead", str(tmp_path / "room.yaml"), "--runs", "20"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 10
    assert all("MB" in line for line in lines)
