"""Maps of recorded readings: those of a run are the maps that its robots made."""

import json
from typing import Any

import numpy as np
import pytest
from readings_log import log
from scipy import stats

from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.gmrf import MarkovMap as MarkovMapper
from taichi_plume.agents.mapping import mappers
from taichi_plume.agents.recorded_readings import RecordedTeam
from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.cli import maps
from taichi_plume.engine import program
from taichi_plume.execution import robots_table
from taichi_plume.files.readings import ReadingsError, read
from taichi_plume.results.recorded_maps import map_of
from taichi_plume.scenario.maps import InverseDistanceMap, KernelMap, MarkovMap, TimeSeriesMap

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SCENARIO = """
name: readings
seed: 3
duration: 20
domain: {size: [2.0, 1.5], spacing: 0.05, depth: 0.5}
wind: {kind: uniform, velocity: [0.4, 0.0]}
gas: {kind: gaussian_plume, intensity: 0.1, sources: [{position: [0.3, 0.7], rate: 1.0e-6, radius: 0.05}]}
robots:
  - name: walkers
    count: 3
    trials: 2
    reach: 0
    localization: {kind: odometry}
    start: {kind: area, low: [0.3, 0.3], high: [1.7, 1.2]}
    algorithm: {kind: random_walk}
    sensors: {gas: {kind: mox, model: mics5524}, wind: {kind: ultrasonic}}
maps:
  - {kind: time_series, alpha: 0.9}
  - {kind: kernel_dmv, cell: 0.1, wind_stretch: 0.25}
  - {kind: gmrf, cell: 0.25, window: 2}
  - {kind: inverse_distance}
"""


@pytest.fixture
def mapped(tmp_path):
    """Make the map of rows t, x, y, reading on a floor of 1 x 1 m."""
    return lambda rows, model: map_of(read(log(tmp_path / "a.csv", rows)), model, (1.0, 1.0))


def inverse_distance(window: float) -> InverseDistanceMap:
    return InverseDistanceMap(kind="inverse_distance", window=window)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run to its end with its robots.parquet, and what its second trial's maps reported."""
    program.start("cpu")
    path = tmp_path_factory.mktemp("run") / "readings.yaml"
    path.write_text(SCENARIO)
    sim = assemble(load_scenario(path))
    table = robots_table.RobotTable(sim, path.with_name("robots.parquet"))
    table.start()
    sim.observers.append(table.observer())
    sim.run()
    table.close()
    reported = []
    for gas_map in sim.maps:
        one: Any = gas_map
        variance = one.variance()[1] if hasattr(one, "variance") else None
        errors = [(t, error[1]) for t, error in one.errors]
        reported.append((one.estimate()[1], one.weight()[1], variance, errors))
    return sim.scenario, table.path, reported


@pytest.mark.parametrize("number", range(4))
def test_readings_of_a_run_give_the_maps_of_the_run(recorded, number):
    scenario, table, reported = recorded
    estimate, weight, variance, errors = reported[number]
    model = scenario.maps[number]
    written = type(model).model_validate(model.model_dump())  # with all defaults, as in a run's scenario.yaml
    gas_map = map_of(read(table, trial=1), written, (2.0, 1.5))
    assert gas_map.scores["chosen_for_the_log"] == {}
    assert np.isfinite(estimate).any()
    np.testing.assert_array_equal(gas_map.estimate, estimate)
    np.testing.assert_array_equal(gas_map.weight, weight)
    assert (gas_map.variance is None) == (variance is None)
    if variance is not None:
        np.testing.assert_array_equal(gas_map.variance, variance)
    assert gas_map.scores["forecast"] == {
        "time_s": [t for t, _ in errors],
        "error_ppm": [e for _, e in errors],
    }


@pytest.mark.parametrize("number", [0, 1])
def test_the_command_writes_map_picture_and_scores(recorded, number, tmp_path, capsys):
    _, table, reported = recorded
    kinds = ("{kind: time_series, window: 5}", "{kind: kernel_dmv, cell: 10 cm, wind_stretch: 0.25}")
    out = tmp_path / "out"
    where = ["--size", "2 m", "1.5", "--source", "0.3", "70 cm", "--trial", "1", "--group", "walkers"]
    assert maps.main(["--map", kinds[number], str(table), *where, "--out", str(out)]) == 0
    scores = json.loads((out / "scores.json").read_text())
    assert scores["readings"] == 600
    rows = np.genfromtxt(out / "map.csv", delimiter=",", names=True)
    columns = [rows[name].reshape(reported[number][0].shape) for name in ("ppm", "weight")]
    for column, expected in zip(columns, reported[number], strict=False):
        np.testing.assert_allclose(column, expected, rtol=1e-5)
    assert ("variance_ppm2" in (rows.dtype.names or ())) == (number == 1)
    best = np.nanargmax(rows["ppm"])
    away = np.hypot(rows["x"][best] - 0.3, rows["y"][best] - 0.7)
    assert scores["peak"]["to_source_m"] == pytest.approx(away, rel=1e-5)
    assert (out / "map.png").read_bytes()[:4] == b"\x89PNG"
    assert f"\npeak {scores['peak']['ppm']:.3g} ppm at (" in capsys.readouterr().out


