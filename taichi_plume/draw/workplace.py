"""State of a session that all open pages share: the text, its history, the file, and the runs. No Bokeh."""

import os
import shutil
from collections.abc import Collection
from dataclasses import replace
from itertools import count
from math import inf
from pathlib import Path
from time import perf_counter
from typing import Protocol

from taichi_plume.draw.checks import Findings, check
from taichi_plume.draw.document import data_of
from taichi_plume.draw.drafts import Draft, Drafts
from taichi_plume.draw.edits import BLANK
from taichi_plume.draw.history import History
from taichi_plume.draw.objects import Scene, scene, stamps
from taichi_plume.draw.repeats import Repeats, repeats_in
from taichi_plume.draw.runs import LISTED, Run, runs_in
from taichi_plume.files import bundled
from taichi_plume.files.disk import written_whole
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import inside
from taichi_plume.guard.terminal import visible
from taichi_plume.guard.yaml_text import LARGEST_FILE, LineError, read_text

ENDINGS = (".yaml", ".yml")
DRAWN = ("scenario", "live", "task")
"""Kinds of examples that can be drawn."""
BROUGHT = (*ENDINGS, ".stl", ".obj", ".ply", ".png", ".pgm")
"""Endings of the files that a user may bring: scenarios, meshes, maps with their pictures."""
QUICK = 0.04  # s: if the last check took less, a text is checked before it is shown
MOST_BROUGHT = 40 << 20  # bytes


class FileChangedError(InputError):
    """Error: another program has changed the file since it was read; nothing has been written.

    found: present text of the file, None if there is none.
    """

    def __init__(self, line: str, found: str | None):
        super().__init__(line)
        self.found = found


class Follower(Protocol):
    """Protocol of an open page."""

    def follow(self, runs_alone: bool = False) -> None:
        """Show a change of text or findings; runs_alone: only the runs have changed."""
        ...


