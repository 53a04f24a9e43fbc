"""What our zarr groups have in common: chunks with checksums, metadata that readers find in one place, and faults.

Each group is consolidated: its zarr.json repeats the metadata of all its arrays, so that ``xarray.open_zarr(path)``
gives no warning. What grows is consolidated when it comes to the disk: a reader sees it as it was then, whole.
"""

import json
import math
import os
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import psutil
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.errors import ZarrUserWarning

from taichi_plume.files.bounded_codecs import BOUNDED
from taichi_plume.files.tables import plain
from taichi_plume.guard.opening import irregular, unopenable
from taichi_plume.guard.terminal import visible

if TYPE_CHECKING:
    import xarray

CONVENTIONS = "CF-1.11"
FAULTS = (
    OSError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    RuntimeError,
    ArithmeticError,
    MemoryError,
)
"""Of what zarr reads."""
OWN_CODECS = frozenset({"bytes", "blosc", "crc32c", "zstd"})
"""Codecs of the groups that this package writes, and of xarray's copies of these groups."""
LARGEST_CHUNK = 1 << 30  # bytes of a decoded chunk
MOST_CHUNKS = 10_000  # of one element of the first axis, such as a frame


class GroupError(ValueError):
    """A Zarr group that must not be read; the message is one line and begins with its path."""


