"""Zarr groups: chunks with checksums, consolidated metadata, checks of foreign groups and errors in one line.

The zarr.json of a consolidated group repeats the metadata of all arrays, so that ``xarray.open_zarr(path)`` gives no
warning. A growing group is consolidated at each flush: readers see the state of the last flush, complete.
"""

import json
import math
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import psutil
import zarr
from numpy.typing import DTypeLike
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.errors import ZarrUserWarning

from taichi_plume.files.tables import plain
from taichi_plume.guard.safe_open import irregular, read_regular, unopenable
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
"""Errors of zarr when it reads damaged groups."""
OWN_CODECS = frozenset({"bytes", "blosc", "crc32c", "zstd"})
"""Codecs of the groups that this package writes, and of xarray's copies of these groups."""
LARGEST_METADATA = 1 << 24  # bytes of the zarr.json of an array
Array = Any
"""A `zarr.Array` that `Group` has checked. zarr types its elements as a union that no caller can use."""


class GroupError(ValueError):
    """Error: a foreign Zarr group is unsafe to read; the message is one line and begins with the path."""


class Group:
    """Reader of a foreign Zarr group or single array, with safety checks. All stored groups are opened by this class.

    A codec may execute what it reads, as pickle of Zarr 2 does. Hence every array is checked before a chunk is decoded:
    codecs and data type (numbers).

    name: path of the group within `path`. attributes: of the group. names: of the arrays; [""] if `path` is an array.
    """

    def __init__(
        self,
        path: Path,
        group: str = "",
        mode: Literal["r", "r+"] = "r",
        formats: tuple[int, ...] = (3,),
        codecs: frozenset[str] = OWN_CODECS,
        consolidated: bool = False,
    ):
        """Open a group. formats: accepted Zarr versions. consolidated: read array metadata from the group's zarr.json.

        Raises GroupError if `path` is no folder or holds links, and errors of zarr (FAULTS).
        """
        fault = unopenable(path, folder=True) or irregular(path)
        if fault:
            raise GroupError(f"{path}: {fault}")
        self.path, self.name, self.codecs = path, group, codecs
        self._node: Array = zarr.open(
            path,
            path=group,
            mode=mode,
            zarr_format=3 if formats == (3,) else None,
            use_consolidated=consolidated,
        )
        self.attributes: dict[str, Any] = dict(self._node.attrs)
        if isinstance(self._node, zarr.Array):
            self.names = [""]
        elif consolidated:
            self.names = sorted(self._node.array_keys())
        else:
            self.names = _arrays_in(path / group)

    def __getitem__(self, name: str) -> Array:
        """Return an array of the group after safety checks. Raises GroupError, KeyError, errors of zarr (FAULTS)."""
        if name not in self.names:
            raise KeyError(name)
        array = self._node[name] if name else self._node
        if not isinstance(array, zarr.Array):
            raise GroupError(f"{self.path}: {visible(name, 40)} is a group, not an array")
        for codec in _codecs(array):
            if codec not in self.codecs:
                raise GroupError(f"{self.path}: is packed by '{visible(codec, 40)}', which is not read")
        where = f"{self.path}{': ' * bool(name)}{visible(name, 40)}"
        if array.dtype.kind not in "biuf":
            raise GroupError(f"{where}: holds {visible(array.dtype, 40)}; wanted numbers")
        return array


def open_dataset(path: Path, **options: Any) -> "xarray.Dataset":
    """Open a Zarr group, checked before by `Group`, as an xarray dataset."""
    import xarray

    return xarray.open_zarr(path, zarr_format=3, **options)


@contextmanager
def errors_as(fault: type[ValueError], place: object, what: str = "is damaged") -> Iterator[None]:
    """Context that raises errors of zarr as `fault` with one line. place: path, and frame, that begin the line."""
    try:
        yield
    except fault:
        raise
    except GroupError as error:
        raise fault(str(error)) from None
    except FAULTS as error:
        raise fault(f"{place}: {what}: {reason(error)}") from None


def _codecs(array: zarr.Array) -> list[str]:
    """Return the names of all codecs that decode the chunks of a Zarr array."""
    about: dict[str, Any] = array.metadata.to_dict()
    if array.metadata.zarr_format == 2:
        used = [about.get("compressor"), *(about.get("filters") or ())]
        return [
            str(codec["id"] if isinstance(codec, dict) else codec.codec_id)
            for codec in used
            if codec is not None
        ]
    return list(_names(about["codecs"]))


