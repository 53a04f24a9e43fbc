"""Movies whose files state axes, units, packing and missing values: what is read equals what xarray reads."""

import re
from datetime import datetime

import h5py
import numpy as np
import pytest
import xarray
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taichi_plume.files.conventions import ConventionError, role_of, stated_unit, times_of, unit_of, unpacked
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


@pytest.mark.parametrize(
    "attributes",
    [
        {"_FillValue": np.int16(-7), "scale_factor": 0.01, "add_offset": 5.0},
        {"_FillValue": np.int16(-1), "_Unsigned": "true", "scale_factor": np.float32(0.5)},
    ],
)
def test_packed_values_are_those_of_xarray(attributes):
    values = np.array([-7, -1, 0, 3, 32767], "i2")
    variable = xarray.Variable("n", values, dict(attributes))
    truth = xarray.conventions.decode_cf_variable("a", variable).values
    np.testing.assert_allclose(unpacked(values, attributes), truth, rtol=1e-6)
    narrow = unpacked(values, {**attributes, "valid_range": [0, 10]})
    np.testing.assert_array_equal(np.isnan(narrow), np.isnan(truth) | (values < 0) | (values > 10))
    with pytest.raises(ConventionError, match="valid_range has 1 values, not 2"):
        unpacked(values, {**attributes, "valid_range": [10]})


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


