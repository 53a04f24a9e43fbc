"""Playback of recorded winds and gases: frames of an earlier run, pictures of a movie, points in logs of PlumeSim."""

from collections.abc import Iterator, Mapping
from math import inf
from typing import Any, ClassVar, Literal

import numpy as np

from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.motion import SourceMotion
from taichi_plume.scenario.sources import OneGas, Target
from taichi_plume.scenario.vocabulary import FileName, Model
from taichi_plume.scenario.wind_base import AnyWind


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


def played_source(source: Mapping[str, Any], times: np.ndarray, model: Played) -> dict[str, Any]:
    """Return the keys of a recorded source with its `start`, `stop` and `motion` in the time of the run that plays it.

    source: keys of a `Source` in the time of the record; times: of the frames [s]. In a loop the source is there all
    the time, and moves from the end of the record to its start as the gas does, within a frame.
    """
    source, first, last = dict(source), float(times[0]), float(times[-1])
    for key in ("start", "stop"):
        moment = source.pop(key, None)
        if moment is not None and not model.loop and (key == "start" or moment < last):
            source[key] = (moment - model.start) / model.rate
    given = source.pop("motion", None)
    if given is None:
        return source
    motion, position = SourceMotion.model_validate(given), source["position"]
    ends = np.array([0.0, *(point[0] for point in motion.path)])
    if motion.loop:
        laps = np.arange(np.floor(first / ends[-1]), np.ceil(last / ends[-1]))
        ends = (laps[:, None] * ends[-1] + ends).ravel()
    nodes = np.unique([first, last, *ends[(ends > first) & (ends < last)]])
    period = last - first + float(np.median(np.diff(times))) if len(times) > 1 else np.inf
    begin, after = model.start, nodes - model.start
    places = motion.places(position, nodes)
    if model.loop and np.isfinite(period):
        begin, after = first + (begin - first) % period, after % period
        nodes, places = np.append(nodes, first + period), np.concatenate([places, places[:1]])
        here = np.array([np.interp(begin, nodes, along) for along in places.T])
        after, order = np.unique(np.append(after, period), return_index=True)
        places = np.concatenate([places[:-1], here[None]])[order]
    else:
        here = motion.places(position, float(np.clip(begin, first, last)))
    ahead = after > 1e-9
    path = np.column_stack([after[ahead] / model.rate, places[ahead]])
    moves = {"motion": {"path": path.tolist(), "loop": model.loop}} if len(path) else {}
    return source | {"position": here.tolist()} | moves


class Playback(Played):
    """Playback of a recorded run (see `fields`), linear in time between frames, also from the last to the first."""

    part: ClassVar[Literal["wind", "gas"]]
    """Recorded quantity that is played back."""
    file: FileName
    """Path of a fields.zarr that an earlier run wrote, relative to the scenario's folder."""

    density_per_unit: ClassVar[float] = 1.0
    """Concentration [kg/m³] of the value 1 in the file."""


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


class PlumeSimLog(PointPlayback):
    """A text log of PlumeSim; see point_frames.py. `plumesim_log` makes a run write one."""

    file: FileName
    """Path of a log of PlumeSim, relative to the scenario's folder."""


class PlumeSimWind(AnyWind, PlumeSimLog):
    """The wind of a log at points, for sensors; it cannot carry gas on the grid."""

    on_grid: ClassVar[bool] = False
    kind: Literal["plumesim_log"]

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from super().errors(where, context)
        scenario = context.scenario
        for path, gas in scenario.gases:
            if gas.on_grid:
                yield (
                    f"{path}.kind: a wind of kind plumesim_log is known only at points and cannot carry eulerian gas; "
                    "use gas of kind plumesim_log, or another wind"
                )
        if scenario.fields is not None and "wind" in scenario.fields.quantities:
            yield "fields.quantities: a wind of kind plumesim_log is not on the grid; use quantities: [gas]"


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
