import numpy as np
import pytest

from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.direct import FastTransforms, SparseFactors
from taichi_plume.solvers.multigrid import Multigrid
from taichi_plume.solvers.poisson import Openness
from taichi_plume.solvers.pressure import pressure_solver

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(scope="module")
def fields(taichi):
    """Fields b and phi of a grid, the same for all grids of a shape: each has kernels of its own."""
    made = {}

    def of(grid: Grid) -> tuple:
        if grid.shape not in made:
            made[grid.shape] = grid.field(), grid.field()
        return made[grid.shape]

    return of


def problem(shape, obstacle, outlet, periodic=None):
    """Face openness of a box with an obstacle, and a right-hand side that its air can satisfy."""
    rng = np.random.default_rng(0)
    grid = Grid(shape, 0.1, periodic=periodic or (False,) * len(shape))
    air = np.ones(shape, bool)
    if obstacle:
        air[tuple(slice(n // 4, n // 2) for n in shape)] = False
    padded = grid.pad(air)
    faces = []
    for d in range(grid.dim):
        a = (padded & np.roll(padded, 1, axis=d)).astype(np.float32)
        if not grid.periodic[d]:
            along = np.moveaxis(a, d, 0)
            along[grid.ghost] = 0.0
            along[grid.ghost + shape[d]] *= float(outlet and d == 0)
        faces.append(a)
    b = rng.standard_normal(shape) * air
    if not outlet:
        b -= air * b.sum() / air.sum()
    return grid, tuple(faces), b.astype(np.float32), air


def solve(solver, grid, fields, b, tolerance):
    right, phi = fields(grid)
    grid.write(right, b)
    solver.solve(right, phi, tolerance)
    return grid.read(phi).astype(float)


CASES = [
    ((40, 30), True, True, None),
    ((40, 30), True, False, None),
    ((37, 23, 11), True, True, None),
    ((24, 20, 16), True, False, None),
    ((24, 20, 16), False, False, (True, True, False)),
    ((32, 24, 1), True, True, None),
]


@pytest.mark.parametrize(
    ("method", "shape", "obstacle", "outlet", "periodic"),
    [(SparseFactors, *case) for case in CASES]
    + [
        # what compiles for seconds and is much like another case, and flat cells, which a CPU leaves to the factors
        pytest.param(Multigrid, *case, marks=[pytest.mark.slow] if n in (1, 5) else [])
        for n, case in enumerate(CASES)
    ],
)
def test_the_equations_are_met(fields, method, shape, obstacle, outlet, periodic):
    grid, faces, b, air = problem(shape, obstacle, outlet, periodic)
    openness = Openness.of(faces, grid)
    phi = solve(method(openness, grid), grid, fields, b, 1e-4)
    residual = openness.matrix() @ phi.ravel(order="F") - b.ravel(order="F")
    assert np.abs(residual[air.ravel(order="F")]).max() < 1e-3 * np.abs(b).max()


@pytest.mark.slow
def test_both_solvers_agree(fields):
    grid, faces, b, air = problem((37, 23, 11), True, True)
    openness = Openness.of(faces, grid)
    direct = solve(SparseFactors(openness, grid), grid, fields, b, 0.0)
    iterated = solve(Multigrid(openness, grid), grid, fields, b, 1e-5)
    np.testing.assert_allclose(iterated[air], direct[air], atol=1e-4 * np.abs(direct).max())


@pytest.mark.slow
def test_iterations_hardly_grow_with_the_grid(fields):
    iterations = []
    for n in (16, 32):
        grid, faces, b, _ = problem((2 * n, n, n), True, True)
        solver = Multigrid(Openness.of(faces, grid), grid)
        solve(solver, grid, fields, b, 1e-4 * float(np.abs(b).max()))
        iterations.append(solver.iterations)
    assert iterations[1] <= iterations[0] + 4


EMPTY = [
    ((20, 15), (False, False), (0, 0, 0, 0)),
    ((20, 15), (False, False), (0, 1, 0, 0)),
    ((20, 15), (False, True), (1, 0, 0, 0)),
    ((16, 15), (True, True), (0, 0, 0, 0)),
    ((12, 10, 7), (False, False, False), (1, 1, 0, 1, 0, 0)),
    ((12, 9, 8), (True, False, True), (0, 0, 1, 0, 0, 0)),
    ((12, 9, 1), (False, True, False), (0, 1, 0, 0, 0, 0)),
]


@pytest.mark.parametrize(("shape", "periodic", "free"), EMPTY)
def test_fast_transforms_solve_empty_boxes(fields, shape, periodic, free):
    grid = Grid(shape, 0.1, periodic=periodic)
    faces = []
    for d in range(grid.dim):
        a = np.ones(grid.padded, np.float32)
        along = np.moveaxis(a, d, 0)
        if not periodic[d]:
            along[grid.ghost], along[grid.ghost + shape[d]] = free[2 * d], free[2 * d + 1]
        faces.append(a)
    openness = Openness.of(tuple(faces), grid)
    b = np.random.default_rng(0).standard_normal(shape)
    if not any(free):
        b -= b.mean()
    solver = pressure_solver(tuple(faces), grid)
    assert isinstance(solver, FastTransforms)
    phi = solve(solver, grid, fields, b.astype(np.float32), 0.0)
    residual = openness.matrix() @ phi.ravel(order="F") - b.ravel(order="F")
    assert np.abs(residual).max() < 1e-4


@pytest.mark.parametrize(
    ("shape", "obstacle", "kind"),
    [((20, 15), True, SparseFactors), ((12, 10, 7), True, Multigrid), ((12, 10, 7), False, FastTransforms)],
)
def test_each_case_gets_its_solver(shape, obstacle, kind):
    grid, faces, _, _ = problem(shape, obstacle, True)
    assert isinstance(pressure_solver(faces, grid), kind)
