"""`manifest.json` of a run folder: size and SHA-256 of each input and output of the run, to detect later changes.

    {"inputs": {"../film/fields.zarr": {"sha256": ..., "bytes": ...}}, "outputs": {"robots.parquet": {...}}}

Paths are relative to the folder. The digest of a folder is that of the sorted names and digests of the files in it.
Chunks of a zarr folder count by name and size only: each chunk holds its own checksum, and hashing a long film before
the first frame would take as long as playing it.
"""

import hashlib
import json
import os
from collections.abc import Iterable
from io import BufferedReader
from pathlib import Path
from typing import TypedDict

from taichi_plume.files import disk
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import gate, open_regular, unopenable

NAME = "manifest.json"
LARGEST = 1 << 24  # bytes
ZARR_METADATA = "zarr.json"


class ManifestError(InputError):
    """Error: manifest.json cannot be read; the message is one line and begins with the path."""


class Digest(TypedDict):
    """Checksum and size of a file or folder."""

    sha256: str
    bytes: int


def digest(path: Path, chunks: bool = False) -> Digest:
    """Return SHA-256 and size of a file or folder. chunks: also hash the content of zarr chunks. Raises OSError."""
    if not path.is_dir():
        with _opened(path) as file:
            size = os.fstat(file.fileno()).st_size
            return {"sha256": hashlib.file_digest(file, "sha256").hexdigest(), "bytes": size}
    total, size = hashlib.sha256(), 0
    zarr = (path / ZARR_METADATA).is_file()
    files = [Path(root) / name for root, _, names in os.walk(path) for name in names]
    for name, file in sorted((file.relative_to(path).as_posix(), file) for file in files):
        bytes_ = file.stat().st_size
        chunk = zarr and not chunks and file.name != ZARR_METADATA
        total.update(json.dumps([name, bytes_, "" if chunk else digest(file)["sha256"]]).encode())
        size += bytes_
    return {"sha256": total.hexdigest(), "bytes": size}


def digests(folder: Path, paths: Iterable[Path]) -> dict[str, Digest]:
    """Return SHA-256 and size of each path that exists, by its path relative to `folder`. Raises OSError."""
    existing = sorted({path.absolute() for path in paths if path.exists()})
    return {_name(folder, path): digest(path) for path in existing}


def write(folder: Path, inputs: dict[str, Digest], outputs: Iterable[Path]) -> None:
    """Write a folder's manifest with the digests of inputs and outputs, atomically. Raises OSError."""
    content = {"inputs": inputs, "outputs": digests(folder, outputs)}
    with disk.written_whole(folder / NAME) as fresh:
        fresh.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _opened(path: Path) -> BufferedReader:
    """Open a regular file; a surrounding `gate` neither checks nor lists the file, which is no input of a run."""
    with gate(None):
        return open_regular(path)


def _name(folder: Path, path: Path) -> str:
    """Return `path` relative to `folder`, after resolving links; on another drive the path itself."""
    try:
        return Path(os.path.relpath(path.parent.resolve() / path.name, folder.resolve())).as_posix()
    except ValueError:
        return path.as_posix()


def read(folder: Path) -> dict[str, dict[str, Digest]]:
    """Return the digests of `inputs` and `outputs` in a folder's manifest; empty without one. Raises ManifestError."""
    path = folder / NAME
    try:
        with _opened(path) as file:
            content = json.loads(file.read(LARGEST))
        parts = {part: content[part] for part in ("inputs", "outputs")}
        entries = [entry for part in parts.values() for entry in part.values()]
        if all(isinstance(entry["sha256"], str) and isinstance(entry["bytes"], int) for entry in entries):
            return parts
    except FileNotFoundError:
        return {"inputs": {}, "outputs": {}}
    except OSError as error:
        raise ManifestError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        pass
    raise ManifestError(f"{path}: is damaged; remove it to read the files beside it without a check")


def is_input(folder: Path, path: Path) -> bool:
    """Return whether a run's manifest lists a file as an input whose content is still the same."""
    try:
        recorded = read(folder)["inputs"].get(_name(folder, path))
        if recorded is None or unopenable(path) or path.stat().st_size != recorded["bytes"]:
            return False
        return digest(path) == recorded
    except (ManifestError, OSError, ValueError):
        return False


def changed(path: Path) -> str | None:
    """Return one line on how a file or folder differs from its checksum in manifest.json; None if equal, unlisted."""
    try:
        recorded = read(path.parent)["outputs"].get(path.name)
        if recorded is None:
            return None
        if path.is_file() and path.stat().st_size != recorded["bytes"]:
            return f"{path}: has changed since its run: {path.stat().st_size} bytes, not {recorded['bytes']}"
        if digest(path) != recorded:
            return f"{path}: has changed since its run: its checksum differs from the one in {NAME}"
    except ManifestError as error:
        return str(error)
    except OSError as error:
        return f"{path}: cannot be read: {error.strerror or error}"
    return None


def require_unchanged(path: Path, fault: type[ValueError]) -> None:
    """Raise `fault`, with one line of text, if a file or folder differs from its checksum in manifest.json."""
    damage = changed(path)
    if damage:
        raise fault(damage)
