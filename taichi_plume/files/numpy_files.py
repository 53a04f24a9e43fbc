"""Arrays of numbers in NumPy's files: .npy with one array, .npz with several by their names; never pickled objects."""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from taichi_plume.guard.safe_open import content_of
from taichi_plume.guard.terminal import LONGEST_VALUE, visible

LARGEST = 1 << 28  # bytes, also when unpacked
SUFFIXES = (".npy", ".npz")


def read_arrays(path: Path, fault: Callable[[str], Exception]) -> dict[str, np.ndarray]:
    """Return the arrays of a file by their names, that of a .npy file by "". Raises `fault(message)`, in a line."""
    content = content_of(path, LARGEST, fault)
    try:
        if path.suffix.lower() == ".npz":
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                if sum(part.file_size for part in archive.infolist()) > LARGEST:
                    raise ValueError(f"more than {LARGEST >> 20} MiB unpacked")
            with np.load(io.BytesIO(content), allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
        return {"": np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)}
    except Exception as error:  # NumPy raises many kinds of errors for damaged files
        reason = visible(" ".join(str(error).split()), LONGEST_VALUE)
        raise fault(f"{path}: is no readable {path.suffix} file of numbers ({reason})") from None
