"""Gas from a movie file: pictures of a plume from above, made by another program."""

from collections.abc import Iterator
from typing import Annotated, Literal

from taichi_plume.scenario.domain import Context, span
from taichi_plume.scenario.played import Played
from taichi_plume.scenario.sources import OneGas, Target
from taichi_plume.scenario.vocabulary import COMPILED, FileName, Frequency, FullScale, Length, Point2


class MovieGas(OneGas, Played):
    """A plume in pictures, such as of plume-nav-sim, linear in time between them.

    Pixels are squares. A cell takes the mean over its area; beyond the picture the air is clean. In 3-D the gas is the
    same at every height. The wind is that of the scenario.
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
    """Concentration in ppm of the value 1 in the file."""
    sources: tuple[Target, ...] = ()
    """Places that robots search for, as a movie has no sources; they emit nothing, the plume is given."""

    def unusable(self, where: str, context: Context) -> Iterator[str]:
        movie, extent = context.resources.movies[where], context.domain.extent
        (x, y), (width, height) = movie.origin, movie.size
        if not (x < extent[0] and y < extent[1] and x + width > 0 and y + height > 0):
            yield (
                f"{where}: no pixel of {movie.path} is in the domain, {context.domain.box}; they are within "
                f"{span('x', x, x + width)}, {span('y', y, y + height)}; give an origin"
            )
        yield from self.too_late(where, movie.path, movie.times[-1])

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        if not self.sources and context.scenario.robots:
            yield f"{where}.sources: none, so robots cannot find any; give their positions"
