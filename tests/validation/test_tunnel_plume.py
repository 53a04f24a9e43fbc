"""The plume in a tunnel: its statistics find what was put into made-up readings; the run is left to the command."""

import numpy as np
import pytest

from taichi_plume.validation import tunnel_plume as case
from taichi_plume.validation.searches import scenario_of

SHAPE, WIDTH = 0.8, 0.17  # of the gamma distribution on the axis; m


def gamma_plume(seed: int, n: int = 20_000) -> case.Records:
    """Readings with a gamma distribution, whose shape is Gaussian across and whose scale is one (Pang et al. 2026).

    The fluctuation over the mean is then 1/√SHAPE on the axis, and the profile of the fluctuation √2 as wide as that of
    the mean.
    """
    rng = np.random.default_rng(seed)
    shapes = np.stack(
        [
            SHAPE * np.exp(-0.5 * (np.linspace(-1.0, 1.0, case.COUNT) * case.across(x) / WIDTH) ** 2)
            for x in case.DISTANCES
        ]
    )
    ppm = rng.gamma(shapes, 30.0, (n, *shapes.shape))
    wind = np.broadcast_to((case.U, 0.0, 0.0), (n, *shapes.shape, 3))
    wind = wind + 0.1 * rng.standard_normal((n, 1, 1, 1))
    return case.Records(np.arange(n) * case.STEP, dict.fromkeys(case.KINDS, ppm), wind)


@pytest.fixture(scope="module")
def found():
    return case.found_in(gamma_plume(1), case.LARGE)


def test_a_gamma_plume_is_one(found):
    far = np.array([case.across(x) for x in case.DISTANCES]) > 3.0 * WIDTH  # readings reach around it
    assert far.sum() >= 2
    np.testing.assert_allclose(found.width[far], WIDTH, rtol=0.03)
    np.testing.assert_allclose(found.narrower[far], np.sqrt(0.5), rtol=0.03)
    np.testing.assert_allclose(found.peak / found.peak_gamma, 1.0, atol=0.06)
    np.testing.assert_allclose(found.present, found.present_gamma, atol=0.02)
    np.testing.assert_allclose(found.beside, found.beside_gamma, atol=0.02)
    np.testing.assert_allclose(found.intensity, SHAPE**-0.5, rtol=0.05)


def wind_across(fluctuation: np.ndarray) -> np.ndarray:
    """The same record (n,) [m/s] at all places."""
    return np.broadcast_to(fluctuation[:, None, None], (len(fluctuation), len(case.DISTANCES), 2))


def test_a_plume_in_slow_eddies_widens_evenly():
    """σ² = σ0² + (v' t)²: what a parcel sets out with it keeps (Taylor 1921)."""
    t = np.arange(20_000) * 0.04
    wind = wind_across(0.1 * np.sqrt(2.0) * np.sin(2.0 * np.pi * t / 100.0))
    expected = np.hypot(0.01, 0.1 * np.array(case.DISTANCES))
    np.testing.assert_allclose(case.taylor(0.01, 1.0, wind, 0.04), expected, rtol=0.02)


def test_a_plume_in_quick_eddies_diffuses():
    """σ² grows with the distance: 2 v'² T t, T = 0.44 U/v' times half a step."""
    wind = wind_across(0.1 * np.random.default_rng(3).standard_normal(50_000))
    widths = case.taylor(0.0, 1.0, wind, 0.001)
    x = np.array(case.DISTANCES)
    np.testing.assert_allclose(widths**2 / x, 2.0 * 0.1**2 * 0.44 / 0.1 * 0.0005, rtol=0.05)


def test_the_scenario_can_be_run_and_measures_where_it_says():
    scenario = scenario_of(case.scenario(1, 10.0))
    assert scenario.probes is not None
    for line, x in zip(scenario.probes.points, case.DISTANCES, strict=True):
        assert line.places[:, 0] == pytest.approx(case.PLACE[0] + x)
        assert line.places[case.COUNT // 2] == pytest.approx((case.PLACE[0] + x, *case.PLACE[1:]))
    widths = [part.initial_size for part in scenario.gas.parts[:2]]  # pyright: ignore[reportAttributeAccessIssue]
    assert widths == [pytest.approx(d / 4.0) for d in (0.009, 0.035)]
    for part in scenario.gas.parts[:2]:  # pyright: ignore[reportAttributeAccessIssue]
        assert case.U / part.release_rate < 1.8 * part.initial_size


def test_what_is_judged_is_reported_for_every_kind(monkeypatch):
    made = [gamma_plume(k, 1000) for k in (1, 2)]
    airs = tuple({kind: case.found_in(one, kind) for kind in case.KINDS} for one in made)
    monkeypatch.setattr(case, "_airs", lambda count: airs)
    for kind in case.KINDS:
        reported = case.plume(2, kind)
        assert case.EXPECTED[kind].keys() <= reported.keys()
    assert reported["c'/C over that of puffs of 35 mm, where wide"].mean == pytest.approx(1.0)
