"""Playback of recorded wind and gas (films): linear in time between frames, or held from frame to frame.

A mean of two divergence-free fields is divergence-free, so gas can be dispersed on a played flow as on a computed flow.
Two frames are on the device, while a thread reads the next frame from the disk. The shared flow of a study has a frame
per tick, which is replayed bit for bit.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from math import inf
from typing import TYPE_CHECKING, Protocol

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier, GridGas, Wind, sample_faces
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.gases import PlaybackGas, PureGas
from taichi_plume.scenario.imported_wind import ImportedWind
from taichi_plume.scenario.playback import GadenGas, MovieGas, PlaybackWind, Played

if TYPE_CHECKING:
    from taichi_plume.files.film import Film
    from taichi_plume.files.gaden_film import GadenFilm
    from taichi_plume.files.movie import Movie
    from taichi_plume.files.shared_film import AirFilm
    from taichi_plume.solvers.imported_flow import ImportedFilm

VELOCITIES = ("u", "v", "w")  # in a shared film
CLOSE = 1e-12  # relative difference up to which times are equal
TICKS = Played()  # way to play a shared film: a frame per tick

Maxima = tuple[float, ...] | None
"""Maxima of a frame; empty for a gas."""
FrameValues = tuple[dict[str, np.ndarray], Maxima]
"""Values of a frame by variable, and their maxima."""


class Frames(Protocol):
    """Protocol of frames that can be played: a film, a movie, an imported wind."""

    @property
    def times(self) -> np.ndarray:
        """Times of the frames, ascending [s]."""
        ...

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Return variables of frame n, axes (x, y, z)."""
        ...


class FramePlayer:
    """Player of recorded frames: sets fields on the device to the recorded values at the simulated time.

    names: variables to play; margin: ghost layers of their values. prepare: function that the reading thread applies to
    a frame, (values per name, maxima); without it, each frame is read when due and holds until the next frame.
    now: fields by name; known: maxima of the two enclosing frames.
    """

    STATE = ("now", "_goal", "known", "_reached", "_end")

    def __init__(
        self,
        film: Frames,
        grid: Grid,
        names: list[str],
        margin: int,
        model: Played,
        t: float,
        prepare: Callable[[dict[str, np.ndarray]], FrameValues] | None = None,
    ):
        """Start playback at simulated time t [s]; model: settings with the start time, the rate and the loop."""
        self.film, self.grid, self.names, self.margin = film, grid, names, margin
        self.prepare = prepare
        self.now = {name: grid.field() for name in names}
        self._goal = {name: grid.field() for name in names if prepare}
        self.known: tuple[Maxima, ...] = (None, None)
        if prepare:
            self._approach = grid.blending(list(self.now.values()), list(self._goal.values()))
            self._pool = ThreadPoolExecutor(1, "film")
        self.model, self.times = model, self.film.times
        steps = np.diff(self.times)
        begin, end = model.looped
        near = CLOSE * max(1.0, abs(self.times[-1]))
        self.first = int(np.searchsorted(self.times, begin - near))
        self.last = int(np.searchsorted(self.times, end + near, side="right")) - 1
        self.period = (
            self.times[self.last] - self.times[self.first] + (np.median(steps) if len(steps) else np.inf)
        )
        self.ends = np.append(self.times[1:], np.inf)
        if model.loop:
            self.ends[self.last] = self.times[self.first] + self.period
        self._frames: dict[int, Future] = {}  # a cache, not part of the state
        self._reached = self._end = -np.inf
        self.show(t)

    def show(self, t: float) -> None:
        """Set the fields to the recorded values at simulated time t [s]."""
        first = self.times[self.first]
        time = self.model.start + self.model.rate * t
        if self.model.loop and np.isfinite(self.period) and (time >= first or self.first == 0):
            time = first + (time - first) % self.period
        time = self._snapped(max(time, self.times[0]))
        if not self._reached <= time < self._end:
            n = int(np.searchsorted(self.times, time, side="right")) - 1
            self._change(min(n, self.last) if self.model.loop else n)
        share = (time - self._reached) / (self._end - self._reached)
        if share > 0.0 and self.prepare:
            self._approach(share)
        self._reached = time

    def _snapped(self, time: float) -> float:
        """Return the time of a frame that equals `time` [s] up to rounding errors; otherwise `time` itself."""
        near = CLOSE * max(1.0, abs(time))
        n = int(np.searchsorted(self.times, time - near))
        equal = n < len(self.times) and self.times[n] <= time + near
        return float(self.times[n]) if equal else time

    def _change(self, n: int) -> None:
        """Put frame n on the device and, for interpolation, frame n + 1; start to read frame n + 2 from the disk."""
        if self.prepare:
            numbers = (n, self._next(n), self._next(self._next(n)))
            self._frames = {k: self._frames.get(k) or self._pool.submit(self._read, k) for k in numbers}
            frames = [self._frames[k].result() for k in numbers[:2]]
            self.known = tuple(maxima for _, maxima in frames)
        else:
            frames = [(self.film.frame(n, self.names), None)]
        for fields, (values, _) in zip((self.now, self._goal), frames, strict=False):
            for name, field in fields.items():
                self.grid.write(field, values[name], self.margin)
        self._reached, self._end = self.times[n], self.ends[n]

    def _next(self, n: int) -> int:
        if self.model.loop and n == self.last:
            return self.first
        return min(n + 1, len(self.times) - 1)

    def _read(self, n: int) -> FrameValues:
        assert self.prepare is not None
        return self.prepare(self.film.frame(n, self.names))


