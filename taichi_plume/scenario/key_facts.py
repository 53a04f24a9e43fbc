"""Facts about a key of a scenario's section, read from its pydantic model: meaning, type, unit, limits and default."""

import ast
import inspect
import re
import sys
import textwrap
import types
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import inf, isfinite
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from taichi_plume.quantities import Quantity
from taichi_plume.scenario.vocabulary import INPUT_FILE, Model, Vector

UNIONS = (Union, types.UnionType)


@dataclass(frozen=True)
class Facts:
    """Facts about a key of a scenario, as texts. A quantity is a number in `unit`, or a text such as "20 cm".

    limits: smallest and largest number; default: empty if the key has to be given.
    """

    meaning: str
    type: str
    unit: str
    limits: str
    default: str

    @property
    def brief(self) -> str:
        """First sentence of the key's meaning, and its unit in brackets."""
        return first_sentence(self.meaning) + (f" [{self.unit}]" if self.unit else "")

    @property
    def figures(self) -> str:
        """Type, unit, limits and default of the key as one line of text."""
        unit = f" [{self.unit}]" if self.unit else ""
        default = f"default: {self.default}" if self.default else "has to be given"
        return "; ".join(filter(None, (self.type + unit, self.limits, default)))


@cache
def facts(model: type[Model], key: str) -> Facts:
    """Return the facts about a key of a section."""
    field = model.model_fields[key]
    whole = _whole(field)
    figures = {_limits(marks) for _, marks in _numbers(whole)}
    unit, limits = figures.pop() if len(figures) == 1 else ("", "")
    meaning = meanings(model).get(key, "").replace(f" [{unit}]", "")
    return Facts(meaning, _type(whole), unit, limits, _default(field))


@cache
def quantity_unit(model: type[Model], key: str) -> str:
    """Return the unit of a key that takes quantities; "" if it takes plain numbers or several units."""
    whole = _whole(model.model_fields[key])
    units = {_limits(marks)[0] for _, marks in _numbers(whole)}
    return units.pop() if len(units) == 1 and "quantit" in _type(whole) else ""


@cache
def limits(model: type[Model], key: str) -> tuple[float, float] | None:
    """Return the smallest and largest number of a key, in its unit; None if it takes no number, or has no limits."""
    found = {_bounds(marks)[3:] for _, marks in _numbers(_whole(model.model_fields[key]))}
    low, high = found.pop() if len(found) == 1 else (-inf, inf)
    return (low, high) if isfinite(low) and isfinite(high) else None


@cache
def meanings(model: type[Model]) -> dict[str, str]:
    """Return the meaning of each key of a section: the text below the key in its class or a base class.

    The key `kind` gets the purpose of its section. pydantic's `use_attribute_docstrings` would read all sources at
    every start: importing the scenario then takes 1.6 times as long.
    """
    texts = {"kind": purpose(model)}
    for base in reversed(model.__mro__):
        if issubclass(base, BaseModel) and base is not BaseModel:
            section = _classes(base.__module__).get(base.__qualname__)
            if section is None:  # within a function
                (section,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
            assert isinstance(section, ast.ClassDef)
            for key, text in pairwise([*section.body, ast.Pass()]):
                match key, text:
                    case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                        value=ast.Constant(value=str(meaning))
                    ):
                        texts[name] = " ".join(meaning.split())
    return {key: texts[key] for key in model.model_fields if key in texts}


@cache
def _classes(module: str) -> dict[str, ast.stmt]:
    """Return the classes of a module as parsed source, by name."""
    source = inspect.getsource(sys.modules[module])
    return {part.name: part for part in ast.parse(source).body if isinstance(part, ast.ClassDef)}


def purpose(model: type[BaseModel]) -> str:
    """Return the first paragraph of the docstring of a section's class, in one line."""
    return " ".join((model.__doc__ or "").strip().split("\n\n")[0].split())


def first_sentence(text: str) -> str:
    """Return the first sentence of a text, without the full stop."""
    return re.split(r"(?<!\bal)\. ", text, maxsplit=1)[0].removesuffix(".")


def models_in(kind: object) -> Iterator[tuple[type[Model], int]]:
    """Yield the classes of sections within a type annotation, each with the number of lists and mappings around it."""
    if isinstance(kind, FieldInfo):
        kind = _whole(kind)
    if get_origin(kind) is Annotated:
        yield from models_in(get_args(kind)[0])
    elif get_origin(kind) in (*UNIONS, tuple, dict):
        several = get_origin(kind) in (tuple, dict)
        for part in get_args(kind):
            if part is not Ellipsis:
                yield from ((model, depth + several) for model, depth in models_in(part))
    elif isinstance(kind, type) and issubclass(kind, Model):
        yield kind, 0


def own_kind(model: type[Model]) -> str:
    """Return the only value that the key `kind` of a section can have; "" if it has none or several."""
    field = model.model_fields.get("kind")
    names = get_args(field.annotation) if field and get_origin(field.annotation) is Literal else ()
    return names[0] if len(names) == 1 else ""


def _whole(field: FieldInfo) -> object:
    """Return the type of a pydantic field together with its annotations, as ``Annotated[...]``."""
    return Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation


