import json

import numpy as np
import pytest

from taichi_plume.validation.benchmark import pressure, puffs, robots, start, trials
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
def test_the_pressure_is_solved_as_told(monkeypatch, capsys):
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
def test_robots_are_measured():
    row = robots.ticks("robots", "cpu", "spiral", 300)
    assert row.robots == 300
    assert row.Mrobot_steps_per_s == pytest.approx(
        0.3 / (row.measure_ms + row.act_ms + row.move_ms), rel=1e-6
    )
    assert "spiral" in str(row)


@pytest.mark.slow
def test_trials_in_a_recorded_room_are_measured():
    (row,) = trials.spiral_trials("trials", "cpu", 40, recorded=4.0, limit=50.0)
    assert row.trials == 40
    assert row.robot_steps == pytest.approx(40 * 50 / 0.25, rel=0.3)  # hardly one has found it yet
    assert "40 trials" in str(row)


@pytest.mark.slow
def test_starts_are_measured_cold_and_warm(tmp_path, capsys):
    config = tmp_path / "still.yaml"
    config.write_text("""
name: still
duration: 1
warm_up: 1000
domain: {size: [2.0, 1.5], spacing: 0.1}
wind: {kind: uniform, velocity: [0.3, 0]}
gas: {kind: eulerian, sources: [{position: [0.4, 0.75], rate: 10 mg/s}]}
""")
    assert main(["start", str(config), "--json"]) == 0
    cold, warm = json.loads(capsys.readouterr().out)
    assert (cold["config"], cold["cold"], warm["cold"]) == ("still", True, False)
    assert cold["kernels"] == warm["kernels"] > 5
    assert 0.0 < warm["cpu_seconds"] < cold["cpu_seconds"] + 1.0


@pytest.mark.slow
def test_a_start_that_fails_tells_why(tmp_path):
    with pytest.raises(RuntimeError, match=r"nowhere.yaml: cannot be read"):
        next(start.starts([start.ROOT], [str(tmp_path / "nowhere.yaml")]))
