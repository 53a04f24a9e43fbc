"""Closed forms and read-outs of cases on made-up flows: round jet, boundary layer, thermal plume."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from taichi_plume.validation import jet
from taichi_plume.validation.heat_cases import ABOVE_FLOOR, ENTRAINMENT, flow_rates
from taichi_plume.validation.wall_cases import VISCOSITY, power_law_mean


def test_the_scales_of_a_known_jet():
    """A jet with Schlichting's profile, U_c (1 + (√2 - 1) (r/r_half)²)^-2, whose scales are put in."""
    n = 6
    x = np.arange(jet.LENGTH * n) / n
    place = (np.arange(jet.WIDTH * n) + 0.5) / n - jet.WIDTH / 2
    square = place[:, None] ** 2 + place**2
    center, half = 6.0 / (x + 5.0), 0.1 * (x + 5.0)
    mean = center[:, None, None] * (1 + (np.sqrt(2) - 1) * square / half[:, None, None] ** 2) ** -2.0
    found_x, found_center, found_half = jet.scales(mean, n)
    np.testing.assert_allclose(found_x, x)
    wide = half >= 0.7  # as it is where the scales are fitted
    np.testing.assert_allclose(
        found_center[wide], center[wide], rtol=0.025
    )  # the four cells lie 0.12 d off the axis
    np.testing.assert_allclose(found_half[wide], half[wide], rtol=0.025)


def test_the_published_ranges_hold_the_textbook_jet():
    """U_c/U0 = 6 d/x, r_half = 0.094 to 0.1 x, a core of 5 to 6 d."""
    for (middle, half), values in zip(
        (jet.DECAY, jet.SPREAD, jet.CORE), ((6.0,), (0.094, 0.1), (5.0, 6.0)), strict=True
    ):
        for value in values:
            assert value == pytest.approx(middle, abs=half)


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
