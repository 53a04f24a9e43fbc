"""Playback of recorded winds and gases: frames of an earlier run, pictures of a movie, points in logs of PlumeSim."""

from collections.abc import Iterator
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, ends_early, span
from taichi_plume.scenario.sources import OneGas, Target
from taichi_plume.scenario.vocabulary import FileName, Model
from taichi_plume.scenario.wind_base import AnyWind

if TYPE_CHECKING:
    from taichi_plume.files.film import Film


class Played(Model):
    """Playback of recorded frames, once or in a loop."""

    loop: bool = False
    """Start again at the end of the frames; otherwise the last frame holds."""
    rate: si.SomeCoefficient = 1.0
    """Seconds of the frames per simulated second; their velocities stay as they are."""
    start: si.Time = 0.0
    """Time of the frames that is shown when the robots start."""

    key: ClassVar[str] = "file"
    """Key of the file with the frames."""
    steps: ClassVar[bool] = False
    """Whether each frame holds until the next one; otherwise playback is linear in time."""

    @property
    def looped(self) -> tuple[float, float]:
        """Times [s] of the first and the last frame that a loop repeats; infinite for all."""
        return -inf, inf

    def recorded(self, where: str, context: Context) -> tuple[str | Path, int, float]:
        """Return the file of the frames, their number, and the time [s] of the frames at which they end."""
        raise NotImplementedError

    def too_late(self, where: str, context: Context) -> Iterator[str]:
        """Yield an error if playback without loop starts after the end of the frames. One frame is a steady state."""
        file, count, last = self.recorded(where, context)
        late = self.start > last or (self.start == last and self.steps)
        if late and count > 1 and not self.loop:
            yield f"{where}.start: {self.start:g} s is after the end of {file} at {last:g} s"

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        yield from super().warnings(where, context)
        file, count, last = self.recorded(where, context)
        if count > 1 and not self.loop:
            then = f"the last frame holds; {where}.loop: true repeats them"
            yield from ends_early(f"{where}.{self.key}", file, (last - self.start) / self.rate, then, context)


class Playback(Played):
    """Playback of a recorded run (see `fields`), linear in time between frames, also from the last to the first."""

    part: ClassVar[Literal["wind", "gas"]]
    """Recorded quantity that is played back."""
    file: FileName
    """Path of a fields.zarr that an earlier run wrote, relative to the scenario's folder."""

    density_per_unit: ClassVar[float] = 1.0
    """Concentration [kg/m³] of the value 1 in the file."""

    def file_errors(self, where: str, context: Context) -> Iterator[str]:
        film = context.resources.films[where]
        recorded = [name for name, variables in (("wind", film.wind), ("gas", film.gas)) if variables]
        if self.part not in recorded:
            yield (
                f"{where}.file: {film.path}: holds no {self.part}, only {', '.join(recorded) or 'nothing'}; record "
                f"with fields.quantities: [{self.part}]"
            )
        elif errors := list(self._another_domain(film, context)):
            yield from errors
        elif differing := context.resources.unlike(where):
            yield (
                f"obstacles: {differing} cells are not as in {film.path}, which {self.part} plays back; "
                "give the obstacles of the recorded run"
            )
        yield from self.too_late(where, context)

    def recorded(self, where: str, context: Context) -> tuple[str | Path, int, float]:
        film = context.resources.films[where]
        return film.path, len(film.times), film.times[-1]

    def _another_domain(self, film: "Film", context: Context) -> Iterator[str]:
        """Yield an error if the grid of the recorded run differs from that of the scenario."""
        domain = context.domain
        if domain.shape != film.shape or abs(domain.spacing - film.dx) > 1e-6 * film.dx:
            size = ", ".join(f"{n * film.dx:.6g}" for n in film.shape)
            yield (
                f"domain: {_cells(domain.shape, domain.spacing)}, but {film.path}, which {self.part} plays back, has "
                f"{_cells(film.shape, film.dx)}; use size: [{size}], spacing: {film.dx:g}"
            )
        elif self.part == "gas" and domain.dim == 2 and abs(domain.depth - film.depth) > 1e-6 * film.depth:
            yield (
                f"domain.depth: {domain.depth:g} m, but the gas of {film.path} was recorded in {film.depth:g} m; "
                f"use depth: {film.depth:g}"
            )


