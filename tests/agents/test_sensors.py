"""Gas sensors and anemometers against closed forms: one laboratory, fitted out anew for each test."""

import numpy as np
import pytest
from robots import NOWHERE, Air, Floor, group

from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import fields, ti
from taichi_plume.engine.program import compiled
from taichi_plume.grid.state import State
from taichi_plume.scenario.metal_oxides import MOX_MODELS
from taichi_plume.scenario.sensors import Anemometer, GasSensor, IdealGasSensor, MoxSensor, PidSensor
from taichi_plume.scenario.species import SPECIES

pytestmark = pytest.mark.usefixtures("taichi")

TICK = 0.1
MANY = 2000


class Two(Air):
    """10 ppm of ethanol and 20 ppm of acetone."""

    species = (SPECIES["ethanol"], SPECIES["acetone"])

    @ti.func
    def ppm(self, x, t):
        return ti.Vector([10.0, 20.0])


class Methane(Air):
    """5 ppm of ethanol, as much helium, and as much methane as there is `level`."""

    species = (SPECIES["ethanol"], SPECIES["methane"], SPECIES["helium"])

    @ti.func
    def ppm(self, x, t):
        return ti.Vector([5.0, self.level[None], 5.0])


IDEAL = IdealGasSensor(kind="ideal")


def mox(model="mics5524", **keys) -> MoxSensor:
    """Without noise, unless given."""
    return MoxSensor.model_validate({"kind": "mox", "model": model, "noise": 0, **keys})


class Lab:
    """A swarm in air that the tests set; `counts` robots and `trials` of each group, by its name.

    Groups whose names begin with "mox" have metal oxides.
    """

    def __init__(
        self, air: Air, counts: dict[str, int], trials: dict[str, int] | None = None, first_trial=None
    ):
        self.air, self.counts, self.trials, self.first_trial = air, counts, trials or {}, first_trial or {}
        size = sum(count * self.trials.get(name, 1) for name, count in counts.items())
        self.places = np.ones((size, 2)), np.zeros(size)
        self.fit()

    def _groups(self, gas: dict[str, GasSensor], wind: dict[str, Anemometer]):
        """Unless given, with a cubic calibration and a wind that is not compensated: both are compiled."""
        groups = []
        for name, count in self.counts.items():
            usual = mox(calibration="cubic") if name.startswith("mox") else IDEAL
            usual_wind = Anemometer(kind="ideal", compensated=False)
            sensors = {"gas": gas.get(name, usual), "wind": wind.get(name, usual_wind)}
            trials, first = self.trials.get(name, 1), self.first_trial.get(name, 0)
            groups.append(group(name=name, count=count, trials=trials, first_trial=first, sensors=sensors))
        return groups

    def fit(self, wind: dict[str, Anemometer] | None = None, seed=5, **gas: GasSensor):
        """Make robots with these sensors, in clean and still air."""
        self.swarm = Swarm(self._groups(gas, wind or {}), *self.places, Floor(), NOWHERE, seed)
        self.sensors = Sensors(self.swarm, self.air.dim, TICK, self.air.species)
        self.states = State(self.swarm), State(self.sensors)
        self.air.level[None], self.air.slope[None], self.air.u[None] = 0.0, 0.0, [0.0] * self.air.dim
        self.tick = 0

    def measure(self, ticks: int = 1, t: float | None = None) -> None:
        """Go on for some ticks; t: the time [s], if not that of the tick."""
        for _ in range(ticks):
            self.tick += 1
            self.sensors.measure(self.air, self.air, self.tick, self.tick * TICK if t is None else t)

    def of(self, name: str, column: str = "reading_ppm") -> np.ndarray:
        """What the robots of a group have now."""
        return self.swarm.snapshot()[column][self.rows(name)]

    def series(self, ticks: int, column: str = "reading_ppm") -> np.ndarray:
        """Of all robots, tick by tick (ticks, robots)."""
        out = []
        for _ in range(ticks):
            self.measure()
            out.append(self.swarm.snapshot()[column])
        return np.array(out)

    def rows(self, name: str) -> slice:
        """The robots of a group."""
        return next(one.slice for one in self.swarm.groups if one.name == name)

    def row(self, name: str) -> int:
        """The first of them."""
        return self.rows(name).start


