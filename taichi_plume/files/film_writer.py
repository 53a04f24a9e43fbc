"""Writer of films (recorded wind and gas, see `film`): units and CF names of variables; completion after a kill."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.files import zarr_groups
from taichi_plume.files.film import BACKGROUND, FORMAT, GAS, STILL, VELOCITIES, FilmError, dimensions, places
from taichi_plume.files.zarr_groups import Array, errors_as

if TYPE_CHECKING:
    from taichi_plume.grid.fields import Species

Known = Mapping[str, tuple[str, str, str | None]]
"""Units, meaning and standard name of variables."""
TIMES = 4096  # per chunk
WIND_NAMES = {"u": "x_wind", "v": "y_wind", "w": "upward_air_velocity"}
NAMED = {  # standard names of CF, version 93
    "ethanol": ("mass_concentration_of_ethanol_in_air", "mole_fraction_of_ethanol_in_air"),
    "acetone": (None, "mole_fraction_of_acetone_in_air"),
}
MEANING: Known = {
    "time": ("s", "simulated time since the robots start", "time"),
    "viscosity": ("m2 s-1", "molecular and eddy viscosity of the air", None),
    "air": ("1", "volume fraction of the cell that holds gas, 0 in obstacles", None),
    "volume": ("1", "volume fraction of the cell that is air", None),
}
PLACES = {
    "": "the cell centres",
    "face": "the cell faces",
    "ghost": "the cell centres and one ghost cell beyond each end",
}


def middles(values: np.ndarray, axis: int) -> np.ndarray:
    """Average a velocity component from the faces along `axis` to cell centres; other axes lose their ghost cells."""
    inner = tuple(slice(None) if a == axis else slice(1, -1) for a in range(values.ndim))
    faces = np.moveaxis(values[inner], axis, 0)
    return np.moveaxis(0.5 * (faces[1:] + faces[:-1]), 0, axis)


class NewFilm:
    """Writer of a film (recorded wind and gas, see `film`).

    shape: cells per axis (x, y, z); dx: cell edge [m]; attributes: of the group; moving: names of the variables of a
    frame; still: variables without time; species: of the gases among `moving`. resume_at: resume the existing film
    after this number of frames; raises FilmError if the film has fewer. background: of species in clean air [ppm], by
    name, which the gases do not contain. further: attributes, with units and long_name, of variables among `moving`
    that are neither gas nor wind.
    """

    def __init__(
        self,
        path: Path,
        shape: tuple[int, ...],
        dx: float,
        attributes: Mapping[str, object],
        moving: Sequence[str],
        still: Mapping[str, np.ndarray],
        species: "Sequence[Species]",
        resume_at: int | None = None,
        background: Mapping[str, float] | None = None,
        further: Mapping[str, Mapping[str, object]] | None = None,
    ):
        self.path, self.dim = path, len(shape)
        self.ppm = {f"{GAS}{gas.name}": (f"{gas.name}_ppm", gas.ppm_per_density) for gas in species}
        centred = [name.removesuffix("_face") for name in moving if name in VELOCITIES]
        names = [*moving, *centred, *(self.ppm[name][0] for name in moving if name in self.ppm)]
        if resume_at is not None:
            self._resume(names, resume_at)
            return
        facts = {"format": FORMAT, "shape": list(shape), "spacing": dx, **attributes}
        facts |= {
            key: json.dumps(value) for key, value in attributes.items() if isinstance(value, dict)
        }  # for NetCDF
        self.group = zarr_groups.create(path, facts)
        self.frames = 0
        self.backgrounds: dict[str, dict[str, float]] = {}
        self.further = further or {}
        known = dict(MEANING)
        for gas in species:
            mass, share = NAMED.get(gas.name, (None, None))
            variables, above = (f"{GAS}{gas.name}", f"{gas.name}_ppm"), ""
            if ppm := (background or {}).get(gas.name, 0.0):
                mass, share, above = None, None, f", above the background of {ppm:g} ppm"
                self.backgrounds |= {name: {BACKGROUND: ppm} for name in variables}
            known[variables[0]] = ("kg m-3", f"concentration of {gas.name}{above}", mass)
            known[variables[1]] = (
                "ppm",
                f"mole fraction of {gas.name} at 25 degrees and 1 atm{above}",
                share,
            )
        self.time = self._array("time", ("time",), np.empty(0), (TIMES,), known)
        self.moving = {}
        for name in names:
            along = dimensions(name, self.dim)
            size = tuple(len(places(d, shape, dx)) for d in along)
            empty = np.empty((0, *size), np.float32)
            self.moving[name] = self._array(name, ("time", *along), empty, (1, *size), known)
        for name, values in still.items():
            kind = "int8" if name.startswith("open_") else "float32"
            self._array(name, dimensions(name, self.dim), values.astype(kind), None, known)
        for name in sorted({d for v in [*names, *still] for d in dimensions(v, self.dim)}):
            self._array(name, (name,), places(name, shape, dx), None, known)
        zarr_groups.consolidate(path)

    def _resume(self, names: Sequence[str], resume_at: int) -> None:
        path = self.path
        with errors_as(FilmError, path, "is damaged, without it the run cannot go on"):
            group = zarr_groups.Group(path, mode="r+")
            arrays = {name: group[name] for name in group.names}
            self.frames, self.time = resume_at, arrays["time"]
            self.moving = {name: arrays[name] for name in names}
            stored = [min(array.shape[0], zarr_groups.stored_chunks(array)) for array in self.moving.values()]
            held = min(int(np.isfinite(self.time[:resume_at]).sum()), *stored)
        if held < resume_at:
            raise FilmError(f"{path}: the run cannot go on: {held} of the first {resume_at} frames are left")
        for part in path.rglob("*.partial"):  # of a killed run
            part.unlink()
        for array in (self.time, *self.moving.values()):
            array.resize((resume_at, *array.shape[1:]))
        zarr_groups.consolidate(path)

    def _array(
        self,
        name: str,
        dims: tuple[str, ...],
        values: np.ndarray,
        chunks: tuple[int, ...] | None,
        known: Known,
    ) -> Array:
        about = self.further.get(name) or _facts(name, known) | self.backgrounds.get(name, {})
        return zarr_groups.add(self.group, name, dims, values, about, chunks)

    def append(self, t: float, frame: Mapping[str, np.ndarray]) -> None:
        """Append a frame at time t [s]; frame: array of every time-dependent variable, by name."""
        n = self.frames
        values = dict(frame)
        for d, name in enumerate(VELOCITIES[: self.dim]):
            if name in frame:
                values[name.removesuffix("_face")] = middles(frame[name], self.dim - 1 - d)
        for name, (in_ppm, factor) in self.ppm.items():
            if name in frame:
                values[in_ppm] = frame[name] * np.float32(factor)
        for name, array in self.moving.items():
            array.resize((n + 1, *array.shape[1:]))
            array[n] = values[name]
        self.time.resize((n + 1,))
        self.time[n] = t
        self.frames = n + 1

    def flush(self) -> None:
        """Update the metadata, so that readers see all frames written so far."""
        zarr_groups.consolidate(self.path)


def _facts(name: str, known: Known) -> dict[str, str]:
    """Return the CF attributes (units, long_name, standard_name, axis) of the film variable `name`."""
    standard, more = None, {"axis": "T"} if name == "time" else {}
    component, _, at = name.partition("_")
    if name in known:
        units, meaning, standard = known[name]
    elif f"{component}_face" in VELOCITIES and at in ("", "face"):
        along = "xyz"[VELOCITIES.index(f"{component}_face")]
        units, meaning = "m s-1", f"velocity of the air along {along}, at {PLACES[at]}"
        standard = None if at else WIND_NAMES[name]
    elif name.startswith(STILL):
        solved = "1 where the velocity was solved for, 0 on walls"
        what = solved if component == "open" else "area fraction that is air"
        units, meaning = "1", f"of the faces of {at}: {what}"
    else:
        units, meaning = "m", f"{component} of {PLACES[at]}"
        more = {} if at else {"axis": component.upper()} | ({"positive": "up"} if name == "z" else {})
        standard = "height" if name == "z" else None
    return {"units": units, "long_name": meaning, **more, **({"standard_name": standard} if standard else {})}


def complete(path: Path) -> int:
    """Cut an interrupted film to the frames that are complete; return their number. Raises FilmError."""
    with errors_as(FilmError, path):
        return zarr_groups.complete(path)
