"""A film: wind and gas on the whole grid, frame by frame, in a zarr group that xarray opens as it is.

Dimensions, for `a` in x, y, z: `a` cell centres, `a_face` cell faces, `a_ghost` cell centres and one more beyond each
end. Variables are float32 in the order (time, z, y, x), one chunk per frame and variable:

    u, v, w     [m/s]    air velocity on the faces, so that its divergence over a cell stays what it was; along the
                         other axes over ghosts, so that interpolation gives the walls' own velocity at the walls
    viscosity   [m²/s]   molecular and eddy viscosity, over ghosts; only of a flow with eddies
    gas_NAME    [kg/m³]  concentration of a species
    air         share of the cells that is air; without time
    area_u, ... share of the faces that is air; without time
    open_u, ... 1 on faces whose velocity was solved for, 0 on walls; without time

A frame counts once its time is written, so a film that was interrupted holds all frames before. To look at one:
``xarray.open_zarr("runs/arena-1/fields.zarr", consolidated=False)``.
"""

from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec

from taichi_plume.files import manifest
from taichi_plume.files.tables import plain
from taichi_plume.grid.cut_cells import Air
from taichi_plume.guard.opening import irregular, unopenable
from taichi_plume.scenario.sources import OtherSpecies

FORMAT = "taichi_plume film 2"
TIMES = 4096  # per chunk
VELOCITIES = ("u", "v", "w")
STILL = ("open_", "area_")
GAS = "gas_"  # and the name of the species
MEANING = {
    "time": ("s", "simulated time"),
    "u": ("m s-1", "velocity of the air along x"),
    "v": ("m s-1", "velocity of the air along y"),
    "w": ("m s-1", "velocity of the air along z"),
    "viscosity": ("m2 s-1", "molecular and eddy viscosity"),
    "air": ("1", "share of the cell that is air"),
}
FAULTS = (
    OSError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    RuntimeError,
    ArithmeticError,
    MemoryError,
)
"""Of what zarr reads."""
MOST = 1e9
"""Of a number in the attributes, cells along an axis among them."""


class FilmError(ValueError):
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


class NewFilm:
    """A film being written.

    shape: cells per axis (x, y, z); dx [m]; attributes: of the group; moving: names of the variables of a frame;
    still: those that do not change, with their values. kept: go on with the film that is there, after so many frames.
    """

    def __init__(
        self,
        path: Path,
        shape: tuple[int, ...],
        dx: float,
        attributes: dict[str, Any],
        moving: list[str],
        still: dict[str, np.ndarray],
        kept: int | None = None,
    ):
        if kept is not None:
            self._go_on(path, moving, kept)
            return
        facts = {"format": FORMAT, "shape": list(shape), "spacing": dx, **attributes}
        self.group = zarr.create_group(path, zarr_format=3, attributes=facts)
        self.frames = 0
        dim = len(shape)
        self.time = self._array("time", (), (0,), (TIMES,), "float64")
        self.moving = {}
        for name in moving:
            names = dimensions(name, dim)
            size = tuple(len(places(one, shape, dx)) for one in names)
            self.moving[name] = self._array(name, names, (0, *size), (1, *size), "float32")
        for name, values in still.items():
            kind = "int8" if name.startswith("open_") else "float32"
            self._array(name, dimensions(name, dim), values.shape, values.shape, kind, values)
        for name in sorted({d for v in [*moving, *still] for d in dimensions(v, dim)}):
            along = places(name, shape, dx)
            self._array(name, (name,), along.shape, along.shape, "float64", along)

    def _go_on(self, path: Path, moving: list[str], kept: int) -> None:
        """Raises FilmError where there are fewer frames."""
        try:
            self.group = zarr.open_group(path, mode="r+")
            arrays: dict[str, Any] = {name: self.group[name] for name in _arrays(path)}
            self.frames, self.time = kept, arrays["time"]
            self.moving = {name: arrays[name] for name in moving}
            held = int(np.isfinite(self.time[:kept]).sum())
            held = min(held, *(min(one.shape[0], one.nchunks_initialized) for one in self.moving.values()))
        except FAULTS as error:
            raise FilmError(f"{path}: is damaged, without it the run cannot go on: {_line(error)}") from None
        if held < kept:
            raise FilmError(
                f"{path}: {held} of its first {kept} frames are left, without which the run cannot go on"
            )
        tidy(path)
        for array in (self.time, *self.moving.values()):
            array.resize((kept, *array.shape[1:]))

    def _array(
        self, name: str, dims: tuple, shape: tuple, chunks: tuple, kind: str, values: Any = None
    ) -> Any:
        units, meaning = MEANING.get(name, ("1" if name.startswith(STILL) else "m", name.replace("_", " ")))
        if name.startswith(GAS):
            units, meaning = "kg m-3", f"concentration of {name.removeprefix(GAS)}"
        array = self.group.create_array(
            name,
            shape=shape,
            chunks=chunks,
            dtype=kind,
            fill_value=0 if kind == "int8" else np.nan,
            dimension_names=("time", *dims) if len(dims) < len(shape) else dims,
            attributes={"units": units, "long_name": meaning},
            compressors=[BloscCodec(cname="zstd", clevel=3, shuffle="shuffle"), Crc32cCodec()],
        )
        if values is not None:
            array[...] = values
        return array

    def append(self, t: float, frame: dict[str, np.ndarray]) -> None:
        """Add the frame of time t [s]: the values of every moving variable."""
        n = self.frames
        for name, array in self.moving.items():
            array.resize((n + 1, *array.shape[1:]))
            array[n] = frame[name]
        self.time.resize((n + 1,))
        self.time[n] = t
        self.frames = n + 1


