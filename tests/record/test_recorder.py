import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_run
import numpy as np
import pytest
import rerun as rr
from recordings import column, entities, record, recorded, verified

from taichi_plume.engine import program
from taichi_plume.files import disk
from taichi_plume.record.recorder import BATCH
from taichi_plume.time_loop import Every, TimeLoop

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(autouse=True)
def strict():
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def fake(path: Path, dim: int = 2, **changes: Any) -> Path:
    """Record a run of `fake_run.scenario`."""
    return recorded(fake_run.simulation(fake_run.scenario(dim, **changes)), path)


@pytest.fixture(scope="module")
def arena(tmp_path_factory) -> SimpleNamespace:
    """A run with one of everything in 2-D: its recording's path, the recorder, the simulation, and all snapshots."""
    program.start("cpu")
    path = tmp_path_factory.mktemp("arena") / "a.rrd"
    sim = fake_run.simulation(fake_run.scenario(2, duration=9, warm_up=1))
    recorder = record(sim, path)
    seen: dict[float, dict[str, np.ndarray]] = {}
    sim.observers.append(Every(0.1, lambda s: seen.update({round(s.t, 6): s.swarm.snapshot()})))
    sim.run()
    recorder.close()
    return SimpleNamespace(path=path, recorder=recorder, sim=sim, seen=seen)


def is_whole(path: Path, dim: int, duration: float) -> None:
    """Assert that a recording of `fake_run.scenario` has all entities, and pictures from -1 s on."""
    assert verified(path)
    there = entities(path)
    assert {f"/robots/team-{i}" for i in range(4)} <= there
    assert "/robots/team-4" not in there  # of two trials the first
    assert {f"/world/obstacles/{n}" for n in range(5)} <= there
    assert {f"/maps/{n}/{what}" for n in (0, 1) for what in ("estimate", "truth", "weight", "error")} <= there
    assert {
        "/world/openings/0",
        "/world/openings/1",
        "/wind/slice",
        "/gas/slice",
        "/about",
        "/events",
    } <= there
    deep = {"/gas/volume", "/gas/column", "/gas/section", "/wind/section"}
    assert there & deep == (deep if dim == 3 else set())
    t, _ = column(path, "/gas/slice", "GridMap:data")
    assert t[0] == -1.0
    assert t[-1] == pytest.approx(duration)
    assert np.unique(t.round(6)).size == 5 * (duration + 1) + 1
    assert len(rr.chunk.RrdReader(str(path)).blueprints()) == 1


def test_everything_is_there(arena, tmp_path):
    is_whole(arena.path, 2, 9)
    is_whole(fake(tmp_path / "a.rrd", 3, duration=2, warm_up=1), 3, 2)


def test_robots_are_where_they_were(arena):
    t, places = column(arena.path, "/robots/team-2", "Transform3D:translation")
    _, turns = column(arena.path, "/robots/team-2", "Transform3D:quaternion")
    _, readings = column(arena.path, "/sensors/team-2", "Scalars:scalars")
    assert len(t) == 91
    for at, place, turn, reading in zip(t, places, turns, readings, strict=True):
        now = arena.seen[round(at, 6)]
        assert place[0][:2] == pytest.approx(now["position"][2], abs=1e-5)
        heading = 2 * np.arctan2(turn[0][2], turn[0][3])
        assert np.cos(heading - now["heading"][2]) == pytest.approx(1.0, abs=1e-6)
        assert reading[0] == pytest.approx(now["reading_ppm"][2])


