"""The case of bouts against distance: quantities of made-up results; the runs are left to the command."""

import numpy as np
import pytest

from taichi_plume.validation import bouts_distance as case
from taichi_plume.validation.searches import scenario_of


@pytest.mark.parametrize("name", case.SETUPS)
def test_probes_lie_behind_the_source_and_puffs_overlap(name):
    setup = case.SETUPS[name]
    scenario = scenario_of(case.scenario(setup, 1))
    assert scenario.probes is not None
    places = np.concatenate([point.places for point in scenario.probes.points])
    np.testing.assert_allclose(places - setup.source, np.outer(setup.distances, (1.0, 0.0, 0.0)), atol=1e-9)
    assert places[:, 0].max() < setup.size[0] - 5 * setup.cell
    assert setup.speed / scenario.gas.release_rate < 1.8 * setup.width  # pyright: ignore[reportAttributeAccessIssue]


def test_fit_and_correlation_of_known_results():
    d = (0.5, 1.0, 2.0, 4.0)
    rng = np.random.default_rng(1)
    line = 30.0 - 5.0 * np.array(d) + 0.01 * rng.normal(size=(5, 4))
    assert case.line_fit(line, d).mean == pytest.approx(1.0, abs=1e-4)
    bent = np.tile([9.0, 1.0, 5.0, 2.0], (5, 1))
    assert case.line_fit(bent, d).mean == pytest.approx(np.corrcoef(bent[0], d)[0, 1] ** 2)
    ranks = case.rank_correlation(np.array([[9.0, 5, 3, 1], [1, 2, 3, 4], [2, 2, 2, 2]]), d)
    assert ranks.tolist() == [-1.0, 1.0, 0.0]


@pytest.mark.parametrize("name", case.SETUPS)
def test_a_power_of_the_distance_is_found(monkeypatch, name):
    d = np.array(case.SETUPS[name].distances)
    values = np.tile(d**-1.5, (4, 1)) * np.arange(1.0, 5.0)[:, None]
    made = case.Found(10.0 * values, values, values, values, values)
    monkeypatch.setattr(case, "results", lambda setup, airs: (made, made))
    results = case.compared(4, name)
    assert (case.EXPECTED[name].keys() | case.PUBLISHED[name].keys()) <= results.keys()
    assert results[case.POWER].mean == pytest.approx(-1.5)
    assert results["bouts: rank correlation with the distance"].mean == pytest.approx(-1.0)
    if name in case.MEASURED:
        assert results[case.FOURTH].mean == pytest.approx(2.0**-1.5)
        assert case.MEASURED[name][2] / case.MEASURED[name][0] == pytest.approx(2.0**-1.6, rel=0.15)
