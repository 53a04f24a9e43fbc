"""A study in shards: the partition, what the shards agree on in their folder, and killed shards."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from fake_study import plan_of
from small_study import ROOM, write
from test_campaign import finish, parts, start, study, until

import taichi_plume as tp
from taichi_plume.cli.study import main
from taichi_plume.guard.input_error import InputError
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.studies import air_plan, tables
from taichi_plume.studies import store as store_module
from taichi_plume.studies.job_queue import JobQueue
from taichi_plume.studies.messages import AirRecord, Cost, Record
from taichi_plume.studies.shards import (
    LOG,
    STALE_S,
    Claims,
    Heart,
    Shard,
    locks,
    log_of,
    parts_of,
    shard_of,
)
from taichi_plume.studies.store import Store, StoreError
from taichi_plume.studies.study_run import Settings, execute, publish

COST = Cost(0.0, 0.0, 0.0, 0, "")
POSIX = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
BY_NATURE = {"costs.parquet", "parts", "airs", "workers.log", ".lock", "begun.txt", "airs.txt", "films.txt"}


def array(**values: object) -> dict[str, str]:
    return {f"SLURM_ARRAY_TASK_{name}": str(value) for name, value in values.items()}


@pytest.mark.parametrize(
    ("given", "environment", "expected"),
    [
        ("3/7", {}, (3, 7)),
        ((7, 7), {}, (7, 7)),
        (True, array(ID=1, COUNT=7), (1, 7)),
        (True, array(ID=0, COUNT=7, MIN=0), (1, 7)),
        (True, array(ID=14, COUNT=4, MIN=5, STEP=3), (4, 4)),
    ],
)
def test_the_shard_of_an_option_or_a_job_array(given, environment, expected):
    assert shard_of(given, environment) == expected


@pytest.mark.parametrize(
    "given",
    [
        "0/7",
        "8/7",
        "a/b",
        "3",
        "1/2/3",
        "-1/7",
        "1/5000",
        pytest.param(f"1/{'9' * 5000}", id="digits"),
        (1.0, 7),
        (0, 7),
        3,
        "²/7",
    ],
)
def test_values_that_are_no_shard(given):
    with pytest.raises(InputError) as caught:
        shard_of(given)
    (line,) = caught.value.lines
    assert line.startswith("shard: got ")
    assert "1 <= k <= n" in line


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({}, "SLURM_ARRAY_TASK_ID is not set"),
        (array(ID=3), "SLURM_ARRAY_TASK_COUNT is not set"),
        (array(ID="x", COUNT=7), "SLURM_ARRAY_TASK_ID: got x"),
        (array(ID=0, COUNT=7), "SLURM_ARRAY_TASK_ID: got 0"),
        (array(ID=8, COUNT=7), "SLURM_ARRAY_TASK_ID: got 8"),
        pytest.param(array(ID="9" * 5000, COUNT=7), "SLURM_ARRAY_TASK_ID: got 9", id="digits"),
        (array(ID=1, COUNT=5000), "SLURM_ARRAY_TASK_COUNT: got 5,000; at most 4,096"),
        (array(ID=2, COUNT=7, STEP=2), "SLURM_ARRAY_TASK_ID: got 2"),
        (array(ID=2, COUNT=7, STEP=0), "SLURM_ARRAY_TASK_STEP: got 0"),
    ],
)
def test_environments_that_are_no_job_array(environment, expected):
    with pytest.raises(InputError) as caught:
        shard_of(True, environment)
    assert expected in caught.value.lines[0]


# ---------------------------------------------------------------- partition


@pytest.fixture
def plan(tmp_path, monkeypatch):
    """Makes plans of fake runs, whose airs can be filmed."""
    monkeypatch.setattr(air_plan, "scenario_of", lambda base, changes: base | changes)
    monkeypatch.setattr(air_plan, "why_not", lambda one, *_: None if one.get("shared") else "no")

    def made(runs: int, airs: int, shared: bool = True):
        return plan_of(tmp_path / "case", {"runs": runs, "airs": airs, "base": {"shared": shared}})

    return made


@pytest.mark.parametrize(
    ("runs", "airs", "count"),
    [(100, 5, 7), (100, 20, 7), (100, 2, 5), (10, 2, 7), (3, 3, 7), (100, 1, 4), (97, 13, 4)],
)
def test_each_run_is_in_one_shard_and_shards_are_of_like_size(plan, runs, airs, count):
    made = plan(runs, airs)
    found = parts_of(made, count)
    numbers = [request.number for part in found for request in part.requests]
    assert sorted(numbers) == list(range(runs))
    assert all(part.requests == tuple(sorted(part.requests, key=lambda one: one.number)) for part in found)
    share, largest = -(-runs // count), -(-runs // airs)
    sizes = [len(part.requests) for part in found]
    assert max(sizes) - min(sizes) <= min(share, largest)
    owners = {air: {k for k, part in enumerate(found) for one in part.requests if one.air == air} for air in
              {one.air for one in made.requests}}  # fmt: skip
    for k, part in enumerate(found):
        assert part.common == {air for air, shards in owners.items() if k in shards and len(shards) > 1}
    if largest <= share:
        assert not any(part.common for part in found)  # an air stays whole
    assert parts_of(plan(runs, airs), count) == found


def test_runs_without_a_shared_air_are_dealt_out_evenly(plan):
    sizes = [len(part.requests) for part in parts_of(plan(100, 3, shared=False), 7)]
    assert sorted(sizes) == [14] * 5 + [15] * 2


# ---------------------------------------------------------------- claims on airs


def claims_of(folder: Path, k: int) -> Claims:
    shard = Shard(k, 3)
    (folder / "airs").mkdir(exist_ok=True)
    (folder / shard.lock).touch()
    return Claims(folder, shard, frozenset({"a"}), Heart(folder / shard.lock))


def test_one_shard_solves_an_air_and_a_killed_one_loses_it(tmp_path):
    first, second, third = (claims_of(tmp_path, k) for k in (1, 2, 3))
    assert first.claim("a")
    assert first.claim("a")
    assert not second.claim("a")
    assert (first.solver("a"), second.solver("a")) == (None, "1-of-3")
    assert claims_of(tmp_path, 1).claim("a")  # the same shard, resumed
    past = time.time() - STALE_S - 1
    os.utime(tmp_path / first.shard.lock, (past, past))
    assert third.solver("a") is None
    assert second.claim("a")
    assert not third.claim("a")
    assert (first.owns("a"), second.owns("a")) == (False, True)
    second.heart.stop()
    assert third.claim("a")


def test_an_air_of_another_shard_is_waited_for(tmp_path, plan):
    """Other runs are executed meanwhile; the runs of the air begin when its film is there."""
    first, second = claims_of(tmp_path, 1), claims_of(tmp_path, 2)
    first.claim("a")
    requests = [one._replace(air=air) for one, air in zip(plan(3, 1).requests, "aab", strict=True)]
    queue = JobQueue(requests, {"a"}, lambda air: tmp_path / "airs" / air, 2, claims=second)
    job = queue.next("", 1)
    assert job is not None
    assert (job.air, job.solve) == ("b", False)
    assert queue.next("", 1) is None
    (tmp_path / "airs" / "a").mkdir()
    job = queue.next("", 1)
    assert job is not None
    assert (job.air, job.solve, job.film) == ("a", False, tmp_path / "airs" / "a")


# ---------------------------------------------------------------- what shards agree on


def begun(folder: Path, plan: SimpleNamespace, shard: Shard | None = None) -> Store:
    store = Store(folder, shard)
    store.begin(plan)  # pyright: ignore[reportArgumentType]
    return store


def test_a_folder_is_of_one_plan_and_one_number_of_shards(tmp_path, plan, monkeypatch):
    monkeypatch.setattr(store_module, "STALE_S", 0.0)  # wait for no merge
    out, made = tmp_path / "out", plan(10, 2)
    with begun(out, made, Shard(1, 3)), begun(out, made, Shard(2, 3)):
        for shard, expected in ((Shard(3, 4), "made in 3 shards, got k/4"), (Shard(2, 3), "shard 2-of-3 is running"),
                                (None, "shards (1-of-3, 2-of-3) are running there")):  # fmt: skip
            with pytest.raises(StoreError, match=f"{out}: ") as caught:
                begun(out, made, shard)
            assert expected in str(caught.value)
            assert "\n" not in str(caught.value)
    with pytest.raises(StoreError, match="holds shards of another study"):
        begun(out, plan(11, 2), Shard(1, 3))
    with begun(tmp_path / "of_one", made) as store:
        store.add([Record(made.requests[9].run, "completed", "", [], {}, COST)])
    with pytest.raises(StoreError, match="add --force, without --shard"):
        begun(tmp_path / "of_one", plan(9, 2), Shard(1, 3))
    begun(tmp_path / "of_one", made, Shard(1, 3)).close()  # the refused study has begun no shards
    with Store(out) as store, pytest.raises(StoreError, match="another study"):
        store.merge(plan(11, 2))
    with begun(out, made), pytest.raises(StoreError, match="a study without shards is running there"):
        begun(out, made, Shard(1, 3))
    begun(out, made, Shard(1, 4)).close()  # the study without shards has ended the three


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--shard", "8/7"], "shard: got 8/7"),
        (["--shard"], "SLURM_ARRAY_TASK_ID is not set"),
        (["--shard", "1/7", "--scheduler", "tcp://a:1"], "shard: cannot go with scheduler"),
        (["--shard", "1/7", "--force"], "shard: cannot go with force"),
        (["--shard", "1/7", "--merge"], "shard: cannot go with merge"),
        (["--merge", "--workers", "2"], "merge: cannot go with workers"),
        (["--merge"], "out: is not the folder of a study"),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys, options, expected):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SLURM_ARRAY_TASK_ID", raising=False)
    write(tmp_path)
    assert main(["study.yaml", "--out", "out", *options]) == 2
    said = capsys.readouterr()
    assert expected in said.err
    assert (said.out + said.err).count("\n") == 1
    assert not (tmp_path / "out").exists()


def recorded(folder: Path, plan: SimpleNamespace, count: int) -> None:
    """All runs of a plan as `count` shards record them."""
    for k, part in enumerate(parts_of(plan, count), 1):  # pyright: ignore[reportArgumentType]
        with begun(folder, plan, Shard(k, count)) as store:
            store.add([Record(one.run, "completed", "", [], {}, COST) for one in part.requests])


def test_a_merge_replaces_records_while_they_are_read(tmp_path, plan, monkeypatch):
    out, made = tmp_path / "out", plan(10, 2)
    recorded(out, made, 3)
    real = store_module._read

    def read(part, names):
        monkeypatch.setattr(store_module, "_read", real)
        with Store(out) as store:
            assert store.merge(made) == 3
        assert not part.exists()
        return real(part, names)

    monkeypatch.setattr(store_module, "_read", read)
    assert list(tp.open_study(out).runs()["status"]) == ["completed"] * 10
    assert parts(out) == 1


def test_tables_are_written_while_they_are_read(tmp_path, plan, monkeypatch):
    out, made = tmp_path / "out", plan(10, 2)
    recorded(out, made, 3)
    publish(out, page=False)
    real = tables.read

    def read(path):
        if path.name == tables.PLAN:
            return real(path)
        monkeypatch.setattr(tables, "read", real)
        (out / "costs.parquet").unlink()
        publish(out, page=False)
        raise FileNotFoundError(2, "No such file or directory", str(path))

    monkeypatch.setattr(tables, "read", read)
    assert list(tp.open_study(out).runs()["status"]) == ["completed"] * 10


def test_a_merge_executes_no_code_of_the_user(tmp_path, plan):
    out, made = tmp_path / "out", plan(10, 2)
    made.base |= {"kind": "own", "file": "zigzag.py"}
    recorded(out, made, 3)
    with pytest.raises(ScenarioError, match="add --allow-code"):
        execute(made, Settings(out, shard=Shard(1, 3), report=False))
    assert execute(made, Settings(out, merge=True, report=False)).status == "completed"


def test_a_shard_waits_for_a_merge(tmp_path, plan, monkeypatch):
    out, made = tmp_path / "out", plan(10, 2)
    recorded(out, made, 3)
    merging = Store(out)
    heart = merging._hold()

    def sleep(_):
        """Meanwhile the merge goes on, without a shard of its folder, and ends."""
        assert not merging.running(heart, locks(out))
        monkeypatch.undo()
        merging.close()
        with merging:
            assert merging.merge(made) == 3

    monkeypatch.setattr(store_module.time, "sleep", sleep)
    with begun(out, made, Shard(1, 3)) as store:
        store.beat()
        assert locks(out) == [Shard(1, 3).lock]


def test_a_failed_air_is_forgotten_while_another_shard_reads(tmp_path, plan, monkeypatch):
    """As two shards with --retry do that start at the same moment."""
    out, made = tmp_path / "out", plan(10, 1)
    with Store(out, Shard(1, 3), {"0000"}) as store:
        store.begin(made)
        store.add_air(AirRecord("0000", 0.0, 0, 0, "unstable"))
        assert store.failure("0000") == "unstable"
        real = store_module.read_regular

        def read(file, *limit):
            file.unlink()
            return real(file, *limit)

        monkeypatch.setattr(store_module, "read_regular", read)
        store.forget_failures({"0000"})
        assert store.failure("0000") == ""


@pytest.mark.parametrize("texts", [("", ""), ("", "a\n"), ("a\n", "b\n")])
def test_logs_of_killed_shards_are_put_together_unless_empty(tmp_path, plan, texts):
    out, made = tmp_path / "out", plan(10, 1)
    for k, text in enumerate(texts, 1):
        begun(out, made, Shard(k, 2)).close()
        (out / log_of(Shard(k, 2).lock)).write_text(text)
    with Store(out) as store:
        store.begin(made)  # the study without shards
    assert (out / LOG).exists() == any(texts)
    assert not any(texts) or (out / LOG).read_text() == "".join(texts)
    assert not list(out.glob("workers.*-of-*"))


# ---------------------------------------------------------------- campaigns


def content(folder: Path) -> dict[str, bytes]:
    """Bytes of all files of a study's folder but those that hold costs and times of day."""
    files = (file for file in folder.rglob("*") if file.is_file())
    found = {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}
    return {name: text for name, text in found.items() if name.split("/")[0] not in BY_NATURE}


