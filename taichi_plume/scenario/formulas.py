"""Formulas of the place, such as ``-cos(pi*x)*sin(pi*y)``: Python's arithmetic over a white list, and nothing else.

A formula is parsed, never executed: each node of its syntax tree is looked up here. All numbers are f64, so that no
power takes long, and what has no value becomes nan or inf, which whoever asked has to refuse.
"""

import ast
import warnings
from collections.abc import Callable
from functools import lru_cache
from math import inf, isfinite
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator
from pydantic_core import PydanticCustomError

from taichi_plume.scenario.quantities import Quantity, fault, parse

LONGEST = 1000  # characters
DEEPEST = 100  # levels of a syntax tree
AXES: tuple[str, ...] = ("x", "y", "z")
FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    **{name: (1, getattr(np, name)) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{name: (1, getattr(np, f"arc{name[1:]}")) for name in ("asin", "acos", "atan")},
    **{name: (1, getattr(np, name)) for name in ("exp", "log", "sqrt", "abs", "sign", "floor")},
    "atan2": (2, np.arctan2),
    "min": (2, np.minimum),
    "max": (2, np.maximum),
    "hypot": (2, np.hypot),
    "where": (3, np.where),
}
"""By name, with the number of arguments; ``where(x > 1, a, b)`` is a where x > 1, else b."""
OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.USub: np.negative,
    ast.UAdd: np.positive,
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
}
ALLOWED = f"allowed: numbers, x, y, z [m], pi, + - * / ** ( ) < <= > >= and {', '.join(FUNCTIONS)}"


class FormulaError(ValueError):
    """What is wrong with a formula, in a few words."""


def evaluate(text: str, places: dict[str, np.ndarray]) -> np.ndarray:
    """The formula's values at `places`, coordinates [m] by axis that broadcast; nan and inf where it has none. `places`
    may hold the sizes of units too.

    Raises FormulaError.
    """
    with np.errstate(all="ignore"):
        return np.asarray(_value(_tree(text), places, 0), float)


@lru_cache(64)
def _tree(text: str) -> ast.expr:
    if len(text) > LONGEST:
        raise FormulaError(f"has {len(text):,} characters, at most {LONGEST:,} are taken")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise FormulaError("is no formula") from None


def _value(node: ast.AST, places: dict[str, np.ndarray], depth: int) -> Any:
    """Of a node of the tree, and of all below it."""
    if depth > DEEPEST:
        raise FormulaError(f"is nested deeper than {DEEPEST} levels")
    match node:
        case ast.Constant(value=bool() | complex()):
            raise FormulaError(f"has {node.value!r}")
        case ast.Constant(value=int() | float()):
            return np.float64(_number(node.value))
        case ast.Name(id="pi"):
            return np.float64(np.pi)
        case ast.Name():
            if node.id in places:
                return places[node.id]
            if node.id in AXES:
                raise FormulaError(f"has {node.id}, a {len(places)}-D run has none")
            raise FormulaError(f"has the unknown name '{node.id}'")
        case ast.UnaryOp() if type(node.op) in OPERATORS:
            return OPERATORS[type(node.op)](_value(node.operand, places, depth + 1))
        case ast.BinOp() if type(node.op) in OPERATORS:
            left, right = (_value(one, places, depth + 1) for one in (node.left, node.right))
            return OPERATORS[type(node.op)](left, right)
        case ast.Compare(ops=[operator]) if type(operator) in OPERATORS:
            left, right = (_value(one, places, depth + 1) for one in (node.left, node.comparators[0]))
            return OPERATORS[type(operator)](left, right) * 1.0
        case ast.Call(func=ast.Name(), keywords=[]) if node.func.id in FUNCTIONS:
            count, function = FUNCTIONS[node.func.id]
            if len(node.args) != count:
                raise FormulaError(f"gives {node.func.id} {len(node.args)} values, it takes {count}")
            return function(*(_value(one, places, depth + 1) for one in node.args))
        case ast.BinOp(op=ast.BitXor()):
            raise FormulaError("has ^, a power is written **")
        case ast.Call(func=ast.Name(), keywords=[]):
            raise FormulaError(f"has the unknown function '{node.func.id}'")
    raise FormulaError(f"has what is not arithmetic ({type(node).__name__})")


def _number(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:
        raise FormulaError("has a number that is too large") from None


def _parsed(value: Any, unit: str) -> float | None:
    """The number in `unit` that a value is; None for a formula."""
    try:
        return parse(value, unit)
    except PydanticCustomError:
        return None


def formula(unit: str, **others: float) -> Any:
    """The annotated type of a formula for a quantity in `unit` [SI]; a plain number or one with a unit is one too.

    others: units that are names in the formula, as their size in `unit` is known only later ("420 ppm" is "420*ppm"),
    with the largest number of each.
    """

    def check(value: Any) -> str:
        number = _parsed(value, unit)
        for other in others if number is None else ():
            amount = _parsed(value, other)
            if amount is not None and isfinite(amount):
                if amount > others[other]:
                    raise fault(
                        "got {got} {unit}; at most {most} {unit}",
                        {"got": f"{amount:g}", "unit": other, "most": f"{others[other]:g}"},
                    )
                return f"{amount!r}*{other}"
        if number is not None and isfinite(number):
            return repr(number)
        if number is not None or not isinstance(value, str):
            raise fault("must be a finite number or a formula of x, y and z")
        try:
            evaluate(value, dict.fromkeys((*AXES, *others), np.ones(1)))
        except FormulaError as error:
            shown = value if len(value) <= 60 else value[:57] + "..."
            raise fault(
                "'{got}' {why}; {allowed}", {"got": shown, "why": str(error), "allowed": allowed}
            ) from None
        return value

    allowed = ALLOWED.replace("pi,", f"pi, {', '.join(others)},") if others else ALLOWED

    unbounded = Quantity(unit, -inf, inf)
    return Annotated[str, BeforeValidator(check, json_schema_input_type=float | str), unbounded]
