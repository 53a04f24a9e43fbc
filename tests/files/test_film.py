"""Films on disk: what they hold, what is kept of an interrupted one, and what is said of bad ones."""

import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
import zarr
from refusals import cut, gone, replaced

from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.files import manifest
from taichi_plume.files.film import Film, FilmError, dimensions
from taichi_plume.files.film_writer import NewFilm, complete
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.species import SPECIES

SHAPE, DX = (6, 5, 4), 0.1
MOVING = ["u_face", "v_face", "w_face", "gas_acetone"]
PLAY = """
duration: 2
domain: {size: [0.6, 0.5, 0.4], spacing: 0.1}
wind: {kind: playback, file: fields.zarr}
gas: {kind: playback, file: fields.zarr}
"""


def size_of(name: str, shape: tuple[int, ...] = SHAPE) -> tuple[int, ...]:
    """Extent of a variable (x, y, z), reported from the names of its dimensions."""
    more = {"": 0, "face": 1, "ghost": 2}
    return tuple(
        n + more[d.partition("_")[2]] for n, d in zip(shape, dimensions(name, len(shape))[::-1], strict=True)
    )


def opened(path: Path) -> Any:
    return zarr.open_group(path, mode="r+", use_consolidated=False)


def new_film(path: Path, frames: int = 3) -> list[dict[str, np.ndarray]]:
    """A film of noise; returns its frames, axes (z, y, x)."""
    rng = np.random.default_rng(5)
    names = ["volume", "air", *(kind + name for kind in ("open_", "area_") for name in MOVING[:3])]
    still = {name: np.ones(size_of(name)[::-1], np.float32) for name in names}
    gas = {"species": "acetone", "sources": [{"position": [0.3, 0.2, 0.2], "rate": 1e-5}]}
    facts = {"depth": 1.0, "periodic": [False] * 3, "viscosity": 1e-5, "schmidt": 1.0}
    facts |= {"gases": {"gas_acetone": gas}}
    film = NewFilm(path, SHAPE, DX, facts, MOVING, still, (SPECIES["acetone"],))
    shown = [{name: rng.random(size_of(name)[::-1], np.float32) for name in MOVING} for _ in range(frames)]
    for n, frame in enumerate(shown):
        film.append(0.5 * n, frame)
    film.flush()
    return shown


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A film, to be copied."""
    path = tmp_path_factory.mktemp("film") / "fields.zarr"
    new_film(path)
    return path


@pytest.fixture
def path(whole, tmp_path) -> Path:
    """A film of one's own to damage, beside a scenario that plays it."""
    shutil.copytree(whole, tmp_path / "fields.zarr")
    (tmp_path / "play.yaml").write_text(PLAY)
    return tmp_path / "fields.zarr"


def test_what_was_written_is_read(tmp_path):
    frames = new_film(tmp_path / "fields.zarr")
    film = Film(tmp_path / "fields.zarr")
    np.testing.assert_array_equal(film.times, [0.0, 0.5, 1.0])
    assert (film.shape, film.dx) == (SHAPE, DX)
    for n, frame in enumerate(frames):
        for name, values in film.frame(n, [*film.wind, *film.gas]).items():
            np.testing.assert_array_equal(values, frame[name].T)


@pytest.mark.parametrize("plain", [False, True], ids=["encoding kept", "encoding dropped"])
def test_a_copy_by_xarray_is_read(tmp_path, plain):
    frames = new_film(tmp_path / "fields.zarr")
    copy = xarray.open_zarr(tmp_path / "fields.zarr").load()
    (copy.drop_encoding() if plain else copy).to_zarr(tmp_path / "copy.zarr", zarr_format=3)
    film = Film(tmp_path / "copy.zarr")
    np.testing.assert_array_equal(film.still("volume"), Film(tmp_path / "fields.zarr").still("volume"))
    for name, values in film.frame(2, [*film.wind, *film.gas]).items():
        np.testing.assert_array_equal(values, frames[2][name].T)


