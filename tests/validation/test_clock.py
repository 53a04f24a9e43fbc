import json

import pytest

from taichi_plume.validation.benchmark import clock, openfoam
from taichi_plume.validation.benchmark.__main__ import main
from taichi_plume.validation.benchmark.clock import Row, Timing

FIGURES = {
    "old": [{"s/s": 2.0, "CPU s/s": 1.5}, {"s/s": 1.8, "CPU s/s": 1.6}],
    "new": [{"s/s": 0.6, "CPU s/s": 0.3}] * 2,
}


@pytest.fixture
def rows(monkeypatch):
    """Rows that take no time: one with what another program needs, one that cannot be measured."""
    reported = {name: iter(figures) for name, figures in FIGURES.items()}

    def look_up(name, checkout, args):
        return dict(next(reported[checkout.name]))

    def fail(name, checkout, args):
        raise RuntimeError("exit code 1: no room left")

    made = {
        "room": Row("a room", "s/s", look_up, 10.0, 15.0, "x OpenFOAM", lambda args: {"x OpenFOAM": 9.0}),
        "broken": Row("a row that fails", "s", fail, 2.0, 1.0, "s"),
    }
    monkeypatch.setattr(clock, "ROWS", made)


def test_a_misspelt_row_is_reported(capsys):
    assert main(["clock", "arena_3D"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("unknown row 'arena_3D'; known: arena_3d, ")


@pytest.mark.parametrize(
    ("unit", "value", "verdict"),
    [
        ("s/s", 0.1, "aim reached"),
        ("s/s", 0.4, "enough"),
        ("s/s", 0.9, "1.8 times too slow"),
        ("M cell-steps/s", 0.7, "aim reached"),
        ("M cell-steps/s", 0.25, "2.0 times too slow"),
        ("x jax-cfd", None, ""),
    ],
)
def test_of_costs_less_is_better_and_of_rates_more(unit, value, verdict):
    least, aim = (0.5, 0.2) if unit == "s/s" else (0.5, 0.6)
    figures = {"ms": 3.0} | ({} if value is None else {unit: value})
    found = Timing("row", "here", "ms", figures, unit, least, aim)
    assert found.verdict == verdict
    assert verdict in str(found)
    assert ("<= 0.5, aim 0.2 s/s" in str(found)) == (unit == "s/s")


def test_checkouts_are_measured_in_turns_and_compared(rows, tmp_path, capsys):
    folders = [str(tmp_path / name) for name in FIGURES]
    assert main(["clock", "room", "--repeats", "2", "--checkout", *folders]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines[1:5]] == ["old", "new", "old", "new"]
    assert "4.5 x OpenFOAM, 9 s/s of OpenFOAM" in lines[1]
    assert "2.2 times too slow" in lines[1]
    assert "aim reached" in lines[2]
    assert lines[5].endswith(
        "new is 3.00 times as fast as old, with 0.20 of its CPU time"
    )  # the best of each


def test_a_row_that_fails_is_reported_and_the_others_go_on(rows, tmp_path, capsys):
    assert main(["clock", "broken", "room", "--checkout", str(tmp_path / "new"), "--json"]) == 1
    shown = capsys.readouterr()
    (row,) = json.loads(shown.out)
    assert (row["row"], row["verdict"]) == ("room", "aim reached")
    assert row["figures"]["x OpenFOAM"] == pytest.approx(15.0)
    assert shown.err == "broken: exit code 1: no room left\n"


def test_other_programs_that_are_not_there(tmp_path):
    args = clock._arguments([])
    assert clock._jax_box(16, 2, args) == {}
    assert clock._openfoam(0.05, 2, args) == {}
    args = clock._arguments(["--openfoam-seconds", "3", "1.5", "130", "40"])
    times = [clock._openfoam(dx, 2, args) for dx in clock.SPACINGS]
    assert times == [{clock.FOAM: 3.0, clock.EMPTY: 1.5}, {clock.FOAM: 130.0, clock.EMPTY: 40.0}]
    with pytest.raises(RuntimeError, match="OpenFOAM made 0 of 11 steps"):
        openfoam.arena(0.25, 1, True, str(tmp_path / "no_bashrc"))


@pytest.mark.parametrize("obstacles", [False, True])
def test_the_case_of_openfoam_closes_what_it_opens(obstacles):
    files = openfoam._files(0.25, obstacles)
    assert "(16 12 2)" in files["system/blockMeshDict"]
    assert "deltaT 0.2; adjustTimeStep yes; maxCo 0.8;" in files["system/controlDict"]
    for text in files.values():
        assert text.count("{") == text.count("}") > 0
        assert text.count("(") == text.count(")")


@pytest.mark.slow
def test_a_row_is_measured_in_a_process_of_its_own(capsys):
    assert main(["clock", "robots", "--robots", "300", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    figures = row["figures"]
    parts = figures["measure ms"] + figures["act ms"] + figures["move ms"]
    assert figures["M robot-steps/s"] == pytest.approx(0.3 / parts, rel=1e-6)
    assert figures["triad GB/s"] > 0.1
