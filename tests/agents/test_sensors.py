"""Gas sensors and anemometers against closed forms."""

import numpy as np
import pytest
import taichi as ti

from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.scenario.algorithms import Casting
from taichi_plume.scenario.robots import Body, Group
from taichi_plume.scenario.sensors import Anemometer, IdealGasSensor, MoxSensor, PidSensor
from taichi_plume.scenario.sensors import Sensors as SensorModels
from taichi_plume.scenario.species import SPECIES
from taichi_plume.scenario.starts import StartAt

pytestmark = pytest.mark.usefixtures("taichi")

pytestmark = pytest.mark.usefixtures("taichi")

pytestmark = pytest.mark.usefixtures("taichi")

TICK = 0.1


@ti.data_oriented
class Floor:
    """Nothing in the way."""

    @ti.func
    def distance(self, p):
        return 1e6

    @ti.func
    def normal(self, p):
        return ti.Vector([1.0, 0.0])


@ti.data_oriented
class Air:
    """The same gas [ppm] and wind [m/s] everywhere; gas grows by `slope` per m of x + 10 z."""

    species = (SPECIES["ethanol"],)

    def __init__(self, dim=2):
        self.dim = dim
        self.level, self.slope = ti.field(ti.f32, ()), ti.field(ti.f32, ())
        self.u = ti.Vector.field(dim, ti.f32, ())

    def stable_dt(self, t=0.0):
        return np.inf

    def is_finite(self):
        return True

    def advance(self, t, dt):
        pass

    @ti.func
    def ppm(self, x, t):
        ppm = self.level[None] + self.slope[None] * x[0]
        if ti.static(self.dim == 3):
            ppm += self.slope[None] * 10.0 * x[2]
        return ti.Vector([ppm])

    @ti.func
    def velocity(self, x, t):
        return self.u[None]


@ti.data_oriented
class Two(Air):
    """10 ppm of ethanol and 20 ppm of acetone."""

    species = (SPECIES["ethanol"], SPECIES["acetone"])

    @ti.func
    def ppm(self, x, t):
        return ti.Vector([10.0, 20.0])


def group(gas, wind=None, count=1, trials=1):
    return Group(
        name="team",
        count=count,
        trials=trials,
        start=StartAt(kind="positions", positions=((1.0, 1.0),)),
        algorithm=Casting(kind="casting"),
        body=Body(),
        sensors=SensorModels(gas=gas, wind=wind or Anemometer(kind="ideal")),
    )


def robots(*groups, dim=2, seed=5):
    count = sum(g.count * g.trials for g in groups)
    swarm = Swarm(groups, np.ones((count, 2)), np.zeros(count), Floor(), np.empty((0, 2)), seed)
    return swarm, [Sensors(swarm, r, dim, TICK) for r in swarm.groups]


def series(sensors, swarm, air, first, ticks):
    """Readings (ticks, robots) at the ticks from `first` on."""
    out = []
    for tick in range(first, first + ticks):
        sensors.measure(air, air, tick, tick * TICK)
        out.append(swarm.reading.to_numpy())
    return np.array(out)


# c0 [ppm], b, time constants [s], from the data sheets and GADEN's fits
MOX = {
    "tgs800": (0.9, 0.511, 4.0, 20.0),
    "tgs822": (0.9, 0.511, 4.0, 20.0),
    "tgs2600": (0.6796 ** (1 / 0.3196), 0.3196, 4.8, 18.75),
    "tgs2620": (4.32, 0.7155, 2.96, 15.71),
    "mics5524": (1.6, 0.644, 1.5, 8.0),
}


@pytest.mark.parametrize("model", MOX)
def test_mox_step_response(model):
    """Clean air, 60 s of 50 ppm, clean air again: ln R follows two exponentials."""
    c0, b, rise, decay = MOX[model]
    swarm, (sensors,) = robots(group(MoxSensor(kind="mox", model=model, noise=0)))
    air = Air()
    clean = series(sensors, swarm, air, 1, 1)[0]
    assert clean == 0
    r_air = swarm.resistance.to_numpy()[0]
    air.level[None] = 50.0
    seen = []
    for tick in range(2, 1202):
        if tick == 602:
            air.level[None] = 0.0
        sensors.measure(air, air, tick, tick * TICK)
        seen.append(np.log(swarm.resistance.to_numpy()[0] / r_air))
    t = TICK * np.arange(1, 601)
    up = np.log1p(50.0 / c0) * -b * (1 - np.exp(-t / rise))
    down = up[-1] * np.exp(-t / decay)
    steady = np.log1p(50.0 / c0) * b
    np.testing.assert_allclose(seen, np.concatenate([up, down]), atol=1e-4 * steady, rtol=2e-3)
    assert swarm.true_ppm.to_numpy()[0] == 0


