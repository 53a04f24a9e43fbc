"""A film that was made up: a Gaussian plume that comes and goes, with an obstacle in it."""

import numpy as np
import pytest

import taichi_plume as tp
from taichi_plume.files.film_writer import NewFilm
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.fluctuations.film_statistics import FilmRecord
from taichi_plume.guard.input_error import InputError
from taichi_plume.results.run import film_dataset
from taichi_plume.scenario.species import SPECIES

SHAPE, DX, HEIGHT, MIDDLE = (24, 15, 4), 0.1, 2, 7
ETHANOL = SPECIES["ethanol"]
ON = np.tile([1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], 8)  # in which frames there is gas
WIDTHS = 0.15 + 0.05 * np.arange(SHAPE[0]) * DX


def plume() -> np.ndarray:
    """Concentration [ppm] while there is any, (x, y, z): strongest at HEIGHT, falling off with x from 0.15 m on."""
    x, y, z = (np.arange(n) for n in SHAPE)
    across = (y - MIDDLE)[None, :] * DX / WIDTHS[:, None]
    ground = 100.0 * np.exp(-(across**2) / 2) * (x >= 1)[:, None] / (1 + x)[:, None]
    return ground[:, :, None] * np.exp(-((z - HEIGHT) ** 2))


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "air.zarr"
    air = np.ones(SHAPE, np.float32)
    air[15:17, 6:9] = 0.0
    facts = {
        "depth": 1.0,
        "periodic": [False] * 3,
        "gases": {"gas_ethanol": {"species": "ethanol", "sources": [{"position": [0.15, 0.75, 0.25]}]}},
    }
    still = {"volume": air.T, "air": air.T}
    made = NewFilm(path, SHAPE, DX, facts, ["gas_ethanol"], still, (ETHANOL,))
    for n, on in enumerate(ON):
        c = (on * plume() / ETHANOL.ppm_per_density).astype(np.float32)
        made.append(0.5 * n, {"gas_ethanol": c.T})
    made.flush()
    return path, air > 0


def test_maps_and_their_height(film):
    path, air = film
    found = tp.statistics(path, threshold=5.0)
    maps = found.maps
    assert maps is not None
    assert maps.attrs["height_m"] == pytest.approx((HEIGHT + 0.5) * DX)
    on = np.trapezoid(ON, dx=0.5) / (0.5 * (len(ON) - 1))
    mean = np.where(air, on * plume(), np.nan)[:, :, HEIGHT]
    np.testing.assert_allclose(maps["mean"], mean, rtol=1e-4)
    np.testing.assert_allclose(maps["rms"], np.sqrt(on * (1 - on)) / on * mean, rtol=1e-3, atol=1e-4)
    gamma = np.where(plume() > 5.0, on, 0.0)
    np.testing.assert_allclose(maps["intermittency"], np.where(air, gamma, np.nan)[:, :, HEIGHT], atol=1e-6)


def test_lines_end_at_the_obstacle_and_are_gaussian(film):
    path, _ = film
    found = tp.statistics(path, threshold=5.0)
    along, *across = found.probes
    assert along.probe.name == "along x"
    assert along.probe.places[:, 0].max() == pytest.approx(14.5 * DX)
    assert len(across) == 4
    for one in across:
        (profile,) = one.profiles
        if len(one.probe.places) < SHAPE[1]:
            continue  # cut by the obstacle
        assert profile.gaussian is not None
        assert profile.gaussian.centre == pytest.approx((MIDDLE + 0.5) * DX, abs=1e-3)
        row = round(one.probe.places[0, 0] / DX - 0.5)
        assert profile.gaussian.width == pytest.approx(WIDTHS[row], rel=1e-3)
    lasted = along.kinds[0].of_points[1].lasted  # frames 3, and 7 to 9, of every eight
    assert set(np.round(lasted, 6)) == {0.5, 1.5}


def test_sources_are_those_that_the_film_tells(film):
    record = FilmRecord(film[0], film_dataset(film[0]))
    assert record.sources is not None
    assert record.sources.tolist() == [[0.15, 0.75, 0.25]]
    record.data.attrs["gases"] = '{"gas_ethanol": {"sources": [{"position": "here"}]}}'
    assert record.sources is None


def test_films_that_tell_too_little(film, tmp_path):
    path, _ = film
    with pytest.raises(RunFolderError, match="at least 16"):
        tp.statistics(path, start=30.0)
    with pytest.raises(RunFolderError, match="holds no acetone, only ethanol"):
        tp.statistics(path, gas="acetone")
    empty = NewFilm(tmp_path / "e.zarr", (4, 4), DX, {"depth": 1.0, "periodic": [False] * 2}, [], {}, ())
    empty.flush()
    with pytest.raises(InputError, match=r"e\.zarr"):
        tp.statistics(tmp_path / "e.zarr")
