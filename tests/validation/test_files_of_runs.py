"""Cases, benchmarks and comparisons that write files of runs by themselves can do it."""

import pytest

from taichi_plume.files.plumesim_log import read_log
from taichi_plume.validation import plumesim_cases
from taichi_plume.validation.benchmark.trials import spiral_trials

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("taichi")]


def test_a_log_of_the_turbulent_plume(monkeypatch, tmp_path):
    monkeypatch.setattr(plumesim_cases, "RECORDED", 2.0)
    plumesim_cases.recorded.cache_clear()
    (tmp_path / "plume.pslog").write_bytes(plumesim_cases.recorded(0))
    plumesim_cases.recorded.cache_clear()
    assert len(read_log(tmp_path / "plume.pslog")) == 3


def test_trials_in_a_film():
    (row,) = spiral_trials("few", "cpu", trials=3, recorded=2.0, limit=4.0)
    assert row.trials == 3
    assert row.robot_steps == 3 * 16
