"""The file of a recording: opened, brought to the disk in whole batches, closed; readable whatever happens."""

import ctypes
import errno
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from taichi_plume.files import disk
from taichi_plume.record.drawing import TIME
from taichi_plume.record.live import SEVERED
from taichi_plume.record.scene import Entities

FLUSH_TIMEOUT = 60.0  # s
MOST_GATHERED = 1 << 22  # bytes of pictures


class Stream:
    """Writes `path`. Pictures are gathered, and sent by columns as series are: to log one costs as much as ten of a
    column. Nothing is on the disk before `flush`.

    live: the address of a viewer that is to see it as it comes; whatever becomes of that, the file goes on.
    Raises OSError, from `begin` and `flush`, as soon as the disk has no room for more.
    """

    def __init__(
        self, path: Path, name: str, seeds: Sequence[int], blueprint: rrb.Blueprint, live: str | None = None
    ):
        self.path, self.live = path, live
        self.good_size = self.largest_batch = 0  # bytes
        self.open = False
        self._pictures: dict[str, list[tuple[float, bytes]]] = {}
        self._gathered = 0  # bytes
        batches = rr.ChunkBatcherConfig.DEFAULT()
        batches.flush_tick = timedelta(days=1)  # chunks are cut by `flush` alone: equal runs, equal chunks
        batches.flush_num_bytes = 1 << 22
        its_id = "-".join([name, *map(str, seeds)])
        self.rerun = rr.RecordingStream("taichi_plume", recording_id=its_id, batcher_config=batches)
        self.rerun.set_log_time_enabled(False)
        self.rerun.send_recording_name(name)
        self.blueprint = blueprint

    def begin(self) -> None:
        """Make the file."""
        disk.require_room(self.path)
        self.open = True
        try:
            if self.live:
                sinks = rr.FileSink(self.path), rr.GrpcSink(self.live)
                self.rerun.set_sinks(*sinks, default_blueprint=self.blueprint)
            else:
                self.rerun.save(self.path, default_blueprint=self.blueprint)
        except RuntimeError as error:
            self._abandon()
            raise OSError(errno.EIO, str(error), str(self.path)) from None

    def take_over(self, earlier: Path, t: float) -> None:
        """Send what another recording of the run holds up to time t [s], but for what never changes."""
        latest = np.timedelta64(round(1e9 * t) + 1000, "ns")  # its times are whole nanoseconds
        for chunk in rr.chunk.RrdReader(str(earlier)).stream():
            if not chunk.is_static:
                self.rerun.send_chunks(list(_until(chunk, latest)))
        self.flush()

    def log_still(self, entities: Entities) -> None:
        """Log what never changes."""
        for entity, what in entities:
            self.rerun.log(entity, what, static=True)

    def log(self, t: float, entity: str, what: Any) -> None:
        """Log what is there from time t [s] on."""
        self.rerun.set_time(TIME, duration=t)
        self.rerun.log(entity, what)

    def picture(self, t: float, entity: str, pixels: bytes) -> None:
        """Pixels of a GridMap from time t [s] on; what else it needs has been logged."""
        self._pictures.setdefault(entity, []).append((t, pixels))
        self._gathered += len(pixels)
        if self._gathered > MOST_GATHERED:
            self._send_pictures()

    def _send_pictures(self) -> None:
        for entity, pictures in self._pictures.items():
            times, pixels = zip(*pictures, strict=True)
            self.send(entity, times, rr.GridMap.columns(data=list(pixels)))
        self._pictures.clear()
        self._gathered = 0

    def send(self, entity: str, t: Sequence[float] | np.ndarray, columns: Any) -> None:
        """Send columns of values of an entity at times t [s]."""
        self.rerun.send_columns(entity, [rr.TimeColumn(TIME, duration=t)], columns)

    def require_room(self) -> None:
        """Raise OSError where a few more batches would fill the disk."""
        disk.require_room(self.path, 4 * self.largest_batch)

    def flush(self) -> None:
        """Bring all to the disk."""
        self._send_pictures()
        try:
            self.rerun.flush(timeout_sec=FLUSH_TIMEOUT)
        except RuntimeError as error:
            if not (self.live and str(error).startswith(SEVERED)):
                self._abandon()
                disk.require_room(self.path)
                raise OSError(errno.EIO, f"writing failed ({error})", str(self.path)) from None
            disk.require_room(self.path)  # of two faults rerun tells but one
        size = self.path.stat().st_size
        self.largest_batch = max(self.largest_batch, size - self.good_size)
        self.good_size = size

    def close(self) -> None:
        """Finish the file."""
        if self.open:
            self.rerun.disconnect()
            self.open = False

    def _abandon(self) -> None:
        """Give up after a failed write. Rerun would now hang in `disconnect` and when the stream is freed."""
        rr.unregister_shutdown()
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.rerun.to_native()))
        self.open = False
        if self.path.exists():
            os.truncate(self.path, self.good_size)  # to the last whole message


def _until(chunk: rr.chunk.Chunk, latest: np.timedelta64) -> Iterator[rr.chunk.Chunk]:
    """The rows of a chunk up to a time, if there are any."""
    rows = chunk.to_record_batch()
    early = rows.column(TIME).to_numpy(zero_copy_only=False) <= latest
    if early.all():
        yield chunk
    elif early.any():
        yield from rr.chunk.Chunk.from_record_batch(rows.filter(pa.array(early)))


def mend(path: Path, mended: Path) -> None:
    """Write a recording whose writing was cut off as one that is whole: without what is broken, with its index.

    Raises OSError where nothing of it can be read, and where there is no room.
    """
    disk.require_room(mended, path.stat().st_size)
    command = [sys.executable, "-m", "rerun_cli", "rrd", "merge", "--continue-on-error", path, "-o", mended]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode or not mended.exists():
        mended.unlink(missing_ok=True)
        raise OSError(errno.EIO, "cannot be read, not even in part", str(path))
