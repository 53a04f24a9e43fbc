"""The command that makes maps of recorded readings: what it refuses, helps with, and writes where."""

import json
import struct

import numpy as np
import pytest
from readings_log import log
from scripts import refusal

from taichi_plume.cli import maps
from taichi_plume.files.readings import read
from taichi_plume.results.recorded_maps import map_of
from taichi_plume.scenario.maps import TimeSeriesMap

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

GOOD = "t,x,y,reading\n1,0,0,2\n"


@pytest.mark.parametrize(
    ("text", "options", "reported"),
    [
        (None, [], "cannot be read"),
        ("t,x,y,reading\n1,0,0,nan\n2,0,0,\n", [], "none of the 2 readings is a number"),
        (GOOD, ["--map={kind: time_series, alpha: 2}"], "--map.alpha: got 2: must be less than 1"),
        (GOOD, ["--map={kind: time_series, alfa: 2}"], "--map: unknown key 'alfa'; did you mean 'alpha'?"),
        (GOOD, ["--map={alpha: 0.9}"], "--map: missing key 'kind'; known kinds: time_series, inverse"),
        (GOOD, ["--map={kind: gmrf"], "--map: line 1, column 12: not YAML: expected ',' or '}'"),
        (GOOD, ["--map", "nose"], "--map: unknown kind 'nose'; known kinds: time_series, inverse_distance"),
        (GOOD, ["--alpha", "2"], "unexpected '--alpha'; did you mean '--map'? options: --help, --map"),
        (GOOD, ["--map", "gmrf", "b.csv"], "unexpected 'b.csv'"),
        (GOOD, ["--size", "0", "2"], "--size[0]: got 0 m; at least 1e-06 m"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_reported_in_one_line(text, options, reported, tmp_path, capsys):
    path = tmp_path / "a.csv"
    if text is not None:
        path.write_text(text)
    line = ["maps", str(path), "--size", "2", "1", "--out", str(tmp_path / "out"), *options]
    assert reported in refusal(capsys, *line)
    assert not (tmp_path / "out").exists()


def test_help_tells_the_kinds(capsys):
    with pytest.raises(SystemExit) as caught:
        maps.main(["--help"])
    assert caught.value.code == 0
    reported = capsys.readouterr().out
    kinds = ("time_series", "inverse_distance", "kernel_dmv", "gmrf")
    assert all(f"\n  {kind} " in reported for kind in kinds)
    assert "Gaussian Markov random field, cut by obstacles" in " ".join(reported.split())


def test_options_may_come_first(tmp_path):
    path = log(tmp_path / "a.csv", [(k, 0.1 * k, 0.5, 5.0) for k in range(10)])
    out = ["--size", "1", "1", "--out", str(tmp_path / "out")]
    assert maps.main(["--map={kind: time_series, raw_samples: true, alpha: 0.98}", str(path), *out]) == 0
    rows = np.genfromtxt(tmp_path / "out" / "map.csv", delimiter=",", names=True)
    model = TimeSeriesMap(kind="time_series", alpha=0.98, raw_samples=True)
    expected = map_of(read(path), model, (1.0, 1.0)).weight
    np.testing.assert_allclose(rows["weight"], expected.ravel(), rtol=1e-5)


def test_what_lies_in_the_folder_is_kept_unless_by_force(tmp_path, capsys):
    path = log(tmp_path / "a.csv", [(1, 0.5, 0.5, 5.0), (9, 0.5, 0.5, 5.0)])
    out = tmp_path / "out"
    command = [str(path), "--size", "1", "1", "--out", str(out)]
    coarse = ["--map", "{kind: time_series, cell: 0.5}"]
    assert maps.main(command) == 0
    before = (out / "map.csv").read_bytes()
    assert maps.main([*command, *coarse]) == 2
    assert "is not empty; choose another --out or add --force" in capsys.readouterr().err
    assert (out / "map.csv").read_bytes() == before
    assert maps.main([*command, *coarse, "--force"]) == 0
    assert (out / "map.csv").read_bytes() != before
    assert (tmp_path / "out.old" / "map.csv").read_bytes() == before
    for wrong in (path, path / "out"):
        error = refusal(capsys, "maps", "missing.csv", "--size", "1", "1", "--out", str(wrong))
        assert error.startswith(str(path))
        assert "missing.csv" not in error, "the folder is looked at first"


def test_readings_that_are_too_old_make_an_empty_map(tmp_path, capsys):
    path = log(tmp_path / "a.csv", [(1, 0.5, 0.5, 5.0), (99, 0.5, 0.5, "nan")])
    out = ["--size", "1", "1", "--out", str(tmp_path / "out")]
    assert maps.main(["--map={kind: gmrf, memory: 60}", str(path), *out]) == 0
    assert "\nthe map is empty" in capsys.readouterr().out
    scores = json.loads((tmp_path / "out" / "scores.json").read_text())
    assert (scores["known_fraction"], scores["peak"]["ppm"], scores["nlpd"]) == (0.0, None, None)


def test_a_picture_of_a_long_floor_is_no_larger(tmp_path):
    path = log(tmp_path / "a.csv", [(1, 0.5, 0.5, 5.0), (9, 0.5, 0.5, 5.0)])
    out = tmp_path / "out"
    options = ["--size", "2", "3000", "--map={kind: time_series, cell: 1}", "--out", str(out)]
    assert maps.main([str(path), *options]) == 0
    width, height = struct.unpack(">2I", (out / "map.png").read_bytes()[16:24])
    assert max(width, height) < 4000