SEVERAL = {f"mox {model}": 8 for model in MOX_MODELS} | {"ideal": 1, "pid": 1, "raw": 1}


@pytest.fixture(scope="module")
def lab(taichi):
    """Groups of a few robots, five of them with metal oxides."""
    return Lab(Air(), SEVERAL)


@pytest.fixture(scope="module")
def crowd(taichi):
    """Many robots with metal oxides, and many without."""
    return Lab(Air(), {"mox": MANY, "others": MANY})


@pytest.fixture(scope="module")
def room(taichi):
    """Robots in 3-D."""
    return Lab(Air(dim=3), {"ideal": 1, "high": 1})


# c0 [ppm], b, time constants [s], from the data sheets and GADEN's fits
MOX = {
    "tgs800": (0.9, 0.511, 4.0, 20.0),
    "tgs822": (0.9, 0.511, 4.0, 20.0),
    "tgs2600": (0.6796 ** (1 / 0.3196), 0.3196, 4.8, 18.75),
    "tgs2620": (4.32, 0.7155, 2.96, 15.71),
    "mics5524": (1.6, 0.644, 1.5, 8.0),
}


def each_model(**keys) -> dict[str, GasSensor]:
    """A group with each of the models."""
    return {f"mox {model}": mox(model, **keys) for model in MOX}


def test_other_numbers_compile_nothing(lab):
    lab.fit(**each_model())
    lab.series(3)
    before = compiled()
    lab.fit(
        {"ideal": Anemometer(kind="thermal", noise=0.3, lag=0.2, height=0.3, compensated=False)},
        seed=6,
        **each_model(
            noise=0.1, drift=0.2, spread=1, slow_share=0.3, averaged=9, period=0.3, bits=9, load=5e3, height=1
        ),
        pid=PidSensor(kind="pid", rise_time=3, noise_ppm=1),
    )
    lab.air.level[None] = 20.0
    lab.series(60)
    assert compiled() == before
    assert all(len(np.unique(lab.of(f"mox {model}"))) > 3 for model in MOX)


def test_a_measurement_takes_few_arrays_on_a_device(lab, monkeypatch):
    """Metal gives a kernel 31 at most; those of this test's air stand for gas and wind."""
    monkeypatch.setattr(fields, "memory_is_shared", lambda: True)
    lab.fit(**each_model())
    lab.measure()
    launches = vars(lab.sensors)["_bound"].values()
    assert max(sum(kind == "field" for _, kind in launch.extra) for launch in launches) <= 31


def test_sensors_go_on_from_what_was_saved(crowd):
    crowd.fit(
        {"others": Anemometer(kind="thermal")},
        mox=mox(noise=0.02, spread=1, drift=0.3, slow_share=0.4, averaged=3, period=0.3),
        others=PidSensor(kind="pid"),
    )
    crowd.air.level[None], crowd.air.u[None] = 20.0, [0.3, 0.1]
    crowd.measure(7)
    saved = [state.save() for state in crowd.states]
    then = crowd.series(7)
    wind = crowd.swarm.snapshot()["wind"]
    for state, what in zip(crowd.states, saved, strict=True):
        state.restore(what)
    crowd.tick = 7
    np.testing.assert_array_equal(crowd.series(7), then)
    np.testing.assert_array_equal(crowd.swarm.snapshot()["wind"], wind)


def test_gases_with_curves_of_their_own_add_up_as_what_makes_the_same_resistance():
    """(R/R_air)^(-1/b) is 1 in clean air, and each gas adds what it would add alone; one is read back as it is."""
    lab = Lab(Methane(), {"mox a": 1, "mox b": 1})
    quick = {"rise_time": 0, "decay_time": 0}
    reported: dict[str, GasSensor] = {
        "mox a": mox("tgs2620", **quick),
        "mox b": mox("tgs2611", **quick, calibrated_for="methane", sensitivity={"ethanol": 0.0}),
    }
    lab.fit(None, 5, **reported)
    for level in (0.0, 0.5, 40.0, 3000.0):
        lab.air.level[None] = level
        lab.measure()
        y = -np.log(lab.swarm.snapshot()["resistance_ohm"][0] / np.sqrt(21e3 * 105e3))
        alone = 0.7155 * np.log1p(5.0 / 4.32), 0.4877 * np.log1p(level / 36.0)
        assert np.exp(y / 0.7155) - 1 == pytest.approx(
            sum(np.exp(one / 0.7155) - 1 for one in alone), rel=1e-4
        )
        assert lab.of("mox b")[0] == pytest.approx(level, rel=1e-4, abs=1e-3)


