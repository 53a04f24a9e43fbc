"""Movies of plumes in the three layouts that there are, and files that are none."""

import json
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import zarr
from refusals import refused

from taichi_plume.files.film import FilmError
from taichi_plume.files.movie import Movie
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.playback import MovieGas

PICTURES = np.random.default_rng(3).random((4, 5, 7)).astype("f2")
TOLD = {"fps": 8.0, "pixel_to_grid": [0.1, 0.1], "origin": [0.2, -0.1]}


def zarr_of(path: Path, values: np.ndarray, name: Any = "concentration", **attributes: Any) -> Path:
    group = zarr.open_group(path, mode="w")
    group.create_array(name, data=values, chunks=(1, *values.shape[1:]))
    group.attrs.update(attributes)
    return path


def npy_of(path: Path, values: np.ndarray, name: str = "", **attributes) -> Path:
    np.save(path, values)
    return path


def hdf5_of(path: Path, values: np.ndarray, name: str = "plume", **attributes) -> Path:
    with h5py.File(path, "w") as file:
        file[name] = values
        file.attrs.update(attributes)
    return path


def movie(path: Path, **keys) -> Movie:
    model = MovieGas.model_validate({"kind": "movie", "file": path.name, **keys})
    return Movie(path, model, Domain(size=(1, 1), spacing=0.1))


@pytest.mark.parametrize(
    ("make", "name"), [(zarr_of, "m.zarr"), (npy_of, "m.npy"), (hdf5_of, "m.h5")], ids=["zarr", "npy", "hdf5"]
)
def test_layouts(tmp_path, make, name):
    path = make(tmp_path / name, PICTURES)
    up = movie(path, frame_rate=10, pixel=0.05)
    down = movie(path, frame_rate=10, pixel=0.05, rows="down")
    np.testing.assert_allclose(up.times, [0, 0.1, 0.2, 0.3])
    assert up.size == pytest.approx((0.35, 0.25))
    assert up.origin == (0.0, 0.0)
    for n in range(4):
        np.testing.assert_array_equal(up.picture(n)[2, 1], PICTURES[n, 1, 2])
        np.testing.assert_array_equal(down.picture(n)[2, 1], PICTURES[n, -2, 2])


@pytest.mark.parametrize("make", [zarr_of, hdf5_of])
def test_what_files_tell(tmp_path, make):
    path = make(tmp_path / "m", PICTURES, **TOLD)
    reported, given = movie(path), movie(path, frame_rate=1, pixel=1, origin=[0, 3])
    assert (reported.times[1], reported.pixel, reported.origin) == (0.125, 0.1, (-0.1, 0.2))
    assert (given.times[1], given.pixel, given.origin) == (1.0, 1.0, (0.0, 3.0))


def test_other_names(tmp_path):
    assert movie(hdf5_of(tmp_path / "one", PICTURES, "odour", **TOLD)).shape == PICTURES.shape
    path = hdf5_of(tmp_path / "two", PICTURES, "a", **TOLD)
    with h5py.File(path, "a") as file:
        file["b"] = 2 * PICTURES
    assert movie(path, variable="b").picture(0)[1, 2] == 2 * PICTURES[0, 2, 1]
    for keys, said in [({}, "neither .* a, b"), ({"variable": "c"}, "no 'c'.* a, b")]:
        with pytest.raises(FilmError, match=said):
            movie(path, **keys)


@pytest.mark.parametrize(
    ("value", "remark"),
    [
        (np.nan, "1 missing pixels count as 0"),
        (-9999, "1 missing"),
        (-0.25, r"down to -0.25 ppm, of .* count as 0"),
    ],
)
def test_noise_and_missing_pixels_count_as_zero(tmp_path, value, remark):
    values = PICTURES.astype("f4")
    values[2, 1, 1] = value
    one = movie(npy_of(tmp_path / "m.npy", values), frame_rate=1, pixel=1)
    expected = PICTURES[2].T.astype(float)
    expected[1, 1] = 0.0
    np.testing.assert_allclose(one.picture(2), expected)
    assert re.search(remark, one.facts().remarks[0])


@pytest.mark.parametrize("value", [np.inf, 1e30])
def test_frames_that_are_no_concentrations(tmp_path, value):
    values = PICTURES.astype("f4")
    values[2, 1, 1] = value
    one = movie(npy_of(tmp_path / "m.npy", values), frame_rate=1, pixel=1)
    one.picture(1)
    with pytest.raises(FilmError, match=r"frame 2: holds values beyond 1e\+12"):
        one.picture(2)