class PlayedWind(Carrier):
    """Recorded flow, or flow computed by another program."""

    STATE = ("film", "outflow_rate", "max_viscosity", "max_speed")
    carries = True
    """Whether gas is dispersed on the wind, which limits the step."""

    def __init__(
        self,
        wind: PlaybackWind | ImportedWind,
        film: "Film | ImportedFilm",
        grid: Grid,
        t: float = 0.0,
    ):
        self.grid = grid
        self.dim = grid.dim
        self.frames = film
        self.viscosity = float(film.attributes["viscosity"])
        self.schmidt = float(film.attributes["schmidt"])
        self.speed_names = film.wind[: grid.dim]
        self.film = FramePlayer(film, grid, film.wind, 1, wind, t, self._prepare)
        self.u = tuple(self.film.now[name] for name in self.speed_names)
        self.nu = self.film.now.get("viscosity")
        air = film.air()
        within = [[(grid.ghost, grid.ghost - (a == d)) for a in range(grid.dim)] for d in range(grid.dim)]
        self.open = tuple(
            grid.filled(np.pad(film.still(f"open_{name}"), w))
            for name, w in zip(self.speed_names, within, strict=True)
        )
        self.area = None
        if not air.empty:
            self.area = tuple(grid.filled(grid.pad_faces(area, d)) for d, area in enumerate(air.area))
        self._set_maxima()

    def _prepare(self, frame: dict[str, np.ndarray]) -> FrameValues:
        """Return a frame with a ghost layer, and its maxima: outflow of a cell over volume [1/s], viscosity, speed."""
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
        """Return the longest stable time step [s] of gas that this flow carries; infinite if it carries none."""
        return inf if not self.carries else 0.5 / max(self.outflow_rate, 1e-9)

    def advance(self, t: float, dt: float) -> None:
        self.film.show(t + dt)
        self._set_maxima()


class PlayedGas(GridGas):
    """Playback of a recorded gas as a concentration field on the grid. Frames are checked when read."""

    STATE = ("film",)

    def __init__(
        self,
        gas: PlaybackGas | MovieGas | GadenGas,
        film: "Film | Movie | GadenFilm",
        grid: Grid,
        t: float = 0.0,
    ):
        self.grid = grid
        self.dim = grid.dim
        name = film.gas_of(gas.species)
        self.species, self.density = gas.vapour, gas.density_per_unit
        self.film = FramePlayer(film, grid, [name], grid.ghost, gas, t, self._prepare)
        self.c = self.film.now[name]
        self.air = grid.filled(grid.pad(film.still("volume") > 0))

    def _prepare(self, frame: dict[str, np.ndarray]) -> FrameValues:
        """Return a frame's concentrations [kg/m³] with all ghost layers, by name; no maxima (None)."""
        return {name: self.grid.pad(self.density * values) for name, values in frame.items()}, None

    def advance(self, t: float, dt: float) -> None:
        self.film.show(t + dt)


def variable(n: int) -> str:
    """Return the variable name of the n-th gas in the flow recording that the runs of a study share."""
    return f"gas_{n}"


class TickFilm:
    """Recording that runs share. wind: whether the film holds the wind; gases: paths, in the scenario, of its gases."""

    def __init__(self, film: "AirFilm", wind: bool, gases: tuple[str, ...]):
        self.film, self.wind, self.gases = film, wind, gases

    @property
    def times(self) -> np.ndarray:
        return self.film.times

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        return self.film.frame(n)


class TickWind(Wind):
    """Wind from a recording that the runs of a study share. It carries no gas: the recording holds the gas too."""

    STATE = ("film",)

    def __init__(self, film: TickFilm, grid: Grid, t: float):
        self.grid, self.dim = grid, grid.dim
        self.film = FramePlayer(film, grid, list(VELOCITIES[: grid.dim]), 1, TICKS, t)
        self.u = tuple(self.film.now.values())

    def advance(self, t: float, dt: float) -> None:
        self.film.show(t + dt)

    @ti.func
    def velocity(self, x: Template, t: float):
        return sample_faces(self.u, x, self.grid.dx, self.grid.ghost, self.grid.padded)


class TickGas(PlayedGas):
    """Gas from a recording that the runs of a study share."""

    def __init__(self, film: TickFilm, number: int, model: PureGas, grid: Grid, air: Air, t: float):
        """Create the field of the gas; number: index of the gas in the shared recording."""
        self.grid, self.dim = grid, grid.dim
        self.air = grid.filled(grid.pad(~air.solid))
        self.species = model.vapour
        self.film = FramePlayer(film, grid, [variable(number)], 1, TICKS, t)
        (self.c,) = self.film.now.values()
