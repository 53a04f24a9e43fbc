"""Playback of recorded wind and gas (films), linear in time between frames.

A mean of two divergence-free fields is divergence-free, so gas can be dispersed on a played flow as on a computed flow.
Two frames are on the device, while a thread reads the next frame from the disk.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from math import inf
from typing import Protocol

import numpy as np
import taichi as ti

from taichi_plume.files.film import VELOCITIES
from taichi_plume.files.movie import Movie
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier, GridGas
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario.gases import PlaybackGas
from taichi_plume.scenario.imported_wind import ImportedWind
from taichi_plume.scenario.played import MovieGas, PlaybackWind, Played

CLOSE = 1e-12  # relative difference up to which times are equal

Maxima = tuple[float, ...] | None
"""Maxima of a frame; empty for a gas."""


class Frames(Protocol):
    """Protocol of frames that can be played: a `Film`, or frames in memory."""

    times: np.ndarray
    """Times of the frames, ascending [s]."""

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Return variables of frame n, axes (x, y, z)."""
        ...

    def still(self, name: str) -> np.ndarray:
        """Return a variable that does not change, axes (x, y, z)."""
        ...


class WindFrames(Frames, Protocol):
    """Protocol of the frames of a wind."""

    @property
    def attributes(self) -> Mapping[str, float]:
        """Attributes such as viscosity [m²/s] and schmidt."""
        ...

    @property
    def wind(self) -> list[str]:
        """Names of the wind's variables."""
        ...

    def air(self) -> Air:
        """Return the air that the wind blows through."""
        ...


class GasFrames(Frames, Protocol):
    """Protocol of the frames of a gas."""

    def gas_of(self, species: object) -> str:
        """Return the variable to play for a species."""
        ...


class FramePlayer:
    """Player of a film: sets fields to the film's values at the simulated time.

    names: the film's variables; prepare: function that the reading thread applies to a frame, (values with `margin`
    ghost layers per name, maxima). now: fields by name; known: maxima of the two enclosing frames.
    """

    STATE = ("now", "_goal", "known", "_reached", "_end")

    def __init__(self, film: Frames, grid: Grid, names: list[str], margin: int, prepare: Callable):
        """`begin` shows the first frame."""
        self.film, self.grid, self.names, self.margin = film, grid, names, margin
        self.prepare = prepare
        self.first = film.times[0]
        steps = np.diff(film.times)
        self.period = film.times[-1] - self.first + (np.median(steps) if len(steps) else np.inf)
        self.now = {name: grid.field() for name in names}
        self._goal = {name: grid.field() for name in names}
        self._approach = grid.blending(list(self.now.values()), list(self._goal.values()))
        self._pool = ThreadPoolExecutor(1, "film")
        self.known: tuple[Maxima, Maxima] = (None, None)

    def begin(self, model: Played, t: float) -> None:
        """Start at simulated time t [s], with the rate and start time of the model."""
        self.model = model
        self.ends = np.append(self.film.times[1:], self.first + self.period if model.loop else np.inf)
        self._frames: dict[int, Future] = {}  # a cache, not part of the state
        self._reached = self._end = -np.inf
        self.show(t)

    def show(self, t: float) -> None:
        """Set the fields to those of simulated time t [s]."""
        time = self.model.start + self.model.rate * t
        if self.model.loop and np.isfinite(self.period):
            time = self.first + (time - self.first) % self.period
        time = self._snapped(max(time, self.first))
        if not self._reached <= time < self._end:
            self._change(int(np.searchsorted(self.film.times, time, side="right")) - 1)
        share = (time - self._reached) / (self._end - self._reached)
        if share > 0.0:
            self._approach(share)
        self._reached = time

    def _snapped(self, time: float) -> float:
        """Return the time of the frame that equals `time` up to the rounding of sums of ticks, otherwise `time`."""
        near = CLOSE * max(1.0, abs(time))
        n = int(np.searchsorted(self.film.times, time - near))
        equal = n < len(self.film.times) and self.film.times[n] <= time + near
        return float(self.film.times[n]) if equal else time

    def _change(self, n: int) -> None:
        """Put frames n and n + 1 on the device, and start to read frame n + 2."""
        numbers = (n, self._next(n), self._next(self._next(n)))
        self._frames = {k: self._frames.get(k) or self._pool.submit(self._read, k) for k in numbers}
        frames = [self._frames[k].result() for k in numbers[:2]]
        for fields, (values, _) in zip((self.now, self._goal), frames, strict=True):
            for name, field in fields.items():
                self.grid.write(field, values[name], self.margin)
        self.known = (frames[0][1], frames[1][1])
        self._reached, self._end = self.film.times[n], self.ends[n]

    def _next(self, n: int) -> int:
        if n + 1 < len(self.film.times):
            return n + 1
        return 0 if self.model.loop else n

    def _read(self, n: int) -> tuple[dict[str, np.ndarray], Maxima]:
        return self.prepare(self.film.frame(n, self.names))


