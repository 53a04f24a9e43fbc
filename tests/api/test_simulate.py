"""tp.simulate: the files of the command, errors before anything is written, and what a run shows of itself."""

import json
import os
import threading

import numpy as np
import pytest
import yaml

import taichi_plume as tp
from taichi_plume.cli import run as command

DATA = {
    "name": "small", "duration": "2 s", "warm_up": 0.5, "domain": {"size": [2, 1.5], "spacing": "10 cm"},
    "wind": {
        "kind": "cfd",
        "openings": [{"kind": "inlet", "face": "x-", "speed": 0.3}, {"kind": "outlet", "face": "x+"}],
    },
    "obstacles": [{"kind": "cylinder", "center": [1.2, 0.4], "radius": 0.2}],
    "gas": {"kind": "eulerian", "sources": [{"position": [0.5, 0.75], "rate": "10 mg/s"}]},
    "robots": [
        {
            "name": "pair", "count": 2, "algorithm": {"kind": "casting"},
            "start": {"kind": "positions", "positions": [[1.5, 0.7], [1.5, 1.1]]},
        }
    ],
    "maps": [{"kind": "time_series"}],
}  # fmt: skip
POINTS = {"a": [0.72, 0.77], "beside": [1.2, 0.62], "corner": [0.01, 0.02]}
PROBED = {
    "probes": {
        "points": [{"kind": "point", "name": name, "at": at} for name, at in POINTS.items()], "every": 0.1,
    },
    "fields": {"rate": 10.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def run(taichi, tmp_path_factory) -> tp.Run:
    return tp.simulate(
        DATA, seed=3, overrides=PROBED, out=tmp_path_factory.mktemp("runs") / "call", progress=False
    )


def test_the_files_are_those_of_the_command(run, tmp_path):
    file = tmp_path / "small.yaml"
    file.write_text(yaml.safe_dump(DATA | PROBED))
    assert command.main([str(file), "--seed", "3", "--out", str(tmp_path / "command"), "--quiet"]) == 0
    for name in ("robots.parquet", "probes.parquet", "forces.csv"):
        assert (run.folder / name).read_bytes() == (tmp_path / "command" / name).read_bytes(), name
    other = tp.open_run(tmp_path / "command")
    assert run.scenario == other.scenario
    assert run.fields.equals(other.fields)
    assert run.maps[0].equals(other.maps[0])
    (a, b) = (json.loads((folder / "result.json").read_text()) for folder in (run.folder, other.folder))
    assert a["groups"] == b["groups"]
    assert {file.name for file in run.folder.iterdir()} == {file.name for file in other.folder.iterdir()}


@pytest.mark.slow
def test_force_renames_an_earlier_run(taichi, tmp_path):
    quick = {"duration": 0.2, "warm_up": 0.0}
    earlier = tp.simulate(DATA, overrides=quick, out=tmp_path / "run", progress=False)
    with pytest.raises(tp.RunFolderError, match="--force"):
        tp.simulate(DATA, seed=5, overrides=quick, out=earlier.folder, progress=False)
    again = tp.simulate(DATA, seed=5, overrides=quick, out=earlier.folder, force=True, progress=False)
    assert (again.folder, again.scenario.seed) == (earlier.folder, 5)
    assert tp.open_run(tmp_path / "run.old").scenario.seed == 0


def test_a_scenario_may_be_an_example_a_file_a_dict_or_an_object(tmp_path):
    named = tp.Scenario.from_file("casting_room", {"seed": 9})
    assert named == tp.load_scenario("configs/casting_room.yaml", ["seed=9"])
    file = tmp_path / "again.yaml"
    named.to_yaml(file)
    assert tp.Scenario.from_file(file) == named
    small = tp.Scenario.from_dict(DATA)
    assert small.with_({"robots.0.count": 1}).robots[0].count == 1
    check = small.check()
    assert (bool(check), check.errors, check.size["cells"]) == (True, [], 300)
    off = small.with_({"gas.sources.0.position": [3, 1]})
    assert not off.check()
    assert "gas.sources[0].position: x = 3 m" in off.check().errors[0]


@pytest.mark.parametrize("name", POINTS)
def test_gas_at_a_position_is_what_a_probe_measures(run, name):
    probe = run.probes[run.probes.probe == name]
    gas = run.gas_at(*POINTS[name]).ethanol_ppm.sel(time=probe.t.to_numpy(), method="nearest")
    np.testing.assert_allclose(gas, probe.ethanol_ppm, rtol=gas.relative_precision, atol=1e-5)


@pytest.mark.slow
def test_gas_at_a_position_without_fields_is_as_precise_as_stated(run, tmp_path):
    """Between pixels, from next to no gas to far above the colours' range; the obstacle is elsewhere."""
    pictured = tp.simulate(
        DATA | {"recording": {"rate": 10.0, "range_ppm": [0.1, 33.0]}},
        seed=3,
        out=tmp_path / "run",
        progress=False,
    )
    with pytest.raises(tp.RunFolderError, match="fields"):
        _ = pictured.fields
    for place in ((1.02, 0.97), (0.5, 0.75)):
        known = run.gas_at(*place).ethanol_ppm
        seen = pictured.gas_at(*place).ethanol_ppm.sel(time=known.time, method="nearest")
        assert (known > 1.0).sum() > 5
        error = np.abs(seen - known)
        assert (error <= seen.relative_precision * known + seen.absolute_precision).all()
    assert known.max() > 33


def test_a_position_outside_is_refused(run):
    with pytest.raises(tp.InputError, match=r"x: got 2\.5 m.* 2 m"):
        run.gas_at(2.5, 1.0)
    with pytest.raises(tp.InputError, match="z: got 1"):
        run.gas_at(1.0, 1.0, 1.0)


def test_a_notebook_shows_the_summary_and_a_picture(run):
    html = run._repr_html_()
    assert "small" in html
    assert "data:image/png;base64," in html
    film = run.animate(begin=1.0, end=1.6)
    assert film.data.startswith(b"GIF89a")
    np.testing.assert_allclose(film.times, np.arange(1.0, 1.61, 0.2), atol=0.01)
    assert "data:image/gif;base64," in film._repr_html_()
    assert run.plot(at=1.0)._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("scenario", "options", "error", "words"),
    [
        ("nonsense", {}, tp.ScenarioError, ["nonsense", "casting_room"]),
        (3, {}, tp.ScenarioError, ["int"]),
        (DATA, {"overrides": {"robots.0.cuont": 3}}, tp.ScenarioError, ["cuont", "count"]),
        (DATA, {"overrides": {"domain.spacing": "5 kg"}}, tp.ScenarioError, ["domain.spacing", "5 kg", "cm"]),
        (DATA, {"overrides": "seed=3"}, tp.ScenarioError, ["overrides", "seed=3"]),
        (DATA, {"duration": -1}, tp.ScenarioError, ["duration", "-1"]),
        (DATA, {"arch": "quantum"}, tp.InputError, ["quantum", "cpu"]),
    ],
)  # fmt: skip
def test_bad_input_is_one_error_and_nothing_is_written(
    tmp_path, monkeypatch, scenario, options, error, words
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error) as caught:
        tp.simulate(scenario, progress=False, **options)
    assert len(caught.value.lines) == 1
    assert all(word in caught.value.lines[0] for word in words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_failed_run_keeps_its_files_and_names_them(taichi, tmp_path):
    file = tmp_path / "bad.py"
    file.write_text(
        "class Bad:\n    def act(self, robots):\n        if robots.t > 1:\n            raise KeyError('lost')\n"
    )
    data = DATA | {"robots": [DATA["robots"][0] | {"algorithm": {"kind": "own", "file": str(file)}}]}
    with pytest.raises(tp.ScenarioError, match="allow_code"):
        tp.simulate(data, out=tmp_path / "run", allow_outside=True)
    assert not (tmp_path / "run").exists()
    with pytest.raises(tp.RunError) as caught:
        tp.simulate(data, out=tmp_path / "run", allow_code=True, allow_outside=True, progress=False)
    assert (caught.value.status, caught.value.folder) == ("failed", tmp_path / "run")
    assert "robots.parquet" in caught.value.lines[1]
    assert tp.open_run(tmp_path / "run").robots.t.max() > 0.9


@pytest.mark.slow
def test_another_thread_simulates_and_a_fork_gets_one_clear_error(run, tmp_path):
    sim = tp.Simulation(DATA)
    sim.step()
    thread = threading.Thread(
        target=tp.simulate, args=(DATA,), kwargs={"out": tmp_path / "run", "progress": False}
    )
    thread.start()
    thread.join()
    assert (tmp_path / "run" / "result.json").exists()
    sim.step()
    if hasattr(os, "fork"):
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            try:
                sim.step()
            except RuntimeError as error:
                os.write(writing, str(error).encode())
            os._exit(0)
        os.close(writing)
        os.waitpid(child, 0)
        assert b"fork" in os.read(reading, 1000)
        os.close(reading)
