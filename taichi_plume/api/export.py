"""Data of a run for other programs: ``tp.export(folder, to="netcdf")`` is ``taichi-plume export``."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

NAMES = {
    "vtkhdf": "fields.vtkhdf", "netcdf": "fields.nc", "csv": "", "mcap": "bag", "gaden": "gaden",
    "plumesim": "network.pslog", "pictures": "pictures.zarr",
}  # fmt: skip
"""Formats, and the names of their files in the run's folder."""
SOURCES = {"film": "netcdf", "recording": "netcdf", "probes": "plumesim", "robots": "plumesim"}
"""Sources of an export, and the format of each."""
FROM_ZERO = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
POSITIVE = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
ONLY: dict[str, tuple[Any, str]] = {
    "trial": (Annotated[int, Field(ge=0, le=10**6)], "mcap, plumesim"), "begin": (FROM_ZERO, "mcap"),
    "points": (Annotated[int, Field(ge=1, le=10**7)], "mcap"), "least": (FROM_ZERO, "mcap"),
    "allow_outside": (bool, "mcap"), "full_scale": (POSITIVE, "plumesim"), "cell": (POSITIVE, "plumesim"),
}  # fmt: skip
"""Types of the options that only some formats take, and these formats."""


def export(
    run: str | Path,
    *,
    to: Literal["vtkhdf", "netcdf", "csv", "mcap", "gaden", "plumesim", "pictures"],
    out: str | Path | None = None,
    source: Annotated[Literal["film", "recording", "probes", "robots"] | None, "--from"] = None,
    trial: Annotated[int | None, "N"] = None,
    force: bool = False,
    begin: Annotated[float | str | None, "SECONDS"] = None,
    points: Annotated[int | None, "N"] = None,
    least: Annotated[float | str | None, "PPM"] = None,
    allow_outside: bool = False,
    full_scale: Annotated[float | str | None, "PPM"] = None,
    cell: Annotated[float | str | None, "METRES"] = None,
) -> list[Path]:
    """Write a run's data for other programs. Return the files.

    run: the run's folder. to: vtkhdf: the film for ParaView and pyvista; netcdf: fields after CF; csv: the tables;
    mcap: a bag of ROS 2; gaden: the film for GADEN's player; plumesim: a log of probes, or of robots that stand;
    pictures: numbers from the colours in recording.rrd of an earlier version. out: the file, of csv, mcap, gaden and
    pictures a folder; by default in the run's folder. source: of netcdf, by default the film, else the pictures; or of
    plumesim, by default the probes, else the robots. trial: number of the trial of mcap, plumesim, by default 0.
    force: replace what is there, except pictures.

    begin: ROS time of a bag's start, such as a Unix time, by default 0. points: most points in a bag's cloud of gas, by
    default 20000; more cells are averaged in blocks. least: less gas is no point of a bag's cloud, by default 0.1.
    allow_outside: for a bag, read maps and meshes outside the run's folder that are not those of the run. full_scale:
    concentration that is 100 percent in a log of PlumeSim, by default 100. cell: distance up to which a node of such a
    log counts, by default the largest to a nearest neighbour.

    Raises InputError and OSError.
    """
    given = locals()
    from importlib.util import find_spec

    from taichi_plume.guard.input_error import InputError
    from taichi_plume.guard.safe_open import as_path
    from taichi_plume.results.export import export, export_log
    from taichi_plume.results.run import Run, open_run
    from taichi_plume.scenario.loading import load_part

    options: dict[str, Any] = {}
    for name, (kind, formats) in ONLY.items():
        if given[name] is not None and given[name] is not False:
            option = f"--{name.replace('_', '-')}"
            options[name] = load_part(given[name], option, kind)
            if to not in formats.split(", "):
                raise InputError(f"{option}: is only for --to {formats}")
    if source is not None and to != SOURCES[source]:
        raise InputError(f"--from: {source} is only for --to {SOURCES[source]}")
    folder = as_path(run, "run")
    path = folder / NAMES[to] if out is None else as_path(out, "out")
    if out is None and path != folder and path.is_symlink():
        raise InputError(f"{path}: is a link, to which nothing is written; choose --out")
    opened = Run(folder, lenient=True) if to == "pictures" else open_run(folder)
    if to == "mcap":
        if find_spec("rosbags") is None:
            raise InputError('bags need rosbags: pip install "taichi_plume[ros]"')
        from taichi_plume.results import bag_of_run

        return bag_of_run.write(opened, path, force, **options)
    if to == "plumesim":
        return export_log(opened, path, force, source=source, **options)
    return export(opened, to, path, source, force)
