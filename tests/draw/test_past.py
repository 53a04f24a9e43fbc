"""Moments of a run in the plan: those of the recording and of the solver, while it goes on and once it has ended."""

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip("bokeh", reason="the extra draw is not installed")

from test_drawn_page import Tab, sight_at

import taichi_plume as tp
from taichi_plume.draw.page import Page
from taichi_plume.draw.past import Past
from taichi_plume.draw.runs import Run
from taichi_plume.draw.workplace import Workplace
from taichi_plume.execution.latest_instant import InstantFile, read
from taichi_plume.grid.fields import velocity_at
from taichi_plume.guard.input_error import InputError
from taichi_plume.report.theme import ABOVE

TEXT = """\
name: small
duration: 6
seed: 2
stop_early: false
domain: {size: [2, 1.2], spacing: 0.1}
wind: {kind: synthetic}
gas: {kind: eulerian, sources: [{position: [0.4, 0.5], rate: 5 mg/s, radius: 0.1}]}
robots:
  - name: team
    count: 2
    start: {kind: positions, positions: [[1.6, 0.3], [1.6, 0.7]]}
    algorithm: {kind: casting}
recording: {rate: 2, wind_rate: 1}
maps: [{kind: kernel_dmv, cell: 0.2}, {kind: time_series, cell: 0.25}]
"""


@pytest.fixture(scope="module")
def ended(tmp_path_factory, taichi) -> Path:
    folder = tmp_path_factory.mktemp("past")
    (folder / "small.yaml").write_text(TEXT)
    tp.simulate(folder / "small.yaml", out=folder / "runs" / "small-1", progress=False)
    return folder


@pytest.mark.slow
def test_a_moment_has_the_values_of_the_solver_and_of_the_recording(ended):
    past = Past(ended / "runs/small-1")
    assert past.times == pytest.approx(np.arange(0, 6.01, 0.5))
    recorded = tp.open_run(ended / "runs/small-1").pictures
    with tp.Simulation(ended / "small.yaml") as sim:
        for t in (1.0, 3.5, 6.0):
            sim.run(until=t)
            seen = past.at(t)
            (gas,) = sim.loop.gas.gases
            ppm = np.asarray(gas.cells(sim.loop.t)) * gas.species.ppm_per_density
            shown, about = seen.pictures["gas_slice"], recorded.gas_slice.attrs
            assert (shown.unit, shown.cell) == ("ppm", 0.1)
            for x, y in ((0.45, 0.55), (0.75, 0.35), (1.05, 0.65)):
                i, j = int(x / 0.1), int(y / 0.1)
                allowed = float(about["relative_precision"] * ppm[i, j] + about["absolute_precision"])
                assert shown.values[j, i] == pytest.approx(ppm[i, j], abs=allowed)
                assert shown.values[j, i] == float(recorded.gas_slice.sel(x=x, y=y, time=t, method="nearest"))
            state = sim.loop.swarm.snapshot()
            assert pytest.approx(state["position"], abs=1e-5) == seen.robots[:2].T
            for n, way in enumerate(seen.trails):
                assert way[:, -1] == pytest.approx(state["position"][n], abs=1e-5)
        x, y, u, v = seen.wind()
        from taichi_plume.grid import fields

        there = fields.velocity_at(sim.loop.wind, np.stack([x, y], axis=-1), 6.0)
        assert np.stack([u, v], axis=-1) == pytest.approx(there, rel=2e-3, abs=1e-4)


SOLID = """\
name: solid
duration: 3
seed: 2
domain: {size: [2, 1.2, 0.6], spacing: 0.1}
wind: {kind: synthetic}
gas: {kind: eulerian, sources: [{position: [0.4, 0.5, 0.15], rate: 5 mg/s, radius: 0.1}]}
recording: {rate: 2, wind_rate: 1, slice_height: [0.15, 0.42]}
"""
SLICES = {"slice": 0.15, "slice_2": 0.42}
TEXTS = {
    "slice": "0.15 m above the floor",
    "slice_2": "0.42 m above the floor",
    "column": "maximum over the height",
}