def killed(process: subprocess.Popen) -> None:
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


@POSIX
@pytest.mark.slow
def test_shards_killed_and_resumed_give_the_bytes_of_one_run(tmp_path):
    """100 fake runs in 7 shards, which start at the same moment; their folder has another path for half of them."""
    reported = {
        "runs": 100,
        "airs": 5,
        "structures": 2,
        "base": {"shared": True, "solve": 0.5, "sleep": 0.05},
    }
    one, shared, other = tmp_path / "one" / "out", tmp_path / "shared", tmp_path / "other"
    assert study(one, reported, "--workers=2")[0] == 0
    shared.mkdir()
    other.symlink_to(shared)
    ways = [shared / "out", other / "out"]

    def shard(k: int):
        return start(ways[k % 2], reported, f"--shard={k}/7", "--workers=1")

    running = {k: shard(k) for k in range(1, 8)}
    until(lambda: parts(ways[0]) >= 5)
    for k in random.sample(range(1, 8), 3):
        time.sleep(0.5 * random.random())
        killed(running[k])
        running[k] = shard(k)
    runs = tp.open_study(ways[1]).runs()
    assert len(runs) == 100
    assert set(runs["status"]) <= {"completed", "missing"}
    said = [finish(process) for process in running.values()]
    assert [code for code, _ in said] == [0] * 7, said
    assert "of the shard are done" in said[0][1]
    for _ in range(2):  # a merge may be repeated
        code, text = study(ways[0], reported, "--merge")
        assert code == 0, text
        assert content(ways[0]) == content(one)
    assert not [file for file in (ways[0] / "airs").iterdir() if file.suffix != ".json"]
    assert [file.name for file in ways[0].glob(".lock*")] == [".lock"]


