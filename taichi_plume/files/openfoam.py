"""OpenFOAM cases as imported wind: velocities at the cell centres, of all times, reconstructed or decomposed.

    constant/polyMesh/{points, faces, owner, neighbour}    the mesh; of a decomposed case in each processorN
    TIME/U, and TIME/nut if present                        the fields of a time [s]

The centre of a cell is the centroid of its volume, as in OpenFOAM (Jasak 1996, thesis, Imperial College): faces are
cut into triangles about the mean of their corners, cells into pyramids about the mean of their faces' centres. For
cells with plane faces this is exact.

No library is used: VTK, of half a GB, has points in single precision, and foamlib 1.7 took more than ten minutes for
20,000 faces of text.
"""

import os
import re
from functools import lru_cache
from pathlib import Path

import numpy as np

from taichi_plume.files.openfoam_file import exists, open_foam, real_path
from taichi_plume.files.wind_points import FARTHEST, FASTEST, MOST_NUMBER, Points, WindFileError
from taichi_plume.guard.safe_open import admit

MESH = "constant/polyMesh"
PARTS = ("points", "faces", "owner", "neighbour")
TIME = re.compile(r"\d+(\.\d*)?(e[-+]?\d+)?", re.IGNORECASE)


def is_case(path: Path) -> bool:
    """Return whether a path is the folder of an OpenFOAM case, reconstructed or decomposed."""
    return any(os.path.isdir(path / part / MESH) for part in (".", "processor0"))


def is_time(path: Path) -> bool:
    """Return whether a path CASE/TIME names a time of an OpenFOAM case; the folder TIME itself need not exist."""
    return TIME.fullmatch(path.name) is not None and is_case(path.parent)


def times(case: Path) -> list[tuple[float, Path]]:
    """Return (time [s], folder) for all times of an OpenFOAM case, in order. Raises WindFileError."""
    names = {key: name for part in _parts(case)[:1] for key, name in _times(part).items()}
    late = max(names, default=0.0)
    if late > MOST_NUMBER:
        raise WindFileError(f"{case / names[late]}: its time is above {MOST_NUMBER:g} s")
    if not names:
        raise WindFileError(f"{case}: has no time folder with a file U")
    return [(key, case / names[key]) for key in sorted(names)]


def read(path: Path) -> Points:
    """Return cell centres and velocities of an OpenFOAM case at the time folder `path`. Raises WindFileError."""
    case, velocity, eddies = path.parent, [], []
    parts = _parts(case, path.name)
    for part in parts:
        folder, size = part / path.name, len(_centres(part))
        velocity.append(open_foam(folder / "U").field(3, size))
        if exists(folder / "nut"):
            eddies.append(open_foam(folder / "nut").field(1, size)[:, 0])
    if eddies and len(eddies) < len(parts):
        raise WindFileError(f"{path}: only some of its parts have a file nut")
    u = np.concatenate(velocity)
    if len(u) < 4:
        raise WindFileError(f"{case}: has {len(u)} cells, too few")
    if np.abs(u).max() >= FASTEST:
        raise WindFileError(f"{path}: {np.abs(u).max():.3g} m/s in U is too fast for air")
    place = np.concatenate([_centres(part) for part in parts])
    return Points(path, place, u, np.maximum(np.concatenate(eddies), 0.0) if eddies else None)


def _parts(case: Path, time: str = "") -> list[Path]:
    """Return [case], or its processor folders if only these hold the time. Raises WindFileError if it is no case.

    time: name of the time to read, by default all times.
    """
    whole = [case] if (case / MESH).is_dir() else []
    split, n = [], 0
    while (case / f"processor{n}" / MESH).is_dir():
        split.append(case / f"processor{n}")
        n += 1
    if not whole and not split:
        raise WindFileError(f"{case}: is no case of OpenFOAM: neither the folder nor processor0 has {MESH}")
    if not whole or not split:
        return whole or split
    if time:
        return whole if exists(case / time / "U") else split
    return split if _times(split[0]).keys() - _times(case).keys() else whole


def _times(part: Path) -> dict[float, str]:
    try:
        names = [entry.name for entry in part.iterdir() if TIME.fullmatch(entry.name)]
    except OSError as error:
        raise WindFileError(f"{part}: cannot be read: {error.strerror or error}") from None
    return {float(name): name for name in names if exists(part / name / "U")}


def admit_files(path: Path) -> None:
    """Record all files that `read` opens as inputs of the run. Raises WindFileError if one may not be read."""
    for part in _parts(path.parent, path.name):
        for file in (*_mesh(part), part / path.name / "U", part / path.name / "nut"):
            if exists(file):
                _admit(real_path(file))


