"""Fields: types and shapes of those that are filled when made, and copies of their values."""

import numpy as np
import pytest

from taichi_plume.engine import fields, program, ti

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.mark.parametrize(
    ("values", "dtype", "filled"),
    [
        (0.1, None, (ti.f32, ())),
        ([1, -2, 2**31 - 1], None, (ti.i32, (3,))),
        (np.array([[True, False]]), None, (ti.i32, (1, 2))),
        (np.random.default_rng(1).normal(size=(2, 3, 4)), None, (ti.f32, (2, 3, 4))),
        ([1 / 3, 1e-300], ti.f64, (ti.f64, (2,))),
        ([2**32 - 1, 5], ti.u32, (ti.u32, (2,))),
        ([3, 4], ti.f32, (ti.f32, (2,))),
    ],
)
def test_a_filled_field_has_the_values_and_their_type(values, dtype, filled):
    field = ti.filled(values, dtype)
    assert (field.dtype, field.shape) == filled
    found = field.to_numpy()
    np.testing.assert_array_equal(found, np.asarray(values).astype(found.dtype))
    field.fill(0)
    assert found.any(), "a copy keeps its values"


def test_filled_vectors_are_the_last_axis():
    rows = np.arange(12.0).reshape(2, 3, 2)
    field = ti.filled_vectors(rows)
    assert (field.n, field.shape) == (2, (2, 3))
    np.testing.assert_array_equal(field.to_numpy(), rows)
    assert (ti.filled_vectors([1, 2, 3]).n, ti.filled_vectors([1, 2, 3]).shape) == (3, ())


def test_an_empty_list_becomes_one_zero():
    assert ti.filled([]).to_numpy().tolist() == [0.0]
    assert ti.filled_vectors(np.zeros((0, 2), int)).to_numpy().tolist() == [[0, 0]]


@ti.kernel
def shift(whole: ti.template(), real: ti.template(), pair: ti.template(), by: float):
    for i in range(whole.shape[0]):
        for j in range(whole.shape[1]):
            whole[i, j] = whole[i, j] + 1  # no +=, which lavapipe miscounts
            real[i] = real[i] + by
        pair[i] = ti.Vector([pair[i][1], pair[i][0]])


def beside_others(rows, columns):
    """Fields of whole numbers, reals and pairs, each with another of its type before and behind."""
    with ti.shared_memory():
        first = [ti.filled([7] * 3), ti.filled([0.5] * 3), ti.filled_vectors([[1.0, 2.0]] * 3)]
        whole = ti.filled(np.arange(rows * columns).reshape(rows, columns))
        real, pair = ti.filled(np.arange(rows) / 4), ti.vector_field(2, ti.f32, rows)
        pair.from_numpy(np.arange(2.0 * rows).reshape(rows, 2))
        real[1] = 9.0
        last = [ti.filled([8] * 3), ti.filled([1.5] * 3), ti.filled_vectors([[3.0, 4.0]] * 3)]
    return first, (whole, real, pair), last


@pytest.mark.parametrize("shared", [False, True])
def test_fields_beside_others_in_shared_memory_are_read_and_set_alone(shared, monkeypatch):
    monkeypatch.setattr(fields, "memory_is_shared", lambda: shared)
    for rows, columns in ((40, 30), (5, 30), (2, 1)):  # more and fewer numbers than are uploaded at once
        first, (whole, real, pair), last = beside_others(rows, columns)
        assert len({id(one.block) for one in (*first, whole, real, pair, *last)}) == (3 if shared else 1)
        numbers, reals = np.arange(rows * columns).reshape(rows, columns), np.arange(rows) / 4
        reals[1], pairs = 9.0, np.arange(2.0 * rows).reshape(rows, 2)
        for field, expected in ((whole, numbers), (real, reals), (pair, pairs)):
            np.testing.assert_array_equal(field.to_numpy(), expected)
            field.from_numpy(2 * expected)
        before = program.compiled()
        shift(whole, real, pair, 0.5)
        assert program.compiled() == before + (rows == 40)
        np.testing.assert_array_equal(whole.to_numpy(), 2 * numbers + 1)
        np.testing.assert_array_equal(real.to_numpy(), 2 * reals + 0.5 * columns)
        np.testing.assert_array_equal(pair.to_numpy(), 2 * pairs[:, ::-1])
        real.copy_from(ti.filled(reals, ti.f32))
        assert (real[1], real[0]) == (9.0, 0.0)
        whole.fill(-3)
        whole[1, 0] = 4
        assert np.unique(whole.to_numpy()).tolist() == [-3, 4]
        kept = [one.to_numpy().ravel().tolist() for one in (*first, *last)]
        assert kept == [[7] * 3, [0.5] * 3, [1.0, 2.0] * 3, [8] * 3, [1.5] * 3, [3.0, 4.0] * 3]


def test_a_kernel_may_use_new_fields_before_the_context_ends(monkeypatch):
    monkeypatch.setattr(fields, "memory_is_shared", lambda: True)
    with ti.shared_memory():
        whole, real = ti.filled([[1], [2]]), ti.filled([0.5, 0.25])
        with ti.shared_memory():
            pair = ti.filled_vectors([[1.0, 2.0], [3.0, 4.0]])
        assert pair.block is None  # still
        shift(whole, real, pair, 1.0)
        other = ti.filled([3.0])
    assert whole.to_numpy().tolist() == [[2], [3]]
    assert pair.to_numpy().tolist() == [[2.0, 1.0], [4.0, 3.0]]
    assert other.to_numpy().tolist() == [3.0]
    assert other.block is not real.block is not None


def test_fields_with_a_contiguous_first_axis_and_later_ones_have_their_own_memory(monkeypatch):
    monkeypatch.setattr(fields, "memory_is_shared", lambda: True)
    with ti.shared_memory():
        plane = ti.field(ti.f32, (3, 2), order="ji")
        line = ti.field(ti.f32, 3)
    with pytest.raises(ZeroDivisionError), ti.shared_memory():
        _ = 1 / 0
    later = ti.field(ti.f32, 3)
    assert (plane.block, later.block) == (None, None)
    assert line.block is not None
