"""Taichi for the tests that ask for it, and the order in which the files run.

A module whose tests launch kernels says ``pytestmark = pytest.mark.usefixtures("taichi")``. What its tests share they
share through fixtures of the module, such as a solver that each test begins anew: all then run on one Taichi. A module
without such fixtures gets a fresh Taichi for each test. That is the faster way, as kernels of an object that is built a
second time are compiled a second time, other fields being in them, while after a start they come from the cache.
"""

import json
import os
import sys
from pathlib import Path

import pytest
from measuring import Measuring

import taichi_plume  # noqa: F401  first of all: it keeps Taichi from the network

TREES = 400  # Taichi's runtime has places for 512 trees of fields and crashes beyond them
DURATIONS = Path(__file__).with_name("durations.json")
HELD: set[str] = set()  # names of fixtures that outlive a test
SPLIT = "tests/validation/test_cases.py"  # the longest file; its tests share nothing


@pytest.fixture(scope="module")
def taichi(request):
    """A fresh Taichi, on the CPU unless given."""
    import taichi as ti

    from taichi_plume.engine import program

    program.start(request.config.getoption("--arch"))
    yield
    ti.reset()


def trees() -> int:
    """How many trees of fields Taichi holds: a launch places all fields made since the last one in one of them."""
    impl = sys.modules.get("taichi.lang.impl")
    program = impl.get_runtime().prog if impl else None
    return program.get_snode_tree_size() if program else 0


def pytest_fixture_setup(fixturedef):
    """Note what outlives a test, and may hold fields."""
    if fixturedef.scope in ("class", "module") and fixturedef.argname != "taichi":
        HELD.add(fixturedef.argname)


def pytest_fixture_post_finalizer(fixturedef):
    """It is gone."""
    HELD.discard(fixturedef.argname)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Start Taichi anew, and with it what the module holds, where that is nothing or where hardly a place is left."""
    if "taichi" in item.fixturenames and trees() > (TREES if HELD else 0):
        item.session._setupstate.teardown_exact(item.getparent(pytest.Module).parent)


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
