"""Exported data, read back by the format's own library and by this package: the same place, time, unit and value."""

import numpy as np
import pytest
import xarray

import taichi_plume as tp
from taichi_plume.__main__ import main
from taichi_plume.cli import maps
from taichi_plume.files.movie import Movie
from taichi_plume.files.readings import read
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.playback import MovieGas

pytestmark = pytest.mark.usefixtures("taichi")
ROOM = {
    "duration": "2 s",
    "domain": {"size": [2, 1], "spacing": 0.1},
    "wind": {"kind": "synthetic", "speed": 0.3},
    "obstacles": [{"kind": "cylinder", "center": [1.3, 0.5], "radius": 0.2}],
    "gas": {"kind": "eulerian", "species": "methane", "sources": [{"position": [0.4, 0.4], "rate": "50 mg/s"}]},
    "robots": [
        {"count": 2, "start": {"kind": "area", "low": [0.1, 0.1], "high": [0.9, 0.9]}, "algorithm": {"kind": "casting"}}
    ],
    "fields": {"rate": 2},
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory, taichi):
    return tp.simulate(ROOM, out=tmp_path_factory.mktemp("run") / "a")


def test_a_film_as_netcdf(run, tmp_path):
    path = tmp_path / "film.nc"
    assert main(["export", str(run.folder), "--to", "netcdf", "--out", str(path)]) == 0
    model = MovieGas(kind="movie", file="film.nc", species="methane", variable="methane_ppm")
    movie = Movie(path, model, Domain(size=(2, 1), spacing=0.1))
    with xarray.open_dataset(path) as data:
        gas = data["methane_ppm"]
        assert gas.attrs["units"] == "ppm"
        xarray.testing.assert_allclose(gas.drop_attrs(), run.fields["methane_ppm"].drop_attrs())
        np.testing.assert_allclose(movie.times, data["time"])
        for n in range(len(movie.times)):
            there = np.nan_to_num(gas[n].transpose("x", "y").values)
            np.testing.assert_allclose(movie.frame(n, ["gas"])["gas"], there, atol=1e-9)
    assert (movie.origin, movie.size) == (pytest.approx((0.0, 0.0), abs=1e-12), pytest.approx((2.0, 1.0)))
    assert "assumed" not in movie.facts().text


def test_robots_as_csv(run, tmp_path):
    assert main(["export", str(run.folder), "--to", "csv", "--out", str(tmp_path / "tables")]) == 0
    table, log = read(run.folder / "robots.parquet"), read(tmp_path / "tables" / "robots.csv")
    for name in ("t", "place", "reading", "wind"):
        np.testing.assert_allclose(vars(log)[name], vars(table)[name], rtol=1e-6, atol=1e-9)
    options = ["--size", "2", "1", "--map", "inverse_distance", "--out"]
    for n, source in enumerate((run.folder, tmp_path / "tables" / "robots.csv")):
        assert maps.main([str(source), *options, str(tmp_path / f"map{n}")]) == 0
    ours, theirs = (
        np.genfromtxt(tmp_path / f"map{n}" / "map.csv", delimiter=",", names=True) for n in (0, 1)
    )
    np.testing.assert_allclose(theirs["ppm"], ours["ppm"], rtol=1e-5, atol=1e-6)
