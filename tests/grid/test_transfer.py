"""Fields filled and read in one launch, numbers that kernels read when they run, and the state of components."""

from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti

from taichi_plume.grid import memory
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import compiled, double_field
from taichi_plume.grid.state import State
from taichi_plume.grid.transfer import Numbers, reader, uploader

pytestmark = pytest.mark.usefixtures("taichi")


def fields() -> tuple:
    return (
        ti.field(ti.f32, ()),
        ti.field(ti.i32, 3),
        ti.Vector.field(2, ti.f32, 4),
        ti.Vector.field(1, ti.f32, 3),
        ti.field(ti.f32, (2, 3, 4), order="kji"),
        double_field((2,)),
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


@pytest.fixture(params=["in place", "by kernels"])
def way(request, monkeypatch):
    """Copy numbers as on the CPU, or as on a GPU."""
    if request.param == "by kernels":
        monkeypatch.setattr(memory, "on_cpu", lambda: False)


@pytest.mark.usefixtures("way")
def test_what_is_uploaded_is_read_back_and_compiles_once(taichi):
    several = fields()
    put, get = uploader(*several), reader(*several)
    put(*(0 for _ in several))
    get()
    before = compiled()
    put(*ARRAYS)
    for array, found, field in zip(ARRAYS, get(), several, strict=True):
        assert found.dtype == array.dtype
        np.testing.assert_array_equal(found, array)
        assert compiled() == before or np.array_equal(field.to_numpy(), array)
        before = -1
    with pytest.raises(TypeError, match="7 fields, 1 arrays"):
        put(1)


def test_numbers_are_read_when_a_kernel_runs(taichi):
    n = Numbers("a", "b")

    @ti.kernel
    def product() -> ti.f32:
        return n.a[None] * n.b[None]

    n.set(a=2, b=3)
    assert product() == 6
    before = compiled()
    n.set(b=5)
    assert (product(), n["a"], n["b"], compiled()) == (10, 2.0, 5.0, before)
    with pytest.raises(KeyError, match="c"):
        n.set(c=1)


@pytest.mark.cpu
def test_fields_of_every_layout_are_reached_in_place(taichi):
    """Taichi reads the values written in place, and only the kernel for the address is compiled."""
    several = (*fields(), ti.field(ti.f64, (2, 3)), ti.Vector.field(3, ti.f32, (1, 2), order="ji"))
    before = compiled()
    places = memory.views(several)
    assert places is not None
    assert compiled() == before + 2  # of two trees
    draws = np.random.default_rng(3)
    for place in places:
        place[...] = draws.integers(0, 1000, place.shape)
    for place, field in zip(places, several, strict=True):
        np.testing.assert_array_equal(place, field.to_numpy())
    assert memory.view(several[0]) is places[0]
    assert memory.view(ti.Matrix.field(2, 2, ti.f32, 3)) is None
    blocked = ti.field(ti.f32)
    ti.root.dense(ti.i, 2).dense(ti.i, 3).place(blocked)
    assert memory.view(blocked) is None


@pytest.mark.usefixtures("way")
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


@pytest.mark.usefixtures("way")
def test_a_state_is_saved_restored_and_cleared(taichi):
    scalar, *several = fields()
    inner = SimpleNamespace(STATE=("fields", "count"), fields=tuple(several), count=3)

    class Part:
        STATE = ("scalar", "parts", "draws", "log")

    part = Part()
    part.scalar, part.parts, part.log, part.draws = scalar, [inner], [1.0], np.random.default_rng(2)
    put, get = uploader(scalar, *several), reader(scalar, *several)
    put(*ARRAYS)
    state = State(part)
    saved = state.save()
    after = part.draws.random(), part.log.append(2.0)
    inner.count = 5
    state.clear()
    assert all(not values.any() for values in get())
    state.restore(saved)
    assert (part.draws.random(), part.log, inner.count) == (after[0], [1.0], 3)
    for array, found in zip(ARRAYS, get(), strict=True):
        np.testing.assert_array_equal(found, array)
