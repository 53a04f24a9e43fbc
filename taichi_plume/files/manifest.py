"""`manifest.json` of a run folder: sizes and SHA-256 of what the run read and wrote, so that later damage is noticed.

    {"inputs": {"../film/fields.zarr": {"sha256": ..., "bytes": ...}}, "outputs": {"robots.parquet": {...}}}

Paths are relative to the folder. A file's digest is that of its content. A folder's is that of the sorted names and the
digests of its files; the chunks of a zarr folder count by name and size alone: each holds a checksum of its own, and to
read all of a long film before its first frame is shown would take as long as to play it.
"""

import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from taichi_plume.files import disk
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.opening import unopenable

NAME = "manifest.json"
LARGEST = 1 << 24  # bytes
ZARR_METADATA = "zarr.json"


class ManifestError(InputError):
    """A manifest that cannot be read; the message is one line and begins with its path."""


def digest(path: Path, chunks: bool = False) -> dict[str, Any]:
    """`sha256` and `bytes` of a file or folder; chunks: whether those of zarr count by content. Raises OSError."""
    if not path.is_dir():
        with path.open("rb") as file:
            return {"sha256": hashlib.file_digest(file, "sha256").hexdigest(), "bytes": path.stat().st_size}
    all_of_it, size = hashlib.sha256(), 0
    zarr = (path / ZARR_METADATA).is_file()
    for file in sorted(_files(path)):
        bytes_ = (path / file).stat().st_size
        chunk = zarr and not chunks and Path(file).name != ZARR_METADATA
        content = "" if chunk else digest(path / file)["sha256"]
        all_of_it.update(json.dumps([file, bytes_, content]).encode())
        size += bytes_
    return {"sha256": all_of_it.hexdigest(), "bytes": size}


def _files(folder: Path) -> Iterable[str]:
    """Paths of all files in a folder, relative to it, with slashes."""
    for root, _, names in os.walk(folder):
        for name in names:
            yield (Path(root) / name).relative_to(folder).as_posix()


def digests(folder: Path, paths: Iterable[Path]) -> dict[str, Any]:
    """The digest of each path that is there, by its name relative to the folder. Raises OSError."""
    there = sorted({path.absolute() for path in paths if path.exists()})
    return {_name(folder, path): digest(path) for path in there}


def write(folder: Path, inputs: dict[str, Any], outputs: Iterable[Path]) -> None:
    """Write a folder's manifest, all of it or nothing; inputs: their `digests`. Raises OSError."""
    content = {"inputs": inputs, "outputs": digests(folder, outputs)}
    with disk.written_whole(folder / NAME) as fresh:
        fresh.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _name(folder: Path, path: Path) -> str:
    """A path as a manifest names it, whatever links lead to its folder; on another drive it stays as it is."""
    try:
        return Path(os.path.relpath(path.parent.resolve() / path.name, folder.resolve())).as_posix()
    except ValueError:
        return path.as_posix()


def read(folder: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """`inputs` and `outputs` of a folder's manifest, empty where it has none. Raises ManifestError."""
    path = folder / NAME
    try:
        with path.open("rb") as file:
            content = json.loads(file.read(LARGEST))
        parts = {part: content[part] for part in ("inputs", "outputs")}
        if all(_is_digest(one) for part in parts.values() for one in part.values()):
            return parts
    except FileNotFoundError:
        return {"inputs": {}, "outputs": {}}
    except OSError as error:
        raise ManifestError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        pass
    raise ManifestError(f"{path}: is damaged; without it the files beside it are taken as they are")


def is_input(folder: Path, path: Path) -> bool:
    """Return whether a file is an input of the run in that folder, unchanged to the byte according to its manifest."""
    try:
        recorded = read(folder)["inputs"].get(_name(folder, path))
        if recorded is None or unopenable(path) or path.stat().st_size != recorded["bytes"]:
            return False
        return digest(path) == recorded
    except (ManifestError, OSError, ValueError):
        return False


def _is_digest(one: Any) -> bool:
    return isinstance(one["sha256"], str) and isinstance(one["bytes"], int)


def changed(path: Path) -> str | None:
    """One line where a file or folder is not what the manifest beside it says; None where it is, or is not listed."""
    try:
        told = read(path.parent)["outputs"].get(path.name)
        if told is None:
            return None
        if path.is_file() and path.stat().st_size != told["bytes"]:
            return (
                f"{path}: is not as its run left it: it has {path.stat().st_size} bytes, not {told['bytes']}"
            )
        if digest(path) != told:
            return f"{path}: is not as its run left it: its checksum is another than {NAME} beside it says"
    except ManifestError as error:
        return str(error)
    except OSError as error:
        return f"{path}: cannot be read: {error.strerror or error}"
    return None