@pytest.fixture(scope="module")
def solid(tmp_path_factory, taichi) -> SimpleNamespace:
    """A run in 3-D: its folder, and the moment at 2 s of the recording, of the live file and of the solver."""
    folder = tmp_path_factory.mktemp("solid")
    (folder / "solid.yaml").write_text(SOLID)
    tp.simulate(folder / "solid.yaml", out=folder / "runs" / "solid-1", progress=False)
    with tp.Simulation(folder / "solid.yaml") as sim:
        file = InstantFile(sim.loop, folder / "w.npz")
        sim.run(until=2.0)
        file.written = -np.inf
        file.update(sim.loop)
        (gas,) = sim.loop.gas.gases
        ppm = np.asarray(gas.cells(sim.loop.t)) * gas.species.ppm_per_density
        moments = {"past": Past(folder / "runs/solid-1").at(2.0), "live": read(folder / "w.npz")}
        winds = {}
        for way, moment in moments.items():
            for plane, z in SLICES.items():
                points = np.insert(moment.winds[plane][:2].T, 2, z, axis=1)
                winds[way, plane] = velocity_at(sim.loop.wind, points, 2.0)
    return SimpleNamespace(folder=folder, moments=moments, ppm=ppm, winds=winds)


@pytest.mark.slow
@pytest.mark.parametrize("way", ["past", "live"])
def test_every_horizontal_plane_has_the_values_of_the_solver(solid, way):
    moment = solid.moments[way]
    assert {of.plane: of.quantity for of in moment.pictures.values()} == {
        plane: f"ethanol · {text}" for plane, text in TEXTS.items()
    }
    ppm, about = solid.ppm, tp.open_run(solid.folder / "runs/solid-1").pictures.gas_slice.attrs
    rounding: Any = {
        key: about[f"{word}_precision"] for key, word in (("rel", "relative"), ("abs", "absolute"))
    }
    precision: Any = rounding if way == "past" else {"rel": 1e-4, "abs": 1e-4}
    third = 0.3 * ppm[..., 3] + 0.7 * ppm[..., 4]  # 0.42 m lies between the middles of two layers
    expected = {"slice": ppm[..., 1], "slice_2": third, "column": ppm.max(axis=2)}
    for plane, values in expected.items():
        assert pytest.approx(values, **precision) == moment.pictures[f"gas_{plane}"].values.T, plane
    for plane in SLICES:
        arrows = moment.wind(moment.pictures[f"gas_{plane}"])
        velocity = solid.winds[way, plane][:, :2]
        assert pytest.approx(velocity, rel=4e-3, abs=1e-3) == arrows[2:].T, plane
    assert (moment.winds["slice"] != moment.winds["slice_2"]).any()
    np.testing.assert_array_equal(moment.wind(moment.pictures["gas_column"]), moment.winds["slice"])


@pytest.mark.slow
def test_a_chosen_height_is_drawn_with_its_wind(solid):
    page = page_of(solid.folder, "solid.yaml")
    page.runs.choose(1)
    page.time.choose(2.0)
    assert dict(page.runs.quantity.options) == {
        f"gas_{key}": f"ethanol · {text}" for key, text in TEXTS.items()
    }
    above = page.canvases[ABOVE]
    for plane in ("slice", "slice_2"):
        page.runs.quantity.value = f"gas_{plane}"
        assert above._beside[2] is page.runs.sight.pictures[f"gas_{plane}"]
        lines = above.sources["wind"].data
        drawn = np.subtract(lines["x1"], lines["x0"])
        u, v = solid.winds["past", plane].T[:2]
        assert drawn == pytest.approx(above.arrow * u, rel=4e-3, abs=1e-3 * above.arrow), (
            "the wind at that height"
        )
        fastest = np.hypot(u, v).max()
        assert float(page.time.about.text.split()[2]) == pytest.approx(fastest, rel=0.06)