def test_mox_step_response(lab):
    """Clean air, 60 s of 50 ppm, clean air again: ln R follows two exponentials."""
    lab.fit(**each_model())
    lab.measure()
    r_air = lab.swarm.snapshot()["resistance_ohm"]
    clean = lab.swarm.snapshot()["reading_ppm"]
    lab.air.level[None] = 50.0
    up = np.log(lab.series(600, "resistance_ohm") / r_air)
    lab.air.level[None] = 0.0
    down = np.log(lab.series(600, "resistance_ohm") / r_air)
    t = TICK * np.arange(1, 601)
    for model, (c0, b, rise, decay) in MOX.items():
        n = lab.row(f"mox {model}")
        assert clean[n] == 0, model
        steady = np.log1p(50.0 / c0) * b
        rising = -steady * (1 - np.exp(-t / rise))
        falling = rising[-1] * np.exp(-t / decay)
        np.testing.assert_allclose(up[:, n], rising, atol=1e-4 * steady, rtol=2e-3, err_msg=model)
        np.testing.assert_allclose(down[:, n], falling, atol=1e-4 * steady, rtol=2e-3, err_msg=model)
        assert lab.of(f"mox {model}", "true_ppm")[0] == 0


def test_recovery_by_two_exponentials(lab):
    """10 s of 50 ppm, then clean air: 60 % of what was reached decays with 5 s, 40 % with 40 s."""
    keys = {"decay_time": 5, "slow_share": 0.4, "slow_decay_time": 40, "period": 0.5}
    averaged = {"mox mics5524": 1, "mox tgs800": 5}
    lab.fit(**{name: mox(averaged=samples, **keys) for name, samples in averaged.items()})
    lab.measure()
    r_air = lab.swarm.snapshot()["resistance_ohm"].astype(float)
    lab.air.level[None] = 50.0
    lab.measure(100)
    lab.air.level[None] = 0.0
    seen = np.log(r_air / lab.series(1000, "resistance_ohm").astype(float))
    steady = MOX["mics5524"][1] * np.log1p(50.0 / MOX["mics5524"][0])
    reached = steady * (1 - np.exp(-10.0 / 1.5))
    end = TICK * np.arange(5, 1001, 5)  # the readings come 0.5 s, 1.0 s, ... after the gas has gone
    for name, samples in averaged.items():
        begin = end - 0.5 if samples > 1 else end - 1e-6  # of the time that a reading is the mean of
        fast, slow = (
            tau * (np.exp(-begin / tau) - np.exp(-end / tau)) / (end - begin) for tau in (5.0, 40.0)
        )
        np.testing.assert_allclose(
            seen[4::5, lab.row(name)],
            reached * (0.6 * fast + 0.4 * slow),
            atol=1e-4 * steady,
            err_msg=f"averaged: {samples}",
        )


def clean(lab, t=1.0, **models):
    """Resistance and reading of sensors in clean air at time t [s], by their place among the metal oxides."""
    lab.fit(**dict(zip(SEVERAL, models.values(), strict=False)))
    lab.measure(t=t)
    now = lab.swarm.snapshot()
    rows = [lab.row(name) for name in list(SEVERAL)[: len(models)]]
    return {
        key: (now["resistance_ohm"][n], now["reading_ppm"][n]) for key, n in zip(models, rows, strict=True)
    }


def test_resistance_falls_with_warmth_and_humidity(lab):
    found = clean(
        lab,
        usual=mox(),
        same=mox(air_temperature=293.15, air_humidity=0.65),
        warm=mox(air_temperature="30 degC"),
        dry=mox(air_humidity=0.325),
    )
    usual, reading = found["usual"]
    assert reading == 0
    assert found["same"] == (usual, 0)
    warm, reading = found["warm"]
    assert warm == pytest.approx(usual * 0.8607, rel=1e-4)  # 1.5 % per kelvin
    assert reading > 0  # taken for gas
    dry, reading = found["dry"]
    assert dry == pytest.approx(usual * 1.18921, rel=1e-4)  # the fourth root of 2
    assert reading == 0


