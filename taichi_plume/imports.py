"""Where the files of an imported wind lie in the domain."""

from pathlib import Path

import numpy as np

from taichi_plume import occupancy, wind_files
from taichi_plume.grid import Grid
from taichi_plume.interpolation import Interpolation
from taichi_plume.wind_files import Points, WindFileError
from taichi_plume.winds import ImportedWind


class Site:
    """Files with their times [s], and how the domain lies among their points.

    first: the points of the first file; low, high: corners of the box that they fill [m], from the domain's lower
    corner; origin: that corner in the files [m]; height: z in the files of a 2-D run's section [m]; cubes: the
    obstacles of the occupancy grid, if there is one.
    """

    def __init__(self, wind: ImportedWind, dim: int, folder: Path):
        """Raises WindFileError."""
        self.wind = wind
        self.files = wind_files.find(folder, wind.files, wind.interval)
        self.first = wind_files.read(self.files[0][1])
        known = Interpolation(self.first.place)
        grid = occupancy.read(folder / wind.occupancy) if wind.occupancy else None
        corner = known.low if grid is None else grid.low
        self.origin = np.array(wind.origin or corner[:dim])
        self.low, self.high = known.low[:dim] - self.origin, known.high[:dim] - self.origin
        self.slack = known.slack
        z = self.first.place[:, -1]
        self.height = (
            (z.min() + z.max()) / 2 if wind.height is None else np.clip(wind.height, z.min(), z.max())
        )
        self.cubes = occupancy.Cubes(grid, dim, self.origin, float(self.height)) if grid else None

    def read(self, path: Path) -> Points:
        """The points of a file, as many as the first one has. Raises WindFileError."""
        points = wind_files.read(path)
        if points.place.shape != self.first.place.shape:
            raise WindFileError(
                f"{path}: has {len(points.place)} points, but {self.first.path.name} has {len(self.first.place)}; "
                "is it whole?"
            )
        return points

    def places(self, grid: Grid, face: int | None = None) -> list[np.ndarray]:
        """Coordinates in the files of the faces of an axis, or of cell centres, per axis of the points [m].

        Other than along this axis there is one more beyond each end. What lies still farther from the points has the
        coordinate where they end: there the flow goes on unchanged.
        """
        axes = []
        for a, n in enumerate(grid.shape):
            x = grid.dx * (np.arange(n + 1) if a == face else np.arange(-1, n + 1) + 0.5)
            axes.append(
                self.origin[a] + np.clip(x, self.low[a] - 0.5 * grid.dx, self.high[a] + 0.5 * grid.dx)
            )
        if self.first.place.shape[1] > grid.dim:
            axes.append(np.array([self.height]))
        return axes
