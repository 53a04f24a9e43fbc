"""Checkpoint of an interrupted run, read so that the run can be resumed, and a check of its input files."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from taichi_plume.engine.choice import chosen
from taichi_plume.execution.outputs import OVER, scenario_digest
from taichi_plume.files import checkpoint, manifest
from taichi_plume.files.run_folder import RunFolderError, read_json
from taichi_plume.version import __version__


def saved(folder: Path) -> dict[str, Any]:
    """Return the content of a run's checkpoint. Raises InputError if the run cannot be resumed."""
    status = str(read_json(folder / "result.json").get("status", "unknown"))
    if status in OVER:
        raise RunFolderError(f"{folder}: this run has ended ({status}), there is nothing to resume")
    path = folder / checkpoint.NAME
    if not path.exists():
        raise RunFolderError(
            f"{folder}: has no checkpoint to resume from; python -m taichi_plume repair {folder} completes its files"
        )
    try:
        content = checkpoint.read(path)
        version = content["version"]
        if version != __version__:
            raise RunFolderError(
                f"{path}: is of version {version}, this is {__version__}; resume with that one"
            )
        engine, scenario = content["engine"], content["scenario"]
    except (LookupError, TypeError):
        raise RunFolderError(f"{path}: is no checkpoint of a run") from None
    if engine != chosen():
        raise RunFolderError(f"{path}: was computed with {engine}; resume with --engine {engine}")
    if scenario != scenario_digest(folder):
        raise RunFolderError(f"{folder / 'scenario.yaml'}: has changed since the run was interrupted")
    return content


def require_same(folder: Path, inputs: Mapping[str, object], files: Iterable[Path]) -> None:
    """Raise RunFolderError if an input file has changed. inputs: digests at the start of the run, by relative path."""
    try:
        for name, digest in manifest.digests(folder, files).items():
            if inputs.get(name) != digest:
                raise RunFolderError(
                    f"{folder / name}: has changed since the run began; put the old file back"
                )
    except OSError as error:
        raise RunFolderError(f"{error.filename}: cannot be read: {error.strerror or error}") from None
