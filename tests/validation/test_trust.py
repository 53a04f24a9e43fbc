"""The picture of trust: its statistics, and that every case with something to compare is in it."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trust_picture
from matplotlib.figure import Figure
from scripts import loaded

from taichi_plume.validation.cases import CASES
from taichi_plume.validation.trust import SCALES, Points, collected, comparisons, published, statistics

DOCS = Path(__file__).resolve().parents[2] / "docs"
RESULTS = json.loads((DOCS / "validation/results.json").read_text(encoding="utf-8"))
COLLECTED = collected(CASES, RESULTS)


def points(measured, computed, sigma=0.0, met=True) -> Points:
    measured, computed = np.asarray(measured, float), np.asarray(computed, float)
    return Points("a case", "measured", met, measured, computed, np.full(len(measured), sigma))


def random_pairs(n: int, bias: float, model: float, experiments: float, seed: int) -> Points:
    """Pairs by the definitions of McGrattan & Toman: E = T (1 + e), M = bias T (1 + m)."""
    rng = np.random.default_rng(seed)
    true = rng.uniform(1.0, 100.0, n)
    measured = true * (1.0 + experiments * rng.standard_normal(n))
    computed = bias * true * (1.0 + model * rng.standard_normal(n))
    return points(measured, computed, experiments)


@pytest.mark.parametrize(
    ("bias", "model", "experiments"), [(1.2, 0.15, 0.08), (0.8, 0.1, 0.1), (1.0, 0.2, 0.0)]
)
def test_bias_and_deviations_of_random_pairs_are_recovered(bias, model, experiments):
    found = statistics([random_pairs(40_000, bias, model, experiments, seed) for seed in (1, 2)])
    assert found.points == 80_000
    assert found.bias == pytest.approx(bias, rel=0.01)
    assert found.model == pytest.approx(model, rel=0.07)  # ln(1 + m) is Gaussian for small m alone
    assert found.experiments == pytest.approx(experiments)


def test_statistics_of_one_case_are_those_of_numpy():
    pairs = random_pairs(30, 1.3, 0.3, 0.05, 3)
    x = np.log(pairs.computed / pairs.measured)
    model = np.sqrt(x.var(ddof=1) - 0.05**2)
    found = statistics([pairs])
    assert found.model == pytest.approx(model)
    assert found.bias == pytest.approx(np.exp(x.mean() + model**2 / 2 - 0.05**2 / 2))


def test_the_model_is_never_more_certain_than_the_experiments():
    x = np.log([1.1, 0.9, 1.0])
    found = statistics([points([1.0, 1.0, 1.0], np.exp(x), sigma=0.5)])
    assert found.experiments == found.model == pytest.approx(x.std(ddof=1) / np.sqrt(2.0))


def test_cases_count_alike_however_many_points_they_have():
    few, many = points([1.0, 1.0], [2.0, 3.0]), points([1.0, 1.0], [0.5, 0.6])
    repeated = points(np.tile(many.measured, 50), np.tile(many.computed, 50))
    means = [np.log(part.computed).mean() for part in (few, many)]
    for groups in ([few, many], [few, repeated]):
        found = statistics(groups)
        assert np.log(found.bias) - found.model**2 / 2 == pytest.approx(np.mean(means))


def test_differences_count_where_values_change_sign():
    found = statistics([points([-0.5, 0.0, 0.5, 1.0], [-0.3, 0.1, 0.7, 1.1], sigma=0.1)], differences=True)
    x = np.array([0.2, 0.1, 0.2, 0.1])
    assert found.bias == pytest.approx(0.15)
    assert found.experiments == pytest.approx(
        x.std(ddof=1) / np.sqrt(2.0)
    )  # less than 0.1 of the speeds, rms


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.385", [(0.385, None)]),
        ("-0.144", [(-0.144, None)]),
        ("398.2 +- 84 (n = 15)", [(398.2, 84 / 398.2 / 2.1448)]),
        ("1 to 5", [(5**0.5, np.log(5) / 4)]),
        ("2 of 2, simulated", [(1.0, None)]),
        ("0.03, 0.06, 0.012", [(0.03, None), (0.06, None), (0.012, None)]),
    ],
)
def test_texts_of_published_values_are_read(text, values):
    for found, (value, sigma) in zip(published(text), values, strict=True):
        assert found == (pytest.approx(value), sigma if sigma is None else pytest.approx(sigma, rel=1e-4))


@pytest.mark.parametrize(
    "text", ["below 1", "0 to 5", "-1 to 2", "0 +- 1 (n = 3)", "1 +- 1 (n = 1)", "0 of 0"]
)
def test_a_text_without_a_number_that_can_be_compared_is_refused(text):
    with pytest.raises(ValueError, match="no number that can be compared"):
        published(text)


def test_results_with_a_single_point_and_without_any_are_drawn(tmp_path):
    (tmp_path / "plots").mkdir()
    (tmp_path / "speed.json").write_text((DOCS / "validation/speed.json").read_text(), encoding="utf-8")
    single = trust_picture.write(tmp_path, CASES, {"fan_jet": RESULTS["fan_jet"]})
    assert "| velocity | 1: `fan_jet` | 1 | – | – | – |" in single
    assert "| velocity" not in trust_picture.write(tmp_path, CASES, {})
    with pytest.raises(ValueError, match="a_ghost"):
        trust_picture.write(tmp_path, CASES, {"a_ghost": RESULTS["fan_jet"]})


def test_values_that_are_not_finite_are_left_out():
    result = json.loads(json.dumps(RESULTS["backward_step"]))
    whole = collected(CASES, {"backward_step": result})["velocity"][0]
    for picture in result["pictures"].values():
        if "computed" in picture:
            picture["computed"][0] = float("nan")
    rest = collected(CASES, {"backward_step": result})["velocity"][0]
    assert 0 < len(rest.measured) < len(whole.measured)
    assert np.isfinite(rest.computed).all()


@pytest.mark.parametrize("name", [name for name in RESULTS if comparisons(CASES[name])])
def test_a_case_that_has_diverged_is_left_out_and_listed(name):
    """A report stores what is not finite as null."""
    result = json.loads(json.dumps(RESULTS[name]))
    for row in result.get("rows", ()):
        row["mean"] = None
    for norm in result.get("norms", ()):
        norm["errors"] = dict.fromkeys(norm["errors"])
    for picture in result.get("pictures", {}).values():
        lines = picture.get("lines", picture)
        lines |= {key: [None] * len(line) for key, line in lines.items() if isinstance(line, list)}
    assert collected(CASES, {name: result}) == {}
    listed = trust_picture._absent(CASES, {name: result}, {})
    assert (f"`{name}`: no finite value" in listed) == (CASES[name].evidence in ("measured", "published"))


def test_every_measured_or_published_case_is_in_the_picture_or_says_why_not():
    for name, case in CASES.items():
        if case.evidence in ("measured", "published"):
            assert case.compared, f"{name} states neither comparisons nor the reason for none"
    shown = {(quantity, group.case) for quantity, groups in COLLECTED.items() for group in groups}
    wanted = {(part.quantity, name) for name in RESULTS for part in comparisons(CASES[name])}
    assert shown == wanted
    assert COLLECTED.keys() == SCALES.keys()


@pytest.mark.parametrize("name", [name for name in RESULTS if comparisons(CASES[name])])
def test_every_comparison_selects_stored_values(name):
    for part in comparisons(CASES[name]):
        names = [*RESULTS[name].get("pictures", {}), *(row["norm"] for row in RESULTS[name].get("norms", ()))]
        names += [
            row["quantity"]
            for row in RESULTS[name].get("rows", ())
            if re.fullmatch(part.where, row["condition"])
        ]
        assert any(re.fullmatch(part.values, one) for one in names), part


def test_missed_cases_are_hollow_and_no_more_than_the_stored_ones():
    groups = [group for groups in COLLECTED.values() for group in groups]
    assert {group.case for group in groups if not group.met} == {
        group.case for group in groups if not RESULTS[group.case]["passed"]
    }
    axis = Figure().subplots()
    trust_picture._points(axis, [points([1.0], [1.0], met=False), points([1.0], [2.0])])
    hollow, filled = axis.collections
    assert len(hollow.get_facecolors()) == 0
    assert len(filled.get_facecolors()) == 1


def test_the_page_begins_with_the_picture(tmp_path):
    (tmp_path / "plots").mkdir()
    (tmp_path / "speed.json").write_text((DOCS / "validation/speed.json").read_text(), encoding="utf-8")
    text = trust_picture.write(tmp_path, CASES, RESULTS)
    for ending in ("", "_dark"):
        assert f"plots/trust{ending}.svg" in text
        assert (tmp_path / f"plots/trust{ending}.svg").read_text(encoding="utf-8").rstrip().endswith("</svg>")
    for groups in COLLECTED.values():
        assert all(f"`{group.case}`" in text for group in groups)
    assert "`annex20` ○" in text
    page = (DOCS / "validation.md").read_text(encoding="utf-8")
    assert page.index("validation/trust.md") < page.index("\n## ")


def test_the_speed_of_a_release_is_the_best_of_its_turns(tmp_path, monkeypatch):
    make = loaded(DOCS / "validation/make.py")
    rates = iter((4.0, 2.0, 5.0, 1.0))  # of arena_3d and arena_2d, in two turns

    def output(command, folder):
        if command[0] == "git":
            return "abc 2026-01-02"
        if "-c" in command:
            return "0.3.0"
        rows = [{"case": name, "Mcell_steps_per_s": next(rates), "bandwidth": 20.0} for name in make.STEPS]
        return json.dumps(rows)

    monkeypatch.setattr(make, "SPEEDS", tmp_path / "speed.json")
    monkeypatch.setattr(make, "_output", output)
    make.speed([tmp_path], turns=2)
    (release,) = json.loads(make.SPEEDS.read_text())
    assert release["ns"] == {"arena_3d": 200.0, "arena_2d": 500.0}
    assert (release["version"], release["commit"], release["bandwidth"]) == ("0.3.0", "abc", 20.0)
