"""What a run leaves, opened by `open_run` and exported, and looked at with other people's readers."""

import json
import os
import shutil
import warnings
import zlib
from pathlib import Path

import numpy as np
import pandas
import polars
import pytest
import xarray
from refusals import cut, flipped, gone, refused, unfinished
from scripts import refusal

from taichi_plume import RunFolderError, open_run
from taichi_plume.__main__ import main
from taichi_plume.agents.casting import Casting
from taichi_plume.cli import run
from taichi_plume.execution.result import write_result
from taichi_plume.files import disk, manifest
from taichi_plume.results.export import export as write_export
from taichi_plume.scenario.scenario import Scenario

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]
SCENARIO = """
name: small
duration: 2
domain: {size: [1.2, 0.8, 0.5], spacing: 0.1}
wind:
  kind: cfd
  openings: [{kind: inlet, face: x-, speed: 0.5}, {kind: outlet, face: x+}]
  buoyancy: {heat: {walls: [{face: z-, temperature: 310}]}}
obstacles: [{kind: sphere, center: [0.61, 0.42, 0.2], radius: 0.17}]
gas: {kind: eulerian, sources: [{position: [0.35, 0.4, 0.2], rate: 1 mg/s}]}
robots: [{name: pair, count: 2, reach: 0, start: {kind: positions, positions: [[1, 0.2], [1, 0.6]]},
          algorithm: {kind: casting}}]
maps: [{kind: time_series}, {kind: gmrf}]
probes: {points: [{kind: point, name: a, at: [0.9, 0.4, 0.2]}], every: 0.5}
fields: {rate: 2}
"""
PARTS = ("fields", "robots", "probes", "forces", "maps", "result", "scenario")


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    """A run that has ended, with a film and every table."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "s.yaml").write_text(SCENARIO)
    out = folder / "run"
    assert run.main([str(folder / "s.yaml"), "--out", str(out), "--quiet", "--no-report"]) == 0
    return out


@pytest.fixture
def folder(small, tmp_path) -> Path:
    """A copy to damage."""
    return shutil.copytree(small, tmp_path / "run")


# ---------------------------------------------------------------- open_run


def test_all_parts_are_there_with_units(small, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        one = open_run(str(small))
        assert isinstance(one.scenario, Scenario)
        assert one.scenario.duration == 2
        assert one.result["status"] == "completed"
        fields = one.fields.load()
    assert set(fields.data_vars) == {"u", "v", "w", "ethanol_ppm", "gas_ethanol", "temperature", "air"}
    assert fields["u"].dims == ("time", "z", "y", "x")
    units = [fields[name].attrs["units"] for name in ("u", "ethanol_ppm", "temperature")]
    assert units == ["m s-1", "ppm", "K"]
    np.testing.assert_allclose(fields["time"], [0, 0.5, 1, 1.5, 2])
    first, last = (fields["temperature"].isel(time=n, z=0).mean() for n in (0, -1))
    assert 298 < first < last
    assert one.robots.attrs["units"]["reading_ppm"] == "ppm"
    assert one.robots.attrs["units"]["declared_x"] == "m"
    assert one.trials[["group", "trial", "success", "outcome"]].to_numpy().tolist() == [
        ["pair", 0, False, "neither"]
    ]
    assert np.isnan(one.trials["declarations"]).all()  # casting never declares
    assert one.trials.attrs["units"]["localisation_error_m"] == "m"
    assert one.probes.attrs["units"]["pressure"] == "Pa"
    assert one.forces.attrs["units"] == {"t_s": "s", "obstacle": "1", "x_N": "N", "y_N": "N", "z_N": "N"}
    assert [each.attrs["kind"] for each in one.maps] == ["time_series", "gmrf"]
    assert "variance" in one.maps[1]
    one.maps[1].to_netcdf(tmp_path / "map.nc")
    again = xarray.load_dataset(tmp_path / "map.nc")
    xarray.testing.assert_equal(again, one.maps[1])
    assert json.loads(again.attrs["groups"])[0]["names"] == ["pair"]
    assert one.fields is one.fields
    reported = repr(one)
    assert "small, completed, 2 s" in reported
    assert "probes.parquet" in reported


def test_the_film_tells_what_probes_tell(small):
    """A probe at a cell's middle."""
    one = open_run(small)
    place = {"x": 0.85, "y": 0.45, "z": 0.25}
    last = one.fields.isel(time=-1)
    around = last.sel(x=slice(0.8, 1), y=slice(0.3, 0.5), z=slice(0.1, 0.3))  # the cells about it
    probe = one.probes.iloc[-1]
    assert probe["t"] == last["time"]
    for column, name in [("wind_x", "u"), ("temperature", "temperature"), ("ethanol_ppm", "ethanol_ppm")]:
        assert around[name].min() - 1e-3 <= probe[column] <= around[name].max() + 1e-3, column
    assert last.sel(place, method="nearest")["u"] > 0


