"""Imported wind (CFD results): its files, and where the simulated domain lies in their coordinates."""

import os
from pathlib import Path

import numpy as np

from taichi_plume.files import gaden as occupancy
from taichi_plume.files import openfoam
from taichi_plume.files import wind_points as wind_files
from taichi_plume.files.wind_points import Points, WindFileError
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.interpolation import Interpolation
from taichi_plume.scenario.imported_wind import ImportedWind


class Site:
    """Files of an imported wind with their times [s], and the domain's position in them. Raises WindFileError.

    first: points of the first file; low, high: corners of the box of the points [m], from the domain's lower corner;
    origin: that corner in the files' coordinates [m]; height: for a 2-D run, z of the section in the files [m];
    levels: limits of z; cubes: obstacles of the occupancy grid, if given.
    """

    def __init__(self, wind: ImportedWind, dim: int, folder: Path):
        self.wind = wind
        self.files = _files(folder / wind.files) or wind_files.find(folder, wind.files, wind.interval)
        for _, path in self.files:  # files between the first and the last are not read before the run
            if openfoam.is_time(path):
                openfoam.admit_files(path)
        self.dim = dim
        self.first = _read(self.files[0][1])
        self._check(self.first)
        known = Interpolation(self.first.place)
        grid = occupancy.read(folder / wind.occupancy) if wind.occupancy else None
        corner = known.low if grid is None else grid.low
        self.origin = np.array(wind.origin or corner[:dim])
        self.low, self.high = known.low[:dim] - self.origin, known.high[:dim] - self.origin
        self.slack = known.slack
        if self.first.place.shape[1] == 3:
            self.levels = (known.low[2], known.high[2])
        else:
            self.levels = (grid.low[2], grid.high[2]) if grid else (0.0, 0.0)
        self.height = float(np.mean(self.levels)) if wind.height is None else wind.height
        self.cubes = occupancy.Cubes(grid, dim, self.origin, self.height) if grid else None

    def read(self, path: Path) -> Points:
        """Return points and velocities of a wind file, which must match the first file. Raises WindFileError."""
        points = _read(path)
        self._check(points)
        return points

    def _check(self, points: Points) -> None:
        path, first = points.path, self.first
        if points.place.shape[1] < self.dim:
            raise WindFileError(f"{path}: names no column for z and w, which a 3-D run needs")
        for a, x in enumerate(points.place.T[: self.dim]):
            if np.ptp(x) == 0.0:
                raise WindFileError(
                    f"{path}: all its points have {'xyz'[a]} = {x[0]:g} m, too few for a {self.dim}-D run"
                )
        if points.kind != first.kind:
            raise WindFileError(f"{path}: has other columns than {first.path.name}: z, w or nut")
        if len(points.place) != len(first.place):
            raise WindFileError(
                f"{path}: has {len(points.place)} points, but {first.path.name} has {len(first.place)}; is it whole?"
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


def _files(path: Path) -> list[tuple[float, Path]]:
    """Return (time [s], path) of all times of an OpenFOAM case, or (0, path) for one time; else an empty list."""
    if os.path.isdir(path) and openfoam.is_case(path):
        return openfoam.times(path)
    return [(0.0, path)] if openfoam.is_time(path) else []


def _read(path: Path) -> Points:
    return openfoam.read(path) if openfoam.is_time(path) else wind_files.read(path)
