"""The run directory: which files it holds, who writes to it, and the resolved scenario, to be run again as it is."""

import datetime
import json
import os
import platform
import shlex
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import yaml

from taichi_plume import __version__
from taichi_plume.files import disk
from taichi_plume.files.own_folder import LOCK, FolderLock, link_in
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.opening import open_regular, read_regular
from taichi_plume.scenario.algorithms import Own
from taichi_plume.scenario.changes import changed
from taichi_plume.scenario.input_files import input_files, outside
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import Model

FILES = (
    "scenario.yaml",
    "recording.rrd",
    "robots.parquet",
    "forces.csv",
    "probes.parquet",
    "fields.zarr",
    "plume.pslog",
    "maps.zarr",
    "result.json",
    "report.html",
)
LISTED = tuple(name for name in FILES if name != "report.html")  # in the manifest: a report may be made again
BESIDE = (
    "robots.parts",
    "probes.parts",
    "maps.part",
    "recording.old.rrd",
    "recording.part.rrd",
    "checkpoint.npz",
    "manifest.json",
)
"""What a run writes besides: parts of files that are not finished, and what it can be resumed from."""
STANDS = "result.json"  # the last file that a run begins
CHECK = "check.png"  # the scene, drawn by --check; a run may begin beside it
LARGEST_JSON = 1 << 28  # bytes
LONGEST_HEADER = 1 << 16  # bytes
REPLACING = ".replacing"  # an earlier run while it is set aside or put back: nothing of a new one is there
REPLACED = ".replaced"  # all of it, while the files of a new one are begun
OPTIONS = ("--allow-code", "--allow-outside")
HEADER = "# Every default written out."
OURS = {"name", "status", "seed"}  # keys of every result.json
KILLED = "killed"  # status of a run that did not end by itself, once it is repaired


class RunFolderError(InputError):
    """A run directory that cannot be used."""