def test_where_robots_believe_to_be_is_seen_beside_where_they_are(tmp_path):
    start = {"kind": "area", "low": [3, 0.5], "high": [3.8, 2.5]}
    one = {"count": 2, "start": start, "algorithm": {"kind": "casting"}}
    robots = [{"name": "wheels", "localization": {"kind": "odometry"}, **one}, {"name": "cameras", **one}]
    path = fake(tmp_path / "a.rrd", duration=3, maps=[], robots=robots)
    ghosts = {f"/{kind}/wheels-{n}" for kind in ("believed", "believed_trails") for n in (0, 1)}
    assert {entity for entity in entities(path) if "believed" in entity} == ghosts
    t, places = column(path, "/believed/wheels-1", "Transform3D:translation")
    _, truth = column(path, "/robots/wheels-1", "Transform3D:translation")
    assert len(t) == 31
    off = np.array(places)[:, 0, :2] - np.array(truth)[:, 0, :2]
    assert off == pytest.approx(np.tile([0.03, -0.1], (31, 1)), abs=1e-5)
    halves = []
    for kind in ("believed", "robots"):
        _, turns = column(path, f"/{kind}/wheels-1", "Transform3D:quaternion")
        halves.append(np.arctan2(*np.array(turns)[:, 0, 2:].T))
    assert np.cos(2 * (halves[0] - halves[1]) - 0.4) == pytest.approx(np.ones(31), abs=1e-6)
    t, steps = column(path, "/believed_trails/wheels-1", "LineStrips3D:strips")
    ends = np.array([step[0][1] for step in steps])
    begins = np.array([step[0][0] for step in steps])
    assert ends[:, :2] == pytest.approx(np.array(places)[:, 0, :2], abs=1e-5)
    assert begins[1:] == pytest.approx(ends[:-1], abs=1e-5)  # without gaps, over the flushes too


def test_what_moves_is_seen_moving_and_screens_are_seen(tmp_path):
    motion = {"path": [[1, 1.5, 2.5], [2, 2.5, 2.5]]}
    walker = {"kind": "cylinder", "center": [1.5, 1.5], "radius": 0.2, "motion": motion}
    wind = fake_run.scenario(2).wind.model_dump()
    wind |= {"screens": [{"kind": "honeycomb", "axis": "x", "at": 0.3}]}
    path = fake(tmp_path / "a.rrd", duration=3, warm_up=1, obstacles=[walker], wind=wind)
    t, shifts = column(path, "/world/obstacles/0", "Transform3D:translation")
    at = {round(float(a), 2): shift[0] for a, shift in zip(t, shifts, strict=True)}
    assert len(at) == 41
    for time, shift in ((-1.0, (0, 0)), (0.5, (0, 0.5)), (1.5, (0.5, 1)), (3.0, (1, 1))):
        assert at[time][:2] == pytest.approx(shift, abs=1e-6)
    assert "/world/screens/0/name" in entities(path)


def test_slice_shows_the_gas_where_it_is(tmp_path):
    model = fake_run.scenario(2, duration=1, obstacles=[], maps=[], robots=[])
    sim = fake_run.simulation(model)
    path = recorded(sim, tmp_path / "a.rrd")
    _, pictures = column(path, "/gas/slice", "GridMap:data")
    nx, ny = sim.grid.shape
    image = (
        np.array(pictures[0][0], np.uint8).reshape(ny, nx)[::-1].T
    )  # rows of constant y, the largest first
    quarters = [-sim.grid.dx / 4, sim.grid.dx / 4]  # a pixel is the largest of what it covers
    samples = [sim.grid.centers() + np.array([a, b]) for a in quarters for b in quarters]
    ppm = np.max([fake_ppm(points) for points in samples], axis=0)
    clear = np.abs(sim.grid.centers()[..., 0] - 0.55) > sim.grid.dx  # at the edge rounding decides
    decades = np.log10(np.maximum(ppm, 0.1) / 0.1)
    assert np.abs(image / 255 * 4 - decades)[clear].max() < 0.5 * 4 / 255 + 1e-2
    assert image.max() > 200


