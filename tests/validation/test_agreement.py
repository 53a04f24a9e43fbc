import numpy as np
import pytest
from scipy.stats import norm

from taichi_plume.validation.agreement import above, fac2, fractional_bias, hit_rate, nmse


@pytest.mark.parametrize("factor", [0.4, 0.8, 1.0, 1.9, 3.0])
def test_a_constant_factor(factor):
    measured = np.full(7, 3.0)
    computed = factor * measured
    assert fac2(measured, computed) == (1.0 if 0.5 <= factor <= 2.0 else 0.0)
    assert fractional_bias(measured, computed) == pytest.approx(2 * (1 - factor) / (1 + factor))
    assert nmse(measured, computed) == pytest.approx((1 - factor) ** 2 / factor)


def test_scatter_of_a_lognormal_factor():
    rng, spread = np.random.default_rng(1), 0.7
    measured = rng.uniform(1.0, 5.0, 200_000)
    computed = measured * rng.lognormal(0.0, spread, len(measured))
    assert fac2(measured, computed) == pytest.approx(2 * norm.cdf(np.log(2) / spread) - 1, abs=0.005)


def test_pairs_below_the_limit_are_left_out_and_smaller_values_become_it():
    measured, computed = above(1.0, np.array([0.2, 3.0, 0.5]), np.array([0.9, 0.1, 2.0]))
    assert measured.tolist() == [3.0, 1.0]
    assert computed.tolist() == [1.0, 2.0]


def test_a_hit_is_within_a_quarter_or_the_absolute_bound():
    measured, computed = np.array([4.0, 4.0, 0.0, -4.0]), np.array([4.9, 5.1, 0.1, 4.0])
    assert hit_rate(measured, computed, least=0.2) == 0.5
