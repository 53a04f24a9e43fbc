"""The gas maps that a run left in maps.zarr, as far as a report shows them."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.opening import irregular, unopenable

NAME = "maps.zarr"


class MapAtEnd(NamedTuple):
    """A map of the first trial at the end of a run: estimate and truth (ny, nx) [ppm], cell [m]."""

    name: str
    cell: float
    estimate: np.ndarray
    truth: np.ndarray


def maps_of(folder: Path) -> list[MapAtEnd]:
    """Those of a run; none where it left none. Raises RunFolderError.

    By zarr alone: xarray would take longer than the drawing.
    """
    path = folder / NAME
    if not path.exists():
        return []
    reason = unopenable(path, folder=True) or irregular(path)
    if reason:
        raise RunFolderError(f"{path}: {reason}")
    import zarr

    from taichi_plume.files.maps_file import FORMAT
    from taichi_plume.files.zarr_groups import FAULTS
    from taichi_plume.files.zarr_groups import reason as why

    try:
        root: Any = zarr.open_group(path, mode="r", use_consolidated=False)
        if root.attrs.get("format") != FORMAT:
            raise RunFolderError(f"{path}: was made by another version (its format is not '{FORMAT}')")
        return [_map(root, n) for n in range(int(root.attrs["maps"]))]
    except RunFolderError:
        raise
    except FAULTS as error:
        raise RunFolderError(f"{path}: is damaged: {why(error)}") from None


def _map(root: Any, n: int) -> MapAtEnd:
    group = root[str(n)]
    kind, x = str(group.attrs["kind"]).replace("_", " "), group["x"][:]
    estimate, truth = np.asarray(group["estimate"][0], float), np.asarray(group["truth"][0], float)
    if estimate.ndim != 2 or estimate.shape != truth.shape:
        raise ValueError(f"map {n} has an estimate of {estimate.shape}")
    return MapAtEnd(f"{kind} map", 2.0 * float(x[0]), estimate, truth)
