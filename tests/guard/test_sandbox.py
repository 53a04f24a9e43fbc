"""The process for foreign files: it ends at each of its limits, and with its parent."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest

from taichi_plume.guard.sandbox import MIB, ConfinedError, ConfinedProcess, Limits

LIMITS = Limits(seconds=0.2, memory=64 * MIB)
ENDLESS = "sum(iter(int, 1))"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")


@pytest.fixture
def process() -> Iterator[ConfinedProcess]:
    one = ConfinedProcess("math")
    yield one
    one.close()


def test_it_answers_and_raises(process: ConfinedProcess) -> None:
    array = np.arange(1e5)
    assert (process.call(np.add, array, 1.0) == array + 1.0).all()
    with pytest.raises(ValueError, match="math domain"):
        process.call(eval, "__import__('math').sqrt(-1)")
    with pytest.raises(TypeError, match="pickle"):  # what cannot be sent
        process.call(eval, "(n for n in ())")
    assert process.call(eval, "print('noise') or 3") == 3


def test_it_may_be_busy_for_its_time_only(process: ConfinedProcess) -> None:
    for _ in range(3):  # the limit is that of a call
        process.call(eval, "sum(range(100_000))", limits=LIMITS)
    with pytest.raises(ConfinedError, match="takes more than 0 s of computing time"):
        process.call(eval, ENDLESS, limits=LIMITS)
    with pytest.raises(ConfinedError, match="has ended"):
        process.call(eval, "1")


def test_it_may_wait_for_a_while_only(process: ConfinedProcess) -> None:
    with pytest.raises(ConfinedError, match="takes more than 0 s"):
        process.call(time.sleep, 60, limits=LIMITS)


def test_memory_is_limited(process: ConfinedProcess) -> None:
    with pytest.raises(ConfinedError, match="needs more than 64 MiB of memory"):
        process.call(eval, f"len(bytearray({80 * MIB}))", limits=LIMITS)
    assert process.call(eval, f"len(bytearray({16 * MIB}))", limits=LIMITS) == 16 * MIB


def test_files_are_limited(process: ConfinedProcess, tmp_path) -> None:
    file = tmp_path / "a"
    assert process.call(eval, f"open({str(file)!r}, 'wb').write(b'a')") == 1
    with pytest.raises(OSError, match="Too many open files"):
        process.call(eval, f"open({str(file)!r}, 'rb')", limits=LIMITS)
    other = ConfinedProcess()
    limits = Limits(1.0, 64 * MIB, opens=True)
    assert other.call(eval, f"open({str(file)!r}, 'rb').read()", limits=limits) == b"a"
    with pytest.raises(OSError, match="File too large"):
        other.call(eval, f"open({str(file)!r}, 'ab', 0).write(b'a')", limits=limits)
    other.close()


def test_a_crash_is_reported(process: ConfinedProcess) -> None:
    with pytest.raises(ConfinedError, match="SIGABRT"):
        process.call(os.abort)


@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGINT])
def test_it_ends_with_its_parent(ending: signal.Signals) -> None:
    text = """if True:
    from taichi_plume.guard.sandbox import ConfinedProcess
    one = ConfinedProcess()
    print(one.call(eval, "__import__('os').getpid()"), flush=True)
    one.call(eval, "any(n > 0 for n in iter(int, 1))")
    """
    parent = subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert parent.stdout
    number = int(parent.stdout.readline())
    time.sleep(0.2)
    parent.send_signal(ending)
    assert parent.wait(20) != 0
    deadline = time.monotonic() + 20.0
    while os.path.exists(f"/proc/{number}") and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not os.path.exists(f"/proc/{number}")
