import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from taichi_plume.validation import report
from taichi_plume.validation.__main__ import main
from taichi_plume.validation.case import Answer, Case, Curve, Expected
from taichi_plume.validation.cases import CASES
from taichi_plume.validation.experiment import Condition, Experiment, Mean, Plume, Range, Tracks
from taichi_plume.validation.report import plain

pytestmark = pytest.mark.slow


def unsolvable(n: int) -> dict[str, float]:
    raise RuntimeError("no steady state")


def parabola(n: int) -> Answer:
    x = np.linspace(0.0, 1.0, n)
    return {"u": n**-2.0, "parabola": Curve("x [m]", "u <v>", x, x * (1 - x), x * (1 - x) + n**-2.0)}


GOOD = Case(
    "good", "n^-2", "closed form", parabola, (8,), (8, 16), {"u": Expected(order=1.9)}, evidence="exact"
)
BAD = replace(GOOD, name="bad", expected={"u": Expected(tolerance=1e-9)})
BROKEN = replace(GOOD, name="broken", solve=unsolvable)


def walk(trials: int) -> dict[str, Mean | Tracks]:
    way = np.array([[1.0, 1.0], [2.0, 0.5]])
    return {
        "success": Mean(0.9, 0.8, 0.95, trials),
        "time [s]": Mean(None, None, None, 0),
        "ways <here>": Tracks((4.0, 3.0), (0.1, 1.5), (way,)),
    }


STROLL = Experiment(
    "stroll",
    "a made-up search",
    "none",
    (Condition("a < b", walk, published={"time [s]": "35 s"}, expected={"success": Range(least=0.8)}),),
    evidence="measured",
    trials=50,
)


@pytest.fixture
def table(monkeypatch):
    """Three cases that take no time."""
    cases = {case.name: case for case in (BROKEN, BAD, GOOD)}
    monkeypatch.setattr("taichi_plume.validation.cases.CASES", cases)


def test_a_misspelt_case_is_reported(capsys):
    assert main(["taylor_gren_2d"]) == 2
    assert "did you mean 'taylor_green_2d'?" in capsys.readouterr().err


def test_the_list_names_every_case(capsys):
    assert main(["--list"]) == 0
    shown = capsys.readouterr().out
    listed = {line.split()[0]: line.split()[1] for line in shown.splitlines()}
    assert listed == {name: case.evidence for name, case in CASES.items()}


def test_named_cases_are_solved_and_reported_with_their_curves(table, idle, tmp_path, capsys):
    assert main(["good", "--out", str(tmp_path / "new"), "--json"]) == 0
    report = json.loads((tmp_path / "new" / "report.json").read_text())
    assert json.loads(capsys.readouterr().out) == report
    assert report["passed"] is True
    (case,) = report["cases"]
    (row,) = case["norms"]
    assert (case["name"], case["evidence"]) == ("good", "exact")
    assert row["errors"] == {"8": 8**-2.0, "16": 16**-2.0}
    assert row["order"] == pytest.approx(2.0)
    curve = case["pictures"]["parabola"]
    x = np.array(curve["x"])
    assert curve["kind"] == "curve"
    assert curve["computed"] == pytest.approx(x * (1 - x), abs=2e-4)
    assert curve["reference"] == pytest.approx(x * (1 - x) + 16**-2.0, abs=2e-4)


def test_pictures_are_thinned_and_rounded_for_json():
    way = np.column_stack([np.linspace(0.0, 3.14159, 1000), np.full(1000, np.nan)])
    (reported,) = plain({"ways": Tracks((4.0, 3.0), (0.1, 1.5), (way,))}).values()
    (points,) = reported["ways"]
    assert len(points) <= 80
    assert points[0] == [0.0, None]
    assert points[-1] == [3.142, None]


def test_a_picture_of_a_plume_keeps_its_columns_and_rows():
    ppm = np.arange(6.0).reshape(3, 2)
    plume = Plume((3.0, 2.0), (0.1, 1.5), np.array([[1.0, 0.5]]), ppm)
    (reported,) = plain({"plume": plume}).values()
    assert reported["kind"] == "plume"
    assert (reported["ppm"], reported["nodes"]) == (ppm.tolist(), [[1.0, 0.5]])


def test_a_column_is_as_good_as_a_row_in_json():
    x = np.linspace(0.0, 1.0, 5)
    (reported,) = plain({"c": Curve("x", "c", x, x[:, None], x[:, None])}).values()
    assert reported["computed"] == reported["x"] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert "fit" not in reported


def test_a_law_that_was_fitted_is_drawn_and_kept(drawn):
    x = np.linspace(1.0, 2.0, 3)
    curves = [Curve("x", "c", x, x, x, fit=fit) for fit in (None, 2.0 * x)]
    assert plain({"c": curves[1]})["c"]["fit"] == [2.0, 3.0, 4.0]
    case = {"name": "c", "norms": []}
    for curve in curves:
        report._picture(case, {"c": curve})
    assert [[len(axes.lines) for axes in figure.axes] for figure in drawn] == [[2], [3]]


def test_the_page_shows_norms_curves_and_faults(table, idle, tmp_path, drawn):
    main(["--out", str(tmp_path)])
    page = (tmp_path / "report.html").read_text()
    ElementTree.fromstring(re.sub(r"<!DOCTYPE html>|<meta [^>]*>|<img [^>]*>", "", page))
    assert "RuntimeError: no steady state" in page
    assert "1.56e-02" in page  # 8^-2
    assert page.count("data:image/png;base64,") == len(drawn) == 2  # of the two cases that were solved
    assert any("parabola" in [axes.get_title("left") for axes in figure.axes] for figure in drawn)


def test_a_failure_is_reported_and_the_others_go_on(table, capsys):
    assert main([]) == 1
    shown = capsys.readouterr().out
    assert "NOT MET" in shown
    assert "not met: broken, bad" in shown
    assert "no steady" in shown


@pytest.fixture
def experiments(monkeypatch, idle):
    monkeypatch.setattr("taichi_plume.validation.cases.CASES", {"stroll": STROLL})


@pytest.mark.parametrize(("option", "trials"), [((), 50), (("--trials", "7"), 7)])
def test_an_experiment_is_reported(experiments, tmp_path, capsys, drawn, option, trials):
    assert main(["--out", str(tmp_path), *option]) == 0
    shown = capsys.readouterr().out
    assert "measured: a made-up search (none)" in shown
    assert "0.9 (0.8 to 0.95)" in shown
    (case,) = json.loads((tmp_path / "report.json").read_text())["cases"]
    success, time = case["rows"]
    reported = {
        "condition": "a < b",
        "quantity": "success",
        "published": "",
        "expected": ">= 0.8",
        "met": True,
    }
    assert success == reported | {"mean": 0.9, "low": 0.8, "high": 0.95, "n": trials, "airs": None}
    assert (time["mean"], time["published"], time["met"]) == (None, "35 s", None)
    page = (tmp_path / "report.html").read_text()
    assert "a &lt; b" in page
    assert page.count(">measured</span>") == 3  # the legend, the index and the case
    assert page.count(">exact</span>") == 1
    assert page.count("data:image/png;base64,") == 1
    assert [axes.get_title("left") for axes in drawn[0].axes] == ["ways <here>"]
