"""Tables that grow: their size on the disk, and resuming with other columns."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.run_tables import GrowingTable, column
from taichi_plume.scenario.probes import BYTES_PER_NUMBER


def test_measured_values_take_as_many_bytes_as_scenarios_are_reported(tmp_path):
    """Values that change from sample to sample as a velocity does: none repeats, and the first digits hardly change."""
    samples, points = 4000, 20
    columns = [column("t", pa.float64(), "s", "time"), column("u", pa.float32(), "m/s", "velocity")]
    rng = np.random.default_rng(1)
    u = 0.5 + 0.05 * np.cumsum(rng.standard_normal((samples, points)), axis=0) / np.sqrt(samples)
    table = GrowingTable(tmp_path / "u.parquet", columns, {}, points)
    table.start()
    for n in range(samples):
        table.values["t"][table.pending] = 0.035 * n
        table.values["u"][table.pending] = u[n]
        table.took()
    table.close()
    found = pq.read_table(table.path)
    np.testing.assert_array_equal(found["u"].to_numpy(), u.astype(np.float32).ravel())
    pq.write_table(found, tmp_path / "usual.parquet", compression="zstd", row_group_size=50_000)
    size = table.path.stat().st_size
    assert size < BYTES_PER_NUMBER * found.num_rows
    assert size < 0.8 * (tmp_path / "usual.parquet").stat().st_size


def test_a_table_of_another_version_is_not_continued(tmp_path):
    """Another version may have other columns; the rows that it wrote stay."""
    columns = [column("t", pa.float64(), "s", "time"), column("u", pa.float32(), "m/s", "velocity")]
    older = GrowingTable(tmp_path / "u.parquet", columns[:1], {}, 1)
    older.start()
    older.values["t"][0] = 0.5
    older.took()
    older.flush()
    content = older.stream.read_bytes()
    table = GrowingTable(older.path, columns, {}, 1)
    table.rows = 1
    with pytest.raises(RunFolderError, match=r"u.parquet: is of another version, with other columns"):
        table.resume()
    assert older.stream.read_bytes() == content
