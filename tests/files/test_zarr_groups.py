"""Stored Zarr groups may come from anyone: nothing in them is executed, and what they claim is bounded."""

import json
import pickle
import re
from pathlib import Path
from typing import Any

import numcodecs.pickles
import numpy as np
import pytest
import zarr
from refusals import refused
from test_movie import movie

import taichi_plume
from taichi_plume.files import film_writer, maps_file, shared_film
from taichi_plume.files.film import Film, FilmError
from taichi_plume.files.zarr_groups import (
    Group,
    GroupError,
    add,
    consolidate,
    create,
    require_memory,
    stored_chunks,
)
from taichi_plume.results.run import open_run

FORMATS = {
    "film": {
        "format": "taichi_plume film 3",
        "shape": [5, 5],
        "spacing": 0.1,
        "depth": 1,
        "periodic": [False, False],
    },
    "air": {
        "format": shared_film.FORMAT,
        "tick": 0.1,
        "frames": 1,
        "shape": [3],
        "names": ["u"],
    },
    "maps": {"format": maps_file.FORMAT, "maps": 1},
    "bank": {
        "format": "taichi_plume bank 1",
        "spacing": 1,
        "frame": 1,
        "species": "[]",
        "sources": "[]",
        "key": "",
    },
    "movie": {"fps": 1, "pixel_to_grid": 1},
}
GIVEN = {"frame_rate": 1, "pixel": 1}  # of a movie without attributes


class Trap:
    """An object that leaves a file where it is unpickled."""

    def __init__(self, file: Path):
        self.file = file

    def __reduce__(self):
        return Path.touch, (self.file,)


def pickled(folder: Path, trap: Path, name: str, shape: tuple[int, ...]) -> None:
    """An array of Zarr 2 whose only chunk is a pickle."""
    filters = [{"id": "vlen-utf8"}, {"id": "pickle", "protocol": 5}]
    about = {"zarr_format": 2, "shape": shape, "chunks": shape, "dtype": "|O", "order": "C"}
    about |= {"compressor": None, "filters": filters, "fill_value": None}
    (folder / name).mkdir()
    (folder / name / ".zarray").write_text(json.dumps(about))
    reported = {"_ARRAY_DIMENSIONS": list("abc"[: len(shape)])}
    (folder / name / ".zattrs").write_text(json.dumps(reported))
    (folder / name / ".".join("0" * len(shape))).write_bytes(pickle.dumps(Trap(trap)))


def read_by(kind: str, path: Path) -> None:
    """Read a group with every reader that its format has. Each is expected to refuse it in one line."""
    readers = {
        "film": (Film, film_writer.complete),
        "air": (lambda file: shared_film.AirFilm(file).frame(0),),
        "maps": (maps_file.read,),
        "movie": (lambda file: movie(file).picture(0),),
    }
    if kind == "bank":  # brings Taichi
        from taichi_plume.envs import bank

        readers["bank"] = (bank.read,)
    for read in readers[kind]:
        with refused(ValueError, path, ""):
            read(path)


