"""Formulas: right where they are arithmetic, and nothing else gets through."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from taichi_plume.scenario.formulas import evaluate, formula

VELOCITY = TypeAdapter(formula("m/s"))
X, Y = np.meshgrid(np.linspace(0.0, 2.0, 5), np.linspace(-1.0, 1.0, 4), indexing="ij")
R = np.sqrt(X**2 + Y**2)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-cos(pi*x)*sin(pi*y)", -np.cos(np.pi * X) * np.sin(np.pi * Y)),
        ("2**-1**2 + 1e-3", np.full_like(X, 0.501)),
        ("hypot(x, y) - sqrt(x**2 + y**2)", np.zeros_like(X)),
        ("where(y < 0, -1, x)", np.where(Y < 0, -1.0, X)),
        ("(x >= 1)*3", np.where(X >= 1, 3.0, 0.0)),
        ("max(min(x, 1), y) + atan2(y, x + 3)", np.maximum(np.minimum(X, 1), Y) + np.arctan2(Y, X + 3)),
        ("exp(log(tanh(abs(y)))) - floor(x)", np.tanh(np.abs(Y)) - np.floor(X)),
        ("20 cm/s", np.full_like(X, 0.2)),
        (-3, np.full_like(X, -3.0)),
        (" + ".join(["x"] * 90), 90 * X),
    ],
)
def test_values(text, value):
    found = evaluate(VELOCITY.validate_python(text), {"x": X, "y": Y})
    np.testing.assert_allclose(np.broadcast_to(found, X.shape), value, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("x^2", r"has \^"),
        ("__import__('os')", "unknown function '__import__'"),
        ("x.real", "not arithmetic"),
        ("(lambda: 1)()", "not arithmetic"),
        ("[x for x in x]", "not arithmetic"),
        ("x[0]", "not arithmetic"),
        ("'x'", "not arithmetic"),
        ("f'{x}'", "not arithmetic"),
        ("max(*x)", "gives max 1 values, it takes 2"),
        ("where(condition=x, x=x, y=x)", "not arithmetic"),
        ("t", "unknown name 't'"),
        ("sin", "unknown name 'sin'"),
        ("x if", "is no formula"),
        ("", "is no formula"),
        ("x\0", "is no formula"),
        ("True", "has True"),
        ("1j", "has 1j"),
        ("(" * 400 + "x" + ")" * 400, "is no formula"),
        ("-" * 900 + "x", "nested deeper"),
        ("x" * 1001, "1,001 characters"),
        ("1" * 900 + "*x", "too large"),
        ("1" * 400, "finite"),
        ("inf", "finite"),
        ([1], "finite number or a formula"),
        (None, "finite number or a formula"),
        (True, "finite number or a formula"),
    ],
)
def test_what_is_no_formula_is_reported(text, why):
    with pytest.raises(ValidationError, match=why):
        VELOCITY.validate_python(text)


def test_powers_take_no_time_and_nonsense_has_no_value():
    assert not np.isfinite(evaluate("9**9**9**9**9", {"x": X}))
    np.testing.assert_array_equal(np.isfinite(evaluate("1/x", {"x": X})), X != 0)
