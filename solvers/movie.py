"""A plume of someone else's movie as a gas on the grid."""

import numpy as np
import taichi as ti

from taichi_plume.files.movie import Movie
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.played import MovieGas
from taichi_plume.solvers.playback import PlayedGas

NAME = "concentration"


class MovieFrames:
    """A movie's pictures on a grid, in the file's unit: of each cell the mean over its area.

    Pixels are squares of one value and beyond the picture there is none, so the sum over cells is that over what the
    domain holds of the picture, whether cells or pixels are the larger ones.
    """

    def __init__(self, movie: Movie, grid: Grid):
        self.movie, self.grid = movie, grid
        self.times = movie.times
        self.edges = [
            (np.arange(n + 1) * grid.dx - low) / movie.pixel
            for n, low in zip(grid.shape[:2], movie.origin, strict=True)
        ]

    def gas_of(self, species: object) -> str:
        return NAME

    def still(self, name: str) -> np.ndarray:
        """Pictures know no obstacles: all is air."""
        return np.ones(self.grid.shape)

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Values of frame n, axes (x, y, z), the same at every height. Raises FilmError where it is damaged."""
        values = self.movie.frame(n)
        for axis, edges in enumerate(self.edges):
            values = means(values, edges, axis)
        if self.grid.dim == 3:
            values = np.repeat(values[:, :, None], self.grid.shape[2], axis=2)
        return dict.fromkeys(names, values)


def means(values: np.ndarray, edges: np.ndarray, axis: int) -> np.ndarray:
    """Means along an axis between edges [in its steps]; what lies outside counts as zero."""
    values = np.moveaxis(values, axis, 0)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    at = np.clip(edges, 0, len(values))
    whole = np.minimum(at.astype(int), len(values) - 1)
    upto = total[whole] + (at - whole)[:, None] * values[whole]
    mean = np.diff(upto, axis=0) / np.diff(edges)[:, None]
    return np.moveaxis(np.maximum(mean, 0.0), 0, axis)  # rounding


@ti.data_oriented
class PlayedMovie(PlayedGas):
    """A recorded gas whose frames are pictures."""

    def __init__(self, gas: MovieGas, movie: Movie, grid: Grid, t: float = 0.0):
        super().__init__(gas, MovieFrames(movie, grid), grid, t)

    def begin(self, model: MovieGas, t: float, seed: int) -> None:
        self.density = model.ppm_per_unit / model.vapour.ppm_per_density
        super().begin(model, t, seed)

    def _prepare(self, frame: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], None]:
        """Values [kg/m³] with all ghost layers."""
        return {name: self.grid.pad(self.density * values) for name, values in frame.items()}, None
