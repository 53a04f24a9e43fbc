"""Movies whose files state axes, units, packing and missing values: what is read equals what xarray reads."""

from datetime import datetime

import h5py
import numpy as np
import pytest
import xarray
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taichi_plume.files.film import FilmError
from taichi_plume.files.movie import Movie
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.playback import MovieGas

SHAPE = {"time": 4, "y": 3, "x": 6}
LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 0.01, "km": 1e3}
GASES = {"ppm": 1.0, "ppb": 1e-3, "%": 1e4, "1e-9": 1e-3}


def movie(path, **keys) -> Movie:
    model = MovieGas.model_validate({"kind": "movie", "file": path.name, **keys})
    return Movie(path, model, Domain(size=(2, 1), spacing=0.1))


def ppm(one: Movie, n: int) -> np.ndarray:
    """Frame n in ppm, with the gas's own factor."""
    return one.picture(n) * one.model.density_per_unit * one.model.vapour.ppm_per_density


def plume(signs=(1, 1), pixel=0.1, corner=(0.35, -0.2), start=0.0) -> xarray.Dataset:
    """A plume on coordinates [m, s] of pixel centres, which ascend or descend."""
    axes = {
        "time": start + 0.5 * np.arange(SHAPE["time"]),
        "y": (corner[1] + pixel * (np.arange(SHAPE["y"]) + 0.5))[:: signs[1]],
        "x": (corner[0] + pixel * (np.arange(SHAPE["x"]) + 0.5))[:: signs[0]],
    }
    values = np.random.default_rng(5).uniform(1, 90, tuple(SHAPE.values())).round(2)
    return xarray.Dataset({"gas": (tuple(SHAPE), values)}, axes)


FORMATS = {
    "netcdf4": lambda data, path, coding: data.to_netcdf(path, engine="h5netcdf", encoding=coding),
    "netcdf3": lambda data, path, coding: data.to_netcdf(path, engine="scipy", encoding=coding),
    "zarr2": lambda data, path, coding: data.to_zarr(
        path, encoding=coding, zarr_format=2, consolidated=False
    ),
    "zarr3": lambda data, path, coding: data.to_zarr(
        path, encoding=coding, zarr_format=3, consolidated=False
    ),
}


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    form=st.sampled_from(sorted(FORMATS)),
    order=st.permutations(list(SHAPE)),
    signs=st.tuples(st.sampled_from([1, -1]), st.sampled_from([1, -1])),
    length=st.sampled_from(sorted(LENGTHS)),
    unit=st.sampled_from(sorted(GASES)),
    packing=st.sampled_from(
        [{}, {"dtype": "i2", "scale_factor": 0.01, "add_offset": 50.0, "_FillValue": -7}]
    ),
    names=st.sampled_from([("time", "y", "x"), ("t", "northing", "easting"), ("a", "b", "c")]),
)
def test_what_files_state_counts(tmp_path_factory, form, order, signs, length, unit, packing, names):
    path = tmp_path_factory.mktemp("m") / "plume.nc"
    data = plume(signs)
    holes = data["gas"].copy(data=np.where(data["gas"] > 80, np.nan, data["gas"])) if packing else data["gas"]
    truth = holes.transpose("time", "x", "y").sortby(["x", "y"]).fillna(0.0)
    stored = data.assign(gas=holes.transpose(*order)).assign_coords(
        x=data["x"] / LENGTHS[length], y=data["y"] / LENGTHS[length], time=data["time"] * 1e3
    )
    for axis, letter in zip(SHAPE, "TYX", strict=True):
        stored[axis].attrs = {"units": "ms" if axis == "time" else length, "axis": letter}
    stored["gas"].attrs["units"] = unit
    FORMATS[form](stored.rename(dict(zip(SHAPE, names, strict=True))), path, {"gas": packing})
    one = movie(path)
    np.testing.assert_allclose(one.times, data["time"] - data["time"][0], atol=1e-9)
    np.testing.assert_allclose([one.pixel, *one.origin], [0.1, 0.35, -0.2], rtol=1e-6, atol=1e-7)
    for n in range(SHAPE["time"]):
        np.testing.assert_allclose(ppm(one, n), GASES[unit] * truth[n], rtol=1e-6, atol=1e-4)
    facts = one.facts()
    assert ("descending" if signs[1] < 0 else "ascending") in facts.text
    assert ("missing" in " ".join(facts.remarks)) == bool(packing)


