"""Checkpoints of a run, `checkpoint.npz`: plain data and arrays, with a checksum; replaced atomically.

The file is an archive of NumPy arrays, one of which holds the other data as JSON, followed by the SHA-256 of all bytes
before. Reading a file executes no code, whoever wrote it.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files import disk
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import read_regular

NAME = "checkpoint.npz"
TREE = "tree"
KIND = "taichi_plume checkpoint 1"
DIGEST = 32  # bytes


class CheckpointError(InputError):
    """Error: a checkpoint cannot be read; the message begins with the path."""


class NotPlainError(TypeError):
    """Error: a value is not plain data, so it cannot be stored in a checkpoint."""


def write(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint of numbers, texts, arrays, lists, tuples and dicts. Raises OSError and NotPlainError."""
    arrays: dict[str, np.ndarray] = {}
    tree = json.dumps({"kind": KIND, "content": _encoded(content, arrays, "")})
    disk.require_room(path, len(tree) + sum(array.nbytes for array in arrays.values()))
    with disk.written_whole(path) as fresh, fresh.open("wb+") as file:
        np.savez(file, **{TREE: np.frombuffer(tree.encode(), np.uint8)}, **arrays)  # type: ignore[arg-type]
        file.seek(0)
        file.write(hashlib.file_digest(file, "sha256").digest())


def require_plain(value: object, name: str) -> None:
    """Raise NotPlainError if a checkpoint cannot store and return a value unchanged. name: begins the message."""
    _encoded(value, {}, name)


def read(path: Path) -> dict[str, Any]:
    """Return the content of a run's checkpoint. Raises CheckpointError if it is missing, damaged or foreign."""
    try:
        content = memoryview(read_regular(path))
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror or error}") from None
    body, digest = content[:-DIGEST], content[-DIGEST:]
    if hashlib.sha256(body).digest() != digest:
        raise CheckpointError(f"{path}: is damaged: its checksum is another one")
    try:
        with np.load(io.BytesIO(body), allow_pickle=False) as archive:
            tree = json.loads(archive[TREE].tobytes())
            if tree["kind"] != KIND:
                raise CheckpointError(f"{path}: is no checkpoint of this version")
            return _decoded(tree["content"], archive.__getitem__)
    except (ValueError, LookupError, TypeError, zipfile.BadZipFile) as error:
        raise CheckpointError(f"{path}: is no checkpoint of taichi_plume: {error}") from None


def _encoded(value: Any, arrays: dict[str, np.ndarray], path: str) -> object:
    """Convert a value to JSON types; a type that JSON lacks becomes {"type": content}, arrays are moved to `arrays`.

    Subclasses are refused, as they would be read back as the base class. path: place of the value, for messages.
    """
    if type(value) is np.ndarray or isinstance(value, np.generic):
        if np.asarray(value).dtype.hasobject:
            raise NotPlainError(
                f"{path}: is an array of Python objects; a checkpoint takes arrays of numbers"
            )
        name = str(len(arrays))
        arrays[name] = np.asarray(value)
        return {"array" if type(value) is np.ndarray else "number": name}
    if value is None or type(value) in (bool, int, float, str):
        return value
    if type(value) in (list, tuple):
        parts = [_encoded(part, arrays, f"{path}[{n}]") for n, part in enumerate(value)]
        return parts if isinstance(value, list) else {"tuple": parts}
    if type(value) is dict:
        return {
            "dict": [
                [_encoded(key, arrays, path), _encoded(part, arrays, f"{path}.{key}")]
                for key, part in value.items()
            ]
        }
    raise NotPlainError(f"{path}: is a {type(value).__name__}, which is no number, text, array, list or dict")


def _decoded(value: Any, array: Callable[[str], np.ndarray]) -> Any:
    if isinstance(value, list):
        return [_decoded(part, array) for part in value]
    if not isinstance(value, dict):
        return value
    ((kind, content),) = value.items()
    if kind == "array":
        return array(content)
    if kind == "number":
        return array(content)[()]
    if kind == "tuple":
        return tuple(_decoded(part, array) for part in content)
    return {_decoded(key, array): _decoded(part, array) for key, part in content}
