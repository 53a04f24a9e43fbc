"""Points in any order, put on a lattice."""

import numpy as np
import pytest

from taichi_plume.grid.interpolation import Interpolation


@pytest.mark.parametrize("dim", [2, 3])
def test_linear_fields_are_exact_on_and_off_a_lattice(dim):
    rng = np.random.default_rng(3)
    lattice = np.stack(np.meshgrid(*[np.cumsum(rng.uniform(0.5, 1.5, 6)) for _ in range(dim)]), axis=-1)
    lattice = rng.permutation(lattice.reshape(-1, dim))
    slope = np.array([0.3, -0.2, 0.5])[:dim]
    wanted = [np.linspace(lattice[:, a].min() - 0.3, lattice[:, a].max() + 0.2, 9) for a in range(dim)]
    exact = sum(s * x for s, x in zip(slope, np.meshgrid(*wanted, indexing="ij"), strict=True))
    for place, tolerance in ((lattice, 1e-9), (lattice + rng.uniform(-0.2, 0.2, lattice.shape), 1e-6)):
        known = Interpolation(place)
        assert (known.lattice is None) == (place is not lattice)
        found = known.onto(wanted)(place @ slope + 1.0)
        inside = (slice(1, -1),) * dim  # far beyond the points it is rather their mean
        np.testing.assert_allclose(found[inside], exact[inside] + 1.0, atol=tolerance)
        assert np.abs(found - exact - 1.0).max() < (1e-9 if place is lattice else 0.5)