def _admit(file: Path) -> None:
    try:
        admit(file)
    except OSError as error:
        raise WindFileError(f"{file}: {error.strerror}") from None


def _mesh(part: Path) -> list[Path]:
    return [part / MESH / name for name in PARTS]


def _centres(part: Path) -> np.ndarray:
    """Return the cell centres (n, 3) [m] of an OpenFOAM mesh in a case or processor folder."""
    if any(exists(part / name / "polyMesh" / "points") for name in _times(part).values()):
        raise WindFileError(f"{part}: its mesh moves, which is not read")
    files = [real_path(file) for file in _mesh(part) if exists(file)]
    for file in files:
        _admit(file)
    return _centres_of(part, tuple(file.stat().st_mtime_ns for file in files))


@lru_cache(maxsize=64)
def _centres_of(part: Path, _changed: tuple[int, ...]) -> np.ndarray:
    points = open_foam(part / MESH / "points").numbers(3)
    flat, ends = open_foam(part / MESH / "faces").faces()
    owner = open_foam(part / MESH / "owner").labels()
    neighbour = open_foam(part / MESH / "neighbour").labels()
    cells = int(max(owner.max(initial=-1), neighbour.max(initial=-1))) + 1
    if (
        not len(points)
        or np.abs(points).max() > FARTHEST
        or flat.min(initial=0) < 0
        or flat.max(initial=0) >= len(points)
        or len(owner) != len(ends)
        or len(neighbour) > len(owner)
        or min(owner.min(initial=0), neighbour.min(initial=0)) < 0
        or not 0 < cells <= len(ends)
    ):
        raise WindFileError(f"{part / MESH}: its points, faces, owner and neighbour do not belong together")
    center, area = _faces(points, flat, ends)
    pairs = np.concatenate([owner, neighbour])
    faces = np.concatenate([np.arange(len(owner)), np.arange(len(neighbour))])
    sign = np.repeat([1.0, -1.0], [len(owner), len(neighbour)])
    return _volumes(center[faces], sign[:, None] * area[faces], pairs, cells, part)


def _sums(values: np.ndarray, into: np.ndarray, count: int) -> np.ndarray:
    """Sum vectors (n, 3) with the same index in `into` (n,); return the sums (count, 3)."""
    return np.stack([np.bincount(into, column, count) for column in values.T], axis=-1)


def _faces(points: np.ndarray, flat: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centres [m] and area vectors [m²] of polygons. flat: vertices of all polygons; ends: where each ends."""
    begin = np.concatenate([[0], ends[:-1]])
    sizes = ends - begin
    face = np.repeat(np.arange(len(ends)), sizes)
    after = np.arange(1, len(flat) + 1)
    after[ends - 1] = begin
    a, b = points[flat], points[flat[after]]
    middle = _sums(a, face, len(ends)) / sizes[:, None]
    normal = 0.5 * np.cross(b - a, middle[face] - a)
    area = _sums(normal, face, len(ends))
    size = np.maximum(np.linalg.norm(area, axis=1), 1e-300)
    # area of each triangle, projected on the normal of the whole face
    share = (normal * (area / size[:, None])[face]).sum(axis=1)
    total = np.bincount(face, share, len(ends))
    center = _sums(share[:, None] * (a + b + middle[face]) / 3.0, face, len(ends))
    flat_out = np.abs(total) < 1e-290
    return np.where(flat_out[:, None], middle, center / np.where(flat_out, 1.0, total)[:, None]), area


def _volumes(center: np.ndarray, area: np.ndarray, cell: np.ndarray, cells: int, part: Path) -> np.ndarray:
    """Return cell centroids (cells, 3) [m] from centre and outward area vector of each face of each cell."""
    count = np.bincount(cell, minlength=cells)
    if count.min() < 4:
        raise WindFileError(f"{part / MESH}: cell {int(count.argmin())} has {int(count.min())} faces")
    middle = _sums(center, cell, cells) / count[:, None]
    volume = (area * (center - middle[cell])).sum(axis=1) / 3.0
    total = np.bincount(cell, volume, cells)
    if not (total > 0.0).all():
        raise WindFileError(f"{part / MESH}: cell {int(total.argmin())} has no volume")
    away = 0.75 * (center - middle[cell])  # of a pyramid's centre from its tip
    return middle + _sums(volume[:, None] * away, cell, cells) / total[:, None]
