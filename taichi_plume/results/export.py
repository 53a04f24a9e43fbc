"""Export of a run to other programs.

vtkhdf   the film, frame by frame: gas, wind as vectors, temperature on the cells; for ParaView and pyvista
netcdf   the film, or the decoded colours of a recording, with CF metadata; for xarray, MATLAB, Panoply ...
csv      the tables robots.csv and probes.csv, and columns.csv with their units and meanings
mcap     a ROS 2 bag with robots, gas, wind, plume and maps; see `bag_of_run`
gaden    the film as a configuration of GADEN 3, for its player: cells, wind and concentrations
plumesim the readings of probes, or of robots that stand, as a log that PlumeSim and `kind: plumesim_log` play back
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_plume.files import disk, own_folder
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.results.run import FILES, Run

if TYPE_CHECKING:
    import numpy as np
    import xarray

TABLES = ("robots", "probes")


def export(run: Run, to: str, out: Path, source: str | None = None, force: bool = False) -> list[Path]:
    """Write a run's data in a format `to` (vtkhdf, netcdf, csv, gaden), and return the files, for gaden one per folder.

    pictures: colours of an old recording become pictures.zarr, from which reports and pictures are made.

    out: the file or, for csv and gaden, the folder; source: "film" or "recording", by default the film if any; force:
    replace existing files. Raises RunFolderError if the run has no such data or a file exists, and OSError.
    """
    if to == "csv":
        return _tables(run, out, force)
    if to == "gaden":
        return _gaden(run, out, force)
    if to == "pictures":
        return _old_pictures(run, out)
    if to == "vtkhdf" and source == "recording":
        raise RunFolderError(f"{run.folder}: pictures of a recording go to netcdf; vtkhdf takes a film")
    if to == "vtkhdf" or source == "film":
        run.require("fields.zarr")
    filmed = source != "recording" and (run.has("fields.zarr") or to == "vtkhdf")
    data = run.fields if filmed else _recorded(run)
    _require_frames(run, data)
    from taichi_plume.files import netcdf, vtkhdf

    with _fresh([out], force) as (part,):
        for coming in (vtkhdf if to == "vtkhdf" else netcdf).write(part, data, frames(data, run.folder)):
            disk.require_room(part, coming)
    return [out]


def export_log(run: Run, out: Path, force: bool = False, **options: Any) -> list[Path]:
    """Write the readings of a run's nodes to `out` as a log of PlumeSim; return the file. Raises as `export`.

    options: of `log_of`.
    """
    from taichi_plume.results.network_log import log_of

    with _fresh([out], force) as (part,), part.open("w", encoding="ascii", newline="\n") as file:
        for text in log_of(run, **options):
            disk.require_room(part, len(text))
            file.write(text)
    return [out]


def _require_frames(run: Run, data: "xarray.Dataset") -> None:
    if not data.sizes.get("time"):
        raise RunFolderError(f"{run.folder}: holds no frame yet; it ended, or is still, before the first")


def _recorded(run: Run) -> "xarray.Dataset":
    """Return the pictures of a run, and the wind on its planes; names of the wind's dimensions end in _wind."""
    winds = run.winds
    return run.pictures.assign(winds.rename({dim: f"{dim}_wind" for dim in winds.dims}))


def _old_pictures(run: Run, out: Path) -> list[Path]:
    """Convert the recording.rrd of a run of an earlier version to a pictures.zarr at `out`, which is never replaced."""
    from taichi_plume.record.old_recordings import convert

    run.require("recording.rrd")
    if os.path.lexists(out):
        raise RunFolderError(f"{out}: exists, and colours replace no numbers; choose another --out")
    if not out.parent.is_dir():
        raise RunFolderError(f"{out}: its folder does not exist")
    about = {"title": f"Pictures of {run.scenario.name}", **run.scenario.seeds}
    made = run.result.get("version", "an earlier version")
    about["source"] = f"colours in recording.rrd of taichi_plume {made}"
    fresh = disk.new_folder_beside(out)
    try:
        convert(run.folder / "recording.rrd", fresh, run.scenario, about)
        os.rename(fresh, out)
    finally:
        disk.discard(fresh)
    return [out]