@pytest.mark.parametrize("averaged", [1, 5])
def test_recovery_by_two_exponentials(averaged):
    """10 s of 50 ppm, then clean air: 60 % of what was reached decays with 5 s, 40 % with 40 s."""
    mox = MoxSensor(
        kind="mox", noise=0, decay_time=5, slow_share=0.4, slow_decay_time=40, period=0.5, averaged=averaged
    )
    swarm, (sensors,) = robots(group(mox))
    air = Air()
    series(sensors, swarm, air, 1, 1)
    r_air = swarm.resistance.to_numpy()[0].astype(float)
    air.level[None] = 50.0
    series(sensors, swarm, air, 2, 100)
    air.level[None] = 0.0
    seen = []
    for tick in range(102, 1102):
        sensors.measure(air, air, tick, tick * TICK)
        seen.append(np.log(r_air / swarm.resistance.to_numpy()[0].astype(float)))
    steady = MOX["mics5524"][1] * np.log1p(50.0 / MOX["mics5524"][0])
    reached = steady * (1 - np.exp(-10.0 / 1.5))
    end = TICK * np.arange(5, 1001, 5)  # the readings come 0.5 s, 1.0 s, ... after the gas has gone
    begin = end - 0.5 if averaged > 1 else end - 1e-6  # of the time that a reading is the mean of
    fast, slow = (tau * (np.exp(-begin / tau) - np.exp(-end / tau)) / (end - begin) for tau in (5.0, 40.0))
    np.testing.assert_allclose(seen[4::5], reached * (0.6 * fast + 0.4 * slow), atol=1e-4 * steady)


def resistance(t=1.0, **keys):
    """Of a noiseless sensor in clean air at time t [s]."""
    swarm, (sensors,) = robots(group(MoxSensor(kind="mox", noise=0, **keys)))
    air = Air()
    sensors.measure(air, air, 1, t)
    return float(swarm.resistance.to_numpy()[0]), float(swarm.reading.to_numpy()[0])


def test_resistance_falls_with_warmth_and_humidity():
    usual, reading = resistance()
    assert reading == 0
    assert resistance(air_temperature=293.15, air_humidity=0.65) == (usual, 0)
    warm, reading = resistance(air_temperature="30 degC")
    assert warm == pytest.approx(usual * 0.8607, rel=1e-4)  # 1.5 % per kelvin
    assert reading > 0  # taken for gas
    dry, reading = resistance(air_humidity=0.325)
    assert dry == pytest.approx(usual * 1.18921, rel=1e-4)  # the fourth root of 2
    assert reading == 0


def test_a_cold_sensor_warms_up():
    usual, _ = resistance()
    falls = [np.log(usual / resistance(t, cold_start=0.2)[0]) for t in (1e-3, 900.0, 1800.0, 1e5)]
    np.testing.assert_allclose(falls, [0.2, 0.2 / np.e, 0.2 / np.e**2, 0.0], atol=1e-5)


@pytest.mark.parametrize("model", MOX)
def test_reading_is_the_inverse_of_the_law(model):
    """Without lag each model reads 50 ppm in 50 ppm."""
    swarm, (sensors,) = robots(group(MoxSensor(kind="mox", model=model, noise=0, rise_time=0)))
    air = Air()
    air.level[None] = 50.0
    assert series(sensors, swarm, air, 1, 1)[0] == pytest.approx(50.0, rel=1e-4)


def test_pid_follows_an_exponential_and_reads_its_own_gas_rightly():
    pid = PidSensor(kind="pid", noise_ppm=0, calibrated_for="ethanol")
    swarm, (sensors,) = robots(group(pid))
    air = Air()
    air.level[None] = 20.0
    seen = series(sensors, swarm, air, 1, 40)[:, 0]
    np.testing.assert_allclose(seen, 20.0 * (1 - np.exp(-TICK * np.arange(1, 41) / 0.5)), rtol=1e-4)
    raw, (sensors,) = robots(group(PidSensor(kind="pid", noise_ppm=0, rise_time=0, decay_time=0)))
    assert series(sensors, raw, air, 1, 1)[0] == pytest.approx(20.0 / 10.0, rel=1e-5)  # as isobutylene
    air.level[None] = 0.9  # below the detection limit, 0.1 ppm of isobutylene
    assert series(sensors, raw, air, 2, 1)[0] == 0


