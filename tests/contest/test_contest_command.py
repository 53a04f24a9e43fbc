"""`python -m taichi_plume contest`: bad input in a line, and a tiny contest that is played twice."""

from hashlib import sha256
from types import SimpleNamespace

import pandas as pd
import pytest
from scripts import refusal

from taichi_plume.cli.contest import main
from taichi_plume.contests import execution
from taichi_plume.contests.standings import MEASURES, NO_INTERVALS, Row, show_table
from taichi_plume.studies.estimates import SUCCESS
from taichi_plume.studies.intervals import estimates
from taichi_plume.studies.results import open_study
from taichi_plume.studies.study_run import Settings

UPWIND = """
import numpy as np

class Upwind:
    def act(self, robots):
        robots.turn_to(np.arctan2(-robots.wind[:, 1], -robots.wind[:, 0]))
        robots.speed[:] = 0.2
"""
BROKEN = """
class Broken:
    def act(self, robots):
        raise RuntimeError("no idea")
"""
LINE = [
    "--scenarios",
    "meandering",
    "--algorithms",
    "surge_cast",
    "--airs",
    "2",
    "--searches",
    "2",
    "--workers",
    "1",
]


@pytest.fixture
def files(tmp_path):
    for name, text in (("upwind", UPWIND), ("broken", BROKEN)):
        (tmp_path / f"{name}.py").write_text(text)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "photo.txt").write_text("mine")
    return tmp_path


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (["--scenarios", "open_3"], "scenario 'open_3': there is none of that name; did you mean open_3d?"),
        (["--algorithms", "infotax"], "did you mean infotaxis?"),
        (["--scenarios", "open_2d,"], "give names with commas between"),
        (["--entry", "upwind.py"], "look at it, then add --allow-code"),
        (["--out", "full"], "full: is not empty, and holds no contest (photo.txt); choose another --out"),
        (["--out", "upwind.py"], "upwind.py: "),
    ],
)
def test_what_is_wrong_is_reported_in_a_line(files, monkeypatch, capsys, line, expected):
    monkeypatch.chdir(files)
    assert expected in refusal(capsys, "contest", *line)


def test_a_folder_of_the_users_with_scenarios_stays_as_it_is(tmp_path, capsys):
    scenarios = tmp_path / "scenarios"
    scenarios.mkdir()
    (scenarios / "open_2d.yaml").write_text("mine")
    assert main(["--quick", "--out", str(tmp_path)]) == 2
    assert "holds no contest (scenarios)" in capsys.readouterr().err
    assert [(file.name, file.read_text()) for file in scenarios.iterdir()] == [("open_2d.yaml", "mine")]
    assert [file.name for file in tmp_path.iterdir()] == ["scenarios"]


@pytest.mark.slow
def test_a_contest_is_the_same_again_goes_on_and_bears_a_broken_algorithm(files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    own = ["--entry", "upwind.py", "--entry", "broken.py", "--allow-code"]
    assert main([*LINE, *own, "--out", "a"]) == 1  # of the broken one
    captured = capsys.readouterr()
    expected = [line for line in captured.err.splitlines() if line.startswith("meandering: broken")]
    assert len(expected) == 1
    assert "2 of 2 runs have failed" in expected[0]
    assert "no idea" in expected[0]
    assert "surge_cast" in captured.out
    assert NO_INTERVALS in captured.out

    table = pd.read_csv("a/contest.csv").set_index("algorithm")
    assert table.loc["broken", ["failed", "searches"]].tolist() == [2, 0]
    trials = open_study("a/meandering").trials()
    for name in ("surge_cast", "upwind"):
        mine = trials[trials["algorithm"] == name]
        assert table.loc[name, "searches"] == len(mine) == 4
        assert table.loc[name, "success"] == pytest.approx(mine["success"].mean(), rel=1e-5)
        assert table.loc[name, "airs"] == 2
        assert table.loc[name, ["success_low", "success_high", "time_with_failures_s_low"]].isna().all()
        assert "at least 3 airs, there are 2" in table.loc[name, "success_words"]
        shares = table.loc[name, ["declared", "reached", "neither"]]
        assert shares.sum() == pytest.approx(1)

    page = (files / "a" / "contest.html").read_text()
    assert "default-src 'none'" in page
    assert NO_INTERVALS in page
    assert f"taichi-plume contest {' '.join([*LINE, *own])} --out a" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    assert page.count("data:image/png;base64,") == 2

    before = (files / "a" / "contest.csv").read_bytes()
    part = sorted((files / "a" / "meandering" / "parts").iterdir())[0]
    part.unlink()  # as if it had been killed before
    assert main([*LINE, *own, "--out", "a", "--quiet"]) == 1
    assert (files / "a" / "contest.csv").read_bytes() == before

    assert main([*LINE, "--entry", "upwind.py", "--allow-code", "--out", "b", "--quiet"]) == 0
    again = (files / "b" / "contest.csv").read_bytes()
    assert again.splitlines() == [line for line in before.splitlines() if b"broken" not in line]


@pytest.mark.parametrize("airs", [1, 2, 3, 8])
def test_a_table_without_intervals_says_why(airs, capsys):
    found = dict.fromkeys([measure.name for measure in MEASURES])
    success = estimates([1.0, 0.0] * airs, ["a"] * 2 * airs, [*range(airs)] * 2, [True] * 2 * airs, True)["a"]
    row = Row("open_2d", "a", 1, 2 * airs, 0, 0, "", 2 * airs, found | {SUCCESS.name: success})
    show_table([row])
    printed = capsys.readouterr().out
    assert (NO_INTERVALS in printed) == (airs < 3)
    assert ("(" in SUCCESS.cell(success)) == (airs >= 3)


@pytest.mark.parametrize("answer", [True, False])
def test_a_contest_executes_the_code_that_was_asked_about(files, monkeypatch, answer):
    """The file changes right after the answer, or after the option --allow-code was read."""
    monkeypatch.chdir(files)

    def asked(path, digest):
        (files / "upwind.py").write_text("raise SystemExit('I ran')\n" + UPWIND)
        return True

    monkeypatch.setattr(execution, "has_permission", asked)
    settings = []
    monkeypatch.setattr(
        execution, "execute", lambda plan, of: settings.append(of) or SimpleNamespace(status="")
    )
    given = {"files": ["upwind.py"], "scenarios": ["meandering"], "allow_code": not answer}
    contest = execution.contest_of(execution.Choice(["surge_cast"], out=files / "a", **given))
    list(execution.play(contest, Settings(files / "a", 1, progress=False)))
    digest = sha256(UPWIND.encode()).hexdigest()
    assert [of.allow_code for of in settings] == [(digest,)]


def test_measures_have_names_of_their_own():
    assert len({one.name for one in MEASURES}) == len(MEASURES)
