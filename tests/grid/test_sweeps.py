"""Sweeps beside NumPy, on rows that strips and panels divide in every way, as on a CPU, with few cells and
with many, and as on a GPU."""

from functools import partial

import numpy as np
import pytest

from taichi_plume.engine import ti
from taichi_plume.engine.fields import LANES
from taichi_plume.grid import sweeps
from taichi_plume.grid.kernels import launch
from taichi_plume.grid.sweeps import PANEL, flux_sweep, sweep

pytestmark = pytest.mark.usefixtures("taichi")

LENGTHS = [4, LANES + 2, 2 * LANES + 3, PANEL * LANES + 2, PANEL * LANES + LANES + 7]
SHAPES = [*((n, 6) for n in LENGTHS), (4, 21), *((n, 6, 5) for n in LENGTHS[:4]), (4, 11, 5)]
UNSET = -7.0


@pytest.fixture(params=["cpu", "cpu_of_many_cells", "gpu"], autouse=True)
def machine(request, monkeypatch):
    monkeypatch.setattr(sweeps, "on_cpu", lambda: request.param != "gpu")
    if request.param == "cpu_of_many_cells":  # then threads divide the strips and parts
        monkeypatch.setattr(sweeps, "FEW_CELLS", 0)


def filled(shape, seed):
    field = ti.field(ti.f32, shape, order="kji"[-len(shape) :])
    field.from_numpy(np.random.default_rng(seed).standard_normal(shape))
    return field, field.to_numpy().astype(float)


def unset(shape):
    field = ti.field(ti.f32, shape, order="kji"[-len(shape) :])
    field.fill(UNSET)
    return field


@ti.func
def slope(q: ti.template(), dim: ti.template(), I, a, b):
    x, y = ti.Vector.unit(dim, 0, ti.i32), ti.Vector.unit(dim, dim - 1, ti.i32)
    return a * (q[I + x] - q[I - x]) + b * q[I - y]


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_sweep_sets_the_cells_of_its_range_and_no_other(shape, axis):
    (q, values), out = filled(shape, 1), unset(shape)
    launch(sweep(partial(slope, q, len(shape)), out, [(1, n - 1) for n in shape], axis=axis))(2.0, 0.5)
    expected, inside = np.full(shape, UNSET), (slice(1, -1),) * len(shape)
    below = np.roll(values, 1, axis=-1)
    expected[inside] = (2.0 * (np.roll(values, -1, 0) - np.roll(values, 1, 0)) + 0.5 * below)[inside]
    np.testing.assert_allclose(out.to_numpy(), expected, rtol=1e-5, atol=1e-6)


@ti.func
def both(q: ti.template(), I, a, b):
    return ti.Vector([q[I], a * q[I]])


@ti.func
def elsewhere(dim: ti.template(), I, m: ti.template()):
    return I + (m + 1) * ti.Vector.unit(dim, dim - 1, ti.i32)


@pytest.mark.parametrize("shape", SHAPES)
def test_several_values_of_a_cell_go_where_they_belong(shape):
    (q, values), outs = filled(shape, 2), (unset(shape), unset(shape))
    ranges = [*((0, n) for n in shape[:-1]), (1, 2)]
    launch(sweep(partial(both, q), outs, ranges, partial(elsewhere, len(shape))))(3.0)
    for m, (out, factor) in enumerate(zip(outs, (1.0, 3.0), strict=True)):
        expected = np.full(shape, UNSET)
        expected[..., 2 + m] = factor * values[..., 1]
        np.testing.assert_allclose(out.to_numpy(), expected, rtol=1e-6)


@ti.func
def through(face: ti.template(), I):
    return face[I]


@ti.func
def gained(I, net, a, b):
    return a * ti.cast(net, ti.f32) + b


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_net_flux_is_what_enters_less_what_leaves(shape, exact):
    faces = [filled(shape, 3 + e) for e in range(len(shape))]
    if exact:  # sums of such numbers in f32 would err by 0.06
        for field, values in faces:
            values += 1e6
            field.from_numpy(values)
            values[...] = field.to_numpy()
    out, ranges = unset(shape), [(1, n - 1) for n in shape]
    launch(flux_sweep([partial(through, field) for field, _ in faces], gained, out, ranges, exact))(0.5, 2.0)
    net = sum(values - np.roll(values, -1, axis=e) for e, (_, values) in enumerate(faces))
    expected, inside = np.full(shape, UNSET), (slice(1, -1),) * len(shape)
    expected[inside] = (0.5 * net + 2.0)[inside]
    np.testing.assert_allclose(out.to_numpy(), expected, rtol=1e-6, atol=1e-5)


@ti.func
def noted(farthest: ti.template(), I, a, b):
    ti.atomic_max(farthest[None], I[1])
    return 1.0


def test_rows_across_the_memory_are_not_left():
    """Along axis 1 a step is a row of memory: beyond the last one lies another's."""
    farthest = ti.field(ti.i32, ())
    launch(sweep(partial(noted, farthest), unset((2, 50)), [(0, 2), (0, 2 * LANES + 1)], axis=1))()
    assert farthest[None] == 2 * LANES