def test_dimensions_have_names_coordinates_and_units(path):
    group = opened(path)
    arrays = dict(group.arrays())
    for name, array in arrays.items():
        for length, dimension in zip(array.shape, array.metadata.dimension_names, strict=True):
            assert arrays[dimension].shape == (length,), f"{name} along {dimension}"
        assert array.attrs["units"]
    assert arrays["u_face"].metadata.dimension_names == ("time", "z_ghost", "y_ghost", "x_face")
    np.testing.assert_allclose(arrays["x_face"], np.linspace(0, 0.6, 7), atol=1e-12)
    np.testing.assert_allclose(arrays["z_ghost"], [-0.05, 0.05, 0.15, 0.25, 0.35, 0.45])
    assert arrays["gas_acetone"].chunks == (1, 4, 5, 6)


def test_others_open_it_without_a_warning(path):
    """With axes, and what is to look at: the wind at the cells' middles, gas in ppm."""
    import cf_xarray  # noqa: F401

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        film = xarray.open_zarr(path)
        assert film.identical(xarray.open_zarr(path, consolidated=True))
    assert [film.cf[axis].name for axis in "XYZT"] == ["x", "y", "z", "time"]
    assert film["time"].values.tolist() == [0.0, 0.5, 1.0]
    faces = film["u_face"].isel(z_ghost=slice(1, -1), y_ghost=slice(1, -1))
    np.testing.assert_allclose(film["u"], faces.rolling(x_face=2).mean()[..., 1:], rtol=1e-5)
    faces = film["w_face"].isel(x_ghost=slice(1, -1), y_ghost=slice(1, -1))
    np.testing.assert_allclose(film["w"], faces.rolling(z_face=2).mean()[:, 1:], rtol=1e-5)
    for name, standard in [("u", "x_wind"), ("v", "y_wind"), ("w", "upward_air_velocity")]:
        assert film.cf[standard].name == name
        assert film[name].dims == film["acetone_ppm"].dims == ("time", "z", "y", "x")
    moles = film["gas_acetone"] / 58.080e-3 / (101325 / 8.314462618 / 298.15)
    np.testing.assert_allclose(film["acetone_ppm"], 1e6 * moles, rtol=1e-5)
    assert film.attrs["Conventions"].startswith("CF-")
    for one in film.attrs.values():
        assert isinstance(one, str | int | float | list), "NetCDF takes no other"


def test_a_film_that_is_growing_shows_others_its_last_frames_of_which_all_is_there(path):
    """What came after them is found by us, and by all once the film has been completed."""
    group = opened(path)
    for name in ("u_face", "u"):
        group[name].resize((4, *group[name].shape[1:]))
        group[name][3] = 1.0
    assert xarray.open_zarr(path).sizes["time"] == len(Film(path).times) == 3
    group["time"].resize((4,))  # its time is not written yet
    assert len(Film(path).times) == 3
    (path / "u" / "c" / "3" / "x.partial").touch()
    assert complete(path) == 3
    assert xarray.open_zarr(path, consolidated=False).sizes["time"] == 3
    assert xarray.open_zarr(path)["u"].isel(time=2).notnull().all()
    assert not list(path.rglob("*.partial"))
    assert len(Film(path).times) == 3


def test_a_film_goes_on_after_the_frames_that_are_kept(path, whole):
    film = NewFilm(path, SHAPE, DX, {}, MOVING, {}, (SPECIES["acetone"],), 2)
    assert xarray.open_zarr(path).sizes["time"] == 2
    held = Film(whole)
    film.append(1.0, {name: one.T for name, one in held.frame(2, [*held.wind, *held.gas]).items()})
    film.flush()
    files, expected = (
        {file.relative_to(root): file.read_bytes() for file in root.rglob("*") if file.is_file()}
        for root in (path, whole)
    )
    assert files == expected


