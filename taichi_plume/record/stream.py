"""Output stream of a recording: written to the disk in whole batches, readable even if the process dies."""

import ctypes
import errno
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from datetime import timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from taichi_plume.files import disk
from taichi_plume.record.drawing import TIME
from taichi_plume.record.live import SEVERED

FLUSH_TIMEOUT = 60.0  # s
MOST_GATHERED = 1 << 22  # bytes of pictures


class Stream:
    """Writer of a recording to the file `path`. Pictures are gathered and sent in columns, as time series are: logging
    a picture alone costs as much as ten rows of a column. Only `flush` makes sure that all data are on the disk.

    live: address of a viewer that also receives the recording; the file is written even if the viewer fails. Raises
    OSError, from `begin` and `flush`, as soon as the disk has too little room.
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
        batches.flush_tick = timedelta(days=1)  # only `flush` ends chunks: equal runs have equal chunks
        batches.flush_num_bytes = 1 << 22
        identity = "-".join([name, *map(str, seeds)])
        self.rerun = rr.RecordingStream("taichi_plume", recording_id=identity, batcher_config=batches)
        self.rerun.set_log_time_enabled(False)
        self.rerun.send_recording_name(name)
        self.blueprint = blueprint

    def begin(self) -> None:
        """Create the recording's file and, if `live` is given, connect to the viewer. Raises OSError."""
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
        """Copy the data of an earlier recording of the run up to time t [s], except static values, into this one."""
        latest = np.timedelta64(round(1e9 * t) + 1000, "ns")  # times are whole nanoseconds
        for chunk in rr.chunk.RrdReader(str(earlier)).stream():
            if not chunk.is_static:
                self.rerun.send_chunks(list(_until(chunk, latest)))
        self.flush()

    def log_still(self, entities: Iterable[tuple[str, rr.AsComponents]]) -> None:
        """Log pairs (entity path, rerun archetype) that are valid at all times of the recording."""
        for entity, archetype in entities:
            self.rerun.log(entity, archetype, static=True)

    def log(self, t: float, entity: str, archetype: rr.AsComponents) -> None:
        """Log a rerun archetype (drawable object) at an entity path of the recording, valid from time t [s] on."""
        self.rerun.set_time(TIME, duration=t)
        self.rerun.log(entity, archetype)

    def picture(self, t: float, entity: str, pixels: bytes) -> None:
        """Gather a picture's bytes, valid from time t [s] on at an entity path, to be sent with other pictures."""
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

    def send(self, entity: str, t: Sequence[float] | np.ndarray, columns: rr.ComponentColumnList) -> None:
        """Send columns of values to an entity path of the recording, with one row for each of the times t [s]."""
        self.rerun.send_columns(entity, [rr.TimeColumn(TIME, duration=t)], columns)

    def require_room(self) -> None:
        """Raise OSError if the disk has no room for the next batches of the recording."""
        disk.require_room(self.path, 4 * self.largest_batch)

    def flush(self) -> None:
        """Send the gathered pictures and write all data to the disk. Raises OSError."""
        self._send_pictures()
        try:
            self.rerun.flush(timeout_sec=FLUSH_TIMEOUT)
        except RuntimeError as error:
            if not (self.live and str(error).startswith(SEVERED)):
                self._abandon()
                disk.require_room(self.path)
                raise OSError(errno.EIO, f"writing failed ({error})", str(self.path)) from None
            disk.require_room(self.path)  # rerun reports only one of two errors
        size = self.path.stat().st_size
        self.largest_batch = max(self.largest_batch, size - self.good_size)
        self.good_size = size

    def close(self) -> None:
        """Disconnect from the recording's file, and so finish it, if it is open."""
        if self.open:
            self.rerun.disconnect()
            self.open = False

    def _abandon(self) -> None:
        """Cut the file to its last whole batch after a failed write, and detach rerun, which would hang at exit."""
        rr.unregister_shutdown()
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.rerun.to_native()))
        self.open = False
        if self.path.exists():
            os.truncate(self.path, self.good_size)  # to the last whole message


def _until(chunk: rr.chunk.Chunk, latest: np.timedelta64) -> Iterator[rr.chunk.Chunk]:
    """Yield a chunk of a recording without its rows after the time `latest`; nothing if all rows are later."""
    rows = chunk.to_record_batch()
    early = rows.column(TIME).to_numpy(zero_copy_only=False) <= latest
    if early.all():
        yield chunk
    elif early.any():
        yield from rr.chunk.Chunk.from_record_batch(rows.filter(pa.array(early)))


def mend(path: Path, mended: Path) -> None:
    """Copy the readable part of a recording that was cut off to the path `mended`, and add its index.

    Raises OSError if no part can be read, or if there is no room.
    """
    disk.require_room(mended, path.stat().st_size)
    command = [sys.executable, "-m", "rerun_cli", "rrd", "merge", "--continue-on-error", path, "-o", mended]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode or not mended.exists():
        mended.unlink(missing_ok=True)
        raise OSError(errno.EIO, "cannot be read, not even in part", str(path))