def tidy(path: Path) -> None:
    """Remove what of a film was being written when its run was killed."""
    for part in path.rglob("*.partial"):
        part.unlink()


class Film:
    """A film on disk. Raises FilmError where it is not one or not whole."""

    def __init__(self, path: Path):
        self.path = path
        reason = unopenable(path, folder=True)
        if reason:
            raise FilmError(f"{path}: {reason}; a run with `fields` writes fields.zarr into its folder")
        reason = irregular(path)
        if reason:
            raise FilmError(f"{path}: {reason}")
        damage = manifest.changed(path)  # zarr.json has no checksum
        if damage:
            raise FilmError(damage)
        try:
            self.group: Any = zarr.open_group(path, mode="r")
            self.attributes: dict[str, Any] = dict(self.group.attrs)
        except FAULTS:
            raise FilmError(f"{path}: is no zarr group; give the fields.zarr of an earlier run") from None
        if self.attributes.get("format") != FORMAT:
            raise FilmError(f"{path}: was not written by a run of ours (its format is not '{FORMAT}')")
        try:
            self.shape: tuple[int, ...] = tuple(int(_positive(n, "shape")) for n in self.attributes["shape"])
            self.dx = _positive(self.attributes["spacing"], "spacing")
            self.depth = _positive(self.attributes["depth"], "depth")
            self.periodic: tuple[bool, ...] = tuple(map(bool, self.attributes["periodic"]))
            if not len(self.periodic) == len(self.shape) in (2, 3):
                raise ValueError("its shape or periodic are not those of a plane or a room")
            self.times: np.ndarray = self.group["time"][:]
            self.arrays: dict[str, Any] = {name: self.group[name] for name in _arrays(path)}
            if self.wind:
                _positive(self.attributes["schmidt"], "schmidt")
                _positive(self.attributes["viscosity"] or 1.0, "viscosity")  # there may be none
        except FAULTS as error:
            raise FilmError(f"{path}: is damaged: {_line(error)}") from None
        unknown = np.flatnonzero(~np.isfinite(self.times))  # interrupted while it was written
        self.times = self.times[: unknown[0]] if len(unknown) else self.times
        if not len(self.times):
            raise FilmError(f"{path}: holds no frame")
        if (np.diff(self.times) <= 0).any():
            raise FilmError(f"{path}: is damaged: its times do not increase")
        for name in [*self.wind, *self.gas]:
            self._check(name, len(self.times))
        for name in ["air", *(f"{still}{one}" for still in STILL for one in self.wind if one in VELOCITIES)]:
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
            stored = min(array.shape[0], array.nchunks_initialized) if frames else array.nchunks_initialized
        except FAULTS as error:
            raise FilmError(f"{self.path}: is damaged: {name}: {_line(error)}") from None
        if stored < (frames or 1):
            raise FilmError(
                f"{self.path}: is not whole: {name} has {stored} of {frames or 1} frames; copy all of it"
            )

    @property
    def wind(self) -> list[str]:
        """Names of the wind's variables; empty where none was recorded."""
        names = [*VELOCITIES[: len(self.shape)], *(["viscosity"] if "viscosity" in self.arrays else [])]
        return names if "u" in self.arrays else []

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
        """A variable that does not change, axes (x, y, z)."""
        try:
            return self.arrays[name][...].T
        except FAULTS as error:
            raise FilmError(f"{self.path}: is damaged: {name}: {_line(error)}") from None

    def air(self) -> Air:
        """The air of a recorded wind; whose surfaces these are, and how far away, is not known."""
        area = tuple(self.still(f"area_{name}").astype(float) for name in VELOCITIES[: len(self.shape)])
        volume = self.still("air").astype(float)
        return Air(volume, area, area, np.full(volume.shape, -1), self.periodic)

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Variables of frame n, axes (x, y, z)."""
        result = {}
        for name in names:
            try:
                result[name] = self.arrays[name][n].T
            except FAULTS as error:
                raise FilmError(f"{self._place(name, n)} is damaged: {_line(error)}") from None
            if not np.isfinite(result[name]).all():
                raise FilmError(f"{self._place(name, n)} is damaged: not all of its values are numbers")
        return result

    def _place(self, name: str, n: int) -> str:
        return f"{self.path}: frame {n} of {name} (t = {self.times[n]:g} s)"


def _arrays(path: Path) -> list[str]:
    """Names of the arrays in a group's folder; zarr, asked for all at once, prints a traceback where several fail."""
    return sorted(file.parent.name for file in path.glob("*/zarr.json"))


def _line(error: Exception) -> str:
    """What zarr says, in one line; after a checksum's mismatch it lists bytes."""
    return plain(" ".join(str(error).partition(". Stored")[0].split())) or type(error).__name__
