"""The folder of a study: whatever is killed, each run is there once, and whole."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import made_study
import pyarrow.parquet as pq
import pytest

from taichi_plume.files import own_folder
from taichi_plume.studies import store as module
from taichi_plume.studies import tables
from taichi_plume.studies.messages import AirRecord, Cost, Record
from taichi_plume.studies.store import Store, StoreError

COST = Cost(1.5, 0.25, 0.125, 3, "tcp://127.0.0.1:1")


TEXTS = {"study.yaml": b"base: arena.yaml\n", "base.yaml": b"name: arena\n"}


def record(run="a" * 16, status="completed", message="", pushes: int | None = 1) -> Record:
    floats: dict[str, Any] = {
        "final_distance_m": 0.1 + 0.2,
        "pinned_s": 0.5,
        "declared_time_s": 0.1,
        "shortest_m": 1.8,
    }
    trials = [made_study.trial(k, pushes=pushes, time_s=1 / 3 if k else None, **floats) for k in range(2)]
    return Record(run, status, message, trials, {"correlation": 0.1, "none": None}, COST)


@pytest.fixture
def plan(monkeypatch):
    """A study of three runs, whose plan is not written."""
    monkeypatch.setattr(tables, "write_plan", lambda *_: None)
    requests = [SimpleNamespace(run=one * 16) for one in "abc"]
    return SimpleNamespace(texts=TEXTS, requests=requests)


def begun(folder: Path, plan, *parts: list[Record]) -> Store:
    """A study's folder with these parts, which another process may take."""
    with Store(folder) as store:
        store.begin(plan)
        for part in parts:
            store.add(part)
    return store


def full(*_):
    raise OSError(28, "No space left on device")


def test_what_goes_in_comes_out_to_the_bit(tmp_path, plan):
    records = [
        record("a" * 16),
        record("b" * 16, status="failed", message="it burst", pushes=None),
        Record("c" * 16, "stopped", "", [], {}, COST),
    ]
    with Store(tmp_path / "out") as store:
        store.begin(plan)
        store.add(records[:2])
        store.add(records[2:])
        store.add_air(AirRecord("f0", 12.5, 100, 1 << 40))
    again = Store(tmp_path / "out")
    found = list(again.records())
    assert found == records
    assert [type(row["hits"]) for one in found for row in one.trials] == 4 * [int]
    assert again.statuses() == {"a" * 16: "completed", "b" * 16: "failed", "c" * 16: "stopped"}
    assert again.air_records() == [AirRecord("f0", 12.5, 100, 1 << 40)]
    assert (tmp_path / "out" / "base.yaml").read_text() == "name: arena\n"


def test_parts_with_more_columns_are_read(tmp_path, plan):
    """As versions before 0.2 wrote them."""
    begun(tmp_path, plan, [record()])
    part = tmp_path / "parts" / "000000.parquet"
    table = pq.read_table(part)
    pq.write_table(table.add_column(3, "expected", [["{}"]]), part)
    assert list(Store(tmp_path).records()) == [record()]


def test_the_last_one_done_counts(tmp_path, plan):
    """Of a run that failed and was repeated, and of one that was done and failed when it was repeated."""
    store = begun(
        tmp_path,
        plan,
        [record("a" * 16, "failed", "first"), record("b" * 16, "completed")],
        [record("a" * 16, "completed"), record("b" * 16, "failed", "later")],
        [record("c" * 16, "failed", "first")],
        [record("c" * 16, "failed", "second")],
    )
    expected = {one.run[0]: (one.status, one.message) for one in store.records()}
    assert expected == {"a": ("completed", ""), "b": ("completed", ""), "c": ("failed", "second")}


def test_it_goes_on_after_the_last_part(tmp_path, plan):
    for run in "ab":
        begun(tmp_path, plan, [record(run * 16)])
    assert {file.name for file in (tmp_path / "parts").iterdir()} == {"000000.parquet", "000001.parquet"}


