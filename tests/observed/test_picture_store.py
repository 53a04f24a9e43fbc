"""Values that an observer stores are those of the solver, within the stated precision, also after a kill."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

import taichi_plume as tp
from taichi_plume.files import pictures_file
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.grid import fields
from taichi_plume.observed import quantities
from taichi_plume.observed.observer import Observer
from taichi_plume.observed.quantities import MISSING, Quantity, Rounded, Stepped
from taichi_plume.observed.scales import Scale
from taichi_plume.observed.store import PictureStore
from taichi_plume.observed.views import views
from taichi_plume.time_loop import TimeLoop

pytestmark = pytest.mark.usefixtures("taichi")
ROOM = {
    "duration": 2,
    "tick": 0.1,
    "domain": {"size": [2, 1.5, 0.5], "spacing": 0.125},
    "wind": {"kind": "synthetic"},
    "obstacles": [{"kind": "box", "center": [1.4375, 0.9375, 0.125], "size": [0.375, 0.375, 0.25]}],
    "gas": {"kind": "eulerian", "sources": [{"position": [0.6, 0.7, 0.2], "rate": "5 mg/s", "radius": 0.1}]},
    "recording": {"rate": 5, "wind_rate": 1},
}


@pytest.mark.parametrize("digits", [5, 7, 10])
def test_rounded_values_are_as_precise_as_stated(digits):
    storage = Rounded(digits, 16.0, 0.05)
    values = np.geomspace(1e-3, 2e6, 100_000).astype(np.float32)
    packed = storage.packed(values)
    assert packed.dtype == np.float16
    about = storage.attributes
    found = packed.astype(float) * about["scale_factor"]
    expected = np.minimum(values, about["largest_value"])
    assert np.all(
        abs(found - expected) <= 1.0001 * about["relative_precision"] * expected + about["absolute_precision"]
    )
    np.testing.assert_array_equal(storage.packed(values.astype(float)), packed)
    known = (values > 0.1) & (values < about["largest_value"])
    error = abs(found - values)[known] / values[known]
    assert 0.9 * 2.0 ** -(digits + 1) < error.max() <= about["relative_precision"]
    assert len(np.unique(packed)) < 40 * 2**digits, "only so many digits are kept"
    assert np.isnan(storage.packed(np.array([np.nan], np.float32))).all()
    assert Rounded().packed(np.array([-0.25, 0.5], np.float32)).tolist() == [-0.25, 0.5]


def test_steps_are_as_precise_as_stated():
    storage = Stepped(0.01, 293.0)
    values = np.array([280.004, 293.0, 400.0, np.nan, 1e4], np.float32)
    packed = storage.packed(values)
    assert packed[3] == MISSING
    found = packed * storage.attributes["scale_factor"] + storage.attributes["add_offset"]
    assert found[:3] == pytest.approx(values[:3], abs=storage.attributes["absolute_precision"] + 1e-4)
    assert found[4] == pytest.approx(storage.attributes["largest_value"])


def recorded(sim: TimeLoop, folder: Path) -> PictureStore:
    observer = Observer(sim, views(sim))
    store = PictureStore(observer, folder / "pictures.zarr", {"title": "a room"})
    sim.observers += observer.observers()
    store.start()
    return store


def test_stored_values_are_those_of_the_solver(tmp_path):
    sim = tp.Simulation(ROOM).loop
    store = recorded(sim, tmp_path)
    cells: dict[float, np.ndarray] = {}
    while not sim.finished:
        sim.step()
        (gas,) = sim.gas.gases
        cells[round(sim.t, 6)] = np.asarray(gas.cells(sim.t)) * gas.species.ppm_per_density
    sim.observe(force=True)
    store.close()
    data = pictures_file.read(tmp_path / "pictures.zarr")
    assert data.time.values == pytest.approx(np.arange(0, 2.01, 0.2))
    ppm, solid = cells[2.0], sim.air.solid
    below, above = ppm[:, :, 1], ppm[:, :, 2]  # z = 0.2 m is 0.1 of a cell above the middle of layer 1
    share = (0.2 / 0.125 - 1.5) * np.ones(below.shape)
    share = np.where(solid[..., 1], 1.0, np.where(solid[..., 2], 0.0, share))
    expected = {"gas_slice": below + share * (above - below), "gas_column": ppm.max(axis=2)}
    for name, values in expected.items():
        found = data[name][-1].transpose("x", "y")
        about = found.attrs
        closed = solid.all(axis=2) if name == "gas_column" else solid[..., 1] & solid[..., 2]
        assert np.array_equal(np.isnan(found), closed)
        precision = {"rtol": about["relative_precision"] + 1e-5, "atol": about["absolute_precision"]}
        np.testing.assert_allclose(found.values[~closed], values[~closed], **precision)
        assert np.nanmax(values) > 100 * about["absolute_precision"]
    air = pictures_file.read(tmp_path / "pictures.zarr", "wind")
    assert air.time.values == pytest.approx([0, 1, 2])
    (x, y), z = np.meshgrid(air.x, air.y, indexing="ij"), air.u_slice.level
    points = np.stack([x, y, np.full_like(x, z)], axis=-1)
    velocity = fields.velocity_at(sim.wind, points, sim.t)
    for n, name in enumerate(("u_slice", "v_slice", "w_slice")):
        about = air[name].attrs
        precision = {"rtol": about["relative_precision"], "atol": about["absolute_precision"] + 1e-6}
        np.testing.assert_allclose(air[name][-1].transpose("x", "y"), velocity[..., n], **precision)


def test_xarray_opens_the_store_by_itself(tmp_path):
    sim = tp.Simulation(ROOM).loop
    store = recorded(sim, tmp_path)
    sim.run()
    store.close()
    with xarray.open_zarr(tmp_path / "pictures.zarr", chunks=None) as data:
        ours = pictures_file.read(tmp_path / "pictures.zarr")
        assert data.gas_slice.dims == ("time", "y", "x")
        assert data.gas_slice.units == "ppm"
        xarray.testing.assert_equal(data, ours)


class Step:
    """A simulation whose time is set by hand."""

    t = 0.0


@pytest.mark.parametrize("counts", [(0, 0), (3, 3), (5, 5), (70, 64), (140, 140)])
def test_a_store_that_is_resumed_equals_one_that_was_not_interrupted(tmp_path, monkeypatch, counts):
    """counts: pictures before the last flush, and of these before the resumption."""
    monkeypatch.setattr("taichi_plume.observed.store.LONGEST", 64)
    sim = tp.Simulation(ROOM).loop

    def made(name: str) -> tuple[Observer, PictureStore]:
        observer = Observer(sim, views(sim))
        (tmp_path / name).mkdir(exist_ok=True)
        return observer, PictureStore(observer, tmp_path / name / "pictures.zarr", {})

    def show(store: PictureStore, n: int) -> None:
        shape = {view.name: (len("uvw") if view.part else 1, n) for view in observer.views}
        step: Any = Step()
        step.t = float(n)
        frame = observer.observe(sim)
        store.show(step, {name: values + (n if shape[name][0] == 1 else 0) for name, values in frame.items()})

    flushed, _ = counts
    observer, whole = made("whole")
    whole.start()
    for n in range(150):
        show(whole, n)
    whole.close()
    observer, cut = made("cut")
    cut.start()
    for n in range(flushed):
        show(cut, n)
    cut.flush()
    saved = dict(cut.frames)
    for n in range(flushed, min(flushed + 67, 150)):
        show(cut, n)  # lost, partly on the disk
    observer, again = made("cut")
    again.frames = saved
    again.resume()
    for n in range(flushed, 150):
        show(again, n)
    again.close()
    contents = []
    for folder in (tmp_path / "whole", tmp_path / "cut"):
        files = [file for file in folder.rglob("*") if file.is_file()]
        contents.append({str(file.relative_to(folder)): file.read_bytes() for file in files})
    assert contents[0].keys() == contents[1].keys()
    assert not [name for name in contents[0] if contents[0][name] != contents[1][name]]


def test_a_store_with_missing_pictures_cannot_go_on(tmp_path):
    sim = tp.Simulation(ROOM).loop
    store = recorded(sim, tmp_path)
    sim.run()
    store.close()
    observer = Observer(sim, views(sim))
    other = PictureStore(observer, tmp_path / "pictures.zarr", {})
    other.frames = {"": 100, "wind": 3}
    with pytest.raises(RunFolderError, match="11 of the first 100"):
        other.resume()


def dose(sim: TimeLoop) -> Iterator[Quantity]:
    """A made-up quantity: 1 + x + 2 y at all times."""

    def points(sim: TimeLoop, where: np.ndarray) -> np.ndarray:
        return (1 + where[..., 0] + 2 * where[..., 1]).astype(np.float32)

    yield Quantity(
        "dose", "dose", "1", Scale(0.0, 10.0, "linear"), "turbo", lambda sim: points(sim, sim.grid.centers()), None,
        Rounded(), in_cells="dose",
    )  # fmt: skip


def test_a_new_quantity_is_one_function(tmp_path, monkeypatch):
    """It is in the recording, the store, the report, live figures and notebooks."""
    monkeypatch.setattr(quantities, "QUANTITIES", [*quantities.QUANTITIES, dose])
    run = tp.simulate(ROOM, out=tmp_path / "run", progress=False)
    expected = (1 + run.pictures.x + 2 * run.pictures.y).transpose("y", "x")
    for name in ("dose_slice", "dose_column"):
        found = run.pictures[name][-1]
        np.testing.assert_allclose(found.where(found.notnull(), expected), expected, rtol=1e-3)
    assert b"dose" in (tmp_path / "run" / "recording.rrd").read_bytes()
    assert "Mean dose" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert run.plot(of="dose").axes[1].get_ylabel().startswith("dose [1]")
    with tp.Simulation(ROOM) as sim:
        assert sim.plot(of="dose").axes[1].get_ylabel().startswith("dose [1]")
        here = sim.fields.dose.isel(z=3)
        np.testing.assert_allclose(here, (1 + here.x + 2 * here.y).transpose("y", "x"), rtol=1e-6)


def test_a_view_is_written_at_a_rate_of_its_own(tmp_path):
    """Two ways to ask for the same: a key of the scenario and `write`; both equal the solver's layer of cells."""
    side = {"quantity": "gas", "plane": "yz", "at": 0.6875}  # at the middle of cells
    outputs = [side | {"name": "side", "rate": 2}, {"name": "air", "quantity": "wind", "rate": 1}]
    run = tp.simulate(ROOM | {"outputs": outputs}, out=tmp_path / "run", progress=False)
    with tp.Simulation(ROOM) as sim:
        sim.write(tmp_path / "side.zarr", 0.5, view=side)
        sim.run()
        (gas,) = sim.loop.gas.gases
        layer = (np.asarray(gas.cells(sim.t)) * gas.species.ppm_per_density)[5]
        solid = sim.loop.air.solid[5]
    found, written = run.output("side"), pictures_file.read(tmp_path / "side.zarr")
    xarray.testing.assert_equal(found.gas_side, written.gas_view.rename("gas_side"))
    assert found.time.values == pytest.approx([0, 0.5, 1, 1.5, 2])
    about = found.gas_side.attrs
    values = found.gas_side[-1].transpose("y", "z").values
    precision = {"rtol": about["relative_precision"] + 1e-5, "atol": about["absolute_precision"]}
    np.testing.assert_allclose(values[~solid], layer[~solid], **precision)
    assert {"u_air", "v_air", "w_air"} <= set(run.output("air"))
    assert "gas_side" not in run.pictures
    with pytest.raises(RunFolderError, match="no output 'top', but air, side, wind"):
        run.output("top")


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ({"quantity": "smoke"}, r"outputs\[0\].quantity: got 'smoke'; this run has gas, wind"),
        ({"quantity": "wind", "plane": "column"}, r"outputs\[0\].plane: wind"),
        ({"plane": "yz", "at": 3}, r"outputs\[0\].at: 3 m .* 0 to 2 m"),
        ({"name": "wind"}, r"outputs\[0\].name: 'wind'"),
        ({"name": "slice"}, r"outputs\[0\].name: 'slice'"),
        ({"name": "section_2"}, r"outputs\[0\].name: 'section_2'"),
        ({"name": "other"}, r"outputs\[0\].name: 'other' .* several"),
    ],
)
def test_a_view_that_cannot_be_is_refused_in_a_line(tmp_path, output, words):
    """Names that two views share would mix their pixels."""
    with pytest.raises(tp.InputError, match=words):
        tp.simulate(ROOM | {"outputs": [output, {"name": "other"}]}, out=tmp_path / "run", progress=False)
