"""Room on the disk, looked at ahead of writing: rerun hangs when its writer thread fails, so it must not."""

import errno
import os
import shutil
from pathlib import Path

RESERVE = 32 << 20  # bytes kept free, for the ends of all files
FILE_RESERVE = 1 << 20  # bytes below the limit on the size of one file


def require_room(file: Path, coming: int = 0) -> None:
    """Raise OSError when `coming` more bytes would leave less than the reserve on the disk of `file`."""
    free = shutil.disk_usage(file.parent).free
    if free < RESERVE + coming:
        text = f"the disk is full ({free / 1e6:.0f} MB left, {(RESERVE + coming) / 1e6:.0f} MB needed)"
        raise OSError(errno.ENOSPC, text, str(file))
    size = file.stat().st_size if file.exists() else 0
    if size + coming + FILE_RESERVE > largest_file():
        raise OSError(errno.EFBIG, "the file would exceed the limit on file sizes (ulimit -f)", str(file))


def sync(file: Path) -> None:
    """Bring a file to the disk itself, so that a machine that loses power has it. Raises OSError."""
    with file.open("rb+") as opened:
        os.fsync(opened.fileno())


def largest_file() -> float:
    """Bytes that this process may write to one file."""
    if os.name == "nt":
        return float("inf")
    import resource

    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return float("inf") if limit == resource.RLIM_INFINITY else limit