@pytest.mark.parametrize("model", MOX)
def test_cubic_calibration_of_each_unit(model):
    """Fourteen injected concentrations bring every unit within 4 %, and clean air reads as clean."""
    mox = MoxSensor(
        kind="mox", model=model, noise=0, rise_time=0, decay_time=0, calibration="cubic", spread=1
    )
    swarm, (sensors,) = robots(group(mox, count=8))
    air = Air()
    errors = []
    for tick, ppm in enumerate(np.geomspace(5.0, 1000.0, 40), start=1):
        air.level[None] = ppm
        errors.append(series(sensors, swarm, air, tick, 1)[0] / ppm - 1.0)
    assert np.abs(errors).max() < 0.04
    air.level[None] = 0.0
    assert (series(sensors, swarm, air, 99, 1)[0] == 0).all()
    small = [0.01, 0.1, 1.0, 3.0]  # below what was injected it falls to zero with the concentration
    below = []
    for tick, ppm in enumerate(small, start=100):
        air.level[None] = ppm
        below.append(series(sensors, swarm, air, tick, 1)[0])
    assert (np.diff(below, axis=0) > 0).all()


def test_units_differ_as_the_data_sheet_says():
    swarm, (sensors,) = robots(group(MoxSensor(kind="mox", model="tgs800", noise=0, spread=1), count=400))
    series(sensors, swarm, Air(), 1, 1)
    r = swarm.resistance.to_numpy()
    assert 10e3 < r.min() < 11e3
    assert 117e3 < r.max() < 130e3
    same, (sensors,) = robots(group(MoxSensor(kind="mox", model="tgs800", noise=0), count=5))
    series(sensors, same, Air(), 1, 1)
    assert np.ptp(same.resistance.to_numpy()) == 0


def test_mean_of_the_samples_since_the_last_reading():
    """500 samples of 1 ms: the reading is the mean of ln R over half a second, and its noise averages out."""
    mox = MoxSensor(kind="mox", model="tgs800", noise=0, period=0.5, averaged=500)
    swarm, (sensors,) = robots(group(mox))
    air = Air()
    c0, b, rise, _ = MOX["tgs800"]
    series(sensors, swarm, air, 1, 1)
    r_air = swarm.resistance.to_numpy()[0]
    air.level[None] = 50.0
    series(sensors, swarm, air, 2, 15)
    end = np.log1p(50.0 / c0) * b
    last, first = 1.5, 1.0  # s since the gas came
    mean = end * (1 - rise * (np.exp(-first / rise) - np.exp(-last / rise)) / (last - first))
    assert np.log(r_air / swarm.resistance.to_numpy()[0]) == pytest.approx(mean, rel=1e-4)
    noisy = MoxSensor(kind="mox", noise=0.02, rise_time=0, period=0.5, averaged=100)
    swarm, (sensors,) = robots(group(noisy, count=2000))
    series(sensors, swarm, air, 1, 6)
    assert np.log(swarm.resistance.to_numpy()).std() == pytest.approx(0.002, rel=0.1)


def test_drift_is_a_random_walk():
    mox = MoxSensor(kind="mox", noise=0, drift=0.6)
    swarm, (sensors,) = robots(group(mox, count=2000))
    air = Air()
    spreads = []
    for tick in range(1, 401):
        sensors.measure(air, air, tick, tick * TICK)
        if tick in (100, 400):
            spreads.append(np.log(swarm.resistance.to_numpy()).std())
    assert spreads == pytest.approx([0.6 * np.sqrt(10 / 3600), 0.6 * np.sqrt(40 / 3600)], rel=0.1)


def test_converter_knows_whole_steps_only():
    """8 bits over 47 kOhm: the share of the voltage is a multiple of 1/255."""
    swarm, (sensors,) = robots(group(MoxSensor(kind="mox", noise=0.05, bits=8), count=200))
    air = Air()
    air.level[None] = 30.0
    series(sensors, swarm, air, 1, 30)
    steps = 255 * 47e3 / (47e3 + swarm.resistance.to_numpy().astype(float))
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert len(np.unique(np.round(steps))) > 3


def test_mixtures_add_up_by_their_sensitivity():
    """Half as sensitive to acetone: 10 ppm of ethanol and 20 ppm of acetone read as 20 ppm."""
    mox = MoxSensor(kind="mox", noise=0, rise_time=0, sensitivity={"acetone": 0.5})
    swarm, (sensors,) = robots(group(mox))
    air = Two()
    sensors.measure(air, air, 1, TICK)
    assert swarm.reading.to_numpy()[0] == pytest.approx(20.0, rel=1e-4)
    assert swarm.true_ppm.to_numpy()[0] == pytest.approx(30.0, rel=1e-6)
    pid = PidSensor(kind="pid", noise_ppm=0, rise_time=0)
    swarm, (sensors,) = robots(group(pid))
    sensors.measure(air, air, 1, TICK)
    assert swarm.reading.to_numpy()[0] == pytest.approx(10 / 10 + 20 / 1.1, rel=1e-4)


