"""Every test starts with a fresh Taichi on the CPU: fields of the test before are freed."""

import pytest

from taichi_plume.grid import kernels


@pytest.fixture(autouse=True)
def taichi():
    kernels.start("cpu")
