"""A gas that is a movie of someone else: pictures of a plume from above, in a file."""

from collections.abc import Iterator
from typing import Annotated, Literal

from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.played import Played
from taichi_plume.scenario.sources import OneGas, Target
from taichi_plume.scenario.vocabulary import COMPILED, FileName, Frequency, FullScale, Length, Point2


class MovieGas(OneGas, Played):
    """A plume in pictures, such as of plume-nav-sim, linear in time between them.

    Pixels are squares; a cell takes the mean over what it covers of them, clean air beyond the picture. In 3-D it is
    the same at every height. The wind is whatever the scenario says.
    """

    kind: Literal["movie"]
    file: FileName
    """Path of the movie, relative to the scenario's folder. It is a Zarr array or group, a .npy or an HDF5 file, with
    the axes (time, y, x)."""
    variable: str | None = None
    """Name of the variable in a group or an HDF5 file. Unless given it is `concentration`, else `plume`, else the only
    one there is."""
    frame_rate: Annotated[Frequency, COMPILED] | None = None
    """Frames per second; unless given, the file's attribute `fps`."""
    pixel: Annotated[Length, COMPILED] | None = None
    """Width of a pixel; unless given, the file's attribute `pixel_to_grid`, in metres."""
    origin: Annotated[Point2, COMPILED] | None = None
    """Where the picture's lower left corner lies in the domain, x and y. Unless given, it is the file's attribute
    `origin` (there y, x), else 0, 0."""
    rows: Literal["up", "down"] = "up"
    """Which way rows go: up, from the lowest y on, or down, from the highest on as in pictures."""
    ppm_per_unit: FullScale = 1.0
    """How many ppm the number 1 stands for in the file."""
    sources: tuple[Target, ...] = ()
    """Places that robots search for, which no movie tells; they emit nothing, the plume is given."""

    def unusable(self, where: str, context: Context) -> Iterator[str]:
        movie, extent = context.resources.movies[where], context.domain.extent
        (x, y), (width, height) = movie.origin, movie.size
        if not (x < extent[0] and y < extent[1] and x + width > 0 and y + height > 0):
            yield (
                f"{where}: no pixel of {movie.path} is in the domain, {context.domain.box}; they are within "
                f"x {x:.4g} to {x + width:.4g} m, y {y:.4g} to {y + height:.4g} m; give an origin"
            )
        if self.start > movie.times[-1] and not self.loop:
            yield (
                f"{where}.start: {self.start:g} s is after the last frame of {movie.path}; it has 0 to "
                f"{movie.times[-1]:g} s"
            )

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        if not self.sources and context.scenario.robots:
            yield f"{where}.sources: none, and a movie tells of none: no robot can find any; give their places"
