"""`pictures.zarr`: what a run has shown, as numbers: pictures of gas and temperature, and wind, over time.

A zarr group that xarray opens: ``xarray.open_zarr("runs/arena-1/pictures.zarr")``. Variables such as `gas_slice` have
the dimensions (time, y, x), NaN where a pixel has no air. They are packed, as the CF attributes `scale_factor` and
`add_offset` say, and precise to `relative_precision` of the value plus `absolute_precision` in its unit; larger values
than `largest_value` are stored as that. A pixel is the largest value that it covers. `colors_from` and `colors_to` are
the ends of the viewer's colours, by which nothing is cut off. The group "wind" has u, v and w [m/s] at the arrows'
places, such as `u_slice`. Each of the scenario's `outputs` is a group of its name.

A picture counts once its time is written, so an interrupted run has all pictures of the last flush.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.files import manifest
from taichi_plume.files.run_folder import RunFolderError

if TYPE_CHECKING:
    import xarray

NAME = "pictures.zarr"
FORMAT = "taichi_plume pictures 1"
TIME_CHUNK = 4096


def read(path: Path, part: str = "") -> "xarray.Dataset":
    """Return pictures, or a part of them such as "wind", as a dataset whose values are read on use.

    A part that the file lacks is an empty dataset. Raises RunFolderError if the file is foreign or damaged.
    """
    import xarray

    from taichi_plume.files import zarr_groups

    manifest.require_unchanged(path, RunFolderError)
    with zarr_groups.errors_as(RunFolderError, path):
        root = zarr_groups.Group(path).attributes
        if root.get("format") != FORMAT:
            raise RunFolderError(f"{path}: was made by another version (its format is not '{FORMAT}')")
        if part and part not in parts(path):
            return xarray.Dataset()
        group = zarr_groups.Group(path, part, consolidated=True)
        for name in group.names:
            array = group[name]
            if zarr_groups.stored_chunks(array) < array.nchunks:
                raise ValueError(f"{name} has {zarr_groups.stored_chunks(array)} of {array.nchunks} chunks")
        return zarr_groups.open_dataset(path, group=part or None, consolidated=True, chunks=None)


def parts(path: Path) -> list[str]:
    """Return the names of the groups in a file of pictures, such as "wind"."""
    inner = (file.parent for file in path.glob("*/zarr.json"))
    return sorted(folder.name for folder in inner if (folder / "time" / "zarr.json").exists())


def complete(path: Path) -> int:
    """Cut the parts of an interrupted run's pictures to those that are complete; return the number of the main part.

    Raises RunFolderError.
    """
    from taichi_plume.files import zarr_groups

    with zarr_groups.errors_as(RunFolderError, path):
        counts = [zarr_groups.complete(path, part) for part in parts(path)]
        is_main = "time" in zarr_groups.Group(path).names
        return zarr_groups.complete(path) if is_main else max(counts, default=0)
