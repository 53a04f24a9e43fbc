"""Kernels that know no room: what is compiled for another part, and what is not."""

from functools import partial

import numpy as np
import pytest

from taichi_plume.engine import program, ti
from taichi_plume.engine.fields import ArrayField, Layout
from taichi_plume.engine.library import KernelSyntaxError
from taichi_plume.grid.kernels import Template

pytestmark = pytest.mark.usefixtures("taichi")


class Part:
    """Part with fields, numbers, a flag and parts of its own."""

    def __init__(self, shape, scale=2.0, adds=False, others=1, seed=1):
        self.layout = Layout(shape, first_axis_contiguous=True)
        self.x, self.y = (ArrayField(ti.f32, self.layout) for _ in range(2))
        self.x.from_numpy(np.random.default_rng(seed).normal(size=shape))
        self.shape, self.scale, self.adds = shape, scale, adds
        self.others = tuple(ti.field(ti.f32, ()) for _ in range(others))
        for n, other in enumerate(self.others):
            other.fill(n + 1.0)

    @ti.func
    def term(self, I):
        result = self.x[I] * self.scale / (self.scale + 1.0)
        for other in ti.static(self.others):
            result += other[None]
        return result

    @ti.kernel
    def run(self, extra: float):
        for I in ti.grouped(ti.ndrange(*self.shape)):
            self.y[I] = self.term(I)
            if ti.static(self.adds):
                self.y[I] += extra

    def expected(self, extra):
        whole = self.x.to_numpy() * self.scale / (self.scale + 1.0)
        return whole + sum(range(1, len(self.others) + 1)) + (extra if self.adds else 0.0)


@pytest.mark.parametrize("shape", [(5,), (4, 3), (2, 3, 4)])
def test_shapes_and_numbers_compile_nothing_and_what_selects_code_does(shape):
    first = Part(shape)
    first.run(1.0)
    before = program.compiled()
    for part in (
        Part(shape, 0.5),
        Part(tuple(2 * n + 1 for n in shape), -3.0, seed=2),
        Part((1,) * len(shape)),
    ):
        part.run(0.5)
        np.testing.assert_allclose(part.y.to_numpy(), part.expected(0.5), rtol=1e-6)
    assert program.compiled() == before
    for part in (Part(shape, adds=True), Part(shape, others=2)):
        part.run(0.5)
        np.testing.assert_allclose(part.y.to_numpy(), part.expected(0.5), rtol=1e-6)
    assert program.compiled() == before + 2
    np.testing.assert_allclose(first.y.to_numpy(), first.expected(1.0), rtol=1e-6)


def closing_over(field, factor):
    @ti.func
    def scaled(i):
        return factor * field[i]

    return scaled


@ti.kernel
def summed(terms: Template, n: int) -> ti.f32:
    total = 0.0
    for i in range(n):
        for term in ti.static(terms):
            total += term(i)
    return total


def test_functions_of_one_source_are_one_kernel_whatever_they_close_over():
    fields = [ti.field(ti.f32, n) for n in (3, 4, 5)]
    for n, field in enumerate(fields):
        field.fill(n + 1.0)
    assert summed((closing_over(fields[0], 2.0), closing_over(fields[1], 1.0)), 3) == 3 * (2.0 + 2.0)
    before = program.compiled()
    assert summed((closing_over(fields[2], 3.0), closing_over(fields[0], 1.0)), 3) == 3 * (9.0 + 1.0)
    assert program.compiled() == before
    assert summed((closing_over(fields[2], 3.0), closing_over(fields[2], 1.0)), 3) == 3 * (9.0 + 3.0)


@ti.func
def weighed(field: Template, weight: Template, i):
    return weight * field[i]


def test_functions_with_given_parts_are_one_kernel():
    fields = [ti.field(ti.f32, n) for n in (3, 4, 5)]
    for n, field in enumerate(fields):
        field.fill(n + 1.0)
    assert summed((partial(weighed, fields[0], 2.0), partial(weighed, fields[1], 0.5)), 3) == 3 * (2.0 + 1.0)
    before = program.compiled()
    assert summed((partial(weighed, fields[2], 3.0), partial(weighed, fields[0], 1.0)), 2) == 2 * (9.0 + 1.0)
    assert program.compiled() == before


