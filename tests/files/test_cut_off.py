"""Tables whose writing, joining or resumption is killed at any call on the disk: no row is lost, none counts twice."""

import shutil
from pathlib import Path

import fake_run
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from refusals import cut_off

from taichi_plume.files import run_folder, table_parts
from taichi_plume.running import robots_table

pytestmark = pytest.mark.usefixtures("taichi")


def test_rows_count_once_wherever_the_joining_is_killed(tmp_path, monkeypatch):
    """Joined again, the table is the same after any call on the disk was the last."""
    _, table, whole = half_written(tmp_path)
    for last in range(100):
        copy = tmp_path / f"joined {last}"
        shutil.copytree(table.parts, copy / "robots.parts")
        killed = cut_off(monkeypatch, last, lambda: table_parts.join(copy / "robots.parquet"))
        if (copy / "robots.parts").exists():
            table_parts.join(copy / "robots.parquet")
        assert pq.read_table(copy / "robots.parquet").equals(whole)
        if not killed:
            break
    assert last > 5


@pytest.mark.parametrize("joined", [False, True])
def test_rows_of_a_checkpoint_are_kept_wherever_the_resumption_is_killed(tmp_path, monkeypatch, joined):
    sim, table, whole = half_written(tmp_path)
    if joined:
        table_parts.join(table.path)
    rows = 4 * sim.swarm.count
    for last in range(100):
        copy = tmp_path / f"resumed {last}"
        shutil.copytree(tmp_path / "run", copy)

        def resumed(copy: Path = copy) -> robots_table.RobotTable:
            again = robots_table.RobotTable(sim, copy / "robots.parquet")
            again.rows = rows
            again.go_on()
            return again

        killed = cut_off(monkeypatch, last, resumed)
        repaired = copy.with_name("repaired")
        shutil.copytree(copy, repaired)
        if (repaired / "robots.parts").exists():
            table_parts.join(repaired / "robots.parquet")
        held = pq.read_table(repaired / "robots.parquet")
        assert held.equals(whole.slice(0, len(held)))
        shutil.rmtree(repaired)
        resumed().close()
        assert pq.read_table(copy / "robots.parquet").equals(whole.slice(0, rows))
        if not killed:
            break
    assert last > 2


def test_a_table_whose_rows_have_gone_does_not_go_on(tmp_path):
    sim, table, _ = half_written(tmp_path)
    table_parts.part_files(table.parts)[0].unlink()
    table.rows = 4 * sim.swarm.count
    with pytest.raises(run_folder.RunFolderError, match="16 of its first 32 rows are left"):
        table.go_on()
    assert len(table_parts.part_files(table.parts)) == 2, "nothing else went"


def half_written(tmp_path: Path):
    """A simulation after six ticks, with its rows in three parts; and all of these."""
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
    files = table_parts.part_files(table.parts)
    return sim, table, pa.concat_tables(map(pq.read_table, files))


@pytest.mark.parametrize("left", [None, 40])
def test_what_a_file_lacks_is_not_made_up(tmp_path, left):
    """Longer than the file is, truncating would fill it with zeros."""
    file = tmp_path / "forces.csv"
    if left is not None:
        file.write_bytes(left * b"a")
    with pytest.raises(run_folder.RunFolderError, match=f"{left or 0} of its first 41 bytes are left"):
        run_folder.cut(file, 41)
    assert not file.exists() or file.stat().st_size == left
