"""Run folder: names of a run's files, the lock, a new name for an earlier run, and scenario.yaml."""

import datetime
import json
import os
import platform
import shlex
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.metadata import version
from itertools import chain, count
from pathlib import Path
from typing import Any, Self

import yaml

from taichi_plume.engine.choice import DEFAULT, ENGINES, chosen
from taichi_plume.files import disk
from taichi_plume.files.own_folder import LOCK, FolderLock, link_in
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import open_regular, read_regular
from taichi_plume.guard.terminal import say
from taichi_plume.scenario.changes import changed
from taichi_plume.scenario.checks import every
from taichi_plume.scenario.input_files import input_files, outside
from taichi_plume.scenario.own_code import OwnCode
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import Model
from taichi_plume.version import __version__

FILES = (
    "scenario.yaml",
    "recording.rrd",
    "pictures.zarr",
    "robots.parquet",
    "forces.csv",
    "probes.parquet",
    "fields.zarr",
    "plume.pslog",
    "maps.zarr",
    "result.json",
    "report.html",
)
LISTED = tuple(name for name in FILES if name != "report.html")  # in the manifest; a report may be rewritten
BESIDE = (
    "robots.arrows",
    "probes.arrows",
    "maps.part",
    "recording.old.rrd",
    "recording.part.rrd",
    "checkpoint.npz",
    "manifest.json",
)
"""Other files of a run: unfinished parts, and the state for a resumption."""
CHECK = "check.png"  # the scene, drawn by --check; a run may start beside it
LARGEST_JSON = 1 << 28  # bytes
LONGEST_HEADER = 1 << 16  # bytes
OPTIONS = ("--allow-code", "--allow-outside", *(f"--engine={name}" for name in ENGINES))
HEADER = "# Every default written out."
OURS = {"name", "status", "seed"}  # keys of every result.json
KILLED = "killed"  # status of a killed run after its repair


class RunFolderError(InputError):
    """Error: the folder of a run cannot be used or read.

    >>> import taichi_plume as tp
    >>> tp.open_run("nowhere")
    Traceback (most recent call last):
    taichi_plume.files.run_folder.RunFolderError: nowhere: does not exist; give the folder of a run
    """


