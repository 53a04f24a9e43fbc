import json

import numpy as np
import pytest

from taichi_plume.validation.benchmark import pressure, puffs, robots, trials
from taichi_plume.validation.benchmark.__main__ import main
from taichi_plume.validation.benchmark.pressure import cluttered, right_sides


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
def test_the_pressure_is_solved_as_told():
    rows = pressure.solve(24, "cpu")
    assert [row.right_side for row in rows] == ["random", "smooth", "both"]
    for row in rows:
        assert row.solver == "Multigrid"
        assert 1 < row.iterations < 20
        assert row.residual <= 3 * row.tolerance  # reckoned anew from the solution, with its rounding


@pytest.mark.slow
def test_the_table_as_json(monkeypatch, capsys):
    monkeypatch.setattr(pressure, "SIDES", (16,))
    assert main(["--pressure", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["N"] for row in rows] == [16, 16, 16]
    assert all(row["cells"] == 16**3 and row["iterations"] >= 1 for row in rows)


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
def test_robots_are_measured():
    row = robots.ticks("robots", "cpu", "spiral", 300)
    assert row.robots == 300
    assert row.Mrobot_steps_per_s == pytest.approx(
        0.3 / (row.measure_ms + row.act_ms + row.move_ms), rel=1e-6
    )
    assert "spiral" in str(row)


@pytest.mark.slow
def test_trials_in_a_recorded_room_are_measured():
    (row,) = trials.spiral_trials("trials", "cpu", 40, recorded=10.0, limit=100.0)
    assert row.trials == 40
    assert row.robot_steps == pytest.approx(40 * 100 / 0.25, rel=0.3)  # hardly one has found it yet
    assert "40 trials" in str(row)