class Twin:
    """Two names of fields, which may be the same field."""

    def __init__(self, same):
        self.a = ti.field(ti.f32, 4)
        self.b = self.a if same else ti.field(ti.f32, 4)

    @ti.kernel
    def shift(self):
        ti.loop_config(serialize=True)
        for i in range(3):
            self.b[i + 1] = self.a[i] + 1.0


@pytest.mark.parametrize("order", [(True, False), (False, True)])
def test_two_names_of_one_field_stay_one_field(order):
    for same in order:
        twin = Twin(same)
        twin.shift()
        assert twin.b.to_numpy().tolist() == ([0, 1, 2, 3] if same else [0, 1, 1, 1])


@ti.kernel
def spread(field: Template, D: Template):
    for J in ti.grouped(ti.ndrange(*field.shape[:0:-1])):
        row = ti.row(J, (field,))
        for i in range(field.shape[0]):
            I = ti.along(row, i)
            field[I] = 100.0 * I[0] + 10.0 * I[1] + (I + 2 * ti.Vector.unit(2, 1, ti.i32) * D)[1]


def test_cells_of_rows_are_the_indices_that_they_stand_for():
    field = ArrayField(ti.f32, Layout((3, 4), first_axis_contiguous=True))
    spread(field, 3)
    i, j = np.indices((3, 4))
    np.testing.assert_array_equal(field.to_numpy(), 100.0 * i + 10.0 * j + j + 6)


@ti.kernel
def add_corners(field: Template, index: Template, dim: Template, out: Template):
    """Write the fields' values at the corners of the cube above each index, a digit of base 4 for each."""
    for n in range(out.shape[0]):
        I = ti.cell(index[n], (field,))
        for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * dim)))):
            out[n] = 4.0 * out[n] + field[I + offset]


@pytest.mark.parametrize("first_axis_contiguous", [True, False])
@pytest.mark.parametrize("shape", [(3, 4), (3, 4, 5)])
def test_the_corners_of_a_cell_are_those_of_its_index(shape, first_axis_contiguous):
    dim, rng = len(shape), np.random.default_rng(1)
    field = ArrayField(ti.f32, Layout(shape, first_axis_contiguous))
    values = rng.integers(4, size=shape)
    field.from_numpy(values)
    indices = rng.integers(np.array(shape) - 1, size=(6, dim))
    out = ti.field(ti.f32, 6)
    add_corners(field, ti.filled_vectors(indices, ti.i32), dim, out)
    for index, found in zip(indices, out.to_numpy(), strict=True):
        corners = [values[tuple(index + offset)] for offset in np.ndindex((2,) * dim)]
        assert found == int("".join(map(str, corners)), 4)


def test_a_component_of_a_cell_cannot_be_set():
    @ti.kernel
    def wrong(field: Template):
        for J in ti.grouped(ti.ndrange(*field.shape[:0:-1])):
            I = ti.row(J, (field,))
            I[1] = 0

    with pytest.raises(KernelSyntaxError, match="non-writable"):
        wrong(ArrayField(ti.f32, Layout((3, 4), first_axis_contiguous=True)))


@pytest.mark.cpu
def test_fields_outlive_a_restart_of_the_engine_on_a_cpu(taichi):
    part = Part((3,))
    part.run(0.0)
    part.y.fill(0.0)
    ti.reset()
    part.run(0.0)  # starts it again
    np.testing.assert_allclose(part.y.to_numpy(), part.expected(0.0), rtol=1e-6)


@pytest.mark.parametrize(
    ("dtype", "values"),
    [(ti.f64, [1 / 3, 1e-300]), (ti.i32, [-5, 2**31 - 1]), (ti.u32, [7, 2**32 - 1]), (ti.f32, [0.1, -2.0])],
)
def test_fields_of_every_type_are_copied(dtype, values):
    @ti.kernel
    def copy(a: Template, b: Template):
        for i in range(2):
            b[i] = a[i]

    a, b = ti.field(dtype, 2), ti.field(dtype, 2)
    a.from_numpy(np.array(values))
    copy(a, b)
    np.testing.assert_array_equal(b.to_numpy(), a.to_numpy())
    assert b.to_numpy().tolist() == np.array(values, a.values.dtype).tolist()
