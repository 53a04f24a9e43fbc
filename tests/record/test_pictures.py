"""Pictures and arrows of a recorded plume, read back from the file."""

from pathlib import Path
from typing import Any

import fake_run
import numpy as np
import pytest
import recordings
from recordings import stream

from taichi_plume.assembly.assemble import assemble
from taichi_plume.grid.fields import Gas, Mixture
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.time_loop import TimeLoop

pytestmark = pytest.mark.usefixtures("taichi")


class Cells(fake_run.FakeGas):
    """A gas of which every cell is known: ppm(t) of the grid's shape."""

    finer_than_cells = False

    def __init__(self, sim: TimeLoop, ppm: np.ndarray):
        super().__init__(sim.grid, (0.0, 0.0, 0.0))
        self.density = ppm / self.species.ppm_per_density

    def cells(self, t: float) -> np.ndarray:
        return self.density


def recorded(sim: TimeLoop, path: Path) -> dict[str, dict[str, Any]]:
    """Return static and last values of all entities of the run's recording, by component."""
    found: dict[str, dict[str, Any]] = {}
    for chunk in stream(recordings.recorded(sim, path)):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            values = [value for value in batch.column(name).to_pylist() if value is not None]
            if values:
                found.setdefault(chunk.entity_path, {})[name] = values[-1]
    return found


def ppm(entity: dict[str, Any]) -> np.ndarray:
    """Return a picture decoded by its static values, (first axis, second axis)."""
    form = entity["GridMap:format"][0]
    pixels = np.array(entity["GridMap:data"][0], np.uint8).reshape(form["height"], form["width"])[::-1].T
    (low,), (high,), (scale,) = entity["low"], entity["high"], entity["scale"]
    if scale == "log":
        return np.where(pixels == 0, 0.0, low * (high / low) ** (pixels / 255))
    return low + (high - low) * pixels / 255


def run_of(cells: np.ndarray | None = None, **changes: Any) -> TimeLoop:
    base = {"duration": 1, "robots": [], "maps": [], "obstacles": []}
    sim = fake_run.simulation(fake_run.scenario(3, **(base | changes)))
    if cells is not None:
        gases: list[Gas] = [Cells(sim, cells)]
        sim.gas = Mixture(gases)
    return sim


STEP = np.log(1e4) / 255
SHAPE = (80, 60, 10)


def test_a_plume_away_from_the_slice_is_seen(tmp_path):
    cells = np.zeros(SHAPE)
    cells[30, 20, 7] = 500.0
    found = recorded(
        run_of(cells, recording={"slice_height": 0.1, "section": {"at": 1.025}}), tmp_path / "a.rrd"
    )
    assert ppm(found["/gas/slice"]).max() == 0
    for name, place in (("column", (30, 20)), ("section", (30, 7))):
        picture = ppm(found[f"/gas/{name}"])
        assert np.argwhere(picture).tolist() == [list(place)]
        assert np.log(picture[place] / 500) == pytest.approx(0, abs=0.5 * STEP + 1e-5)
    values = found["/gas/volume"]["Volume3D:values"][0]
    shape = list(values["shape"])
    volume = np.array(values["buffer"], float).reshape(shape)
    assert np.argwhere(volume > 0).tolist() == [[3, 10, 15]]  # z, y, x of the voxels of 2³ cells
    assert 0.1 * 1e4 ** volume.max() == pytest.approx(500, rel=0.5 * STEP + 2e-3)


def test_what_only_points_know_is_where_it_is_on_all_planes(tmp_path):
    found = recorded(run_of(), tmp_path / "a.rrd")  # a closed form, its source at (0.6, 1.5, 0.1) m
    for name in ("slice", "column", "section"):
        entity = found[f"/gas/{name}"]
        i, k = np.unravel_index(ppm(entity).argmax(), ppm(entity).shape)
        (cell,) = entity["GridMap:cell_size"]
        axes = "xz" if name == "section" else "xy"
        place = {letter: (n + 0.5) * cell for letter, n in zip(axes, (i, k), strict=True)}
        for letter, at in zip("xyz", (0.6, 1.5, 0.1), strict=True):
            assert abs(place.get(letter, at) - at) < 1.6 * cell
        assert ppm(entity).max() > 220
    assert np.all(ppm(found["/gas/column"]) >= ppm(found["/gas/slice"]))


def test_static_values_tell_what_pictures_are(tmp_path):
    found = recorded(run_of(np.full(SHAPE, 20.0), recording={"range_ppm": [0.5, 50]}), tmp_path / "a.rrd")
    entity = found["/gas/section"]
    expected = {"quantity": ["ethanol"], "unit": ["ppm"], "low": [0.5], "high": [50.0], "scale": ["log"]}
    expected |= {"plane": ["y = 1.5 m"], "GridMap:cell_size": [pytest.approx(0.05)]}
    assert {name: entity[name] for name in expected} == expected
    assert found["/gas/slice"]["plane"] == ["0.1 m above the floor"]
    assert found["/gas/column"]["plane"] == ["maximum over the height"]
    for name in ("slice", "column", "section"):
        assert ppm(found[f"/gas/{name}"]) == pytest.approx(20, rel=np.log(100) / 510 + 1e-5)


WARM = {"reference": 295, "walls": [{"face": "x-", "temperature": 300, "transfer": 300}]}
HEATED = {
    "name": "heated",
    "duration": 0.5,
    "tick": 0.1,
    "domain": {"size": [1.0, 0.8, 0.6], "spacing": 0.1},
    "wind": {"kind": "cfd", "buoyancy": {"heat": WARM}},
    "gas": {"kind": "eulerian", "sources": [{"position": [0.5, 0.4, 0.1], "rate": 1e-7}]},
}


@pytest.mark.slow
def test_temperature_is_recorded_where_it_is_solved_for(tmp_path):
    sim = assemble(Scenario.model_validate(HEATED))
    found = recorded(sim, tmp_path / "a.rrd")
    theta = sim.grid.read(sim.wind.heat.theta) + 295
    section = ppm(found["/temperature/section"])
    expected = (theta[:, 3] + theta[:, 4]) / 2  # y = 0.4 m is between these
    (low,), (high,) = found["/temperature/section"]["low"], found["/temperature/section"]["high"]
    assert (low, high) == pytest.approx((295, 300))
    assert expected.max() > 295.1
    assert section == pytest.approx(expected, abs=(high - low) / 510 + 1e-4)
    assert found["/temperature/slice"]["unit"] == ["K"]
    assert "/temperature/column" not in found


def test_arrows_are_in_proportion_to_the_speed(tmp_path):
    found = recorded(run_of(), tmp_path / "a.rrd")
    for name, axes in (("slice", (0, 1)), ("section", (0, 2))):
        arrows = found[f"/wind/{name}"]
        vectors, origins = (np.array(arrows[f"Arrows3D:{part}"]) for part in ("vectors", "origins"))
        (key,) = found[f"/legend/wind/{name}/text"]["Points3D:labels"]
        (length,) = np.linalg.norm(found[f"/legend/wind/{name}/arrow"]["Arrows3D:vectors"], axis=-1)
        speed = float(key.removesuffix(" m/s"))
        y = (origins + vectors / 2)[:, 1] / 3
        along = 0.9 * 4 * y * (1 - y)  # the fake wind's first component
        tolerance = 0.02 if name == "slice" else 0.03
        assert vectors[:, 0] / length * speed == pytest.approx(along, abs=tolerance)
        assert np.all(vectors[:, [d for d in range(3) if d not in axes]] == 0)
