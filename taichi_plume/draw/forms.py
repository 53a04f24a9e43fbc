"""Forms: all keys of a section with units, limits, defaults and explanations, made from the models of the scenario."""

import re
from dataclasses import dataclass
from functools import cache
from math import floor, log10
from typing import Any, Literal

from pydantic import ValidationError

from taichi_plume.draw.document import EditError, data_of, delete, flow, parent_of, set_value, value_at
from taichi_plume.draw.objects import classes_at, model_at, read
from taichi_plume.guard.yaml_text import LineError, parse
from taichi_plume.quantities import parse as quantity
from taichi_plume.quantities import split
from taichi_plume.report.theme import short
from taichi_plume.scenario.changes import Data
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.error_messages import explain
from taichi_plume.scenario.key_facts import facts, limits, meanings, models_in, own_kind, purpose
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import Model, vector

Field = Literal["number", "point", "switch", "choice", "section", "list", "text"]
AXES = ("x", "y", "z")
NUMBERS = ("quantity", "number", "whole number")
STEPS = 100  # of a slider, about
WIDEST = 360.0  # range of a slider: beyond, a pixel is too coarse for the usual values
LONGEST_SUMMARY = 44  # characters


@dataclass(frozen=True)
class Key:
    """Key of a section, as the section's model declares the key.

    default: in words, "" if the key has to be given; choices: all allowed names, or none; slider: lowest number,
    highest number and step, None without a slider; axes: labels of the numbers of a list of fixed length; fewer: of a
    list with a number per axis, the count of axes without a number; is_section: whether the key may have a form of its
    own; is_text: whether each entry is a text, even "3".
    """

    name: str
    field: Field
    default: str
    unit: str
    meaning: str
    choices: tuple[str, ...] = ()
    slider: tuple[float, float, float] | None = None
    axes: tuple[str, ...] = ()
    fewer: int | None = None
    is_section: bool = False
    is_text: bool = False


@dataclass(frozen=True)
class Row:
    """Key of a section in a form. given: value in the text, None if absent; value: the same as YAML, "" if absent.

    field: kind of entry; of an absent key, or one whose value fits, that of the key. axes: labels of its numbers.
    """

    path: str
    about: Key
    given: Any
    value: str
    field: Field
    axes: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Name of the key."""
        return self.about.name

    @property
    def meaning(self) -> str:
        """Meaning of the key, its type, limits and default."""
        return self.about.meaning

    @property
    def numbers(self) -> list[tuple[str, str]]:
        """Number and unit of each entry, as in the text; the number is "" if absent."""
        given = self.given if self.field == "point" and self.given else [self.given]
        parts = [_number(item, self.about.unit) for item in given]
        return parts + [("", self.about.unit)] * (len(self.axes) - len(parts))

    @property
    def least(self) -> int:
        """Count of numbers that a list has to have; the floor's size may have a height besides."""
        return 2 if self.key == "size" and self.about.fewer is None else len(self.axes)

    @property
    def position(self) -> float | None:
        """Value for the slider, in the unit of the key; None if neither text nor default has a number."""
        for value in (self.given, self.about.default):
            try:
                return quantity(value, self.about.unit)
            except ValueError:
                continue
        return None

    def slid(self, value: float) -> str:
        """Return the entry for a position of the slider, in the unit in which the text has the number.

        Raises EditError if the text has a word that is no such unit.
        """
        assert self.about.slider is not None
        low, high, step = self.about.slider
        value = min(max(round(value / step) * step, low), high)
        unit = self.numbers[0][1]
        if unit != self.about.unit:
            try:
                zero, unity = (quantity(f"{n} {unit}", self.about.unit) for n in (0, 1))
            except ValueError as fault:
                raise EditError(f"{self.path}: {fault}") from None
            value = (value - zero) / (unity - zero)
        return f"{value:.6g}"


def _number(item: object, unit: str) -> tuple[str, str]:
    """Return the number and the unit of a value of the text."""
    if item is None:
        return "", unit
    found = split(item) if isinstance(item, str) else None
    if isinstance(item, str) and found is not None:
        return item.strip().removesuffix(found[1]).strip(), found[1]
    return str(item), unit


def prepare() -> None:
    """Read the meanings of all keys of a scenario, which the first forms would wait for."""
    waiting: list[type[Model]] = [Scenario]
    models = set(waiting)
    while waiting:
        model = waiting.pop()
        meanings(model)
        inner = {part for field in model.model_fields.values() for part, _ in models_in(field)} - models
        models |= inner
        waiting += inner


def title(data: Data, path: str) -> str:
    """Return the purpose of the section at a path, in a sentence; "" if its kind is not known."""
    model = model_at(data, path)
    return purpose(model) if model is not None else ""


