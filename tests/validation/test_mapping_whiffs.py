"""Readings without air: their statistics, the ways they are taken on, and what maps make of them."""

import numpy as np
import pytest

from taichi_plume.agents.time_series import neighbourhood
from taichi_plume.scenario.maps import TimeSeriesMap
from taichi_plume.validation import mapping_whiffs
from taichi_plume.validation.mapping_cases import ALPHAS
from taichi_plume.validation.mapping_whiffs import (
    CASES,
    MARGIN,
    SIZE,
    TICK,
    endless,
    mapped,
    plume,
    remembering,
    ways,
    whiffs,
)

pytestmark = pytest.mark.usefixtures("taichi")


def test_whiffs_are_as_reported():
    found = whiffs(200_000, 5.0, np.random.default_rng(1))
    assert found.mean() == pytest.approx(1.0, abs=0.02)
    assert found.std() == pytest.approx(1.0, abs=0.05)
    logarithm = np.log(found)
    together = np.corrcoef(logarithm[10:, 0], logarithm[:-10, 0])[0, 1]  # 5 s apart
    assert together == pytest.approx(np.exp(-1.0), abs=0.02)


@pytest.mark.parametrize("speed", [0.05, 0.3])
def test_the_line_sweeps_at_its_speed(speed):
    place = ways(speed, 2000)
    assert place.shape == (2000, 4, 2)
    steps = np.abs(np.diff(place[..., 1], axis=0))
    assert np.median(steps) == pytest.approx(speed * TICK)
    assert place[..., 1].min() == pytest.approx(MARGIN, abs=speed * TICK)
    assert place[..., 1].max() == pytest.approx(SIZE[1] - MARGIN, abs=speed * TICK)
    assert (np.diff(place[..., 0], axis=0) == 0.0).all()


def test_the_plume_is_downwind_and_carries_the_same_gas_everywhere():
    y = np.linspace(0.0, 4.0, 4001)  # wider than the arena: all of it counts
    across = [plume(np.stack([np.full_like(y, x), y], axis=-1)).sum() for x in (1.0, 1.8, 3.0)]
    assert across[0] == 0.0
    assert across[1] == pytest.approx(across[2], rel=1e-3)


def test_remembering_goes_from_one_snap_to_a_long_mean():
    kept = np.array([0.0, 0.5, 0.9])
    assert remembering(0.4, kept, 10.0) == pytest.approx(1.0)  # sees the last snap alone
    assert endless(np.array(0.5)) == pytest.approx(1.0)
    assert (remembering(0.98, kept)[[0, 2]] < [0.75, 10.0]).all()
    for alpha in (0.6, 0.9):  # independent snaps with weights g: sqrt((1 + sum of g²)/2)
        lags = {0.6: 3, 0.9: 10}[alpha]
        assert np.sqrt(0.5 * (1 + 1 / lags)) <= remembering(alpha, 0.0) < 1.0
    # by drawing: an autoregression, forecast with the weights of alpha = 0.6
    stencil = neighbourhood(TimeSeriesMap(kind="time_series", alpha=0.6), 15)
    g = [sum(U for lag, _, _, U in stencil if lag == n) for n in (1, 2, 3)]
    x, rng = np.zeros((6, 200_000)), np.random.default_rng(2)
    x[0] = rng.standard_normal(x.shape[1])
    for n in range(1, 6):
        x[n] = 0.3 * x[n - 1] + np.sqrt(1 - 0.09) * rng.standard_normal(x.shape[1])
    forecast = (g[0] * x[4] + g[1] * x[3] + g[2] * x[2]) / sum(g)
    drawn = np.abs(x[5] - forecast).mean() / np.abs(x[5] - x[4]).mean()
    assert remembering(0.6, 0.3) == pytest.approx(drawn, rel=0.01)


@pytest.mark.slow
def test_what_is_forgotten_between_snaps_is_forecast_better_from_many(monkeypatch):
    """Quick robots among short whiffs gain from every snap; slow ones among long whiffs do not."""
    short = tuple(case for case in CASES if case in ((0.5, 0.2), (20.0, 0.05)))
    monkeypatch.setattr(mapping_whiffs, "CASES", short)
    found = mapped()
    quick, slow = (short.index(case) for case in ((0.5, 0.2), (20.0, 0.05)))
    assert found["error"].shape == (len(ALPHAS), 2)
    assert found["correlation"][quick] < 0.1 < found["correlation"][slow]
    assert (found["error"][1:, quick] < 0.95).all()
    assert (found["error"][1:, slow] > found["error"][1:, quick]).all()
    assert found["endless"][quick] == pytest.approx(
        1.0 / np.sqrt(2.0 * (1.0 - found["correlation"][quick])), rel=0.1
    )