class Workplace:
    """A text that is drawn, checked, saved and run.

    root: folder in which files are read and written; file: YAML file of the text, which need not exist yet;
    allow_outside, allow_code: permissions of the command line, for runs too. Unsaved changes are written at once to a
    draft beside the file (see `drafts`): a server that is killed loses nothing. Raises InputError.
    """

    def __init__(
        self, root: Path, file: Path | None = None, allow_outside: bool = False, allow_code: bool = False
    ):
        self.root, self.allow_outside, self.allow_code = root.resolve(), allow_outside, allow_code
        self._scene: tuple[object, Scene] | None = None
        file = self._permitted(file if file is not None else self._free_name(self.root))
        self._begin(file, self._read(file))
        self.runs = self._earlier_runs()
        self._elsewhere: list[Run] = []
        self.pages: list[Follower] = []
        self.findings: Findings | None = None
        self.checked: str | None = None
        self._took = inf  # s, of the last check

    def _begin(self, file: Path, content: str | None) -> None:
        """Take a file with its content, None if there is no such file, and the drafts that were left of it."""
        self.file, self.on_disk, self._scene = file, content, None
        self.history = History(BLANK if content is None else content)
        self.drafts = Drafts(file)
        for draft in [draft for draft in self.drafts.waiting if draft.text == self.text]:
            self.drafts.refuse(draft)  # saved just before a server was killed

    @property
    def text(self) -> str:
        """The present text."""
        return self.history.text

    @property
    def scene(self) -> Scene:
        """Objects of the present text, read once for all pages, and again if a file that an obstacle names changes.

        While the text is no YAML, as when it is half typed, they are those of the last text that was.
        """
        key = self.text, stamps(self.text, self.folder)
        if self._scene is None or self._scene[0] != key:
            last = self._scene[1] if self._scene is not None else None
            try:
                data_of(self.text)
                present = scene(self.text, self.folder, self.allow_outside, last)
            except LineError:
                present = replace(last or Scene(self.text, {}, None, ()), text=self.text)
            self._scene = key, present
        return self._scene[1]

    @property
    def folder(self) -> Path:
        """Folder of the text's file, and of the files that the text names."""
        return self.file.parent

    @property
    def saved(self) -> bool:
        """Whether the file has the present text, as far as is known."""
        return self.text == self.on_disk

    def put(self, text: str) -> None:
        """Make a text the present one; all pages and the draft follow. Raises InputError if no file can hold it."""
        try:
            text.encode("utf-8")
        except UnicodeEncodeError as error:
            line, half = text.count("\n", 0, error.start) + 1, ord(text[error.start])
            raise InputError(
                f"line {line} of the text: holds half a character (U+{half:04X}), which no file can have; nothing was "
                "changed"
            ) from None
        if text != self.text:
            self.history.put(text)
            self._changed()

    def undo(self) -> None:
        """Return to the previous text."""
        self.history.undo()
        self._changed()

    def redo(self) -> None:
        """Return to the text that was undone last."""
        self.history.redo()
        self._changed()

    def save(self, agreed: FileChangedError | None = None) -> None:
        """Write the text to the file. agreed: the error after which the user has agreed to overwrite what it found.

        Raises FileChangedError if another program has changed the file since, and InputError.
        """
        present = self._read()
        expected = {self.on_disk, self.text} if agreed is None else {self.on_disk, self.text, agreed.found}
        if present not in expected:
            raise FileChangedError(
                f"{self.file.name}: another program has changed this file since it was read; nothing was written",
                present,
            )
        self._write(self.file)

    def _write(self, file: Path, replace: bool = True) -> None:
        """Write the text to a file, which becomes that of the text. Raises InputError."""
        content = self.text.encode("utf-8")
        if len(content) > LARGEST_FILE:  # it could not be opened again
            raise InputError(
                f"{file.name}: cannot be written: the text has {len(content) / (1 << 20):.1f} MiB; at most "
                f"{LARGEST_FILE >> 20} MiB"
            )
        try:
            with written_whole(file, replace=replace) as fresh:
                fresh.write_bytes(content)
        except FileExistsError:
            raise InputError(f"{file.name}: exists already; choose another name") from None
        except OSError as error:
            raise InputError(f"{file.name}: cannot be written: {error.strerror or error}") from None
        self.file, self.on_disk = file, self.text
        self._changed()

    def save_as(self, name: str) -> None:
        """Give the text another file in the folder, and write it. Raises InputError; the text keeps its file then."""
        self._write(self._permitted(self.folder / name), replace=False)

    def open(self, name: str = "") -> None:
        """Take another file of the folder, by default a new one with an empty room.

        Unsaved changes of the present text stay in its draft, which is offered once its file is opened again. Undo does
        not lead back. Raises InputError, as if the draft cannot be written; the text stays then.
        """
        file = self._permitted(self.folder / name) if name else self._free_name(self.folder)
        content = self._read(file)
        if name and content is None:
            raise InputError(f"{name}: there is no such file")
        if self.drafts.fault:
            raise InputError(f"{self.drafts.fault}; save the text first")
        self.drafts.leave()
        self._begin(file, content)
        self._changed()

    def example(self, name: str) -> None:
        """Take a copy of an example in the folder, or the copy that is there already. Raises InputError."""
        found = bundled.example(name)
        if found.kind not in DRAWN:
            raise InputError(f"{name}: is a {found.kind}, no scenario that can be drawn")
        if not (self.folder / found.path.name).exists():
            try:
                bundled.copied(found, self.folder)
            except OSError as error:
                raise InputError(f"{name}: cannot be copied: {error.strerror or error}") from None
        self.open(found.path.name)

    def take(self, name: str, content: bytes) -> Path:
        """Write a file that a user brings into the folder. Raises InputError if a file of this name exists.

        name: of a scenario, a mesh, a map or its picture; folders in it count for nothing.
        """
        file = self.folder / Path(name.replace("\\", "/")).name
        if file.suffix.lower() in ENDINGS:
            file = file.with_suffix(file.suffix.lower())
        if file.suffix.lower() not in BROUGHT or file.name.startswith("."):
            raise InputError(f"{visible(file.name)}: must end in {', '.join(BROUGHT)}")
        if len(content) > MOST_BROUGHT:
            raise InputError(f"{file.name}: has {len(content) >> 20} MiB; at most {MOST_BROUGHT >> 20} MiB")
        try:
            with written_whole(file, replace=False) as fresh:
                fresh.write_bytes(content)
        except FileExistsError:
            raise InputError(f"{file.name}: exists already; choose another name") from None
        except (OSError, ValueError) as error:
            raise InputError(
                f"{file.name}: cannot be written: {getattr(error, 'strerror', '') or error}"
            ) from None
        return file

    @property
    def files(self) -> list[str]:
        """Names of the scenarios in the folder."""
        return sorted(
            file.name
            for file in self.folder.iterdir()
            if file.suffix in ENDINGS
            and not file.name.startswith(".")
            and file.is_file()
            and not is_map(file)
        )

    def reload(self) -> None:
        """Take the text of the file; the present one can be returned to by undo."""
        self.on_disk = self._read()
        if self.on_disk is not None:
            self.history.put(self.on_disk)
        self._changed()

    @property
    def recovered(self) -> Draft | None:
        """Newest draft that a killed server left and that nobody has been asked about; None without such a draft."""
        return self.drafts.waiting[-1] if self.drafts.waiting else None

    def restore(self, draft: Draft | None, take: bool) -> None:
        """Take the text of a draft that a killed server left, or remove that draft; once."""
        if draft is None or draft not in self.drafts.waiting:  # answered on another page
            return
        if not take:
            self.drafts.refuse(draft)
        elif draft.text is not None:
            self.drafts.take(draft)
            self.history.put(draft.text)
        self._changed()

    def _earlier_runs(self) -> list[Run]:
        """Return runs and repeats in the folder, the oldest first: the last, at most LISTED, and all pinned ones."""
        found = [(time, folder, Run) for time, folder in runs_in(self.root / "runs")]
        found += [(time, folder, Repeats) for time, folder in repeats_in(self.root / "studies")]
        runs: list[Run] = []
        for n, (_, folder, kind) in enumerate(sorted(found, key=lambda each: each[:2])):
            run = kind(len(runs) + 1, folder, before=runs[-1] if runs else None)
            if n >= len(found) - LISTED or run.pinned:
                runs.append(run)
        return runs

    def run(self, text: str, agreed: Collection[str] = (), kind: type[Run] = Run) -> Run:
        """Start a run of a text. agreed: SHA-256 of the Python files that the user has allowed. Raises InputError.

        kind: Run, or Repeats for runs with several seeds.
        """
        name = data_of(text).get("name", "run")
        above = self.root / ("studies" if kind is Repeats else "runs")
        name = name if isinstance(name, str) and name.replace("_", "").replace("-", "").isalnum() else "run"
        if not self.allow_outside and not inside(above, self.root):
            raise InputError(
                f"{above}: is a link to {above.resolve()}, outside the folder in which the command was started; remove "
                "the link, or add --allow-outside"
            )
        taken = {run.folder for run in self.runs}  # also of runs that have not made their folder yet
        folders = (above / f"{name}-{n}" for n in count(1))
        free = next(folder for folder in folders if folder not in taken and not os.path.lexists(folder))
        drawn = self.scene if text == self.text else scene(text, self.folder, self.allow_outside)
        run = kind(len(self.runs) + 1, free, text, self.runs[-1] if self.runs else None, drawn)
        flags = ["--allow-outside"] * self.allow_outside + ["--allow-code"] * self.allow_code
        run.start(self.folder, self.root, flags + [w for sha in agreed for w in ("--allow-sha256", sha)])
        self.runs.append(run)
        self._notify()
        return run

    def run_of(self, number: int) -> Run | None:
        """Return the run with a number; None if there is none, or if it has been removed."""
        run = self.runs[number - 1] if 1 <= number <= len(self.runs) else None
        return None if run is None or run.discarded else run

    def mark(self, run: Run, name: str, pinned: bool) -> None:
        """Give a run a name and pin it, or not; all pages follow. Raises InputError if that is not kept."""
        try:
            run.mark(name, pinned)
        finally:
            self._notify(runs_alone=True)

    def discard(self, run: Run) -> None:
        """Remove the folder of a run that has ended, and the run from the lists. Raises InputError."""
        if run.alive or run.elsewhere or run.folder.is_symlink() or not inside(run.folder, self.root):
            raise InputError(
                f"{run.folder.name}: is not removed: the run goes on, or its folder lies elsewhere"
            )
        try:
            shutil.rmtree(run.folder)
        except OSError as error:
            raise InputError(f"{error.filename}: cannot be removed: {error.strerror}") from None
        run.discarded = True
        self._notify()

    def check(self, text: str | None = None) -> tuple[str, Findings]:
        """Check a text, by default the present one; return the text and its findings. May run in another thread."""
        text, start = self.text if text is None else text, perf_counter()
        findings = check(text, self.folder, self.allow_outside)
        self._took = perf_counter() - start
        return text, findings

    def found(self, text: str, findings: Findings) -> None:
        """Take the findings of a text, unless the text has changed since."""
        if text == self.text:
            self.checked, self.findings = text, findings
            self._notify()

    def keep_draft(self) -> None:
        """Write the draft of the text, or remove the draft if nothing has changed; `drafts.fault` reports failures."""
        if self.text == (BLANK if self.on_disk is None else self.on_disk):
            self.drafts.drop()
        else:
            self.drafts.keep(self.file, self.text)

    def retry_draft(self) -> None:
        """Write the draft again if this has failed, and tell the pages once it has succeeded."""
        if self.drafts.fault:
            self.keep_draft()
            if not self.drafts.fault:
                self._notify()

    # ---------------------------------------------------------------- files

    def _permitted(self, file: Path) -> Path:
        file = Path(os.path.abspath(file))
        if file.name != file.name.encode("utf-8", "replace").decode("utf-8"):
            raise InputError(f"{visible(file.name)}: is no text in UTF-8; choose another name")
        if file.suffix not in ENDINGS:
            raise InputError(f"{file.name}: must end in {' or '.join(ENDINGS)}")
        if not self.allow_outside and not inside(file, self.root):
            raise InputError(
                f"{file}: lies outside the folder in which the command was started; start it there, or add "
                "--allow-outside"
            )
        if not os.path.isdir(file.parent):
            raise InputError(f"{file.parent}: there is no such folder")
        return file

    def _free_name(self, folder: Path) -> Path:
        names = ("room.yaml", *(f"room-{n}.yaml" for n in range(2, 10_000)))
        return next(folder / name for name in names if not (folder / name).exists())

    def _read(self, file: Path | None = None) -> str | None:
        """Return the text of a file, by default of the present one; None if there is none. Raises InputError."""
        file = self.file if file is None else file
        if not os.path.exists(file):  # no error for a name that the system refuses
            return None
        try:
            return read_text(file)
        except (LineError, OSError) as fault:
            raise InputError(f"{file.name}: {fault}") from None

    def _changed(self) -> None:
        self.keep_draft()
        if self._took < QUICK and self.checked != self.text:
            self.checked, self.findings = self.check()
        self._notify()

    def watch(self) -> None:
        """Read the states of the runs; pages show what has changed."""
        running = [run for run in self.runs if run.begun_here and run.wall is None]
        for run in running:
            run.poll()
        elsewhere = [run for run in self.runs if run.elsewhere]
        if running or elsewhere or self._elsewhere:
            self._elsewhere = elsewhere
            self._notify(runs_alone=True)

    def _notify(self, runs_alone: bool = False) -> None:
        for page in list(self.pages):
            page.follow(runs_alone)


def is_map(file: Path) -> bool:
    """Return whether a YAML file is a map of ROS's map_server: scenarios lie beside it."""
    try:
        return "image" in data_of(read_text(file))
    except (LineError, OSError):
        return False
