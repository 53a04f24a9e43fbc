"""Which whiffs sensors keep: square pulses, where the closed form of a first-order lag decides."""

import numpy as np
import pytest

from taichi_plume.fluctuations.sensor_comparison import (
    NamedSensor,
    compare_sensors,
    compared_sensors,
    readings,
)
from taichi_plume.scenario.sensors import IdealGasSensor, MoxSensor, PidSensor

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

STEP = 0.01


def pulses(width, gap, count, height=10.0):
    """A record of square pulses, clean air first and last."""
    one = np.concatenate([np.full(round(width / STEP), height), np.zeros(round(gap / STEP))])
    return np.concatenate([np.zeros(round(gap / STEP)), np.tile(one, count)]).astype(np.float32)


def lagging(tau, **keys) -> PidSensor:
    """A linear sensor of a time constant, that errs in nothing and reads isobutylene at every tick."""
    return PidSensor(
        kind="pid", rise_time=tau, decay_time=tau, period=STEP, noise_ppm=0, detection_limit_ppm=0, **keys
    )


def kept(records, threshold, *models):
    ppm = records if records.ndim == 2 else records[:, None]
    return compare_sensors(
        [NamedSensor("", one) for one in models], "isobutylene", STEP, ppm, threshold
    ).sensors


def test_pulses_far_apart_are_kept_and_close_ones_are_one():
    fast, slow = lagging(0.05), lagging(12.0)
    far, near = kept(pulses(2, 60, 8), 1.0, fast, slow), kept(pulses(2, 0.5, 20), 1.0, fast, slow)
    assert [(one.seen, one.whiffs, one.rises) for one in far] == [(8, 8, 8), (8, 8, 8)]
    assert [(one.seen, one.whiffs) for one in near] == [(20, 20), (1, 20)]


def test_a_lag_decides_by_its_closed_form():
    """The second of two equal pulses is kept if the reading, A (1 - e^-w) after the first, fell to the threshold.

    That is after the gap tau ln(A (1 - e^(-w/tau)) / threshold); and the first one is kept if it comes up to it at all.
    """
    tau, height, width = 1.0, 10.0, 0.8
    for threshold in (1.0, 3.0):
        peak = height * (1 - np.exp(-width / tau))
        gap = tau * np.log(peak / threshold)
        for factor, whole in ((0.93, 1), (1.07, 2)):
            record = pulses(width, gap * factor, 2)
            assert kept(record, threshold, lagging(tau))[0].seen == whole
    longest = -tau * np.log(1 - 3.0 / height)
    assert kept(pulses(0.9 * longest, 9, 3), 3.0, lagging(tau))[0].seen == 0
    assert kept(pulses(1.1 * longest, 9, 3), 3.0, lagging(tau))[0].seen == 3


def test_readings_are_those_of_the_lag():
    """At the ends of ticks in which the gas stands still; a sensor that reads half as much of this gas, half of it."""
    record = np.zeros((300, 1), np.float32)
    record[100:200] = 6.0
    tau = 0.4
    model = lagging(tau)
    found = np.array(list(readings([model, model], "isobutylene", STEP, record)))[:, 0, 0]
    t = np.arange(1, 101) * STEP
    np.testing.assert_allclose(found[100:200], 6 * (1 - np.exp(-t / tau)), rtol=1e-4)
    np.testing.assert_allclose(found[200:], found[199] * np.exp(-t / tau), rtol=1e-4)


def test_the_ideal_sensor_keeps_all_and_so_does_one_that_reads_another_gas():
    rng = np.random.default_rng(0)
    record = np.repeat(rng.exponential(1.0, (300, 3)), 20, axis=0)
    ideal = IdealGasSensor(kind="ideal", period=STEP)
    found = compare_sensors(
        [NamedSensor("", ideal), NamedSensor("", lagging(0.0))],
        "ethanol",
        STEP,
        record.astype(np.float32),
        1.0,
    ).sensors
    assert found[0].whiffs > 100
    assert [one.share for one in found] == [1.0, 1.0]
    assert found[1].threshold == pytest.approx(0.1)  # the detector's reading of 1 ppm of ethanol


def test_a_metal_oxide_of_12_s_merges_what_a_sensor_of_50_ms_tells_apart():
    slow, fast, *_ = compared_sensors()
    assert isinstance(slow.model, MoxSensor)
    assert slow.model.signal.rise == slow.model.signal.decay == 12.0
    assert fast.model.signal.rise == 0.05
    record = pulses(1.0, 0.5, 30, 50.0)
    merged, apart = compare_sensors([slow, fast], "isobutylene", STEP, record[:, None], 5.0).sensors
    assert apart.share == 1.0
    assert merged.seen <= 1
    far, _ = compare_sensors(
        [slow, fast], "isobutylene", STEP, pulses(10.0, 100.0, 3, 50.0)[:, None], 5.0
    ).sensors
    assert far.share == 1.0


def test_whiffs_that_the_record_cuts_do_not_count():
    record = np.concatenate([np.full(100, 5.0), pulses(0.5, 0.5, 4), np.full(50, 5.0)]).astype(np.float32)
    (found,) = kept(record, 1.0, lagging(0.0))
    assert (found.whiffs, found.seen, found.rises) == (4, 4, 4)
    (none,) = kept(np.full(50, 5.0, np.float32), 1.0, lagging(0.0))
    assert none.whiffs == 0
    assert np.isnan(none.share)


def test_all_models_of_scenarios_are_asked():
    models = {getattr(one.model, "model", one.model.kind) for one in compared_sensors()}
    assert models >= {"tgs800", "tgs822", "tgs2600", "tgs2620", "mics5524", "pid", "ideal"}
    assert len({one.name for one in compared_sensors()}) == len(compared_sensors())
