"""Faster tracing of kernels: all replacements are active, and traced code is the same."""

import numpy as np
import pytest

from taichi_plume.engine import library, ti, tracing
from taichi_plume.grid.kernels import Template

pytestmark = pytest.mark.usefixtures("taichi")


def test_all_changes_are_in_force():
    assert len(tracing.QUICKENED) == 4 + len(library.SOURCE_READERS)
    assert all(tracing.QUICKENED)


def test_a_function_that_is_not_as_expected_stays():
    class Other:
        def get_pos_info(self, node, more):
            return more

    before = Other.get_pos_info
    assert not tracing.replace(Other, "get_pos_info", ("self", "node"), tracing.position)
    assert not tracing.replace(Other, "missing", ("self", "node"), tracing.position)
    assert Other.get_pos_info is before


def adder(n: int):
    @ti.func
    def add(x):
        return x + n

    return add


@ti.func
def power(x, n: Template):
    y = x
    if ti.static(n > 1):
        y = x * power(x, n - 1) + power(x, 1) - x
    return y


class Twice:
    @ti.func
    def of(self, x):
        return 2 * x

    @ti.kernel
    def run(self, x: int) -> int:
        return self.of(x)


def test_functions_of_one_source_stay_apart():
    """A source that is read once serves functions made anew, functions that call themselves, and methods."""
    one, ten = adder(1), adder(10)

    @ti.kernel
    def several(x: int) -> ti.types.vector(3, int):  # type: ignore[valid-type]
        return ti.Vector([one(x), ten(x), power(x, 4)])

    np.testing.assert_array_equal(several(3), [4, 13, 81])
    assert Twice().run(4) == 8


def test_a_fault_in_a_function_is_reported_by_both_places():
    @ti.func
    def broken(x):
        return x.nothing_of_the_kind(3)

    @ti.kernel
    def faulty():
        for i in range(3):
            broken(i)

    with pytest.raises(library.CompilationError) as reported:
        faulty()
    for line in ("broken(i)", "return x.nothing_of_the_kind(3)", "test_tracing.py", "in faulty", "in broken"):
        assert line in str(reported.value)
