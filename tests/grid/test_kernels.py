"""Kernels: what Taichi says of a faulty one."""

import pytest
import taichi as ti

pytestmark = pytest.mark.usefixtures("taichi")


def test_a_fault_in_a_kernel_is_told_with_its_file_and_line():
    @ti.kernel
    def faulty():
        for i in range(3):
            missing[i] = 1.0  # noqa: F821  # type: ignore[name-defined]

    with pytest.raises(ti.TaichiNameError) as told:
        faulty()
    assert "test_kernels.py" in str(told.value)
    assert "missing[i] = 1.0" in str(told.value)
