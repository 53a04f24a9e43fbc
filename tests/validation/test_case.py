from math import nan

import pytest

from taichi_plume.validation.case import Case, Expected, examine, observed_order

pytestmark = pytest.mark.usefixtures("idle")


def test_order_is_the_slope_between_the_last_two():
    assert observed_order({8: 1.0, 16: 0.5, 32: 0.125}) == pytest.approx(2.0)
    assert observed_order({10: 0.09, 30: 0.01}) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("expected", "errors", "met"),
    [
        (Expected(order=1.9), {16: 4e-2, 32: 1e-2}, True),
        (Expected(order=1.9), {16: 2e-2, 32: 1e-2}, False),
        (Expected(order=1.9), {32: 1e-2}, False),
        (Expected(order=1.9), {16: 0.0, 32: 0.0}, False),
        (Expected(tolerance=1e-3), {16: 9e-4, 32: 9e-4}, True),
        (Expected(tolerance=1e-3), {16: 2e-3, 32: 9e-4}, False),
        (Expected(tolerance=1e-3, at=32), {16: 3.9e-3, 32: 9e-4}, True),
        (Expected(tolerance=1e-3, at=32), {16: 4.1e-3}, False),
        (Expected(tolerance=1e-3), {16: nan}, False),
        (Expected(order=1.0, tolerance=1e-3), {16: 8e-4, 32: 1e-4}, True),
        (Expected(order=1.0, tolerance=1e-3), {16: 8e-4, 32: 7e-4}, False),
    ],
)
def test_the_verdict(expected, errors, met):
    assert expected.met(errors) is met


def case(**expected: Expected) -> Case:
    return Case(
        "made_up", "", "", lambda n: {"a": n**-2.0, "b": 1.0}, (8,), (8, 16), expected, evidence="exact"
    )


def test_a_norm_without_expectation_is_not_judged():
    (a, b), _ = examine(case(a=Expected(order=1.9)), (8, 16))
    assert (a.norm, a.met, a.order) == ("a", True, pytest.approx(2.0))
    assert (b.norm, b.met) == ("b", None)


def test_an_expectation_of_no_norm_is_refused():
    with pytest.raises(KeyError, match="speed"):
        examine(case(speed=Expected(order=2.0)), (8, 16))