class Group:
    """A Zarr group, or a single array, that others may have written: the only way in which stored groups are opened.

    A codec may execute what it reads, as pickle of Zarr 2 does. Hence every array is checked before any of its chunks
    is decoded: its codecs, its data type (numbers), size and number of its chunks. No chunk is decoded to more than
    that size.

    name: path of the group within `path`. attributes: of the group. names: of its arrays; [""] if `path` is itself an
    array.
    """

    def __init__(
        self,
        path: Path,
        group: str = "",
        mode: Any = "r",
        formats: tuple[int, ...] = (3,),
        codecs: frozenset[str] = OWN_CODECS,
        consolidated: bool = False,
    ):
        """group: path of a group within `path`. formats: of Zarr that are read. consolidated: whether the metadata
        of the arrays are those that the group repeats. Raises GroupError if `path` is no folder or holds links, and one
        of FAULTS.
        """
        fault = unopenable(path, folder=True) or irregular(path)
        if fault:
            raise GroupError(f"{path}: {fault}")
        self.path, self.name, self.codecs = path, group, codecs
        zarr_format: Any = 3 if formats == (3,) else None
        with zarr.config.set(BOUNDED):
            self._node: Any = zarr.open(
                path, path=group, mode=mode, zarr_format=zarr_format, use_consolidated=consolidated
            )
        self.attributes: dict[str, Any] = dict(self._node.attrs)
        if isinstance(self._node, zarr.Array):
            self.names = [""]
        elif consolidated:
            self.names = sorted(self._node.array_keys())
        else:
            self.names = _arrays_in(path / group)

    def __getitem__(self, name: str) -> Any:
        """An array, checked. Raises GroupError, KeyError, and one of FAULTS."""
        if name not in self.names:
            raise KeyError(name)
        with zarr.config.set(BOUNDED):
            array = self._node[name] if name else self._node
        if not isinstance(array, zarr.Array):
            raise GroupError(f"{self.path}: {visible(name, 40)} is a group, not an array")
        for codec in _codecs(array):
            if codec not in self.codecs:
                raise GroupError(f"{self.path}: is packed by '{visible(codec, 40)}', which is not read")
        where = f"{self.path}{': ' * bool(name)}{visible(name, 40)}"
        if array.dtype.kind not in "biuf":
            raise GroupError(f"{where}: holds {visible(str(array.dtype), 40)}; wanted numbers")
        chunk = getattr(array, "shards", None) or array.chunks
        if min(chunk, default=1) < 1 or math.prod(chunk) * array.dtype.itemsize > LARGEST_CHUNK:
            raise GroupError(
                f"{where}: has chunks of {chunk}; wanted at least one value and at most {LARGEST_CHUNK >> 30} GiB"
            )
        pieces = math.prod(-(-n // size) for n, size in zip(array.shape[1:], array.chunks[1:], strict=True))
        if pieces > MOST_CHUNKS:
            raise GroupError(
                f"{where}: has {pieces} chunks along its axes but the first; at most {MOST_CHUNKS}"
            )
        return array


def open_dataset(path: Path, **options: Any) -> "xarray.Dataset":
    """Open a group that `Group` has checked by xarray, whose chunks have the same bounds."""
    import xarray

    with zarr.config.set(BOUNDED):
        return xarray.open_zarr(path, zarr_format=3, **options)


def _codecs(array: zarr.Array) -> Iterable[str]:
    """Names of all codecs that decode an array's chunks."""
    about: Any = array.metadata.to_dict()
    if array.metadata.zarr_format == 2:
        used = [about.get("compressor"), *(about.get("filters") or ())]
        return [str(one["id"] if isinstance(one, dict) else one.codec_id) for one in used if one is not None]
    return list(_names(about["codecs"]))


def _names(codecs: Iterable[Any]) -> Iterable[str]:
    """Names of Zarr 3 codecs, also of those within shards."""
    for one in codecs:
        yield str(one["name"])
        inner = one.get("configuration") or {}
        yield from _names([*inner.get("codecs", ()), *inner.get("index_codecs", ())])


def create(path: Path, attributes: dict[str, Any]) -> zarr.Group:
    """A new group."""
    return zarr.create_group(path, zarr_format=3, attributes={"Conventions": CONVENTIONS, **attributes})


def add(
    group: zarr.Group,
    name: str,
    dimensions: tuple[str, ...],
    values: np.ndarray,
    attributes: dict[str, Any],
    chunks: tuple[int, ...] | None = None,
) -> Any:
    """A new array of a group, with these values; in one chunk, unless told. What is not there is NaN, or 0."""
    array = reserve(group, name, dimensions, values.shape, attributes, chunks, values.dtype)
    if values.size:
        array[...] = values
    return array


def reserve(
    group: zarr.Group,
    name: str,
    dimensions: tuple[str, ...],
    shape: tuple[int, ...],
    attributes: dict[str, Any],
    chunks: tuple[int, ...] | None = None,
    kind: Any = np.float32,
) -> Any:
    """A new array of a group, of that shape and kind of number, with nothing in it; else as `add`."""
    kind = np.dtype(kind)
    return group.create_array(
        name,
        shape=shape,
        chunks=chunks or tuple(max(1, n) for n in shape),
        dtype=kind,
        fill_value=np.nan if kind.kind == "f" else 0,
        dimension_names=dimensions,
        attributes=attributes,
        compressors=[BloscCodec(cname="zstd", clevel=3, shuffle="shuffle"), Crc32cCodec()],
        config={"write_empty_chunks": True},  # so that one that is missing is noticed
    )


def consolidate(path: Path, group: str | None = None) -> None:
    """Repeat the metadata of all that is in a group in its own."""
    with (
        warnings.catch_warnings()
    ):  # that zarr's specification does not mention it yet; xarray warns without it
        warnings.simplefilter("ignore", ZarrUserWarning)
        zarr.consolidate_metadata(path, path=group)


def _arrays_in(path: Path) -> list[str]:
    """Names of the arrays in a group's folder; zarr, asked for all at once, prints a traceback where several fail."""
    names = {file.parent.name for file in path.glob("*/.zarray")}
    for file in path.glob("*/zarr.json"):
        try:
            is_group = json.loads(file.read_bytes())["node_type"] == "group"
        except (OSError, ValueError, LookupError, TypeError, RecursionError):
            is_group = False  # damaged: zarr reports the fault
        names |= set() if is_group else {file.parent.name}
    return sorted(names)


def stored_chunks(array: Any) -> int:
    """Number of chunks on the disk, of an array that this package wrote.

    Counts files. zarr would go through all chunks that the metadata claim, of which a hostile file has any number.
    """
    folder = Path(array.store.root) / array.path / "c"
    return sum(not name.endswith(".partial") for _, _, names in os.walk(folder) for name in names)


def whole(array: Any, name: str) -> None:
    """Raises ValueError where chunks of an array are missing: zarr takes them for empty ones."""
    stored = stored_chunks(array)
    if stored < array.nchunks:
        raise ValueError(f"{name} has {stored} of {array.nchunks} chunks")


def require_memory(arrays: dict[str, Any]) -> None:
    """Raises ValueError if arrays that are to be read as a whole exceed the free memory, or chunks are missing."""
    for name, array in arrays.items():
        whole(array, name)
    needed = sum(math.prod(array.shape) * array.dtype.itemsize for array in arrays.values())
    free = psutil.virtual_memory().available
    if needed > free:
        raise ValueError(
            f"its arrays take {needed / 1e9:.3g} GB of memory, of which {free / 1e9:.3g} GB are free"
        )


def reason(error: Exception) -> str:
    """What zarr says, in one line; after a checksum's mismatch it lists bytes."""
    return plain(" ".join(str(error).partition(". Stored")[0].split())) or type(error).__name__
