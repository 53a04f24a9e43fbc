"""Protection of folders that commands write into: a lock file, a mark of the folder's kind, refusal of links.

A refused folder stays as it is: not even the lock file is created.
"""

import json
import os
import stat
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from taichi_plume.files import disk
from taichi_plume.guard.safe_open import read_regular
from taichi_plume.version import __version__

LOCK = ".lock"
LARGEST_MARK = 1 << 26  # bytes


class FolderLock:
    """Lock file of a folder, which keeps other processes out until `release`, or until this process ends.

    require: raises if the folder must not be used; called before the lock file is created, and again under the lock.
    name: of the lock file, for a lock on files of the folder instead of the folder.
    Raises filelock.Timeout if another process holds the lock, and OSError, ValueError or NotImplementedError if a lock
    is impossible.
    """

    def __init__(self, folder: Path, require: Callable[[], object] = lambda: None, name: str = LOCK):
        import filelock  # 0.04 s, for commands that write

        self.path = folder / name
        with tempfile.TemporaryFile(dir=folder):
            pass  # fail now rather than after minutes of compiling; FileLock would report another holder
        self.made = not os.path.lexists(self.path)
        if self.made:
            require()
        elif not _is_lock(self.path):
            raise OSError(f"{name} is no lock file, but another file or a link")
        self._lock = filelock.FileLock(self.path, timeout=0)
        self._lock.acquire()
        try:
            require()
        except BaseException:
            self.release(remove=self.made)
            raise

    def release(self, remove: bool = False) -> None:
        """Release the folder's lock. remove: remove the lock file too."""
        # Windows cannot unlink an open file; elsewhere a waiting process notices that the file is gone
        with suppress(OSError):
            if remove:
                self.path.unlink()
        self._lock.release()
        with suppress(OSError):
            if remove and os.name == "nt":
                self.path.unlink(missing_ok=True)


def is_locked(folder: Path) -> bool:
    """Return whether a process holds the lock of a folder; no lock file is made."""
    import filelock

    try:
        if not _is_lock(folder / LOCK):
            return False
        with filelock.FileLock(folder / LOCK, timeout=0):
            return False
    except filelock.Timeout:
        return True
    except (OSError, NotImplementedError):  # there is no lock file, or the disk knows no locks
        return False


def _is_lock(path: Path) -> bool:
    """Return whether a file can be the lock file, which is truncated: an empty file without hard links."""
    about = os.lstat(path)
    return stat.S_ISREG(about.st_mode) and not about.st_size and about.st_nlink == 1


def mark(folder: Path, kind: str) -> None:
    """Write KIND.json, such as study.json, which marks a folder of taichi_plume's of that kind. Raises OSError.

    An equal mark stays as it is, since other processes may read it at that moment.
    """
    content = json.dumps({"format": format_of(kind), "version": __version__}) + "\n"
    disk.write_changed(folder / f"{kind}.json", content.encode())


def is_marked(folder: Path, kind: str) -> bool:
    """Return whether a folder holds the file KIND.json that marks its kind, such as study.json."""
    try:
        content = json.loads(read_regular(folder / f"{kind}.json", LARGEST_MARK))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("format") == format_of(kind)


def other_in(folder: Path, kind: str) -> str | None:
    """Return the name of a file in a folder not marked as of this kind; None if marked or empty. Raises OSError."""
    if is_marked(folder, kind):
        return None
    ours = {file.name for file in disk.left_in(folder)}
    files = [file.name for file in folder.iterdir()]
    other = min((name for name in files if name not in ours and not name.startswith(LOCK)), default=None)
    return None if is_marked(folder, kind) else other  # another process may have marked the folder meanwhile


def refusal(folder: Path, kind: str) -> str | None:
    """Return an error line if a folder holds links, or files but no mark of this kind; else None. Raises OSError."""
    other = other_in(folder, kind)
    if other is not None:
        return f"{folder}: is not empty, and holds no {kind} ({other}); choose another --out"
    link = link_in(folder)
    return f"{folder / link}: is a link, which a {kind} does not write to; remove it" if link else None


def format_of(kind: str) -> str:
    """Return the value of the key `format` in the file KIND.json that marks a folder's kind."""
    return f"taichi_plume {kind} 1"


def link_in(folder: Path, names: Iterable[str] | None = None, hard: bool = False) -> str | None:
    """Return the relative path of the first link in a folder tree, as writing would change its target; else None.

    names: entries to look at, by default all. hard: count hard links, and entries that are neither file nor folder.
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