@ti.data_oriented
class PlayedWind(Carrier):
    """Recorded flow, or flow computed by another program."""

    STATE = ("film", "outflow_rate", "max_viscosity", "max_speed")
    carries = True
    """Whether gas is dispersed on the wind, which limits the step."""

    def __init__(
        self,
        wind: PlaybackWind | ImportedWind,
        film: WindFrames,
        grid: Grid,
        t: float = 0.0,
        seed: int = 0,
    ):
        self.grid = grid
        self.dim = grid.dim
        self.frames = film
        self.film = FramePlayer(film, grid, film.wind, 1, self._prepare)
        self.speed_names = VELOCITIES[: grid.dim]
        self.u = tuple(self.film.now[name] for name in self.speed_names)
        self.nu = self.film.now.get("viscosity")
        air = film.air()
        self.open = grid.faces_field()
        self.area = None if air.empty else grid.faces_field()
        within = [[(grid.ghost, grid.ghost - (a == d)) for a in range(grid.dim)] for d in range(grid.dim)]
        still = [
            np.pad(film.still(f"open_{name}"), w) for name, w in zip(self.speed_names, within, strict=True)
        ]
        cut = [grid.pad_faces(area, d) for d, area in enumerate(air.area)] if self.area else []
        uploader(*self.open, *(self.area or ()))(*still, *cut)
        self.begin(wind, t, seed)

    def begin(self, model: PlaybackWind | ImportedWind, t: float, seed: int) -> None:
        self.viscosity = float(self.frames.attributes["viscosity"])
        self.schmidt = float(self.frames.attributes["schmidt"])
        self.film.begin(model, t)
        self._set_maxima()

    def _prepare(self, frame: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[float, ...]]:
        """Return values with a ghost layer, and maxima: flow out of a cell over its volume [1/s], viscosity, speed."""
        values, faces = dict(frame), []
        for d, name in enumerate(self.speed_names):
            u = frame[name]
            values[name] = np.pad(u, [(int(a == d), 0) for a in range(self.dim)])
            faces.append(u[tuple(slice(None) if a == d else slice(1, -1) for a in range(self.dim))])
        speed = max(float(np.abs(u).max()) for u in faces)
        viscosity = float(frame["viscosity"].max()) if "viscosity" in frame else self.viscosity
        return values, (self.grid.largest_outflow(faces), viscosity, speed)

    def _set_maxima(self) -> None:
        # between two frames a maximum is at most the larger maximum
        known = np.max([maxima for maxima in self.film.known if maxima is not None], axis=0)
        self.outflow_rate, self.max_viscosity, self.max_speed = (float(value) for value in known)

    def stable_dt(self, t: float = 0.0) -> float:
        """Return the longest step [s] with which dispersed gas follows the flow; infinite without such gas."""
        return inf if not self.carries else 0.5 / max(self.outflow_rate, 1e-9)

    def advance(self, t: float, dt: float) -> None:
        self.film.show(t + dt)
        self._set_maxima()


@ti.data_oriented
class PlayedGas(GridGas):
    """Recorded gas. Frames are checked when read."""

    STATE = ("film",)

    def __init__(self, gas: PlaybackGas | MovieGas, film: GasFrames, grid: Grid, t: float = 0.0):
        self.grid = grid
        self.dim = grid.dim
        name = film.gas_of(gas.species)
        self.film = FramePlayer(film, grid, [name], grid.ghost, self._prepare)
        self.c = self.film.now[name]
        self.air = grid.field()
        uploader(self.air)(grid.pad(film.still("volume") > 0))
        self.begin(gas, t, 0)

    def begin(self, model: PlaybackGas | MovieGas, t: float, seed: int) -> None:
        self.species = model.vapour
        self.film.begin(model, t)

    def _prepare(self, frame: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], None]:
        """Values with all ghost layers."""
        return {name: self.grid.pad(values) for name, values in frame.items()}, None

    def advance(self, t: float, dt: float) -> None:
        self.film.show(t + dt)


class MovieFrames:
    """Pictures of a movie on a grid, in the file's unit: the mean over the area of each cell.

    Pixels are squares of constant value, 0 beyond the picture. The sum over cells thus equals the sum over the part of
    the picture in the domain, whether cells or pixels are larger.
    """

    def __init__(self, movie: Movie, grid: Grid):
        self.movie, self.grid = movie, grid
        self.times = movie.times
        self.edges = [
            (np.arange(n + 1) * grid.dx - low) / movie.pixel
            for n, low in zip(grid.shape[:2], movie.origin, strict=True)
        ]

    def gas_of(self, species: object) -> str:
        return "concentration"

    def still(self, name: str) -> np.ndarray:
        """Return ones: there are no obstacles in pictures."""
        return np.ones(self.grid.shape)

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Return values of frame n, axes (x, y, z), the same at every height. Raises FilmError for damaged frames."""
        values = self.movie.frame(n)
        for axis, edges in enumerate(self.edges):
            values = means(values, edges, axis)
        if self.grid.dim == 3:
            values = np.repeat(values[:, :, None], self.grid.shape[2], axis=2)
        return dict.fromkeys(names, values)


def means(values: np.ndarray, edges: np.ndarray, axis: int) -> np.ndarray:
    """Return means along an axis between edges [in its steps]; values outside count as zero."""
    values = np.moveaxis(values, axis, 0)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    at = np.clip(edges, 0, len(values))
    whole = np.minimum(at.astype(int), len(values) - 1)
    upto = total[whole] + (at - whole)[:, None] * values[whole]
    mean = np.diff(upto, axis=0) / np.diff(edges)[:, None]
    return np.moveaxis(np.maximum(mean, 0.0), 0, axis)  # rounding


@ti.data_oriented
class PlayedMovie(PlayedGas):
    """Recorded gas whose frames are pictures."""

    def __init__(self, gas: MovieGas, movie: Movie, grid: Grid, t: float = 0.0):
        super().__init__(gas, MovieFrames(movie, grid), grid, t)

    def begin(self, model: MovieGas, t: float, seed: int) -> None:
        self.density = model.ppm_per_unit / model.vapour.ppm_per_density
        super().begin(model, t, seed)

    def _prepare(self, frame: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], None]:
        """Values [kg/m³] with all ghost layers."""
        return {name: self.grid.pad(self.density * values) for name, values in frame.items()}, None
