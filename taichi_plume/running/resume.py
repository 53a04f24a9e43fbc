"""What a run that was cut off is resumed from, and whether all that it reads is still as it was."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from taichi_plume import __version__
from taichi_plume.files import checkpoint, manifest
from taichi_plume.files.run_folder import RunFolderError, told
from taichi_plume.running.outputs import OVER, scenario_digest


def saved(folder: Path) -> dict[str, Any]:
    """The content of a run's checkpoint. Raises InputError if the run cannot be resumed."""
    status = str(told(folder / "result.json").get("status", "unknown"))
    if status in OVER:
        raise RunFolderError(f"{folder}: this run is over ({status}), there is nothing to resume")
    path = folder / checkpoint.NAME
    if not path.exists():
        raise RunFolderError(
            f"{folder}: has no checkpoint to go on from; python -m taichi_plume.repair {folder} completes its files"
        )
    try:
        content = checkpoint.read(path)
        version, scenario = content["version"], content["scenario"]
    except (LookupError, TypeError):
        raise RunFolderError(f"{path}: is no checkpoint of a run") from None
    if version != __version__:
        raise RunFolderError(f"{path}: is of version {version}, this is {__version__}; resume with that one")
    if scenario != scenario_digest(folder):
        raise RunFolderError(f"{folder / 'scenario.yaml'}: is not as it was when the run was cut off")
    return content


def require_same(folder: Path, inputs: dict[str, Any], files: Iterable[Path]) -> None:
    """Raise RunFolderError unless `files` are as `inputs`, their digests when the run began, tell."""
    try:
        for name, digest in manifest.digests(folder, files).items():
            if inputs.get(name) != digest:
                raise RunFolderError(
                    f"{folder / name}: is not as it was when the run began; put the old one back"
                )
    except OSError as error:
        raise RunFolderError(f"{error.filename}: cannot be read: {error.strerror or error}") from None
