"""Scores of estimated sources: optimal assignment, errors of places and rates, coverage."""

from itertools import permutations

import numpy as np
import pytest

from taichi_plume.agents.source_posterior import Estimate
from taichi_plume.scoring.beliefs import estimate_scores


def estimate(x, y, rate, factor=2.0):
    return Estimate(np.array([x, y]), 0.1, rate, rate / factor, rate * factor, 1.0)


def test_sources_are_matched_by_the_least_sum_of_distances():
    rng = np.random.default_rng(1)
    for _ in range(20):
        places, true = rng.random((2, 3, 2))
        terms = [estimate(place[0], place[1], 1e-6) for place in places]
        least = min(
            np.linalg.norm(places[list(order)] - true, axis=1).sum() for order in permutations(range(3))
        )
        found = estimate_scores(terms, true, np.full(3, 1e-6))
        assert found["place_error_m"] == pytest.approx(least / 3)


def test_errors_and_coverage_of_rates():
    terms = [estimate(1.0, 1.0, 3e-6), estimate(3.0, 1.0, 1e-6)]
    found = estimate_scores(terms, np.array([[3.0, 1.3], [1.0, 1.0]]), np.array([1.5e-6, 1e-6]))
    assert found["place_error_m"] == pytest.approx(0.15)
    assert found["log_error"] == pytest.approx((np.log(3.0) + np.log(1.5)) / 2)
    assert found["coverage"] == 0.5
    assert found["missing"] == 0.0


def test_fewer_estimates_than_sources_and_unknown_rates():
    found = estimate_scores(
        [estimate(1.0, 1.0, 1e-6)], np.array([[1.0, 1.0], [2.0, 2.0]]), np.full(2, np.nan)
    )
    assert found["missing"] == 1.0
    assert np.isnan(found["log_error"])
    assert np.isnan(found["coverage"])
    assert np.isnan(
        estimate_scores([estimate(1.0, 1.0, 1e-6)], np.zeros((0, 2)), np.zeros(0))["place_error_m"]
    )
