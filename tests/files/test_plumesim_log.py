"""Logs that runs write: what is in them, how they are played back, and what is kept of an interrupted one."""

import errno
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas
import pytest

from taichi_plume import open_run
from taichi_plume.__main__ import main
from taichi_plume.assembly import assemble as assembly
from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.cli import run
from taichi_plume.execution.plume_log import PlumeLogger
from taichi_plume.files import disk
from taichi_plume.files.plumesim_log import read_log
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.grid.fields import ppm_at, velocity_at
from taichi_plume.results.network_log import log_of
from taichi_plume.scenario.outputs import PlumeLog
from taichi_plume.time_loop import Every, TimeLoop

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

LIVE = """
name: live
seed: 3
duration: 1.5
warm_up: 1
domain: {size: [1.2, 0.8], spacing: 0.05, depth: 0.5}
wind:
  kind: cfd
  openings:
    - {kind: honeycomb, face: x-, speed: 0.7, turbulence_intensity: 0.1}
    - {kind: honeycomb, face: x+}
obstacles: [{kind: cylinder, center: [0.5, 0.35], radius: 0.1}]
gas: {kind: eulerian, species: acetone, sources: [{position: [0.3, 0.4], rate: 10 mg/s, start: -1}]}
plumesim_log: {rate: 2, start: -0.5, cell: 0.08, full_scale_ppm: 400}
"""
PLAY = """
duration: 1.5
domain: {size: [1.2, 0.8], spacing: 0.05}
wind: {kind: plumesim_log, file: run/plume.pslog, start: 0.5}
gas: {kind: plumesim_log, file: run/plume.pslog, start: 0.5, species: acetone, full_scale_ppm: 400}
"""

HALF_DIGIT = 5.1e-4  # of four: the largest relative error of a printed number, 1.0005 as 1.000


