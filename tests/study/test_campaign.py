"""Campaigns whose runs do nothing: what is left when workers, the command, the scheduler or runs fail."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as pq
import pytest

from taichi_plume import __version__
from taichi_plume.engine.choice import ENGINES, VARIABLE, chosen
from taichi_plume.studies.store import Store
from taichi_plume.studies.workers import WorkersError, _require_scheduler, why_unusable

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name == "nt", reason="POSIX signals")]
HERE = Path(__file__).parent
PATHS = [str(HERE.parents[1]), str(HERE)]
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(PATHS)}
ENOUGH = 180.0  # s, for anything, on a busy machine


def command(out: Path, reported: dict, *options: str) -> list[str]:
    return [sys.executable, str(HERE / "fake_study.py"), str(out), json.dumps(reported), *options]


def start(out: Path, reported: dict, *options: str, **more) -> "subprocess.Popen[str]":
    """In a process group of its own, as a shell does."""
    return subprocess.Popen(
        command(out, reported, *options),
        env=ENVIRONMENT | more.pop("env", {}),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **more,
    )


def finish(process: "subprocess.Popen[str]") -> tuple[int, str]:
    """Exit code, and all that was printed."""
    try:
        reported = "".join(process.communicate(timeout=2 * ENOUGH))
    finally:
        if process.poll() is None:
            process.kill()
    assert "Traceback" not in reported, reported
    assert "distributed" not in reported, reported
    return process.returncode, reported


def study(out: Path, reported: dict, *options: str) -> tuple[int, str]:
    return finish(start(out, reported, *options))


def until(true, what: str = "it"):
    """Wait for it."""
    end = time.monotonic() + ENOUGH
    while not (found := true()):
        assert time.monotonic() < end, f"waited for {what}"
        time.sleep(0.02)
    return found


def parts(out: Path) -> int:
    return len(list(out.glob("parts/*.parquet")))


def workers(process: "subprocess.Popen[str]", out: Path) -> list[psutil.Process]:
    """Those that have begun runs and are alive."""
    with suppress(OSError):
        pids = {int(line.split()[1]) for line in (out / "begun.txt").read_text().splitlines()}
        return [one for one in psutil.Process(process.pid).children(recursive=True) if one.pid in pids]
    return []


def table(out: Path) -> list[str]:
    """All that came of the runs but for their costs."""
    return sorted(json.dumps(one[:-1]) for one in Store(out).records())


def left(group: int) -> list[psutil.Process]:
    """What runs in a process group."""
    found = []
    for one in psutil.process_iter():
        with suppress(OSError, psutil.Error):
            if os.getpgid(one.pid) == group and one.status() != psutil.STATUS_ZOMBIE:
                found.append(one)
    return found


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory) -> list[str]:
    """The table of 60 runs that nothing disturbed."""
    out = tmp_path_factory.mktemp("unbroken") / "out"
    assert study(out, {"runs": 60}, "--workers=2")[0] == 0
    return table(out)


def test_killed_and_resumed(tmp_path, unbroken):
    """SIGKILL to a worker, then to the scheduler's process, then Ctrl-C: each run is there once, and all as it was."""
    out = tmp_path / "out"
    reported = {"runs": 60, "structures": 3, "base": {"sleep": 0.2}}
    first = start(out, reported, "--workers=2")
    until(lambda: parts(out) >= 2, "results")
    victim = workers(first, out)[0]
    victim.kill()
    before = parts(out)
    until(lambda: parts(out) >= before + 3, "more after a worker was killed")
    assert any(one.pid != victim.pid for one in workers(first, out))
    first.kill()
    first.communicate()
    until(lambda: not left(first.pid), "the workers of a killed command to end")
    kept = Store(out).statuses()
    assert 0 < len(kept) < 60

    second = start(out, reported, "--workers=2")
    before = parts(out)
    until(lambda: parts(out) > before, "results")
    os.killpg(second.pid, signal.SIGINT)
    code, said = finish(second)
    assert code == 130
    assert "resume" in said
    until(lambda: not left(second.pid), "its processes to end")
    assert kept.keys() < Store(out).statuses().keys()
    assert (
        pq.read_table(out / "runs.parquet")["status"].to_pylist().count("completed") == len(table(out)) < 60
    )

    code, said = study(out, reported, "--workers=2")
    assert code == 0, said
    assert table(out) == unbroken
    runs = Counter(one.run for one in Store(out).records())
    assert runs == {f"{n:016x}": 1 for n in range(60)}
    begun = Counter(line.split()[0] for line in (out / "begun.txt").read_text().splitlines())
    assert sum(begun.values()) < 60 + 3 * 2 * 25  # only what was under way was lost


