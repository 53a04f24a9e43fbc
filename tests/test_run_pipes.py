"""A pipe in place of a file of a run folder is refused by every reader; none waits for a writer."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_run import made, result, scenario
from pipes_in_folders import ended

from taichi_plume import cite, open_run
from taichi_plume.__main__ import main
from taichi_plume.api.export import NAMES
from taichi_plume.cli import maps, run, statistics
from taichi_plume.draw.downloads import zipped
from taichi_plume.execution import latest_instant
from taichi_plume.files import checkpoint, manifest
from taichi_plume.files.run_folder import LISTED
from taichi_plume.guard.input_error import InputError
from taichi_plume.record import live
from tests.fuzz import bases, formats

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in folders")
PARTS = (
    "result",
    "trials",
    "scenario",
    "fields",
    "pictures",
    "robots",
    "probes",
    "forces",
    "maps",
    "beliefs",
)
PLAYBACK = """
duration: 1
domain: {{size: [0.6, 0.5, 0.4], spacing: 0.1}}
wind: {{kind: playback, file: {folder}/fields.zarr}}
gas: {{kind: playback, file: {folder}/fields.zarr}}
"""
FILES = (
    "scenario.yaml",
    "result.json",
    "manifest.json",
    "robots.parquet",
    "probes.parquet",
    "forces.csv",
    "pictures.zarr",
    "pictures.zarr/zarr.json",
    "pictures.zarr/gas_slice/c/0/0/0",
    "checkpoint.npz",
    "watch.npz",
    "report.html",
    "fields.zarr",
    "fields.zarr/zarr.json",
    "fields.zarr/time/zarr.json",
    "fields.zarr/time/c/0",
    "maps.zarr",
    "maps.zarr/zarr.json",
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A run folder with a file of each kind."""
    folder = tmp_path_factory.mktemp("pipes") / "run"
    made(folder, content=result(scenario(), version=formats.__version__))
    bases._write_film(folder / "fields.zarr")
    formats._write_maps(folder / "maps.zarr")
    shutil.copy(folder / "robots.parquet", folder / "probes.parquet")
    (folder / "forces.csv").write_text("t_s,obstacle,x_N,y_N\n0,0,0.1,-1e-3\n")
    (folder / "report.html").write_text("<p>a report</p>")
    checkpoint.write(folder / "checkpoint.npz", {"inputs": {}})
    np.savez(folder / "watch.npz", t=0.0)
    (folder.parent / "playback.yaml").write_text(PLAYBACK.format(folder=folder.name))
    manifest.write(folder, {}, [folder / name for name in LISTED])
    return folder


def readers(folder: Path, out: Path) -> dict[str, Callable[[], Any]]:
    """Each reader of a run folder, by name; `out` is a folder to write to."""

    def part(name: str) -> Callable[[], Any]:
        return lambda: getattr(open_run(folder), name)

    def command(main: Callable[[list[str]], int], *arguments: object) -> Callable[[], Any]:
        return lambda: main([str(argument) for argument in arguments])

    return {
        **{name: part(name) for name in (*PARTS, "header", "tracks", "shapes", "lacks")},
        "repr": lambda: repr(open_run(folder)),
        "notebook": lambda: open_run(folder)._repr_html_(),
        "plot": lambda: open_run(folder).plot(),
        "gas_at": lambda: open_run(folder).gas_at(1.0, 1.0),
        "show": lambda: open_run(folder).show(),
        "cite": lambda: cite(folder),
        "checkpoint": lambda: checkpoint.read(folder / "checkpoint.npz"),
        "watch": lambda: latest_instant.read(folder / "watch.npz"),
        "zip": lambda: zipped(folder, out / "run.zip"),
        "verify": command(main, "repair", folder, "--verify"),
        "repair": command(main, "repair", folder, "--no-report"),
        "resume": command(run.main, "--resume", folder),
        "playback": command(run.main, folder.parent / "playback.yaml", "--check", "--out", out / "checked"),
        "again": command(run.main, folder / "scenario.yaml", "--check", "--out", out / "again"),
        "report": command(main, "report", folder),
        "picture": command(main, "picture", folder, "--out", out / "picture.png"),
        "statistics": command(statistics.main, folder, "--out", out / "statistics", "--no-page"),
        "film statistics": command(statistics.main, folder / "fields.zarr", "--out", out / "of_film"),
        "map of readings": command(
            maps.main, folder / "robots.parquet", "--size", 4, 3, "--out", out / "maps"
        ),
        **{
            f"export {to}": command(main, "export", folder, "--to", to, "--out", out / to, "--force")
            for to in NAMES
        },
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_no_reader_waits_for_a_pipe(finished, tmp_path, monkeypatch, capsys, name):
    folder = shutil.copytree(finished, tmp_path / "run")
    shutil.copy(finished.parent / "playback.yaml", tmp_path)
    file = folder / name
    shutil.rmtree(file) if file.is_dir() else file.unlink()
    os.mkfifo(file)
    monkeypatch.setattr(live, "open_viewer", lambda *files, what: None)
    messages = []
    for reader, call in readers(folder, tmp_path).items():
        ends, outcome = ended(call, file)
        printed = capsys.readouterr()
        assert ends, f"{reader} waits for {name}"
        if isinstance(outcome, Exception):
            assert isinstance(outcome, InputError | OSError), (reader, outcome)
            assert len(getattr(outcome, "lines", [outcome])) == 1
        messages.append(f"{outcome}{printed.out}{printed.err}")
        assert file.is_fifo() or name == "report.html"  # a new report replaces it
    top = name.partition("/")[0]
    assert top in ("watch.npz", "report.html") or any(top in message for message in messages)
