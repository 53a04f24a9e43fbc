"""Kernels: their launches, and what Taichi says of a faulty one."""

import pytest
import taichi as ti

from taichi_plume.grid import kernels
from taichi_plume.grid.kernels import Pass, launch

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


def test_every_launch_takes_its_own_numbers_and_runs_the_passes_in_order():
    seen = ti.field(ti.f32, (3, 2))
    count = ti.field(ti.i32, ())

    @ti.func
    def keep(a, b):
        seen[count[None], 0] = a
        seen[count[None], 1] = b

    @ti.func
    def go_on(a, b):
        count[None] += 1

    run = launch(Pass(keep, 1), Pass(go_on, 1))
    for numbers in ((1.5, -2.0), (), (3, 4)):
        run(*numbers)
    assert seen.to_numpy().tolist() == [[1.5, -2.0], [0.0, 0.0], [3.0, 4.0]]


def test_a_device_that_there_is_not_is_told_before_anything_starts():
    with pytest.raises(RuntimeError, match="got 'abacus', allowed are auto, cpu, cuda, vulkan, metal"):
        kernels.start("abacus")
