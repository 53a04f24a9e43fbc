"""Writer of `pictures.zarr`: the values of views over time, see files/pictures_file.py."""

from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files import disk
from taichi_plume.files.pictures_file import FORMAT, TIME_CHUNK
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.observed.observer import Observer, Pictures
from taichi_plume.observed.quantities import MISSING
from taichi_plume.observed.views import Layout, layout
from taichi_plume.time_loop import Every, TimeLoop

CHUNK = 1 << 20  # bytes of a variable's chunk before compression
LONGEST = 256  # pictures in a chunk: each write to a variable costs 5 ms


class PictureStore:
    """Writer of the values of an observer's views into a zarr group.

    Pictures are gathered in memory until a chunk is full or `flush` is called, and the file is created then, as zarr's
    import takes a quarter of a second. attributes: of the group. Raises OSError as soon as the disk is full.
    """

    STATE = ("frames",)

    def __init__(self, observer: Observer, path: Path, attributes: Mapping[str, object]):
        self.path, self.attributes = path, dict(attributes)
        stored = [view for view in observer.views if view.stored]
        self.parts = {
            name: _Part(path, name, layout([view for view in stored if view.part == name], observer.samples))
            for name in dict.fromkeys(view.part for view in stored)
        }
        self.frames = dict.fromkeys(self.parts, 0)
        """Number of pictures of each part on the disk at the last flush."""
        self.observer_of = observer
        observer.shown_by.append(self.show)
        self.open = False

    def observer(self) -> Every:
        """Return the observer of the time loop, of a store whose views have one rate."""
        (every,) = self.observer_of.observers()
        return every

    def start(self) -> None:
        disk.require_room(self.path)
        self.open = True

    def show(self, sim: TimeLoop, pictures: Pictures) -> None:
        """Gather the pictures of an instant; write those of a full chunk."""
        for part in self.parts.values():
            if part.layout.variables and part.layout.variables[0].view.name in pictures:
                part.gather(sim.t, pictures)
                if part.count % part.length == 0:
                    self._write(part)

    def _write(self, part: "_Part") -> None:
        from taichi_plume.files import zarr_groups

        disk.require_room(self.path, part.gathered_bytes)
        if not (self.path / "zarr.json").exists():
            zarr_groups.create(self.path, {"format": FORMAT, **self.attributes})
        part.write()

    def flush(self) -> None:
        from taichi_plume.files import zarr_groups

        for part in self.parts.values():
            if part.times or part.group is None:
                self._write(part)
        for name in {*self.parts} - {""}:
            zarr_groups.consolidate(self.path, name)
        zarr_groups.consolidate(self.path)  # last, as the root repeats the metadata of all parts
        self.frames = {name: part.count for name, part in self.parts.items()}

    def resume(self) -> None:
        """Resume the file: cut off the pictures after the last `flush`. Raises RunFolderError if some are missing."""
        for name, part in self.parts.items():
            part.resume(self.frames[name])
        self.open = True

    def close(self) -> None:
        if self.open:
            self.open = False
            self.flush()


class _Part:
    """Group of variables with a common time. length: pictures per chunk; count: pictures so far, with those in memory;
    times, values: pictures in memory, as observed.
    """

    def __init__(self, path: Path, name: str, of: Layout):
        self.path, self.name, self.layout = path, name, of
        largest = max((prod(each.shape) for each in of.variables), default=1)
        self.length = int(np.clip(CHUNK // (2 * largest), 1, LONGEST))
        self.group: Any = None
        self.arrays: dict[str, Any] = {}
        self.count = 0
        self.times: list[float] = []
        self.values: dict[str, list[np.ndarray]] = {each.name: [] for each in of.variables}

    @property
    def gathered_bytes(self) -> int:
        return sum(values.nbytes for gathered in self.values.values() for values in gathered)

    def gather(self, t: float, pictures: Pictures) -> None:
        for each in self.layout.variables:
            self.values[each.name].append(each.values(pictures))
        self.times.append(t)
        self.count += 1

    def write(self) -> None:
        """Write the pictures in memory, also behind those of a chunk that is not full."""
        if self.group is None:
            self._create()
        first = self.count - len(self.times)
        for each in self.layout.variables:
            gathered = self.values[each.name]
            if gathered:
                array = self.arrays[each.name]
                array.resize((self.count, *array.shape[1:]))
                array[first:] = each.view.quantity.precision.packed(np.stack(gathered))
                gathered.clear()
        if self.times:
            time = self.arrays["time"]
            time.resize((self.count,))
            time[first:] = np.array(self.times)
            self.times.clear()

    def _create(self) -> None:
        from taichi_plume.files import zarr_groups

        self.group = (
            zarr_groups.create(self.path / self.name, {}) if self.name else zarr_groups.opened(self.path)
        )
        time = {"units": "s", "long_name": "simulated time", "axis": "T", "standard_name": "time"}
        add = zarr_groups.add
        self.arrays["time"] = add(self.group, "time", ("time",), np.empty(0), time, (TIME_CHUNK,))
        for each in self.layout.variables:
            precision = each.view.quantity.precision
            empty = precision.packed(np.empty((0, *each.shape), np.float32))
            missing = {"_FillValue": MISSING} if empty.dtype.kind == "i" else {}
            self.arrays[each.name] = add(
                self.group, each.name, ("time", *each.dims), empty, each.attributes | precision.attributes | missing,
                (self.length, *each.shape),
            )  # fmt: skip
        for name, (values, about) in self.layout.coordinates.items():
            add(self.group, name, (name,), values, about)

    def resume(self, count: int) -> None:
        from taichi_plume.files import zarr_groups

        if not count and not (self.path / self.name / "zarr.json").exists():
            return
        with zarr_groups.errors_as(RunFolderError, self.path, "is damaged, without it the run cannot go on"):
            group = zarr_groups.Group(self.path, self.name, mode="r+")
            self.arrays = {name: group[name] for name in ("time", *self.values)}
            self.group = group
            held = min(
                int(np.isfinite(self.arrays["time"][:count]).sum()),
                *(a.shape[0] for a in self.arrays.values()),
            )
        if held < count:
            raise RunFolderError(
                f"{self.path}: the run cannot go on: {held} of the first {count} pictures are left"
            )
        self.count = count
        for array in self.arrays.values():
            begin = count - count % array.chunks[0]
            values = array[begin:count]
            array.resize((begin, *array.shape[1:]))  # also removes later chunks
            array.resize((count, *array.shape[1:]))
            array[begin:] = values
