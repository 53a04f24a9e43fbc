"""The manifest of a run folder tells whether its files are those that the run left."""

import hashlib
import json

import numpy as np
import pytest
import zarr
from refusals import cut, gone, refused, replaced

from taichi_plume.files import manifest


@pytest.fixture
def folder(tmp_path):
    """A run folder with a table, a film, and an input elsewhere."""
    run = tmp_path / "run"
    run.mkdir()
    (run / "table.csv").write_text("t,x\n0,1\n")
    (tmp_path / "wind.csv").write_text("x,y\n")
    film = zarr.create_group(run / "film.zarr")
    film.create_array("u", data=np.arange(12.0), chunks=(4,))
    manifest.write(
        run,
        manifest.digests(run, [tmp_path / "wind.csv"]),
        [run / "table.csv", run / "film.zarr", run / "never.csv"],
    )
    return run


def test_it_holds_what_sha256sum_says(folder):
    content = json.loads((folder / "manifest.json").read_text())
    expected = {"sha256": hashlib.sha256(b"t,x\n0,1\n").hexdigest(), "bytes": 8}
    assert content["outputs"]["table.csv"] == expected == manifest.digest(folder / "table.csv")
    assert list(content["inputs"]) == ["../wind.csv"]
    assert sorted(content["outputs"]) == ["film.zarr", "table.csv"]
    assert manifest.read(folder) == content
    assert sorted(path.name for path in folder.iterdir()) == ["film.zarr", "manifest.json", "table.csv"]


def test_files_as_they_were_left_are_not_changed(folder):
    assert manifest.changed(folder / "table.csv") is None
    assert manifest.changed(folder / "film.zarr") is None
    (folder / "other.csv").write_text("not listed")
    assert manifest.changed(folder / "other.csv") is None
    assert manifest.changed(folder.parent / "wind.csv") is None  # there is no manifest beside it


@pytest.mark.parametrize("content", ["t,x\n0,2\n", "t,x\n0,1\n2,3\n", ""])
def test_a_changed_file_is_reported(folder, content):
    (folder / "table.csv").write_text(content)
    with refused(ValueError, folder / "table.csv", "has changed since its run"):
        manifest.require_unchanged(folder / "table.csv", ValueError)


@pytest.mark.parametrize(
    "damage",
    [
        replaced("u/zarr.json", "float64", "int64"),
        gone("u/c/1"),
        cut("u/c/1", 0),
        lambda film: (film / "u/c/9").write_bytes(b""),
    ],
)
def test_a_changed_film_is_reported(folder, damage):
    damage(folder / "film.zarr")
    assert "has changed since its run" in str(manifest.changed(folder / "film.zarr"))


@pytest.mark.parametrize(
    "content", ["", "[]", '{"inputs": {}}', '{"inputs": {}, "outputs": {"table.csv": 1}}', "[" * 9999]
)
def test_a_damaged_manifest_is_reported(folder, content):
    (folder / "manifest.json").write_text(content)
    assert "manifest.json: is damaged" in str(manifest.changed(folder / "table.csv"))
    with pytest.raises(manifest.ManifestError):
        manifest.read(folder)
