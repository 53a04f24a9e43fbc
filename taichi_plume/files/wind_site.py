"""Imported wind (CFD results): its files, and where the simulated domain lies in their coordinates."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from taichi_plume.files import gaden as occupancy
from taichi_plume.files import gaden_winds, openfoam, openfoam_case
from taichi_plume.files import wind_points as wind_files
from taichi_plume.files.conventions import FileFacts, spans, when
from taichi_plume.files.wind_points import Points, WindFileError
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.interpolation import SAME, Interpolation
from taichi_plume.grid.point_box import box_of
from taichi_plume.scenario.imported_wind import ImportedWind

LARGE = 20.0  # times the domain's size, from which on the flow may be in another unit


class Site:
    """Files of an imported wind with their times [s], and the domain's position in them. Raises WindFileError.

    extent: edges of the simulated domain [m]. first: points of the first file; low, high: corners of the box that the
    mesh or, without one, the points fill (see `point_box`) [m], from the domain's lower corner; slack: tolerance of
    that box [m]; form: text on the points; origin: the domain's lower corner in the files' coordinates [m]; height: for
    a 2-D run, z of the section in the files [m]; levels: limits of z; cubes: obstacles of the occupancy grid, if given.
    """

    def __init__(self, wind: ImportedWind, extent: Sequence[float], folder: Path):
        self.wind, self.dim = wind, len(extent)
        case = openfoam_case.series(folder / wind.files)
        self.remarks = dict.fromkeys(case.remarks if case else ())  # without repeats, in their order
        self.grid = occupancy.read(folder / wind.occupancy) if wind.occupancy else None
        self.remarks |= dict.fromkeys(self.grid.remarks if self.grid else ())
        self._uniform = self._uniform_wind(folder / wind.files) if case is None else {}
        if case:
            self.files = case.files
        elif self._uniform:
            self.files = [(n * wind.interval, path) for n, path in enumerate(self._uniform)]
        else:
            self.files = wind_files.find(folder, wind.files, wind.interval)
        times = [path for _, path in self.files if openfoam_case.is_time(path)]
        for path in times:  # files between the first and the last are not read before the run
            openfoam.admit_files(path)
        faults = {path / "nut": openfoam.nut_fault(path) for path in times}
        self.has_nut = set(faults.values()) == {""}
        if not self.has_nut and any(fault is not None for fault in faults.values()):
            file, fault = next((file, fault) for file, fault in faults.items() if fault != "")
            remark = f"nut is left out of all times: {fault or f'{file}: is missing'}; eddy_viscosity can stand for it"
            self.remarks[remark] = None
        self.fastest, dim = 0.0, self.dim
        self.first = self._read(self.files[0][1])
        self._check(self.first)
        low, high, self.slack, self.form = self._box(extent)
        grid = self.grid
        corner = low if grid is None else grid.low
        self.origin = np.array(wind.origin or corner[:dim])
        self.low, self.high = low[:dim] - self.origin, high[:dim] - self.origin
        times_larger = ((high[:dim] - low[:dim]) / np.array(extent)).min()
        if times_larger > LARGE:
            remark = f"the flow is {times_larger:.3g} times as large as the domain; are its points in m?"
            self.remarks[remark] = None
        if self.first.place.shape[1] == 3:
            self.levels = (low[2], high[2])
        else:
            self.levels = (grid.low[2], grid.high[2]) if grid else (0.0, 0.0)
        self.height = float(np.mean(self.levels)) if wind.height is None else wind.height
        self.cubes = occupancy.Cubes(grid, dim, self.origin, self.height) if grid else None

    def _box(self, extent: Sequence[float]) -> tuple[np.ndarray, np.ndarray, float, str]:
        """Return the corners of the flow [m], their uncertainty [m], and a text on the form of its points."""
        if self.first.box is not None:
            return *self.first.box, 0.0, self.first.form
        box = box_of(Interpolation(self.first.place), extent, self.wind.points or self.first.stand)
        form = self.first.form or {"nodes": "nodes", "centres": "centres of cells"}[box.stand]
        if not box.is_known and not self.wind.origin and not self.wind.occupancy:
            remark = f"its points may be nodes or centres of cells; {form} are assumed; give points or origin"
            self.remarks[remark] = None
        return box.low, box.high, box.slack, form if box.is_known else f"{form} (assumed)"

    def read(self, path: Path) -> Points:
        """Return points and velocities of a wind file, which must match the first file. Raises WindFileError."""
        points = self._read(path)
        self._check(points)
        return points

    def _uniform_wind(self, path: Path) -> dict[Path, np.ndarray]:
        """Return the velocity (3,) [m/s] per line FILE:LINE of GADEN's uniform wind; {} for another file."""
        if not gaden_winds.is_uniform(path):
            return {}
        if self.grid is None:
            raise WindFileError(
                f"{path}: has velocities without positions (uniform wind); give wind.occupancy"
            )
        return {Path(f"{path}:{n}"): u for n, u in enumerate(gaden_winds.uniform(path), 1)}

    def _read(self, path: Path) -> Points:
        if path in self._uniform and self.grid is not None:
            low, high = self.grid.low, self.grid.high
            place = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
            velocity, form = (
                np.tile(self._uniform[path], (8, 1)),
                "corners of the grid (uniform wind of GADEN)",
            )
            return self._noted(Points(path, place, velocity, None, (low, high), form=form))
        wind, is_table = self.wind, False
        if openfoam_case.is_time(path):
            points = openfoam.read(path)
            points = points if self.has_nut else replace(points, eddy_viscosity=None)
        elif gaden_winds.is_binary(path):
            if self.grid is None:
                raise WindFileError(f"{path}: has no positions; give the grid as wind.occupancy")
            points = gaden_winds.read(path, self.grid)
        else:
            is_table, points = (
                True,
                wind_files.read(path, {str(key): name for key, name in wind.columns.items()}, wind.missing),
            )
        if not is_table and (wind.columns or wind.points or wind.missing):
            raise WindFileError(f"{path}: is no table, for which columns, points and missing are")
        return self._noted(points)

    def _noted(self, points: Points) -> Points:
        """Return the points after their remarks and their fastest velocity are noted."""
        self.remarks |= dict.fromkeys(points.remarks)
        self.fastest = max(self.fastest, float(np.linalg.norm(points.velocity, axis=1).max()))
        return points

    def facts(self) -> FileFacts:
        """Return what was read of the files, in their coordinates, and what was assumed."""
        first, times = self.first, np.array([time for time, _ in self.files])
        period = when(times) if len(times) > 1 else "one time, which holds"
        which = " in the first and last" if len(times) > 2 else ""
        ends = [*zip(self.low + self.origin, self.high + self.origin, strict=True), self.levels]
        box = spans(*zip(*ends[: first.place.shape[1]], strict=True))
        corner = ", ".join(f"{round(float(x), 6) + 0.0:.7g}" for x in self.origin)
        more = f"; assumed: {first.assumed}" if first.assumed else ""
        more += "; eddy viscosity nut" if first.eddy_viscosity is not None else ""
        text = (
            f"{period}; {len(first.place):,} {self.form}, {self.fastest:.3g} m/s at most{which}, {box}{more}"
        )
        return FileFacts(f"{text}; the domain begins at ({corner})", tuple(self.remarks))

    def _check(self, points: Points) -> None:
        path, first = points.path, self.first
        if points.place.shape[1] < self.dim:
            raise WindFileError(f"{path}: names no column for z and w, which a 3-D run needs")
        extent = np.ptp(points.place, axis=0)
        flat = extent <= SAME * extent.max()
        for a in np.flatnonzero(flat[: self.dim]):
            if openfoam_case.is_time(path):
                raise WindFileError(_one_layer(path, "xyz"[a], self.dim))
            raise WindFileError(
                f"{path}: all its points have {'xyz'[a]} = {points.place[0, a]:g} m, too few for a {self.dim}-D run"
            )
        if points.kind != first.kind:
            raise WindFileError(f"{path}: has other columns than {first.path.name}: z, w or nut")
        count, known = (len(of.place) + of.left_out for of in (points, first))
        if count != known:
            raise WindFileError(
                f"{path}: has {count} points, but {first.path.name} has {known}; is it whole?"
            )

    def places(self, grid: Grid, face: int | None = None) -> list[np.ndarray]:
        """Return the file coordinates [m], per axis, of the grid's faces normal to axis `face`, or of its cell centres.

        Along other axes there is a ghost cell beyond each end. Coordinates are limited to half a cell beyond the
        points: farther out the flow is constant.
        """
        axes = []
        for a, n in enumerate(grid.shape):
            x = grid.dx * (np.arange(n + 1) if a == face else np.arange(-1, n + 1) + 0.5)
            low, high = self.low[a] - 0.5 * grid.dx, self.high[a] + 0.5 * grid.dx
            axes.append(self.origin[a] + np.clip(x, low, high))
        if self.first.place.shape[1] > grid.dim:
            axes.append(np.array([self.height]))
        return axes


def _one_layer(path: Path, axis: str, dim: int) -> str:
    """Return an error: the mesh has only one layer of cells along an axis that the run needs."""
    start = f"{path}: its mesh has one layer of cells along {axis} (empty faces)"
    if dim == 2:
        how = " '(-90 0 0)'" if axis == "y" else " '(0 90 0)'"
        return (
            f"{start}, but a 2-D run is horizontal and needs the one layer along z; turn mesh and fields, such as by "
            f"transformPoints -rotateFields -rollPitchYaw{how}, or compute in 3-D"
        )
    hint = "give domain.size two numbers" if axis == "z" else "use a mesh with several layers"
    return f"{start}, but a 3-D run needs several; {hint}"