def test_another_studys_folder(tmp_path, plan):
    begun(tmp_path, plan, [record("a" * 16), record("d" * 16)], [record("e" * 16)], [record("b" * 16)])
    (tmp_path / "kept" / ("d" * 16)).mkdir(parents=True)
    with pytest.raises(StoreError, match="holds 2 runs that this study does not have"):
        Store(tmp_path).begin(plan)
    assert len(Store(tmp_path).statuses()) == 4
    with Store(tmp_path) as store:
        store.begin(plan, force=True)
        assert store.statuses() == {"a" * 16: "completed", "b" * 16: "completed"}
        assert [one.run[0] for one in store.records()] == ["a", "b"]
    assert not (tmp_path / "kept" / ("d" * 16)).exists()


def test_a_folder_of_others_is_refused(tmp_path, plan):
    (tmp_path / "thesis.tex").write_text("")
    for force in (False, True):
        with pytest.raises(StoreError, match=r"is not empty, and holds no study \(thesis.tex\)"):
            Store(tmp_path).begin(plan, force)
    with pytest.raises(StoreError, match="cannot be written to"):
        Store(tmp_path / "thesis.tex").begin(plan)
    with pytest.raises(StoreError, match="cannot be written to"):
        Store(tmp_path / "\0").begin(plan)


def test_a_disk_that_is_full_at_the_begin_leaves_a_folder_to_go_on_in(tmp_path, plan, monkeypatch):
    film = tmp_path / "airs" / "one.zarr.0a.part"
    film.mkdir(parents=True)  # of a worker that was killed
    (tmp_path / "parts").mkdir()
    own_folder.mark(tmp_path, "study")
    with monkeypatch.context() as patched:
        patched.setattr(Store, "_keep", full)
        for folder in (tmp_path / "new", tmp_path):
            with pytest.raises(OSError, match="No space"):
                Store(folder).begin(plan)
    assert not film.exists()
    for folder in (tmp_path / "new", tmp_path):
        begun(folder, plan)


def test_a_folder_of_the_users_stays_as_it_is(tmp_path, plan):
    """Known by no mark of a study, or holding links out of it: nothing is replaced, removed or left there."""
    mine = {"base.yaml": "mine", "study.yaml": "mine", "a.part": "", "b.new": "", "study.json": "{}"}
    folder = tmp_path / "mine"
    (folder / "parts").mkdir(parents=True)
    for name, text in mine.items():
        (folder / name).write_text(text)
    for force in (False, True):
        with pytest.raises(StoreError, match=r"holds no study \(a.part\)"):
            Store(folder).begin(plan, force)
    assert {file.name: file.read_text() for file in folder.iterdir() if file.is_file()} == mine
    for link in ("parts", "base.yaml", "airs/one.json", "kept/a/result.json", ".lock"):
        out, target = tmp_path / "studies" / link.replace("/", "-"), tmp_path / "target"
        target.write_text("mine")
        begun(out, plan)
        (out / link).parent.mkdir(exist_ok=True, parents=True)
        if (out / link).is_dir():
            (out / link).rmdir()
        (out / link).unlink(missing_ok=True)
        (out / link).symlink_to(target)
        with pytest.raises(StoreError, match=link):
            Store(out).begin(plan)
        assert target.read_text() == "mine"


def test_leftovers_of_a_killed_study_go_and_files_of_the_user_stay(tmp_path, plan):
    begun(tmp_path, plan)
    for name in (".base.yaml.0123abcd.part", "parts/.000000.parquet.0123abcd.part", "mine.part", "mine.new"):
        (tmp_path / name).write_text("")
    begun(tmp_path, plan)
    left = {file.name for file in tmp_path.rglob("*") if file.suffix in (".part", ".new")}
    assert left == {"mine.part", "mine.new"}


