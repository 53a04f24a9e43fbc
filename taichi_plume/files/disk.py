"""Checks of free disk space before writing (rerun hangs if its writer thread fails), and atomic file writing."""

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from taichi_plume.guard.safe_open import NO_NAME, read_regular

RESERVE = 32 << 20  # bytes kept free, to complete all files
FILE_RESERVE = 1 << 20  # bytes below the limit on the size of one file


def require_room(file: Path, coming: int = 0) -> None:
    """Raise OSError if writing `coming` more bytes would leave less free disk space than a reserve."""
    free = shutil.disk_usage(file.parent).free
    if free < RESERVE + coming:
        text = f"the disk is full ({free / 1e6:.0f} MB left, {(RESERVE + coming) / 1e6:.0f} MB needed)"
        raise OSError(errno.ENOSPC, text, str(file))
    size = file.stat().st_size if file.exists() else 0
    if size + coming + FILE_RESERVE > largest_file():
        raise OSError(errno.EFBIG, "the file would exceed the limit on file sizes (ulimit -f)", str(file))


def new_beside(path: Path) -> Path:
    """Create an empty temporary file in the folder of `path`, to be filled and renamed to `path`.

    The file is created exclusively under a random name: no link is followed, no file overwritten. Raises OSError.
    """
    fresh = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        os.close(os.open(fresh, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    except ValueError as error:  # a zero byte, a lone surrogate
        raise OSError(errno.EINVAL, NO_NAME, str(path)) from error
    return fresh


def new_folder_beside(path: Path) -> Path:
    """Create an empty temporary folder in the folder of `path`, to be filled and renamed to `path`. Raises OSError."""
    fresh = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    fresh.mkdir()
    return fresh


def put_at_free(fresh: Path, path: Path) -> None:
    """Rename a file to a name that nothing has. Raises FileExistsError."""
    try:
        os.link(fresh, path)  # unlike a rename, it never replaces
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        os.rename(fresh, path)


def left_in(folder: Path) -> list[Path]:
    """Return the temporary files (see `new_beside`) that killed processes left in a folder."""
    return list(folder.glob(f".*.{'[0-9a-f]' * 8}.part"))


def remove(path: Path, ignore_errors: bool = False) -> None:
    """Delete a file, pipe or link, or a folder with its content, if it exists. Raises OSError."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors)  # would open a pipe, and wait
    else:
        path.unlink(missing_ok=True)


def discard(path: Path) -> None:
    """Delete a file, pipe or link, or a folder with its content, as far as possible."""
    with suppress(OSError):
        remove(path, ignore_errors=True)


@contextmanager
def written_whole(path: Path, durable: bool = True, replace: bool = True) -> Iterator[Path]:
    """Context that yields a temporary file to write, and then atomically puts the file at `path`.

    durable: the file survives a power failure; otherwise only a kill. replace: an earlier file or link at `path` is
    replaced, and a link not followed; otherwise FileExistsError is raised and the earlier file stays. Raises OSError.
    """
    fresh = new_beside(path)
    try:
        yield fresh
        if durable:
            with fresh.open("rb+") as file:
                os.fsync(file.fileno())
        if replace:
            os.replace(fresh, path)
        else:
            put_at_free(fresh, path)
    finally:
        with suppress(OSError):
            fresh.unlink(missing_ok=True)
    if durable and os.name != "nt":  # Windows cannot open folders
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def write_changed(path: Path, content: bytes) -> None:
    """Write a file atomically, unless the file has this content already. Raises OSError."""
    with suppress(OSError):
        if read_regular(path, len(content)) == content:
            return
    with written_whole(path) as fresh:
        fresh.write_bytes(content)


def largest_file() -> float:
    """Return the operating system's limit on the size of one file [bytes] (ulimit -f); infinity without a limit."""
    if os.name == "nt":
        return float("inf")
    import resource

    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return float("inf") if limit == resource.RLIM_INFINITY else limit