def test_dates_and_masses(tmp_path):
    data = plume(start=3.0)
    data["time"].attrs["units"] = "seconds since 2026-01-01 10:00:00"
    data["gas"].attrs["units"] = "mg m-3"
    data.to_netcdf(tmp_path / "p.nc", engine="h5netcdf")
    one = movie(tmp_path / "p.nc", species="methane")
    assert one.begin == datetime.fromisoformat("2026-01-01T10:00:03+00:00").timestamp()
    assert "1.5 s from 2026-01-01 10:00:03 UTC on, 0.5 s apart" in one.facts().text
    moles = 1e-6 * data["gas"][0].values.T / 0.016043  # mol/m3 of methane, in 40.87 mol/m3 of air at 25 degC
    np.testing.assert_allclose(ppm(one, 0), 1e6 * moles / (101325 / 8.314462618 / 298.15), rtol=2e-3)


def test_keys_that_contradict_the_file_are_remarked(tmp_path):
    data = plume()
    data["gas"].attrs["units"] = "ppb"
    data.to_netcdf(tmp_path / "p.nc", engine="h5netcdf")
    one = movie(tmp_path / "p.nc", ppm_per_unit=40, pixel="5 cm", frame_rate=4)
    assert (one.pixel, one.times[1]) == (0.05, 0.25)
    np.testing.assert_allclose(ppm(one, 0), 1e-3 * data["gas"][0].T)
    remarks = " ".join(one.facts().remarks)
    for part in (
        "pixel: 0.05 m, but the file states 0.1 m",
        "frame_rate: 4",
        "ppm_per_unit: 40, but the file states 'ppb'",
    ):
        assert part in remarks


def test_arrays_without_names_get_those_of_coordinates_beside_them(tmp_path):
    values = plume()["gas"].values
    with h5py.File(tmp_path / "p.h5", "w") as file:
        run = file.create_group("Runs/second")
        run["odour"] = values.transpose(2, 0, 1)  # x, time, y
        run["x"], run["y"] = 100.0 * (np.arange(6) + 0.5), 100.0 * np.arange(3)[::-1] + 50
        run["t"] = np.arange(4) / 2
        run["x"].attrs["units"] = run["y"].attrs["units"] = "mm"
    one = movie(tmp_path / "p.h5")
    assert (one.pixel, one.origin) == (pytest.approx(0.1), (pytest.approx(0.0), pytest.approx(0.0)))
    np.testing.assert_array_equal(one.picture(1), values[1, ::-1].T)
    assert movie(tmp_path / "p.h5", variable="Runs/second/odour").shape == (4, 3, 6)
    with pytest.raises(FilmError, match=r"no 'odour'.*Runs/second/odour"):
        movie(tmp_path / "p.h5", variable="odour")


def test_matlab_has_its_axes_in_reverse(tmp_path):
    """save -v7.3 of C(y, x, t): HDF5 behind a block of 512 bytes, its axes reversed."""
    values = plume()["gas"].values
    with h5py.File(tmp_path / "p.mat", "w", userblock_size=512) as file:
        file["C"] = values.transpose(0, 2, 1)
        file["C"].attrs["MATLAB_class"] = np.bytes_("double")
    with open(tmp_path / "p.mat", "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")
    one = movie(tmp_path / "p.mat", pixel=0.1, frame_rate=2)
    np.testing.assert_array_equal(one.picture(2), values[2].T)
    turned = movie(tmp_path / "p.mat", pixel=0.1, frame_rate=2, axes=["x", "y", "time"])
    np.testing.assert_array_equal(turned.picture(2), values[2])


def test_axes_that_no_movie_has_are_refused(tmp_path):
    data = plume()
    cases = {
        "its y is not equally spaced": data.assign_coords(y=[0.0, 0.1, 0.4]),
        "pixels are 0.2 by 0.1 m": data.assign_coords(x=0.2 * np.arange(6)),
        "'degrees_east' is no unit": data.assign_coords(x=data["x"].assign_attrs(units="degrees_east")),
        "its times are not 4 ascending": data.assign_coords(time=[0.0, 1.0, 0.5, 2.0]),
        r"axes \(time: 4, z: 3, x: 6\)": data.rename(y="z"),
    }
    for n, (said, wrong) in enumerate(cases.items()):
        wrong.to_netcdf(tmp_path / f"{n}.nc", engine="h5netcdf")
        with pytest.raises(FilmError, match=said):
            movie(tmp_path / f"{n}.nc")
    data.expand_dims(height=[1.2], axis=1).to_netcdf(tmp_path / "one_level.nc", engine="h5netcdf")
    np.testing.assert_array_equal(movie(tmp_path / "one_level.nc").picture(3), data["gas"][3].T)