@POSIX
@pytest.mark.slow
def test_each_air_is_solved_once_by_a_group_of_shards(tmp_path):
    out, base = tmp_path / "out", {"shared": True, "solve": 2.0, "sleep": 0.02}
    reported = {"runs": 40, "airs": 2, "base": base}
    running = [start(out, reported, f"--shard={k}/5", "--workers=2") for k in range(1, 6)]
    assert [finish(process)[0] for process in running] == [0] * 5
    assert Counter(line.split()[0] for line in (out / "airs.txt").read_text().splitlines()) == {
        "0000": 1,
        "0001": 1,
    }
    assert sorted(file.suffix for file in (out / "airs").iterdir()) == [".json", ".json"]  # no film is left


@POSIX
@pytest.mark.slow
def test_missing_runs_are_reported_and_completed_without_shards(tmp_path):
    """Also where an air cannot be solved, which one shard of its group finds out for all."""
    out, base = tmp_path / "out", {"shared": True, "sleep": 0.02, "bad_airs": ["0000"]}
    reported = {"runs": 40, "airs": 2, "base": base}
    for k in (1, 2, 4):
        assert study(out, reported, f"--shard={k}/5", "--workers=1")[0] in (0, 1)
    assert [line.split()[0] for line in (out / "airs.txt").read_text().splitlines()].count("0000") == 1
    code, said = study(out, reported, "--merge")
    assert code == 1
    assert "16 runs are missing" in said
    assert "3/5 (8 runs), 5/5 (8 runs)" in said
    assert len(tp.open_study(out).runs()) == 40
    code, said = study(out, reported, "--workers=2")
    assert code == 1
    assert "20 runs have failed" in said
    base["bad_airs"] = []
    assert study(out, reported, "--workers=2", "--retry")[0] == 0
    one = tmp_path / "one"
    assert study(one, reported, "--workers=2")[0] == 0
    names = {"runs.parquet", "trials/part-0.parquet"}
    ours, theirs = content(out), content(one)
    assert {name: ours[name] for name in names} == {name: theirs[name] for name in names}