def test_without_a_film_there_are_pictures_and_no_fields(folder, tmp_path):
    """A NetCDF file can be made of them as well."""
    film = open_run(folder).fields.load()
    command = [str(folder), "--to", "netcdf", "--from", "recording", "--out", str(tmp_path / "r.nc")]
    assert main(["export", *command]) == 0
    shutil.rmtree(folder / "fields.zarr")
    with pytest.raises(RunFolderError, match=r"fields.zarr; `fields: .*\.pictures"):
        _ = open_run(folder).fields
    pictures = open_run(folder).pictures
    again = xarray.open_dataset(tmp_path / "r.nc")
    for name, values in pictures.items():
        np.testing.assert_array_equal(again[name], values.astype(np.float32))
    column = pictures["gas_column"].sel(time=2.0)
    here = film["ethanol_ppm"].sel(time=2.0).max("z").sel(x=column["x"], y=column["y"], method="nearest")
    assert column.attrs["units"] == "ppm"
    known = here > 1.0
    assert known.sum() > 5
    precision = {"rtol": column.relative_precision, "atol": column.absolute_precision}
    np.testing.assert_allclose(column.where(known), here.where(known), **precision)
    for to in ("vtkhdf", "netcdf"):
        where = ["--from", "film"] if to == "netcdf" else []
        assert main(["export", str(folder), "--to", to, *where, "--out", str(tmp_path / "x")]) == 2


def test_gaden_s_player_gets_the_film(small, tmp_path, capsys):
    """See files/test_gaden_results.py for what is in the files."""
    assert main(["export", str(small), "--to", "gaden", "--out", str(tmp_path / "g")]) == 0
    film = open_run(small).fields
    results = sorted((tmp_path / "g/simulations/ethanol/result").iterdir())
    assert len(results) == film.sizes["time"]
    raw = zlib.decompress(results[-1].read_bytes())
    ppm = np.frombuffer(raw[-4 * 480 :], "<f4").reshape(5, 8, 12)
    np.testing.assert_allclose(ppm, np.nan_to_num(film["ethanol_ppm"].values[-1].clip(0)), rtol=1e-6)
    assert main(["export", str(small), "--to", "gaden", "--out", str(tmp_path / "g")]) == 2
    assert "is not empty; choose another --out or add --force" in capsys.readouterr().err


def test_tracks_know_all_states_in_the_order_of_the_algorithms(small):
    assert [track.states for track in open_run(small).tracks] == [list(Casting.STATE_NAMES)] * 2


def test_pandas_and_polars_find_units_in_the_file(small):
    for name in ("robots", "probes"):
        path = small / f"{name}.parquet"
        frame = pandas.read_parquet(path)
        assert set(frame.attrs["units"]) == set(frame.columns) == set(frame.attrs["meanings"])
        assert frame.attrs["units"]["wind_x"] == "m/s"
        assert frame.equals(getattr(open_run(small), name))
        reported = polars.read_parquet_metadata(path)
        assert json.loads(reported["units"]) == frame.attrs["units"]
        assert polars.read_parquet(path)["t"].to_list() == frame["t"].tolist()