@pytest.mark.parametrize("names", [["SIGTERM"], ["SIGHUP"], ["SIGINT", "SIGINT"]])
def test_signals(tmp_path, names):
    """As batch systems and terminals send them: to its workers too. A second one ends it at once, without tables."""
    out = tmp_path / "out"
    process = start(out, {"runs": 40, "base": {"sleep": 0.2}}, "--workers=2")
    until(lambda: parts(out) >= 2)
    for name in names:
        os.killpg(process.pid, getattr(signal, name))
        time.sleep(0.03)
    assert finish(process)[0] == 130
    assert len(names) > 1 or (out / "runs.parquet").exists()
    until(lambda: not left(process.pid), "its processes to end")


def test_interrupted_before_the_first_run(tmp_path):
    process = start(tmp_path / "out", {"runs": 4, "base": {"sleep": 5}}, "--workers=1")
    until(lambda: (tmp_path / "out" / "plan.parquet").exists())
    time.sleep(0.3)
    os.killpg(process.pid, signal.SIGINT)
    assert finish(process)[0] == 130
    until(lambda: not left(process.pid), "its processes to end")


def test_interrupted_while_a_scheduler_is_silent(tmp_path):
    """It does not wait for an answer that does not come."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        process = start(tmp_path / "out", {"runs": 4}, f"--scheduler=tcp://127.0.0.1:{port}")
        silent.settimeout(ENOUGH)
        link, _ = silent.accept()
        with link:
            time.sleep(0.3)
            os.killpg(process.pid, signal.SIGINT)
            code, said = finish(process)
    assert code == 130, said
    assert "interrupted; finished runs are kept" in said


def test_failures_are_reported_and_retried(tmp_path):
    """Also those of runs that kill their workers: they alone are blamed, not those beside them."""
    out = tmp_path / "out"
    changes = {"7": {"kills": 99}, "20": {"fail": "it burst"}, "21": {"raise": "odd"}, "30": {"kills": 1}}
    reported = {"runs": 40, "base": {"sleep": 0.01}, "changes": changes}
    code, said = study(out, reported, "--workers=2")
    assert code == 1
    assert "3 runs have failed" in said
    assert "37 of 40 runs are done" in said
    messages = {one.run[-2:]: one.message for one in Store(out).records() if one.status == "failed"}
    assert messages == {
        "07": "worker died 2 times: too little memory? see workers.log", "14": "it burst", "15": "ValueError: odd"
    }  # fmt: skip
    for line in messages.values():
        assert line in said
    assert (out / "failed" / f"{7:016x}" / "message.txt").read_text().strip() == messages["07"]
    begun = (out / "begun.txt").read_text()

    code, said = study(out, reported, "--workers=2")
    assert code == 1
    assert "3 runs have failed" in said
    assert (out / "begun.txt").read_text() == begun

    code, said = study(out, reported | {"changes": {}}, "--workers=2", "--retry")
    assert code == 0, said
    assert set(Store(out).statuses().values()) == {"completed"}
    assert len(pq.read_table(out / "runs.parquet")) == 40


def test_airs_are_filmed_once_and_films_go(tmp_path, unbroken):
    """Six airs, one of which cannot be solved; films at a time are no more than workers and one."""
    out = tmp_path / "out"
    base = {"shared": True, "solve": 0.3, "sleep": 0.02, "bad_airs": ["0004"]}
    code, said = study(out, {"runs": 60, "airs": 6, "structures": 2, "base": base}, "--workers=2")
    assert code == 1
    assert "10 runs have failed" in said
    assert "its air: unstable at t = 1 s" in said
    assert sorted((out / "airs.txt").read_text().splitlines()) == [f"{n:04x} 10" for n in range(6)]
    assert max(map(int, (out / "films.txt").read_text().split())) <= 2  # others, when one was begun
    assert not list((out / "airs").glob("*.zarr"))
    assert len(Store(out).air_records()) == 6
    assert "50 runs and 6 airs" in said
    code, _ = study(
        out,
        {"runs": 60, "airs": 6, "structures": 2, "base": base | {"bad_airs": []}},
        "--retry",
        "--workers=2",
    )
    assert code == 0
    assert [json.loads(line)[:3] for line in table(out)] == [json.loads(line)[:3] for line in unbroken]


def test_a_worker_is_killed_while_it_solves(tmp_path):
    out = tmp_path / "out"
    reported = {"runs": 20, "airs": 2, "base": {"shared": True, "solve": 3.0}}
    process = start(out, reported, "--workers=2")
    until(lambda: (out / "airs.txt").exists() and (out / "airs.txt").read_text().strip())
    for one in psutil.Process(process.pid).children(recursive=True):
        if "resource_tracker" not in " ".join(one.cmdline()):
            one.kill()
    assert finish(process)[0] == 0
    begun = Counter((out / "airs.txt").read_text().splitlines())  # a second worker may not have begun
    assert set(begun) == {"0000 10", "0001 10"}
    assert max(begun.values()) >= 2
    assert len(Store(out).statuses()) == 20


def test_a_full_disk_ends_the_study(tmp_path):
    out = tmp_path / "out"
    code, said = study(out, {"runs": 6, "changes": {"4": {"full": True}}}, "--workers=1")
    assert code == 1
    assert "No space left on device" in said
    assert 0 < len(Store(out).statuses()) < 6
    assert study(out, {"runs": 6}, "--workers=1")[0] == 0


def test_one_command_at_a_time(tmp_path):
    out = tmp_path / "out"
    process = start(out, {"runs": 20, "base": {"sleep": 0.5}}, "--workers=1")
    until(lambda: parts(out) >= 1)
    second = subprocess.run(
        command(out, {"runs": 20}), env=ENVIRONMENT, capture_output=True, text=True, timeout=ENOUGH
    )
    assert "another study is running there" in second.stderr
    os.killpg(process.pid, signal.SIGTERM)
    finish(process)


# ---------------------------------------------------------------- a cluster of others


@contextmanager
def background(line: Sequence[str], **more: Any) -> "Iterator[subprocess.Popen[str]]":
    """A process that is killed in the end, with its children."""
    process = subprocess.Popen([sys.executable, *line], stderr=subprocess.DEVNULL, text=True, **more)
    try:
        yield process
    finally:
        with suppress(psutil.Error):
            for child in psutil.Process(process.pid).children(recursive=True):
                child.kill()
        process.kill()
        process.wait()


def dask(kind: str, folder: Path, *options: str, path: Sequence[str] = PATHS):
    """A scheduler or worker, started by hand."""
    line = ["-m", f"distributed.cli.dask_{kind}", "--host", "127.0.0.1", "--no-dashboard", *options]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path)}
    return background(line, stdout=subprocess.DEVNULL, env=environment, cwd=folder)


@contextmanager
def scheduler(folder: Path, *options: str):
    """A scheduler; yields its process and its address."""
    file = folder / "scheduler.json"
    with dask("scheduler", folder, *options, "--port", "0", "--scheduler-file", str(file)) as process:
        until(file.exists, "the scheduler")
        yield process, until(lambda: read(file), "its address")["address"]


def worker(folder: Path, address: str, *options: str, path: Sequence[str] = PATHS):
    """A worker of a scheduler."""
    return dask("worker", folder, address, "--nthreads", "1", *options, path=path)


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> Iterator[str]:
    """Where a scheduler without workers runs."""
    with scheduler(tmp_path_factory.mktemp("scheduler")) as (_, address):
        yield address


def read(path: Path) -> dict:
    try:
        return json.loads(path.read_text())
    except ValueError:  # half of it is there
        return {}


def test_a_scheduler_started_by_hand(tmp_path, unbroken, address):
    out = tmp_path / "out"
    with worker(tmp_path, address) as first, worker(tmp_path, address) as second:
        code, said = study(out, {"runs": 60, "base": {"sleep": 0.05}}, f"--scheduler={address}")
        assert code == 0, said
        assert "by 2 workers" in said
        assert first.poll() is second.poll() is None  # they are not ours to end
        other = {
            "runs": 5,
            "changes": {"2": {"fail": "of the second study"}},
        }  # which has nothing of the first one's
        code, said = study(tmp_path / "other", other, f"--scheduler={address}")
        assert code == 1
        assert "of the second study" in said
    assert table(out) == unbroken


def test_a_scheduler_file(tmp_path, unbroken):
    """A file that names no scheduler is refused in a line."""
    file, other = tmp_path / "scheduler.json", tmp_path / "other.json"
    other.write_text("[]")
    code, said = study(tmp_path / "out", {"runs": 60}, f"--scheduler={other}")
    assert code == 2
    assert said.splitlines()[-1] == f"--scheduler {other}: is no scheduler file of Dask"
    with scheduler(tmp_path) as (_, address), worker(tmp_path, address):
        code, said = study(tmp_path / "out", {"runs": 60}, f"--scheduler={file}")
    assert code == 0, said
    assert table(tmp_path / "out") == unbroken


def test_its_workers_come_late_and_die(tmp_path, unbroken, address):
    """Where Dask's own rule has it that a run is begun again elsewhere, up to four times."""
    out = tmp_path / "out"
    reported = {"runs": 60, "base": {"sleep": 0.02}, "changes": {"33": {"kills": 1}, "5": {"kills": 1}}}
    process = start(out, reported, f"--scheduler={address}")
    until(lambda: (out / "plan.parquet").exists())
    time.sleep(3)
    assert parts(out) == 0
    with worker(tmp_path, address), worker(tmp_path, address):
        code, said = finish(process)
    assert "no workers there; start one by: dask worker tcp://127.0.0.1" in said
    assert code == 0
    assert table(out) == unbroken


