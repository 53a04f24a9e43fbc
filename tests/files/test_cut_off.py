"""Tables whose writing, finishing or resumption is killed anywhere: no row is lost, none counts twice."""

import os
import shutil
from contextlib import suppress
from pathlib import Path

import fake_run
import pyarrow.parquet as pq
import pytest
from refusals import cut_off

from taichi_plume.execution import robots_table
from taichi_plume.files import run_folder, run_tables

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]


def test_rows_count_once_wherever_the_finishing_is_killed(tmp_path, monkeypatch):
    """Finished again, the table is the same after any call on the disk was the last."""
    _, table, whole = half_written(tmp_path)
    for last in range(100):
        path = tmp_path / f"finished {last}" / "robots.parquet"
        path.parent.mkdir()
        shutil.copy(table.stream, path.parent)
        killed = cut_off(monkeypatch, last, lambda path=path: run_tables.finish(path))
        if run_tables.stream_of(path).exists():
            run_tables.finish(path)
        assert pq.read_table(path).equals(whole)
        if not killed:
            break
    assert last > 2


@pytest.mark.parametrize("finished", [False, True])
def test_rows_of_a_checkpoint_are_kept_wherever_the_resumption_is_killed(tmp_path, monkeypatch, finished):
    sim, table, whole = half_written(tmp_path)
    if finished:
        run_tables.finish(table.path)
    rows = 4 * sim.swarm.count
    for last in range(100):
        copy = tmp_path / f"resumed {last}"
        shutil.copytree(tmp_path / "run", copy)

        def resumed(copy: Path = copy) -> robots_table.RobotTable:
            again = robots_table.RobotTable(sim, copy / "robots.parquet")
            again.rows = rows
            again.resume()
            return again

        killed = cut_off(monkeypatch, last, resumed)
        held = run_tables.read(copy / "robots.parquet")
        assert held.equals(whole.slice(0, len(held)))
        resumed().close()
        assert pq.read_table(copy / "robots.parquet").equals(whole.slice(0, rows))
        if not killed:
            break
    assert last > 2


def test_a_stream_is_read_up_to_the_last_complete_batch(tmp_path):
    """The end may be cut off anywhere; a run that needs more rows does not go on."""
    _, table, whole = half_written(tmp_path)
    content = table.stream.read_bytes()
    counts = []
    for size in range(len(content) - 1, -1, -7):
        os.truncate(table.stream, size)
        rows = whole.slice(0, 0)
        with suppress(run_folder.RunFolderError):  # holds no row yet
            rows = run_tables.read(table.path)
        assert rows.equals(whole.slice(0, len(rows)))
        counts.append(len(rows))
    assert list(dict.fromkeys(counts)) == [32, 16, 0]
    table.stream.write_bytes(content[:-1])
    table.rows = 33
    with pytest.raises(run_folder.RunFolderError, match="32 of its first 33 rows are left"):
        table.resume()
    assert table.stream.read_bytes() == content[:-1], "the rows that are left stay"


def test_rows_of_an_interrupted_write_count_once(tmp_path, monkeypatch):
    sim, table, _ = half_written(tmp_path)
    sim.observe()
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: os.truncate(table.stream, table.size + 100) or 1 / 0)
        with pytest.raises(ZeroDivisionError):
            table.flush()
    assert len(run_tables.read(table.path)) == 6 * sim.swarm.count
    table.close()
    assert len(pq.read_table(table.path)) == 7 * sim.swarm.count


def half_written(tmp_path: Path):
    """A simulation after six ticks, with its rows in three batches; and all of these."""
    (tmp_path / "run").mkdir()
    sim = fake_run.simulation(fake_run.scenario(2, maps=[], duration=4))
    table = robots_table.RobotTable(sim, tmp_path / "run" / "robots.parquet")
    table.start()
    sim.observers.append(table.observer())
    for tick in range(6):
        sim.observe()
        sim.advance()
        if tick % 2:
            table.flush()
    return sim, table, run_tables.read(table.path)


@pytest.mark.parametrize("left", [None, 40])
def test_what_a_file_lacks_is_not_made_up(tmp_path, left):
    """Longer than the file is, truncating would fill it with zeros."""
    file = tmp_path / "forces.csv"
    if left is not None:
        file.write_bytes(left * b"a")
    with pytest.raises(run_folder.RunFolderError, match=f"{left or 0} of its first 41 bytes are left"):
        run_folder.cut(file, 41)
    assert not file.exists() or file.stat().st_size == left