class RunFolder:
    """A run directory that this process alone writes to until it is closed; as a context it closes itself.

    `path` is `out`, or the first free ``runs/<name>-<n>``. Raises RunFolderError where another process writes there,
    and where it holds files: unless by `force` these are of an earlier run. Those are replaced when `clear` is called,
    not before; `inputs`, the files that the new run reads, must not be among them. Other files stay as they are. A
    replacement in which a process was killed is settled first, so that one of the two runs is there, and whole.

    files: names of what may be replaced; ours: tells whether a folder holds such files of ours.
    """

    def __init__(
        self,
        name: str,
        out: Path | None = None,
        force: bool = False,
        runs: Path = Path("runs"),
        inputs: Sequence[Path] = (),
        files: Sequence[str] = FILES + BESIDE,
        ours: Callable[[Path], bool] | None = None,
    ):
        self.files, self._ours = files, ours or is_run
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
        self._hold(lambda: self._require(force, inputs))
        try:
            self._recover()
            self._check(force, inputs)
        except OSError as error:
            self.close()
            raise RunFolderError(f"{out}: cannot be used: {error.strerror or error}") from None
        except BaseException:
            self.close()
            raise

    @classmethod
    def again(cls, folder: Path) -> Self:
        """The directory of an earlier run, to go on in it. Raises RunFolderError where it is none."""
        if not folder.is_dir():
            raise RunFolderError(f"{folder}: is no folder; give the folder of a run")
        if not any(map(is_run, (folder, folder / REPLACING, folder / REPLACED))):
            raise RunFolderError(f"{folder}: is not the folder of a run")
        self = cls.__new__(cls)
        self.made, self.path, self.files = False, folder, FILES + BESIDE
        self._hold(self._require_no_links)
        self._recover()
        for left in disk.left_in(folder):
            left.unlink()
        return self

    def _hold(self, require: Callable[[], None]) -> None:
        """Take the lock, which goes with the process, however it ends. require: as FolderLock takes it."""
        import filelock

        try:
            self._lock = FolderLock(self.path, require)
        except filelock.Timeout:
            raise RunFolderError(f"{self.path}: another run is writing there") from None
        except RunFolderError:
            raise
        except (OSError, NotImplementedError) as error:
            reason = getattr(error, "strerror", None) or error
            raise RunFolderError(f"{self.path}: cannot be written to: {reason}") from None

    def _require(self, force: bool, inputs: Sequence[Path]) -> None:
        """Refuse a folder before anything is made in it."""
        self._require_no_links()
        if not any((self.path / name).is_dir() for name in (REPLACING, REPLACED)):  # else it is settled first
            self._check(force, inputs)

    def _require_no_links(self) -> None:
        """Refuse a folder in which files of a run are links, or have other names: their targets would be written to."""
        link = link_in(self.path, {*self.files, REPLACING, REPLACED}, hard=True)
        if link is not None:
            raise RunFolderError(
                f"{self.path / link}: is a link, has another name (a hard link), or is no plain file; a run writes "
                "to files of its own: remove it, or copy the folder"
            )

    def _check(self, force: bool, inputs: Sequence[Path]) -> None:
        if not any(file.name not in (LOCK, CHECK) for file in self.path.iterdir()):
            return
        held = held_input(self.path, inputs)
        if held is not None:
            raise RunFolderError(f"{self.path}: holds {held}, which this run reads; choose another --out")
        if not force:
            raise RunFolderError(
                f"{self.path}: is not empty; choose another --out or add --force to overwrite"
            )
        if not self._ours(self.path):
            raise RunFolderError(
                f"{self.path}: holds files that no run of ours has left; choose another --out"
            )

    def clear(self) -> None:
        """Set aside what an earlier run left, until `settle`."""
        aside = self.path / REPLACING
        aside.mkdir()
        for name in self.files:
            if os.path.lexists(self.path / name):
                (self.path / name).rename(aside / name)
        aside.rename(self.path / REPLACED)
        for left in disk.left_in(self.path):
            left.unlink()

    def settle(self, stands: bool) -> None:
        """Remove what was set aside, as the new run `stands`; else put it back in the place of the new one's files."""
        aside = self.path / REPLACED
        if not stands and aside.is_dir():
            for name in self.files:
                remove(self.path / name)
            aside.rename(self.path / REPLACING)
        self._put_back()
        shutil.rmtree(aside, ignore_errors=True)

    def _recover(self) -> None:
        """Settle a replacement in which a process was killed."""
        if (self.path / REPLACING).is_dir():
            self._put_back()
        elif (self.path / REPLACED).is_dir():
            self.settle((self.path / STANDS).exists())

    def _put_back(self) -> None:
        aside = self.path / REPLACING
        for file in files_in(aside):
            file.rename(self.path / file.name)
        shutil.rmtree(aside, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let others write there; a folder that was made and left empty goes."""
        empty = self.made and not any(file.name != LOCK for file in files_in(self.path))
        self._lock.release(remove=empty)
        with suppress(OSError):  # another run may be there by now: not a file of it goes
            if empty:
                self.path.rmdir()


def is_run(folder: Path) -> bool:
    """Whether a folder holds what a run, finished or not, has left."""
    if told(folder / "result.json").keys() >= OURS:
        return True
    try:
        with open_regular(folder / "scenario.yaml") as file:
            return file.readline(len(HEADER)) == HEADER.encode()
    except OSError:
        return False


def told(file: Path) -> dict[str, Any]:
    """What a JSON file of ours says; nothing where it is none."""
    try:
        content = json.loads(read_regular(file, LARGEST_JSON) or b"")
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def held_input(folder: Path, inputs: Sequence[Path]) -> Path | None:
    """The first of the files that lies in the folder."""
    there = folder.resolve()
    return next((file for file in inputs if there in (file.resolve(), *file.resolve().parents)), None)


def remove(file: Path) -> None:
    """Remove a file or a whole folder, if it is there."""
    if file.is_dir() and not file.is_symlink():
        shutil.rmtree(file)
    else:
        file.unlink(missing_ok=True)


def cut(file: Path, size: int) -> None:
    """Keep the first `size` bytes of a file. Raises RunFolderError where it has fewer, and OSError."""
    held = file.stat().st_size if file.exists() else 0
    if held < size:
        raise RunFolderError(
            f"{file}: {held:,} of its first {size:,} bytes are left, without which the run cannot go on"
        )
    os.truncate(file, size)


def files_in(folder: Path) -> list[Path]:
    """What a folder holds; nothing where it is gone."""
    return list(folder.iterdir()) if folder.is_dir() else []


def _next_folder(name: str, runs: Path) -> Path:
    n = 0
    while True:
        folder = runs / f"{name}-{(n := n + 1)}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        return folder


# ---------------------------------------------------------------- the scenario


def to_yaml(scenario: Scenario, source: Path = Path(), target: Path | None = None) -> str:
    """The scenario with every default written out.

    Paths of files, relative to `source`, are written relative to `target` when one is given.
    """
    data = scenario.model_dump(mode="json", exclude_none=True)
    _say_none(scenario, data)
    if target is not None:
        moved = {
            where: os.path.relpath(source.resolve() / name, target.resolve())
            for where, name in input_files(scenario)
        }
        data = changed(data, moved)
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)


class _Dumper(yaml.SafeDumper):
    """One that writes a list of numbers or names in a line."""

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> Any:
        """As the base class."""
        flat = not any(isinstance(one, list | dict) for one in sequence)
        return super().represent_sequence(tag, sequence, flow_style=flat)


def _say_none(part: Any, data: Any) -> None:
    """Put null where it was said and is not what a key means that is left out."""
    if isinstance(part, tuple):
        for one, its in zip(part, data, strict=True):
            _say_none(one, its)
    elif isinstance(part, Model):
        for key, field in type(part).model_fields.items():
            if vars(part)[key] is not None:
                _say_none(vars(part)[key], data[key])
            elif field.default is not None:
                data[key] = None


def _again(folder: Path, scenario: Scenario, source: Path) -> str:
    """The command that runs the scenario of a run directory again."""
    options = []
    if any(isinstance(group.algorithm, Own) and group.algorithm.file for group in scenario.robots):
        options.append(OPTIONS[0])
    if any(outside(folder, str(source.resolve() / name)) for _, name in input_files(scenario)):
        options.append(OPTIONS[1])
    command = ["python", "-m", "taichi_plume.run", str(folder / "scenario.yaml"), *options]
    return shlex.join(command)


def resuming(folder: Path) -> str:
    """The command that goes on with the run of a directory, with the options that the one to run it again has."""
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
    """Write `scenario.yaml`. source: folder of the original; called: what this one will be."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("taichi", "numpy", "rerun-sdk"))
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