def assert_place(one, pixel=0.1, corner=(0.35, -0.2)):
    np.testing.assert_allclose([one.pixel, *one.origin], [pixel, *corner], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("form", sorted(FORMATS))
def test_packed_coordinates_count_as_xarray_reads_them(tmp_path, form):
    """Coordinates in mm and dates, packed into integers with offset and fill value."""
    data = plume().assign_coords(x=1e3 * plume()["x"], y=1e3 * plume()["y"], time=0.5 * np.arange(4))
    for name, unit in (("x", "mm"), ("y", "mm"), ("time", "seconds since 2026-1-1 0:0:7")):
        data[name].attrs["units"] = unit
    packing = {"dtype": "i2", "scale_factor": 50.0, "add_offset": -150.0, "_FillValue": -9}
    time = {"dtype": "i2", "scale_factor": 0.5, "add_offset": -4.0}
    path = tmp_path / "p"
    FORMATS[form](data, path, {"x": packing, "y": packing, "time": time})
    one = movie(path)
    assert_place(one)
    np.testing.assert_allclose(one.times, 0.5 * np.arange(4))
    assert one.begin == datetime.fromisoformat("2026-01-01T00:00:07+00:00").timestamp()


@pytest.mark.parametrize("form", sorted(FORMATS))
def test_bounds_and_auxiliary_coordinates_count(tmp_path, form):
    """Lower edges with CF bounds; x(i), y(j) and time(frame) along axes without coordinates of their own."""
    data = plume().isel(y=slice(None, None, -1))
    low = data.assign_coords(x=data["x"] - 0.05, y=data["y"] - 0.05)
    for name in "xy":
        low[f"{name}_bnds"] = ((name, "nv"), np.c_[data[name] - 0.05, data[name] + 0.05])
        low[name].attrs["bounds"] = f"{name}_bnds"
    FORMATS[form](low, tmp_path / "bounds", {})
    assert_place(movie(tmp_path / "bounds"))
    data["gas"] = data["gas"].transpose("time", "x", "y")
    along = {"x": "i", "y": "j", "time": "frame"}
    bare = data.drop_vars([*along]).rename(along)
    bare = bare.assign_coords({name: (axis, data[name].values) for name, axis in along.items()})
    FORMATS[form](bare, tmp_path / "along", {})
    one = movie(tmp_path / "along")
    assert_place(one)
    np.testing.assert_array_equal(one.picture(2), data["gas"][2].isel(y=slice(None, None, -1)))
    assert "axes time, x, y, " in one.facts().text


@pytest.mark.parametrize("form", sorted(FORMATS))
def test_files_without_coordinates_leave_the_keys(tmp_path, form):
    """xarray fills dimensions of NetCDF 4 without coordinates with zeros, which are none."""
    data = plume()
    FORMATS[form](data.drop_vars(["x", "y", "time"]), tmp_path / "p", {})
    one = movie(tmp_path / "p", pixel=0.2, frame_rate=4)
    assert (one.pixel, one.origin, one.times[1]) == (0.2, (0.0, 0.0), 0.25)
    np.testing.assert_array_equal(one.picture(1), data["gas"][1].T)
    text = one.facts().text
    assert "ascending (assumed)" in text
    assert "(assumed: m)" not in text


@pytest.mark.parametrize(
    ("names", "attributes", "file"),
    [
        ({"x": "x_mm", "y": "y_mm", "time": "time_ms"}, {}, {}),
        ({"x": "x [mm]", "y": "y [mm]", "time": "t [ms]"}, {}, {}),
        ({}, {"unit": "mm"}, {}),
        ({}, {"UNITS": "mm"}, {}),
        ({}, {"Units": np.array(["mm"], "S2")}, {}),
        ({}, {}, {"units": "mm"}),
        ({}, {}, {"coordinate_units": "mm"}),
        ({"x": "pos_x", "y": "pos_y"}, {}, {"physical_unit": b"mm"}),
    ],
)
def test_units_stand_in_attributes_names_or_the_file(tmp_path, names, attributes, file):
    data = plume()
    data = data.assign_coords(x=1e3 * data["x"], y=1e3 * data["y"], time=1e3 * data["time"])
    values = data["gas"].transpose("x", "time", "y").values
    with h5py.File(tmp_path / "p.h5", "w") as stored:
        stored["gas"] = values
        stored["gas"].attrs.create("units", ["ppb"], dtype=h5py.string_dtype())
        stored.attrs.update(file)
        for n, axis in enumerate(("x", "time", "y")):
            name = names.get(axis, axis)
            stored["gas"].dims[n].label = name
            stored[name] = data[axis]
            if axis != "time":
                stored[name].attrs.update(attributes)
            elif name == axis:
                stored[name].attrs["unit"] = b"ms"
    one = movie(tmp_path / "p.h5")
    assert_place(one)
    np.testing.assert_allclose(one.times, 0.5 * np.arange(4))
    np.testing.assert_allclose(ppm(one, 0), 1e-3 * values[:, 0], rtol=1e-6)
    assert "assumed" not in one.facts().text


@pytest.mark.parametrize(
    ("unit", "about", "factor"),
    [
        ("PPB", {}, 1e-3),
        ("PPM", {}, 1.0),
        ("umol/mol", {}, 1.0),
        ("m3/m3", {}, 1e6),
        ("1", {"long_name": "mole fraction of CO2"}, 1e6),
        ("1", {"standard_name": "volume_fraction_of_x"}, 1e6),
        ("mole fraction", {}, 1e6),
        ("1", {"long_name": "mass fraction"}, None),
        *(
            (unit, {}, None)
            for unit in ("1", "-", "dimensionless", "counts", "AU", "a.u.", "px", "dB", "kg/kg", "g/g")
        ),
        ("fraction", {}, None),
    ],
)
def test_only_units_of_concentration_are_converted(tmp_path, unit, about, factor):
    data = plume()
    data["gas"].attrs = {"Units": unit, **about}
    FORMATS["zarr3"](data, tmp_path / "p", {})
    one = movie(tmp_path / "p")
    np.testing.assert_allclose(ppm(one, 1), (factor or 1.0) * data["gas"][1].T, rtol=1e-6)
    facts = one.facts()
    assert ("(assumed: 1 ppm per unit)" in facts.text) == (factor is None)
    assert any(f"'{unit}'" in remark for remark in facts.remarks) == (factor is None)


@pytest.mark.parametrize(
    ("name", "attributes", "role"),
    [
        *(
            (name, {}, "x")
            for name in ("x_position", "xpos", "pos_x", "X coordinate", "x_coord", "xdim", "nx", "xx")
        ),
        *(
            (name, {}, "x")
            for name in ("x_m", "x [m]", "west_east", "width", "col_index", "grid/x", "x_edges")
        ),
        *((name, {}, "y") for name in ("y-position", "south_north", "row", "y_cm", "nrows")),
        *((name, {}, "time") for name in ("Time [s]", "time_ms", "frame_number", "Times", "nt")),
        ("bottom_top", {}, "z"),
        ("c", {"long_name": "y position"}, "y"),
        ("c", {"standard_name": "grid_longitude"}, "x"),
        ("y", {"axis": np.array([b"X"])}, "x"),
        *((name, {}, None) for name in ("", "position", "c", "text", "max", "index", "velocity_x_y")),
    ],
)
def test_roles_of_names(name, attributes, role):
    assert role_of(name, attributes) == role


def test_units_of_attributes():
    assert unit_of({"a": 1, "Unit": b" mm "}) == "mm"
    assert unit_of({"unit": "cm", "UNITS": np.array(["mm"])}) == "mm"
    assert unit_of({"units": ["a", "b"]}) == ""
    assert stated_unit({"x_unit": "mm", "n": "m"}, ("xy", "x")) == "mm"
    assert stated_unit({"max_unit": "mm"}, ("x",)) == ""


def test_heights_and_widths_and_the_key_of_axes(tmp_path):
    data = plume()
    turned = data.transpose("time", "x", "y")
    for name, axes, keys in (
        ("picture", {"x": "width", "y": "height"}, {}),
        ("known", {}, {"axes": ["time", "y", "x"]}),
        ("doubtful", {"x": "altitude", "y": "depth"}, {"axes": ["time", "x", "y"]}),
        ("unknown", {"x": "alpha", "y": "beta"}, {"axes": ["time", "x", "y"]}),
    ):
        FORMATS["netcdf4"](turned.rename(axes), tmp_path / name, {})
        one = movie(tmp_path / name, **keys)
        np.testing.assert_array_equal(one.picture(3), data["gas"][3].T, err_msg=name)
        assert ("axes: time" in " ".join(one.facts().remarks)) == (name in ("known", "doubtful")), name
        assert "axes time, x, y, " in one.facts().text
    with pytest.raises(FilmError, match=r"axes \(time: 4, altitude: 6, depth: 3\)"):
        movie(tmp_path / "doubtful")


@pytest.mark.parametrize(
    "listed", [["time", "x", "y"], "time, x, y", "(t, x, y)", "TXY", np.array([b"t", b"x", b"y"])]
)
def test_attributes_list_the_axes(tmp_path, listed):
    values = plume()["gas"].values.transpose(0, 2, 1)
    with h5py.File(tmp_path / "p.h5", "w") as file:
        file["gas"] = values
        file["gas"].attrs["dimensions" if isinstance(listed, str) else "dims"] = listed
    one = movie(tmp_path / "p.h5", pixel=0.1, frame_rate=1)
    np.testing.assert_array_equal(one.picture(2), values[2])
    assert "(assumed), none" not in one.facts().text


def test_lengths_that_leave_the_order_open_are_assumed(tmp_path):
    """A square picture; then edges (n + 1) of one that is not."""
    values = plume()["gas"].values
    with h5py.File(tmp_path / "square.h5", "w") as file:
        file["gas"], file["t"] = values[:, :, :3], np.arange(4) / 2
        file["x"] = file["y"] = 0.1 * np.arange(3)
    assert "axes time, y, x (assumed)" in movie(tmp_path / "square.h5").facts().text
    with h5py.File(tmp_path / "edges.h5", "w") as file:
        file["gas"], file["t"] = values.transpose(0, 2, 1), np.arange(4) / 2
        file["x_edges"], file["y_edges"] = 0.1 * np.arange(7), 1 + 0.1 * np.arange(4)
    one = movie(tmp_path / "edges.h5")
    assert_place(one, 0.1, (0.0, 1.0))
    np.testing.assert_array_equal(one.picture(0), values[0].T)


@pytest.mark.parametrize("start", [0, 0.5, 1, 40])
@pytest.mark.parametrize("unit", ["", "pixel", "1", "px"])
def test_numbers_of_pixels_only_give_the_direction(tmp_path, start, unit):
    data = plume()
    data = data.assign_coords(x=start + np.arange(6), y=(start + np.arange(3))[::-1])
    for name in "xy":
        data[name].attrs = {"units": unit} if unit else {}
    FORMATS["zarr2"](data, tmp_path / "p", {})
    one = movie(tmp_path / "p", pixel="2 cm")
    assert (one.pixel, one.origin) == (0.02, (0.0, 0.0))
    np.testing.assert_array_equal(one.picture(0), data["gas"][0, ::-1].T)
    assert ("from 40 on" in " ".join(one.facts().remarks)) == (start == 40)
    if unit:
        with pytest.raises(FilmError, match="give pixel"):
            movie(tmp_path / "p")
    else:
        assert movie(tmp_path / "p").facts().text.count("(assumed: m)") == 2


@pytest.mark.parametrize("unit", ["frame", "1", "days since 2026-13-01", "seconds since 2026-02-30", "mm"])
def test_times_that_are_none_need_a_frame_rate(tmp_path, unit):
    data = plume()
    data["time"].attrs["units"] = unit
    data.to_netcdf(tmp_path / "p.nc", engine="h5netcdf")
    with pytest.raises(FilmError, match=f"'{unit}'.*; give frame_rate"):
        movie(tmp_path / "p.nc")
    one = movie(tmp_path / "p.nc", frame_rate=10)
    np.testing.assert_allclose(one.times, np.arange(4) / 10)
    assert f"'{unit}'" in " ".join(one.facts().remarks)


def test_times_from_the_start_or_in_other_calendars_have_no_date(tmp_path):
    for unit, calendar in (("seconds since start", ""), ("s since 2026-02-30", "360_day")):
        data = plume(start=5.0)
        data["time"].attrs = {"units": unit} | ({"calendar": calendar} if calendar else {})
        data.to_netcdf(tmp_path / "p.nc", engine="h5netcdf")
        one = movie(tmp_path / "p.nc")
        assert (one.begin, one.times[1]) == (5.0, 0.5)
        assert calendar in " ".join(one.facts().remarks)
        (tmp_path / "p.nc").unlink()


@pytest.mark.parametrize(
    ("unit", "date"),
    [
        ("days since 2026-1-1 0:0:0", "2026-01-01T00:00:00+00:00"),
        ("days since 1-1-1 00:00:0.0", "0001-01-01T00:00:00+00:00"),
        ("days since 2026-01-01T06:30Z", "2026-01-01T06:30:00+00:00"),
        ("days since 2026-1-1 0:0:0.5 -05:30", "2026-01-01T05:30:00.500000+00:00"),
        ("days after 2026-01-01 01:00 GMT", "2026-01-01T01:00:00+00:00"),
        ("Days Since 2026-01-01 12:00:00 +0100", "2026-01-01T11:00:00+00:00"),
    ],
)
def test_dates_of_udunits(unit, date):
    start = datetime.fromisoformat(date).timestamp()
    np.testing.assert_allclose(times_of(np.array([0.0, 2.0]), unit), [start, start + 2 * 86400])


@pytest.mark.parametrize("date", ["2026-01-01 00:00 GMT+1", "2026-01-01T00:00 UTC-2", "2026-13-01"])
def test_dates_that_may_mean_two_times_are_refused(date):
    with pytest.raises(ConventionError, match=re.escape(date)):
        times_of(np.array([0.0]), f"hours since {date}")


@pytest.mark.parametrize(("form", "group"), [("zarr2", "run/a"), ("zarr3", "run/a"), ("netcdf4", "run/a")])
def test_groups_have_arrays_and_coordinates_above(tmp_path, form, group):
    """Arrays in groups are found, with a leading slash or none; coordinates also lie in the groups above."""
    data = plume()
    path = tmp_path / "p"
    if form == "netcdf4":
        data.drop_vars(["x", "y"]).to_netcdf(path, engine="h5netcdf", group=group)
        with h5py.File(path, "a") as file:
            for n, name in ((1, "y"), (2, "x")):
                file[name] = 1e3 * data[name]
                file[name].attrs["units"] = "mm"
                file[name].make_scale(name)
                scale = file[f"{group}/gas"].dims[n]
                scale.detach_scale(file[f"{group}/{name}"])
                scale.attach_scale(file[name])
    else:
        options = {"zarr_format": int(form[-1]), "consolidated": False}
        data[["x", "y"]].to_zarr(path, **options)
        data.drop_vars(["x", "y"]).to_zarr(path, group=group, mode="a", **options)
    for keys in ({}, {"variable": f"{group}/gas"}, {"variable": f"/{group}/gas"}):
        one = movie(path, **keys)
        assert_place(one)
        np.testing.assert_array_equal(one.picture(3), data["gas"][3].T)


def test_texts_with_numbers_and_units_count(tmp_path):
    data = plume().drop_vars(["x", "y", "time"])
    data.attrs = {"pixel_to_grid": "100 mm", "FPS": "2 Hz"}
    data["gas"] = (100 * data["gas"]).round().astype("i2")
    data["gas"].attrs = {"scale_factor": "0.01", "missing_value": str(int(data["gas"][1, 0, 2]))}
    FORMATS["zarr3"](data, tmp_path / "p", {})
    one = movie(tmp_path / "p")
    assert (one.pixel, one.times[1]) == (pytest.approx(0.1), 0.5)
    wanted = 0.01 * data["gas"][1].values.T
    wanted[2, 0] = 0.0
    np.testing.assert_allclose(one.picture(1), wanted, rtol=1e-6)
    data["gas"].attrs["scale_factor"] = "fine"
    FORMATS["zarr3"](data, tmp_path / "q", {})
    with pytest.raises(FilmError, match="scale_factor is 'fine'"):
        movie(tmp_path / "q").picture(0)


def test_places_in_single_precision_are_equally_spaced(tmp_path):
    """UTM coordinates in 32 bits, exact to 0.25 m only."""
    data = plume(corner=(500000.0, 4000000.0))
    data = data.assign_coords(x=data["x"].astype("f4"), y=data["y"].astype("f4"))
    for name in "xy":
        data[name].attrs["units"] = "m"
    FORMATS["netcdf4"](data, tmp_path / "p", {})
    one = movie(tmp_path / "p", pixel=0.1)
    np.testing.assert_allclose(one.origin, [500000.0, 4000000.0], atol=0.13)
    assert "rounded to 0.25 m" in " ".join(one.facts().remarks)


@pytest.mark.parametrize(("kind", "value"), [("u2", 65535), ("i2", -32768), ("u1", 255), ("i2", 32767)])
def test_limits_of_integers_are_remarked(tmp_path, kind, value):
    values = plume()["gas"].values.astype(kind)
    np.save(tmp_path / "plain.npy", values)
    values[1, 1, 1] = values[2, 0, 0] = value
    np.save(tmp_path / "full.npy", values)
    for name, count in (("plain", 0), ("full", 1)):
        remarks = movie(tmp_path / f"{name}.npy", pixel=0.1, frame_rate=1).facts().remarks
        assert sum(f"2 pixels are {value}, the" in remark for remark in remarks) == count
    data = plume()
    data["gas"] = (SHAPE.keys(), values, {"_FillValue": values[1, 1, 1]})
    FORMATS["zarr3"](data, tmp_path / "p", {})
    assert not any(f"are {value}" in remark for remark in movie(tmp_path / "p").facts().remarks)