# ---------------------------------------------------------------- simulations, on two nodes


def node(folder: Path, way: Path, name: str) -> dict[str, Any]:
    """Arguments of `Popen` for a shard on a node with its own working folder, temporary folder, home and caches."""
    own = folder / name
    for part in ("tmp", "home", "work"):
        (own / part).mkdir(parents=True)
    environment = {
        "TMPDIR": own / "tmp",
        "HOME": own / "home",
        "XDG_CACHE_HOME": own / "home",
        "HOSTNAME": name,
    }
    environment |= {"PYTHONPATH": Path(str(tp.__file__)).parents[1]}
    line = [
        sys.executable,
        "-m",
        "taichi_plume.study",
        str(way / "study.yaml"),
        "--out",
        str(way / "out"),
        "--quiet",
    ]
    env = os.environ | {key: str(value) for key, value in environment.items()}
    return {"args": line, "cwd": own / "work", "env": env, "start_new_session": True}


def ordered(node: dict[str, Any], *options: str) -> subprocess.Popen:
    """The study's command on a node, in a process group of its own."""
    given = dict(node)
    return subprocess.Popen([*given.pop("args"), *options], **given)


@POSIX
@pytest.mark.slow
def test_simulations_in_shards_on_two_nodes(tmp_path):
    """100 searches in 5 airs, 7 shards on two nodes that share a folder only, three killed at random and resumed."""
    disk, mounted, alone = tmp_path / "disk", tmp_path / "mounted", tmp_path / "alone"
    threshold = {"key": "robots.0.algorithm.threshold_ppm", "values": [1, 2, 3, 5]}
    room = {key: value for key, value in ROOM.items() if key != "maps"}
    for folder in (disk, alone):
        folder.mkdir()
        write(folder, room, axes={"threshold": threshold}, airs=5, searches=5, keep=["robots.parquet"])
    mounted.symlink_to(disk)
    assert ordered(node(tmp_path, alone, "one")).wait() == 0
    nodes = [node(tmp_path, disk, "a"), node(tmp_path, mounted, "b")]

    def shard(k: int) -> subprocess.Popen:
        return ordered(nodes[k % 2], "--shard", f"{k}/7", "--workers", "1")

    running = {k: shard(k) for k in range(1, 8)}
    try:
        while not parts(disk / "out"):
            assert all(process.poll() is None for process in running.values())
            time.sleep(0.1)
        for k in random.sample(range(1, 8), 3):
            time.sleep(3 * random.random())
            killed(running[k])
            running[k] = shard(k)
        assert [process.wait() for process in running.values()] == [0] * 7
    finally:
        for process in running.values():
            if process.poll() is None:
                killed(process)
    assert ordered(nodes[1], "--merge").wait() == 0
    ours, theirs = content(disk / "out"), content(alone / "out")
    assert ours.keys() == theirs.keys()
    assert len([name for name in ours if name.endswith("robots.parquet")]) == 100
    kept = {name for name in ours if name.startswith("kept/") and not name.endswith("robots.parquet")}
    differ = {name for name in ours if ours[name] != theirs[name]}
    assert differ - kept == {"report.html"}  # paths and costs
    for name in kept:
        if name.endswith("result.json"):
            assert plain(ours[name]) == plain(theirs[name])
    shutil.rmtree(disk)


def plain(text: bytes) -> dict:
    """A result.json without the speed of the run."""
    return {
        key: value
        for key, value in yaml.safe_load(text).items()
        if key not in ("wall_s", "Mcell_steps_per_s")
    }