@pytest.mark.slow
def test_between_two_pictures_the_earlier_one_is_seen(ended):
    past = Past(ended / "runs/small-1")
    for t, other in ((3.4, 3.0), (-5.0, 0.0), (99.0, 6.0)):
        found, wanted = (past.at(at).pictures["gas_slice"].values for at in (t, other))
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.slow
def test_gas_maps_are_those_of_the_end(ended):
    past, run = Past(ended / "runs/small-1"), tp.open_run(ended / "runs/small-1")
    found = past.at(1.0).pictures
    assert set(found) == {"gas_slice", "map_0_0", "deviation_0_0", "map_1_0"}
    for n, cell in ((0, 0.2), (1, 0.25)):
        shown, of = found[f"map_{n}_0"], run.maps[n]
        np.testing.assert_array_equal(shown.values, of.estimate[0])
        assert (shown.unit, shown.cell) == ("ppm", pytest.approx(cell))
        assert shown.quantity.endswith("map at the end, 6 s")
        assert shown.scale == found["gas_slice"].scale
    deviation = found["deviation_0_0"]
    assert deviation.values**2 == pytest.approx(run.maps[0].variance.values[0], rel=1e-5, nan_ok=True)
    assert np.isfinite(deviation.values).any()


def test_a_folder_without_a_run_is_one_line(tmp_path):
    with pytest.raises(InputError, match=r"^empty: shows no moments"):
        Past(tmp_path / "empty")


class Clock(Tab):
    """Document whose periodic callbacks are called by hand."""

    def __init__(self):
        super().__init__()
        self.periodic: list = []

    def add_periodic_callback(self, callback, period):
        self.periodic.append(callback)
        return callback

    def remove_periodic_callback(self, callback):
        self.periodic.remove(callback)


def page_of(folder: Path, name: str = "small.yaml") -> Any:
    return Page(Clock(), Workplace(folder, folder / name))


def shown(page) -> tuple[int, list[float]]:
    """Number of pictures, and positions of the robots in the view from above."""
    sources = page.canvases[ABOVE].sources
    return len(sources["image"].data["image"]), list(sources["robots"].data["x"])


@pytest.mark.slow
def test_the_slider_shows_moments_of_a_run_that_has_ended(ended):
    page = page_of(ended)
    page.runs.choose(1)
    run = page.runs.run
    bar = page.time
    assert bar.layout.visible
    assert (bar.slider.start, bar.slider.end) == (0.0, 6.0)
    bar.slider.value = 2.5
    past = Past(run.folder)
    images, robots = shown(page)
    assert images == 1
    (values,) = page.canvases[ABOVE].sources["values"].data["image"]
    np.testing.assert_array_equal(values, past.at(2.5).pictures["gas_slice"].values)
    assert page.canvases[ABOVE].reader.tooltips[0][1] == "@image{%.3g} ppm"
    assert robots == pytest.approx(past.at(2.5).robots[0])
    ways = page.canvases[ABOVE].sources["trails"].data["xs"]
    assert [len(way) for way in ways] == [26, 26], "a place per 0.1 s"
    assert page.runs.now.location == 2.5
    drawn = page.runs.curves.data
    bar.slider.value = 3.0
    assert page.runs.curves.data is drawn, "the readings of the whole run are drawn once"
    bar.slider.value = 2.5
    page._typed(TEXT.replace("size: [2, 1.2]", "size: [2, 1.5]"))
    assert shown(page)[0] == 1, "a chosen moment stays while the room is edited"
    assert "run 1" in page.canvases[ABOVE].note.text
    page.time.choose(None)
    assert shown(page) == (0, []), "its room is not the present one"
    page._undo()


@pytest.mark.slow
def test_a_run_is_played_to_its_end(ended):
    page = page_of(ended)
    page.runs.choose(1)
    page.time._play()
    seen = []
    for _ in range(1000):
        if not page.document.periodic:
            break
        page.document.periodic[0]()
        seen.append(page.time.slider.value)
    assert seen == sorted(seen)
    assert seen[-1] == 6.0
    assert 150 < len(seen) < 250, "20 s, whatever the run's length"