def test_the_scheduler_dies(tmp_path, unbroken):
    out = tmp_path / "out"
    reported = {"runs": 60, "base": {"sleep": 0.2}}
    with scheduler(tmp_path) as (dying, address), worker(tmp_path, address), worker(tmp_path, address):
        process = start(out, reported, f"--scheduler={address}")
        until(lambda: parts(out) >= 3)
        dying.kill()
        code, said = finish(process)
    assert code == 1
    assert "the scheduler is gone" in said
    assert "the study resumes" in said
    assert 0 < len(Store(out).statuses()) < 60
    assert study(out, reported, "--workers=2")[0] == 0
    assert table(out) == unbroken


def test_workers_of_no_use(tmp_path, address):
    """They have no taichi_plume that knows studies: a module of the name hides even one installed from a checkout."""
    other = tmp_path / "other"
    other.mkdir()
    (other / "taichi_plume.py").touch()
    with worker(tmp_path, address, path=[str(other)]):
        code, said = study(tmp_path / "out", {"runs": 3}, f"--scheduler={address}")
    assert code == 2
    assert "has no taichi_plume" in said


def test_workers_that_do_not_see_the_folder(tmp_path):
    """They do not, where its study.yaml is not the same."""
    reported = "name: one"
    assert why_unusable("0.0.1", chosen(), tmp_path, b"", tmp_path).startswith("has taichi_plume")
    assert "does not see the study's folder" in why_unusable(
        __version__, chosen(), tmp_path, reported.encode(), tmp_path
    )
    (tmp_path / "study.yaml").write_text(reported)
    assert why_unusable(__version__, chosen(), tmp_path, reported.encode(), tmp_path) == ""
    assert "does not see the scenario's folder" in why_unusable(
        __version__, chosen(), tmp_path, reported.encode(), tmp_path / "no"
    )


