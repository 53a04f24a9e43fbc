"""A film: wind and gas on the whole grid, frame by frame, in a zarr group that xarray opens as it is.

Dimensions, for `a` in x, y, z: `a` cell centres, `a_face` cell faces, `a_ghost` cell centres and one more beyond each
end. Variables are float32 in the order (time, z, y, x), one chunk per frame and variable; attributes follow CF. To look
at, on the cells' middles:

    u, v, w     [m/s]    air velocity
    NAME_ppm    [ppm]    of a species, at 25 °C and 1 atm
    temperature [K]      where it is solved for
    gas_NAME    [kg/m³]  concentration of a species
    air         share of the cell that holds its gas, 0 in obstacles: the sum of gas_NAME * air * cell_volume is the
                mass; without time

To go on with, played back or as the start of a run:

    u_face, ... [m/s]    air velocity on the faces, so that its divergence over a cell stays what it was; along the
                         other axes over ghosts, so that interpolation gives the walls' own velocity at the walls
    viscosity   [m²/s]   molecular and eddy viscosity, over ghosts; only of a flow with eddies
    volume      share of the cells that is air; without time. Cells that an obstacle cuts hold gas as though they
                were as wide as their widest face, hence `air`
    area_u_face, ... share of the faces that is air; without time
    open_u_face, ... 1 on faces whose velocity was solved for, 0 on walls; without time

A frame counts once its time is written, so a film that was interrupted holds all frames before. To look at one:
``xarray.open_zarr("runs/arena-1/fields.zarr")``.
"""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.files import manifest
from taichi_plume.files.zarr_groups import (
    FAULTS,
    LARGEST_CHUNK,
    Group,
    GroupError,
    reason,
    require_memory,
    stored_chunks,
)
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.opening import unopenable
from taichi_plume.scenario.sources import OtherSpecies

if TYPE_CHECKING:
    from taichi_plume.grid.cut_cells import Air

FORMAT = "taichi_plume film 3"
EARLIER = "taichi_plume film"  # all of them begin so
VELOCITIES = ("u_face", "v_face", "w_face")
STILL = ("open_", "area_")
GAS = "gas_"  # and the name of the species
MOST = 1e9
"""Of a number in the attributes, cells along an axis among them."""


class FilmError(InputError):
    """A film that cannot be read; the message begins with its path."""


def dimensions(name: str, dim: int) -> tuple[str, ...]:
    """Names of a variable's dimensions without time, slowest first."""
    still = name.startswith(STILL)
    component = name.removeprefix(STILL[0]).removeprefix(STILL[1])
    if component in VELOCITIES:
        own, others = VELOCITIES.index(component), "" if still else "_ghost"
        ends = ["_face" if a == own else others for a in range(dim)]
    else:
        ends = ["_ghost" if name == "viscosity" else ""] * dim
    return tuple(axis + end for axis, end in zip("xyz", ends, strict=False))[::-1]


def _count(dimension: str, shape: tuple[int, ...]) -> int:
    """Number of places along a dimension."""
    more = {"": 0, "face": 1, "ghost": 2}[dimension.partition("_")[2]]
    return shape["xyz".index(dimension[0])] + more


def _positive(value: Any, name: str) -> float:
    """A number of the attributes. Raises ValueError, or TypeError."""
    number = float(value)
    if not 0.0 < number < MOST:
        raise ValueError(f"its {name} is {number:g}")
    return number


def places(dimension: str, shape: tuple[int, ...], dx: float) -> np.ndarray:
    """Coordinates [m] along a dimension."""
    n = shape["xyz".index(dimension[0])]
    if dimension.endswith("_face"):
        return np.arange(n + 1) * dx
    if dimension.endswith("_ghost"):
        return (np.arange(-1, n + 1) + 0.5) * dx
    return (np.arange(n) + 0.5) * dx