def test_a_run_that_goes_on_is_seen_at_earlier_times(tmp_path):
    (tmp_path / "small.yaml").write_text(TEXT)
    page = page_of(tmp_path)
    run = Run(1, tmp_path / "runs", TEXT, scene=page.scene)
    run.process = SimpleNamespace(poll=lambda: None)  # type: ignore[assignment]
    page.workplace.runs.append(run)
    times = np.linspace(0, 9, 10)
    way = np.stack([np.linspace(1, 2, 10), np.full(10, 0.5)])
    readings = np.stack([times, times**2], axis=1)
    for n, t in enumerate(times.tolist()):
        sight = sight_at(t)._replace(trails=[way[:, : n + 1]], readings=readings[: n + 1])
        run.see(sight)
    page.look()
    assert (page.time.slider.start, page.time.slider.end) == (0.0, 9.0)
    page.time.slider.value = 4.4
    assert page.runs.sight.t == 4.0
    xs = page.canvases[ABOVE].sources["trails"].data["xs"]
    assert xs[0] == pytest.approx(way[0, :5])
    assert page.runs.curves.data["xs"][0] == pytest.approx(times), "the readings up to now"
    page.time.choose(None)
    assert page.runs.sight.t == 9.0


@pytest.fixture(scope="module")
def two(ended) -> Path:
    """Two runs of a folder, the second with ten times the gas."""
    other = TEXT.replace("rate: 5 mg/s", "rate: 50 mg/s")
    tp.simulate(tp.Scenario.from_dict(yaml.safe_load(other)), out=ended / "runs" / "small-2", progress=False)
    return ended


@pytest.mark.slow
def test_runs_of_the_folder_are_listed_compared_taken_and_deleted(two, tmp_path):
    shutil.copytree(two, tmp_path / "place")
    page = page_of(tmp_path / "place")
    assert [run.folder.name for run in page.workplace.runs] == ["small-1", "small-2"]
    assert page.runs.rows.data["name"] == ["small-2", "small-1"]
    page.workplace.watch()
    spent = tp.open_run(page.workplace.runs[0].folder).result["wall_s"]
    assert page.workplace.runs[0].row()["took"] == f"{spent:.0f} s", "not the time since the page was opened"
    assert page.workplace.runs[1].changes.endswith("rate: 5 mg/s → 50 mg/s")
    page.runs.choose(2)
    page.time.choose(4.0)
    page.runs.other.value = "1"
    picture = page.runs.picture
    ten, one = (Past(run.folder).at(4.0).pictures["gas_slice"].values for run in page.workplace.runs[::-1])
    well = (one > 0.2) & (ten < 1000)
    ten, one = ten[well], one[well]
    assert np.count_nonzero(well) > 20
    assert picture.values[well] == pytest.approx(np.log10(ten / one), abs=1e-5)
    assert picture.values[well] == pytest.approx(1.0, abs=0.01), "ten times the gas"
    assert picture.scale.kind == "linear"
    assert "decades" in page.hint.text
    assert len(page.runs.dashed.data["xs"]) == 2
    page.runs._take()
    assert "rate: 50 mg/s" in page.workplace.text
    assert "diffusivity" not in page.workplace.text, "no defaults"
    assert page.scene.data["gas"]["sources"][0]["position"] == ["0.4 m", "0.5 m"]
    page.runs._remove()
    assert "small-2" in page.banner.text
    page._yes()
    assert not (tmp_path / "place/runs/small-2").exists()
    assert page.runs.rows.data["name"] == ["small-1"]
    assert page.workplace.run_of(2) is None
    assert (tmp_path / "place/runs/small-1").exists()
    assert len(page.workplace.runs) == 2, "numbers stay"


