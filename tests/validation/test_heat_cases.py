"""Flow rates in the validation case of a thermal plume, measured on a Gaussian plume."""

import numpy as np
import pytest

from taichi_plume.validation.heat_cases import ABOVE_FLOOR, ENTRAINMENT, flow_rates


def test_the_flow_rate_of_a_gaussian_plume_is_its_integral():
    n, dx = 60, 0.03
    place = (np.arange(n) + 0.5) * dx - 0.5 * n * dx
    square = place[:, None, None] ** 2 + place[None, :, None] ** 2
    width = np.array([0.15, 0.2, 0.25])
    mean = 0.4 * np.exp(-square / width**2) - 1e-3 * (square > 0.75**2)  # air sinks far from the plume
    height, rate = flow_rates(mean, dx)
    np.testing.assert_allclose(height, np.arange(3) * dx - ABOVE_FLOOR)
    np.testing.assert_allclose(rate, 0.4 * np.pi * width**2 * (1.0 - 0.02), rtol=0.02)
    assert flow_rates(np.ones((6, 6, 1)), dx)[1] == pytest.approx(36 * dx**2)


def test_the_constant_of_the_law_is_that_of_the_entrainment_coefficient_stated():
    entrainment = 0.1236  # of top-hat profiles; plumes were measured at 0.11 to 0.13
    law = 1.2 * entrainment * (0.9 * entrainment) ** (1.0 / 3.0) * np.pi ** (2.0 / 3.0)
    assert law == pytest.approx(ENTRAINMENT, rel=0.002)