def _names(codecs: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Yield the names in Zarr 3 codec metadata, including codecs within shards."""
    for codec in codecs:
        yield str(codec["name"])
        inner = codec.get("configuration") or {}
        yield from _names([*inner.get("codecs", ()), *inner.get("index_codecs", ())])


def create(path: Path, attributes: Mapping[str, object]) -> zarr.Group:
    """Create a Zarr group with these attributes and the CF conventions."""
    return zarr.create_group(path, zarr_format=3, attributes={"Conventions": CONVENTIONS, **attributes})


def opened(path: Path) -> zarr.Group:
    """Open a Zarr group that this process has created, to add arrays."""
    return zarr.open_group(path, mode="r+", zarr_format=3)


def add(
    group: zarr.Group,
    name: str,
    dimensions: tuple[str, ...],
    values: np.ndarray,
    attributes: Mapping[str, object],
    chunks: tuple[int, ...] | None = None,
) -> Array:
    """Store values as a new Zarr array, by default in one chunk. Its fill value is NaN or, for integers, 0."""
    array = reserve(group, name, dimensions, values.shape, attributes, chunks, values.dtype)
    if values.size:
        array[...] = values
    return array


def reserve(
    group: zarr.Group,
    name: str,
    dimensions: tuple[str, ...],
    shape: tuple[int, ...],
    attributes: Mapping[str, object],
    chunks: tuple[int, ...] | None = None,
    kind: DTypeLike = np.float32,
) -> Array:
    """Create an empty Zarr array, by default in one chunk. kind: data type. Missing values: NaN or, of integers, 0."""
    kind = np.dtype(kind)
    return group.create_array(
        name,
        shape=shape,
        chunks=chunks or tuple(max(1, n) for n in shape),
        dtype=kind,
        fill_value=np.nan if kind.kind == "f" else 0,
        dimension_names=dimensions,
        attributes=dict[str, Any](attributes),
        compressors=[BloscCodec(cname="zstd", clevel=3, shuffle="shuffle"), Crc32cCodec()],
        config={"write_empty_chunks": True},  # so that a missing chunk is noticed
    )


def consolidate(path: Path, group: str | None = None) -> None:
    """Consolidate a group's metadata: copy the metadata of all arrays into the group's zarr.json."""
    with warnings.catch_warnings():  # zarr's specification does not mention this yet; xarray warns without
        warnings.simplefilter("ignore", ZarrUserWarning)
        zarr.consolidate_metadata(path, path=group)


def complete(path: Path, part: str = "") -> int:
    """Cut an interrupted group to the frames that are complete; return their number. Raises errors of zarr (FAULTS).

    A frame is complete once its time is written. The remains of unfinished chunks are removed.
    """
    for file in (path / part).rglob("*.partial"):
        file.unlink()
    group = Group(path, part, mode="r+")
    arrays = {name: group[name] for name in group.names}
    frames = int(np.isfinite(arrays["time"][:]).cumprod().sum())
    for array in arrays.values():
        if (array.metadata.dimension_names or ("",))[0] == "time":
            array.resize((frames, *array.shape[1:]))
    consolidate(path, part or None)
    return frames


def _arrays_in(path: Path) -> list[str]:
    """Return the array names in a Zarr group's folder. zarr's own listing prints a traceback for damaged arrays."""
    names = {file.parent.name for file in path.glob("*/.zarray")}
    for file in path.glob("*/zarr.json"):
        try:
            is_group = json.loads(read_regular(file, LARGEST_METADATA))["node_type"] == "group"
        except (OSError, ValueError, LookupError, TypeError, RecursionError):
            is_group = False  # damaged: zarr reports the fault
        names |= set() if is_group else {file.parent.name}
    return sorted(names)


def stored_chunks(array: Array) -> int:
    """Count the chunk files on disk of a Zarr array that this package wrote.

    zarr would go through all chunks that the metadata claim, and a hostile file claims any number.
    """
    folder = Path(array.store.root) / array.path / "c"
    return sum(not name.endswith(".partial") for _, _, names in os.walk(folder) for name in names)


def require_chunks(array: Array, name: str) -> None:
    """Raise ValueError if chunk files of an array are missing, which zarr would read as empty chunks."""
    stored = stored_chunks(array)
    if stored < array.nchunks:
        raise ValueError(f"{name} has {stored} of {array.nchunks} chunks")


def require_memory(arrays: Mapping[str, Array]) -> None:
    """Raise ValueError if the arrays together exceed the free memory, or if chunk files are missing."""
    for name, array in arrays.items():
        require_chunks(array, name)
    needed = sum(math.prod(array.shape) * array.dtype.itemsize for array in arrays.values())
    free = psutil.virtual_memory().available
    if needed > free:
        raise ValueError(f"its arrays take {needed / 1e9:.3g} GB of memory, {free / 1e9:.3g} GB are free")


def reason(error: Exception) -> str:
    """Return the message of a zarr error in one line, without the bytes listed after a checksum mismatch."""
    return plain(" ".join(str(error).partition(". Stored")[0].split())) or type(error).__name__
