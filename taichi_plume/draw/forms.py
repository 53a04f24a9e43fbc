"""Forms: all keys of a section with units, defaults and explanations, made from the models of the scenario."""

from dataclasses import dataclass

from taichi_plume.draw.document import EditError, delete, flow, set_value, value_at
from taichi_plume.draw.objects import classes_at, model_at
from taichi_plume.guard.yaml_text import LineError, parse
from taichi_plume.scenario.changes import Data
from taichi_plume.scenario.key_facts import facts, meanings, models_in, own_kind, purpose
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import Model

NOT_GIVEN = "(default)"


@dataclass(frozen=True)
class Row:
    """Key of a section in a form. value: as written in the text, "" if absent; choices: all allowed values, or none.

    is_section: whether the key has a form of its own, at `path`.
    """

    path: str
    key: str
    value: str
    default: str
    unit: str
    meaning: str
    choices: tuple[str, ...]
    is_section: bool

    @property
    def label(self) -> str:
        """The key with its unit."""
        return f"{self.key} [{self.unit}]" if self.unit else self.key


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
        kind = values.get("kind")
        meaning = "; ".join(f"{name}: {purpose(kinds[name])}" for name in kinds)
        found.append(Row(_inner(path, "kind"), "kind", str(kind or ""), "", "", meaning, tuple(kinds), False))
    names = [name for name in (model.model_fields if model else ()) if name != "kind" or not kinds]
    known = [_row(model, path, name, values) for name in names if model is not None]
    return [*found, *sorted(known, key=lambda row: not row.value)]


def _row(model: type[Model], path: str, name: str, values: Data) -> Row:
    about = facts(model, name)
    given = values.get(name)
    text = "" if name not in values else given if isinstance(given, str) else flow(given)
    choices: tuple[str, ...] = ()
    if about.type.startswith("one of ") and " or " not in about.type:
        choices = tuple(about.type.removeprefix("one of ").split(", "))
    elif about.type == "true or false":
        choices = ("true", "false")
    inside = any(depth == 0 for _, depth in models_in(model.model_fields[name]))
    meaning = about.meaning + f" ({about.figures})"
    return Row(_inner(path, name), name, text, about.default, about.unit, meaning, choices, inside)


def kinds_at(data: Data, path: str) -> dict[str, type[Model]]:
    """Return the classes that a section at a path may have, by the names of their kinds; none if it has no kinds."""
    return {own_kind(model): model for model in classes_at(data, path) if own_kind(model)}


def entered(text: str, data: Data, path: str, entry: str) -> str:
    """Return the text with an entry of a form at a key's path; an empty entry removes the key. Raises EditError.

    A new kind of a section keeps the keys that both kinds have.
    """
    present = value_at(data, path)
    entry = entry.strip()
    section, _, key = path.rpartition(".")
    if not entry or entry == NOT_GIVEN:
        return text if present is None and not _has(data, section, key) else delete(text, path)
    if key == "kind" and (kinds := kinds_at(data, section)):
        return _with_kind(text, data, section, kinds, entry)
    try:
        value = parse(entry)
    except LineError as fault:
        raise EditError(f"{path}: {fault}") from None
    return text if value == present else set_value(text, path, value)


def _has(data: Data, section: str, key: str) -> bool:
    values = value_at(data, section)
    return isinstance(values, dict) and key in values


def _with_kind(text: str, data: Data, section: str, kinds: dict[str, type[Model]], kind: str) -> str:
    if kind not in kinds:
        raise EditError(f"{section}.kind: '{kind}'; allowed: {', '.join(kinds)}")
    values = value_at(data, section)
    if not isinstance(values, dict):
        return set_value(text, section, {"kind": kind})
    text = set_value(text, f"{section}.kind", kind)
    for name in values:
        if name not in kinds[kind].model_fields:
            text = delete(text, f"{section}.{name}")
    return text


def _inner(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key