@pytest.mark.parametrize("kind", FORMATS)
def test_pickles_are_not_executed(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(numcodecs.pickles, "ALLOW_UNSAFE_PICKLE_DECODE", True, raising=False)
    path, trap = tmp_path / f"{kind}.zarr", tmp_path / "executed"
    for folder in (path, path / "0"):
        folder.mkdir()
        (folder / ".zgroup").write_text('{"zarr_format": 2}')
        (folder / ".zattrs").write_text(json.dumps(FORMATS[kind]))
    for name in ("time", "values", "scale", "air", "u"):
        pickled(path, trap, name, (1,))
    pickled(path, trap, "concentration", (1, 1, 1))
    pickled(path / "0", trap, "estimate", (1,))
    array: Any = zarr.open_group(path, mode="r")["time"]
    with pytest.raises((TypeError, ValueError)):  # of what the trap returns; the trap works
        array[:]
    assert trap.exists()
    trap.unlink()
    read_by(kind, path)
    assert not trap.exists()


def test_codecs_are_those_that_are_allowed_also_in_repeated_metadata_and_shards(tmp_path):
    gzip = [{"name": "bytes"}, {"name": "gzip", "configuration": {"level": 1}}]
    endian = {"name": "bytes", "configuration": {"endian": "little"}}
    shards = {"chunk_shape": [1], "codecs": gzip, "index_codecs": [endian]}
    allowed = frozenset({"bytes", "sharding_indexed"})
    for n, codecs in enumerate((gzip, [{"name": "sharding_indexed", "configuration": shards}])):
        path = tmp_path / f"{n}.zarr"
        add(create(path, {}), "time", ("time",), np.arange(2.0), {})
        consolidate(path)
        own, root = path / "time/zarr.json", path / "zarr.json"
        sound, about = own.read_text(), json.loads(own.read_text())
        own.write_text(json.dumps(about | {"codecs": codecs}))
        with pytest.raises(GroupError, match=r"gzip|sharding_indexed"):
            _ = Group(path)["time"]
        with pytest.raises(GroupError, match="gzip"):
            _ = Group(path, codecs=allowed)["time"]
        _ = Group(path, codecs=allowed | {"gzip"})["time"]
        own.write_text(sound)
        reported = json.loads(root.read_text())
        reported["consolidated_metadata"]["metadata"]["time"]["codecs"] = codecs
        root.write_text(json.dumps(reported))
        _ = Group(path)["time"]
        with pytest.raises(GroupError, match=r"gzip|sharding_indexed"):
            _ = Group(path, consolidated=True)["time"]


def claim(path: Path, name: str, **changes: object) -> None:
    """Change what an array says of itself."""
    file = path / name / "zarr.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def test_claims_are_bounded(tmp_path):
    path = tmp_path / "a.zarr"
    group = create(path, {})
    add(group, "a", ("x",), np.arange(4.0), {}, (2,))
    array = Group(path)["a"]
    assert stored_chunks(array) == array.nchunks == 2
    claim(path, "a", shape=[10**15])  # zarr would look for each of 5e14 chunks
    with pytest.raises(ValueError, match="a has 2 of 500000000000000 chunks"):
        require_memory({"a": Group(path)["a"]})
    claim(path, "a", data_type="string", fill_value="")
    with pytest.raises((GroupError, ValueError)):
        _ = Group(path)["a"]


def test_arrays_beyond_the_free_memory_are_refused(tmp_path, monkeypatch):
    group = create(tmp_path / "a.zarr", {})
    add(group, "a", ("x",), np.zeros(1000), {})
    array = Group(tmp_path / "a.zarr")["a"]
    require_memory({"a": array})

    class Little:
        available = 15_000

    monkeypatch.setattr("psutil.virtual_memory", Little)
    with pytest.raises(ValueError, match="memory"):
        require_memory({"a": array, "b": array})


def test_a_film_that_claims_more_times_than_it_has_ends_with_those_there_are(tmp_path):
    path = tmp_path / "fields.zarr"
    group = create(path, FORMATS["film"])
    add(group, "time", ("time",), np.arange(2.0), {}, (2,))
    claim(path, "time", shape=[10**12])
    with pytest.raises(ValueError, match="volume"):  # further than the times
        Film(path)


def test_only_the_gate_opens_groups():
    package = Path(taichi_plume.__file__).parent
    opening = re.compile(r"\bzarr\.(open|load|Group|Array)\w*\(")
    found = {file.name for file in package.rglob("*.py") if opening.search(file.read_text())}
    assert found == {"zarr_groups.py"}


def test_a_run_of_others(tmp_path):
    """`open_run(...).fields` looks at the metadata that xarray reads."""
    (tmp_path / "result.json").write_text('{"name": "a", "status": "completed", "seed": 1}')
    path = tmp_path / "fields.zarr"
    path.mkdir()
    (path / ".zgroup").write_text('{"zarr_format": 2}')
    (path / ".zattrs").write_text(json.dumps(FORMATS["film"]))
    with pytest.raises(ValueError, match="no zarr group"):
        _ = open_run(tmp_path).fields


def test_the_number_of_chunks_of_a_frame_is_bounded(tmp_path):
    group = zarr.open_group(tmp_path / "a", mode="w")
    group.create_array("concentration", shape=(1, 8000, 8000), chunks=(1, 1, 1), dtype="f4")
    with pytest.raises(FilmError, match="64000000 chunks"):
        movie(tmp_path / "a", **GIVEN)
