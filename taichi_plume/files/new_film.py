"""A film while it is written, see `film`: what its variables are called, mean and are measured in."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.files import zarr_groups
from taichi_plume.files.film import (
    FORMAT,
    GAS,
    STILL,
    VELOCITIES,
    FilmError,
    dimensions,
    places,
)

if TYPE_CHECKING:
    from taichi_plume.grid.fields import Species

TIMES = 4096  # per chunk
WIND_NAMES = {"u": "x_wind", "v": "y_wind", "w": "upward_air_velocity"}
NAMED = {  # of those that the table of CF's standard names has; of version 93
    "ethanol": ("mass_concentration_of_ethanol_in_air", "mole_fraction_of_ethanol_in_air"),
    "acetone": (None, "mole_fraction_of_acetone_in_air"),
}
MEANING = {
    "time": ("s", "simulated time since the robots start"),
    "viscosity": ("m2 s-1", "molecular and eddy viscosity of the air"),
    "temperature": ("K", "temperature of the air"),
    "air": ("1", "share of the cell that holds its gas, 0 in obstacles"),
    "volume": ("1", "share of the cell that is air"),
}
PLACES = {
    "": "the cells' middles",
    "face": "the cells' faces",
    "ghost": "the cells' middles and one beyond each end",
}


def middles(values: np.ndarray, axis: int) -> np.ndarray:
    """A velocity at the cells' middles, from its faces along an axis and ghosts along the others."""
    inner = tuple(slice(None) if a == axis else slice(1, -1) for a in range(values.ndim))
    faces = np.moveaxis(values[inner], axis, 0)
    return np.moveaxis(0.5 * (faces[1:] + faces[:-1]), 0, axis)


class NewFilm:
    """A film being written.

    shape: cells per axis (x, y, z); dx [m]; attributes: of the group; moving: names of the variables of a frame;
    still: those that do not change, with their values; species: of the gases among `moving`. kept: go on with the film
    that is there, after so many frames.
    """

    def __init__(
        self,
        path: Path,
        shape: tuple[int, ...],
        dx: float,
        attributes: dict[str, Any],
        moving: list[str],
        still: dict[str, np.ndarray],
        species: "Sequence[Species]",
        kept: int | None = None,
    ):
        self.path, self.dim = path, len(shape)
        self.ppm = {f"{GAS}{one.name}": (f"{one.name}_ppm", one.ppm_per_density) for one in species}
        names = [*moving, *self._also(moving)]
        if kept is not None:
            self._go_on(names, kept)
            return
        facts = {"format": FORMAT, "shape": list(shape), "spacing": dx, **attributes}
        facts |= {
            name: json.dumps(one) for name, one in attributes.items() if isinstance(one, dict)
        }  # for NetCDF
        self.group = zarr_groups.create(path, facts)
        self.frames = 0
        known = {}
        for one in species:
            mass, share = NAMED.get(one.name, (None, None))
            known[f"{GAS}{one.name}"] = ("kg m-3", f"concentration of {one.name}", mass)
            known[f"{one.name}_ppm"] = ("ppm", f"mole fraction of {one.name} at 25 degrees and 1 atm", share)
        self.time = self._array("time", ("time",), np.empty(0), (TIMES,), known)
        self.moving = {}
        for name in names:
            along = dimensions(name, self.dim)
            size = tuple(len(places(one, shape, dx)) for one in along)
            empty = np.empty((0, *size), np.float32)
            self.moving[name] = self._array(name, ("time", *along), empty, (1, *size), known)
        for name, values in still.items():
            kind = "int8" if name.startswith("open_") else "float32"
            self._array(name, dimensions(name, self.dim), values.astype(kind), None, known)
        for name in sorted({d for v in [*names, *still] for d in dimensions(v, self.dim)}):
            self._array(name, (name,), places(name, shape, dx), None, known)
        zarr_groups.consolidate(path)

    def _also(self, moving: list[str]) -> list[str]:
        """What is stored besides, as others want it: the wind at the cells' middles, gas in ppm."""
        return [name.removesuffix("_face") for name in moving if name in VELOCITIES] + [
            self.ppm[name][0] for name in moving if name in self.ppm
        ]

    def _go_on(self, names: list[str], kept: int) -> None:
        """Raises FilmError where there are fewer frames."""
        path = self.path
        try:
            group = zarr_groups.Group(path, mode="r+")
            arrays: dict[str, Any] = {name: group[name] for name in group.names}
            self.frames, self.time = kept, arrays["time"]
            self.moving = {name: arrays[name] for name in names}
            held = int(np.isfinite(self.time[:kept]).sum())
            held = min(
                held, *(min(one.shape[0], zarr_groups.stored_chunks(one)) for one in self.moving.values())
            )
        except zarr_groups.GroupError as error:
            raise FilmError(str(error)) from None
        except zarr_groups.FAULTS as error:
            told = zarr_groups.reason(error)
            raise FilmError(f"{path}: is damaged, without it the run cannot go on: {told}") from None
        if held < kept:
            raise FilmError(
                f"{path}: {held} of its first {kept} frames are left, without which the run cannot go on"
            )
        tidy(path)
        self._shorten(kept)

    def _shorten(self, kept: int) -> None:
        for array in (self.time, *self.moving.values()):
            array.resize((kept, *array.shape[1:]))
        zarr_groups.consolidate(self.path)

    def _array(
        self,
        name: str,
        dims: tuple[str, ...],
        values: np.ndarray,
        chunks: tuple | None,
        known: dict[str, Any],
    ) -> Any:
        """An array with what is to be known of it. known: of the gases units, meaning and standard name."""
        return zarr_groups.add(self.group, name, dims, values, _facts(name, known), chunks)

    def append(self, t: float, frame: dict[str, np.ndarray]) -> None:
        """Add the frame of time t [s]: the values of every moving variable."""
        n = self.frames
        values = dict(frame)
        for d, name in enumerate(VELOCITIES[: self.dim]):
            if name in frame:
                values[name.removesuffix("_face")] = middles(frame[name], self.dim - 1 - d)
        for name, (told, factor) in self.ppm.items():
            if name in frame:
                values[told] = frame[name] * np.float32(factor)
        for name, array in self.moving.items():
            array.resize((n + 1, *array.shape[1:]))
            array[n] = values[name]
        self.time.resize((n + 1,))
        self.time[n] = t
        self.frames = n + 1

    def flush(self) -> None:
        """Show readers the frames up to here."""
        zarr_groups.consolidate(self.path)