def test_a_cold_sensor_warms_up(lab):
    falls = []
    for t in (1e-3, 900.0, 1800.0, 1e5):
        found = clean(lab, t, usual=mox(), cold=mox(cold_start=0.2))
        falls.append(np.log(found["usual"][0] / found["cold"][0]))
    np.testing.assert_allclose(falls, [0.2, 0.2 / np.e, 0.2 / np.e**2, 0.0], atol=1e-5)


def test_reading_is_the_inverse_of_the_law(lab):
    """Without lag each model reads 50 ppm in 50 ppm."""
    lab.fit(**each_model(rise_time=0))
    lab.air.level[None] = 50.0
    lab.measure()
    for model in MOX:
        assert lab.of(f"mox {model}")[0] == pytest.approx(50.0, rel=1e-4), model


def test_pid_follows_an_exponential_and_reads_its_own_gas_rightly(lab):
    lab.fit(
        pid=PidSensor(kind="pid", noise_ppm=0, calibrated_for="ethanol"),
        raw=PidSensor(kind="pid", noise_ppm=0, rise_time=0, decay_time=0),
    )
    lab.air.level[None] = 20.0
    seen = lab.series(40)
    expected = 20.0 * (1 - np.exp(-TICK * np.arange(1, 41) / 0.5))
    np.testing.assert_allclose(seen[:, lab.row("pid")], expected, rtol=1e-4)
    assert seen[0, lab.row("raw")] == pytest.approx(20.0 / 10.0, rel=1e-5)  # as isobutylene
    lab.air.level[None] = 0.9  # below the detection limit, 0.1 ppm of isobutylene
    lab.measure()
    assert lab.of("raw")[0] == 0


def test_cubic_calibration_of_each_unit(lab):
    """Fourteen injected concentrations bring every unit within 4 %, and clean air reads as clean."""
    lab.fit(**each_model(rise_time=0, decay_time=0, calibration="cubic", spread=1))
    errors, below = [], []
    for ppm in np.geomspace(5.0, 1000.0, 40):
        lab.air.level[None] = ppm
        errors.append(lab.series(1)[0] / ppm - 1.0)
    lab.air.level[None] = 0.0
    zero = lab.series(1)[0]
    for ppm in (0.01, 0.1, 1.0, 3.0):  # below what was injected it falls to zero with the concentration
        lab.air.level[None] = ppm
        below.append(lab.series(1)[0])
    for model in MOX:
        rows = lab.rows(f"mox {model}")
        assert np.abs(np.array(errors)[:, rows]).max() < 0.04, model
        assert (zero[rows] == 0).all(), model
        assert (np.diff(np.array(below)[:, rows], axis=0) > 0).all(), model


def test_extrapolated_cubic_reads_gas_in_clean_air(lab):
    """Least squares of 14 measured resistances give the cubic, down to clean air."""
    name = "mox tgs800"
    lab.fit(**{name: mox("tgs800", rise_time=0, decay_time=0, calibration="extrapolated_cubic")})
    row = lab.row(name)

    def at(ppm, column):
        lab.air.level[None] = ppm
        return lab.series(1, column)[0, row]

    clean = at(0.0, "resistance_ohm")
    injected = np.geomspace(5.0, 1000.0, 14)
    x = np.log10([at(ppm, "resistance_ohm") / clean for ppm in injected])
    k, *_ = np.linalg.lstsq(np.vander(x, 4), np.log10(injected), rcond=None)
    for ppm in (0.0, 0.3, 3.0, 30.0):
        x = np.log10(at(ppm, "resistance_ohm") / clean)
        assert at(ppm, "reading_ppm") == pytest.approx(10 ** np.polyval(k, x), rel=1e-3), ppm
    assert at(0.0, "reading_ppm") == pytest.approx(0.5, abs=0.05)


