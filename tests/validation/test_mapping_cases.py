"""The mapping experiment: its scenario, what it makes of maps, and its closed forms."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taichi_plume import load_scenario
from taichi_plume.agents.time_series import neighbourhood
from taichi_plume.scenario.maps import TimeSeriesMap
from taichi_plume.validation import mapping_cases, mapping_scenario, mapping_whiffs
from taichi_plume.validation.case import Curve
from taichi_plume.validation.experiment import Lines, Mean
from taichi_plume.validation.mapping_cases import ALPHAS, chosen, forecasts, least, levels, of_length, worst
from taichi_plume.validation.mapping_scenario import (
    BEST,
    BETAS,
    GASES,
    READINGS,
    SOURCES,
    TEAMS,
    WINDOW,
    WINDOWS,
    Team,
    arena,
    persistence,
    remembering_alphas,
)
from taichi_plume.validation.mapping_whiffs import endless
from taichi_plume.validation.report import page
from taichi_plume.validation.searches import scenario_of

pytestmark = pytest.mark.usefixtures("taichi")

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize(
    ("name", "team"),
    [
        ("dapso", Team("DAPSO", 0.1, "MiCS-5524", (1.7, 2.0))),
        ("lineup", Team("line-up", 0.1, "MiCS-5524", (2.5, 1.2))),
    ],
)
def test_the_configs_show_the_experiment_from_above(name, team):
    """Robots, wind and maps are the same; sensors smell one of two gases, and air and gas are in 3-D."""
    ours, theirs = scenario_of(arena(teams=[team])), load_scenario(CONFIGS / f"odor_mapping_{name}.yaml")
    robots, shown = ours.robots[0], theirs.robots[0]
    smells = robots.sensors.nose.model_copy(update={"sensitivity": {}})
    sensors = robots.sensors.model_copy(update={"gas": smells})
    assert robots.model_copy(update={"name": shown.name, "sensors": sensors}) == shown
    assert ours.wind == theirs.wind
    assert set(theirs.maps) <= set(ours.maps)
    (of_ours,) = [gas for _, gas in ours.gases if gas.sources[0].position[:2] == team.source]
    assert theirs.gas.sources[0].position == of_ours.sources[0].position[:2]
    assert theirs.gas.sources[0].rate == of_ours.sources[0].rate
    assert (ours.tick, ours.duration, ours.warm_up) == (theirs.tick, theirs.duration, theirs.warm_up)


def test_a_team_smells_its_own_source_alone():
    """The two gases have the same numbers; a team is blind to that of the other source."""
    scenario = scenario_of(arena())
    own, other = (gas.vapour for _, gas in scenario.gases)
    assert replace(own, name="", vapour_pressure=None, latent_heat=None) == replace(
        other, name="", vapour_pressure=None, latent_heat=None
    )
    for group, team in zip(scenario.robots, TEAMS, strict=True):
        weights = [group.sensors.nose.weight(name) for name in GASES]
        assert weights == [float(source == team.source) for source in SOURCES]


@pytest.mark.parametrize(("window", "count"), [(2.5, 6), (5.0, 6), (10.0, 5), (25.0, 3)])
def test_alphas_that_remember_see_two_past_snaps(window, count):
    """As the neighbourhoods of their maps reach back."""
    models = [TimeSeriesMap(kind="time_series", alpha=alpha, window=window) for alpha in ALPHAS]
    reach = [max(lag for lag, *_ in neighbourhood(model, 15)) for model in models]
    assert tuple(alpha for alpha, lag in zip(ALPHAS, reach, strict=True) if lag >= 2) == remembering_alphas(
        window
    )
    assert len(remembering_alphas(window)) == count


@pytest.mark.parametrize(
    ("change", "rates"),
    [("", [20] * 6), ("stops", [20, 20, 0, 0, 0, 0]), ("slows", [30, 25, 20, 20, 15, 10])],
)
def test_sources_stop_or_slow_to_the_published_rate(change, rates):
    """Rates [mg/s] at 30, 90, 130, 170, 230 and 290 s, of each of the two gases."""
    for _, gas in scenario_of(arena(0, TEAMS[:1], change=change)).gases:
        emitted = [
            sum(source.rate or 0.0 for source in gas.sources if source.stop is None or t < source.stop)
            for t in (30.0, 90.0, 130.0, 170.0, 230.0, 290.0)
        ]
        assert np.array(emitted) * 1e6 == pytest.approx(rates)


def test_series_count_up_to_their_length():
    """Errors that are 1 at first and 3 from 80 s on, of pure interpolation always 2."""
    times = np.arange(35.0, 121.0, 5.0)
    errors = np.full((7, len(times), 1), 2.0)
    errors[4] = np.where(times < 80.0, 1.0, 3.0)[:, None]
    runs: Any = [SimpleNamespace(times=times, errors={5.0: errors})] * 3
    short, whole = (of_length(runs, np.array([0]), 5.0, last) for last in (75.0, 120.0))
    assert short.shape == (7, 3)
    assert (short[4] == 1.0).all()
    assert whole[4] == pytest.approx(2.0)
    found = forecasts(short, "maps", 75.0)
    assert found["maps, 75 s: alpha of the least error"].mean == ALPHAS[3]
    assert found[f"maps, 75 s: alpha 0.9 / {mapping_cases.PURE}"].mean == 0.5


def test_figures_are_of_the_paper_set_up(monkeypatch):
    """In the first air, errors of 2 ppm by pure interpolation, of 1 and 3 ppm by time series of DAPSO and the line."""
    errors = np.full((1 + len(ALPHAS), 2, len(TEAMS)), np.nan)
    for navigation, error in (("DAPSO", 1.0), ("line-up", 3.0)):
        (team,) = chosen(navigation, *mapping_cases.PAPER, SOURCES[0])
        errors[:, :, team] = np.where(np.arange(1 + len(ALPHAS)) == 0, 2.0, error)[:, None]
    runs = [
        SimpleNamespace(times=np.array([35.0, 40.0]), errors={WINDOW: part}) for part in (errors, 2 * errors)
    ]
    monkeypatch.setattr(mapping_cases, "in_airs", lambda airs: runs)
    parts = mapping_cases.figures(2).values()
    line, swarm, bars = (part.lines for part in parts if isinstance(part, Lines))
    assert [set(part["alpha 0.9"]) for part in (line, swarm)] == [{3.0}, {1.0}]
    assert set(swarm[mapping_cases.PURE]) == {2.0}
    assert [set(bars[name]) for name in ("DAPSO", "line-up")] == [{0.5}, {1.5}]


def test_levels_are_means_within_an_interval():
    """The mean of one map over all snaps, from 7 to 2 ppm, and of two maps in the last snap."""
    times = np.array([35.0, 40.0, 45.0, 50.0, 55.0, 60.0])
    runs: Any = [
        SimpleNamespace(
            times=times, level=np.stack([np.zeros((6, 2)), np.array([7.0, 6, 5, 4, 3, 2])[:, None] + [0, 2]])
        )
    ]
    assert levels(runs, np.array([0]), 1, 30.0, 60.0) == pytest.approx([4.5])
    assert levels(runs, np.array([0, 1]), 1, 55.0, 60.0) == pytest.approx([3.0])
    assert levels(runs, np.array([0]), 0, 30.0, 60.0) == pytest.approx([0.0])


def test_teams_are_chosen_by_what_they_are():
    assert len(chosen("DAPSO")) == len(TEAMS) // 2
    (one,) = chosen("line-up", 0.2, "no lag", (2.5, 1.2))
    assert TEAMS[one] == Team("line-up", 0.2, "no lag", (2.5, 1.2))


def test_persistence_of_a_known_process():
    """Readings that follow an autoregression of known correlation: it is kept; a mean of all snaps errs so."""
    rng, kept = np.random.default_rng(1), np.array([0.0, 0.5, 0.8])
    x = np.zeros((4000, 3, 4, 4))
    noise = rng.standard_normal(x.shape)
    r = kept[:, None, None]
    for n in range(1, len(x)):
        x[n] = r * x[n - 1] + np.sqrt(1.0 - r**2) * noise[n]
    found, scatter, long = persistence(10.0 + x)
    assert found == pytest.approx(kept, abs=0.02)
    assert scatter == pytest.approx(0.1, rel=0.05)
    assert long == pytest.approx(endless(kept), rel=0.03)


def test_spread_of_known_teams():
    """Robots on a circle are its radius from their centroid; a team at one point has no spread."""
    angle = 2 * np.pi * np.arange(5) / 5
    circle = [2.0, 1.0] + 0.4 * np.column_stack([np.cos(angle), np.sin(angle)])
    place = np.concatenate([circle, np.full((4, 2), 1.5)])
    assert mapping_scenario.spread(place, np.repeat([0, 1], [5, 4])) == pytest.approx([0.4, 0.0], abs=1e-9)


def test_gas_that_is_there_or_not_gains_nothing_from_a_long_mean():
    """Of readings that are 0 or 1 by chance, |c - mean| and |c - c'| have one mean, 2 p (1 - p): eq 8 cannot tell."""
    snaps = (np.random.default_rng(1).random((20000, 1, 2, 2)) < 0.2).astype(float)
    assert persistence(snaps)[2] == pytest.approx(1.0, abs=0.02)


