"""Maximum over the height of a gas that is known at points: its position is that of the gas."""

from pathlib import Path

import numpy as np
import pytest

from taichi_plume import open_run
from taichi_plume.cli import run

CONFIG = Path(__file__).parents[2] / "configs/gaussian.yaml"
SOURCE = (1.0, 3.2)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "run"
    sizes = ["--set", "domain.spacing=0.2", "--duration", "0.4 s", "--set", "robots=[]"]
    assert run.main([str(CONFIG), *sizes, "--out", str(out), "--quiet"]) == 0
    return open_run(out).pictures


def test_the_plume_of_points_begins_at_its_source_from_above(recorded):
    column = recorded["gas_column"].isel(time=-1).transpose("x", "y")
    ppm, x, y = column.to_numpy(), column["x"].to_numpy(), column["y"].to_numpy()
    first = x[(ppm > 1.0).any(axis=1)].min()
    assert first == pytest.approx(SOURCE[0], abs=0.2)
    near = ppm[np.abs(x - 3.0) < 0.2].sum(axis=0)
    assert (near * y).sum() / near.sum() == pytest.approx(SOURCE[1], abs=0.05)