@pytest.mark.slow
def test_two_runs_are_seen_side_by_side_on_the_same_scales(two):
    page = page_of(two)
    above, beside = page.canvases[ABOVE], page.runs.beside
    page.runs.choose(2)
    page.time.choose(4.0)
    page.runs.other.value = "1"
    assert not beside.figure.visible
    page.runs.way.value = "side by side"
    assert beside.figure.visible
    one, ten = (Past(run.folder).at(4.0) for run in page.workplace.runs)
    for canvas, moment in ((above, ten), (beside, one)):
        picture = canvas._beside[2]
        np.testing.assert_array_equal(picture.values, moment.pictures["gas_slice"].values)
        assert picture.scale == ten.pictures["gas_slice"].scale
        assert canvas.bar.title.startswith("ethanol")
        assert canvas.sources["robots"].data["x"] == pytest.approx(list(moment.robots[0]))
        lines = canvas.sources["wind"].data
        drawn = np.hypot(*(np.subtract(lines[f"{d}1"], lines[f"{d}0"]) for d in "xy"))
        assert drawn == pytest.approx(above.arrow * np.hypot(*moment.wind()[2:])), "m per m/s"
    assert (beside.figure.x_range, beside.figure.y_range) == (above.figure.x_range, above.figure.y_range)
    assert len(beside.sources["areas"].data["xs"]) == len(above.sources["areas"].data["xs"]) > 0, "its room"
    assert (above.figure.title.text, beside.figure.title.text) == ("run 2", "run 1")
    page.time.choose(2.0)
    past = Past(page.workplace.runs[0].folder)
    np.testing.assert_array_equal(
        beside._beside[2].values, past.at(2.0).pictures["gas_slice"].values, "the slider moves both"
    )
    page.runs.other.value = ""
    assert not beside.figure.visible
    assert above.figure.title.text == ""


def test_another_quantity_has_a_difference_of_its_own(tmp_path):
    (tmp_path / "small.yaml").write_text(TEXT)
    page = page_of(tmp_path)
    for number in (1, 2):
        run = Run(number, tmp_path / "runs", TEXT, scene=page.scene)
        run.process = SimpleNamespace(poll=lambda: None)  # type: ignore[assignment]
        page.workplace.runs.append(run)
        run.see(sight_at(1.0))
    page.look()
    page.runs.other.value = "1"
    assert page.runs.picture.unit == "decades"
    page.runs.quantity.value = "temperature_slice"
    assert page.runs.picture.unit == "K"


@pytest.mark.slow
def test_a_row_that_is_clicked_is_the_run_that_is_shown_named_and_pinned(two, tmp_path):
    shutil.copytree(two, tmp_path / "place")
    page = page_of(tmp_path / "place")
    panel = page.runs
    panel.rows.selected.indices = [1]
    assert (panel.number, panel.title.placeholder) == (1, "small-1")
    assert page.time.slider.value == 6.0
    panel.title.value = "first"
    panel.pin.active = True
    assert panel.rows.data["name"] == ["★ first", "small-2"], "pinned runs come first"
    assert panel.rows.selected.indices == [0]
    assert panel.remove.disabled
    panel.rows.selected.indices = [1]
    assert (panel.number, panel.title.value, panel.pin.active) == (2, "", False)
    assert [run.label for run in page.workplace.runs] == [("first", True), ("", False)], "each has its own"
    assert not panel.remove.disabled
    assert list(panel.rows.data["state"]) == ["completed", "completed"]
    again = Page(Clock(), Workplace(tmp_path / "place")).runs.rows
    assert list(again.data["name"]) == ["★ first", "small-2"]


def test_no_run_is_removed_elsewhere(tmp_path):
    (tmp_path / "room").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "room/small.yaml").write_text(TEXT)
    work = Workplace(tmp_path / "room", tmp_path / "room/small.yaml")
    (tmp_path / "room/link").symlink_to(tmp_path / "elsewhere")
    for folder in (tmp_path / "elsewhere", tmp_path / "room/link"):
        with pytest.raises(InputError, match=f"^{folder.name}: is not removed"):
            work.discard(Run(1, folder, TEXT))
    assert (tmp_path / "elsewhere").is_dir()


def test_a_run_beside_another_is_asked_about(tmp_path, monkeypatch):
    (tmp_path / "small.yaml").write_text(TEXT)
    page = page_of(tmp_path)
    started = []
    monkeypatch.setattr(page.runs, "start", lambda text, kind: started.append(text))
    page.run()
    assert started == [TEXT]
    run = Run(1, tmp_path / "runs", TEXT, scene=page.scene)
    run.process = SimpleNamespace(poll=lambda: None)  # type: ignore[assignment]
    page.workplace.runs.append(run)
    page.run()
    assert "Run 1 goes on" in page.banner.text
    assert len(started) == 1
    page._no()
    assert len(started) == 1
    page.run()
    page._yes()
    assert len(started) == 2
