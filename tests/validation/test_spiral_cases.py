"""The SPIRAL room as the experiment and the config tell it, and what its trials come to."""

from pathlib import Path

import numpy as np
import pytest

from taichi_plume import load_scenario
from taichi_plume.assembly.assemble import assemble
from taichi_plume.scenario.search_algorithm import Spiral
from taichi_plume.validation import spiral_cases, spiral_room
from taichi_plume.validation.experiment import Range
from taichi_plume.validation.searches import outcomes, scenario_of
from taichi_plume.validation.spiral_cases import CASES, airs_of, chance_of_variation
from taichi_plume.validation.spiral_floor import ARMS, NoisyIndex, arms, chi_square
from taichi_plume.validation.spiral_index import PLACES, in_order
from taichi_plume.validation.spiral_index import spread as index_spread
from taichi_plume.validation.spiral_room import (
    ALGORITHMS,
    READINGS,
    TABLE_2,
    Sample,
    at,
    begins,
    floor,
    momo,
    reading,
    room,
)

pytestmark = pytest.mark.usefixtures("taichi")

CONFIG = Path(__file__).parents[2] / "configs" / "spiral_room.yaml"


def test_the_config_is_the_experiment_of_the_validation():
    theirs = load_scenario(CONFIG)
    robot = momo(
        "momo", 1, at(180), {"kind": "spiral", "minimum_ppm": theirs.robots[0].algorithm.minimum_ppm}
    )
    ours = scenario_of(room(0, [robot], theirs.duration))
    assert ours.model_copy(update={"recording": theirs.recording}) == theirs


@pytest.mark.slow
def test_every_row_has_its_trials(monkeypatch):
    monkeypatch.setattr(spiral_cases, "AIRS", 1)
    monkeypatch.setattr(spiral_room, "OPENED", 60.0)
    monkeypatch.setattr(spiral_cases, "HOUR", 150.0)
    monkeypatch.setattr(spiral_cases, "least_index", lambda airs: 1.0)
    monkeypatch.setattr(spiral_cases, "begins", lambda row: [0.0, 5.0, 5.0, 10.0])
    experiment, _ = CASES
    rows = experiment.conditions[:9]
    reported = {condition.name: condition.run(6) for condition in rows}
    quick, slow = reported["E. coli 3 s, 180 cm"], reported["random SPIRAL, 180 cm"]
    assert Range(least=15).met(quick["acquisitions"].mean)  # of 3 s, and 5 s of driving and turning
    assert Range(3, 4.5).met(slow["acquisitions"].mean)  # of 31 s, and 5
    assert all(reported[row.name]["success"].n == 6 for row in rows[:-1])
    assert [name for name, results in reported.items() if "escapes" in results] == [
        f"{algorithm}, {d} cm" for algorithm in ("SPIRAL", "random SPIRAL") for d in (180, 150)
    ]
    ratios = rows[-1]
    assert ratios.published.keys() >= ratios.expected.keys()
    assert reported[ratios.name].keys() > ratios.expected.keys()
    chances = [
        reported[row.name][spiral_cases.CHANCE(kind)].mean
        for row in rows[:-1]
        for kind in ("time", "acquisitions")
    ]
    unlikely = reported[ratios.name][spiral_cases.UNLIKELY]
    assert (unlikely.mean, unlikely.n) == (np.mean(np.array(chances) < 0.01), 16)
    assert all((one["time_s"][one["success"]] <= 150.0).all() for one in spiral_cases.table(6).values())


@pytest.mark.slow
def test_every_reading_has_its_trials(monkeypatch):
    """In the time of an acquisition only those robots complete one that do not drive before."""
    monkeypatch.setattr(spiral_room, "OPENED", 60.0)
    monkeypatch.setattr(spiral_cases, "HOUR", 32.0)
    monkeypatch.setattr(spiral_cases, "least_index", lambda airs: 1.0)
    readings = CASES[1]
    reported = {condition.name: condition.run(1) for condition in readings.conditions}
    assert len(reported) == 2 * len(READINGS)
    assert all(results.keys() >= readings.conditions[0].published.keys() for results in reported.values())
    steps = {name: results["acquisitions"].mean for name, results in reported.items()}
    assert [name for name, mean in steps.items() if mean == 1.0] == [
        f"acquisition first, {d} cm" for d in (180, 150)
    ]


@pytest.mark.parametrize("name", READINGS)
def test_readings_differ_from_the_default_by_their_keys(name):
    usual, other = (Spiral.model_validate(keys) for keys in (ALGORITHMS["SPIRAL"], reading(name)))
    different = {key for key, value in usual if value != getattr(other, key)}
    assert different == READINGS[name].keys()


def test_spiral_is_judged_within_two_standard_errors_in_24_airs():
    steps = {d: CASES[0].conditions[k].expected["acquisitions"] for k, d in enumerate((180, 150))}
    assert steps == {180: Range(9.28, 13.72), 150: Range(7.81, 10.59)}
    assert airs_of(CASES[0].trials) == airs_of(CASES[1].trials) == 24
    assert [airs_of(trials) for trials in (1, 4, 5, 92, 93)] == [1, 1, 2, 23, 24]


