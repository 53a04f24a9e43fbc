"""Inner cells of fields of a grid, and the state of components."""

from types import SimpleNamespace

import numpy as np
import pytest

from taichi_plume.engine import ti
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.state import State

pytestmark = pytest.mark.usefixtures("taichi")


def fields() -> tuple:
    return (
        ti.field(ti.f32, ()),
        ti.field(ti.i32, 3),
        ti.vector_field(2, ti.f32, 4),
        ti.vector_field(1, ti.f32, 3),
        ti.field(ti.f32, (2, 3, 4), order="kji"),
        ti.field(ti.f64, 2),
        ti.field(ti.u32, 2),
    )


ARRAYS = (
    np.float32(0.1),
    np.array([1, -2, 2**31 - 1], np.int32),
    np.arange(8, dtype=np.float32).reshape(4, 2),
    np.array([[0.5], [1.5], [2.5]], np.float32),
    np.random.default_rng(1).normal(size=(2, 3, 4)).astype(np.float32),
    np.array([1 / 3, 1e-300]),
    np.array([2**32 - 1, 5], np.uint32),
)


def test_a_grid_reads_and_writes_its_inner_cells(taichi):
    grid = Grid(shape=(4, 3), dx=0.1)
    values = np.arange(12, dtype=np.float32).reshape(4, 3)
    field = grid.field()
    grid.write(field, values)
    grid.write(field, values[1:3, 1:2], margin=-1)
    found = grid.read(field)
    assert found.flags.f_contiguous
    np.testing.assert_array_equal(found, values)
    np.testing.assert_array_equal(grid.read(field, 1)[1:-1, 1:-1], values)
    assert grid.read(field, 1).sum() == values.sum()


def test_a_state_is_saved_restored_and_cleared(taichi):
    scalar, *several = fields()
    inner = SimpleNamespace(STATE=("fields", "count"), fields=tuple(several), count=3)

    class Part:
        STATE = ("scalar", "parts", "draws", "log")

    part = Part()
    part.scalar, part.parts, part.log, part.draws = scalar, [inner], [1.0], np.random.default_rng(2)
    for field, array in zip((scalar, *several), ARRAYS, strict=True):
        field.from_numpy(array)
    state = State(part)
    saved = state.save()
    after = part.draws.random(), part.log.append(2.0)
    inner.count = 5
    for field in (scalar, *several):
        field.fill(0)
    state.restore(saved)
    assert (part.draws.random(), part.log, inner.count) == (after[0], [1.0], 3)
    for field, array in zip((scalar, *several), ARRAYS, strict=True):
        np.testing.assert_array_equal(field.to_numpy(), array)
