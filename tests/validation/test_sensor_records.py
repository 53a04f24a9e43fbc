"""The case of recorded metal oxides: statistics of made-up sensors whose noise, lag and drift are known."""

from functools import partial

import numpy as np
import pandas as pd
import pytest

from taichi_plume.fluctuations.sensor_comparison import readings
from taichi_plume.scenario.metal_oxides import MOX_MODELS
from taichi_plume.scenario.sensors import MoxSensor
from taichi_plume.validation import sensor_records as case
from taichi_plume.validation.published_data import VARIABLE

QUIET = round(case.QUIET / case.STEP)
CLEAR = np.zeros((QUIET, 1))


def falling(model: str, decay_time: float, resistance: bool = False) -> np.ndarray:
    """Return gas (n, 1) [ppm] as a sensor reads it after 60 ppm, where ln R or R approaches clean air."""
    c0, b = MOX_MODELS[model].curve(case.GAS) or (1.0, 1.0)
    left = np.exp(-np.arange(0.0, 60.0, case.STEP) / decay_time)
    if not resistance:
        return c0 * np.expm1(np.log1p(60.0 / c0) * left)[:, None]
    resistances = 1.0 + ((1.0 + 60.0 / c0) ** -b - 1.0) * left
    return c0 * (resistances ** (-1.0 / b) - 1.0)[:, None]


@pytest.mark.parametrize("model", ["tgs2600", "tgs2610", "tgs2620"])
@pytest.mark.parametrize("resistance", [False, True])
def test_the_decay_time_of_a_fall_is_found(model, resistance):
    record = case.Record.of(np.concatenate([CLEAR, falling(model, 12.0, resistance)]))
    signal = case.conductive if resistance else case.logarithm
    rate = case.steepest(record, partial(signal, model=model))
    assert rate == pytest.approx(1.0 / 12.0, rel=1e-6)


def test_no_fall_is_no_bound():
    record = case.Record.of(np.concatenate([CLEAR, np.linspace(5.0, 50.0, 100)[:, None]]))
    assert np.isnan(case.steepest(record, np.asarray)).all()
    assert case.steepest(record, np.asarray, rise=True) > 0.0


@pytest.mark.usefixtures("taichi")
def test_our_sensors_fall_as_fast_as_their_decay_time_and_no_faster():
    gas = np.zeros((QUIET + 300, 1), np.float32)
    gas[QUIET : QUIET + 100] = 60.0
    model = "tgs2620"
    sensor = MoxSensor(kind="mox", model=model, noise=0.0)
    ppm = np.array([now[0] for now in readings([sensor], case.GAS, case.STEP, gas)], float)
    rate = case.steepest(case.Record.of(ppm), partial(case.logarithm, model=model))
    assert rate == pytest.approx(1.0 / MOX_MODELS[model].decay, rel=1e-3)


def test_digits_and_noise_of_a_converter_are_found():
    rng = np.random.default_rng(1)
    slow = np.repeat(rng.normal(0.0, 0.5, (QUIET // 4, 50)), 4, axis=0)
    record = case.Record.of(0.08 * np.round(slow + 0.3))
    assert np.nanmedian(case.digit(record)) == pytest.approx(0.08)
    white = case.Record.of(rng.normal(0.0, 0.03, (QUIET, 50)))
    assert case.noise(white).mean() == pytest.approx(0.03, rel=0.03)
    assert np.isnan(case.digit(case.Record.of(np.zeros((QUIET, 1)))))


def test_the_size_of_a_random_walk_is_found():
    rng = np.random.default_rng(2)
    per_step = 0.4 * np.sqrt(case.STEP / 3600.0)
    walk = case.Record.of(np.cumsum(rng.normal(0.0, per_step, (QUIET, 2000)), axis=0))
    assert 0.8 < np.sqrt((case.drift(walk) ** 2).mean()) / 0.4 < 1.0  # at least, as minutes are averaged
    noise = np.repeat(rng.normal(0.0, 0.03, (QUIET // 4, 2000)), 4, axis=0)
    assert case.drift(case.Record.of(noise)).mean() < 0.1


def test_intensity_and_correlation_time_of_a_known_process_are_found():
    rng = np.random.default_rng(3)
    keep = np.exp(-case.STEP / 10.0)
    gas = np.zeros((20_000, 4))
    for n in range(1, len(gas)):
        gas[n] = keep * gas[n - 1] + rng.normal(0.0, np.sqrt(1.0 - keep**2), 4)
    ppm = np.concatenate([np.zeros((QUIET, 4)), 10.0 + gas])
    intensity, time = case.fluctuation(case.Record.of(ppm))
    assert intensity.mean() == pytest.approx(0.1, rel=0.1)
    assert time.mean() == pytest.approx(10.0, rel=0.15)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Two records of six sensors with two gains, which fall with a time constant of 3 s, in the second of 30 s."""
    rng = np.random.default_rng(4)
    gains = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    (tmp_path / "orebro").mkdir()
    for name, decay_time in zip(case.RECORDS, (3.0, 30.0), strict=False):
        fall = falling("tgs2600", decay_time)
        rise = np.repeat(fall[0], 4)[:, None]
        ppm = np.concatenate([CLEAR, rise, fall, np.linspace(5.0, 50.0, 120)[:, None]]) * gains
        ppm[:QUIET] += np.repeat(rng.choice([0.0, 0.02], (QUIET // 4, 6)), 4, axis=0)
        table = pd.DataFrame(ppm, columns=[f"C_{n}{k} (ppm)" for n in range(2) for k in range(3)])
        table.to_csv(tmp_path / "orebro" / f"exp{name:02d}.csv.gz", index=False)
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    for part in (case.records, case.our_records):
        part.cache_clear()
    yield
    for part in (case.records, case.our_records):
        part.cache_clear()


@pytest.mark.usefixtures("folder", "taichi")
def test_records_of_a_folder_are_compared():
    results = {}
    for condition in case.CASES[0].conditions:
        found = condition.run(2)
        assert condition.expected.keys() <= found.keys()
        results |= found
    assert results[f"ln R lags: {case.EVERY}"].mean == 0.5  # one record of two
    assert results["ln R lags: share of sensors faster than tgs2620 allows, in any record"].mean == 1.0
    assert results[case.NOISE].mean == pytest.approx(0.5 * case.DIGIT, rel=0.1)
    assert results["correlation of ln c between records"].mean == pytest.approx(1.0)
    share = results[f"{case.DEFAULT.model}: {case.STEEPNESS}"].mean
    assert 0.3 < share < 1.0