def _facts(name: str, known: dict[str, tuple[str, str, str | None]]) -> dict[str, str]:
    """Attributes of an array."""
    standard = more = None
    component, _, at = name.partition("_")
    if name in known:
        units, meaning, standard = known[name]
    elif f"{component}_face" in VELOCITIES and at in ("", "face"):
        along = "xyz"[VELOCITIES.index(f"{component}_face")]
        units, meaning = "m s-1", f"velocity of the air along {along}, at {PLACES[at]}"
        standard = None if at else WIND_NAMES[name]
    elif name in MEANING:
        units, meaning = MEANING[name]
        standard = "air_temperature" if name == "temperature" else None
        more = {"axis": "T", "standard_name": "time"} if name == "time" else None
    elif name.startswith(STILL):
        shown = (
            "1 where the velocity was solved for, 0 on walls" if component == "open" else "share that is air"
        )
        units, meaning = "1", f"of the faces of {at}: {shown}"
    else:
        axis, _, at = name.partition("_")
        units, meaning = "m", f"{axis} of {PLACES[at]}"
        more = None if at else {"axis": axis.upper()} | ({"positive": "up"} if axis == "z" else {})
        standard = "height" if name == "z" else None
    told = {"units": units, "long_name": meaning} | (more or {})
    return told | ({"standard_name": standard} if standard else {})


def tidy(path: Path) -> None:
    """Remove what of a film was being written when its run was killed."""
    for part in path.rglob("*.partial"):
        part.unlink()


def complete(path: Path) -> int:
    """Leave of a film that was cut off the frames that are whole, and return how many. Raises FilmError."""
    tidy(path)
    try:
        group = zarr_groups.Group(path, mode="r+")
        arrays: dict[str, Any] = {name: group[name] for name in group.names}
        moving = [one for one in arrays.values() if (one.metadata.dimension_names or ("",))[0] == "time"]
        frames = int(np.isfinite(arrays["time"][:]).cumprod().sum())
        for array in moving:
            array.resize((frames, *array.shape[1:]))
    except zarr_groups.GroupError as error:
        raise FilmError(str(error)) from None
    except zarr_groups.FAULTS as error:
        raise FilmError(f"{path}: is damaged: {zarr_groups.reason(error)}") from None
    zarr_groups.consolidate(path)
    return frames
