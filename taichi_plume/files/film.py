"""Film: recorded wind and gas on the whole grid, frame by frame, in a zarr group (`fields.zarr`) for xarray.

Dimensions, for `a` in x, y, z: `a` cell centres, `a_face` cell faces, `a_ghost` cell centres and one ghost cell beyond
each end. Variables are float32 in the order (time, z, y, x), one chunk per frame and variable; attributes follow CF.
At the cell centres, to look at:

    u, v, w     [m/s]    air velocity
    NAME_ppm    [ppm]    mole fraction of a species (at 25 °C and 1 atm)
    temperature [K]      if the run solves for temperature; likewise further quantities of `observed.quantities`
    gas_NAME    [kg/m³]  concentration of a species, as NAME_ppm above its background, which is their attribute
                `background_ppm` [ppm]
    air         volume fraction of the cell that holds gas, 0 in obstacles: the sum of gas_NAME * air * cell_volume is
                the mass; without time

For playback, or as the initial state of a run:

    u_face, ... [m/s]    air velocity on the faces, which keeps the divergence over a cell; along the other axes with
                         ghosts, so that interpolation gives the walls' velocity at the walls
    viscosity   [m²/s]   molecular and eddy viscosity, with ghosts; only of a flow with an eddy viscosity
    volume      volume fraction of the cells that is air; without time. Cells that an obstacle cuts hold gas as though
                they were as wide as their widest face, hence `air`
    area_u_face, ... area fraction of the faces that is air; without time
    open_u_face, ... 1 on faces whose velocity was solved for, 0 on walls; without time

A frame counts once its time is written, so an interrupted film holds all frames before. To open a film:
``xarray.open_zarr("runs/arena-1/fields.zarr")``.
"""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.files import manifest
from taichi_plume.files.conventions import FileFacts, when
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.zarr_groups import (
    FAULTS,
    Group,
    GroupError,
    errors_as,
    require_memory,
    stored_chunks,
)
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.scenario.sources import OtherSpecies

if TYPE_CHECKING:
    from taichi_plume.grid.cut_cells import Air

FORMAT = "taichi_plume film 3"
EARLIER = "taichi_plume film"  # start of the format of every version
VELOCITIES = ("u_face", "v_face", "w_face")
STILL = ("open_", "area_")
GAS = "gas_"  # and the name of the species
BACKGROUND = "background_ppm"
"""Attribute of a gas variable: concentration of the species in clean air [ppm], which its values do not contain."""
MOST = 1e9  # largest number in the attributes, such as cells along an axis
Places = Callable[[np.ndarray], np.ndarray]
"""Values (...), or (..., dim) of a vector, at points (..., dim) [m]."""


class FilmError(RunFolderError):
    """Error: a film (recorded wind and gas) cannot be read; the message begins with the path."""


def dimensions(name: str, dim: int) -> tuple[str, ...]:
    """Return the dimensions of a film variable without time, slowest first, such as z_ghost, y_ghost, x_face."""
    still = name.startswith(STILL)
    component = name.removeprefix(STILL[0]).removeprefix(STILL[1])
    if component in VELOCITIES:
        own, others = VELOCITIES.index(component), "" if still else "_ghost"
        ends = ["_face" if a == own else others for a in range(dim)]
    else:
        ends = ["_ghost" if name == "viscosity" else ""] * dim
    return tuple(axis + end for axis, end in zip("xyz", ends, strict=False))[::-1]


def _positive(value: Any, name: str) -> float:
    """Return an attribute's value as a float if it is positive. Raises ValueError, or TypeError."""
    number = float(value)
    if not 0.0 < number < MOST:
        raise ValueError(f"its {name} is {number:g}")
    return number


def places(dimension: str, shape: tuple[int, ...], dx: float) -> np.ndarray:
    """Return the coordinates [m] along a film's dimension, such as x, x_face or x_ghost. dx: cell edge [m]."""
    n = shape["xyz".index(dimension[0])]
    if dimension.endswith("_face"):
        return np.arange(n + 1) * dx
    if dimension.endswith("_ghost"):
        return (np.arange(-1, n + 1) + 0.5) * dx
    return (np.arange(n) + 0.5) * dx