def test_workers_with_another_engine(tmp_path):
    other = next(name for name in ENGINES if name != chosen())
    why = why_unusable(__version__, other, tmp_path, b"", tmp_path)
    assert why == f"computes with {chosen()}, the command with {other}: set {VARIABLE}={other} there"


def test_workers_with_several_threads(tmp_path, address):
    """Taichi is used by one at a time: they take turns, and the user is informed."""
    with worker(tmp_path, address, "--nthreads", "4"):
        code, said = study(tmp_path / "out", {"runs": 12, "base": {"sleep": 0.05}}, f"--scheduler={address}")
    assert code == 0
    assert "start them with --nthreads 1" in said
    times = sorted(
        (one.cost.begun, one.cost.begun + one.cost.total_s) for one in Store(tmp_path / "out").records()
    )
    assert all(end <= begin + 0.01 for (_, end), (begin, _) in pairwise(times))


def test_a_scheduler_with_tls(tmp_path, unbroken):
    """Its certificate and key come from Dask's configuration; without them it is not reached."""
    line = "openssl req -x509 -newkey rsa:3072 -nodes -days 2 -subj /CN=dask -keyout key.pem -out cert.pem"
    subprocess.run(line.split(), cwd=tmp_path, check=True, capture_output=True)
    files = {"ca-file": "cert.pem", "cert": "cert.pem", "key": "key.pem"}
    tls = [text for name, file in files.items() for text in (f"--tls-{name}", str(tmp_path / file))]
    prefix = "DASK_DISTRIBUTED__COMM__TLS__"
    keys = {
        f"{prefix}CA_FILE": str(tmp_path / "cert.pem"),
        f"{prefix}CLIENT__CERT": str(tmp_path / "cert.pem"),
        f"{prefix}CLIENT__KEY": str(tmp_path / "key.pem"),
    }
    with scheduler(tmp_path, *tls) as (_, address), worker(tmp_path, address, *tls):
        assert address.startswith("tls://")
        code, said = study(tmp_path / "without", {"runs": 3}, f"--scheduler={address}")
        assert (code, "no Dask scheduler there" in said) == (2, True), said
        process = start(tmp_path / "out", {"runs": 60}, f"--scheduler={address}", env=keys)
        code, said = finish(process)
        assert code == 0, said
    assert table(tmp_path / "out") == unbroken