def wind_and_gas(sim: TimeLoop, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return velocity_at(sim.wind, place, sim.t), ppm_at(sim.gas, place, sim.t)[:, 0]


def changed(monkeypatch: pytest.MonkeyPatch, change: Callable[[TimeLoop], None]) -> None:
    """Change each simulation that a command makes."""
    live = assembly.build

    def build(*arguments: Any, **more: Any) -> TimeLoop:
        sim = live(*arguments, **more)
        change(sim)
        return sim

    monkeypatch.setattr(assembly, "build", build)


def test_a_run_is_played_back_to_the_printed_digits(tmp_path, monkeypatch):
    """The same wind and gas on the nodes, at the frames' times."""
    (tmp_path / "live.yaml").write_text(LIVE)
    (tmp_path / "play.yaml").write_text(PLAY)
    seen: dict[int, Any] = {}

    def watch(sim: TimeLoop) -> None:
        grid = 0.08 * (np.stack(np.meshgrid(np.arange(15), np.arange(10), indexing="ij"), -1) + 0.5)
        flat = grid.reshape(-1, 2)
        place = flat[np.linalg.norm(flat - [0.5, 0.35], axis=1) > 0.1]
        sim.observers.append(
            Every(0.1, lambda s: seen.update({s.tick: (place, *wind_and_gas(s, place))}), warm_up=True)
        )

    changed(monkeypatch, watch)
    command = [str(tmp_path / "live.yaml"), "--out", str(tmp_path / "run"), "--quiet", "--no-recording"]
    assert run.main(command) == 0
    frames = read_log(tmp_path / "run" / "plume.pslog")
    assert (len(frames), frames.period, frames.cell) == (5, 0.5, 0.08)
    again = assemble(load_scenario(tmp_path / "play.yaml"), tmp_path)
    for tick in range(16):
        place, u, ppm = seen[tick - tick % 5]
        assert len(place) == len(frames.place) / 5
        speed = np.abs(u).max()
        there = wind_and_gas(again, place)
        np.testing.assert_allclose(there[0], u, atol=2 * HALF_DIGIT * speed)  # of speed and of direction
        np.testing.assert_allclose(there[1], ppm, rtol=HALF_DIGIT, atol=4e-6)
        assert ppm.max() > 10
        if tick < 15:
            again.advance()


def plain(velocity: str, position: str) -> list[str]:
    """Overrides for a wind and a gas that need hardly a kernel."""
    source = f"{{position: {position}, rate: 10 mg/s, radius: 0.05}}"
    return [
        f"wind={{kind: uniform, velocity: {velocity}}}",
        f"gas={{kind: gaussian_plume, species: acetone, intensity: 0.1, walls: [], sources: [{source}]}}",
        "obstacles=[]",
    ]


def short(tmp_path: Path, **keys: Any) -> tuple[TimeLoop, PlumeLogger]:
    (tmp_path / "live.yaml").write_text(LIVE)
    scenario = load_scenario(tmp_path / "live.yaml", plain("[0, -0.3]", "[0.3, 0.4]"))
    sim = assemble(scenario, tmp_path)
    log = PlumeLogger(sim, tmp_path / "plume.pslog", PlumeLog(**keys))
    log.start()
    return sim, log


def test_the_file_is_whole_after_every_frame(tmp_path):
    sim, log = short(tmp_path, rate=5, start=-0.8)
    sim.observers.append(log.observer())
    sim.observe()
    assert (tmp_path / "plume.pslog").read_text() == f"200,{0:9d},0.1\n"
    for _ in range(9):
        sim.advance()
        sim.observe()
    frames = read_log(tmp_path / "plume.pslog")  # not closed
    assert len(frames) == 4  # at -0.8, -0.6, -0.4 and -0.2 s
    np.testing.assert_allclose(frames.wind[:, 1], -0.3, rtol=1e-4)
    np.testing.assert_allclose(frames.wind[:, 0], 0, atol=1e-4)
    log.close()


def test_a_full_disk_is_reported_and_the_frames_before_are_kept(tmp_path, monkeypatch):
    usage = SimpleNamespace(free=10 * disk.RESERVE)
    monkeypatch.setattr(disk.shutil, "disk_usage", lambda _: usage)
    (tmp_path / "live.yaml").write_text(LIVE)
    fill = Every(0.1, lambda s: setattr(usage, "free", disk.RESERVE - 1) if s.tick > 3 else None)
    changed(monkeypatch, lambda sim: sim.observers.append(fill))
    out = tmp_path / "run"
    changes = [f"--set={change}" for change in plain("[0.3, 0]", "[0.3, 0.4]")]
    command = [str(tmp_path / "live.yaml"), *changes, "--out", str(out), "--quiet", "--no-recording"]
    assert run.main(command) == 1
    assert json.loads((out / "result.json").read_text())["status"] == "disk_full"
    assert len(read_log(out / "plume.pslog")) == 2
    with pytest.raises(OSError, match="full") as caught:
        short(tmp_path)
    assert caught.value.errno == errno.ENOSPC


def test_in_three_dimensions_the_log_is_a_slice(tmp_path):
    (tmp_path / "live.yaml").write_text(LIVE.replace("[1.2, 0.8]", "[1.2, 0.8, 0.4]"))
    scenario = load_scenario(tmp_path / "live.yaml", plain("[0.2, 0, 0.1]", "[0.3, 0.4, 0.1]"))
    sim = assemble(scenario, tmp_path)
    for _ in range(5):
        sim.advance()
    log = PlumeLogger(sim, tmp_path / "plume.pslog", PlumeLog(start=-0.5, height=0.25))
    log.start()
    log.add(sim)
    log.close()
    frames = read_log(tmp_path / "plume.pslog")
    at = np.column_stack([frames.place, np.full(len(frames.place), 0.25)])
    np.testing.assert_allclose(frames.percent, ppm_at(sim.gas, at, sim.t)[:, 0], rtol=HALF_DIGIT, atol=1e-6)
    np.testing.assert_allclose(frames.wind, np.tile([0.2, 0.0], (len(at), 1)), atol=1e-5)
    assert frames.percent.max() > 1


NETWORK = """
name: network
duration: 2
domain: {size: [1.2, 0.8], spacing: 0.1}
wind: {kind: uniform, velocity: [0.3, 0], gusts: {intensity: 0.3, time: 0.5 s}}
gas: {kind: meandering, species: acetone, sources: [{position: [0.1, 0.4], rate: 1 mg/s, radius: 0.1}]}
probes: {every: 0.5 s, points: [{kind: grid, name: net, low: [0.15, 0.15], high: [1.05, 0.65], counts: [4, 3]}]}
robots:
  - name: nodes
    count: 3
    trials: 2
    start: {kind: positions, positions: [[0.3, 0.4], [0.6, 0.4], [0.9, 0.5]]}
    algorithm: {kind: casting, speed: 0}
    body: {radius: 0.03}
    reach: 0
  - name: rover
    count: 1
    algorithm: {kind: random_walk}
    start: {kind: positions, positions: [[1.1, 0.7]]}
    body: {radius: 0.03}
    reach: 0
"""
REPLAY = """
duration: 1.9
domain: {size: [1.2, 0.8], spacing: 0.1}
wind: {kind: plumesim_log, file: run/network.pslog}
gas: {kind: plumesim_log, file: run/network.pslog, species: acetone, full_scale_ppm: 50}
"""


@pytest.fixture(scope="module")
def network(tmp_path_factory) -> Path:
    """Folder with a run of a sensor network, of probes and of robots, and the scenario that plays its log."""
    folder = tmp_path_factory.mktemp("network")
    (folder / "network.yaml").write_text(NETWORK)
    (folder / "replay.yaml").write_text(REPLAY)
    command = [str(folder / "network.yaml"), "--out", str(folder / "run"), "--quiet", "--no-recording"]
    assert run.main([*command, "--no-report"]) == 0
    return folder


@pytest.mark.parametrize(("source", "cell"), [("probes", 0.25), ("robots", 0.1**0.5)])
def test_the_log_of_a_sensor_network_plays_its_readings(network, source, cell):
    """Readings hold at each node until the next row; of the robots, only those that stand are nodes."""
    log = network / "run/network.pslog"
    options = ["--from", source, "--full-scale", "50", "--force"]
    assert main(["export", str(log.parent), "--to", "plumesim", *options]) == 0
    results = open_run(log.parent)
    if source == "probes":
        rows, gas = results.probes, "acetone_ppm"
    else:
        rows, gas = results.robots, "reading_ppm"
        rows = rows[(rows.trial == 0) & (rows.group == "nodes") & (rows.t > 0)]  # at 0 no sensor has read
    times = np.unique(rows.t)
    assert read_log(log).cell == pytest.approx(cell)
    again = assemble(load_scenario(network / "replay.yaml"), network)
    while not again.finished:
        t = times[np.searchsorted(times - times[0], again.t + 1e-6) - 1]
        now = rows[rows.t == t]
        u, ppm = wind_and_gas(again, now[["x", "y"]].to_numpy())
        speed = np.hypot(now.wind_x, now.wind_y).max()
        np.testing.assert_allclose(u, now[["wind_x", "wind_y"]].to_numpy(), atol=2 * HALF_DIGIT * speed)
        np.testing.assert_allclose(ppm, np.maximum(now[gas], 0), rtol=HALF_DIGIT, atol=4e-6)
        again.advance()
    assert rows[gas].to_numpy().max() > 3


@pytest.mark.parametrize(
    ("source", "trial", "reported"), [("robots", "2", "has no trial 2"), ("probes", "0", "--trial")]
)
def test_a_trial_that_is_not_there_is_refused(network, capsys, source, trial, reported):
    options = ["--to", "plumesim", "--from", source, "--trial", trial, "--force"]
    assert main(["export", str(network / "run"), *options]) == 2
    assert reported in capsys.readouterr().err


@pytest.mark.parametrize(
    ("t", "z", "reported"),
    [
        ([0, 0.1, 0.3], [0, 0, 0], "rows are 0.1 to 0.2 s apart"),
        ([0, 0.0105, 0.021], [0, 0, 0], "10.5 ms apart"),
        ([0, 0, 0], [0, 0, 0], "rows of one time only"),
        ([0, 0.1, 0.2], [0, 0, 0.5], "at heights from 0 to 0.5 m"),
        ([0, 0.1, 0.2], [0, 0, 0], "a single node"),
    ],
)
def test_tables_that_make_no_log_are_refused(tmp_path, t, z, reported):
    zero = np.zeros(3)
    rows = pandas.DataFrame(
        {"t": t, "x": zero, "y": zero, "z": z, "wind_x": zero, "wind_y": zero, "a_ppm": zero}
    )
    table: Any = SimpleNamespace(probes=rows, folder=tmp_path)
    with pytest.raises(RunFolderError, match=reported):
        list(log_of(table, source="probes"))
