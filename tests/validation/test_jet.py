import numpy as np
import pytest

from taichi_plume.validation import jet


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
