"""A quantity of one function in QUANTITIES, a closed form of position and time, is in every file of a run."""

from collections.abc import Iterator

import h5py
import numpy as np
import pytest
import xarray
import yaml

from taichi_plume.cli import run as command
from taichi_plume.observed import quantities
from taichi_plume.observed.quantities import Quantity, Rounded
from taichi_plume.observed.scales import Scale
from taichi_plume.results.export import export
from taichi_plume.results.run import open_run
from taichi_plume.time_loop import TimeLoop

pytestmark = pytest.mark.usefixtures("taichi")
ROOM = {
    "duration": "1 s",
    "domain": {"size": [2, 1], "spacing": 0.1},
    "wind": {"kind": "synthetic", "speed": 0.3},
    "gas": {"kind": "eulerian", "sources": [{"position": [0.4, 0.4], "rate": "50 mg/s"}]},
    "recording": {"rate": 2, "wind_rate": 1, "range_ppm": [0.1, 100]},
    "fields": {"rate": 2},
}  # fmt: skip


def dose(x, y, t):
    return x + 2 * y + 3 * t + 10


def of_position(sim: TimeLoop) -> Iterator[Quantity]:
    x, y = np.moveaxis(sim.grid.centers(), -1, 0)
    yield Quantity(
        "dose", "dose", "1", Scale(0.0, 20.0, "linear"), "turbo", lambda sim: dose(x, y, sim.t).astype(np.float32),
        None, Rounded(), in_cells="dose", meaning="dose of light",
    )  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory, taichi):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(quantities, "QUANTITIES", [*quantities.QUANTITIES, of_position])
        folder = tmp_path_factory.mktemp("run")
        (folder / "room.yaml").write_text(yaml.safe_dump(ROOM), encoding="utf-8")
        arguments = [str(folder / "room.yaml"), "--out", str(folder / "a"), "--quiet", "--no-report"]
        assert command.main(arguments) == 0
        return open_run(folder / "a")


def expected(data: xarray.Dataset) -> xarray.DataArray:
    return dose(data["x"], data["y"], data["time"]).transpose("time", "y", "x")


def test_it_is_in_the_film(run):
    of = run.fields["dose"]
    assert (of.attrs["units"], of.attrs["long_name"]) == ("1", "dose of light")
    assert run.fields.sizes["time"] == 3
    np.testing.assert_allclose(of, expected(run.fields), rtol=1e-6)


def test_it_is_in_the_exports_of_the_film(run, tmp_path):
    export(run, "netcdf", tmp_path / "film.nc")
    with xarray.open_dataset(tmp_path / "film.nc") as data:
        np.testing.assert_allclose(data["dose"], expected(data), rtol=1e-6)
    export(run, "vtkhdf", tmp_path / "film.vtkhdf")
    with h5py.File(tmp_path / "film.vtkhdf") as file:
        cells = np.asarray(file["VTKHDF/CellData/dose"])[:, 0]
    np.testing.assert_allclose(cells, expected(run.fields), rtol=1e-6)


def test_it_is_in_the_export_of_the_pictures(run, tmp_path):
    export(run, "netcdf", tmp_path / "pictures.nc", "recording")
    with xarray.open_dataset(tmp_path / "pictures.nc") as data:
        of = data["dose_slice"]
        assert (of.dtype, of.attrs["units"]) == (np.float32, "1")
        np.testing.assert_allclose(of, expected(data), rtol=of.attrs["relative_precision"])
        gas = data["gas_slice"]
        assert gas.dtype == np.float32
        np.testing.assert_array_equal(gas, run.pictures["gas_slice"])
        assert gas.max() > 1.0


def test_the_wind_is_in_the_export_of_the_pictures(run, tmp_path):
    export(run, "netcdf", tmp_path / "pictures.nc", "recording")
    with xarray.open_dataset(tmp_path / "pictures.nc") as data:
        assert (data.sizes["time"], data.sizes["time_wind"]) == (3, 2)
        winds = run.winds
        for name in ("u_slice", "v_slice"):
            assert (data[name].dtype, data[name].attrs["units"]) == (np.float32, "m s-1")
            np.testing.assert_array_equal(data[name], winds[name])
        np.testing.assert_allclose(data["x_wind"], winds["x"])
        assert abs(data["u_slice"]).max() > 0.1
