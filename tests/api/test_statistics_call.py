"""tp.statistics: the files and lines of the command, what a notebook shows, and errors before anything is written."""

from pathlib import Path

import numpy as np
import pytest

import taichi_plume as tp
from taichi_plume.cli import statistics as command
from taichi_plume.scenario.sensors import PidSensor

pytestmark = pytest.mark.usefixtures("taichi")

SENSOR = {"kind": "pid", "rise_time": "20 ms", "decay_time": "20 ms", "period": "50 ms"}
PLUME = {
    "name": "plume", "seed": 2, "duration": 8, "tick": 0.05, "domain": {"size": [4, 3], "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [1, 0], "gusts": {"intensity": 0.4, "time": 0.2}},
    "gas": {
        "kind": "meandering", "width_slope": 0.05,
        "sources": [{"position": [0.5, 1.5], "rate": "10 mg/s", "radius": 0.05}],
    },
    "probes": {
        "every": "step", "start": 1,
        "points": [
            {"kind": "point", "name": "axis", "at": [2, 1.6]},
            {"kind": "line", "name": "across", "start": [2, 1], "end": [2, 2], "count": 5},
        ],
    },
    "fields": {"rate": 20, "quantities": ["gas"]},
}  # fmt: skip


@pytest.fixture(scope="module")
def run(taichi, tmp_path_factory) -> tp.Run:
    return tp.simulate(PLUME, out=tmp_path_factory.mktemp("runs") / "plume", progress=False)


def contents(folder: Path) -> dict[str, bytes]:
    """The files of a folder; maps.nc, in which HDF5 counts objects of the process, by its values."""
    return {
        file.name: file.read_bytes() if file.suffix != ".nc" else netcdf(file) for file in folder.iterdir()
    }


def netcdf(file: Path) -> bytes:
    import xarray

    with xarray.open_dataset(file) as data:
        return b"".join(data[name].to_numpy().tobytes() for name in sorted(map(str, data.variables)))


@pytest.mark.slow
def test_the_files_are_those_of_the_command(run, tmp_path, capsys):
    options = ["--threshold", "20", "--from", "1.5", "--range", "0.1", "2", "--sensor", str(SENSOR)]
    assert command.main([str(run.folder), *options, "--out", str(tmp_path / "command")]) == 0
    printed = capsys.readouterr().out.splitlines()
    plume = tp.statistics(
        run, threshold="20 ppm", start="1500 ms", bounds=(0.1, 2), sensors=[SENSOR], out=tmp_path / "call"
    )
    expected = contents(tmp_path / "command")
    assert len(expected) == 6
    assert contents(tmp_path / "call") == expected
    assert repr(plume).splitlines() == printed[:-1]
    assert printed[-1].startswith(str(tmp_path / "command" / "statistics.html"))
    tp.statistics(str(run.folder), out=str(tmp_path / "bare"), page=False)
    assert contents(tmp_path / "bare").keys() == expected.keys() - {"statistics.html"}


def test_numbers_are_those_of_the_table(run):
    """By the trapezoidal rule. Sensors may be texts, sections or models; they follow the seven defaults."""
    before = sorted(file.name for file in run.folder.iterdir())
    model = PidSensor.model_validate(SENSOR)
    plume = tp.statistics(run.folder, probe="axis", threshold=20, sensors=[SENSOR, str(SENSOR), model])
    rows = run.probes[run.probes.probe == "axis"]
    mean = np.trapezoid(rows.ethanol_ppm.to_numpy(float), rows.t) / np.ptp(rows.t)
    (point,) = plume.points.itertuples()
    assert point.mean == pytest.approx(mean, rel=1e-5)
    sensors = plume.summary["sensors"]
    assert isinstance(sensors, list)
    assert [sensor["sensor"] for sensor in sensors[-3:]] == [
        "photo-ionisation detector, 20 ms, read every 50 ms"
    ] * 3
    assert sensors[-1] == sensors[-3]
    assert sorted(file.name for file in run.folder.iterdir()) == before, "nothing is written unless asked for"


@pytest.mark.slow
def test_a_film_alone_and_what_a_notebook_shows(run):
    of_run, of_film = tp.statistics(run), tp.statistics(run.folder / "fields.zarr")
    assert (of_run.of, of_film.of) == ("probes", "film")
    assert "points, 141 samples from 1 to 8 s; threshold " in repr(of_run).splitlines()[0]
    for plume in (of_run, of_film):
        html = plume._repr_html_()
        assert "data:image/png;base64," in html
        assert plume.why in html


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"source": 5}, "source: got 5; give a run, the folder of a run, or a film"),
        ({"source": "nowhere"}, "nowhere: "),
        ({"gas": "helium"}, "holds no helium, only ethanol"),
        ({"probe": "b"}, "has no probe b, only axis, across"),
        ({"threshold": 0}, "--threshold: got 0 ppm; at least 1e-09 ppm"),
        ({"threshold": "2 m"}, "--threshold: got '2 m': must have a unit that converts to ppm"),
        ({"threshold": float("nan")}, "--threshold: got nan: must be a finite number"),
        ({"start": 99}, "holds 0 samples from 99 s on"),
        ({"start": "1 m"}, "--from: got '1 m': must have a unit that converts to s"),
        ({"bounds": (3, 1)}, "--range: got 3 and 1 s; the first must be less than the second"),
        ({"bounds": 3}, "--range: must be a list, got 3"),
        ({"sensors": [{"kind": "nose"}]}, "--sensor: unknown kind 'nose'; "),
        ({"sensors": [{"kind": "pid", "rise_time": "1 kg"}]}, "--sensor.rise_time: got '1 kg': must have a unit"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_writes_nothing(run, options, line, tmp_path):
    with pytest.raises(tp.InputError) as caught:
        tp.statistics(**({"source": run, "out": tmp_path / "out"} | options))
    (got,) = caught.value.lines
    assert line in got
    assert not (tmp_path / "out").exists()