def test_the_least_error_is_where_the_mean_is_least():
    errors = np.ones((len(ALPHAS), 8))
    errors[2] = 0.5
    errors[4, 0] = 0.1
    found = least(errors)
    assert (found.mean, found.low, found.high) == (ALPHAS[2],) * 3


def test_the_worst_alpha_is_one_that_sees_two_snaps():
    shares = [Mean(ratio, None, None, 8) for ratio in (1.3, 0.9, 1.2, 0.8, 0.7, 0.6)]
    assert worst(shares) is shares[0]
    assert worst(shares, 10.0) is shares[2]  # alpha = 0.4 reaches back 8.33 s


@pytest.mark.slow
def test_a_short_run_tells_everything(monkeypatch):
    """Ten seconds after the errors begin to count, with the teams of what is taken for the paper's set-up."""
    short = tuple(team for team in TEAMS if team[1:3] == mapping_cases.PAPER)
    for module in (mapping_scenario, mapping_cases):
        monkeypatch.setattr(module, "TEAMS", short)
    monkeypatch.setattr(mapping_scenario, "DURATION", 40.0)
    monkeypatch.setattr(mapping_scenario, "CHANGED_DURATION", {"stops": 95.0, "slows": 40.0})
    for module in (mapping_scenario, mapping_cases):
        monkeypatch.setattr(module, "STOP", 35.0)
    monkeypatch.setattr(mapping_cases, "AFTER", (5.0, 60.0))
    monkeypatch.setattr(mapping_cases, "SPEEDS", (mapping_cases.PAPER[0],))
    monkeypatch.setattr(mapping_cases, "SENSORS", (mapping_cases.PAPER[1],))
    monkeypatch.setattr(mapping_whiffs, "CASES", mapping_whiffs.CASES[:1])
    mapping_scenario.in_airs.cache_clear()
    try:
        airs = mapping_scenario.in_airs(2)
        for condition in mapping_cases.CASES[0].conditions:
            reported = condition.run(2)
            means = {name: part for name, part in reported.items() if isinstance(part, Mean)}
            assert condition.published.keys() | condition.expected.keys() <= means.keys()
            assert {mean.n for mean in means.values()} <= {0, 1, 2}
    finally:
        mapping_scenario.in_airs.cache_clear()
    first, second = airs
    assert first.times == pytest.approx([35.0, 40.0])
    assert not np.array_equal(first.errors[5.0], second.errors[5.0])
    assert [first.errors[window].shape for window in WINDOWS] == [(7, 2, 4), (7, 4, 4), (7, 1, 4)]
    assert [first.errors[name].shape for name in READINGS] == [(7, 2, 4), (7, 2, 4)]
    here, there = first.errors["beta"][BETAS.index(0.5)], first.errors[WINDOW][1 + ALPHAS.index(BEST)]
    np.testing.assert_array_equal(here, there)  # the same map
    np.testing.assert_array_equal(first.errors["age from the forecast snap"][0], first.errors[WINDOW][0])
    assert not np.array_equal(first.errors["age from the forecast snap"][1:], first.errors[WINDOW][1:])
    assert (first.passed <= 40.0).any()
    assert (first.way > 0.0).all()
    assert (first.spread > 0.1).all()  # robots of 5 cm radius do not overlap
    assert ((first.met >= 0.0) & (first.met <= 1.0)).all()


def test_lines_are_drawn():
    x = np.arange(3.0)
    case = dict.fromkeys(("about", "reference", "discussion", "message"), "")
    case |= {"name": "maps", "wall_s": 1.0, "passed": True, "skipped": False}
    case["evidence"] = "published"
    report = {"passed": True, "cases": [case], "wall_s": 1.0, "backend": "cpu", "versions": {}}
    drawn = page(report, {"maps": {"errors": Lines("t", "MAE", x, {"one": x, "two": 2 * x})}})
    assert drawn.count("<img") == 1
    assert drawn != page(report, {"maps": {"errors": Curve("t", "MAE", x, x, x)}})