def test_units_differ_as_the_data_sheet_says(crowd, lab):
    crowd.fit(mox=mox("tgs800", spread=1))
    crowd.measure()
    r = crowd.of("mox", "resistance_ohm")
    assert 10e3 < r.min() < 11e3
    assert 117e3 < r.max() < 130e3
    lab.fit(**each_model())
    lab.measure()
    assert np.ptp(lab.of("mox tgs800", "resistance_ohm")) == 0


def test_mean_of_the_samples_since_the_last_reading(crowd):
    """500 samples of 1 ms: the reading is the mean of ln R over half a second, and its noise averages out."""
    crowd.fit(mox=mox("tgs800", period=0.5, averaged=500))
    c0, b, rise, _ = MOX["tgs800"]
    crowd.measure()
    r_air = crowd.of("mox", "resistance_ohm")[0]
    crowd.air.level[None] = 50.0
    crowd.measure(15)
    end = np.log1p(50.0 / c0) * b
    last, first = 1.5, 1.0  # s since the gas came
    mean = end * (1 - rise * (np.exp(-first / rise) - np.exp(-last / rise)) / (last - first))
    assert np.log(r_air / crowd.of("mox", "resistance_ohm")[0]) == pytest.approx(mean, rel=1e-4)
    crowd.fit(mox=mox(noise=0.02, rise_time=0, period=0.5, averaged=100))
    crowd.air.level[None] = 50.0
    crowd.measure(6)
    assert np.log(crowd.of("mox", "resistance_ohm")).std() == pytest.approx(0.002, rel=0.1)


def test_drift_is_a_random_walk(crowd):
    crowd.fit(mox=mox(drift=0.6))
    spreads = []
    for ticks in (100, 300):
        crowd.measure(ticks)
        spreads.append(np.log(crowd.of("mox", "resistance_ohm")).std())
    assert spreads == pytest.approx([0.6 * np.sqrt(10 / 3600), 0.6 * np.sqrt(40 / 3600)], rel=0.1)


def test_converter_knows_whole_steps_only(crowd):
    """8 bits over 47 kOhm: the share of the voltage is a multiple of 1/255."""
    crowd.fit(mox=mox(noise=0.05, bits=8))
    crowd.air.level[None] = 30.0
    crowd.measure(30)
    steps = 255 * 47e3 / (47e3 + crowd.of("mox", "resistance_ohm").astype(float))
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert len(np.unique(np.round(steps))) > 3


def test_mixtures_add_up_by_their_sensitivity():
    """Half as sensitive to acetone: 10 ppm of ethanol and 20 ppm of acetone read as 20 ppm."""
    lab = Lab(Two(), {"mox": 1, "pid": 1})
    lab.fit(
        mox=mox(rise_time=0, sensitivity={"acetone": 0.5}),
        pid=PidSensor(kind="pid", noise_ppm=0, rise_time=0),
    )
    lab.measure()
    assert lab.of("mox")[0] == pytest.approx(20.0, rel=1e-4)
    assert lab.of("mox", "true_ppm")[0] == pytest.approx(30.0, rel=1e-6)
    assert lab.of("pid")[0] == pytest.approx(10 / 10 + 20 / 1.1, rel=1e-4)


def test_ideal_sensor_reads_the_truth_at_once(lab):
    lab.fit()
    for ppm in (0.0, 120.0, 3.0):
        lab.air.level[None] = ppm
        lab.measure()
        assert lab.of("ideal")[0] == pytest.approx(ppm, rel=1e-6)
        assert lab.of("ideal", "true_ppm")[0] == pytest.approx(ppm, rel=1e-6)


def test_given_time_constants_replace_the_models(lab):
    lab.fit(ideal=IdealGasSensor(kind="ideal", rise_time=2.0, decay_time=4.0))
    lab.air.level[None] = 10.0
    lab.measure(20)
    before = lab.of("ideal")[0]
    assert before == pytest.approx(10 * (1 - np.exp(-1)), rel=1e-4)
    lab.air.level[None] = 0.0
    lab.measure(40)
    assert lab.of("ideal")[0] == pytest.approx(before * np.exp(-1), rel=1e-4)