def test_a_running_run_is_read_as_far_as_it_is(folder):
    whole = open_run(folder).robots
    unfinished(folder / "robots.parquet", rows=6)
    stream = folder / "robots.arrows"
    os.truncate(stream, stream.stat().st_size - 100)  # a batch is being written
    gone("maps.zarr", manifest.NAME)(folder)
    write_result(folder, open_run(folder).result | {"status": "running"})
    with (folder / "forces.csv").open("a") as file:
        file.write("2.5,0,0.1,0.")  # a row is being written
    one = open_run(folder)
    assert "running" in repr(one)
    assert one.robots.equals(whole.iloc[: (len(whole) - 1) // 6 * 6])
    assert one.robots.attrs["units"]["t"] == "s"
    assert len(one.forces) == 3
    assert one.fields.sizes["time"] == 5
    with pytest.raises(RunFolderError, match=r"has no maps.zarr; .*they are written when a run ends"):
        print(one.maps)


def test_parts_that_a_run_has_not_tell_how_to_get_them(folder):
    gone(*{file.name for file in folder.iterdir()} - {"result.json", "scenario.yaml"})(folder)
    one = open_run(folder)
    for part in PARTS[:5]:
        with refused(RunFolderError, folder, ": has no .*; "):
            getattr(one, part)
    assert "fields: {rate: 2}" in repr(one)
    repaired = [{"name": "casters", "robots_of_all_trials": 2, "found": 0}]
    for changes, fault in (
        ({"groups": []}, "has no trials"),
        ({"status": "killed", "groups": repaired}, "has no trials"),
        ({"groups": [{"algorithm": "casting", "trials": 1}]}, "is damaged: 'per_trial'"),
    ):
        write_result(folder, one.result | changes)
        with pytest.raises(RunFolderError, match=fault):
            print(open_run(folder).trials)


# ---------------------------------------------------------------- export


def test_paraview_reads_every_time_and_all_the_mass(small, tmp_path):
    import pyvista

    out = tmp_path / "a.vtkhdf"
    assert main(["export", str(small), "--to", "vtkhdf", "--out", str(out)]) == 0
    film = xarray.open_zarr(small / "fields.zarr")
    reader = pyvista.get_reader(out).reader
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == film.sizes["time"]
    for n in range(film.sizes["time"]):
        reader.SetStep(n)
        reader.Update()
        mesh = pyvista.wrap(reader.GetOutputDataObject(0))
        assert mesh.field_data["Time"][0] == film["time"][n]
        for name in ("ethanol_ppm", "gas_ethanol", "temperature"):
            np.testing.assert_array_equal(mesh.cell_data[name], film[name][n].values.ravel())
        for d, name in enumerate("uvw"):
            np.testing.assert_array_equal(mesh.cell_data["wind"][:, d], film[name][n].values.ravel())
        np.testing.assert_array_equal(mesh.cell_data["air"], film["air"].values.ravel())
    np.testing.assert_allclose(mesh.cell_centers().points[-1], [1.15, 0.75, 0.45], rtol=1e-6)
    volume = mesh.compute_cell_sizes()["Volume"]
    assert ((mesh["air"] > 0) & (mesh["air"] < 1)).any(), "the sphere cuts cells"
    mass = (mesh["gas_ethanol"].astype(float) * mesh["air"] * volume).sum()
    assert mass == pytest.approx(open_run(small).result["gas"]["in_domain_kg"], rel=1e-6)


def test_netcdf_is_the_same_data_and_follows_cf(small, tmp_path):
    import cf_xarray  # noqa: F401

    out = tmp_path / "a.nc"
    assert main(["export", str(small), "--to", "netcdf", "--out", str(out)]) == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = xarray.open_dataset(out)
    fields = open_run(small).fields
    assert data.equals(fields)
    for name in data.variables:
        assert data[name].attrs == fields[name].attrs
    assert [data.cf[axis].name for axis in "XYZT"] == ["x", "y", "z", "time"]
    assert data.attrs["Conventions"].startswith("CF-")


def test_csv_is_read_by_pandas_as_it_is(small, tmp_path):
    assert main(["export", str(small), "--to", "csv", "--out", str(tmp_path / "csv")]) == 0
    about = pandas.read_csv(tmp_path / "csv" / "columns.csv").set_index(["table", "column"])
    for name in ("robots", "probes"):
        frame, wanted = pandas.read_csv(tmp_path / "csv" / f"{name}.csv"), getattr(open_run(small), name)
        assert list(frame.columns) == list(wanted.columns)
        loose = {"check_dtype": False, "check_categorical": False, "rtol": 1e-6}
        pandas.testing.assert_frame_equal(frame, wanted, **loose)
        assert about.loc[name]["unit"].to_dict() == wanted.attrs["units"]


@pytest.mark.parametrize("to", ["vtkhdf", "netcdf", "csv"])
def test_what_is_there_stays_unless_by_force_and_no_half_is_left(folder, tmp_path, capsys, monkeypatch, to):
    out = tmp_path / "there" / ("robots.csv" if to == "csv" else "a.out")
    out.parent.mkdir()
    out.write_text("mine")
    command = [str(folder), "--to", to, "--out", str(out.parent if to == "csv" else out)]
    assert main(["export", *command]) == 2
    assert f"{out}: exists; choose another --out or add --force" in capsys.readouterr().err

    def full(file: Path, coming: int = 0) -> None:
        assert file.exists()
        raise OSError(28, "the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(disk, "require_room", full)
        assert main(["export", *command, "--force"]) == 1
    assert capsys.readouterr().err.endswith(": the disk is full\n")
    assert [file.name for file in out.parent.iterdir()] == [out.name]
    assert out.read_text() == "mine"
    assert main(["export", *command, "--force"]) == 0
    assert out.read_bytes() != b"mine"


def test_what_is_no_file_is_never_replaced(small, tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe")
    for out, reported in (("", "is a folder"), ("pipe", "is no plain file"), ("no/a.nc", "does not exist")):
        assert main(["export", str(small), "--to", "netcdf", "--force", "--out", str(tmp_path / out)]) == 2
        assert reported in capsys.readouterr().err
    assert (tmp_path / "pipe").is_fifo()


# ---------------------------------------------------------------- bad input


def other_version(folder: Path) -> None:
    content = json.loads((folder / "result.json").read_text())
    write_result(folder, content | {"version": "7.1"})


def bad_forces(folder: Path) -> None:
    (folder / "forces.csv").write_text("t_s,obstacle\n1,x\n")


DAMAGE = {
    "no folder": (shutil.rmtree, "", "does not exist"),
    "no run": (gone("result.json", "scenario.yaml"), "", "is not the folder"),
    "other version": (other_version, "", "was made by taichi_plume 7.1"),
    "result": (cut("result.json"), "result", "result.json: is damaged"),
    "scenario": (cut("scenario.yaml", 0.2), "scenario", "scenario.yaml: "),
    "robots": (cut("robots.parquet", 0.9), "robots", "robots.parquet: "),
    "a bit of robots": (flipped("robots.parquet"), "robots", "robots.parquet: "),
    "probes": (cut("probes.parquet"), "probes", "probes.parquet: "),
    "forces": (bad_forces, "forces", "forces.csv: "),
    "empty forces": (cut("forces.csv", 0), "forces", "forces.csv: "),
    "chunk": (gone("fields.zarr/ethanol_ppm/c/2"), "fields", "fields.zarr: "),
    "wind chunk": (gone("fields.zarr/u_face/c/2"), "fields", "fields.zarr: "),
    "zarr.json": (cut("fields.zarr/zarr.json"), "fields", "fields.zarr: "),
    "array": (cut("fields.zarr/temperature/zarr.json"), "fields", "fields.zarr: "),
    "maps": (cut("maps.zarr/zarr.json"), "maps", "maps.zarr: "),
    "map chunk": (gone("maps.zarr/1/variance/c"), "maps", "maps.zarr: "),
}


@pytest.mark.parametrize("sealed", [True, False])
@pytest.mark.parametrize("case", DAMAGE)
def test_damage_is_reported_in_a_line(folder, case, sealed, capsys):
    """With the manifest of the run's end and, as of a killed run, without."""
    damage, part, fault = DAMAGE[case]
    if not sealed:
        (folder / manifest.NAME).unlink()
    damage(folder)
    with refused(RunFolderError, folder, fault):
        getattr(open_run(folder), part)
    to = {"": "csv", "robots": "csv", "probes": "csv", "fields": "vtkhdf"}.get(part)
    if to:
        assert main(["export", str(folder), "--to", to, "--out", str(folder.parent / "out")]) == 2
        assert capsys.readouterr().err.startswith(str(folder))
        assert not [*folder.parent.glob("out/*"), *folder.parent.glob(".out*")]


def test_a_damaged_frame_is_reported_when_it_is_exported(folder, tmp_path, capsys):
    flipped("fields.zarr/ethanol_ppm/c/3/0/0/0")(folder)
    line = ["export", str(folder), "--to", "netcdf", "--out", str(tmp_path / "a.nc")]
    assert "frame 3 of ethanol_ppm is damaged" in refusal(capsys, *line)


def test_a_killed_run_is_opened_again_after_repair(folder):
    (folder / manifest.NAME).unlink()
    write_result(folder, open_run(folder).result | {"status": "running"})
    assert main(["repair", str(folder)]) == 0
    one = open_run(folder)
    assert one.result["status"] == "killed"
    assert (one.fields.sizes["time"], len(one.maps)) == (5, 2)


@pytest.mark.parametrize("to", ["vtkhdf", "netcdf"])
def test_a_run_that_ended_before_its_first_frame_is_one_line(folder, tmp_path, to):
    """As one that was killed while its warm-up lasted."""
    data = open_run(folder)
    data.__dict__["fields"] = data.fields.isel(time=slice(0, 0))
    with pytest.raises(RunFolderError, match=r"run: holds no frame yet; .*$"):
        write_export(data, to, tmp_path / "out")
    assert not (tmp_path / "out").exists()