def rows(data: Data, path: str) -> list[Row]:
    """Return the form of the section at a path: its kind first, then keys of the text, then those left out."""
    model = model_at(data, path)
    kinds = kinds_at(data, path)
    values = value_at(data, path)
    values = values if isinstance(values, dict) else {}
    found = []
    if kinds:
        meaning = "; ".join(f"{name}: {purpose(kinds[name])}" for name in kinds)
        found.append(_row(Key("kind", "choice", "", "", meaning, tuple(kinds)), path, values))
    names = [name for name in (model.model_fields if model else ()) if name != "kind" or not kinds]
    domain = read(data, "domain")
    room = AXES[: len(domain.extent) if isinstance(domain, Domain) else 2]
    known = [_row(_key(model, name), path, values, room) for name in names if model is not None]
    return [*found, *sorted(known, key=lambda row: not row.value)]


def _row(about: Key, path: str, values: Data, room: tuple[str, ...] = ()) -> Row:
    given, field = values.get(about.name), about.field
    is_list = isinstance(given, list) and bool(given) and all(isinstance(item, dict) for item in given)
    if about.is_section and (is_list or isinstance(given, dict)):
        field = "list" if is_list else "section"
    elif (field == "list" and not is_list) or (about.name in values and not _fits(field, given)):
        field = "text"
    axes = _labels(about, given, values, room) if field == "point" else ()
    text = "" if about.name not in values else given if isinstance(given, str) else flow(given)
    return Row(f"{path}.{about.name}" if path else about.name, about, given, text, field, axes)


def _fits(field: Field, given: object) -> bool:
    """Return whether a kind of entry can show a value; all else is shown as text."""
    if field == "point":
        return (
            isinstance(given, list) and 0 < len(given) <= len(AXES) and all(_fits("number", x) for x in given)
        )
    if field == "number":
        return isinstance(given, int | float | str) and not isinstance(given, bool)
    return field == "list" or isinstance(
        given, bool if field == "switch" else str if field == "choice" else ()
    )


def _labels(about: Key, given: Any, values: Data, room: tuple[str, ...]) -> tuple[str, ...]:
    """Return the labels of the numbers of a list: of all that it has, and of all that it should have."""
    names, face = about.axes, values.get("face")
    if about.fewer is not None:
        across = face[:1] if about.fewer and isinstance(face, str) else ""
        names = tuple(name for name in (*room, *AXES[len(room) :]) if name != across)
        names = names[: max(len(room) - about.fewer, len(given or ()))]
    return names


@cache
def _key(model: type[Model], name: str) -> Key:
    about, declared = facts(model, name), model.model_fields[name]
    kind, _, rest = about.type.partition(" or section")
    choices: tuple[str, ...] = ()
    field: Field = "text"
    axes: tuple[str, ...] = ()
    number, across = re.match(r"list of (\d) (quantities|numbers)", kind), vector(model, name)
    depths = {depth for _, depth in models_in(declared)}
    if kind.startswith("one of ") and " or " not in kind and not rest:
        field, choices = "choice", tuple(kind.removeprefix("one of ").split(", "))
    elif kind in NUMBERS:
        field = "number"
    elif kind == "true or false":
        field, choices = "switch", ("true", "false")
    elif across is not None and "formula" not in kind:
        field = "point"
    elif number is not None or (model is Domain and name == "size"):
        count = int(number[1]) if number else len(AXES)
        if about.unit[:1] == "m":
            field, axes = "point", AXES[:count]
        elif count == 2 and about.unit:
            field, axes = "point", ("from", "to")
    elif depths:
        field = "section" if 0 in depths else "list"
    return Key(
        name, field, about.default, about.unit, f"{about.meaning} ({about.figures})", choices,
        _slider(model, name) if field == "number" else None, axes, across.fewer if across else None,
        0 in depths, kind in ("text", "path", "formula"),
    )  # fmt: skip


def _slider(model: type[Model], name: str) -> tuple[float, float, float] | None:
    """Return lowest and highest number and step of a key whose range a slider can show; None for all others.

    Not of ranges that merely exclude slips, such as 0 to 100 m/s: usual values would lie within a pixel.
    """
    found, about = limits(model, name), facts(model, name)
    if found is None or found[1] - found[0] > WIDEST:
        return None
    (low, high), default = found, model.model_fields[name].default
    span, is_whole = high - low, about.type == "whole number"
    size = abs(default) if isinstance(default, int | float) else 0.0
    widest = (
        span
        if size >= span / 30 or about.unit in ("deg", "K")
        else 100
        if is_whole
        else 0
        if about.unit
        else 1
    )
    if span > widest or 0 < size < span / STEPS:
        return None
    step = 10.0 ** floor(log10(span / STEPS))
    return low, high, 1 if is_whole else step * max(n for n in (1, 2, 5) if n * step <= span / STEPS)


