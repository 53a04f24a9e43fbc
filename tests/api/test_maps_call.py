"""tp.maps: the files and values of the command, maps of runs and tables, and errors before anything is written."""

import json
from pathlib import Path

import numpy as np
import pandas
import pytest

import taichi_plume as tp
from taichi_plume.cli import maps as command
from taichi_plume.report.theme import png, styled

pytestmark = pytest.mark.usefixtures("taichi")

FILES = {"map.csv", "map.png", "scores.json"}
KERNEL = {"kind": "kernel_dmv", "cell": "20 cm", "memory": "8 s"}
MAPPED = {
    "name": "mapped", "seed": 3, "duration": 12, "domain": {"size": [2, 1.5], "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [0.4, 0]},
    "gas": {
        "kind": "gaussian_plume", "intensity": 0.1,
        "sources": [{"position": [0.3, 0.7], "rate": "10 mg/s", "radius": 0.05}],
    },
    "robots": [
        {
            "name": "walkers", "count": 2, "trials": 2, "reach": 0, "algorithm": {"kind": "random_walk"},
            "start": {"kind": "area", "low": [0.4, 0.4], "high": [1.6, 1.1]},
        }
    ],
    "maps": [KERNEL],
}  # fmt: skip


@pytest.fixture(scope="module")
def run(taichi, tmp_path_factory) -> tp.Run:
    return tp.simulate(MAPPED, out=tmp_path_factory.mktemp("runs") / "mapped", progress=False)


@pytest.fixture
def log(tmp_path) -> Path:
    rng = np.random.default_rng(2)
    rows = np.column_stack([np.arange(30) / 2, rng.uniform(1, [3, 2], (30, 2)), rng.uniform(0, 9, 30)])
    np.savetxt(tmp_path / "log.csv", rows, "%.4f", ",", header="t,x,y,reading", comments="")
    return tmp_path / "log.csv"


def contents(folder: Path) -> dict[str, bytes]:
    files = {file.name: file.read_bytes() for file in folder.iterdir() if file.name in FILES}
    assert files.keys() == FILES
    return files


@pytest.mark.slow
def test_the_files_are_those_of_the_command(log, tmp_path, capsys):
    options = [
        "--map={kind: kernel_dmv, cell: 20 cm, memory: 8 s}",
        "--size",
        "2 m",
        "1",
        "--origin",
        "1",
        "1",
    ]
    line = [str(log), *options, "--source", "2", "150 cm", "--out", str(tmp_path / "command")]
    assert command.main(line) == 0
    facts, *printed = capsys.readouterr().out.splitlines()
    assert facts.startswith(f"{log}: ")
    gas_map = tp.maps(
        log, KERNEL, size=(2, "100 cm"), origin=(1, 1), sources=[(2, "1.5 m")], out=tmp_path / "call"
    )
    assert contents(tmp_path / "call") == contents(tmp_path / "command")
    gas_map.write(str(tmp_path / "method"))
    assert contents(tmp_path / "method") == contents(tmp_path / "command")
    assert repr(gas_map).splitlines() == printed[:2]
    with styled():
        assert png(gas_map.plot()) == contents(tmp_path / "command")["map.png"]
    html = gas_map._repr_html_()
    assert printed[0] in html
    assert "data:image/png;base64," in html


@pytest.mark.slow
def test_a_map_of_a_run_is_the_map_that_its_robots_made(run):
    """On the floor of the scenario; its source is known."""
    (online,) = run.maps
    gas_map = tp.maps(run, KERNEL, trial=1)
    for name in ("estimate", "variance", "weight"):
        np.testing.assert_array_equal(np.float32(gas_map.data[name]), online[name].isel(trial=1))
        for key in ("units", "long_name"):
            assert gas_map.data[name].attrs[key] == online[name].attrs[key]
    assert gas_map.data.attrs["memory"] == 8.0
    assert gas_map.data.estimate.dims == ("y", "x")
    best = gas_map.data.estimate.where(lambda values: values == values.max(), drop=True)
    away = float(np.hypot(best.x[0] - 0.3, best.y[0] - 0.7))
    assert gas_map.scores["peak"]["to_source_m"] == pytest.approx(away)


@pytest.mark.slow
def test_folders_and_tables_of_runs_are_read_alike(run, tmp_path):
    expected = tp.maps(run, "inverse_distance", out=tmp_path / "run")
    tp.maps(str(run.folder), "{kind: inverse_distance}", out=tmp_path / "folder")
    assert contents(tmp_path / "folder") == contents(tmp_path / "run")
    assert command.main([str(run.folder), "--map=inverse_distance", "--out", str(tmp_path / "command")]) == 0
    assert contents(tmp_path / "command") == contents(tmp_path / "run")
    table = tp.maps(run.robots, "inverse_distance", size=(2, 1.5))
    np.testing.assert_array_equal(table.estimate, expected.estimate)
    assert "to_source_m" not in table.scores["peak"]
    again = run.robots.rename(columns={"reading_ppm": "reading"})[["t", "x", "y", "reading"]]
    again["reading"] = 7.5
    np.testing.assert_allclose(tp.maps(again, "inverse_distance", size=(2, 1.5)).estimate, 7.5, rtol=3e-6)


@pytest.mark.slow
def test_a_simulation_in_use_goes_on(log):
    alone, other = (tp.Simulation("plumesim_casting") for _ in range(2))
    alone.run(until=2)
    other.run(until=1)
    tp.maps(log, "gmrf", size=(4, 3))
    other.run(until=2)
    assert other.robots.equals(alone.robots)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"map": "nose"}, "--map: unknown kind 'nose'; known kinds: time_series, "),
        ({"map": {"kind": "gmrf", "cell": "2 kg"}}, "--map.cell: got '2 kg': must have a unit that converts to m"),
        ({"map": {"kind": "gmrf", "cell": 1e-5}}, "--map.cell: 1e-05 m makes more than "),
        ({"map": 5}, "--map: must be a mapping"),
        ({"size": None}, "--size: is missing; give the edges of the floor"),
        ({"size": (4, "3 s")}, "--size[1]: got '3 s': must have a unit that converts to m"),
        ({"size": (4, float("nan"))}, "--size[1]: got nan: must be a finite number"),
        ({"origin": (9, 9)}, "no reading lies on the floor of 4 x 3 m"),
        ({"readings": "no.csv"}, "no.csv: cannot be read: "),
        ({"readings": 7}, "readings: got 7; give a file, a run or a pandas.DataFrame"),
        ({"trial": -1}, "--trial: got -1: must be at least 0"),
        ({"group": "a"}, "no column 'group'"),
        ({"bag": {"topic": ["/gas"]}}, "bag: unknown key 'topic'; allowed: gas, pose, wind, frame, "),
        ({"bag": {"gas": ["/gas"]}}, "log.csv: is no bag"),
        ({"bag": {"air": "3 m"}}, "bag.air: got '3 m': must have a unit that converts to ohm"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_writes_nothing(options, line, log, tmp_path):
    before = set(tmp_path.iterdir())
    given = {"readings": log, "size": (4, 3), "out": tmp_path / "out"} | options
    with pytest.raises(tp.InputError) as caught:
        tp.maps(**given)
    (got,) = caught.value.lines
    assert line in got
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        ({"t": [1.0], "x": [1.0]}, "DataFrame: has no column y, reading; it has t, x"),
        ({"t": [1], "x": [1], "y": [1], "reading": ["a"]}, "DataFrame: reading must be numbers, not "),
        ({"t": [1], "x": [None], "y": [1], "reading": [1]}, "DataFrame: x of row 1 is not a number"),
        ({"t": [1], "x": [1], "y": [1], "reading": [object()]}, "DataFrame: cannot be read: "),
        ({"t": [], "x": [], "y": [], "reading": []}, "DataFrame: has no readings"),
    ],
)
def test_faults_of_a_table_are_named(columns, line):
    with pytest.raises(tp.InputError) as caught:
        tp.maps(pandas.DataFrame(columns), size=(4, 3))
    (got,) = caught.value.lines
    assert got.startswith(line)