@pytest.mark.parametrize("wrong", ["tcp://127.0.0.1:9", "nonsense", "tcp://", "foo://127.0.0.1:1"])
def test_no_scheduler_there(wrong):
    with pytest.raises(WorkersError, match=f"--scheduler {wrong}: no Dask scheduler there") as caught:
        _require_scheduler(wrong)
    assert caught.value.code == 2


def test_a_scheduler_is_found_from_a_running_event_loop(tmp_path, address):
    """A notebook has one."""

    async def require():
        _require_scheduler(address)

    asyncio.run(require())


def test_something_else_there(tmp_path, address):
    """A server of another protocol, and a worker of Dask's."""
    server = ["-u", "-m", "http.server", "0", "--bind", "127.0.0.1"]
    with worker(tmp_path, address) as process, background(server, stdout=subprocess.PIPE) as http:
        assert http.stdout
        other = http.stdout.readline().split("port ")[1].split()[0]
        found = psutil.Process(process.pid)
        ports = until(
            lambda: [
                one.laddr.port
                for process in [found, *found.children()]
                for one in process.net_connections()
                if one.status == psutil.CONN_LISTEN
            ]
        )
        for port in (other, ports[0]):
            code, said = study(tmp_path / "out", {"runs": 3}, f"--scheduler=tcp://127.0.0.1:{port}")
            assert (code, "no Dask scheduler there" in said) == (2, True), said


# ---------------------------------------------------------------- the network

SPY = """
import os, sys
def hook(event, arguments):
    if event in ("socket.connect", "socket.sendto", "socket.bind", "socket.getaddrinfo", "socket.gethostbyname"):
        with open(os.environ["SPIED"], "a") as file:
            file.write(f"{event} {arguments[-1] if event[7:11] != 'geta' else arguments[0]!r}\\n")
sys.addaudithook(hook)
"""


def test_no_sockets(tmp_path):
    """In the command and in its workers, each of which begins with a hook that sees what sockets do."""
    (tmp_path / "sitecustomize.py").write_text(SPY)
    (tmp_path / "spied.txt").touch()
    environment = {
        "PYTHONPATH": os.pathsep.join([str(tmp_path), *PATHS]),
        "SPIED": str(tmp_path / "spied.txt"),
    }
    process = start(tmp_path / "out", {"runs": 20}, "--workers=2", env=environment)
    assert finish(process)[0] == 0
    assert (tmp_path / "spied.txt").read_text() == ""


def test_what_lies_in_the_working_folder_is_not_imported(tmp_path):
    """By the command or its workers, under the names of modules that they import first."""
    for name in ("socket", "random", "logging", "pickle", "tempfile", "yaml", "distributed", "taichi"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('imported from the working folder')")
    process = start(tmp_path / "out", {"runs": 4}, "--workers=1", cwd=tmp_path)
    code, said = finish(process)
    assert code == 0, said