def _gaden(run: Run, out: Path, force: bool) -> list[Path]:
    """Write the film (recorded wind and gas) into folder `out` as a GADEN 3 configuration; return a file per folder."""
    from taichi_plume.files import gaden_results

    run.require("fields.zarr")
    data = run.fields
    _require_frames(run, data)
    if os.path.lexists(out) and not out.is_dir():
        raise RunFolderError(f"{out}: is no folder")
    if out.is_dir() and any(out.iterdir()) and not force:
        raise RunFolderError(f"{out}: is not empty; choose another --out or add --force to write into it")
    link = own_folder.link_in(out)
    if link is not None:
        raise RunFolderError(f"{out / link}: is a link, and links are not written to; choose another --out")
    out.mkdir(parents=True, exist_ok=True)
    first: dict[Path, Path] = {}
    sources = gaden_results.sources_of(run.scenario)
    for coming, path in gaden_results.write(out, data, frames(data, run.folder), sources):
        disk.require_room(out, coming)
        first.setdefault(path.parent, path)
    return list(first.values())


def frames(data: "xarray.Dataset", folder: Path) -> "Callable[[str, int], np.ndarray]":
    """Return a function (name, frame number) that reads a variable's values; it raises RunFolderError if damaged."""
    from taichi_plume.files.zarr_groups import errors_as

    def read(name: str, n: int) -> "np.ndarray":
        values = data[name]
        with errors_as(RunFolderError, folder, f"frame {n} of {name} is damaged"):
            moving = values.ndim > 1 and str(values.dims[0]).startswith("time")
            return (values[n] if moving else values).values

    return read


def _tables(run: Run, out: Path, force: bool) -> list[Path]:
    """Write the run's robot and probe tables as CSV into folder `out`, with a list of columns; return the files."""
    import pyarrow as pa
    import pyarrow.csv

    from taichi_plume.files import run_tables

    there = [name for name in TABLES if any((run.folder / file).exists() for file in FILES[name])]
    if not there:
        raise RunFolderError(f"{run.folder}: has no tables, neither robots nor probes")
    out.mkdir(parents=True, exist_ok=True)
    files = [out / f"{name}.csv" for name in (*there, "columns")]
    options = pa.csv.WriteOptions(quoting_style="needed")
    with _fresh(files, force) as parts:
        columns = []
        for name, part in zip(there, parts, strict=False):
            rows = run_tables.batches(run.folder / f"{name}.parquet")
            first = next(rows)
            kinds = {c.name: pa.string() if pa.types.is_dictionary(c.type) else c.type for c in first.schema}
            plain = pa.schema(list(kinds.items()))
            with pa.csv.CSVWriter(part, plain, write_options=options) as csv:
                for batch in rows:
                    disk.require_room(part, batch.nbytes)
                    csv.write_batch(batch.cast(plain))
            for column in first.schema:
                about = column.metadata or {}
                text = {key: about.get(key.encode(), b"").decode() for key in ("unit", "meaning")}
                columns.append({"table": name, "column": column.name} | text)
        pa.csv.write_csv(pa.Table.from_pylist(columns), parts[-1], options)
    return files


@contextmanager
def _fresh(files: Sequence[Path], force: bool) -> Iterator[list[Path]]:
    """Context that yields temporary file names, and renames the files to `files` once all are complete.

    force: replace existing files. Raises RunFolderError if a file exists or cannot exist.
    """
    for file in files:
        if not file.parent.is_dir():
            raise RunFolderError(f"{file}: its folder does not exist")
        if os.path.lexists(file) and not file.is_file():  # --force replaces no device, nor a link to nowhere
            what = "a folder" if file.is_dir() else "no plain file"
            raise RunFolderError(f"{file}: is {what}; give the name of a file")
        if os.path.lexists(file) and not force:
            raise RunFolderError(f"{file}: exists; choose another --out or add --force to overwrite")
    parts: list[Path] = []
    try:
        parts.extend(disk.new_beside(file) for file in files)
        yield parts
        for part, file in zip(parts, files, strict=True):
            (os.replace if force else disk.put_at_free)(part, file)
    finally:
        for part in parts:
            part.unlink(missing_ok=True)
