"""Drafts: unsaved texts in hidden files beside a scenario, so that a server that is killed loses nothing.

Each draft is locked by the server that writes it. The lock of a killed server is free: the next server of the scenario
takes the draft over, offers its text and alone may remove it.
"""

from contextlib import suppress
from glob import escape
from pathlib import Path
from secrets import token_hex

from taichi_plume.files.disk import left_in, written_whole
from taichi_plume.files.own_folder import FolderLock
from taichi_plume.guard.safe_open import content_of
from taichi_plume.guard.yaml_text import LineError, decode

LARGEST = 1 << 26  # bytes: more than a page can send
KEY = "[0-9a-f]" * 8


class Draft:
    """A text in the file ``.NAME.KEY.draft`` beside the scenario NAME, locked by this process.

    Raises filelock.Timeout if another process holds the lock, and OSError, ValueError or NotImplementedError if a lock
    is impossible.
    """

    def __init__(self, file: Path, key: str):
        self.path = file.with_name(f".{file.name}.{key}.draft")
        self.text: str | None = None
        self.written = 0.0  # s, as of the file system
        self._lock = FolderLock(file.parent, name=f".{file.name}.{key}.lock")

    def read(self) -> None:
        """Read the text that the file has. Raises LineError, and OSError."""
        if self.path.is_symlink():
            raise LineError("is a link")
        self.written = self.path.stat().st_mtime
        self.text = decode(content_of(self.path, LARGEST, LineError, ""))

    def write(self, text: str) -> None:
        """Write the text to the file. Raises OSError, and ValueError for half a character."""
        if text == self.text:
            return
        with written_whole(self.path, durable=False) as fresh:  # an edit does not wait for the disk
            fresh.write_bytes(text.encode("utf-8"))
        self.text = text

    def release(self) -> None:
        """Release the lock; the file stays, for the next server."""
        self._lock.release()

    def remove(self) -> None:
        """Remove the file, its unfinished successors and its lock."""
        with suppress(OSError):
            self.path.unlink(missing_ok=True)
            for part in left_in(self.path.parent):
                if part.name.startswith(f".{self.path.name}."):
                    part.unlink(missing_ok=True)
        self._lock.release(remove=True)


class Drafts:
    """Drafts of a server. file: scenario whose drafts, if killed servers left some, become `waiting`, the newest last.

    own: draft of the present text; None while all changes are saved. fault: why it could not be written, in a line;
    "" without a fault. unreadable: the same about drafts that were left.
    """

    def __init__(self, file: Path):
        self.own: Draft | None = None
        self.fault = self.unreadable = ""
        self.waiting: list[Draft] = []
        self._earlier: list[Draft] = []  # of texts that a taken draft has replaced
        self._take_over(file)

    @property
    def files(self) -> list[Path]:
        """Files of all drafts of this server."""
        held = [*self.waiting, *self._earlier, *([self.own] if self.own else [])]
        return [draft.path for draft in held if draft.text is not None]

    def _take_over(self, file: Path) -> None:
        from filelock import Timeout

        ends = [f".{escape(file.name)}.{KEY}.{end}" for end in ("draft", "lock")]
        for key in {path.name.split(".")[-2] for end in ends for path in file.parent.glob(end)}:
            try:
                draft = Draft(file, key)
            except Timeout:  # the draft of a server that is alive
                continue
            except (OSError, ValueError, NotImplementedError) as error:
                self.unreadable = f"the draft .{file.name}.{key}.draft cannot be locked: {error}"
                continue
            try:
                if draft.path.exists() or draft.path.is_symlink():
                    draft.read()
            except (LineError, OSError) as error:
                self.unreadable = (
                    f"unsaved changes were left in {draft.path.name}, which cannot be read: {error}"
                )
                draft.release()
                continue
            if draft.text is None:  # a server was killed before its first draft was written
                draft.remove()
            else:
                self.waiting.append(draft)
        self.waiting.sort(key=lambda draft: draft.written)

    def keep(self, file: Path, text: str) -> None:
        """Write an unsaved text of a file to the server's draft; set `fault` if this is impossible."""
        try:
            if self.own is None:
                self.own = Draft(file, token_hex(4))
            self.own.write(text)
            self.fault = ""
        except (OSError, ValueError, NotImplementedError) as error:
            reason = (isinstance(error, OSError) and error.strerror) or error
            self.fault = f"unsaved changes cannot be kept in a draft: {reason}"

    def take(self, draft: Draft) -> None:
        """Make a waiting draft that of the present text; the draft of the text before stays until `drop`."""
        self.waiting.remove(draft)
        if self.own is not None:
            self._earlier.append(self.own)
        self.own = draft

    def refuse(self, draft: Draft) -> None:
        """Remove a waiting draft."""
        self.waiting.remove(draft)
        draft.remove()

    def leave(self) -> None:
        """Leave all drafts where they are, for whoever opens the file next."""
        for draft in (*self.waiting, *self._earlier, *([self.own] if self.own else [])):
            draft.release()

    def drop(self) -> None:
        """Remove the drafts of this server's texts: all changes are saved. Waiting drafts stay."""
        for draft in (*self._earlier, *([self.own] if self.own else [])):
            draft.remove()
        self.own, self.fault = None, ""
        self._earlier.clear()
