"""Files that others name are opened only if they are regular ones: a pipe would wait, a device might never end."""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

NO_NAME = "no file can have this name, for a null byte or half a character in it"


def open_regular(path: Path) -> BinaryIO:
    """A regular file, opened for reading in binary, without ever waiting for one.

    Raises OSError, with a `strerror` for a message: also for a folder, pipe, device or socket, and for names that no
    file can have.
    """
    flags = (
        os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)
    )
    try:
        descriptor = os.open(path, flags)
    except ValueError as error:  # a zero byte, a lone surrogate
        raise OSError(errno.EINVAL, NO_NAME, str(path)) from error
    try:
        mode = os.fstat(descriptor).st_mode
        fault = _fault(mode)
        if fault:
            raise OSError(errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL, fault, str(path))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: Path, most: int) -> bytes | None:
    """The content of a regular file; None where it has more than `most` bytes, which are not read then.

    Raises OSError as `open_regular`.
    """
    with open_regular(path) as file:
        content = file.read(most + 1)
    return content if len(content) <= most else None


def unopenable(path: Path, folder: bool = False) -> str | None:
    """Why `open_regular` would refuse a path, such as "does not exist", for readers that open it themselves; None where
    it would not.

    folder: whether it has to be a folder.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return "does not exist"
    except ValueError:
        return f"cannot be read: {NO_NAME}"
    except OSError as error:
        return f"cannot be read: {error.strerror or error}"
    if folder:
        return None if stat.S_ISDIR(mode) else "is no folder"
    return "is a folder" if stat.S_ISDIR(mode) else _fault(mode)


def irregular(folder: Path) -> str | None:
    """What in a folder, or below it, is neither a file nor a folder, for readers of whole folders; None if all is.

    Links are told too: they may lead anywhere.
    """
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = os.path.join(place, name)
            mode = os.lstat(path).st_mode
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                return f"holds {os.path.relpath(path, folder)}, which is no plain file"
    return None


def _fault(mode: int) -> str | None:
    if stat.S_ISREG(mode):
        return None
    return os.strerror(errno.EISDIR) if stat.S_ISDIR(mode) else "is a pipe, socket or device, not a file"