def test_even_readings_make_an_even_map_whatever_the_clock_says(mapped):
    begin = 1.7e9 + 3.0
    rng = np.random.default_rng(1)
    rows = [(begin + k, *rng.uniform(0.0, 1.0, 2).round(3), 12.5) for k in range(40)]
    rows += [(begin + 4.0, 7.0, 0.5, 99.0), (begin + 4.0, 0.5, 0.5, "nan"), (begin + 5.0, 0.5, 0.5, "inf")]
    gas_map = mapped(rows, inverse_distance(5.0))
    np.testing.assert_allclose(gas_map.estimate, 12.5, rtol=1e-6)
    assert gas_map.scores["forecast_error_ppm"] == pytest.approx(0.0, abs=1e-5)
    assert gas_map.scores["forecast"]["time_s"][0] == pytest.approx(1.7e9 + 10.0)
    assert (gas_map.scores["readings"], gas_map.scores["left_out"]) == (40, 3)


MODELS = (
    TimeSeriesMap(kind="time_series", window=1.7),
    TimeSeriesMap(kind="time_series", window=1.7, raw_samples=True),
    KernelMap(kind="kernel_dmv", cell=0.25, memory=10.0),
    MarkovMap(kind="gmrf", cell=0.25, window=1.7),
)


@pytest.mark.parametrize("model", MODELS)
def test_what_the_clock_shows_does_not_matter(model, mapped):
    """Two robots read five times a second, and so at the ends of snaps; 1.7e9 s is a multiple of all windows."""
    rng = np.random.default_rng(5)
    rows = [(k / 5, *rng.uniform(0, 1, 2), rng.uniform(0, 90)) for k in range(184) for _ in range(2)]
    early = mapped(rows, model)
    late = mapped([(t + 1.7e9, *row) for t, *row in rows], model)
    np.testing.assert_array_equal(late.estimate, early.estimate)
    np.testing.assert_array_equal(late.weight, early.weight)
    assert late.scores["readings"] == 368
    for name in ("forecast_error_ppm", "nlpd", "nlpd_median"):
        assert late.scores[name] == early.scores[name]
    assert late.scores["forecast"]["error_ppm"] == early.scores["forecast"]["error_ppm"]


def test_a_reading_where_windows_meet_begins_the_first(mapped):
    rows = [(0.3 + 0.05 * k, 0.5, 0.5, 5.0) for k in range(9)]  # 0.3 / 0.1 is a little less than 3
    scores = mapped(rows, inverse_distance(0.1)).scores
    assert scores["forecast"]["time_s"] == pytest.approx([0.5, 0.6, 0.7])


def test_forecasts_count_from_30_s_after_the_first_reading(mapped):
    rows = [(7.5 + k, 0.5, 0.5, 0.1 * k**2) for k in range(42)]
    scores = mapped(rows, inverse_distance(4.0)).scores
    forecast = scores["forecast"]
    assert forecast["time_s"] == pytest.approx([12, 16, 20, 24, 28, 32, 36, 40, 44, 48])
    assert scores["forecast_error_ppm"] == pytest.approx(np.mean(forecast["error_ppm"][-3:]))
    assert forecast["error_ppm"][-1] != pytest.approx(forecast["error_ppm"][-4])
    assert mapped(rows[:30], inverse_distance(4.0)).scores["forecast_error_ppm"] is None


def test_the_last_readings_are_in_the_map(mapped):
    """A snap that the log does not end: 10 s of 5 ppm, then 2 s of 80."""
    rows = [(0.5 * k, 0.5, 0.5, 5.0 if k <= 20 else 80.0) for k in range(1, 25)]
    gas_map = mapped(rows, inverse_distance(5.0))
    np.testing.assert_allclose(gas_map.estimate, 80.0, rtol=1e-6)
    assert gas_map.scores["forecast"] == {"time_s": [10.0], "error_ppm": [pytest.approx(0.0, abs=1e-5)]}
    model = MarkovMap(kind="gmrf", cell=1.0, window=5.0, memory=None)
    gas_map = mapped(rows, model)
    assert gas_map.estimate.item() == pytest.approx((20 * 5.0 + 4 * 80.0) / 24)