def test_a_trial_alone_measures_what_it_measures_among_others():
    mox = MoxSensor(kind="mox", noise=0.02, spread=1, drift=0.1)
    air = Air()
    air.level[None] = 20.0
    many, (sensors,) = robots(group(mox, count=3, trials=4))
    together = series(sensors, many, air, 1, 5)[:, 6:9]
    alone, (sensors,) = robots(group(mox, count=3).model_copy(update={"first_trial": 2}))
    assert (series(sensors, alone, air, 1, 5) == together).all()
    assert (many.resistance.to_numpy()[6:9] == alone.resistance.to_numpy()).all()
    assert (together[:, 0] != series(sensors, many, air, 6, 5)[:, 0]).all()


def test_ideal_sensor_reads_the_truth_at_once():
    swarm, (sensors,) = robots(group(IdealGasSensor(kind="ideal")))
    air = Air()
    for tick, ppm in enumerate([0.0, 120.0, 3.0], start=1):
        air.level[None] = ppm
        sensors.measure(air, air, tick, tick * TICK)
        assert swarm.reading.to_numpy()[0] == pytest.approx(ppm, rel=1e-6)
        assert swarm.true_ppm.to_numpy()[0] == pytest.approx(ppm, rel=1e-6)


def test_given_time_constants_replace_the_models():
    gas = IdealGasSensor(kind="ideal", rise_time=2.0, decay_time=4.0)
    swarm, (sensors,) = robots(group(gas))
    air = Air()
    air.level[None] = 10.0
    assert series(sensors, swarm, air, 1, 20)[-1, 0] == pytest.approx(10 * (1 - np.exp(-1)), rel=1e-4)
    air.level[None] = 0.0
    before = swarm.reading.to_numpy()[0]
    assert series(sensors, swarm, air, 21, 40)[-1, 0] == pytest.approx(before * np.exp(-1), rel=1e-4)


