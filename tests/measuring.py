"""What each file of tests takes: seconds, seconds of the CPU, and kernels that it compiles; on all workers."""

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest


class Measuring:
    """Counts around each test; workers send their counts to the one process that tells them.

    scope: what is counted together, of a test's id.
    """

    def __init__(self, config: pytest.Config, scope: Callable[[str], str], path: Path):
        self.config, self.scope, self.path = config, scope, path
        self.found: dict[
            str, list[float]
        ] = {}  # of a file, or a test that stands alone: seconds, CPU seconds, kernels
        self.compiled = 0  # before Taichi's last start
        self.watched = False

    def kernels(self) -> int:
        """Kernels compiled in this process until now; Taichi forgets them when it starts anew."""
        if "taichi_plume.engine.library" not in sys.modules:
            return 0
        from taichi_plume.engine import program
        from taichi_plume.engine.library import taichi

        if not self.watched:
            self.watched = True
            for name in ("init", "reset"):
                setattr(taichi, name, self.counting(getattr(taichi, name)))
        return self.compiled + program.compiled()

    def counting(self, function):
        """A function of Taichi that forgets kernels, and counts them before."""
        from taichi_plume.engine import program

        def counted(*args, **options):
            self.compiled += program.compiled()
            return function(*args, **options)

        return counted

    def now(self) -> tuple[float, float, int]:
        """Seconds, CPU seconds with those of child processes that ended, and kernels."""
        spent = os.times()
        return time.perf_counter(), sum(spent[:4]), self.kernels()

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item):
        """Counts of a test, with its set-up and what it tears down."""
        before = self.now()
        yield
        counts = self.found.setdefault(self.scope(item.nodeid), [0.0, 0.0, 0])
        for k, (a, b) in enumerate(zip(before, self.now(), strict=True)):
            counts[k] += b - a

    def pytest_sessionfinish(self):
        """A worker sends its counts."""
        output = getattr(self.config, "workeroutput", None)
        if output is not None:
            output["measured"] = self.found

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        """The counts of a worker that ends."""
        for name, counts in getattr(node, "workeroutput", {}).get("measured", {}).items():
            mine = self.found.setdefault(name, [0.0, 0.0, 0])
            mine[:] = [a + b for a, b in zip(mine, counts, strict=True)]

    def pytest_terminal_summary(self, terminalreporter):
        """The table, longest first."""
        if hasattr(self.config, "workeroutput"):
            return
        rows = sorted(self.found.items(), key=lambda row: -row[1][0])
        if self.config.getoption("--keep-durations"):
            kept = json.loads(self.path.read_text()) if self.path.exists() else {}
            kept |= {name: round(seconds, 1) for name, (seconds, _, _) in rows}
            self.path.write_text(json.dumps(kept, indent=1, sort_keys=True, ensure_ascii=False) + "\n")
        terminalreporter.section("seconds, CPU seconds, kernels")
        total = [sum(column) for column in zip(*self.found.values(), strict=True)] or [0, 0, 0]
        for name, (seconds, cpu, kernels) in [*rows, ("all", total)]:
            terminalreporter.write_line(f"{seconds:8.1f} {cpu:8.1f} {kernels:6.0f}  {name}")
