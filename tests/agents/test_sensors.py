"""Gas sensors and anemometers against closed forms."""

import numpy as np
import pytest
import taichi as ti

from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.robots import Anemometer, Body, Casting, Group, IdealGasSensor, MoxSensor, StartAt
from taichi_plume.robots import Sensors as SensorModels

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


# c0 [ppm], b, time constants [s]: from the models' description
MOX = {"tgs2620": (4.32, 0.7155, 2.96, 15.71), "mics5524": (1.6, 0.644, 1.5, 8.0)}


@pytest.mark.parametrize("model", MOX)
def test_mox_step_response(model):
    """Clean air, 60 s of 50 ppm, clean air again: ln R follows two exponentials."""
    c0, b, rise, decay = MOX[model]
    swarm, (sensors,) = robots(group(MoxSensor(kind="mox", model=model, noise=0)))
    air = Air()
    air.level[None] = 50.0
    up = series(sensors, swarm, air, 1, 600)[:, 0]
    air.level[None] = 0.0
    down = series(sensors, swarm, air, 601, 600)[:, 0]
    t = TICK * np.arange(1, 601)
    resistance = np.log1p(50.0 / c0) * -b  # ln(R/R_air) in the end
    ln_r = resistance * (1 - np.exp(-t / rise))
    assert up == pytest.approx(c0 * (np.exp(-ln_r / b) - 1), rel=1e-4)
    ln_r = ln_r[-1] * np.exp(-t / decay)
    assert down == pytest.approx(c0 * (np.exp(-ln_r / b) - 1), rel=1e-4)
    assert swarm.true_ppm.to_numpy()[0] == 0


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
    swarm, (sensors,) = robots(group(IdealGasSensor(kind="ideal"), Anemometer(kind=kind)))
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
