"""Reader of Parquet files, with checksums of the pages."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow.parquet as pq

from taichi_plume.guard.safe_open import open_regular


@contextmanager
def opened(path: Path) -> Iterator[pq.ParquetFile]:
    """Context that yields a Parquet file's reader. Raises OSError, for irregular files too, and pyarrow's errors.

    Read with use_threads=False: Arrow's threads may release Python's buffers after the read has returned, which aborts
    a process that ends just then. Arrow reads ahead (pre_buffer) in threads whatever use_threads is.
    """
    options = {"page_checksum_verification": True, "pre_buffer": False}
    with open_regular(path) as file, pq.ParquetFile(file, **options) as table:
        yield table
