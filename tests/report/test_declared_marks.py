"""Declared source positions in a report's figures, tables and words; none without declarations."""

import made_run
import numpy as np
import pyarrow.parquet as pq
import pytest
from matplotlib.colors import to_hex

from taichi_plume.report import facts, figures, page, theme
from taichi_plume.report.page import Parts
from taichi_plume.results import tracks
from taichi_plume.results.run import Run

SAID = {
    "outcome": ["declared", "reached", "neither"], "declarations": [2, 1, 0], "false_declarations": [1, 1, 0],
    "declared_time_s": [4.0, 6.0, None], "localisation_error_m": [0.1, 0.5, None],
}  # fmt: skip


@pytest.fixture
def run(tmp_path) -> Run:
    return Run(made_run.made(tmp_path / "run"), lenient=True)


def saying(run: Run) -> list:
    """Return the tracks; the first robot declares (2, 2) falsely at 4 s and (1, 1.2) rightly at 6 s."""
    first, other = run.tracks
    t, nan = first.t, np.full(len(first.t), np.nan)
    said = (t >= 4).astype(int) + (t >= 6)
    values = {
        "declared_x": np.where(t >= 6, 1.0, np.where(t >= 4, 2.0, nan)), "declarations": said,
        "declared_y": np.where(t >= 6, 1.2, np.where(t >= 4, 2.0, nan)), "false_declarations": (said > 0).astype(int),
    }  # fmt: skip
    return [first._replace(values=first.values | values), other]


def crosses(figure) -> list[tuple[list[float], str]]:
    """Places and rims of the crosses on a figure's first axes."""
    lines = [line for line in figure.axes[0].lines if line.get_marker() == "X" and len(line.get_xdata())]
    return [([*line.get_xdata(), *line.get_ydata()], to_hex(line.get_markeredgecolor())) for line in lines]


def test_crosses_are_where_robots_said_and_red_while_they_are_wrong(run, drawn):
    picture = run.pictures.gas_slice.sel(time=slice(0, None))
    figures.mean_plume(run, picture, saying(run))
    figures.only_tracks(run, saying(run))
    assert [crosses(figure) for figure in drawn] == [[([1.0, 1.2], theme.FOUND)]] * 2
    names = [text.get_text() for text in drawn[0].legends[0].get_texts()]
    assert "declared rightly" in names
    assert "falsely" not in names
    figures.only_tracks(run, [track._replace(t=track.t[track.t < 5]) for track in saying(run)])
    assert crosses(drawn[-1]) == [([2.0, 2.0], theme.WRONG)]


def test_a_run_in_which_nobody_declares_has_none(run, drawn):
    figures.only_tracks(run, run.tracks)
    assert crosses(drawn[0]) == []
    assert "declar" not in " ".join(str(part) for part in Parts(run, False).all())


def test_tables_tell_outcomes_and_how_many_airs(run):
    (group,) = made_run.result(run.scenario)["groups"]
    share = {"mean": 1 / 3, "low": 0.06, "high": 0.79, "n": 3, "airs": 1}
    error = {"mean": 0.3, "low": None, "high": None, "n": 2, "airs": 1}
    group["summary"] |= {"declared_rate": share, "localisation_error_m": error, "false_declarations": share}
    assert not [row for row in facts.trials(group) if "declar" in row[0]]
    group["per_trial"] |= SAID
    rows = {row[0]: row[1:] for row in facts.trials(group)}
    assert rows["declared rightly"] == ("33 %", "6 to 79 %", "3 trials in one air (Wilson)")
    over = "2 trials that declared in one air"
    assert rows["from the declared place to the nearest source"] == ("0.3 m", "none: fewer than 3", over)
    assert rows["false declarations"][0] == "0.333 a trial"


def test_groups_that_share_the_arena_are_named(tmp_path):
    reported = made_run.result(made_run.scenario())
    reported["groups"][0]["shares_arena_with"] = ["others"]
    run = Run(made_run.made(tmp_path / "run", content=reported), lenient=True)
    (section,) = [one for one in Parts(run, False).all() if one.key == "trials"]
    assert "The robots of pair were in one arena with those of others" in section.lines[0]
    assert page.write(run).exists()


def test_a_table_from_before_robots_could_declare(run):
    """It says nothing of declarations, and is read as one in which there are none."""
    path = run.folder / "robots.parquet"
    table = pq.read_table(path)
    path.unlink()
    pq.write_table(table.drop_columns([name for name in tracks.MORE if name in table.column_names]), path)
    groups = [track.group for track in run.tracks]
    read = tracks.tracks(path, list({group.name: group for group in groups}.values()))
    assert [track.name for track in read] == [track.name for track in run.tracks]
    for track, whole in zip(read, run.tracks, strict=True):
        np.testing.assert_array_equal(track.values["x"], whole.values["x"])
        assert not track.values["declarations"].any()
        assert track.declared(len(track.t) - 1) is None
