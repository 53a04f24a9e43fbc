"""Wind and gas of a recorded run, linear in time between its frames.

A mean of two divergence-free fields is divergence-free, so gas can be dispersed on a played flow as on a computed one.
Two frames are on the device; the next one is read from the disk meanwhile.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from math import inf
from typing import Any, Protocol

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
from taichi_plume.scenario.movie import MovieGas
from taichi_plume.scenario.played import PlaybackWind, Played

CLOSE = 1e-12  # of a time: as good as equal


class Frames(Protocol):
    """What can be played: a `Film`, or frames in memory with the same meaning."""

    times: np.ndarray
    """Of the frames, ascending [s]."""

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Variables of frame n, axes (x, y, z)."""
        ...


class WindFrames(Frames, Protocol):
    """Frames of a wind."""

    attributes: dict[str, Any]
    """viscosity and schmidt."""

    @property
    def wind(self) -> list[str]:
        """Names of the wind's variables."""
        ...

    def still(self, name: str) -> np.ndarray:
        """A variable that does not change, axes (x, y, z)."""
        ...

    def air(self) -> Air:
        """The air that it blows through."""
        ...


class GasFrames(Frames, Protocol):
    """Frames of a gas."""

    def gas_of(self, species: Any) -> str:
        """The variable to play for a species."""
        ...

    def still(self, name: str) -> np.ndarray:
        """A variable that does not change, axes (x, y, z)."""
        ...


class FramePlayer:
    """Keeps fields as a film shows them at the time of the clock.

    names: the film's variables; prepare: what the reading thread makes of a frame, (values with `margin` ghost layers
    per name, numbers to be known about it). now: the fields by name; known: the numbers of the two frames around.
    """

    STATE = ("now", "_goal", "known", "_reached", "_end")

    def __init__(self, film: Frames, grid: Grid, names: list[str], margin: int, prepare: Callable):
        """It shows nothing before `begin`."""
        self.film, self.grid, self.names, self.margin = film, grid, names, margin
        self.prepare = prepare
        self.first = film.times[0]
        steps = np.diff(film.times)
        self.period = film.times[-1] - self.first + (np.median(steps) if len(steps) else np.inf)
        self.now = {name: grid.field() for name in names}
        self._goal = {name: grid.field() for name in names}
        self._approach = grid.blending(list(self.now.values()), list(self._goal.values()))
        self._pool = ThreadPoolExecutor(1, "film")
        self.known: tuple[Any, Any] = (None, None)

    def begin(self, model: Played, t: float) -> None:
        """Show simulated time t [s], played as the model says."""
        self.model = model
        self.ends = np.append(self.film.times[1:], self.first + self.period if model.loop else np.inf)
        self._frames: dict[int, Future] = {}  # a cache, and no state
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
        """The time of a frame where it is meant: sums of ticks miss it by their rounding."""
        near = CLOSE * max(1.0, abs(time))
        n = int(np.searchsorted(self.film.times, time - near))
        meant = n < len(self.film.times) and self.film.times[n] <= time + near
        return float(self.film.times[n]) if meant else time

    def _change(self, n: int) -> None:
        """Put frame n and the next one on the device, and send for the one after."""
        wanted = (n, self._next(n), self._next(self._next(n)))
        self._frames = {k: self._frames.get(k) or self._pool.submit(self._read, k) for k in wanted}
        frames = [self._frames[k].result() for k in wanted[:2]]
        for fields, (values, _) in zip((self.now, self._goal), frames, strict=True):
            for name, field in fields.items():
                self.grid.write(field, values[name], self.margin)
        self.known = (frames[0][1], frames[1][1])
        self._reached, self._end = self.film.times[n], self.ends[n]

    def _next(self, n: int) -> int:
        if n + 1 < len(self.film.times):
            return n + 1
        return 0 if self.model.loop else n

    def _read(self, n: int) -> Any:
        return self.prepare(self.film.frame(n, self.names))


@ti.data_oriented
class PlayedWind(Carrier):
    """A flow that was recorded or made elsewhere."""

    STATE = ("film", "outflow_rate", "max_viscosity", "max_speed")
    carries = True
    """Whether gas is solved for in it, and has to see it change."""

    def __init__(
        self,
        wind: PlaybackWind | ImportedWind,
        film: WindFrames,
        grid: Grid,
        t: float = 0.0,
        seed: int = 0,
    ):
        """t: begin of the run [s]."""
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
        self._be(film)
        self.begin(wind, t, seed)

    def begin(self, model: PlaybackWind | ImportedWind, t: float, seed: int) -> None:
        self._be(self.frames)
        self.film.begin(model, t)
        self._know()

    def _be(self, film: WindFrames) -> None:
        self.viscosity = float(film.attributes["viscosity"])
        self.schmidt = float(film.attributes["schmidt"])

    def _prepare(self, frame: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[float, ...]]:
        """Values with a ghost layer; largest flow out of a cell over its volume [1/s], viscosity and speed."""
        values, faces = dict(frame), []
        for d, name in enumerate(self.speed_names):
            u = frame[name]
            values[name] = np.pad(u, [(int(a == d), 0) for a in range(self.dim)])
            faces.append(u[tuple(slice(None) if a == d else slice(1, -1) for a in range(self.dim))])
        speed = max(float(np.abs(u).max()) for u in faces)
        viscosity = float(frame["viscosity"].max()) if "viscosity" in frame else self.viscosity
        return values, (self.grid.largest_outflow(faces), viscosity, speed)

    def _know(self) -> None:
        # the maxima of a mean are no larger than the larger ones
        known = np.max(self.film.known, axis=0)
        self.outflow_rate, self.max_viscosity, self.max_speed = (float(value) for value in known)

    def stable_dt(self, t: float = 0.0) -> float:
        """A step of the gas [s], so that it sees the flow change; the film itself has no limit."""
        return inf if not self.carries else 0.5 / max(self.outflow_rate, 1e-9)

    def advance(self, t: float, dt: float) -> None:
        self.film.show(t + dt)
        self._know()


@ti.data_oriented
class PlayedGas(GridGas):
    """A recorded gas; its frames were looked at when they were read."""

    STATE = ("film",)

    def __init__(self, gas: PlaybackGas | MovieGas, film: GasFrames, grid: Grid, t: float = 0.0):
        """t: begin of the run [s]."""
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