def changed(key: str, value: object):
    def damage(path: Path) -> None:
        opened(path).attrs[key] = value

    return damage


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        (shutil.rmtree, "does not exist"),
        (cut("zarr.json"), "is no zarr group"),
        (gone("zarr.json"), "is no zarr group"),
        (changed("format", "another"), "was not written by a run"),
        (changed("format", "taichi_plume film 2"), "was written by another version"),
        (changed("gases", "{"), "is damaged"),
        (changed("shape", "wide"), "is damaged"),
        (cut("u_face/zarr.json"), "is damaged"),
        (cut("time/c/0"), "is damaged: Stored and computed checksum do not match"),
        (cut("u_face/c/2/0/0/0"), "frame 2 of u_face (t = 1 s): is damaged"),
        (gone("v_face/c/1/0/0/0"), "v_face has 2 of 3 frames"),
        (gone("w_face"), "w_face is missing"),
        (gone("open_v_face"), "open_v_face is missing"),
        (gone("volume/c/0/0/0"), "volume has 0 of 1 frames"),
        (lambda path: opened(path)["time"].resize((0,)), "holds no frame"),
    ],
)
def test_bad_films_are_reported_in_a_line(path, damage, fault):
    damage(path)
    with pytest.raises(ScenarioError) as reported:
        load_scenario(path.parent / "play.yaml")
    (line,) = (line for line in reported.value.lines if "wind.file" in line)
    assert str(path) in line
    assert fault in line


def test_damage_in_the_middle_is_found_when_it_is_read(path):
    cut("gas_acetone/c/1/0/0/0")(path)
    film = Film(path)
    film.frame(1, film.wind)
    with pytest.raises(FilmError, match=r"frame 1 of gas_acetone \(t = 0.5 s\): is damaged"):
        film.frame(1, film.gas)


@pytest.mark.parametrize(
    ("override", "fault"),
    [
        ("domain.spacing=0.05", "use size: [0.6, 0.5, 0.4], spacing: 0.1"),
        ("domain.size=[0.5, 0.5, 0.4]", "5 x 5 x 4 cells of 0.1 m, but"),
        ("gas.start=1.1", "gas.start: 1.1 s is after"),
        ("gas.species=argon", "gas.species"),
        ("wind.rate=0", "wind.rate"),
        ("obstacles=[{kind: sphere, center: [0.3, 0.3, 0.2], radius: 0.1}]", "cells are not as in"),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_film_is_reported(path, override, fault):
    with pytest.raises(ScenarioError) as reported:
        load_scenario(path.parent / "play.yaml", [override])
    assert fault in str(reported.value)


def test_film_without_the_quantity(path):
    gone("gas_acetone")(path)
    with pytest.raises(ScenarioError, match="holds no gas, only wind"):
        load_scenario(path.parent / "play.yaml")


def test_species_and_sources_come_from_the_film(path):
    gas = load_scenario(path.parent / "play.yaml").gas
    assert (gas.species, gas.sources[0].position) == ("acetone", (0.3, 0.2, 0.2))
    other = load_scenario(path.parent / "play.yaml", ["gas.species=ethanol"]).gas
    assert (other.species, other.sources) == ("ethanol", gas.sources)


def test_metadata_that_are_not_as_the_run_left_them_are_noticed(path):
    manifest.write(path.parent, {}, [path])
    Film(path)
    replaced("u_face/zarr.json", '"m s-1"', '"km s-1"')(path)
    with pytest.raises(FilmError, match="has changed since its run"):
        Film(path)


def test_other_folders_in_a_film_are_ignored_and_messages_are_short(path, recwarn):
    (path / "notes").mkdir()
    Film(path)
    assert not list(recwarn)
    replaced("u_face/zarr.json", "crc32c", "crc" * 3000)(path)
    with pytest.raises(FilmError) as caught:
        Film(path)
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize(
    ("array", "old", "new", "fault"),
    [
        (".", '"spacing": 0.1', '"spacing": NaN', "its spacing is nan"),
        (".", '"shape": [', '"shape": [1e308,', r"its shape is 1e\+308"),
        (".", '"shape": [', '"shape": [999999,', "not those of a plane or a room"),
        (".", '"viscosity"', '"vicosity"', "'viscosity'"),
        (".", '"schmidt": 1.0', '"schmidt": -1.0', "its schmidt is -1"),
        ("v_face", '"chunk_shape": [1,', '"chunk_shape": [0,', "v_face"),
        ("open_u_face", '"fill_value": 0', '"fill_value": 99999999999999999999', "damaged"),
    ],
)
def test_damaged_metadata_are_reported_without_a_manifest(path, array, old, new, fault):
    file = path / array / "zarr.json"
    text = " ".join(file.read_text().split()).replace("[ ", "[")
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(FilmError, match=f"is damaged: .*{fault}|{fault}"):
        Film(path)
