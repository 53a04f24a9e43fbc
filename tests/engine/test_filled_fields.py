"""Fields: types and shapes of those that are filled when made, and copies of their values."""

import numpy as np
import pytest

from taichi_plume.engine import ti

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
