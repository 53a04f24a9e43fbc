"""The gas maps that a run left in maps.zarr, as far as a report shows them."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

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
    from taichi_plume.files.maps_file import opened

    with opened(path) as groups:
        return [_map(group) for group in groups]


def _map(group: Any) -> MapAtEnd:
    kind, x = str(group.attributes["kind"]).replace("_", " "), group["x"][:]
    estimate, truth = np.asarray(group["estimate"][0], float), np.asarray(group["truth"][0], float)
    if estimate.ndim != 2 or estimate.shape != truth.shape:
        raise ValueError(f"map {group.name} has an estimate of {estimate.shape}")
    made_by = group.attributes["groups"]  # of rivals the first trial is of the first
    whose = f" of {made_by[0]['names'][0]}" if len(made_by) > 1 else ""
    return MapAtEnd(f"{kind} map{whose}", 2.0 * float(x[0]), estimate, truth)
