"""Shared film of a study: wind and gas at every time step, bit for bit, for runs that share one turbulent flow.

A zarr group with the variables u, v, w [m/s], velocities on the faces, and gas_0, gas_1 ... [kg/m³], the gases of the
scenario in order, at the end of each time step from t = 0 on: float32 in the order (time, z, y, x), over all cells and
one layer of ghost cells, which interpolation needs. The group is renamed to `path` when all frames are written.

See `film` for the film that users look at and play back.
"""

import secrets
from glob import escape
from pathlib import Path

import numpy as np

from taichi_plume.files import disk, zarr_groups

FORMAT = "taichi_plume shared film 1"
CHUNK = 16  # frames
PART = ".part"  # end of the name while the film is written
UNITS = {"u": "m s-1", "v": "m s-1", "w": "m s-1"}


class AirFilmError(ValueError):
    """Error: a shared film (wind and gas for several runs) cannot be read; the message is one line."""


class AirFilm:
    """Reader of a shared film (wind and gas for several runs); caches frames in memory up to `room` bytes.

    shape: of the grid without ghost cells; names: of the variables; tick: time step [s]; frames: their number; times:
    of the frames [s]; held: cached bytes. Raises AirFilmError.
    """

    def __init__(self, path: Path, room: int = 0):
        self.path, self.room, self.held = path, room, 0
        with zarr_groups.errors_as(AirFilmError, path):
            group = zarr_groups.Group(path)
            known = group.attributes
            if known.get("format") != FORMAT:
                raise AirFilmError(f"{path}: is no shared film of this version")
            self.tick, self.frames = float(known["tick"]), int(known["frames"])
            self.times = self.tick * np.arange(self.frames)
            self.shape: tuple[int, ...] = tuple(int(n) for n in known["shape"])
            self.names: tuple[str, ...] = tuple(map(str, known["names"]))
            self._arrays = {name: group[name] for name in self.names}
            size = tuple(n + 2 for n in reversed(self.shape))
            for name, array in self._arrays.items():
                if array.shape != (self.frames, *size) or array.dtype != np.float32:
                    raise ValueError(f"{name} is not of {self.frames} frames of {self.shape} cells")
                zarr_groups.require_chunks(array, name)
        self._kept: dict[int, dict[str, np.ndarray]] = {}
        self._last = -1  # last block that did not fit into `room`

    def frame(self, n: int) -> dict[str, np.ndarray]:
        """Return all variables at time step n, with ghost cells, axes (x, y, z). Raises AirFilmError."""
        if not 0 <= n < self.frames:
            raise AirFilmError(f"{self.path}: has no tick {n}; ends at tick {self.frames - 1}")
        block, at = divmod(n, CHUNK)
        return {name: values[at].T for name, values in self._block(block).items()}

    def _block(self, k: int) -> dict[str, np.ndarray]:
        """Return the frames of chunk k by variable, from the cache or the disk."""
        if k in self._kept:
            return self._kept[k]
        span = slice(k * CHUNK, (k + 1) * CHUNK)
        with zarr_groups.errors_as(AirFilmError, self.path):
            block = {name: array[span] for name, array in self._arrays.items()}
        if not all(np.isfinite(values).all() for values in block.values()):
            raise AirFilmError(f"{self.path}: is damaged: not all of its values are numbers")
        size = sum(values.nbytes for values in block.values())
        if self.held + size <= self.room:
            self.held += size
        else:
            self._kept.pop(self._last, None)
            self._last = k
        self._kept[k] = block
        return block


class NewAirFilm:
    """Writer of a shared film (wind and gas for several runs). Raises OSError if the disk is full.

    frames: their final number; count: written so far. `close()` renames the complete film to `path`.
    """

    def __init__(self, path: Path, shape: tuple[int, ...], names: tuple[str, ...], tick: float, frames: int):
        self.path, self.part = path, path.with_name(f"{path.name}.{secrets.token_hex(4)}{PART}")
        self.names, self.frames, self.count = names, frames, 0
        for part in path.parent.glob(f"{escape(path.name)}.*{PART}"):  # of a killed or abandoned writer
            disk.discard(part)
        path.parent.mkdir(parents=True, exist_ok=True)
        size = tuple(n + 2 for n in reversed(shape))
        self._block = {name: np.empty((min(frames, CHUNK), *size), np.float32) for name in names}
        self._require_room()
        about = {"format": FORMAT, "shape": list(shape), "names": list(names), "tick": tick, "frames": frames}
        group = zarr_groups.create(self.part, about)
        dims = ("time", *"zyx"[3 - len(shape) :])
        self._arrays = {
            name: zarr_groups.reserve(
                group, name, dims, (frames, *size), {"units": UNITS.get(name, "kg m-3")}, (CHUNK, *size)
            )
            for name in names
        }

    def _require_room(self) -> None:
        disk.require_room(self.path.parent, sum(values.nbytes for values in self._block.values()))

    def append(self, frame: dict[str, np.ndarray]) -> None:
        """Add the frame of the next time step: each variable over grid and ghost cells, axes (x, y, z)."""
        at = self.count % CHUNK
        for name in self.names:
            self._block[name][at] = frame[name].T
        self.count += 1
        if self.count % CHUNK == 0 or self.count == self.frames:
            first = self.count - at - 1
            self._require_room()
            for name, array in self._arrays.items():
                array[first : self.count] = self._block[name][: at + 1]

    def close(self) -> int:
        """Rename the completed film to `path`; return its size in bytes."""
        if self.count != self.frames:
            raise ValueError(f"{self.count} of {self.frames} frames")
        zarr_groups.consolidate(self.part)
        size = sum(file.stat().st_size for file in self.part.rglob("*") if file.is_file())
        try:
            self.part.rename(self.path)
        except OSError:  # another machine has written the same film, which runs may play
            if not self.path.exists():
                raise
            self.discard()
        return size

    def discard(self) -> None:
        """Delete the unfinished film."""
        disk.discard(self.part)
