"""Folders that commands write into, and that may come from elsewhere: the lock, the mark of whose they are, links.

Nothing is made, not even the lock, in a folder that is refused.
"""

import json
import os
import stat
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from taichi_plume import __version__
from taichi_plume.files import disk
from taichi_plume.guard.opening import read_regular

LOCK = ".lock"
LARGEST_MARK = 1 << 26  # bytes


class FolderLock:
    """The lock of a folder, which this process holds until `release`, or until the process ends.

    require: raises if the folder must not be used. It is called before the lock file is made, so that a refused folder
    stays as it is, and again under the lock. Raises also filelock.Timeout if another process holds the lock, and
    OSError, ValueError or NotImplementedError if there can be none.
    """

    def __init__(self, folder: Path, require: Callable[[], object]):
        import filelock  # 0.04 s, for commands that write

        self.path = folder / LOCK
        with tempfile.TemporaryFile(dir=folder):
            pass  # now, rather than after minutes of compiling; the lock would take it for another's
        self.made = not os.path.lexists(self.path)
        if self.made:
            require()
        elif not _is_lock(self.path):
            raise OSError(f"{LOCK} is no lock of a run or study, but a file or link of someone's")
        self._lock = filelock.FileLock(self.path, timeout=0)
        self._lock.acquire()
        try:
            require()
        except BaseException:
            self.release(remove=self.made)
            raise

    def release(self, remove: bool = False) -> None:
        """Let other processes write there. remove: whether the lock file goes as well."""
        # Windows unlinks no open file; elsewhere whoever waits for the lock sees that the file went
        with suppress(OSError):
            if remove:
                self.path.unlink()
        self._lock.release()
        with suppress(OSError):
            if remove and os.name == "nt":
                self.path.unlink(missing_ok=True)


def _is_lock(path: Path) -> bool:
    """Whether a file may be locked, which cuts it to no length: an empty one without another name."""
    about = os.lstat(path)
    return stat.S_ISREG(about.st_mode) and not about.st_size and about.st_nlink == 1


def mark(folder: Path, kind: str) -> None:
    """Write KIND.json, by which a folder of that kind is known, such as study.json. Raises OSError."""
    content = {"format": format_of(kind), "version": __version__}
    with disk.written_whole(folder / f"{kind}.json") as fresh:
        fresh.write_text(json.dumps(content) + "\n", encoding="utf-8")


def is_marked(folder: Path, kind: str) -> bool:
    """Whether a folder holds the mark of that kind."""
    try:
        content = json.loads(read_regular(folder / f"{kind}.json", LARGEST_MARK) or b"")
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("format") == format_of(kind)


def other_in(folder: Path, kind: str) -> str | None:
    """The first file of a folder that has not the mark of that kind; None if it has, or is empty. Raises OSError."""
    if is_marked(folder, kind):
        return None
    ours = {LOCK, *(file.name for file in disk.left_in(folder))}
    return min((file.name for file in folder.iterdir() if file.name not in ours), default=None)


def format_of(kind: str) -> str:
    """Value of `format` in the mark of a kind of folder."""
    return f"taichi_plume {kind} 1"


def link_in(folder: Path, names: Iterable[str] | None = None, hard: bool = False) -> str | None:
    """Path, relative to a folder, of the first link in it or in its folders: to write there would write elsewhere.

    names: of what is looked at in the folder; unless given, all. hard: whether files with another name, and what is
    neither a file nor a folder, count as well.
    """
    try:
        here = [entry for entry in os.scandir(folder) if names is None or entry.name in names]
    except OSError:
        return None
    for entry in here:
        if entry.is_symlink():
            return entry.name
        if entry.is_dir():
            inner = link_in(Path(entry.path), None, hard)
            if inner is not None:
                return f"{entry.name}/{inner}"
        elif hard and not (entry.is_file() and entry.stat(follow_symlinks=False).st_nlink == 1):
            return entry.name
    return None
