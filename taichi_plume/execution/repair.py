"""Completion of the files of a killed run (`complete`), and a check for changed files (`verify`).

Row streams become robots.parquet and probes.parquet, the viewer's recording gets its index, text tables end with a
whole row, and result.json states the time reached. No data are lost; a run with a checkpoint can still be resumed.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow.compute as pc

from taichi_plume.execution.execute import report
from taichi_plume.execution.outputs import OVER
from taichi_plume.execution.result import write_result
from taichi_plume.files import (
    checkpoint,
    disk,
    manifest,
    maps_file,
    parquet,
    pictures_file,
    plumesim_log,
    run_tables,
)
from taichi_plume.files.run_folder import KILLED, LISTED, RunFolder, RunFolderError, read_json, resuming
from taichi_plume.guard.terminal import say
from taichi_plume.scoring.declarations import Json

UNFINISHED = ("robots.arrows", "probes.arrows", "recording.old.rrd")
"""Files that exist only until a file is finished."""


def verify(folder: Path) -> int:
    """Print which files of a run differ from the checksums in its manifest; return 1 if any differs, else 0."""
    if not folder.is_dir():
        raise RunFolderError(f"{folder}: is no folder; give the folder of a run")
    listed = manifest.read(folder)["outputs"]
    if not listed:
        raise RunFolderError(f"{folder}: has no {manifest.NAME}, which runs write at their end")
    paths = [folder / name for name in listed]
    changes = [manifest.changed(path) if path.exists() else f"{path}: is no longer there" for path in paths]
    faults = [fault for fault in changes if fault]
    say(*faults, f"{folder}: {len(paths) - len(faults)} of {len(paths)} files are unchanged since their run")
    return int(bool(faults))


def complete(folder: RunFolder, reported: bool) -> int:
    """Complete every file of a killed run and return the exit code. reported: also write report.html."""
    path = folder.path
    content = _content(path)
    status, whole = content["status"], not any((path / name).exists() for name in UNFINISHED)
    if status != "running" and whole:
        if (path / checkpoint.NAME).exists() and not (path / manifest.NAME).exists():  # killed during its end
            if reported and not (path / "report.html").exists():
                report(path)
            _seal(path)
        if status in OVER:
            (path / checkpoint.NAME).unlink(missing_ok=True)
        say(f"{path}: the run has ended regularly ({status})")
        return 0
    code = 0
    (path / manifest.NAME).unlink(missing_ok=True)  # lists files that change below
    for name, mend in COMPLETE.items():
        try:
            outcome = mend(path / name)
        except (OSError, ValueError, LookupError) as error:
            outcome, code = f"could not be completed: {' '.join(str(error).split())}", 1
        if outcome:
            say(f"{name}: {outcome}")
    with _writing(path):
        if status == "running":
            status = KILLED
            write_result(path, content | {"status": status, **_reached(path / "robots.parquet", content)})
    if reported:
        report(path)
    _seal(path)
    say(f"result.json: {status}")
    if (path / checkpoint.NAME).exists():
        say(f"to resume: {resuming(path)}", longest=None)
    return code


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Context that raises an OSError again as a RunFolderError on this path."""
    try:
        yield
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be written to: {error.strerror or error}") from None


def _seal(path: Path) -> None:
    """Write the manifest (checksums of inputs and outputs) of a run folder."""
    with _writing(path):
        manifest.write(path, _inputs(path), [path / name for name in LISTED])


def _content(folder: Path) -> Json:
    """Return the content of result.json; a missing status becomes "running"."""
    return {"name": folder.name, "status": "running", "seed": None} | read_json(folder / "result.json")


def _inputs(folder: Path) -> Json:
    """Return the digests of the run's input files from its checkpoint; empty without a checkpoint."""
    try:
        return checkpoint.read(folder / checkpoint.NAME)["inputs"]
    except (checkpoint.CheckpointError, LookupError):
        return {}


def _reached(table: Path, content: Json) -> Json:
    """Return for result.json the last time in the table, as a message, and per robot group how many found a source."""
    try:
        with parquet.opened(table) as file:
            rows = file.read(columns=["t", "group", "found"])
    except (OSError, ValueError, LookupError):
        rows = None
    if rows is None or not len(rows):
        return {"message": content.get("message", "")}
    t = pc.max(rows["t"]).as_py()
    last = rows.filter(pc.equal(rows["t"], t))
    groups = [
        {
            "name": name.as_py(),
            "robots_of_all_trials": len(robots := last.filter(pc.equal(last["group"], name))),
            "found": pc.sum(robots["found"]).as_py(),
        }
        for name in pc.unique(last["group"].cast("string"))
    ]
    return {"message": f"the rows of robots end at t = {t:.2f} s", "groups": groups}


# ---------------------------------------------------------------- files


def _table(path: Path) -> str | None:
    if not run_tables.stream_of(path).exists():
        return None
    run_tables.finish(path)
    if not path.exists():
        return "no rows"
    with parquet.opened(path) as file:
        return f"{file.metadata.num_rows:,} rows"


def _lines(path: Path) -> str | None:
    """Cut off an incomplete last line of a text table; return a note with the number of lines, None without a file."""
    if not path.exists():
        return None
    with path.open("rb+") as file:
        content = file.read()
        file.truncate(content.rfind(b"\n") + 1)
    lines = content.count(b"\n")
    return f"{lines} lines"


def _log(path: Path) -> str | None:
    return f"{plumesim_log.shorten(path)} frames" if path.exists() else None


def _recording(path: Path) -> str | None:
    from taichi_plume.record.recorder import EARLIER, MENDED
    from taichi_plume.record.stream import mend

    earlier = path.with_name(EARLIER)
    if earlier.exists():  # killed while a resumed run copied it: all data are in the old file
        earlier.replace(path)
    if not path.exists():
        return None
    mended = path.with_name(MENDED)
    mend(path, mended)
    mended.replace(path)
    return f"{path.stat().st_size / 1e6:.3g} MB"


def _film(path: Path) -> str | None:
    if not path.is_dir():
        return None
    from taichi_plume.files import film_writer

    return f"{film_writer.complete(path)} frames"


def _pictures(path: Path) -> str | None:
    return f"{pictures_file.complete(path)} instants" if (path / "zarr.json").exists() else None


def _maps(path: Path) -> None:
    """Remove the partial folder of gas maps whose writing was interrupted."""
    disk.discard(path.with_name(maps_file.PART))


COMPLETE: dict[str, Callable[[Path], str | None]] = {
    "robots.parquet": _table,
    "probes.parquet": _table,
    "forces.csv": _lines,
    "fields.zarr": _film,
    "pictures.zarr": _pictures,
    "plume.pslog": _log,
    "maps.zarr": _maps,
    "recording.rrd": _recording,
}