def test_windows_of_a_field_are_cut_as_in_a_run(mapped):
    """Against the map of readings reported one by one since 0 s, in a log that begins at 6 s."""
    model = MarkovMap(kind="gmrf", cell=0.25, window=2.0, memory=20.0)
    rng = np.random.default_rng(4)
    rows = [(6.25 + 0.5 * k, *rng.uniform(0, 1, 2), rng.uniform(0, 90)) for k in range(24)]
    gas_map = mapped(rows, model)
    expected = MarkovMapper(model, Floor((1.0, 1.0), 1, 1, 0.5))
    team = RecordedTeam(1)
    for t, x, y, reading in [*rows, (18.0, 0.5, 0.5, np.nan)]:
        team.show(np.array([[x, y]]), np.zeros((1, 2)), np.array([reading]))
        expected.update(team, t, 0.5)
    np.testing.assert_allclose(gas_map.estimate, expected.estimate()[0], rtol=1e-9)
    assert gas_map.variance is not None
    np.testing.assert_allclose(gas_map.variance, expected.variance()[0], rtol=1e-9)


def test_times_that_all_but_agree_need_no_more_room(mapped, monkeypatch):
    made: list[Any] = []

    def spy(*args: Any) -> list[Any]:
        made.extend(mappers(*args))
        return made

    monkeypatch.setattr("taichi_plume.agents.mapping.mappers", spy)
    rows = [(k + late, 0.5, 0.5, 5.0 + k) for k in range(1, 12) for late in (0.0, 1e-7, 3e-6)]
    gas_map = mapped(rows, inverse_distance(5.0))
    assert made[0].snaps.samples.shape[2] < 50
    np.testing.assert_allclose(gas_map.estimate, (15 + 3 * 16) / 4, rtol=1e-6)  # from 10.000003 s on


@pytest.mark.parametrize("model", MODELS)
def test_a_clock_that_jumps_is_refused(model, mapped):
    rows = [(1.7e9, 0.5, 0.5, 5.0), (1.0, 0.5, 0.5, 5.0), (2.0, 0.5, 0.5, 5.0)]
    with pytest.raises(ReadingsError, match=r"^row 1: t = 1700000000 s is 1\.7e\+09 s after"):
        mapped(rows, model)


@pytest.mark.parametrize(
    ("seed", "model"),
    [
        (2, KernelMap(kind="kernel_dmv", cell=0.25)),
        (3, MarkovMap(kind="gmrf", cell=1.0, lambda_observation=1.0 / 16.0, memory=None)),
    ],
    ids=["variance", "mean and scatter"],
)
def test_a_variance_is_judged_by_the_readings_to_come(mapped, seed, model):
    """Normal readings around 50 ppm: the negative logarithm of their density is that of a normal distribution.

    The mean of one cell of a Markov field is soon known far better than any reading to come, which scatters.
    """
    rng = np.random.default_rng(seed)
    rows = [(0.1 * k, 0.5, 0.5, 50.0 + 4.0 * rng.standard_normal()) for k in range(1, 601)]
    scores = mapped(rows, model).scores
    entropy = 0.5 * np.log(2 * np.pi * np.e * 16.0)
    assert scores["nlpd"] == pytest.approx(entropy, abs=0.15)  # five standard errors of 550 readings
    assert model.kind != "gmrf" or scores["nlpd_median"] < scores["nlpd"]


def test_what_ended_before_is_known_of_the_readings_to_come(mapped):
    """A field of one cell is the mean m of n readings, each ± 2 ppm: the next is m ± 2 (1 + 1/n)^½."""
    values = np.array([3.0, 9.0, 4.0, 8.0, 1.0, 7.0, 2.0, 5.0])
    rows = [(0.5 + k, 0.5, 0.5, value) for k, value in enumerate(values)]
    model = MarkovMap(kind="gmrf", cell=1.0, lambda_observation=0.25, memory=None)
    scores = mapped(rows, model).scores
    known, to_come = values[:5], values[5:]  # at 5 s
    surprises = -stats.norm(known.mean(), 2.0 * np.sqrt(1.2)).logpdf(to_come)
    assert scores["nlpd"] == pytest.approx(surprises.mean(), rel=1e-5)
    assert scores["nlpd_median"] == pytest.approx(np.median(surprises), rel=1e-5)