def test_escapes_are_counted_per_search():
    """Spirals of two arms that never hit escape after every two acquisitions. E. coli knows no escapes."""
    stays = {"kind": "spiral", "arms": [0.1, 0.1], "acquisition": 1.0, "minimum_ppm": 1e6}
    groups = [
        momo("spirals", 3, at(150), stays),
        momo("late", 2, at(150), stays, 30.0),
        momo("runs", 3, at(150), {"kind": "ecoli"}),
    ]
    sim = assemble(scenario_of(floor(groups, 60.0) | {"rivals": True}))
    sim.run()
    columns = outcomes(sim)
    for name in ("spirals", "late"):
        assert columns[name]["escapes"] == [count // 2 for count in columns[name]["acquisitions"]]
    assert min(columns["spirals"]["escapes"]) > max(columns["late"]["escapes"]) > 1
    assert "escapes" not in columns["runs"]


def test_sessions_are_spaced_by_the_published_times():
    assert begins(("SPIRAL", 180)) == [0.0, 458.2, 916.4, 1374.6]
    assert begins(("E. coli 30 s", 180))[-1] == pytest.approx(5193.6)


def test_published_intervals_are_students():
    assert str(TABLE_2["SPIRAL", 180].acquisitions) == "11.5 +- 2.4 (n = 15)"


@pytest.mark.parametrize(("n", "variation"), [(4, 0.3), (10, 0.21), (15, 0.22), (15, 0.9)])
def test_chance_of_a_published_variation_is_that_of_as_many_searches(n, variation):
    """Memoryless searches, in airs without influence: against drawing n from the distribution itself."""
    rng = np.random.default_rng(4)
    steps, air = rng.geometric(0.03, 20_000) + 5, np.arange(20_000) % 50
    truth = rng.geometric(0.03, (200_000, n)) + 5
    expected = np.mean(truth.std(axis=1, ddof=1) / truth.mean(axis=1) <= variation)
    found = chance_of_variation(steps, air, Sample(30.0, 30.0 * variation, n))
    assert found.mean == pytest.approx(expected, rel=0.1, abs=2e-4)


def test_chance_of_a_variation_keeps_sessions_in_one_air():
    """Searches that are equal in an air: a session of four has no variation, two sessions only in different airs."""
    air = np.repeat(np.arange(10), 7)
    for n, expected in ((4, 1.0), (8, 0.1)):
        assert chance_of_variation(10.0 + air, air, Sample(1.0, 1e-9, n)).mean == pytest.approx(
            expected, abs=5e-3
        )


def test_pairs_in_order_and_spread_of_indices():
    distance = np.array([d for d, _ in PLACES])
    assert in_order(np.tile(1.0 / distance, (4, 1))) == 1.0
    assert in_order(np.tile(distance, (4, 1))) == 0.0
    rising = np.outer(np.exp(0.1 * np.arange(400)), 1.0 / distance)
    noise = np.exp(0.3 * np.random.default_rng(1).standard_normal(rising.shape))
    assert index_spread(rising * noise) == pytest.approx(0.3, rel=0.2)
    assert index_spread(rising) == pytest.approx(0.0, abs=1e-6)


def test_chi_square_counts_standard_errors():
    """Two means of four trials that are 1 and 2 standard errors of ours away."""
    ours = np.array([-1.0, 1.0]).repeat(500)
    of_four = ours.std(ddof=1) / 2
    assert chi_square([(of_four, 4), (-2 * of_four, 4)], [ours, ours]) == pytest.approx(5.0)


@pytest.mark.slow
def test_default_arms_fit_random_spiral():
    """400 searches can tell them from those of 0.5 m only."""
    found = arms(400)
    chi = np.array([found[f"{name}: chi-square, of 2"].mean for name in ARMS], float)
    default = list(ARMS.values()).index(Spiral.model_fields["arms"].default)
    assert chi[default] < min(1.0, chi[-1])


def test_indices_have_the_noise_that_is_reported():
    """Readings at a place differ from acquisition to acquisition, not within one, and by the spread that is given."""
    groups = [momo(name, 2000, at(150), {"kind": "ecoli"}) for name in ("smooth", "noisy")]
    sim = assemble(scenario_of(floor(groups, 10.0) | {"rivals": True}))
    field = NoisyIndex(sim.swarm, np.repeat([0.0, 0.4], 2000))
    seen = []
    for count in (0, 0, 1):
        sim.swarm.acquisitions.fill(count)
        field.measure(None, None, 1, 0.25)
        seen.append(np.log(sim.swarm.reading.to_numpy()))
    first, same, other = seen
    np.testing.assert_array_equal(first, same)
    assert first[:2000] == pytest.approx(np.log(0.5 / 1.8), abs=1e-5)
    assert first[2000:].std() == pytest.approx(0.4, rel=0.1)
    assert abs(np.corrcoef(first[2000:], other[2000:])[0, 1]) < 0.13
