import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.solvers import tridiagonal
from taichi_plume.solvers.capacitance import Capacitance, Changes
from taichi_plume.solvers.direct import FastTransforms, SparseFactors, angles, eigenvalues
from taichi_plume.solvers.imported_flow import Projection
from taichi_plume.solvers.multigrid import Multigrid
from taichi_plume.solvers.poisson import OpenFractions
from taichi_plume.solvers.pressure import pressure_solver
from taichi_plume.solvers.tridiagonal import Amplitudes, Tridiagonal

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
    """Open fractions of the faces of a box with an obstacle, and a right-hand side that its air can satisfy."""
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
        # Multigrid compiles for seconds; a CPU leaves flat cells to the factors
        pytest.param(Multigrid, *CASES[n], marks=pytest.mark.slow)
        for n in (0, 2, 3, 4, 5)
    ],
)
def test_the_equations_are_met(fields, method, shape, obstacle, outlet, periodic):
    grid, faces, b, air = problem(shape, obstacle, outlet, periodic)
    fractions = OpenFractions.of(faces, grid)
    phi = solve(method(fractions, grid), grid, fields, b, 1e-4)
    residual = fractions.matrix() @ phi.ravel(order="F") - b.ravel(order="F")
    assert np.abs(residual[air.ravel(order="F")]).max() < 1e-3 * np.abs(b).max()


@pytest.mark.slow
@pytest.mark.parametrize("case", [CASES[2], CASES[4]])
def test_multigrid_by_cells_as_on_a_gpu(fields, case, monkeypatch):
    grid, faces, b, air = problem(*case)
    fractions = OpenFractions.of(faces, grid)
    by_rows = solve(Multigrid(fractions, grid), grid, fields, b, 1e-4)[air]
    monkeypatch.setattr("taichi_plume.solvers.vcycle.on_cpu", lambda: False)
    by_cells = Multigrid(fractions, grid)
    assert not by_cells.strips
    result = solve(by_cells, grid, fields, b, 1e-4)[air]
    if by_cells.floating:
        by_rows, result = by_rows - by_rows.mean(), result - result.mean()
    np.testing.assert_allclose(result, by_rows, atol=1e-4 * np.abs(by_rows).max())


@pytest.mark.slow
def test_iterations_hardly_grow_with_the_grid(fields):
    iterations = []
    for n in (16, 32):
        grid, faces, b, _ = problem((2 * n, n, n), True, True)
        solver = Multigrid(OpenFractions.of(faces, grid), grid)
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
    ((1, 9), (True, False), (0, 0, 0, 0)),
    ((2, 9), (True, False), (0, 0, 0, 1)),
    # axes that are longer than DENSE
    ((5, 103), (True, False), (0, 0, 0, 0)),
    ((5, 104), (False, False), (0, 0, 1, 1)),
    ((5, 103), (False, False), (0, 0, 1, 0)),
    ((5, 103), (False, True), (0, 1, 0, 0)),
    ((3, 4, 104), (False, False, True), (0, 0, 0, 0, 0, 0)),
]


@pytest.mark.cpu
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
    fractions = OpenFractions.of(tuple(faces), grid)
    b = np.random.default_rng(0).standard_normal(shape)
    if not any(free):
        b -= b.mean()
    solver = pressure_solver(tuple(faces), grid)
    assert isinstance(solver, FastTransforms)
    phi = solve(solver, grid, fields, b.astype(np.float32), 0.0)
    residual = fractions.matrix() @ phi.ravel(order="F") - b.ravel(order="F")
    assert np.abs(residual).max() < 5e-6 * np.abs(phi).max()
    if not any(free):
        assert abs(phi.mean()) < 1e-6 * np.abs(phi).max()


