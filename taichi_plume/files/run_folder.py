"""The run directory: which files it holds, and the resolved scenario in it, which can be run again as it is."""

import datetime
import os
import platform
import re
import shlex
import shutil
import tempfile
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from taichi_plume import __version__
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.algorithms import Own
from taichi_plume.scenario.input_files import input_files, outside
from taichi_plume.scenario.scenario import Scenario

FILES = (
    "scenario.yaml",
    "recording.rrd",
    "robots.parquet",
    "forces.csv",
    "fields.zarr",
    "plume.pslog",
    "result.json",
)


class RunFolderError(ValueError):
    """A run directory that cannot be used."""


def run_folder(
    name: str,
    out: Path | None = None,
    force: bool = False,
    runs: Path = Path("runs"),
    files: Sequence[str] = FILES,
) -> Path:
    """Make and return `out`, or the first free ``runs/<name>-<n>``; raises RunFolderError.

    One that holds files is refused, unless by `force` those `files` that an earlier run left there are removed.
    """
    if out is not None and os.fsencode(out) != str(out).encode(errors="replace"):
        raise RunFolderError(f"{out}: is no text in UTF-8; choose another --out")
    try:
        if out is None:
            return _next_folder(name, runs)
        if out.is_file():
            raise RunFolderError(f"{out}: is a file; --out takes a folder")
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(
            f"{error.filename or out or runs}: cannot be made: {error.strerror or error}"
        ) from None
    try:
        with tempfile.NamedTemporaryFile(dir=out):
            pass  # now, rather than after minutes of compiling
        if not force and any(out.iterdir()):
            raise RunFolderError(f"{out}: is not empty; choose another --out or add --force to overwrite")
        for file in files:
            if (out / file).is_dir():
                shutil.rmtree(out / file)
            else:
                (out / file).unlink(missing_ok=True)
    except OSError as error:
        raise RunFolderError(f"{out}: cannot be written to: {error.strerror or error}") from None
    return out


def _next_folder(name: str, runs: Path) -> Path:
    n = 1
    while True:
        folder = runs / f"{name}-{n}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            n += 1
            continue
        return folder


# ---------------------------------------------------------------- the scenario


def to_yaml(scenario: Scenario, source: Path = Path(), target: Path | None = None) -> str:
    """The scenario with every default written out.

    Paths of files, relative to `source`, are written relative to `target` when one is given.
    """
    data = scenario.model_dump(mode="json", exclude_none=True)
    if target is not None:
        for where, name in input_files(scenario):
            *above, key = re.findall(r"[^.\[\]]+", where)
            place: Any = data
            for step in above:
                place = place[int(step) if step.isdecimal() else step]
            place[key] = os.path.relpath(source.resolve() / name, target.resolve())
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=100)


def _again(folder: Path, scenario: Scenario, source: Path) -> str:
    """The command that runs the scenario of a run directory again."""
    options = []
    if any(isinstance(group.algorithm, Own) and group.algorithm.file for group in scenario.robots):
        options.append("--allow-code")
    if any(outside(folder, str(source.resolve() / name)) for _, name in input_files(scenario)):
        options.append("--allow-outside")
    return visible(
        shlex.join(["python", "-m", "taichi_plume.run", str(folder / "scenario.yaml"), *options]), None
    )


def write_scenario(folder: Path, scenario: Scenario, source: Path, backend: str) -> None:
    """Write `scenario.yaml`, versions, backend and seed above it; `source` is the folder of the original."""
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    packages = ("taichi", "numpy", "rerun-sdk")
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    header = (
        f"# Every default written out. Again: {_again(folder, scenario, source)}\n"
        f"# started: {now}\n"
        f"# backend: {backend}\n"
        f"# seed: {scenario.seed}\n"
        f"# taichi_plume {__version__}, {versions}, Python {platform.python_version()}, {platform.system()}\n"
    )
    (folder / "scenario.yaml").write_text(header + to_yaml(scenario, source, folder), encoding="utf-8")
