"""Taichi for the tests that ask for it.

A module whose tests launch kernels says ``pytestmark = pytest.mark.usefixtures("taichi")``. It gets a Taichi of its
own, so that its tests share what they compile. What it keeps between them it keeps in fixtures, not in globals or
caches: where its fields become too many, Taichi starts anew between two of its tests, and its fixtures with it.
"""

import os
import sys

import pytest

TREES = 400  # Taichi's runtime has places for 512 trees of fields and crashes beyond them


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


def pytest_configure():
    if "PYTEST_XDIST_WORKER" in os.environ:  # a core for each worker
        os.environ.setdefault("TI_CPU_MAX_NUM_THREADS", "1")