def _numbers(kind: object, marks: tuple = ()) -> Iterator[tuple[object, tuple]]:
    """Yield each type of number or formula within a type annotation, with its annotations. Sections are not entered."""
    bare, more = (get_args(kind)[0], get_args(kind)[1:]) if get_origin(kind) is Annotated else (kind, ())
    formula = bare is str and any(isinstance(mark, Quantity) for mark in more)
    if bare in (float, int) or formula:
        yield bare, (*marks, *more)
    elif get_origin(bare) is Annotated:
        yield from _numbers(bare, (*marks, *more))
    elif get_origin(bare) in UNIONS:
        for part in get_args(bare):
            yield from _numbers(part, (*marks, *more))
    elif get_origin(bare) in (tuple, dict):
        for part in get_args(bare):
            yield from _numbers(part)


def _limits(marks: tuple) -> tuple[str, str]:
    """Return the unit and the limits, such as "0 to 10", of a number with these annotations; "" if there is none."""
    unit, zero, below, low, high = _bounds(marks)
    if low == -inf:
        return unit, ""
    return unit, f"{'0, or ' * zero}{_shown(low)} to {below}{_shown(high)}"


def _bounds(marks: tuple) -> tuple[str, bool, str, float, float]:
    """Return unit, whether 0 is allowed besides, "below " if the upper limit is excluded, and both limits."""
    unit, zero, below, lows, highs = "", False, "", [-inf], [inf]
    for mark in marks:
        if isinstance(mark, Quantity):
            unit, zero = mark.unit, mark.or_zero
            lows.append(mark.least)
            highs.append(mark.most)
        for limit in getattr(mark, "metadata", [mark]):
            if isinstance(limit, Ge | Gt):
                lows.append(float(limit.ge if isinstance(limit, Ge) else limit.gt))  # type: ignore[arg-type]
            elif isinstance(limit, Le | Lt):
                highs.append(float(limit.le if isinstance(limit, Le) else limit.lt))  # type: ignore[arg-type]
                below = "below " if isinstance(limit, Lt) else below
    return unit, zero, below, max(lows), min(highs)


def _shown(value: float) -> str:
    """Return a number as text: whole numbers without a point, others to six digits with a short exponent."""
    if value == int(value) and abs(value) < 1e7:
        return str(int(value))
    return re.sub(r"e\+?(-?)0*(?=\d)", r"e\1", f"{value:g}")


def _type(kind: object, marks: tuple = ()) -> str:
    """Return a type annotation in words, such as "list of 2 quantities"; marks: annotations around it."""
    if get_origin(kind) is Annotated:
        return _type(get_args(kind)[0], (*get_args(kind)[1:], *marks))
    units = any(isinstance(mark, Quantity) and mark.unit for mark in marks)
    if kind is float:
        texts = any("BeforeValidator" in type(mark).__name__ for mark in marks)
        return "quantity" if texts else "number"
    if kind is str:
        return "path" if any(mark is INPUT_FILE for mark in marks) else "formula" if units else "text"
    if kind is Any:
        return "value"
    if kind in (bool, int):
        return "true or false" if kind is bool else "whole number"
    if get_origin(kind) is Literal:
        return f"{'one of ' * (len(get_args(kind)) > 1)}{', '.join(get_args(kind))}"
    if get_origin(kind) in UNIONS:
        parts = [_type(part, marks) for part in get_args(kind) if part is not type(None)]
        return " or ".join(dict.fromkeys(parts))
    if get_origin(kind) is tuple:
        return _list(get_args(kind), marks)
    if get_origin(kind) is dict:
        part = get_args(kind)[1]
        return (
            f"{_type(part)}, for each name" if get_origin(part) is dict else f"a {_type(part)} by each name"
        )
    return "section"


def _list(parts: tuple, marks: tuple) -> str:
    """Return the type of a list in words, from the types of its items and the annotations (marks) around the list."""
    item = _type(parts[0])
    first, _, rest = item.partition(" of ")
    plural = "quantities" if first == "quantity" else item if first == "one" else f"{first}s"
    many = f"{plural} of {rest}" if rest and first != "one" else plural
    vector = next((mark for mark in marks if isinstance(mark, Vector)), None)
    if vector is not None:
        return f"list of {many}, {'one in 2-D, two in 3-D' if vector.fewer else 'one per axis'}"
    if Ellipsis not in parts:
        return f"list of {len(parts)} {many}"
    single = any("BeforeValidator" in type(mark).__name__ for mark in marks)
    return f"{f'{item}, or ' * single}list of {many}"


def _default(field: FieldInfo) -> str:
    """Return the default of a key in words; "" if the key has to be given."""
    if field.is_required():
        return ""
    value = field.default_factory() if field.default is PydanticUndefined else field.default  # type: ignore[call-arg]
    return _value(value)


def _value(value: object) -> str:
    """Return a default value in words."""
    if value is None:
        return "not given"
    if isinstance(value, Model):
        return f"{{kind: {own_kind(type(value))}}}" if own_kind(type(value)) else "all of its defaults"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, tuple | dict):
        pairs = [f"{key}: {_value(item)}" for key, item in value.items()] if isinstance(value, dict) else []
        inside = ", ".join(pairs or map(_value, value))
        return (f"{{{inside}}}" if pairs else f"[{inside}]") if value else "none"
    return str(value) or "empty"
