"""Reference of the validation case of a growing layer: means of the 1/7-power law over cells."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from taichi_plume.validation.wall_cases import VISCOSITY, power_law_mean


@pytest.mark.parametrize("x", [0.5, 2.0])
def test_the_means_of_the_power_law_are_its_integrals_over_the_cells(x):
    delta = 0.37 * x / (0.5 * x / VISCOSITY) ** 0.2
    sides = np.array([0.0, 0.02, 0.05, 0.3])
    expected = [
        quad(lambda z: min(1.0, z / delta) ** (1.0 / 7.0), low, high, points=[delta])[0] / (high - low)
        for low, high in pairwise(sides)
    ]
    np.testing.assert_allclose(power_law_mean(x, 0.5, sides), expected, rtol=1e-6)
    assert power_law_mean(x, 0.5, np.array([0.0, delta])) == pytest.approx([7.0 / 8.0])
