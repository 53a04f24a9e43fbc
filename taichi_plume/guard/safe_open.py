"""Checked opening of foreign files, those of a run folder too: path traversal, links, pipes and devices are refused.

Readers open such files by `open_regular`, `read_regular`, `content_of` and, for tables, `files/parquet.py`, or ask
`unopenable` and `irregular` before a library opens them. All of these accept regular files only: a pipe would wait, a
device might never end. In the block of a `gate` they also accept only files in its folder, once links are followed, and
list the files for the manifest. A reader that keeps content in a cache calls `admit` before the cache answers.
`tests/test_file_opening.py` finds code that opens a file for reading in another way.
"""

import codecs
import errno
import os
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from io import BufferedReader
from pathlib import Path, PureWindowsPath

from taichi_plume.guard.input_error import InputError

FLAGS = os.O_RDONLY | sum(vars(os).get(name, 0) for name in ("O_NONBLOCK", "O_NOCTTY", "O_BINARY"))
LONGEST_END = 12  # folders and file name of a path of another computer that are looked up
NO_NAME = "no file can have this name, for a null byte or half a character in it"
ALLOW = "if it is what you want to be read, add --allow-outside (in Python: allow_outside=True)"
OUTSIDE = f"lies outside the scenario's folder; {ALLOW}"

_gate: ContextVar[tuple[Path | None, list[Path]] | None] = ContextVar("gate", default=None)


@contextmanager
def gate(folder: Path | None) -> Iterator[list[Path]]:
    """Context in which files can be opened only inside a folder (None: anywhere); yields the list of opened paths."""
    files: list[Path] = []
    token = _gate.set((folder, files))
    try:
        yield files
    finally:
        _gate.reset(token)


def admit(path: Path) -> None:
    """Record a path as an input file of the run. Raises PermissionError outside the folder that `gate` permits."""
    require_inside(path)
    current = _gate.get()
    if current is not None and path not in current[1]:
        current[1].append(path)


def inside(path: str | Path, folder: Path) -> bool:
    """Return whether a path, with links followed, lies in a folder; True for an impossible file name."""
    try:
        return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))
    except ValueError:  # a zero byte or a lone surrogate, which `open` refuses
        return True


def moved(name: str, folders: Sequence[Path]) -> Path | None:
    """Return the file that a path of another computer means: that of the longest end of the path in one of `folders`.

    None if there is none. The bare name of the file is looked up in the first folder only. name: path with slashes or
    backslashes.
    """
    parts = PureWindowsPath(name).parts
    begin = max((n + 1 for n, part in enumerate(parts) if part == ".."), default=0)
    for n in range(max(begin, len(parts) - LONGEST_END), len(parts)):
        for folder in folders if n + 1 < len(parts) else folders[:1]:
            if os.path.isfile(file := folder.joinpath(*parts[n:])):
                return file
    return None


def require_inside(path: Path) -> None:
    """Raise PermissionError if a path lies outside the only folder that the surrounding `gate` permits."""
    current = _gate.get()
    if current is not None and current[0] is not None and not inside(path, current[0]):
        raise PermissionError(errno.EPERM, OUTSIDE, str(path))


def as_path(value: object, where: str, fault: type[InputError] = InputError) -> Path:
    """Return a path that is given as a text or a Path. Raises `fault` if it is neither, or no file can have the name.

    where: name of the argument, for the message.
    """
    if not isinstance(value, str | Path):
        raise fault(f"{where}: got {type(value).__name__}; give a path, as a text or a pathlib.Path")
    try:
        os.stat(value)
    except ValueError:
        raise fault(f"{where}: got {str(value)!r}: {NO_NAME}") from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise fault(f"{where}: got {str(value)!r}: {error.strerror}") from None
    return Path(value)


def open_regular(path: Path) -> BufferedReader:
    """Open a regular file for reading in binary mode, without blocking.

    Raises OSError with a `strerror` for a message, also for a folder, pipe, device or socket, and for impossible names.
    """
    require_inside(path)
    try:
        descriptor = os.open(path, FLAGS)
    except ValueError as error:  # a zero byte, a lone surrogate
        raise OSError(errno.EINVAL, NO_NAME, str(path)) from error
    try:
        mode = os.fstat(descriptor).st_mode
        fault = _fault(mode)
        if fault:
            raise OSError(errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL, fault, str(path))
        admit(path)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: Path, most: int | None = None) -> bytes:
    """Return the bytes of a regular file. Raises OSError if irregular or, if given, larger than `most` bytes."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if most is not None and size > most:
            allowed = f"{most >> 20} MiB" if most >> 20 else f"{most >> 10} KiB"
            raise OSError(errno.EFBIG, f"is larger than {allowed}", str(path))
        return file.read(size)  # read(most) would allocate as much


def content_of(path: Path, most: int, fault: Callable[[str], Exception], name: str | None = None) -> bytes:
    """Return the bytes of a regular file of at most `most` bytes. Raises `fault(message)` if it cannot be read.

    name: beginning of the message, by default the path; "" for none. With a name, the folder of a missing file follows.
    """
    try:
        return read_regular(path, most)
    except FileNotFoundError as error:
        reason = f"no such file in {path.parent}" if name else f"cannot be read: {error.strerror}"
    except OSError as error:
        reason = f"{'' if error.errno == errno.EFBIG else 'cannot be read: '}{error.strerror or error}"
    start = path if name is None else name
    raise fault(f"{start}: {reason}" if start else reason)


def encoding_of(content: bytes) -> str:
    """Return the name of the encoding of a text by its byte order mark: UTF-8, which is also the default, or UTF-16."""
    return "utf-16" if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"


def unopenable(path: Path, folder: bool = False) -> str | None:
    """Return why a path is no readable file (or folder, if `folder`), such as "does not exist"; None if it is.

    For readers that open the path themselves.
    """
    try:
        require_inside(path)
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return "does not exist"
    except ValueError:
        return f"cannot be read: {NO_NAME}"
    except OSError as error:
        return f"cannot be read: {error.strerror or error}"
    if folder:
        fault = None if stat.S_ISDIR(mode) else "is no folder"
    else:
        fault = "is a folder" if stat.S_ISDIR(mode) else _fault(mode)
    if fault is None:
        admit(path)
    return fault


def irregular(folder: Path) -> str | None:
    """Return an error if a folder tree holds links, devices or anything but files and folders; else None."""
    try:
        admit(folder)
    except PermissionError as error:
        return error.strerror
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
