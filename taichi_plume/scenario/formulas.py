"""Formulas in the coordinates, such as ``-cos(pi*x)*sin(pi*y)``: Python's arithmetic with a list of allowed functions.

A formula is parsed, never executed: each node of its syntax tree is looked up here. All numbers are f64, so that no
power takes long. An undefined value becomes nan or inf, which the caller has to refuse.
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

from taichi_plume.quantities import Quantity, fault, parse

LONGEST = 1000  # characters
DEEPEST = 100  # levels of a syntax tree
AXES: tuple[str, ...] = ("x", "y", "z")
FUNCTIONS: dict[str, tuple[int, Callable[..., np.ndarray]]] = {
    **{f.__name__: (1, f) for f in (np.sin, np.cos, np.tan, np.sinh, np.cosh, np.tanh)},
    **{f"a{f.__name__[3:]}": (1, f) for f in (np.arcsin, np.arccos, np.arctan)},
    **{f.__name__: (1, f) for f in (np.exp, np.log, np.sqrt, np.sign, np.floor)},
    "abs": (1, np.abs),
    "atan2": (2, np.arctan2),
    "min": (2, np.minimum),
    "max": (2, np.maximum),
    "hypot": (2, np.hypot),
    "where": (3, np.where),
}
"""Number of arguments and function by name; ``where(x > 1, a, b)`` is a where x > 1, else b."""
OPERATORS: dict[type, Callable[..., np.ndarray]] = {
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
    """An invalid formula; the message is a few words."""


def evaluate(text: str, places: dict[str, np.ndarray]) -> np.ndarray:
    """Return the values of a formula as an array; undefined values are nan or inf. Raises FormulaError.

    places: values of the names in it: coordinates x, y, z [m] as broadcastable arrays, and sizes of units such as ppm.
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


def _value(node: ast.AST, places: dict[str, np.ndarray], depth: int) -> np.ndarray | np.float64:
    """Return the value of a node of the formula's syntax tree; places: values of names. Raises FormulaError."""
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
                raise FormulaError(f"has {node.id}, which a {len(places)}-D run has not")
            raise FormulaError(f"has the unknown name '{node.id}'")
        case ast.UnaryOp() if type(node.op) in OPERATORS:
            return OPERATORS[type(node.op)](_value(node.operand, places, depth + 1))
        case ast.BinOp() if type(node.op) in OPERATORS:
            left, right = (_value(operand, places, depth + 1) for operand in (node.left, node.right))
            return OPERATORS[type(node.op)](left, right)
        case ast.Compare(ops=[operator]) if type(operator) in OPERATORS:
            left, right = (_value(operand, places, depth + 1) for operand in (node.left, node.comparators[0]))
            return OPERATORS[type(operator)](left, right) * 1.0
        case ast.Call(func=ast.Name(), keywords=[]) if node.func.id in FUNCTIONS:
            count, function = FUNCTIONS[node.func.id]
            if len(node.args) != count:
                raise FormulaError(f"gives {node.func.id} {len(node.args)} values, it takes {count}")
            return function(*(_value(argument, places, depth + 1) for argument in node.args))
        case ast.BinOp(op=ast.BitXor()):
            raise FormulaError("has ^; write a power as **")
        case ast.Call(func=ast.Name(), keywords=[]):
            raise FormulaError(f"has the unknown function '{node.func.id}'")
    raise FormulaError(f"is not arithmetic ({type(node).__name__})")


def _number(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:
        raise FormulaError("has a number that is too large") from None


def _parsed(value: object, unit: str) -> float | None:
    """Return a number, or a text such as "20 cm", as a number in `unit`; None for other values, such as formulas."""
    try:
        return parse(value, unit)
    except PydanticCustomError:
        return None


def formula(unit: str, **others: float) -> Any:
    """Return the annotated type of a key that takes a formula, a number or a quantity such as "20 cm" in `unit` [SI].

    others: units that stay names in the formula, as their size is known only later ("420 ppm" is "420*ppm"), with their
    largest numbers.
    """

    def check(value: object) -> str:
        number = _parsed(value, unit)
        for other in others if number is None else ():
            amount = _parsed(value, other)
            if amount is not None and isfinite(amount):
                if amount > others[other]:
                    raise fault(f"got {amount:g} {other}; at most {others[other]:g} {other}")
                return f"{amount!r}*{other}"
        if number is not None and isfinite(number):
            return repr(number)
        if number is not None or not isinstance(value, str):
            raise fault("must be a finite number or a formula of x, y and z")
        try:
            evaluate(value, dict.fromkeys((*AXES, *others), np.ones(1)))
        except FormulaError as error:
            shown = value if len(value) <= 60 else value[:57] + "..."
            raise fault(f"'{shown}' {error}; {allowed}") from None
        return value

    allowed = ALLOWED.replace("pi,", f"pi, {', '.join(others)},") if others else ALLOWED

    unbounded = Quantity(unit, -inf, inf)
    return Annotated[str, BeforeValidator(check, json_schema_input_type=float | str), unbounded]