class RunFolder:
    """The folder of a run, which only this process writes to until `close`; also a context manager.

    `path` is `out`, or the first free ``runs/<name>-<n>``. Raises RunFolderError if another process writes there, or if
    the folder holds files, except those of an earlier run with `force`. `start` renames the folder of that run; the
    `inputs` of the new run must not lie in it. ours: function that tests whether a folder holds an earlier run.
    """

    def __init__(
        self,
        name: str,
        out: Path | None = None,
        force: bool = False,
        runs: Path = Path("runs"),
        inputs: Sequence[Path] = (),
        ours: Callable[[Path], bool] | None = None,
    ):
        if out is not None and os.fsencode(out) != str(out).encode(errors="replace"):
            raise RunFolderError(f"{out}: is no text in UTF-8; choose another --out")
        try:
            self.made = out is None or not out.exists()
            if out is None:
                out = _next_folder(name, runs)
            elif out.exists() and not out.is_dir():
                raise RunFolderError(f"{out}: is a file; --out takes a folder")
            else:
                out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            at = error.filename or out or runs
            raise RunFolderError(f"{at}: cannot be made: {error.strerror or error}") from None
        self.path = out
        self._lock = self._locked(lambda: self._require(force, inputs, ours or is_run))

    @classmethod
    def again(cls, folder: Path) -> Self:
        """Open the folder of an earlier run, to resume it. Raises RunFolderError if it holds no run or is in use."""
        if not folder.is_dir():
            raise RunFolderError(f"{folder}: is no folder; give the folder of a run")
        if not is_run(folder):
            raise RunFolderError(f"{folder}: is not the folder of a run")
        self = cls.__new__(cls)
        self.made, self.path = False, folder
        self._lock = self._locked(self._require_no_links)
        for left in disk.left_in(folder):
            disk.remove(left)
        return self

    def _locked(self, require: Callable[[], None]) -> FolderLock:
        """Lock the folder until the process ends. require: raises if the folder must not be used, see FolderLock."""
        import filelock

        try:
            return FolderLock(self.path, require)
        except filelock.Timeout:
            raise RunFolderError(f"{self.path}: another run is writing there") from None
        except (OSError, NotImplementedError) as error:
            reason = (isinstance(error, OSError) and error.strerror) or error
            raise RunFolderError(f"{self.path}: cannot be written to: {reason}") from None

    def _require(self, force: bool, inputs: Sequence[Path], ours: Callable[[Path], bool]) -> None:
        """Raise RunFolderError if the folder must not be used for a new run; called before any file is created."""
        if not self._holds_files():
            return
        here = self.path.resolve()
        for file in inputs:
            if here in (file.resolve(), *file.resolve().parents):
                raise RunFolderError(f"{self.path}: holds {file}, which this run reads; choose another --out")
        if not force:
            raise RunFolderError(
                f"{self.path}: is not empty; choose another --out or add --force to rename it"
            )
        if not ours(self.path):
            raise RunFolderError(
                f"{self.path}: contains files that do not come from a run; choose another --out"
            )
        if here in (Path.cwd(), *Path.cwd().parents):
            raise RunFolderError(
                f"{self.path}: holds the working folder, so it cannot be renamed; choose another --out"
            )

    def _require_no_links(self) -> None:
        """Raise RunFolderError if a run's files in the folder are links, because their targets would be written to."""
        link = link_in(self.path, FILES + BESIDE, hard=True)
        if link is not None:
            raise RunFolderError(
                f"{self.path / link}: is a link or hard link, or is no plain file, and a run does not write to such "
                "files; remove it, or copy the folder"
            )

    def _holds_files(self) -> bool:
        return any(file.name not in (LOCK, CHECK) for file in self.path.iterdir())

    def start(self) -> None:
        """Rename the folder if it holds an earlier run, to NAME.old, NAME.old-2, ..., and make and lock a new one.

        Prints the new name. The earlier run stays locked until the new folder is, except on Windows, where no folder
        with an open file can be renamed. Raises RunFolderError.
        """
        if not self._holds_files():
            return
        here = self.path.resolve() if self.path.is_symlink() else self.path
        names = chain([f"{here.name}.old"], (f"{here.name}.old-{n}" for n in count(2)))
        aside = next(path for name in names if not os.path.lexists(path := here.with_name(name)))
        lock = self._lock
        if os.name == "nt":
            lock.release()
        try:
            here.rename(aside)
            say(f"the earlier run is now {aside}", error=True)
            here.mkdir()
        except OSError as error:
            raise RunFolderError(f"{here}: cannot be replaced: {error.strerror or error}") from None
        self._lock, self.made = self._locked(lambda: None), True
        lock.path = aside / LOCK
        lock.release(remove=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Unlock the folder, and remove it if this process created it and left it empty."""
        empty = self.made and not any(file.name != LOCK for file in files_in(self.path))
        self._lock.release(remove=empty)
        with suppress(OSError):  # another run may have started there: rmdir keeps its files
            if empty:
                self.path.rmdir()


def is_run(folder: Path) -> bool:
    """Return whether a folder holds the files of a run, finished or not."""
    if read_json(folder / "result.json").keys() >= OURS:
        return True
    try:
        with open_regular(folder / "scenario.yaml") as file:
            return file.readline(len(HEADER)) == HEADER.encode()
    except OSError:
        return False


def read_json(file: Path) -> dict[str, Any]:
    """Return the object in a JSON file as a dict; {} if the file cannot be read."""
    try:
        content = json.loads(read_regular(file, LARGEST_JSON))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def cut(file: Path, size: int) -> None:
    """Truncate a file to its first `size` bytes. Raises RunFolderError if it has fewer, and OSError."""
    held = file.stat().st_size if file.exists() else 0
    if held < size:
        raise RunFolderError(
            f"{file}: {held:,} of its first {size:,} bytes are left, without which the run cannot go on"
        )
    os.truncate(file, size)


def files_in(folder: Path) -> list[Path]:
    """Return the paths in a folder, not in its subfolders; none if the folder does not exist."""
    return list(folder.iterdir()) if folder.is_dir() else []


def _next_folder(name: str, runs: Path) -> Path:
    for n in count(1):
        with suppress(FileExistsError):
            (runs / f"{name}-{n}").mkdir(parents=True)
            return runs / f"{name}-{n}"
    raise AssertionError


# ---------------------------------------------------------------- the scenario


def to_yaml(scenario: Scenario, source: Path = Path(), target: Path | None = None) -> str:
    """Return a scenario as YAML with all defaults. target: write file paths relative to this folder, not `source`."""
    data = scenario.model_dump(mode="json", exclude_none=True)
    _write_nulls(scenario, data)
    if target is not None:
        moved = {
            where: os.path.relpath(source.resolve() / name, target.resolve())
            for where, name in input_files(scenario)
        }
        data = changed(data, moved)
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)


class _Dumper(yaml.SafeDumper):
    """YAML dumper that writes a list of scalars on one line."""

    def represent_sequence(self, tag, sequence, flow_style=None):
        flat = not any(isinstance(entry, list | dict) for entry in sequence)
        return super().represent_sequence(tag, sequence, flow_style=flat)


def _write_nulls(part: object, data: Any) -> None:
    """Add to `data` an explicit null for each key that is null in the scenario although its default is not."""
    if isinstance(part, tuple):
        for entry, its_data in zip(part, data, strict=True):
            _write_nulls(entry, its_data)
    elif isinstance(part, Model):
        for key, field in type(part).model_fields.items():
            if vars(part)[key] is not None:
                _write_nulls(vars(part)[key], data[key])
            elif field.default is not None:
                data[key] = None


def _again(folder: Path, scenario: Scenario, source: Path) -> str:
    """Return the shell command that repeats the scenario of a run folder."""
    options = []
    if any(isinstance(section, OwnCode) and section.file for _, section in every(scenario)):
        options.append(OPTIONS[0])
    if any(outside(folder, str(source.resolve() / name)) for _, name in input_files(scenario)):
        options.append(OPTIONS[1])
    if (engine := chosen()) != DEFAULT:
        options.append(f"--engine={engine}")
    command = ["python", "-m", "taichi_plume.run", str(folder / "scenario.yaml"), *options]
    return shlex.join(command)


def resuming(folder: Path) -> str:
    """Return the shell command that resumes a run, with the command-line options noted in its scenario.yaml."""
    try:
        with open_regular(folder / "scenario.yaml") as file:
            again = file.readline(LONGEST_HEADER).decode(errors="replace")
    except OSError:
        again = ""
    options = [option for option in OPTIONS if option in again]
    return shlex.join(["python", "-m", "taichi_plume.run", "--resume", str(folder), *options])


def write_scenario(
    folder: Path, scenario: Scenario, source: Path, backend: str, called: Path | None = None
) -> None:
    """Write scenario.yaml with a header. source: folder of the original; called: final name of the run folder."""
    versions = ", ".join(f"{name} {version(name)}" for name in (chosen(), "numpy", "rerun-sdk"))
    seeds = "\n".join(f"# {name}: {seed}" for name, seed in scenario.seeds.items())
    header = (
        f"{HEADER} Again: {_again(called or folder, scenario, source)}\n"
        f"# started: {datetime.datetime.now(datetime.UTC).isoformat(timespec='seconds')}\n"
        f"# backend: {backend}\n"
        f"{seeds}\n"
        f"# taichi_plume {__version__}, {versions}, Python {platform.python_version()}, {platform.system()}\n"
    )
    with disk.written_whole(folder / "scenario.yaml") as fresh:
        fresh.write_text(header + to_yaml(scenario, source, folder), encoding="utf-8")