def test_files_that_are_no_movies(tmp_path):
    given = {"frame_rate": 1, "pixel": 1}
    cases = [
        (tmp_path / "missing.npy", given, "does not exist"),
        (npy_of(tmp_path / "flat.npy", PICTURES[0]), given, r"shape \(5, 7\)"),
        (npy_of(tmp_path / "none.npy", PICTURES[:0]), given, r"shape \(0, 5, 7\)"),
        (npy_of(tmp_path / "words.npy", PICTURES.astype("U3")), given, "wanted numbers"),
        (npy_of(tmp_path / "bare.npy", PICTURES), {"pixel": 1}, "'fps'; give frame_rate"),
        (zarr_of(tmp_path / "bare", PICTURES, fps=3), {}, "'pixel_to_grid'; give pixel"),
        (zarr_of(tmp_path / "oblong", PICTURES, **TOLD | {"pixel_to_grid": [1, 2]}), {}, "give pixel"),
        (zarr_of(tmp_path / "lost", PICTURES, **TOLD | {"origin": ["x"]}), {}, "give origin"),
    ]
    named = given | {"variable": "plume"}
    cases.append((npy_of(tmp_path / "named.npy", PICTURES), named, "a single array, .* remove variable"))
    zarr.create_array(tmp_path / "array.zarr", data=PICTURES)
    assert movie(tmp_path / "array.zarr", **given).shape == PICTURES.shape
    cases.append((tmp_path / "array.zarr", named, "a single array, .* remove variable"))
    (tmp_path / "text.npy").write_text("0, 1, 2\n")
    cases.append((tmp_path / "text.npy", given, "is no array"))
    (tmp_path / "folder").mkdir()
    cases.append((tmp_path / "folder", given, "neither an array nor a group"))
    for make, name in ((npy_of, "cut.npy"), (hdf5_of, "cut.h5")):
        path = make(tmp_path / name, PICTURES)
        path.write_bytes(path.read_bytes()[:-40])
        cases.append((path, given, "cannot be read"))
    for path, keys, said in cases:
        with refused(FilmError, path, said):
            movie(path, **keys)


def test_coordinates_in_other_files_are_not_read(tmp_path):
    with h5py.File(tmp_path / "m.h5", "w") as file:
        file.create_dataset("plume", data=np.zeros((2, 3, 4), np.float32))
        file.create_dataset("x", (4,), np.float32, external=[(tmp_path / "absent", 0, 16)])
    with pytest.raises(FilmError, match=r"/x lies in other files; copy it into one"):
        movie(tmp_path / "m.h5")


def test_nothing_is_executed_and_no_other_file_read(tmp_path):
    group = zarr.open_group(tmp_path / "evil", mode="w", zarr_format=2)
    group.create_array("concentration", data=PICTURES)
    about = tmp_path / "evil/concentration/.zarray"
    plain = json.loads(about.read_text())
    for packed in (
        {"compressor": {"id": "pickle"}},
        {"filters": [{"id": "pickle"}]},
        {"filters": [{"id": "shuffle"}], "compressor": {"id": "pickle"}},
        {"filters": [{"id": "base64"}]},
    ):
        about.write_text(json.dumps(plain | packed))
        with pytest.raises(FilmError, match=r"pickle|packed by 'base64'"):
            movie(tmp_path / "evil", frame_rate=1, pixel=1)
    hdf5_of(tmp_path / "own", PICTURES)
    with h5py.File(tmp_path / "linked", "w") as file:
        file["plume"] = h5py.ExternalLink("own", "plume")
    with pytest.raises(FilmError, match=r"'concentration'.*no variable"):
        movie(tmp_path / "linked", frame_rate=1, pixel=1)


@pytest.mark.parametrize(
    "packing", [{"compression": "gzip", "shuffle": True, "fletcher32": True}, {"compression": "lzf"}]
)
def test_packed_hdf5_is_read(tmp_path, packing):
    with h5py.File(tmp_path / "fine", "w") as file:
        file.create_dataset("plume", data=PICTURES, **packing)
    np.testing.assert_array_equal(movie(tmp_path / "fine", frame_rate=1, pixel=1).picture(1), PICTURES[1].T)
