"""OpenFOAM cases as imported wind: velocities at the cell centres, of all times, reconstructed or decomposed.

    constant/polyMesh/{points, faces, owner, neighbour}    the mesh; of a decomposed case in each processorN
    TIME/U, and TIME/nut if present                        the fields of a time [s]

Layout, regions and steady cases: files/openfoam_case.py.

The centre of a cell is the centroid of its volume, as in OpenFOAM (Jasak 1996, thesis, Imperial College): faces are
cut into triangles about the mean of their corners, cells into pyramids about the mean of their faces' centres. For
cells with plane faces this is exact.

No library is used: VTK, of half a GB, has points in single precision, and foamlib 1.7 took more than ten minutes for
20,000 faces of text.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np

from taichi_plume.files.openfoam_case import moment_of
from taichi_plume.files.openfoam_file import exists, open_foam, real_path, unresolved_macro
from taichi_plume.files.wind_points import FARTHEST, FASTEST, Points, WindFileError
from taichi_plume.grid.interpolation import SAME
from taichi_plume.guard.safe_open import admit

PARTS = ("points", "faces", "owner", "neighbour")

EVEN = 0.99  # least thickness over largest of a layer of cells of a plane flow

Mesh = tuple[np.ndarray, np.ndarray]
"""Centres of cells (n, 3), and of the points that faces use: lower corner, upper corner, and smallest distance along
each axis from the mean of the centres (3, 3), [m]."""


def read(path: Path) -> Points:
    """Return cell centres and velocities of an OpenFOAM case at the time folder `path`. Raises WindFileError."""
    folders, has_nut = _folders(path), nut_fault(path) == ""
    velocity, eddies, remarks = [], [], []
    for mesh, fields in folders:
        size = len(_mesh(mesh)[0])
        file = open_foam(fields / "U")
        if not file.require_dimensions("m/s", "a velocity"):
            remarks.append(f"{file.path}: states no dimensions; its values are taken as m/s")
        velocity.append(file.field(3, size))
        if has_nut:
            file = open_foam(fields / "nut")
            file.require_dimensions("m^2/s", "an eddy viscosity")
            eddies.append(file.field(1, size)[:, 0])
    u = np.concatenate(velocity)
    if len(u) < 4:
        raise WindFileError(f"{path}: has {len(u)} cells, too few")
    if np.abs(u).max() >= FASTEST:
        raise WindFileError(f"{path}: {np.abs(u).max():.3g} m/s in U is too fast for air")
    meshes = [_mesh(mesh) for mesh, _ in folders]
    place = np.concatenate([centres for centres, _ in meshes])
    corners = np.stack([box for centres, box in meshes if len(centres)])
    box = (corners[:, 0].min(axis=0), corners[:, 1].max(axis=0))
    extent, thick, thin = np.ptp(place, axis=0), box[1] - box[0], 2.0 * corners[:, 2].min(axis=0)
    for a in np.flatnonzero((extent <= SAME * extent.max()) & (thin < EVEN * thick)):
        raise WindFileError(
            f"{path}: its mesh has one layer of cells along {'xyz'[a]}, {round(thin[a], 9):.3g} to {thick[a]:.3g} m "
            "thick: a wedge, whose flow is axisymmetric, which is not read"
        )
    eddy_viscosity = np.maximum(np.concatenate(eddies), 0.0) if eddies else None
    return Points(path, place, u, eddy_viscosity, box, tuple(remarks[:1]), "cell centres of OpenFOAM")


def _folders(path: Path) -> list[tuple[Path, Path]]:
    """Return the folders (mesh, fields) of the parts of a time. Raises WindFileError."""
    moment = moment_of(path)
    if moment is None:
        raise WindFileError(f"{path}: is no time of a case of OpenFOAM")
    return moment.folders


def nut_fault(path: Path) -> str | None:
    """Return why the eddy viscosity of a time cannot be read; "" if it can, None if the time has none.

    Raises WindFileError.
    """
    files = [fields / "nut" for _, fields in _folders(path)]
    if not any(map(exists, files)):
        return None
    for file in files:
        if not exists(file):
            return f"{file}: is missing"
        if macro := unresolved_macro(file):
            return f"{file}: is a macro of OpenFOAM ({macro}), which is not resolved"
    return ""


def admit_files(path: Path) -> None:
    """Record all files that `read` opens as inputs of the run. Raises WindFileError if one may not be read."""
    for mesh, fields in _folders(path):
        for file in (*(mesh / name for name in PARTS), fields / "U", fields / "nut"):
            if exists(file):
                _admit(real_path(file))


def _admit(file: Path) -> None:
    try:
        admit(file)
    except OSError as error:
        raise WindFileError(f"{file}: {error.strerror}") from None


def _mesh(folder: Path) -> Mesh:
    """Return the cell centres and the box of the OpenFOAM mesh in a folder polyMesh."""
    files = [real_path(folder / name) for name in PARTS if exists(folder / name)]
    for file in files:
        _admit(file)
    return _mesh_of(folder, tuple(file.stat().st_mtime_ns for file in files))


@lru_cache(maxsize=64)
def _mesh_of(folder: Path, _changed: tuple[int, ...]) -> Mesh:
    points = open_foam(folder / "points").numbers(3)
    flat, ends = open_foam(folder / "faces").faces()
    owner = open_foam(folder / "owner").labels()
    neighbour = open_foam(folder / "neighbour").labels()
    cells = int(max(owner.max(initial=-1), neighbour.max(initial=-1))) + 1
    if not cells and not len(ends):  # a processor without cells
        return np.empty((0, 3)), np.empty((3, 3))
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
        raise WindFileError(f"{folder}: its points, faces, owner and neighbour do not belong together")
    center, area = _faces(points, flat, ends)
    pairs = np.concatenate([owner, neighbour])
    faces = np.concatenate([np.arange(len(owner)), np.arange(len(neighbour))])
    sign = np.repeat([1.0, -1.0], [len(owner), len(neighbour)])
    centres = _volumes(center[faces], sign[:, None] * area[faces], pairs, cells, folder)
    corners = points[flat]
    away = np.abs(corners - centres.mean(axis=0)).min(axis=0)
    return centres, np.stack([corners.min(axis=0), corners.max(axis=0), away])


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


def _volumes(center: np.ndarray, area: np.ndarray, cell: np.ndarray, cells: int, folder: Path) -> np.ndarray:
    """Return cell centroids (cells, 3) [m] from centre and outward area vector of each face of each cell."""
    count = np.bincount(cell, minlength=cells)
    if count.min() < 4:
        raise WindFileError(f"{folder}: cell {int(count.argmin())} has {int(count.min())} faces")
    middle = _sums(center, cell, cells) / count[:, None]
    volume = (area * (center - middle[cell])).sum(axis=1) / 3.0
    total = np.bincount(cell, volume, cells)
    if not (total > 0.0).all():
        raise WindFileError(f"{folder}: cell {int(total.argmin())} has no volume")
    away = 0.75 * (center - middle[cell])  # of a pyramid's centre from its tip
    return middle + _sums(volume[:, None] * away, cell, cells) / total[:, None]