def fake_ppm(points: np.ndarray) -> np.ndarray:
    """Return the gas of `fake_run` at the start [ppm]."""
    along, y = points[..., 0] - 0.6, points[..., 1]
    s = 0.05 + 0.08 * np.maximum(along, 0)
    across = y - 1.5 - 0.12 * along * np.sin(-2 * points[..., 0])
    ppm = 400 * (0.05 / s) ** 2 * np.exp(-(across**2) / (2 * s**2)) * (0.55 + 0.45 * np.cos(8 * along))
    return np.where(along < -0.05, 0.0, ppm)


def test_found_source_and_changes_are_events(arena):
    t, texts = column(arena.path, "/events", "TextLog:text")
    events = [(at, text[0]) for at, text in zip(t, texts, strict=True)]
    assert [round(at, 6) for at, text in events if "found a source" in text] == [8.0]
    assert [at for at, text in events if "0.6 m/s" in text] == [3.0]
    t, states = column(arena.path, "/states/team-0", "StateChange:state")
    assert states[-1][0] == "found"
    assert t[-1] == pytest.approx(8.0)
    names = [state[0] for state in states]
    assert all(a != b for a, b in pairwise(names))


def test_scores_of_maps_are_series(arena):
    series = arena.recorder.maps.series[0]
    for origin, name in (("map_errors/0_mae", "error_ppm"), ("map_peaks/0", "peak_distance_m")):
        t, scalars = column(arena.path, f"/{origin}", "Scalars:scalars")
        assert list(t) == [5.0]
        assert scalars[0][0] == pytest.approx(series.first(name)[0])
    t, forecasts = column(arena.path, "/map_errors/0_forecast", "Scalars:scalars")
    assert list(t) == [5.0]
    assert forecasts[0][0] == pytest.approx(10 / 6)


def test_map_pictures_are_transparent_where_unknown(arena):
    _, pictures = column(arena.path, "/maps/0/estimate", "GridMap:data")
    fake: Any = arena.sim.maps[0]
    nx, ny = fake.shape
    rgba = np.array(pictures[-1][0], np.uint8).reshape(ny, nx, 4)[::-1].swapaxes(0, 1)
    assert np.array_equal(rgba[..., 3] == 255, fake.seen)


def test_without_robots_and_maps(tmp_path):
    path = fake(tmp_path / "a.rrd", 3, duration=1, robots=[], maps=[])
    assert verified(path)
    assert not any(entity.startswith(("/robots", "/maps")) for entity in entities(path))


def test_large_swarm_is_thinned(tmp_path):
    """And sent in turns, of which nothing is lost."""
    group = {"start": {"kind": "area", "low": [3, 0.5], "high": [3.8, 2.5]}, "algorithm": {"kind": "casting"}}
    robots = [{"name": "many", "count": 200, **group}, {"name": "one", "count": 1, **group}]
    model = fake_run.scenario(2, duration=4.5, robots=robots, maps=[])
    sim = fake_run.simulation(model)
    places = []
    sim.observers.append(Every(0.1, lambda sim: places.append(sim.swarm.snapshot()["position"])))
    path = recorded(sim, tmp_path / "a.rrd")
    drawn = {entity for entity in entities(path) if entity.startswith("/robots/")}
    assert "/robots/one" in drawn
    assert len(drawn) == 26
    for name, number in (("many-0", 0), ("many-13", 13), ("one", 200)):
        t, there = column(path, f"/robots/{name}", "Transform3D:translation")
        assert t == pytest.approx(np.arange(46) * 0.1)
        wanted = [place[number] for place in places]
        np.testing.assert_allclose([place[0][:2] for place in there], wanted, atol=1e-5)
        _, strips = column(path, f"/trails/{name}", "LineStrips3D:strips")
        assert [strip[0][-1][:2] for strip in strips] == pytest.approx(np.array(wanted), abs=1e-5)