def test_one_at_a_time(tmp_path, plan):
    with Store(tmp_path) as store:
        store.begin(plan)
        with pytest.raises(StoreError, match="another study is running there"):
            Store(tmp_path).begin(plan)
        store.add([record()])
        with multiprocessing.get_context("spawn").Pool(1) as pool:  # to be looked at all the same
            assert pool.apply(Store(tmp_path).statuses) == {"a" * 16: "completed"}
    begun(tmp_path, plan)


def fault_of(folder: Path) -> str:
    try:
        list(Store(folder).records())
    except StoreError as error:
        return str(error)
    return ""


@pytest.mark.slow
def test_damage_is_reported_in_a_line(tmp_path, plan):
    begun(tmp_path, plan, [record()], [record("b" * 16)])
    part = tmp_path / "parts" / "000000.parquet"
    whole = part.read_bytes()
    unread = 0
    for n in range(0, len(whole), 7):
        part.write_bytes(whole[:n] + bytes([whole[n] ^ 0x41]) + whole[n + 1 :])
        expected = fault_of(tmp_path)
        unread += expected != ""
        assert expected.startswith(f"{part}: ") == (expected != "")
        assert "\n" not in expected
    assert unread > len(whole) / 7 / 2
    part.write_bytes(b"")
    with pytest.raises(StoreError, match="remove it"):
        Store(tmp_path).begin(plan)
    part.unlink()
    os.mkfifo(part)
    with pytest.raises(StoreError, match="is a pipe"):
        Store(tmp_path).statuses()
    part.unlink()
    (tmp_path / "parts" / "mine.parquet").write_bytes(whole)
    with pytest.raises(StoreError, match=r"mine\.parquet: was not written by a study; remove it"):
        Store(tmp_path).statuses()
    (tmp_path / "parts" / "mine.parquet").unlink()
    assert Store(tmp_path).statuses() == {"b" * 16: "completed"}


def test_a_full_disk_leaves_what_there_was(tmp_path, plan, monkeypatch):
    with Store(tmp_path) as store:
        store.begin(plan)
        store.add([record()])
        monkeypatch.setattr(module.disk.shutil, "disk_usage", lambda _: SimpleNamespace(free=1000))
        with pytest.raises(OSError, match="the disk is full"):
            store.add([record("b" * 16)])
        monkeypatch.undo()
        monkeypatch.setattr(module.disk.os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):
            store.add([record("b" * 16)])
        assert store.statuses() == {"a" * 16: "completed"}
        assert [file.name for file in (tmp_path / "parts").iterdir()] == ["000000.parquet"]


WRITES = """
import sys
from pathlib import Path
from types import SimpleNamespace
from taichi_plume.studies import tables
from taichi_plume.studies.store import Store
from test_store import TEXTS, record
folder = Path(sys.argv[1])
tables.write_plan = lambda *_: None
plan = SimpleNamespace(texts=TEXTS, requests=[SimpleNamespace(run=f"{n:016x}") for n in range(100000)])
store = Store(folder)
store.begin(plan)
first = len(store.statuses())
print(first, flush=True)
for n in range(first, 100000):
    store.add([record(f"{n:016x}")])
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="POSIX signals")
def test_killed_at_any_moment(tmp_path, plan):
    """Ten times, at different moments of writing: the runs that are there are whole, and follow one another."""
    held = 0
    path = os.pathsep.join([str(Path(module.__file__).parents[2]), str(Path(__file__).parent)])
    for n in range(10):
        process = subprocess.Popen(
            [sys.executable, "-c", WRITES, str(tmp_path)],
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": path},
        )
        assert process.stdout
        assert int(process.stdout.readline()) == held
        while len(list(tmp_path.glob("parts/*.parquet"))) <= held:
            assert process.poll() is None
        time.sleep(0.0137 * n)
        process.send_signal(signal.SIGKILL)
        process.wait()
        found = [one.run for one in Store(tmp_path).records()]
        assert found == [f"{k:016x}" for k in range(len(found))]
        assert len(found) > held
        held = len(found)
