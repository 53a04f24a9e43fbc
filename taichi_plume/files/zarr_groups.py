"""What our zarr groups have in common: chunks with checksums, metadata that readers find in one place, and faults.

Each group is consolidated: its zarr.json repeats the metadata of all its arrays, so that ``xarray.open_zarr(path)``
gives no warning. What grows is consolidated when it comes to the disk: a reader sees it as it was then, whole.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.errors import ZarrUserWarning

from taichi_plume.files.tables import plain

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


def arrays_in(path: Path) -> list[str]:
    """Names of the arrays in a group's folder; zarr, asked for all at once, prints a traceback where several fail."""
    return sorted(file.parent.name for file in path.glob("*/zarr.json"))


def whole(array: Any, name: str) -> None:
    """Raises ValueError where chunks of an array are missing: zarr takes them for empty ones."""
    if array.nchunks_initialized < array.nchunks:
        raise ValueError(f"{name} has {array.nchunks_initialized} of {array.nchunks} chunks")


def reason(error: Exception) -> str:
    """What zarr says, in one line; after a checksum's mismatch it lists bytes."""
    return plain(" ".join(str(error).partition(". Stored")[0].split())) or type(error).__name__