class PlaybackWind(AnyWind, Playback):
    """The air flow of a recorded run."""

    part: ClassVar[Literal["wind", "gas"]] = "wind"
    kind: Literal["playback"]


class PointPlayback(Played):
    """Frames of points, played back as PlumeSim does: each holds until the next one.

    Points lie in a plane; in 3-D they are the same at every height. What is read at a place is the value of the nearest
    point that is closer than the cell, else zero.
    """

    steps: ClassVar[bool] = True
    offset: si.Point2 = (0.0, 0.0)
    """Added to the positions of the points, x and y, to move them into the room."""
    interpolate: bool = False
    """Read between points, bilinear on a lattice as wide as the cell; zero at a cell from the last of them. Otherwise
    the nearest point counts, as in PlumeSim."""

    def file_errors(self, where: str, context: Context) -> Iterator[str]:
        frames, extent = context.resources.frames[where], context.domain.extent
        place = frames.place + np.array(self.offset)
        low, high = place.min(axis=0), place.max(axis=0)
        if not ((place > -frames.cell) & (place < np.array(extent[:2]) + frames.cell)).all(axis=1).any():
            yield (
                f"{where}: no point of {frames.path} is in the domain, {context.domain.box}; they are within "
                f"{span('x', low[0], high[0])}, {span('y', low[1], high[1])}; give an offset"
            )
        yield from self.too_late(where, context)

    def recorded(self, where: str, context: Context) -> tuple[str | Path, int, float]:
        frames = context.resources.frames[where]
        return frames.path, len(frames), len(frames) * frames.period


class PlumeSimLog(PointPlayback):
    """A text log of PlumeSim; see point_frames.py. `plumesim_log` makes a run write one."""

    file: FileName
    """Path of a log of PlumeSim, relative to the scenario's folder."""


class PlumeSimWind(AnyWind, PlumeSimLog):
    """The wind of a log at points, for sensors; it cannot carry gas on the grid."""

    on_grid: ClassVar[bool] = False
    kind: Literal["plumesim_log"]

    def file_errors(self, where: str, context: Context) -> Iterator[str]:
        yield from super().file_errors(where, context)
        scenario = context.scenario
        for path, gas in scenario.gases:
            if gas.on_grid:
                yield (
                    f"{path}.kind: a wind of kind plumesim_log is known only at points and cannot carry eulerian gas; "
                    "use gas of kind plumesim_log, or another wind"
                )
        if scenario.fields is not None and "wind" in scenario.fields.quantities:
            yield "fields.quantities: a wind of kind plumesim_log is not on the grid; use quantities: [gas]"


def _cells(shape: tuple[int, ...], dx: float) -> str:
    """Return the size of a grid in words, such as "80 x 60 cells of 0.05 m"."""
    return f"{' x '.join(map(str, shape))} cells of {dx:g} m"


