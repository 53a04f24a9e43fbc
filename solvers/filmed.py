"""Wind and gas of an earlier solution, replayed bit for bit at every tick (shared flow of a study).

`playback`, in contrast, plays a film at any time and rate, and gas can be dispersed on its flow.
"""

from typing import Protocol

import numpy as np
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import GridGas, Wind, sample_faces
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario.gases import PureGas

VELOCITIES = ("u", "v", "w")


class Ticks(Protocol):
    """Film with a frame per tick: see files/shared_film.py."""

    shape: tuple[int, ...]
    names: tuple[str, ...]
    tick: float
    frames: int

    def frame(self, n: int) -> dict[str, np.ndarray]:
        """Return the variables at tick n over the grid and one ghost layer, axes (x, y, z)."""
        ...


class TickFilm:
    """Holder of the film that is played; before a reset it may be replaced by a film of equal shape and variables.

    wind: whether the film holds the wind; gases: indices of the scenario's gases in the film.
    """

    def __init__(self, wind: bool, gases: tuple[str, ...]):
        self.wind, self.gases = wind, gases
        self.film: Ticks | None = None

    def put(self, film: Ticks, shape: tuple[int, ...], tick: float, ticks: int) -> None:
        """Play this film from now on; shape, tick [s], ticks: of the run. Raises ValueError if these differ."""
        names = {*(VELOCITIES[: len(shape)] if self.wind else ()), *map(variable, range(len(self.gases)))}
        if tuple(film.shape) != tuple(shape) or film.tick != tick or set(film.names) != names:
            raise ValueError("the film of the air is of another grid, tick, wind or gas")
        if film.frames <= ticks:
            raise ValueError(
                f"the film of the air ends at t = {(film.frames - 1) * tick:g} s, before the run does"
            )
        self.film = film

    def frame(self, t: float) -> dict[str, np.ndarray] | None:
        """Return the frame of time t [s], the end of a tick; None before t = 0."""
        assert self.film is not None
        n = round(t / self.film.tick)
        return self.film.frame(n) if n >= 0 else None


def variable(n: int) -> str:
    """Return the name of the variable of the n-th filmed gas."""
    return f"gas_{n}"


@ti.data_oriented
class FilmedWind(Wind):
    """Recorded wind: velocities at each tick. No gas is dispersed in this wind: the gas was filmed too."""

    STATE = ("u",)

    def __init__(self, film: TickFilm, grid: Grid, t: float):
        self.film, self.grid, self.dim = film, grid, grid.dim
        self.u = grid.faces_field()
        uploader(*self.u)(*(0.0 for _ in self.u))
        self.begin(None, t, 0)

    def begin(self, model: object, t: float, seed: int) -> None:
        self._show(t)

    def advance(self, t: float, dt: float) -> None:
        self._show(t + dt)

    def _show(self, t: float) -> None:
        frame = self.film.frame(t)
        if frame is not None:
            for name, field in zip(VELOCITIES, self.u, strict=False):
                self.grid.write(field, frame[name], 1)

    @ti.func
    def velocity(self, x: Template, t: float):
        return sample_faces(self.u, x, self.grid.dx, self.grid.ghost, self.grid.padded)


@ti.data_oriented
class FilmedGas(GridGas):
    """Recorded gas: concentration on the grid at each tick."""

    STATE = ("c",)

    def __init__(self, film: TickFilm, number: int, model: PureGas, grid: Grid, air: Air, t: float):
        """number: index of the gas in the film; t: start of the run [s]."""
        self.film, self.name = film, variable(number)
        self.grid, self.dim = grid, grid.dim
        # in trees of their own, as a solver's fields: otherwise LLVM sums in another order, and the last bit may differ
        self.air = grid.field()
        uploader(self.air)(grid.pad(~air.solid))
        self.c = grid.field()
        uploader(self.c)(0.0)
        self.begin(model, t, 0)

    def begin(self, model: PureGas, t: float, seed: int) -> None:
        self.species = model.vapour
        self._show(t)

    def advance(self, t: float, dt: float) -> None:
        self._show(t + dt)

    def _show(self, t: float) -> None:
        frame = self.film.frame(t)
        if frame is not None:
            self.grid.write(self.c, frame[self.name], 1)
