"""Test of Parquet reads without threads of Arrow, which could abort a process that ends at that moment."""

import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

CODE = """
import os, sys
from pathlib import Path
from taichi_plume.files import parquet
before = len(os.listdir("/proc/self/task"))
for _ in range(20):
    with parquet.opened(Path(sys.argv[1])) as file:
        rows = len(file.read(use_threads=False)) + sum(map(len, file.iter_batches(40, use_threads=False)))
print(rows, len(os.listdir("/proc/self/task")) - before)
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted on Linux")
def test_a_read_starts_no_thread(tmp_path):
    pq.write_table(pa.table({name: [1.5] * 100 for name in "abc"}), tmp_path / "t.parquet")
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(tmp_path / "t.parquet")], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["200", "0"]