def maze(shape, seed, sides, periodic=None, solid=0.2):
    """Open fractions of a box with random obstacles, cut faces and a pocket of air; sides: the share of
    each that is open.
    """
    rng = np.random.default_rng(seed)
    grid = Grid(shape, 0.1, periodic=periodic or (False,) * len(shape))
    air = rng.random(shape) > solid
    air[tuple(slice(1, 5) if n > 1 else 0 for n in shape)] = False
    air[tuple(slice(2, 4) if n > 1 else 0 for n in shape)] = True
    air = grid.pad(air)
    faces = []
    for d in range(grid.dim):
        cut = np.where(rng.random(grid.padded) < 0.1, rng.uniform(0.05, 1.0, grid.padded), 1.0)
        a = air & np.roll(air, 1, axis=d)
        if grid.periodic[d]:
            cut = grid.pad(grid.inner(cut))
        else:
            along = np.moveaxis(a, d, 0)
            for side, place in enumerate((grid.ghost, grid.ghost + shape[d])):
                along[place] &= rng.random(along.shape[1:]) < sides[2 * d + side]
        faces.append((a * cut).astype(np.float32))
    return grid, tuple(faces)


def reference(fractions, b):
    """Solution of the equations by SciPy's sparse solver, and the parts of the air, each with what is free in it left
    out: the mean of b and of phi where no free face touches it.
    """
    matrix = fractions.matrix()
    air = np.flatnonzero(matrix.diagonal() > 0)
    matrix, right = matrix[air][:, air], b.ravel(order="F")[air].astype(float)
    parts, part = connected_components(matrix, directed=False)
    floating = np.bincount(part, matrix.sum(axis=1)) < 1e-6
    first = np.unique(part, return_index=True)[1]
    pins = np.zeros(len(air))
    pins[first[floating]] = 1.0

    def centred(values):
        means = np.bincount(part, values) / np.bincount(part)
        return values - np.where(floating, means, 0.0)[part]

    phi = centred(spsolve((matrix + sp.diags_array(pins)).tocsc(), centred(right)))
    return phi, lambda found: centred(found.ravel(order="F")[air]), parts


MAZES = [
    ((19, 14), (0.5,) * 4, None),
    ((19, 14), (0.0,) * 4, None),
    ((19, 14), (0.0, 0.2, 0.0, 0.1), None),  # the nearest box is closed
    ((19, 14), (1.0, 1.0, 0.9, 0.0), None),
    ((19, 14), (0.0, 0.0, 1.0, 0.2), (True, False)),
    ((19, 14), (0.0,) * 4, (True, True)),
    ((9, 7, 8), (0.0, 1.0, 0.4, 0.7, 0.0, 0.1), None),
    ((9, 7, 8), (0.0,) * 6, None),
    ((9, 7, 8), (0.0, 0.0, 0.8, 0.1, 0.0, 0.0), (True, False, True)),
    ((12, 9, 1), (0.0, 0.3, 0.0, 0.0, 0.0, 0.0), (False, True, False)),
]


@pytest.mark.cpu
@pytest.mark.parametrize(("shape", "sides", "periodic"), MAZES)
def test_a_capacitance_matrix_solves_boxes_with_obstacles_exactly(fields, shape, sides, periodic):
    for seed in range(3):
        grid, faces = maze(shape, seed, sides, periodic)
        fractions = OpenFractions.of(faces, grid)
        b = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
        phi, of_air, parts = reference(fractions, b)
        solver = Capacitance(Changes.of(fractions, grid), grid)
        found = solve(solver, grid, fields, b, 0.0)
        assert np.abs(of_air(found) - phi).max() < 1e-5 * np.abs(phi).max()
        closed_off = fractions.matrix().diagonal() == 0
        assert not found.ravel(order="F")[closed_off].any()
        assert parts > 1


