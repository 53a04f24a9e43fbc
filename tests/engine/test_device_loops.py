"""Parallel loops as a GPU gets them, built for the CPU: every index of a range once, whatever its length."""

import numpy as np
import pytest

from taichi_plume.engine import device_loops, ti
from taichi_plume.engine.device_loops import THREADS
from taichi_plume.grid import kernels
from taichi_plume.grid.kernels import Pass, each, launch, together

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(autouse=True)
def on_device(monkeypatch):
    """Kernels that are built now, all of this file alone, are those of a device."""
    monkeypatch.setattr(device_loops, "on_cpu", lambda: False)
    monkeypatch.setattr(kernels, "on_cpu", lambda: False)


class Loops:
    """Counts of how often loops visit each cell: of a range, a plane and a room."""

    def __init__(self, shape=(7, 5, 9)):
        self.line = ti.field(ti.i32, 2 * THREADS + 77)
        self.plane = ti.field(ti.i32, shape[:2])
        self.room = ti.field(ti.i32, shape)
        self.total = ti.field(ti.i32, ())
        self.threads = ti.field(ti.i32, THREADS)

    @ti.kernel
    def along(self, begin: int, end: int):
        for n in range(begin, end):
            self.line[n] += n + 1

    @ti.kernel
    def over_plane(self, i0: int, i1: int, j0: int, j1: int):
        for i, j in ti.ndrange((i0, i1), (j0, j1)):
            self.plane[i, j] += 100 * i + j + 1

    @ti.kernel
    def over_room(self, i0: int, i1: int, j0: int, j1: int, k: int):
        for I in ti.grouped(ti.ndrange((i0, i1), (j0, j1), k)):
            self.room[I] += 100 * I[0] + 10 * I[1] + I[2] + 1

    @ti.kernel
    def sum_of_odd(self, end: int) -> int:
        self.total[None] = 0
        for n in range(end):
            if n % 2 == 0:
                continue
            self.total[None] += n
        return self.total[None]

    @ti.func
    def _up_to(self, end, step):
        for n in range(end):
            self.line[n] += step

    @ti.kernel
    def twice_in_a_function(self, end: int, step: int):
        self._up_to(end, step)
        self._up_to(end // 2, step)

    @ti.kernel
    def if_wanted(self, wanted: int, end: int):
        if wanted == 1:
            for n in range(end):
                self.line[n] += 1

    @ti.kernel
    def beside_a_branch(self, wanted: int, end: int):
        for n in range(end):
            if wanted == 0:
                self.line[n] += 1

    @ti.kernel
    def strides(self, end: int):
        for n in range(end):
            self.threads[n % THREADS] += 1
            for m in range(n % 3):
                self.line[n] += m + 1


@pytest.fixture
def loops():
    return Loops()


@pytest.mark.parametrize(
    ("begin", "end"), [(0, 1), (3, 3), (9, 4), (5, 1000), (THREADS - 1, THREADS + 1), (70, 2 * THREADS + 77)]
)
def test_a_range_is_visited_once(loops, begin, end):
    loops.along(begin, end)
    n = np.arange(len(loops.line.values))
    np.testing.assert_array_equal(loops.line.values, np.where((n >= begin) & (n < end), n + 1, 0))


@pytest.mark.parametrize(("i", "j"), [((0, 7), (0, 5)), ((2, 6), (1, 3)), ((2, 2), (0, 5)), ((5, 3), (4, 2))])
def test_planes_and_rooms_have_begins(loops, i, j):
    loops.over_plane(*i, *j)
    loops.over_room(*i, *j, 8)
    inner = slice(*i), slice(*j)
    plane, room = np.zeros((7, 5), int), np.zeros((7, 5, 9), int)
    plane[inner] = sum(np.indices(plane.shape) * np.array([100, 1]).reshape(2, 1, 1))[inner] + 1
    indices = np.indices(room.shape) * np.array([100, 10, 1]).reshape(3, 1, 1, 1)
    room[(*inner, slice(8))] = sum(indices)[(*inner, slice(8))] + 1
    np.testing.assert_array_equal(loops.plane.values, plane)
    np.testing.assert_array_equal(loops.room.values, room)


@pytest.mark.parametrize("end", [0, 11, THREADS // 8])
def test_continue_leaves_an_index_out_of_a_sum(loops, end):
    assert loops.sum_of_odd(end) == (end // 2) ** 2 % 2**32


def test_a_loop_in_a_function_takes_the_kernels_argument(loops):
    loops.twice_in_a_function(101, 3)
    np.testing.assert_array_equal(loops.line.values[:102], [6] * 50 + [3] * 51 + [0])


def test_a_loop_in_a_branch_stays_as_it_is(loops, monkeypatch):
    built, plain = [], device_loops._build_threads
    monkeypatch.setattr(
        device_loops, "_build_threads", lambda ctx, node, ends: built.append(node) or plain(ctx, node, ends)
    )
    for wanted in (0, 1):
        loops.if_wanted(wanted, 9)
        assert loops.line.values[:10].tolist() == [wanted] * 9 + [0]
    assert not built
    loops.beside_a_branch(0, 4)
    assert len(built) == 1
    assert loops.line.values[:5].tolist() == [2, 2, 2, 2, 1]


def test_threads_take_neighbouring_indices_and_stride_over_the_range(loops):
    end = THREADS + 7
    loops.strides(end)
    np.testing.assert_array_equal(loops.threads.values, np.where(np.arange(THREADS) < 7, 2, 1))
    np.testing.assert_array_equal(loops.line.values[:end], np.array([0, 1, 3])[np.arange(end) % 3])
    assert not loops.line.values[end:].any()


class Steps:
    """Passes over fields of different lengths, each of which reads what is given alone."""

    def __init__(self):
        rng = np.random.default_rng(3)
        self.given = ti.filled(rng.normal(size=40))
        self.made = tuple(ti.field(ti.f32, n) for n in (40, 1, 17))

    @ti.func
    def scaled(self, n, a, b):
        self.made[0][n] = a * self.given[n] + b

    @ti.func
    def first(self, n, a, b):
        self.made[1][n] = self.given[n] - b

    @ti.func
    def squared(self, n, a, b):
        self.made[2][n] += self.given[n] * self.given[n]

    def passes(self) -> list[Pass]:
        return [each(self.scaled, 40), each(self.first, 1), each(self.squared, 17)]


def test_passes_together_are_one_loop_that_does_what_they_do_one_after_another():
    apart, joined = Steps(), Steps()
    one = together(joined.passes())
    assert len(one) == 1
    assert one[0].cells == 58
    apart_run, joined_run = launch(*apart.passes()), launch(*one)
    for a, b in ((2.0, 0.5), (-1.0, 3.0)):
        apart_run(a, b)
        joined_run(a, b)
    for expected, found in zip(apart.made, joined.made, strict=True):
        np.testing.assert_array_equal(found.values, expected.values)
    given = apart.given.values
    np.testing.assert_allclose(joined.made[0].values, 3.0 - given, rtol=1e-6)
    np.testing.assert_allclose(joined.made[2].values, 2.0 * given[:17] ** 2, rtol=1e-6)
    assert joined.made[1][0] == pytest.approx(given[0] - 3.0)
