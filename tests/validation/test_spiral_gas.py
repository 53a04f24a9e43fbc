"""The case of five sensors before a dish: its rooms, and its statistics of made-up series."""

import numpy as np
import pytest

from taichi_plume.validation import spiral_gas as case
from taichi_plume.validation.searches import scenario_of
from taichi_plume.validation.spiral_index import ROW

T = case.SAMPLE * np.arange(round(120.0 / case.SAMPLE))  # s


def series(values: np.ndarray) -> np.ndarray:
    """Series (n, 1, 1) of one sensor."""
    return values[:, None, None]


@pytest.mark.parametrize("air", case.ROOMS)
def test_rows_of_sensors_start_30_cm_from_the_dish(air):
    scenario = scenario_of(case.scenario(air, 0, fluctuations=True))
    (_, dish), (sensors,) = scenario.sources[0], scenario.robots
    places = np.array(sensors.start.positions)  # pyright: ignore[reportAttributeAccessIssue]
    apart = places - dish.position[:2]
    distances = np.hypot(*apart.T)
    assert set(np.round(distances, 3)) == {d / 100 for d in ROW}
    assert (np.abs(apart).min(axis=1) < 1e-3).all()  # in perpendicular directions
    assert len(places) == (20 if air == "no wind" else 16)
    if air == "fan":
        assert dish.position[0] == case.FAN_DISTANCE
        assert (case.ASIDE.max() + dish.position[1]) < scenario.domain.extent[1]
    else:
        assert scenario.warm_up + case.SETTLING == case.EVAPORATED == 15 * 60


def test_index_of_a_wave_is_its_mean_and_half_of_each_peak():
    wave = series(7.0 + 2.0 * np.sin(2 * np.pi * (T - 1.25) / 5.0))  # sampled at its peaks
    assert case.indices(wave, 30.0, 5.0, 0.5).ravel() == pytest.approx(4 * [7.0 + 6 * 0.5 * 2.0], rel=0.01)
    assert case.indices(wave, 30.0, 15.0, 1.0).ravel() == pytest.approx(4 * [7.0 + 2 * 2.0], rel=0.01)
    assert case.indices(wave, 10.0, 5.0, 0.5).ravel() == pytest.approx(12 * [7.0 + 2 * 0.5 * 2.0], rel=0.01)
    assert case.indices(series(np.full(len(T), 7.0)), 30.0, 5.0, 0.5).ravel().tolist() == 4 * [14.0]


def test_peaks_and_variation_of_a_wave():
    wave = series(7.0 + 2.0 * np.sin(2 * np.pi * (T - 1.0) / 10.0))
    count, height = case.peaks(wave)
    assert count.item() == pytest.approx(3.0)
    assert height.item() == pytest.approx(2.0, rel=0.05)
    assert case.variation(wave).item() == pytest.approx(np.sqrt(2.0) / 7.0, rel=1e-3)
    ripple = series(7.0 + 0.3 * np.sin(2 * np.pi * T / 10.0))  # below PEAK
    assert [part.item() for part in case.peaks(ripple)] == [0.0, 0.0]


def test_order_of_pairs_and_of_neighbours():
    row = np.array([5.0, 4.0, 1.0, 2.0, 3.0])
    assert case.in_order(row) == 7 / 10
    assert case.in_order(row, neighbours=True) == 2 / 4
    assert case.in_order(np.array([row, [1.0, *4 * [np.nan]]])) == 7 / 10
    assert case.ranks(np.array([row[[0, 1, 4, 3, 2]], np.ones(5)])) == pytest.approx(-0.5)


def test_edge_of_a_gaussian_plume():
    width = np.sqrt(2.0) * (np.sqrt(-np.log(0.1)) - np.sqrt(-np.log(0.9)))
    profile = 3.0 * np.exp(-0.5 * (case.ASIDE / 0.2) ** 2)
    assert case.falls_within(profile) == pytest.approx(0.2 * width, rel=0.01)
    assert case.falls_within(np.ones(len(case.ASIDE))) == np.inf


@pytest.mark.parametrize("air", case.ROOMS)
def test_an_orderly_series_gives_what_is_expected(monkeypatch, air):
    """Peaks that are rarer and lower from sensor to sensor, smooth readings behind the fan."""

    def listened(air: str, number: int, fluctuations: bool) -> case.Series:
        place = np.arange(len(ROW))
        period = 5.0 * (1.0 + place) + 0.1 * number
        height = 0.4 if air == "no wind" else 0.02
        wave = (5.0 - place) * (1.0 + height * np.sin(2 * np.pi * T[:, None] / period))
        values = np.repeat(wave[:, None], 4, axis=1)
        upwind = case.DIRECTIONS[air].index(180)
        if air == "fan":
            values[:, upwind] *= 0.01
            values[:, upwind, 1:] = np.nan
        return case.Series(values, values, np.exp(-0.5 * (case.ASIDE / 0.1) ** 2))

    monkeypatch.setattr(case, "listened", listened)
    results = case.results(3, air, fluctuations=False)
    judged = {name: results[name].mean for name in case.EXPECTED[air]}  # pyright: ignore
    assert case.PUBLISHED[air].keys() <= results.keys()
    missed = {name for name, bounds in case.EXPECTED[air].items() if not bounds.met(judged[name])}
    assert missed <= {case.LONGER, case.CRITICAL, case.INSTANT}  # of which this series says nothing
    if air == "no wind":
        assert judged[case.HEIGHT] == pytest.approx(-1.0)
        assert judged[case.RATIO] == pytest.approx(20.0, rel=0.2)
    else:
        assert judged[case.INSTANT] == judged[case.FALLS] == 1.0
        assert judged[case.UPWIND] == pytest.approx(0.01, rel=1e-3)