@pytest.mark.cpu
@pytest.mark.parametrize(("outlet", "parts"), [(True, 2), (False, 4)])
def test_obstacles_far_apart_are_solved_as_exactly_as_by_one_matrix(fields, monkeypatch, outlet, parts):
    """A closed room has two parts more: the constant, and the cell to whose equation phi is added."""
    shape = (44, 14, 14)
    grid, faces, b, _ = problem(shape, False, outlet)
    solid = np.zeros(shape, bool)
    solid[4:12, 3:10, 2:10] = solid[32:39, 4:11, 4:12] = True
    closed = grid.pad(solid)
    for d, a in enumerate(faces):
        a *= ~(closed | np.roll(closed, 1, axis=d))
    b[solid] = 0.0
    changes = Changes.of(OpenFractions.of(faces, grid), grid)
    split = Capacitance(changes, grid)
    monkeypatch.setattr("taichi_plume.solvers.clusters.UNDIVIDED", 10**6)
    whole = Capacitance(changes, grid)
    assert len(split.inverse.blocks) == parts
    assert len(whole.inverse.blocks) == 1
    found, wanted = (solve(solver, grid, fields, b, 0.0)[~solid] for solver in (split, whole))
    if not outlet:
        found, wanted = found - found.mean(), wanted - wanted.mean()
    np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(wanted).max())


@pytest.mark.cpu
def test_each_case_gets_its_solver():
    for shape, kind in (((40, 30), SparseFactors), ((12, 10, 7), Multigrid)):
        grid, faces, _, _ = problem(shape, True, True)
        assert isinstance(pressure_solver(faces, grid), Capacitance)
        grid, faces, _, _ = problem(shape, False, True)
        assert isinstance(pressure_solver(faces, grid), FastTransforms)
        grid, faces = maze(shape, 0, (1.0,) * 6)
        assert isinstance(pressure_solver(faces, grid), kind)


# ---------------------------------------------------------------- projection


def test_projection_leaves_the_part_without_divergence():
    """Helmholtz: a curl and a gradient, both without flow through the faces of the box, come apart."""
    grid = Grid((10, 8), 0.1)
    rng = np.random.default_rng(2)
    psi = np.pad(rng.standard_normal((9, 7)), 1)
    potential = rng.standard_normal((10, 8))
    curl = [np.diff(psi, axis=1), -np.diff(psi, axis=0)]
    gradient = [np.pad(np.diff(potential, axis=d), [(int(a == d),) * 2 for a in range(2)]) for d in range(2)]
    both = [c + g for c, g in zip(curl, gradient, strict=True)]
    u, correction, left = Projection(grid, air_of([], grid))(both)
    for found, wanted in zip(u, curl, strict=True):
        np.testing.assert_allclose(found, wanted, atol=3e-6)

    def square(parts):
        return sum((part**2).sum() for part in parts)

    assert correction == pytest.approx(np.sqrt(square(gradient) / square(both)), rel=1e-5)
    assert left < 1e-6


def test_what_comes_in_goes_out():
    grid = Grid((12, 6), 0.1)
    project = Projection(grid, air_of([], grid))
    u = [np.broadcast_to(np.linspace(0.5, 0.7, 13)[:, None], (13, 6)).copy(), np.zeros((12, 7))]
    found, _, _ = project(u)
    np.testing.assert_allclose(found[0], 0.6, rtol=1e-6)
    nowhere, _, _ = project([u[0] - 0.6, u[1]])  # out on both sides
    assert np.abs(nowhere[0]).max() < 1e-6


@pytest.mark.cpu
@pytest.mark.parametrize("kind", ["closed", "periodic", "free-closed"])
def test_strips_of_a_large_box_are_solved_alike(kind, monkeypatch):
    """Strips that threads divide, beside strips in order."""
    layers = eigenvalues(angles("closed", 5))[:, None] + eigenvalues(angles("free", 37))
    right, results = np.random.default_rng(0).standard_normal((5, 20, 37)), []
    for few in (tridiagonal.FEW_CELLS, 10):
        monkeypatch.setattr(tridiagonal, "FEW_CELLS", few)
        waves = Amplitudes(Tridiagonal(kind, 20, layers))
        waves.values[..., :37] = right
        waves.solve()
        results.append(waves.values.copy())
    assert np.abs(results[0]).max() > 0.1
    np.testing.assert_array_equal(*results)