class MovieGas(OneGas, Played):
    """A plume in pictures, such as of plume-nav-sim, linear in time between them.

    Pixels are squares. A cell takes the mean over its area; beyond the picture the air is clean. In 3-D the gas is the
    same at every height. The wind is that of the scenario.
    """

    kind: Literal["movie"]
    file: FileName
    """Path of the movie, relative to the scenario's folder. It is a Zarr array or group, a NetCDF, HDF5, MATLAB 7.3
    or .npy file. Units, packing, missing values and coordinates that the file states count."""
    variable: str | None = None
    """Name of the variable, with its groups as in plume/run_1. Unless given it is `concentration`, else `plume`, else
    the only one there is."""
    axes: tuple[Literal["time", "y", "x"], Literal["time", "y", "x"], Literal["time", "y", "x"]] | None = None
    """Order of the array's axes, if the file does not name them. Unless given, it is time, y, x; in MATLAB's files, as
    MATLAB shows it, y, x, time."""
    frame_rate: si.Frequency | None = None
    """Frames per second; unless given, by the times of the file, or its attribute `fps`."""
    pixel: si.Length | None = None
    """Width of a pixel; unless given, by the coordinates of the file, or its attribute `pixel_to_grid`."""
    origin: si.Point2 | None = None
    """Position of the picture's lower left corner in the domain, x and y. Unless given, it is that of the file's
    coordinates, or its attribute `origin` (there y, x), else 0, 0."""
    rows: Literal["up", "down"] = "up"
    """Order of the rows, if the file has no coordinate y. Up is from the lowest y on, down from the highest y on as in
    pictures."""
    ppm_per_unit: si.FullScale | None = None
    """Concentration in ppm of the value 1 in the file, if the file states no unit. Unless given, values are ppm."""
    sources: tuple[Target, ...] = ()
    """Places that robots search for, as a movie has no sources; they emit nothing, the plume is given."""

    @property
    def density_per_unit(self) -> float:
        """Concentration [kg/m³] for the pixel value 1 of a movie, after conversion by the unit of its file."""
        return (self.ppm_per_unit or 1.0) / self.vapour.ppm_per_density

    def file_errors(self, where: str, context: Context) -> Iterator[str]:
        movie, extent = context.resources.movies[where], context.domain.extent
        (x, y), (width, height) = movie.origin, movie.size
        if not (x < extent[0] and y < extent[1] and x + width > 0 and y + height > 0):
            yield (
                f"{where}: no pixel of {movie.path} is in the domain, {context.domain.box}; they are within "
                f"{span('x', x, x + width)}, {span('y', y, y + height)}; give an origin"
            )
        yield from self.too_late(where, context)

    def recorded(self, where: str, context: Context) -> tuple[str | Path, int, float]:
        movie = context.resources.movies[where]
        return movie.path, len(movie.times), movie.times[-1]

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        yield from super().warnings(where, context)
        if not self.sources and context.scenario.robots:
            yield f"{where}.sources: none, so robots cannot find any; give their positions"


class GadenGas(OneGas, Played):
    """Results of GADEN (iteration_N of all versions), linear in time between files. See files/gaden_film.py.

    A cell takes the mean over its volume; beyond the grid the air is clean. Filaments become sums of Gaussians.
    """

    key: ClassVar[str] = "files"
    kind: Literal["gaden"]
    files: FileName
    """Path of the results, such as result/iteration_%d, or of their folder, relative to the scenario's folder."""
    interval: si.Duration | None = None
    """Time from one file to the next; unless given, saveDeltaTime of the sim.yaml beside or above, else 0.5 s."""
    origin: si.Point | None = None
    """Where the domain's lower corner lies in the results; unless given, at the lower corner of their grid."""
    height: si.Coordinate | None = None
    """Height z in the results at which a 2-D run cuts them; unless given, the middle."""
    occupancy: FileName | None = None
    """Path of GADEN's OccupancyGrid3D.csv, whose walls stop the gas of filaments, as in GADEN."""
    sources: tuple[Target, ...] = ()
    """Places that robots search for; unless given, the source of the results. They emit nothing."""

    @property
    def density_per_unit(self) -> float:
        """Concentration [kg/m³] of 1 ppm."""
        return 1.0 / self.vapour.ppm_per_density

    def file_errors(self, where: str, context: Context) -> Iterator[str]:
        film, extent = context.resources.gaden_films[where], context.domain.extent
        low, high = film.first.low[: len(extent)] - film.origin, film.high[: len(extent)] - film.origin
        if not ((low < extent) & (high > 0.0)).all():
            spans = ", ".join(span(x, a, b) for x, a, b in zip("xyz", low, high, strict=False))
            yield (
                f"{where}: no cell of {film.path} is in the domain, {context.domain.box}; they are within {spans}; "
                "give an origin"
            )
        yield from self.too_late(where, context)

    def recorded(self, where: str, context: Context) -> tuple[str | Path, int, float]:
        film = context.resources.gaden_films[where]
        return film.path, len(film.times), float(film.times[-1])
