"""Winds of GADEN without positions: binary files with a velocity per cell of the grid, and uniform winds.

    wind_iteration_N, NAME_N.csv_gaden    GADEN 2.6 and 3: int32 major, minor version; float32 u, v, w of each cell
    NAME_N.csv_U, _V, _W                  GADEN 1 to 2.5: int32 999; float64 of each cell
    wind_iteration_N                      results of GADEN 1 to 2.5: float64 u of all cells, then v, then w
    any name                              uniform wind: a line u,v,w per time

All are in m/s and little-endian. Cells count x first, then y, then z; the occupancy grid has their positions.
"""

from pathlib import Path

import numpy as np

from taichi_plume.files.gaden import Occupancy
from taichi_plume.files.tables import Table, TextFile, cells_of, delimiter_of, is_number
from taichi_plume.files.wind_points import FASTEST, Points, WindFileError
from taichi_plume.guard.safe_open import content_of, encoding_of, open_regular

LARGEST_FILE = 1 << 30  # bytes
PARTS = (".csv_U", ".csv_V", ".csv_W")
START = 1 << 12  # bytes, in which the first line ends
OLD_MARK = 999  # at the start of files of a component
VERSIONS = (2, 3)  # major versions that a header names


def is_binary(path: Path) -> bool:
    """Return whether a path has the name of a binary wind of GADEN."""
    return path.name.startswith("wind_iteration_") or path.name.endswith((".csv_gaden", *PARTS))


def read(path: Path, grid: Occupancy) -> Points:
    """Return centres and velocities of the cells of a grid from a binary wind of GADEN. Raises WindFileError."""
    shape = grid.cubes.shape
    count = grid.cubes.size
    if path.name.endswith(PARTS):
        stem = str(path)[: -len(PARTS[0])]
        u = np.stack([_component(Path(stem + part), count) for part in PARTS], axis=1)
    else:
        u = _velocities(path, count)
    fastest = np.abs(u).max(initial=0.0)
    if not fastest < FASTEST:  # also if not all are finite
        raise WindFileError(f"{path}: holds {fastest:.3g} m/s; all must be finite and below {FASTEST:g} m/s")
    z, y, x = np.meshgrid(*(np.arange(n) for n in shape[::-1]), indexing="ij")
    cells = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    place = grid.low + grid.size * (cells + 0.5)
    return Points(path, place, u, None, (grid.low, grid.high), form="cells of GADEN's grid")


def _velocities(path: Path, count: int) -> np.ndarray:
    content = content_of(path, LARGEST_FILE, WindFileError)
    header = np.frombuffer(content, "<i4", 2) if len(content) >= 8 else np.zeros(2)
    if len(content) == 8 + 12 * count and header[0] in VERSIONS:
        return np.frombuffer(content, "<f4", offset=8).reshape(count, 3).astype(float)
    if len(content) == 24 * count:
        return np.frombuffer(content, "<f8").reshape(3, count).T
    raise WindFileError(
        f"{path}: has {len(content):,} bytes; a wind on the {count:,} cells of wind.occupancy has {8 + 12 * count:,} "
        f"(GADEN 2.6 and 3) or {24 * count:,} (older)"
    )


def _component(path: Path, count: int) -> np.ndarray:
    content = content_of(path, LARGEST_FILE, WindFileError)
    if len(content) != 4 + 8 * count or int.from_bytes(content[:4], "little") != OLD_MARK:
        raise WindFileError(
            f"{path}: has {len(content):,} bytes; a component on the {count:,} cells of wind.occupancy has "
            f"{4 + 8 * count:,}, which begin with the number {OLD_MARK}"
        )
    return np.frombuffer(content, "<f8", offset=4)


# ---------------------------------------------------------------- uniform


def uniform(path: Path) -> np.ndarray:
    """Return the velocities (times, 3) [m/s] of GADEN's uniform wind: a line u,v,w per time. Raises WindFileError."""
    file = TextFile(path, WindFileError)
    table = Table(file, file.rows(0), 3, delimiter_of(file.lines[0]), "three numbers: u, v, w in m/s")
    values = table.numbers(0, 1, 2)
    fast = ~(np.abs(values) < FASTEST).all(axis=1)
    table.refuse(fast, lambda row: f"{table.shown(row)} is no velocity below {FASTEST:g} m/s")
    return values


def is_uniform(path: Path) -> bool:
    """Return whether a path names a file whose first line has three numbers and no name, as GADEN's uniform wind."""
    try:
        with open_regular(path) as file:
            content = file.read(START)
    except OSError:
        return False
    start = content.decode(encoding_of(content), "replace").splitlines()
    line = next((line for line in start if line.strip()[:1] not in ("", "#")), "")
    cells = cells_of(line, delimiter_of(line))
    return len(cells) == 3 and all(map(is_number, cells))
