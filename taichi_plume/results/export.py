"""A run's data for other programs.

vtkhdf   the film, frame by frame: gas, wind as vectors, temperature on the cells; for ParaView and pyvista
netcdf   the same, or a recording's colours, decoded, after CF; for xarray, MATLAB, Panoply ...
csv      the tables, robots.csv and probes.csv, and columns.csv, which tells their units and meanings
mcap     a bag of ROS 2 with robots, gas, wind, plume and maps; see `bag_of_run`
gaden    the film as a configuration of GADEN 3, for its player: cells, wind and concentrations
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.files import disk, own_folder
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.results.run import FILES, Run

if TYPE_CHECKING:
    import numpy as np
    import xarray

TABLES = ("robots", "probes")


def export(run: Run, to: str, out: Path, source: str | None = None, force: bool = False) -> list[Path]:
    """Write a run's data as `to` says, one of vtkhdf, netcdf, csv and gaden; returns the files, of gaden the first of
    each sort.

    out: the file, of csv and gaden the folder; source: film or recording, by default the film where there is one.
    Raises RunFolderError where the run has no such data or a file is there, unless by `force`; and OSError.
    """
    if to == "csv":
        return _tables(run, out, force)
    if to == "gaden":
        return _gaden(run, out, force)
    if to == "vtkhdf" and source == "recording":
        raise RunFolderError(f"{run.folder}: pictures of a recording go to netcdf; vtkhdf takes a film")
    if to == "vtkhdf" or source == "film":
        run.require("fields.zarr")
    if source == "recording":
        run.require("recording.rrd")
        data = run.pictures
    else:
        data = run.fields if (run.folder / "fields.zarr").exists() or to == "vtkhdf" else run.pictures
    if not data.sizes.get("time"):
        raise RunFolderError(f"{run.folder}: holds no frame yet; it ended, or is still, before the first")
    with _fresh([out], force) as (part,):
        _write(data, to, part, run.folder)
    return [out]


def _write(data: "xarray.Dataset", to: str, part: Path, folder: Path) -> None:
    from taichi_plume.files import netcdf, vtkhdf

    for coming in (vtkhdf if to == "vtkhdf" else netcdf).write(part, data, frames(data, folder)):
        disk.require_room(part, coming)


def _gaden(run: Run, out: Path, force: bool) -> list[Path]:
    """The film as a configuration of GADEN's, in a folder; the first file of each sort."""
    from taichi_plume.files import gaden_results

    run.require("fields.zarr")
    data = run.fields
    if not data.sizes.get("time"):
        raise RunFolderError(f"{run.folder}: holds no frame yet; it ended, or is still, before the first")
    if os.path.lexists(out) and not out.is_dir():
        raise RunFolderError(f"{out}: is no folder")
    if out.is_dir() and any(out.iterdir()) and not force:
        raise RunFolderError(f"{out}: is not empty; choose another --out or add --force to write into it")
    link = own_folder.link_in(out)
    if link is not None:
        raise RunFolderError(f"{out / link}: is a link, to which nothing is written; choose another --out")
    out.mkdir(parents=True, exist_ok=True)
    first: dict[Path, Path] = {}
    sources = gaden_results.sources_of(run.scenario)
    for coming, path in gaden_results.write(out, data, frames(data, run.folder), sources):
        disk.require_room(out, coming)
        first.setdefault(path.parent, path)
    return list(first.values())


def frames(data: "xarray.Dataset", folder: Path) -> "Callable[[str, int], np.ndarray]":
    """How to get the values of a variable of a run at a frame; raises RunFolderError where these are damaged."""
    from taichi_plume.files.zarr_groups import FAULTS, reason

    def read(name: str, n: int) -> "np.ndarray":
        one = data[name]
        try:
            return (one.isel(time=n) if "time" in one.dims and one.ndim > 1 else one).values
        except FAULTS as error:
            raise RunFolderError(f"{folder}: frame {n} of {name} is damaged: {reason(error)}") from None

    return read


def _tables(run: Run, out: Path, force: bool) -> list[Path]:
    """The tables that a run has, as CSV in a folder."""
    import pyarrow as pa
    import pyarrow.csv

    from taichi_plume.files import table_parts

    there = [name for name in TABLES if any((run.folder / file).exists() for file in FILES[name])]
    if not there:
        raise RunFolderError(f"{run.folder}: has no tables, neither robots nor probes")
    out.mkdir(parents=True, exist_ok=True)
    files = [out / f"{name}.csv" for name in (*there, "columns")]
    with _fresh(files, force) as parts:
        columns = []
        for name, part in zip(there, parts, strict=False):
            rows = table_parts.batches(run.folder / f"{name}.parquet")
            first = next(rows)
            plain = pa.schema([(one.name, _text_of(one.type)) for one in first.schema])
            with pa.csv.CSVWriter(
                part, plain, write_options=pa.csv.WriteOptions(quoting_style="needed")
            ) as csv:
                for batch in rows:
                    disk.require_room(part, batch.nbytes)
                    csv.write_batch(batch.cast(plain))
            for one in first.schema:
                told = one.metadata or {}
                columns.append(
                    [name, one.name, *(told.get(key, b"").decode() for key in (b"unit", b"meaning"))]
                )
        about = dict(
            zip(("table", "column", "unit", "meaning"), map(list, zip(*columns, strict=True)), strict=True)
        )
        pa.csv.write_csv(pa.table(about), parts[-1], pa.csv.WriteOptions(quoting_style="needed"))
    return files


def _text_of(kind: object) -> object:
    """A column's type in a CSV: names as text."""
    import pyarrow as pa

    return pa.string() if pa.types.is_dictionary(kind) else kind


@contextmanager
def _fresh(files: Sequence[Path], force: bool) -> Iterator[list[Path]]:
    """Names to write new files under; the files are there once all of them are whole, or none is.

    Raises RunFolderError where one is there, unless by `force`, and where there can be none.
    """
    for file in files:
        if not file.parent.is_dir():
            raise RunFolderError(f"{file}: its folder does not exist")
        if (
            os.path.lexists(file) and not file.is_file()
        ):  # nor does --force replace a device, or a link to nowhere
            what = "a folder" if file.is_dir() else "no plain file"
            raise RunFolderError(f"{file}: is {what}; give the name of a file")
        if os.path.lexists(file) and not force:
            raise RunFolderError(f"{file}: exists; choose another --out or add --force to overwrite")
    parts: list[Path] = []
    try:
        parts.extend(disk.new_beside(file) for file in files)
        yield parts
        for part, file in zip(parts, files, strict=True):
            os.replace(part, file)
    finally:
        for part in parts:
            part.unlink(missing_ok=True)
