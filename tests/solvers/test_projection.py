"""Flows made divergence-free."""

import numpy as np
import pytest

from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.imported import Projection

pytestmark = pytest.mark.usefixtures("taichi")


def test_projection_leaves_the_part_without_divergence():
    """Helmholtz: a curl and a gradient, both without flow through the faces of the box, come apart."""
    grid = Grid((10, 8), 0.1)
    rng = np.random.default_rng(2)
    psi = np.pad(rng.standard_normal((9, 7)), 1)
    potential = rng.standard_normal((10, 8))
    curl = [np.diff(psi, axis=1), -np.diff(psi, axis=0)]
    gradient = [np.pad(np.diff(potential, axis=d), [(int(a == d),) * 2 for a in range(2)]) for d in range(2)]
    u, correction, left = Projection(grid, air_of([], grid))(
        [c + g for c, g in zip(curl, gradient, strict=True)]
    )
    for found, wanted in zip(u, curl, strict=True):
        np.testing.assert_allclose(found, wanted, atol=3e-6)

    def square(parts):
        return sum((part**2).sum() for part in parts)

    assert correction == pytest.approx(
        np.sqrt(square(gradient) / square([c + g for c, g in zip(curl, gradient, strict=True)])), rel=1e-5
    )
    assert left < 1e-6


def test_what_comes_in_goes_out():
    grid = Grid((12, 6), 0.1)
    project = Projection(grid, air_of([], grid))
    u = [np.broadcast_to(np.linspace(0.5, 0.7, 13)[:, None], (13, 6)).copy(), np.zeros((12, 7))]
    found, _, _ = project(u)
    np.testing.assert_allclose(found[0], 0.6, rtol=1e-6)
    nowhere, _, _ = project([u[0] - 0.6, u[1]])  # out on both sides
    assert np.abs(nowhere[0]).max() < 1e-6