@pytest.mark.slow
def test_an_earlier_map_is_replaced_only_by_force(log, tmp_path):
    out = tmp_path / "out"
    fine = tp.maps(log, KERNEL, size=(3, 2), out=out)
    before = contents(out)
    for again in (lambda: tp.maps(log, size=(3, 2), out=out), lambda: fine.write(out)):
        with pytest.raises(tp.RunFolderError, match="is not empty"):
            again()
    with pytest.raises(tp.RunFolderError, match="which this run reads"):
        fine.write(tmp_path, force=True)
    assert contents(out) == before
    tp.maps(log, size=(3, 2), out=out, force=True)
    assert contents(tmp_path / "out.old") == before
    assert json.loads(contents(out)["scores.json"])["kind"] == "time_series"
    fine.write(out, force=True)
    assert contents(out) == before


def test_a_map_has_the_readings_of_all_robots_whatever_they_can_send():
    """docs/howto/gas_maps.md: range and loss of `communication` act on messages, not on maps."""
    mute = MAPPED["robots"][0] | {"communication": {"range": 0.01, "loss": 0.99}}
    far, near = (
        tp.Simulation(MAPPED | {"maps": [{"kind": "inverse_distance"}], "robots": [robots]})
        for robots in (mute, MAPPED["robots"][0])
    )
    for sim in (far, near):
        sim.run(until=11)
    estimates = [np.asarray(sim.loop.maps[0].estimate()) for sim in (far, near)]
    assert np.isfinite(estimates[0]).all()
    np.testing.assert_array_equal(estimates[0], estimates[1])
