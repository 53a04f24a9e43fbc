"""Plumes as files of points: what is read of them, and what is said of bad ones."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.files import manifest
from taichi_plume.files.plumesim_log import read_log
from taichi_plume.files.point_frames import PointFileError, read_fluent
from taichi_plume.scenario.loading import ScenarioError

LOG = """500,3,0.1
+1 2
0.1,0.2,0,0.5,0,12.5
0.2,0.2,0,0.25,1.5707963,100
+2 0
+7 1
0.3,0.4,0,1e-1,-0.5,0
"""
PLAY = """
duration: 2
domain: {size: [0.6, 0.5], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0]}
gas: {kind: plumesim_log, file: plume.pslog}
"""
FLUENT = "nodenumber, x-coordinate, y-coordinate, acetone\n1,0.1,0.2,0.02\n2,0.2,0.2,0.08\n"


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "plume.pslog").write_text(LOG)
    (tmp_path / "play.yaml").write_text(PLAY)
    (tmp_path / "plume001.txt").write_text(FLUENT)
    (tmp_path / "plume002.txt").write_text("titles\n1,0.3,0.1,0.04\n")
    return tmp_path


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_what_a_log_says_is_read(tmp_path, ending):
    path = tmp_path / "plume.pslog"
    path.write_bytes(LOG.replace("\n", ending).encode() + b"\n \n")
    frames = read_log(path)
    assert (len(frames), frames.period, frames.cell) == (3, 0.5, 0.1)
    np.testing.assert_array_equal(frames.begin, [0, 2, 2, 3])
    np.testing.assert_array_equal(frames.place, [[0.1, 0.2], [0.2, 0.2], [0.3, 0.4]])
    np.testing.assert_array_equal(frames.percent, [12.5, 100, 0])
    np.testing.assert_allclose(frames.wind[:2], [[0.5, 0], [0, 0.25]], atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(frames.wind[2]), 0.1)


def replaced(line: int, text: str) -> str:
    lines: list[str] = list(LOG.splitlines())
    lines[line - 1] = text
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("", "is empty"),
        (" \n\n", "is empty"),
        ("500,3\n", "line 1: must be period_ms"),
        (replaced(1, "500,3,0.1,7"), "line 1: must be period_ms"),
        (replaced(1, "0,3,0.1"), "line 1: the period must be above 0, got 0"),
        (replaced(1, "500,0,0.1"), "line 1: the number of frames must be above 0"),
        (replaced(1, "500,3,nan"), "line 1: the cell size must be above 0, got nan"),
        (replaced(1, "500,3,inf"), "line 1: the cell size must be above 0, got inf"),
        (replaced(1, "500,999999999,0.1"), "line 1: 999999999 frames are more than"),
        (replaced(1, "500,4,0.1"), "ends after 3 of 4 frames, at line 7"),
        (replaced(1, "500,2,0.1"), "line 6: must be the end after 2 frames, got '+7 1'"),
        (replaced(2, "+1 3"), "line 5: frame +1 ends here, with 2 of 3 points, by '+2 0'"),
        (replaced(2, "+1 1"), "line 4: must begin frame 2 with '+number points'"),
        (replaced(2, "+1 many"), "line 2: must begin frame 1"),
        (replaced(3, "0.1,0.2,0,0.5,0"), "line 3: must be x,y,z,wind speed,wind direction,chemical"),
        (replaced(4, "0.1,0.2,0,0.5,0,1,1"), "line 4: must be x,y,z"),
        (replaced(4, "0.1,0.2,0,0.5,zero,1"), "line 4: must be x,y,z"),
        (replaced(4, ""), "line 4: must be x,y,z"),
        (replaced(4, "0.1,0.2,0,0.5,nan,1"), "line 4: must be finite"),
        (replaced(7, "0.1,1e400,0,0.5,0,1"), "line 7: must be finite"),
        (replaced(7, "0.1,-1e9,0,0.5,0,1"), "line 7: y must be within 100000 m"),
        (replaced(7, "0.3,0.4,0,0.1,0,-1"), "line 7: chemical must be not negative, got -1"),
        (replaced(7, "0.3,0.4,0,0.1,0,1e300"), "line 7: chemical must be at most 1e+06, got 1e+300"),
        (replaced(7, "0.3,0.4,0,1e5,0,1"), "line 7: wind speed must be at most 1000, got 100000"),
        (replaced(7, "0.3,0.4,0,-0.1,0,1"), "line 7: wind speed must be not negative"),
        (replaced(7, "0.3,0.4,0.5,0.1,0,1"), "line 7: z = 0.5, others 0; a log is of one height"),
        (replaced(6, "+2 1"), "line 6: frame +2 comes after +2; numbers of frames must ascend"),
        (replaced(6, "+7 5"), "ends at line 7, with 1 of the 5 points of frame +7"),
        ("500,1,0.1\n+1 0\n", "holds no points"),
    ],
)
def test_bad_logs_are_reported_in_one_line_before_anything_runs(folder, content, fault):
    path = folder / "plume.pslog"
    path.write_text(content)
    with pytest.raises(PointFileError) as caught:
        read_log(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert fault in str(caught.value)
    with pytest.raises(ScenarioError) as checked:
        load_scenario(folder / "play.yaml")
    assert len(checked.value.lines) == 1
    assert f"gas.file: {caught.value}" in checked.value.lines[0]


def test_a_log_that_is_not_as_its_run_left_it_is_refused(folder):
    path = folder / "plume.pslog"
    manifest.write(folder, {}, [path])
    assert len(read_log(path)) == 3
    path.write_text(LOG.replace("12.5", "13.5"))
    with pytest.raises(PointFileError, match="has changed since its run"):
        read_log(path)


GOOD = (
    "\n".join(["200,8,0.1", *(f"+{n} 9\n" + 9 * f"0.{n},0.2,0,0.5,0.1,7.{n}\n" for n in range(8))])
).replace("\n\n", "\n")


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    cut=st.integers(0, len(GOOD)),
    changes=st.lists(
        st.tuples(st.integers(0, len(GOOD) - 1), st.sampled_from(b"0123456789+-.,eE \n\tnaif\x00\xff_#")),
        max_size=3,
    ),
)
def test_damaged_logs_load_or_are_reported_in_one_line(tmp_path, cut, changes):
    content = bytearray(GOOD.encode())
    for place, byte in changes:
        content[place] = byte
    path = tmp_path / "plume.pslog"
    path.write_bytes(content[:cut] if cut % 3 else content)
    frames, fault = None, f"{path}: "
    try:
        frames = read_log(path)
    except PointFileError as error:
        fault = str(error)
    assert fault.startswith(f"{path}: ")
    assert "\n" not in fault
    if frames is None:
        return
    assert frames.begin[-1] == len(frames.place) == len(frames.wind) == len(frames.percent)
    for values in (frames.place, frames.wind, frames.percent):
        assert np.isfinite(values).all()
    assert (frames.percent >= 0).all()


# ---------------------------------------------------------------- Fluent


def test_fluent_frames_are_numbered_files_in_percent_of_the_largest(folder):
    frames = read_fluent(folder / "plume%03d.txt", None, 2.0, 0.1, None)
    assert (len(frames), frames.period, frames.cell) == (2, 2.0, 0.1)
    np.testing.assert_array_equal(frames.begin, [0, 2, 3])
    np.testing.assert_allclose(frames.percent, [25, 100, 50])
    np.testing.assert_array_equal(frames.place[2], [0.3, 0.1])
    given_scale = read_fluent(folder / "plume%03d.txt", 1, 2.0, 0.1, 0.4)
    np.testing.assert_allclose(given_scale.percent, [5, 20])


def test_titles_of_fluent_say_where_columns_stand_and_their_unit(tmp_path):
    place, values = np.array([[100.0, 2000.0], [300.0, -50.0]]), [0.2, -0.01]
    lines = [f"{n},{v},{y},0.5,{x}" for n, (v, (x, y)) in enumerate(zip(values, place, strict=True))]
    titles = "nodenumber, c2h5oh, y-coordinate (mm), z-coordinate (mm), x-coordinate (mm)"
    (tmp_path / "p1.txt").write_text("\n".join([titles, *lines, ""]))
    frames = read_fluent(tmp_path / "p%d.txt", None, 1.0, 0.1, None)
    np.testing.assert_allclose(frames.place, 1e-3 * place)
    np.testing.assert_allclose(frames.percent, [100.0, 0.0])
    assert "gas of column c2h5oh, x in mm, y in mm" in frames.facts.text
    assert frames.facts.remarks == ("p1.txt: 1 concentrations below 0 count as 0",)
    several = "x-coordinate (cm),y-coordinate (mm),molef_a,molef_b,pressure\n100,2000,5,7,1e5\n"
    (tmp_path / "p1.txt").write_text(several)
    with pytest.raises(PointFileError, match="several columns that may be the gas, molef_a, molef_b"):
        read_fluent(tmp_path / "p%d.txt", None, 1.0, 0.1, None)
    frames = read_fluent(tmp_path / "p%d.txt", None, 1.0, 0.1, 14.0, {"chemical": "molef_b"})
    np.testing.assert_allclose(frames.place, [[1.0, 2.0]])
    np.testing.assert_allclose(frames.percent, [50.0])
    (tmp_path / "p1.txt").write_text("1,0.5,0.25,3\n2,0.75,0.25,6\n")  # without a line of titles
    np.testing.assert_allclose(read_fluent(tmp_path / "p%d.txt", None, 1.0, 0.1, None).percent, [50.0, 100.0])
    (tmp_path / "p1.txt").write_text(titles.replace("mm", "s") + "\n1,2,3,4,5\n")
    with pytest.raises(PointFileError, match=r"line 1: .*'s' is no unit that converts to m"):
        read_fluent(tmp_path / "p%d.txt", None, 1.0, 0.1, None)


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ("files: plume%03d.txt, frames: 3", "plume003.txt: does not exist; files are numbered from 1"),
        ("files: smoke%03d.txt", "smoke001.txt: does not exist"),
        ("files: bad%d.txt", "bad1.txt: line 3: must be index,x,y,chemical, got '2,0.1'"),
        ("files: gap%d.txt", "gap2.txt: does not exist, but gap3.txt does"),
        ("files: empty%d.txt", "empty1.txt: holds no points"),
        ("files: plume.txt", "gas.files: must hold one number"),
        ("files: plume%03d.txt, largest: 1e-9", "line 2: chemical must be at most 1e-05, got 0.02"),
        (f"files: {'long' * 99}%d.txt", "longlong1.txt: does not exist"),
        ("files: plume%s%d.txt", "gas.files: must hold one number"),
        ("files: plume%9999999999d.txt", "gas.files: must hold one number"),
        ("files: plume%03d.txt, offset: [3, 0]", "no point of"),
        ("files: plume%03d.txt, start: 2", "gas.start: 2 s is after"),
    ],
)
def test_bad_exports_are_reported(folder, keys, fault):
    (folder / "bad1.txt").write_text("titles\n1,0.1,0.1,0.1\n2,0.1\n")
    (folder / "gap1.txt").write_text(FLUENT)
    (folder / "gap3.txt").write_text(FLUENT)
    (folder / "empty1.txt").write_text("titles\n")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(folder / "play.yaml", [f"gas={{kind: fluent, {keys}}}"])
    assert len(caught.value.lines) == 1
    assert fault in caught.value.lines[0]


GAUSSIAN = "gas={kind: plumesim_gaussian, release_point: "


@pytest.mark.parametrize(
    ("overrides", "fault"),
    [
        (["gas={kind: eulerian, sources: [{position: [0.3, 0.2], rate: 1e-6}]}"], "gas.kind: a wind of kind"),
        (["fields={}"], "fields.quantities: a wind of kind plumesim_log"),
        (["plumesim_log={rate: 3}"], "plumesim_log.rate: 3 frames per second"),
        (["tick=0.0125", "plumesim_log={rate: 80}"], "must be whole milliseconds"),
        (["plumesim_log={cell: 0.0001}"], "plumesim_log.cell: 0.0001 m makes"),
        (["plumesim_log={cell: 0.6}"], "plumesim_log.cell: 0.6 m is wider than the domain"),
        ([GAUSSIAN + "[0, 0], cell: 1e-5}"], "gas.cell: 1e-05 m makes"),
        ([GAUSSIAN + "[0, 0], cell: 1e4}"], "gas.cell: 10000 m is wider"),
        (["plumesim_log={start: 5}"], "plumesim_log.start: 5 s is after the end of the run"),
        (["gas.start=1.5"], "gas.start: 1.5 s is after"),
        (["gas.offset=[-2, 0]"], "no point of"),
        ([GAUSSIAN + "[1, 0.2]}"], "gas.release_point: x = 1 m is outside"),
        (["gas={kind: plumesim_meandering, release_point: [0.55, 0.2]}"], "gas.release_point: x = 0.55 m"),
        ([GAUSSIAN + "[0, 0], last: 3}"], "gas: repeat_from must not be"),
    ],
)
def test_what_does_not_go_together_is_reported(folder, overrides, fault):
    wind = "wind={kind: plumesim_log, file: plume.pslog}"
    with pytest.raises(ScenarioError) as caught:
        load_scenario(folder / "play.yaml", [wind, *overrides])
    assert len(caught.value.lines) == 1
    assert fault in caught.value.lines[0]