def summary(value: object) -> str:
    """Return the keys and values of a section in short words, its kind first."""
    if not isinstance(value, dict):
        return short(flow(value), LONGEST_SUMMARY)
    words = [str(value["kind"])] if "kind" in value else []
    for key, part in value.items():
        if isinstance(part, dict):
            words.append(f"{key} {part.get('kind', '…')}")
        elif isinstance(part, list) and any(isinstance(item, dict | list) for item in part):
            words.append(f"{len(part)} {key if len(part) > 1 else key.removesuffix('s')}")
        elif key != "kind":
            words.append(f"{key} {part if isinstance(part, str) else flow(part)}")
    return short(", ".join(words), LONGEST_SUMMARY)


def kinds_at(data: Data, path: str) -> dict[str, type[Model]]:
    """Return the classes that a section at a path may have, by the names of their kinds; none if it has no kinds."""
    return {own_kind(model): model for model in classes_at(data, path) if own_kind(model)}


def entered(text: str, data: Data, path: str, entry: str) -> str:
    """Return the text with an entry of a form at the path of a key, or of a number of its list. Raises EditError.

    An empty entry removes the key. A number keeps the unit that the text has there. A new kind of a section keeps the
    keys that both kinds have. Refused is what the key's model refuses about this key alone.
    """
    above, last = parent_of(path)
    whole = above if last.isdecimal() else path
    section, key = parent_of(whole)
    model, present, entry = model_at(data, section), value_at(data, path), entry.strip()
    if not entry:
        return _without(text, data, path, model)
    if key == "kind" and (kinds := kinds_at(data, section)):
        return _with_kind(text, data, section, kinds, entry)
    value = _read(path, entry, present, _key(model, key) if model and key in model.model_fields else None)
    if value == present and isinstance(value, bool) == isinstance(present, bool):
        return text
    items = value_at(data, whole)
    if whole != path and isinstance(items, list) and int(last) == len(items):
        new = set_value(text, whole, [*items, value])  # such as a height, once the room has one
    else:
        new = set_value(text, path, value)
    _check(new, section, model, path)
    return new


def _read(path: str, entry: str, present: object, about: Key | None) -> Any:
    """Return the value of an entry: a text, a number with the unit that it had, or as YAML reads it."""
    if about is not None and about.is_text:
        return entry
    unit = split(present) if isinstance(present, str) else None
    if unit is not None:
        try:
            float(entry)
            return f"{entry} {unit[1]}"
        except ValueError:
            pass
    try:
        return parse(entry)
    except LineError as fault:
        raise EditError(f"{path}: {fault}") from None


def _check(text: str, section: str, model: type[Model] | None, path: str) -> None:
    """Raise EditError for what the model of a section refuses about a path, whatever the other keys are."""
    values = value_at(data_of(text), section)
    if model is None or not isinstance(values, dict):
        return
    known = {key: value for key, value in values.items() if key in model.model_fields}
    try:
        model.model_validate(known)
    except ValidationError as error:
        start = f"{section}." if section else ""
        lines = [start + line for line in explain(error, known, model)]
        own = [line for line in lines if re.match(re.escape(path) + r"[:.\[]", line)]
        if own:
            raise EditError(*own) from None


def _without(text: str, data: Data, path: str, model: type[Model] | None) -> str:
    above, last = parent_of(path)
    place = value_at(data, above)
    if isinstance(place, list) and last.isdecimal():
        if int(last) < len(place) - 1 or len(place) == 1:
            raise EditError(f"{path}: has to be given")
        new = delete(text, path) if int(last) < len(place) else text
        section, _ = parent_of(above)
        _check(new, section, model, above)
        return new
    if not isinstance(place, dict) or last not in place:
        return text
    if last == "kind" or (model and last in model.model_fields and model.model_fields[last].is_required()):
        raise EditError(f"{path}: has to be given")
    return delete(text, path)


def lost(data: Data, section: str, kind: str) -> list[str]:
    """Return the keys of a section that another kind of it lacks."""
    values, model = value_at(data, section), kinds_at(data, section).get(kind)
    return (
        [key for key in values if key not in model.model_fields] if model and isinstance(values, dict) else []
    )


def _with_kind(text: str, data: Data, section: str, kinds: dict[str, type[Model]], kind: str) -> str:
    if kind not in kinds:
        raise EditError(f"{section}.kind: '{kind}'; allowed: {', '.join(kinds)}")
    if not isinstance(value_at(data, section), dict):
        return set_value(text, section, {"kind": kind})
    text = set_value(text, f"{section}.kind", kind)
    for key in lost(data, section, kind):
        text = delete(text, f"{section}.{key}")
    return text
