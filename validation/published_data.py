"""Measurements that others published, which this project does not distribute: files that users download themselves.

The environment variable TAICHI_PLUME_DATA names the folder that holds them. Cases that need a missing file are skipped.
"""

import os
from pathlib import Path

VARIABLE = "TAICHI_PLUME_DATA"


class MissingDataError(Exception):
    """A case needs a file of published measurements that is not there."""


def data_file(name: str, source: str) -> Path:
    """Return the path of a file below the folder of measurements; source: where it was published, such as `doi:10.1/2`.

    Raises MissingDataError if the variable is not set or the file does not exist.
    """
    folder = os.environ.get(VARIABLE)
    path = Path(folder or ".") / name
    if not folder or not path.is_file():
        place = f"{folder} has no {name}" if folder else f"{VARIABLE} is not set"
        raise MissingDataError(f"{place}; needed is {name} of {source} in the folder that {VARIABLE} names")
    return path