def test_readings_are_held_between_samples():
    """With a period of five ticks the reading changes at the 1st, 6th, 11th; the lag goes on in between."""
    gas = IdealGasSensor(kind="ideal", rise_time=1.0, period=0.5)
    swarm, (sensors,) = robots(group(gas))
    air = Air()
    air.level[None] = 10.0
    seen = series(sensors, swarm, air, 1, 20)[:, 0]
    sampled_at = TICK * (1 + 5 * (np.arange(20) // 5))
    assert seen == pytest.approx(10 * (1 - np.exp(-sampled_at)), rel=1e-4)


def test_noise_of_the_resistance():
    """In 20 ppm ln R scatters by the given standard deviation, anew with each sample."""
    swarm, (sensors,) = robots(group(MoxSensor(kind="mox", noise=0.02, rise_time=0), count=2000))
    air = Air()
    air.level[None] = 20.0
    c0, b, *_ = MOX["mics5524"]
    ln_r = -b * np.log1p(series(sensors, swarm, air, 1, 2) / c0)
    ln_r -= -b * np.log1p(20 / c0)
    assert ln_r.std(axis=1) == pytest.approx(0.02, rel=0.1)  # 6 standard errors
    assert ln_r.mean(axis=1) == pytest.approx(0, abs=6 * 0.02 / np.sqrt(2000))
    assert abs(np.corrcoef(ln_r)[0, 1]) < 0.13


def test_noise_in_clean_air_never_reads_below_zero():
    swarm, (sensors,) = robots(group(IdealGasSensor(kind="ideal", noise_ppm=1.0), count=500))
    seen = series(sensors, swarm, Air(), 1, 1)[0]
    assert seen.min() == 0
    assert 0.3 < (seen > 0).mean() < 0.7


def test_numbers_are_drawn_by_group_and_place_in_it():
    """More trials and groups leave the noise of the others as it is; trials, groups and seeds differ."""
    gas = IdealGasSensor(kind="ideal", noise_ppm=1.0)
    air = Air()
    air.level[None] = 100.0

    def first_sample(*groups, seed=5):
        swarm, all_sensors = robots(*groups, seed=seed)
        for sensors in all_sensors:
            sensors.measure(air, air, 1, TICK)
        reading = swarm.reading.to_numpy()
        return [reading[r.slice] for r in swarm.groups]

    (alone,) = first_sample(group(gas, count=4))
    again, other = first_sample(group(gas, count=4, trials=3), group(gas, count=4))
    assert (again[:4] == alone).all()
    assert (again[4:8] != alone).all()
    assert (other != alone).all()
    assert (first_sample(group(gas, count=4), seed=2**32 - 1)[0] != alone).all()


def test_sensors_sit_at_their_height():
    gas = IdealGasSensor(kind="ideal", height=0.25)
    swarm, (sensors,) = robots(group(gas), dim=3)
    air = Air(dim=3)
    air.slope[None] = 2.0
    sensors.measure(air, air, 1, TICK)
    assert swarm.reading.to_numpy()[0] == pytest.approx(2 * (1.0 + 10 * 0.25), rel=1e-6)


@pytest.mark.parametrize(("kind", "threshold"), [("ultrasonic", 0.01), ("thermal", 0.05)])
def test_wind_below_the_threshold_is_not_felt(kind, threshold):
    swarm, (sensors,) = robots(group(IdealGasSensor(kind="ideal"), Anemometer(kind=kind, lag=0)))
    air = Air()
    air.u[None] = [0.0, -0.99 * threshold]
    sensors.measure(air, air, 1, TICK)
    assert swarm.wind_known.to_numpy()[0] == 0
    assert swarm.wind.to_numpy()[0].tolist() == [0, 0]
    air.u[None] = [0.0, -1.01 * threshold]
    sensors.measure(air, air, 2, 2 * TICK)
    assert swarm.wind_known.to_numpy()[0] == 1
    assert swarm.wind.to_numpy()[0].any()


def test_ideal_anemometer_sees_any_wind_exactly_but_no_calm():
    swarm, (sensors,) = robots(group(IdealGasSensor(kind="ideal")), dim=3)
    air = Air(dim=3)
    air.u[None] = [3e-4, -2e-4, 7.0]  # the vertical part is not measured
    sensors.measure(air, air, 1, TICK)
    assert swarm.wind.to_numpy()[0] == pytest.approx([3e-4, -2e-4])
    assert swarm.wind_known.to_numpy()[0] == 1
    air.u[None] = [0.0, 0.0, 7.0]
    sensors.measure(air, air, 2, 2 * TICK)
    assert swarm.wind_known.to_numpy()[0] == 0


@pytest.mark.parametrize(("noise", "expected"), [(None, 0.01 + 0.02 * 0.5), (0.1, 0.1)])
def test_noise_of_the_wind(noise, expected):
    anemometer = Anemometer(kind="ultrasonic", noise=noise)
    swarm, (sensors,) = robots(group(IdealGasSensor(kind="ideal"), anemometer, count=2000))
    air = Air()
    air.u[None] = [0.3, -0.4]
    sensors.measure(air, air, 1, TICK)
    wind = swarm.wind.to_numpy()
    assert wind.std(axis=0) == pytest.approx([expected, expected], rel=0.1)
    assert wind.mean(axis=0) == pytest.approx([0.3, -0.4], abs=6 * expected / np.sqrt(2000))
    assert abs(np.corrcoef(wind.T)[0, 1]) < 0.13


def test_wind_lags():
    swarm, (sensors,) = robots(group(IdealGasSensor(kind="ideal"), Anemometer(kind="ideal", lag=0.5)))
    air = Air()
    air.u[None] = [0.4, 0.0]
    sensors.measure(air, air, 1, TICK)
    assert swarm.wind.to_numpy()[0] == pytest.approx([0.4, 0.0])  # it has stood in this air before
    air.u[None] = [0.0, 0.4]
    for tick in range(2, 7):
        sensors.measure(air, air, tick, tick * TICK)
    assert swarm.wind.to_numpy()[0] == pytest.approx([0.4 * np.exp(-1), 0.4 * (1 - np.exp(-1))], rel=1e-4)


@pytest.mark.parametrize(("compensated", "felt"), [(True, 0.5), (False, 0.3)])
def test_own_motion_is_felt_unless_taken_out(compensated, felt):
    anemometer = Anemometer(kind="ideal", compensated=compensated)
    swarm, (sensors,) = robots(group(IdealGasSensor(kind="ideal"), anemometer))
    air = Air()
    air.u[None] = [0.5, 0.0]
    swarm.velocity.fill([0.2, 0.0])
    sensors.measure(air, air, 1, TICK)
    assert swarm.wind.to_numpy()[0] == pytest.approx([felt, 0.0])