def test_readings_are_held_between_samples(lab):
    """With a period of five ticks the reading changes at the 1st, 6th, 11th; the lag goes on in between."""
    lab.fit(ideal=IdealGasSensor(kind="ideal", rise_time=1.0, period=0.5))
    lab.air.level[None] = 10.0
    seen = lab.series(20)[:, lab.row("ideal")]
    sampled_at = TICK * (1 + 5 * (np.arange(20) // 5))
    assert seen == pytest.approx(10 * (1 - np.exp(-sampled_at)), rel=1e-4)


def test_noise_of_the_resistance(crowd):
    """In 20 ppm ln R scatters by the given standard deviation, anew with each sample."""
    crowd.fit(mox=mox(noise=0.02, rise_time=0))
    crowd.air.level[None] = 20.0
    c0, b, *_ = MOX["mics5524"]
    ln_r = -b * np.log1p(crowd.series(2)[:, :MANY] / c0)
    ln_r -= -b * np.log1p(20 / c0)
    assert ln_r.std(axis=1) == pytest.approx(0.02, rel=0.1)  # 6 standard errors
    assert ln_r.mean(axis=1) == pytest.approx(0, abs=6 * 0.02 / np.sqrt(MANY))
    assert abs(np.corrcoef(ln_r)[0, 1]) < 0.13


def test_noise_of_a_reading_does_not_average_out(crowd):
    """Of ln R, anew with each reading, beside what is left of the noise of 100 samples; draws of its own."""

    def ln_r(**keys):
        crowd.fit(mox=mox(noise=0.02, rise_time=0, period=0.5, averaged=100, **keys))
        crowd.air.level[None] = 20.0
        crowd.measure(6)
        first = np.log(crowd.of("mox", "resistance_ohm"))
        crowd.measure(4)
        held = np.log(crowd.of("mox", "resistance_ohm"))
        crowd.measure()
        return first, held, np.log(crowd.of("mox", "resistance_ohm"))

    first, held, then = ln_r(reading_noise=0.005)
    of_samples = ln_r()[0]
    assert (held == first).all()
    assert first.std() == pytest.approx(np.hypot(0.005, 0.002), rel=0.1)
    own = first - of_samples
    assert own.std() == pytest.approx(0.005, rel=0.1)
    assert own.mean() == pytest.approx(0, abs=6 * 0.005 / np.sqrt(MANY))
    for other in (of_samples, then):
        assert abs(np.corrcoef(own, other)[0, 1]) < 0.13


def test_noise_in_clean_air_never_reads_below_zero(crowd):
    crowd.fit(others=IdealGasSensor(kind="ideal", noise_ppm=1.0))
    crowd.measure()
    seen = crowd.of("others")
    assert seen.min() == 0
    assert 0.3 < (seen > 0).mean() < 0.7


def test_numbers_are_drawn_by_group_and_place_in_it():
    """More trials and groups leave the noise of the others as it is; trials, groups and seeds differ; trials alone."""
    air = Air()
    single = Lab(air, {"mox": 3, "ideal": 4}, first_trial={"mox": 2})
    many = Lab(air, {"mox": 3, "ideal": 4, "other": 4}, {"mox": 4, "ideal": 3})
    gas = IdealGasSensor(kind="ideal", noise_ppm=1.0)
    metal = mox(noise=0.02, spread=1, drift=0.1)

    def readings(lab, ticks=5, **keys):
        lab.fit(mox=metal, ideal=gas, other=gas, **keys)
        lab.air.level[None] = 100.0
        return lab.series(ticks)

    alone = readings(single)
    again = readings(many)
    (mox_rows, ideal, other), (alone_mox, alone_ideal) = (
        [one.slice for one in lab.swarm.groups] for lab in (many, single)
    )
    assert (again[0, ideal][:4] == alone[0, alone_ideal]).all()
    assert (again[0, ideal][4:8] != alone[0, alone_ideal]).all()
    assert (again[0, other] != alone[0, alone_ideal]).all()
    assert (readings(single, seed=2**32 - 1)[0, alone_ideal] != alone[0, alone_ideal]).all()

    resistance = many.of("mox", "resistance_ohm")[6:9]
    assert (readings(single)[:, alone_mox] == again[:, mox_rows][:, 6:9]).all()
    assert (single.of("mox", "resistance_ohm") == resistance).all()
    assert (readings(many, 10)[5:, mox_rows][:, 6] != again[:, mox_rows][:, 6]).all()


def test_sensors_sit_at_their_height(room):
    room.fit(ideal=IdealGasSensor(kind="ideal", height=0.25), high=IdealGasSensor(kind="ideal", height=0.5))
    room.air.slope[None] = 2.0
    room.measure()
    assert room.of("ideal")[0] == pytest.approx(2 * (1.0 + 10 * 0.25), rel=1e-6)
    assert room.of("high")[0] == pytest.approx(2 * (1.0 + 10 * 0.5), rel=1e-6)


def test_a_sensor_ahead_is_in_front_of_the_robot():
    ahead = group(count=2, sensors={"gas": {"kind": "ideal", "ahead": 0.3}, "wind": {"kind": "ideal"}})
    headings = np.array([0.0, 2.0])
    swarm = Swarm([ahead], np.ones((2, 2)), headings, Floor(), NOWHERE, 5)
    air = Air()
    air.slope[None] = 2.0
    Sensors(swarm, 2, TICK, air.species).measure(air, air, 1, TICK)
    assert swarm.snapshot()["reading_ppm"] == pytest.approx(2 * (1.0 + 0.3 * np.cos(headings)), rel=1e-6)


def test_wind_below_the_threshold_is_not_felt(lab):
    kinds = {"ideal": ("ultrasonic", 0.01), "pid": ("thermal", 0.05)}
    for share in (0.99, 1.01):
        for name, (kind, threshold) in kinds.items():
            lab.fit({name: Anemometer.model_validate({"kind": kind, "lag": 0})})
            lab.air.u[None] = [0.0, -share * threshold]
            lab.measure()
            known, wind = lab.of(name, "wind")[0].any(), lab.swarm.wind_known.to_numpy()[lab.row(name)]
            assert (known, wind) == (share > 1, share > 1), (kind, share)


def test_ideal_anemometer_sees_any_wind_exactly_but_no_calm(room):
    room.fit()
    room.air.u[None] = [3e-4, -2e-4, 7.0]  # the vertical part is not measured
    room.measure()
    assert room.of("high", "wind")[0] == pytest.approx([3e-4, -2e-4])
    assert room.swarm.wind_known.to_numpy()[1] == 1
    room.air.u[None] = [0.0, 0.0, 7.0]
    room.measure()
    assert room.swarm.wind_known.to_numpy()[1] == 0


def test_noise_of_the_wind(crowd):
    crowd.fit({"mox": Anemometer(kind="ultrasonic"), "others": Anemometer(kind="ultrasonic", noise=0.1)})
    crowd.air.u[None] = [0.3, -0.4]
    crowd.measure()
    for name, expected in (("mox", 0.01 + 0.02 * 0.5), ("others", 0.1)):
        wind = crowd.of(name, "wind")
        assert wind.std(axis=0) == pytest.approx([expected, expected], rel=0.1), name
        assert wind.mean(axis=0) == pytest.approx([0.3, -0.4], abs=6 * expected / np.sqrt(MANY)), name
        assert abs(np.corrcoef(wind.T)[0, 1]) < 0.13, name


def test_wind_lags(lab):
    lab.fit({"ideal": Anemometer(kind="ideal", lag=0.5)})
    lab.air.u[None] = [0.4, 0.0]
    lab.measure()
    assert lab.of("ideal", "wind")[0] == pytest.approx([0.4, 0.0])  # it has stood in this air before
    lab.air.u[None] = [0.0, 0.4]
    lab.measure(5)
    assert lab.of("ideal", "wind")[0] == pytest.approx([0.4 * np.exp(-1), 0.4 * (1 - np.exp(-1))], rel=1e-4)


def test_own_motion_is_felt_unless_taken_out(lab):
    lab.fit({"ideal": Anemometer(kind="ideal"), "pid": Anemometer(kind="ideal", compensated=False)})
    lab.air.u[None] = [0.5, 0.0]
    lab.swarm.velocity.fill([0.2, 0.0])
    lab.measure()
    assert lab.of("ideal", "wind")[0] == pytest.approx([0.5, 0.0])
    assert lab.of("pid", "wind")[0] == pytest.approx([0.3, 0.0])