class Film:
    """A film on disk. Raises FilmError where it is not one or not whole."""

    def __init__(self, path: Path):
        self.path = path
        fault = unopenable(path, folder=True)
        if fault:
            raise FilmError(f"{path}: {fault}; a run with `fields` writes fields.zarr into its folder")
        damage = manifest.changed(path)  # zarr.json has no checksum
        if damage:
            raise FilmError(damage)
        try:
            group = Group(path)
        except GroupError as error:
            raise FilmError(str(error)) from None
        except FAULTS:
            raise FilmError(f"{path}: is no zarr group; give the fields.zarr of an earlier run") from None
        self.attributes: dict[str, Any] = group.attributes
        made = self.attributes.get("format")
        if made != FORMAT and str(made).startswith(EARLIER):
            raise FilmError(
                f"{path}: was written by another version of ours ({made}); make it again with this one"
            )
        if made != FORMAT:
            raise FilmError(f"{path}: was not written by a run of ours (its format is not '{FORMAT}')")
        try:
            self.shape: tuple[int, ...] = tuple(int(_positive(n, "shape")) for n in self.attributes["shape"])
            self.dx = _positive(self.attributes["spacing"], "spacing")
            self.depth = _positive(self.attributes["depth"], "depth")
            self.periodic: tuple[bool, ...] = tuple(map(bool, self.attributes["periodic"]))
            if not len(self.periodic) == len(self.shape) in (2, 3):
                raise ValueError("its shape or periodic are not those of a plane or a room")
            if "gases" in self.attributes:
                self.attributes["gases"] = json.loads(self.attributes["gases"])
            self.arrays: dict[str, Any] = {name: group[name] for name in group.names}
            time = self.arrays["time"]
            self.times: np.ndarray = time[: min(time.shape[0], stored_chunks(time) * time.chunks[0])]
            if self.wind:
                _positive(self.attributes["schmidt"], "schmidt")
                _positive(self.attributes["viscosity"] or 1.0, "viscosity")  # there may be none
        except GroupError as error:
            raise FilmError(str(error)) from None
        except FAULTS as error:
            raise FilmError(f"{path}: is damaged: {reason(error)}") from None
        unknown = np.flatnonzero(~np.isfinite(self.times))  # interrupted while it was written
        self.times = self.times[: unknown[0]] if len(unknown) else self.times
        if not len(self.times):
            raise FilmError(f"{path}: holds no frame")
        if (np.diff(self.times) <= 0).any():
            raise FilmError(f"{path}: is damaged: its times do not increase")
        for name in [*self.wind, *self.gas]:
            self._check(name, len(self.times))
        for name in [
            "volume",
            *(f"{still}{one}" for still in STILL for one in self.wind if one in VELOCITIES),
        ]:
            self._check(name, 0)

    def _check(self, name: str, frames: int) -> None:
        """Shape and number of the stored frames (none: without time); all else is looked at when they are read."""
        array = self.arrays.get(name)
        if array is None:
            raise FilmError(f"{self.path}: is not whole: {name} is missing; copy all of it")
        wanted = tuple(_count(d, self.shape) for d in dimensions(name, len(self.shape)))
        try:
            size = array.shape[1:] if frames else array.shape
            if size != wanted:
                raise ValueError(f"it has the shape {size}, not {wanted}")
            if math.prod(size) * array.dtype.itemsize > LARGEST_CHUNK:
                raise ValueError(f"it has frames of {size} cells, over {LARGEST_CHUNK >> 30} GiB")
            stored = stored_chunks(array)
            if frames:  # a copy by xarray may hold several in a chunk, or a frame in several
                pieces = math.prod(-(-n // k) for n, k in zip(size, array.chunks[1:], strict=True))
                stored = min(array.shape[0], stored * array.chunks[0] // pieces)
        except FAULTS as error:
            raise FilmError(f"{self.path}: is damaged: {name}: {reason(error)}") from None
        if stored < (frames or 1):
            raise FilmError(
                f"{self.path}: is not whole: {name} has {stored} of {frames or 1} frames; copy all of it"
            )

    @property
    def wind(self) -> list[str]:
        names = [*VELOCITIES[: len(self.shape)], *(["viscosity"] if "viscosity" in self.arrays else [])]
        return names if VELOCITIES[0] in self.arrays else []

    @property
    def gas(self) -> list[str]:
        """Names of the variables of the gas, one per species; empty where none was recorded."""
        return sorted(name for name in self.arrays if name.startswith(GAS))

    def gas_of(self, species: str | OtherSpecies | None) -> str:
        """The variable to play for a species; the only one there is, whatever species is asked for.

        Raises FilmError where there are several and it is none of them.
        """
        asked = species.name if isinstance(species, OtherSpecies) else species
        if len(self.gas) == 1:
            return self.gas[0]
        if f"{GAS}{asked}" in self.gas:
            return f"{GAS}{asked}"
        names = ", ".join(name.removeprefix(GAS) for name in self.gas) or "no gas"
        raise FilmError(f"{self.path}: holds {names}; give the species of one")

    def still(self, name: str) -> np.ndarray:
        try:
            require_memory({name: self.arrays[name]})
            return self.arrays[name][...].T
        except FAULTS as error:
            raise FilmError(f"{self.path}: is damaged: {name}: {reason(error)}") from None

    def air(self) -> "Air":
        """The air of a recorded wind; whose surfaces these are, and how far away, is not known."""
        from taichi_plume.grid.cut_cells import Air  # brings Taichi, which those that only look do without

        area = tuple(self.still(f"area_{name}").astype(float) for name in VELOCITIES[: len(self.shape)])
        volume = self.still("volume").astype(float)
        return Air(volume, area, area, np.full(volume.shape, -1), self.periodic)

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        result = {}
        for name in names:
            try:
                result[name] = self.arrays[name][n].T
            except FAULTS as error:
                raise FilmError(f"{self._place(name, n)} is damaged: {reason(error)}") from None
            if not np.isfinite(result[name]).all():
                raise FilmError(f"{self._place(name, n)} is damaged: not all of its values are numbers")
        return result

    def _place(self, name: str, n: int) -> str:
        return f"{self.path}: frame {n} of {name} (t = {self.times[n]:g} s)"