def test_a_run_that_dies_leaves_a_readable_file(tmp_path):
    sim = fake_run.simulation(fake_run.scenario(2, duration=10))
    record(sim, tmp_path / "a.rrd")  # never closed
    sim.observe()
    while sim.t < BATCH + 0.05:
        sim.advance()
        sim.observe()
    copy = tmp_path / "b.rrd"
    copy.write_bytes((tmp_path / "a.rrd").read_bytes())
    t, _ = column(copy, "/sensors/team-0", "Scalars:scalars")
    assert t[-1] == pytest.approx(BATCH)


def test_no_room_is_an_error_and_the_file_is_whole(tmp_path, monkeypatch):
    sim = fake_run.simulation(fake_run.scenario(2, duration=10))
    recorder = record(sim, tmp_path / "a.rrd")
    usage = SimpleNamespace(free=disk.RESERVE * 4)

    def fill(sim: TimeLoop) -> None:
        if sim.t > 3.5:
            usage.free = disk.RESERVE - 1

    sim.observers.insert(0, Every(0.1, fill))
    monkeypatch.setattr(disk.shutil, "disk_usage", lambda _: usage)
    with pytest.raises(OSError, match="disk is full"):
        sim.run()
    recorder.close()
    assert verified(tmp_path / "a.rrd")
    t, _ = column(tmp_path / "a.rrd", "/sensors/team-0", "Scalars:scalars")
    assert t[-1] == pytest.approx(4.0)


WRITER_FAILS = """
import resource, signal, sys
sys.path.insert(0, {tests!r})
import fake_run
from pathlib import Path
from taichi_plume.files import disk
from taichi_plume.engine import program
from taichi_plume.record import stream
from taichi_plume.record.recorder import Recorder
program.start("cpu")
stream.FLUSH_TIMEOUT = 1.0
disk.require_room = lambda *_: None  # as if another process took the room in between
sim = fake_run.simulation(fake_run.scenario(2, duration=60))
recorder = Recorder(sim, Path({path!r}))
recorder.start()
sim.observers += recorder.observers()
resource.setrlimit(resource.RLIMIT_FSIZE, (800_000, 800_000))
try:
    sim.run()
except OSError as error:
    print("noticed:", error)
recorder.close()
"""


@pytest.mark.skipif(os.name == "nt", reason="no limit on file sizes")
def test_a_writer_that_fails_is_noticed_and_does_not_hang(tmp_path):
    path = tmp_path / "a.rrd"
    command = [
        sys.executable,
        "-c",
        WRITER_FAILS.format(tests=str(Path(__file__).parents[1]), path=str(path)),
    ]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert "noticed:" in run.stdout, run.stderr
    t, _ = column(path, "/sensors/team-0", "Scalars:scalars")
    assert BATCH <= t[-1] < 60.0


def test_sources_are_drawn_where_they_are_at_each_time(tmp_path):
    """One moves, one appears and ends; a source that stays is drawn once for the whole run."""
    sources = [
        {"position": [1.0, 1.5], "rate": 1e-6, "motion": {"path": [[2, 2.0, 1.5]]}},
        {"position": [1.0, 2.5], "rate": 1e-6, "start": 0.5, "stop": 1.5},
        {"position": [0.5, 0.5], "rate": 1e-6},
    ]
    scenario = fake_run.scenario(2, duration=3, warm_up=1, gas={"kind": "eulerian", "sources": sources})
    path = recorded(fake_run.simulation(scenario), tmp_path / "a.rrd")
    assert verified(path)
    t, places = column(path, "/world/sources/0", "Points3D:positions")
    assert [place[0][0] for place in places] == pytest.approx(np.clip(1.0 + 0.5 * t, 1.0, 2.0), abs=1e-6)
    assert t[-1] == pytest.approx(2.0)  # nothing is written while it stands
    t, places = column(path, "/world/sources/1", "Points3D:positions")
    assert t.tolist() == pytest.approx([0.6])  # it starts at 0.5
    assert column(path, "/world/sources/1", "Clear:is_recursive")[0] == pytest.approx([1.6])
    assert not len(column(path, "/world/sources/2", "Points3D:positions")[0])
