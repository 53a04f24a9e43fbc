"""Taichi for the tests that ask for it, and the order in which the files run.

A module whose tests launch kernels says ``pytestmark = pytest.mark.usefixtures("taichi")``. Kernels are compiled once
for all tests of a process.
"""

import json
import os
from pathlib import Path

import pytest
from measuring import Measuring

import taichi_plume  # noqa: F401  first of all: it keeps Taichi from the network

DURATIONS = Path(__file__).with_name("durations.json")
SPLIT = "tests/validation/test_cases.py"  # the longest file; its tests share nothing


@pytest.fixture(scope="module")
def taichi(request):
    """Taichi, on the CPU unless given, with the kernels of earlier modules."""
    from taichi_plume.engine import program

    program.start(request.config.getoption("--arch"))


def pytest_addoption(parser):
    parser.addoption(
        "--arch", default="cpu", help="where tests that launch kernels themselves do it, such as cuda"
    )
    parser.addoption(
        "--kernels", action="store_true", help="tell what each file takes, and kernels it compiles"
    )
    parser.addoption("--keep-durations", action="store_true", help=f"write what it takes to {DURATIONS.name}")


def pytest_configure(config):
    if "PYTEST_XDIST_WORKER" in os.environ:  # a core for each worker
        os.environ.setdefault("TI_CPU_MAX_NUM_THREADS", "1")
        os.environ.setdefault("QD_CPU_MAX_NUM_THREADS", "1")
    if config.getoption("--kernels") or config.getoption("--keep-durations"):
        config.pluginmanager.register(Measuring(config, scope, DURATIONS))


def pytest_collection_modifyitems(config, items):
    """Long files first, by what they took, so that no worker is left with one in the end; new files before all."""
    if config.getoption("--arch") != "cpu":
        for item in items:
            if item.get_closest_marker("cpu"):
                item.add_marker(pytest.mark.skip(reason="of a CPU alone"))
    took = json.loads(DURATIONS.read_text())
    items.sort(key=lambda item: -took.get(scope(item.nodeid), float("inf")))


def scope(nodeid: str) -> str:
    """What one worker runs without a break: a file, but of the longest a test."""
    file = nodeid.partition("::")[0]
    return nodeid if file == SPLIT else file


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """`--dist loadfile`, in our order, with the longest file split."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid):
            return scope(nodeid)

    return Scheduling(config, log) if config.getvalue("dist") == "loadfile" else None


@pytest.fixture
def drawn(monkeypatch) -> list:
    """Return the list of figures that would have become pictures."""
    from taichi_plume.report import theme

    made: list = []
    monkeypatch.setattr(theme, "png", lambda figure: made.append(figure) or b"png")
    return made
