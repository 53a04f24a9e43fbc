"""Taichi for the tests that ask for it, and the order in which the files run.

A module whose tests launch kernels says ``pytestmark = pytest.mark.usefixtures("taichi")``. It gets a Taichi of its
own, so that its tests share what they compile. What it keeps between them it keeps in fixtures, not in globals or
caches: where its fields become too many, Taichi starts anew between two of its tests, and its fixtures with it.
"""

import json
import os
import sys
from pathlib import Path

import pytest
from measuring import Measuring

TREES = 400  # Taichi's runtime has places for 512 trees of fields and crashes beyond them
DURATIONS = Path(__file__).with_name("durations.json")
SPLIT = "tests/validation/test_cases.py"  # the longest file; its tests share nothing


@pytest.fixture(scope="module")
def taichi():
    """A fresh Taichi on the CPU."""
    import taichi as ti

    from taichi_plume.grid import kernels

    kernels.start("cpu")
    yield
    ti.reset()


def trees() -> int:
    """How many trees of fields Taichi holds: a launch places all fields made since the last one in one of them."""
    impl = sys.modules.get("taichi.lang.impl")
    program = impl.get_runtime().prog if impl else None
    return program.get_snode_tree_size() if program else 0


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """End all that a module holds when Taichi has nearly no place left: its fixtures are then made again."""
    if "taichi" in item.fixturenames and trees() > TREES:
        item.session._setupstate.teardown_exact(item.getparent(pytest.Module).parent)


def pytest_addoption(parser):
    parser.addoption(
        "--kernels", action="store_true", help="tell what each file takes, and kernels it compiles"
    )
    parser.addoption("--keep-durations", action="store_true", help=f"write what it takes to {DURATIONS.name}")


def pytest_configure(config):
    if "PYTEST_XDIST_WORKER" in os.environ:  # a core for each worker
        os.environ.setdefault("TI_CPU_MAX_NUM_THREADS", "1")
    if config.getoption("--kernels") or config.getoption("--keep-durations"):
        config.pluginmanager.register(Measuring(config, DURATIONS))


def pytest_collection_modifyitems(items):
    """Long files first, by what they took, so that no worker is left with one in the end; new files before all."""
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
