"""The case of the office: statistics of series with known answers, and its scenarios; the runs are left to others."""

import gzip

import numpy as np
import pandas as pd
import pytest

from taichi_plume.validation import orebro_office as case
from taichi_plume.validation.searches import scenario_of

SENSORS = len(case.SENSORS)


def noise(seconds, n, seed=1):
    """Return a stationary series (n, SENSORS) of unit deviation whose autocorrelation is exp(-t/seconds)."""
    rng = np.random.default_rng(seed)
    keep = np.exp(-case.STEP / seconds)
    series = np.empty((n, SENSORS))
    series[0] = rng.normal(size=SENSORS)
    for k in range(1, n):
        series[k] = keep * series[k - 1] + np.sqrt(1.0 - keep**2) * rng.normal(size=SENSORS)
    return series


def test_a_rise_gives_its_time_constant_layers_and_fluctuations():
    t = case.STEP * np.arange(100 * case.MINUTE) - 600.0  # release at 10 minutes, end at 80 minutes
    tau = 900.0
    rise = np.where(t > 0.0, -np.expm1(-t / tau), 0.0)
    rise[t > 4200.0] *= np.exp(-(t[t > 4200.0] - 4200.0) / 300.0)
    shares = np.tile([0.4, 1.4, 1.2], SENSORS // 3)
    shares[4] += 0.9  # in the middle layer
    ppm = 5.0 * rise[:, None] * shares * (1.0 + 0.05 * noise(20.0, len(t)))
    found = case.statistics(ppm)
    mean = shares.mean()
    assert found.low == pytest.approx(0.4 / mean, rel=0.02)
    assert found.middle == pytest.approx(1.5 / mean, rel=0.02)
    assert found.high == pytest.approx(1.2 / mean, rel=0.02)
    assert found.largest == pytest.approx(2.3 / mean, rel=0.02)
    assert found.rise == pytest.approx(tau / 60.0, rel=0.1)  # counted from 5 %
    assert found.fluctuation == pytest.approx(0.05, rel=0.1)
    assert found.time == pytest.approx(20.0, rel=0.15)
    assert found.mean == pytest.approx(5.0 * mean * 0.98, rel=0.02)  # 40 to 70 minutes after the release


def test_a_trend_of_ten_minutes_is_no_fluctuation():
    t = case.STEP * np.arange(3 * case.BLOCK)
    wave = 0.1 * np.sin(2.0 * np.pi * t / 60.0)  # ten periods in a block
    steady = 2.0 + wave
    c, time = case.fluctuations(np.tile(steady[:, None], (1, SENSORS)))
    drifting, _ = case.fluctuations(np.tile((steady + 0.001 * (t - t.mean()))[:, None], (1, SENSORS)))
    assert c.shape == time.shape == (3, SENSORS)
    assert c == pytest.approx(0.1 / np.sqrt(2.0) / 2.0, rel=0.02)
    assert drifting[1] == pytest.approx(c[1], rel=0.02)
    assert time == pytest.approx(60.0 * np.arccos(1.0 / np.e) / (2.0 * np.pi), abs=0.6)  # of a cosine


@pytest.mark.parametrize("seconds", [5.0, 15.0])
def test_the_time_to_1_over_e_is_that_of_an_exponential(seconds):
    series = noise(seconds, 40 * case.BLOCK)[:, :3].T
    assert np.mean([case.decorrelation(part) for part in series]) == pytest.approx(seconds, rel=0.1)


def test_a_file_is_read_in_the_order_of_the_sensors(tmp_path, monkeypatch):
    names = [f"C_{i}{j}{k} (ppm)" for i in range(3) for j in range(3) for k in range(3)]
    columns = (
        {"# t (s)": [0.0, 0.5]} | {name: [n, 10.0 * n] for n, name in enumerate(names)} | {"T_1 (deg)": 20.0}
    )
    path = tmp_path / "orebro" / "exp01.csv.gz"
    path.parent.mkdir()
    monkeypatch.setenv("TAICHI_PLUME_DATA", str(tmp_path))
    with gzip.open(path, "wt") as file:
        pd.DataFrame(columns).to_csv(file, index=False)
    assert case.record(1).tolist() == [list(range(27)), [10.0 * n for n in range(27)]]
    heights = case.SENSORS.reshape(-1, 3, 3)[:, :, 2]
    assert (heights == case.HEIGHTS).all()


@pytest.mark.parametrize("number", case.SETUPS)
def test_each_setup_is_a_scenario(number):
    setup = case.SETUPS[number]
    checked = scenario_of(case.scenario({"vapour": setup.source}, setup.fan))
    assert checked.probes is not None
    assert checked.probes.size == SENSORS + 1
    assert checked.sources[0][1].position == setup.source
    assert len(checked.robots) == (setup.fan is not None)


@pytest.mark.parametrize("cell", [0.15, 0.2])
def test_the_supply_changes_the_air_as_often_as_assumed(cell):
    keys = case.scenario({"vapour": case.TABLE}, cell=cell, supply=2.0)
    domain = scenario_of(keys).domain
    duct = keys["wind"]["openings"][0]
    flow = duct["speed"] * np.prod(duct["size"])
    assert 3600.0 * flow / np.prod(domain.extent) == pytest.approx(2.0 * case.CHANGES)


@pytest.mark.usefixtures("taichi")
def test_sensors_follow_the_gas_with_their_lag():
    ppm = np.zeros((case.LATE + 600, SENSORS))
    ppm[600:] = 3e-4
    read = case.measured_by_sensors(ppm, 8.0)
    assert read[-case.LATE // 2 :].mean() == pytest.approx(8.0, rel=0.02)
    rising = read[601 : 601 + 40].mean(axis=1)
    assert rising[0] < 4.0 < rising[-1]
    assert abs(read[:600].mean()) < 0.1


def test_of_the_experiments_of_one_run_each_has_its_release(monkeypatch):
    """Experiments 1, 2 and 5 share an air: the first two have the gas of the table, the third that of the floor."""
    rise = -np.expm1(-case.STEP * np.arange(61 * case.MINUTE) / 1000.0)
    layered = rise[:, None] * np.tile([0.5, 1.5, 1.0], 9)
    even = rise[:, None] * np.ones(SENSORS)
    made = case.Run({case.TABLE: layered, case.FLOOR: even}, 0.05, np.array([0.5, 1.5, 2.5]))
    monkeypatch.setattr(case, "run", lambda sources, *others: made)
    monkeypatch.setattr(case, "measured_by_sensors", lambda ppm, mean: ppm * mean / ppm[-case.LATE :].mean())
    results = case.compared(1, case.UNMOVED)
    assert (case.expected(case.UNMOVED).keys() | case.published(case.UNMOVED).keys()) <= results.keys()
    for number, low in ((1, 0.5), (2, 0.5), (5, 1.0)):
        assert results[f"low layer, exp. {number}"].mean == pytest.approx(low)
        assert results[f"rise time [min], exp. {number}"].mean == pytest.approx(1000.0 / 60.0, rel=0.1)
    apart = [
        0.5 - 0.385,
        1.5 - 1.36,
        1.0 - 1.26,
        0.5 - 0.578,
        1.5 - 1.26,
        1.0 - 1.17,
        1 - 1.26,
        1 - 0.851,
        1 - 0.894,
    ]
    assert results[case.LAYERS].mean == pytest.approx(np.sqrt(np.mean(np.square(apart))))
