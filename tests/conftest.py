"""Every module of tests starts with a fresh Taichi on the CPU: fields of the one before are freed."""

import pytest

from taichi_plume.grid import kernels


@pytest.fixture(autouse=True, scope="module")
def taichi():
    kernels.start("cpu")