class Film:
    """Reader of a film (wind and gas over time) on disk. Raises FilmError if the folder is no complete film.

    times: of the frames [s]; shape: number of cells (x, y, z); dx: edge of a cell, depth: thickness of a 2-D film [m].
    """

    def __init__(self, path: Path):
        self.path = path
        fault = unopenable(path, folder=True)
        if fault:
            raise FilmError(f"{path}: {fault}; a run with `fields` writes fields.zarr into its folder")
        manifest.require_unchanged(path, FilmError)  # zarr.json has no checksum
        try:
            group = Group(path)
        except GroupError as error:
            raise FilmError(str(error)) from None
        except FAULTS:
            raise FilmError(f"{path}: is no zarr group; give the fields.zarr of an earlier run") from None
        self.attributes = group.attributes
        made = self.attributes.get("format")
        if made != FORMAT and str(made).startswith(EARLIER):
            raise FilmError(f"{path}: was written by another version of taichi_plume ({made}); record again")
        if made != FORMAT:
            raise FilmError(f"{path}: was not written by a run of taichi_plume (format is not '{FORMAT}')")
        with errors_as(FilmError, path):
            self.shape: tuple[int, ...] = tuple(int(_positive(n, "shape")) for n in self.attributes["shape"])
            self.dx = _positive(self.attributes["spacing"], "spacing")
            self.depth = _positive(self.attributes["depth"], "depth")
            self.periodic: tuple[bool, ...] = tuple(map(bool, self.attributes["periodic"]))
            if not len(self.periodic) == len(self.shape) in (2, 3):
                raise ValueError("its shape or periodic are not those of a plane or a room")
            if "gases" in self.attributes:
                self.attributes["gases"] = json.loads(self.attributes["gases"])
            self.arrays = {name: group[name] for name in group.names}
            time = self.arrays["time"]
            self.times: np.ndarray = time[: min(time.shape[0], stored_chunks(time) * time.chunks[0])]
            if self.wind:
                _positive(self.attributes["schmidt"], "schmidt")
                _positive(self.attributes["viscosity"] or 1.0, "viscosity")  # 0 without viscosity
        unknown = np.flatnonzero(~np.isfinite(self.times))  # the writer was interrupted
        self.times = self.times[: unknown[0]] if len(unknown) else self.times
        if not len(self.times):
            raise FilmError(f"{path}: holds no frame")
        if (np.diff(self.times) <= 0).any():
            raise FilmError(f"{path}: is damaged: its times do not increase")
        for name in [*self.wind, *self.gas]:
            self._check(name, len(self.times))
        still = [f"{kind}{name}" for kind in STILL for name in self.wind if name in VELOCITIES]
        for name in ["volume", *still]:
            self._check(name, 0)

    def _check(self, name: str, frames: int) -> None:
        """Raise FilmError if an array has a wrong shape or lacks stored frames (0: a variable without time)."""
        array = self.arrays.get(name)
        if array is None:
            raise FilmError(f"{self.path}: is not whole: {name} is missing; copy all of it")
        more = {"": 0, "face": 1, "ghost": 2}
        expected = tuple(
            self.shape["xyz".index(d[0])] + more[d.partition("_")[2]]
            for d in dimensions(name, len(self.shape))
        )
        with errors_as(FilmError, self.path, f"is damaged: {name}"):
            size = array.shape[1:] if frames else array.shape
            if size != expected:
                raise ValueError(f"has the shape {size}, not {expected}")
            stored = stored_chunks(array)
            if frames:  # in a copy by xarray a chunk may hold several frames, or a frame several chunks
                pieces = math.prod(-(-n // k) for n, k in zip(size, array.chunks[1:], strict=True))
                stored = min(array.shape[0], stored * array.chunks[0] // pieces)
        if stored < (frames or 1):
            raise FilmError(f"{self.path}: {name} has {stored} of {frames or 1} frames; copy all of it")

    @property
    def wind(self) -> list[str]:
        """Names of the film's variables for playing back the wind; empty if no wind was recorded."""
        names = [*VELOCITIES[: len(self.shape)], *(["viscosity"] if "viscosity" in self.arrays else [])]
        return names if VELOCITIES[0] in self.arrays else []

    @property
    def gas(self) -> list[str]:
        """Names of the film's gas variables, one per species; empty if no gas was recorded."""
        return sorted(name for name in self.arrays if name.startswith(GAS))

    def facts(self) -> FileFacts:
        """Return what the film holds: quantities, times, and cells."""
        cells = " x ".join(map(str, self.shape))
        names = ", ".join([*self.wind, *self.gas])
        return FileFacts(
            f"film of {names}; {len(self.times)} frames, {when(self.times)}; {cells} cells of {self.dx:g} m"
        )

    def gas_of(self, species: str | OtherSpecies | None) -> str:
        """Return the variable name of a species. A film with one gas returns that gas, whatever the species.

        Raises FilmError if the film holds several gases and the species is none of them.
        """
        name = f"{GAS}{species.name if isinstance(species, OtherSpecies) else species}"
        if len(self.gas) == 1:
            return self.gas[0]
        if name in self.gas:
            return name
        names = ", ".join(name.removeprefix(GAS) for name in self.gas) or "no gas"
        raise FilmError(f"{self.path}: holds {names}; give `species` as one of these")

    def still(self, name: str) -> np.ndarray:
        """Return a variable of the film that is constant in time, axes (x, y, z). Raises FilmError."""
        with errors_as(FilmError, self.path, f"is damaged: {name}"):
            require_memory({name: self.arrays[name]})
            return self.arrays[name][...].T

    def air(self) -> "Air":
        """Read the film's air fractions of cells and faces. It does not tell which obstacle is near (body: -1)."""
        from taichi_plume.grid.cut_cells import Air  # imports Taichi, which readers of a film do not need

        area = tuple(self.still(f"area_{name}").astype(float) for name in VELOCITIES[: len(self.shape)])
        volume = self.still("volume").astype(float)
        return Air(volume, area, area, np.full(volume.shape, -1), self.periodic)

    def frame(self, n: int, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Return the named variables of the film's frame n, axes (x, y, z). Raises FilmError if damaged."""
        result = {}
        for name in names:
            place = f"{self.path}: frame {n} of {name} (t = {self.times[n]:g} s)"
            with errors_as(FilmError, place):
                result[name] = self.arrays[name][n].T
            if not np.isfinite(result[name]).all():
                raise FilmError(f"{place}: is damaged: not all values are finite numbers")
        return result

    def moment(self, names: Sequence[str], t: float | None) -> dict[str, np.ndarray]:
        """Return the named variables at time t [s], interpolated between frames, axes (x, y, z); None: last frame.

        Before the first and after the last frame the values of that frame hold. Raises FilmError.
        """
        last = len(self.times) - 1
        n = last if t is None else int(np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, last))
        frame = self.frame(n, names)
        if t is None or n == last or t <= self.times[n]:
            return frame
        share = (t - self.times[n]) / (self.times[n + 1] - self.times[n])
        later = self.frame(n + 1, names)
        return {name: (1.0 - share) * frame[name] + share * later[name] for name in names}

    def velocity(self, t: float | None) -> Places:
        """Return a function that gives the air velocity [m/s] at points, at the film's time t [s]. Raises FilmError."""
        names = VELOCITIES[: len(self.shape)]
        parts = [self._linear(name, values) for name, values in self.moment(names, t).items()]
        return lambda points: np.stack([part(points) for part in parts], axis=-1)

    def concentration(self, name: str, t: float | None) -> Places:
        """Return a function that gives a gas concentration [kg/m³] at points, for time t [s] (None: last) of the film.

        Solid cells do not count in the interpolation. Raises FilmError.
        """
        air = (self.still("volume") > 0).astype(float)
        held, share = self._linear(name, self.moment([name], t)[name] * air), self._linear(name, air)
        return lambda points: np.maximum(held(points), 0.0) / np.maximum(share(points), 1e-6)

    def _linear(self, name: str, values: np.ndarray) -> Places:
        """Return a function that interpolates a variable linearly at points, with constant extrapolation."""
        from scipy.interpolate import RegularGridInterpolator

        axes = [places(d, self.shape, self.dx) for d in dimensions(name, len(self.shape))[::-1]]
        between = RegularGridInterpolator(axes, np.asarray(values, float))
        low, high = (np.array([axis[end] for axis in axes]) for end in (0, -1))
        return lambda points: between(np.clip(points, low, high))
