"""A shared film: what robots meet of the air, tick by tick and to the bit, for other searches in the same air.

A zarr group with the variables u, v, w [m/s], velocities on the faces, and gas_0, gas_1 ... [kg/m³], the gases of the
scenario in their order, as the solvers had them at the end of each tick from t = 0 on: float32 in the order
(time, z, y, x), over all cells and one layer beyond them, for what lies there counts in interpolation. It is written
under another name and takes its own when it is whole.

A film to look at, or to play between its frames, is another thing: see `film`.
"""

import secrets
import shutil
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files import disk, zarr_groups

FORMAT = "taichi_plume shared film 1"
CHUNK = 16  # frames
PART = ".part"  # of its name, while it is written
UNITS = {"u": "m s-1", "v": "m s-1", "w": "m s-1"}


class AirFilmError(ValueError):
    """A shared film that cannot be read; the message is one line."""


class AirFilm:
    """A shared film; its frames are kept in memory once they have been read, while there is room.

    shape: of the grid, without the layer beyond; names: of the variables; tick [s]; frames: how many there are.
    Raises AirFilmError.
    """

    def __init__(self, path: Path, room: int = 0):
        """room: bytes of frames to keep."""
        self.path, self.room, self.held = path, room, 0
        try:
            group = zarr_groups.Group(path)
            told = group.attributes
            if told.get("format") != FORMAT:
                raise AirFilmError(f"{path}: is no shared film of this version")
            self.tick, self.frames = float(told["tick"]), int(told["frames"])
            self.shape: tuple[int, ...] = tuple(int(n) for n in told["shape"])
            self.names: tuple[str, ...] = tuple(map(str, told["names"]))
            self._arrays: dict[str, Any] = {name: group[name] for name in self.names}
            size = tuple(n + 2 for n in reversed(self.shape))
            for name, array in self._arrays.items():
                if array.shape != (self.frames, *size) or array.dtype != np.float32:
                    raise ValueError(f"{name} is not of {self.frames} frames of {self.shape} cells")
                zarr_groups.whole(array, name)
        except zarr_groups.FAULTS as error:
            if isinstance(error, AirFilmError):
                raise
            if isinstance(error, zarr_groups.GroupError):
                raise AirFilmError(str(error)) from None
            raise AirFilmError(f"{path}: is damaged: {zarr_groups.reason(error)}") from None
        self._kept: dict[int, dict[str, np.ndarray]] = {}
        self._passing: tuple[int, dict[str, np.ndarray]] = (-1, {})

    def frame(self, n: int) -> dict[str, np.ndarray]:
        """The variables at tick n, axes (x, y, z). Raises AirFilmError."""
        if not 0 <= n < self.frames:
            raise AirFilmError(f"{self.path}: ends at tick {self.frames - 1}, and tick {n} is asked for")
        block, at = divmod(n, CHUNK)
        return {name: values[at].T for name, values in self._block(block).items()}

    def _block(self, k: int) -> dict[str, np.ndarray]:
        """Frames that lie in one chunk; kept as long as there is room, so that a film too long is read on."""
        if k in self._kept:
            return self._kept[k]
        if self._passing[0] == k:
            return self._passing[1]
        span = slice(k * CHUNK, (k + 1) * CHUNK)
        try:
            block = {name: array[span] for name, array in self._arrays.items()}
        except zarr_groups.FAULTS as error:
            raise AirFilmError(f"{self.path}: is damaged: {zarr_groups.reason(error)}") from None
        if not all(np.isfinite(values).all() for values in block.values()):
            raise AirFilmError(f"{self.path}: is damaged: not all of its values are numbers")
        size = sum(values.nbytes for values in block.values())
        if self.held + size <= self.room:
            self._kept[k] = block
            self.held += size
        else:
            self._passing = k, block
        return block


class NewAirFilm:
    """A shared film while it is written; `close()` gives it its name. Raises OSError where the disk is full."""

    def __init__(self, path: Path, shape: tuple[int, ...], names: tuple[str, ...], tick: float, frames: int):
        """shape: of the grid; frames: how many there will be."""
        self.path, self.part = path, path.with_name(f"{path.name}.{secrets.token_hex(4)}{PART}")
        self.names, self.frames, self.count = names, frames, 0
        for left in path.parent.glob(
            f"{escape(path.name)}.*{PART}"
        ):  # by one that was killed, or is not waited for
            shutil.rmtree(left, ignore_errors=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        size = tuple(n + 2 for n in reversed(shape))
        frame_bytes = 4 * int(np.prod(size)) * len(names)
        disk.require_room(path.parent, frame_bytes * min(frames, CHUNK))
        about = {"format": FORMAT, "shape": list(shape), "names": list(names), "tick": tick, "frames": frames}
        group = zarr_groups.create(self.part, about)
        dims = ("time", *"zyx"[3 - len(shape) :])
        self._arrays = {
            name: zarr_groups.reserve(
                group, name, dims, (frames, *size), {"units": UNITS.get(name, "kg m-3")}, (CHUNK, *size)
            )
            for name in names
        }
        self._block = {name: np.empty((min(frames, CHUNK), *size), np.float32) for name in names}

    def append(self, frame: dict[str, np.ndarray]) -> None:
        """Add the frame of the next tick: every variable over the grid and one layer beyond, axes (x, y, z)."""
        at = self.count % CHUNK
        for name in self.names:
            self._block[name][at] = frame[name].T
        self.count += 1
        if self.count % CHUNK == 0 or self.count == self.frames:
            first = self.count - at - 1
            disk.require_room(self.path.parent, sum(values.nbytes for values in self._block.values()))
            for name, array in self._arrays.items():
                array[first : self.count] = self._block[name][: at + 1]

    def close(self) -> int:
        """Give it its name, as it is whole; returns its bytes."""
        if self.count != self.frames:
            raise ValueError(f"{self.count} of {self.frames} frames")
        zarr_groups.consolidate(self.part)
        size = sum(file.stat().st_size for file in self.part.rglob("*") if file.is_file())
        shutil.rmtree(self.path, ignore_errors=True)
        self.part.rename(self.path)
        return size

    def discard(self) -> None:
        """Remove what there is of it."""
        shutil.rmtree(self.part, ignore_errors=True)
