"""One-line error messages for the validation errors of pydantic, with hints at what the user probably meant."""

import re
from collections.abc import Sequence
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.quantities import units_like
from taichi_plume.scenario.changes import Data, changed, path_of, shown
from taichi_plume.scenario.key_facts import Facts, facts, own_kind
from taichi_plume.scenario.keys import homes, kinds_at, sections_at
from taichi_plume.scenario.metal_oxides import MOX_MODELS
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.suggestions import advice, hint, meant_key, nearest
from taichi_plume.scenario.vocabulary import Model

_NO_KIND = "\0"  # stands for a missing kind, so that pydantic lists the known ones


def explain(error: ValidationError, data: Data, top: type[Model] | TypeAdapter = Scenario) -> list[str]:
    """Return one readable line ``path: message`` for each error of pydantic; top: the type that `data` should have."""
    faults = error.errors(include_url=False)
    nameless = [
        _walk(fault["loc"], data)
        for fault in faults
        if fault["type"] == "union_tag_not_found"
        or (fault["type"] == "union_tag_invalid" and fault.get("ctx", {}).get("tag") == "None")
        or (fault["type"] == "missing" and fault["loc"][-1] == "kind")
    ]
    if nameless:
        kinds = {path_of([*steps, "kind"]): _NO_KIND for steps in nameless}
        data = changed(data, kinds)
        try:
            top.validate_python(data) if isinstance(top, TypeAdapter) else top.model_validate(data)
        except ValidationError as again:
            faults = again.errors(include_url=False)
    section = Model if isinstance(top, TypeAdapter) else top
    lines = dict.fromkeys(_line(fault, data, section) for fault in faults)
    return [line for line in lines if line]


def _line(fault: ErrorDetails, data: Data, top: type[Model]) -> str | None:
    """Return the message ``path: text`` for one pydantic error; None if another error describes the fault better."""
    kind, got, context = fault["type"], fault["input"], fault.get("ctx", {})
    steps = _walk(fault["loc"], data, absent=kind == "missing")
    member = fault["loc"][-1] if fault["loc"] else ""
    if kind == "missing" and isinstance(steps[-1], int):
        steps, kind, got = steps[:-1], "too_short", _at(data, steps[:-1])
    if kind == "missing":
        parent = path_of(steps[:-1])
        return f"{parent}: missing key '{steps[-1]}'" if parent else f"missing key '{steps[-1]}'"
    steps = [*steps, *context.get("below", ())]  # of a value within a section's free part
    where = f"{path_of(steps)}: " if steps else ""
    union = isinstance(member, str) and (member[:1].isupper() or member.startswith("tagged-union["))
    if kind in ("model_type", "model_attributes_type") and union:
        return None  # a section or a name is allowed: the error about the names suffices
    if kind == "literal_error":
        if isinstance(got, dict) and str(member).startswith("literal["):
            return None  # a section or a name is allowed
        names = re.findall(r"'((?:[^'\\]|\\.)*)'", context["expected"])
        if got == _NO_KIND:
            parent = f"{path_of(steps[:-1])}: " if steps[:-1] else ""
            return (
                f"{parent}missing key 'kind'; {_lost_kind(steps[:-1], data)}known kinds: {', '.join(names)}"
            )
        return f"{where}got {shown(got)}; {hint(got, names)}allowed: {', '.join(names)}"
    if kind == "union_tag_invalid":
        names = re.findall(r"'([^']*)'", context["expected_tags"])
        if context["tag"] == _NO_KIND:
            return f"{where}missing key 'kind'; {_lost_kind(steps, data)}known kinds: {', '.join(names)}"
        tag = visible(context["tag"], LONGEST_VALUE)
        meant = _meant_kind(tag, names, top)
        return f"{where}unknown kind '{tag}'; {meant}known kinds: {', '.join(names)}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"{where}must be a mapping (key: value), got {shown(got)}{_keys_there(steps, got, top)}"
    if kind == "tuple_type":
        return f"{where}must be a list, got {shown(got)}{_as_list(got, _facts(steps, data, top))}"
    if kind == "string_pattern_mismatch":
        letters = "at most 64 letters, digits, '_', '.' or '-', the first a letter or digit"
        return f"{where}got {shown(got)}: must be {letters}"
    if kind in ("too_long", "too_short"):
        bound = "at most" if kind == "too_long" else "at least"
        limit = context.get("max_length", context.get("min_length"))
        if kind == "too_short" and limit is not None and len(got) >= limit:
            return None  # pydantic omits items with errors of their own
        fact = _facts(steps, data, top)
        if fact is not None and (_axes(fact) or re.match(r"(list of )+(lists of )?\d|.*in 3-D", fact.type)):
            start = ".start." in where
            form = fact.type.replace("list of lists", "list") if isinstance(steps[-1], int) else fact.type
            axes = _axes(fact) or ": x and y" * start
            height = "; the height of drones is start.altitude" * (start and len(got) == 3)
            return f"{where}has {len(got)} number{'s' * (len(got) != 1)}, must be a {form}{axes}{height}"
        items = f"{limit} item{'s' * (limit > 1)}" if limit is not None else f"{len(got) + 1} items"
        return f"{where}must have {bound} {items}, got {len(got)}"
    fact = _facts(steps, data, top)
    unit = fact.unit if fact is not None else ""
    if kind in ("float_parsing", "float_type"):
        key = next((step for step in reversed(steps) if isinstance(step, str)), "")
        such = (
            " of degrees, such as 90"
            if key.endswith("_deg")
            else f"{f' of {unit}' * bool(unit)}, such as 0.08"
        )
        return f"{where}got {shown(got)}: must be a plain number{such}{_comma(got)}"
    if kind == "quantity":
        message = f"{where}got {shown(got)}: {fault['msg']}"
        comma = _comma(got)
        fits = f"; units that fit: {units_like(context['unit'])}" if "unit" in context and not comma else ""
        return f"{message}{comma or fits}"
    if kind == "fault" and {"key", "allowed"} <= context.keys():
        return where + _unknown_key(fault["msg"], context, steps, top)
    if kind == "fault":
        return where + fault["msg"]
    if kind.startswith(("int_", "bool_")):
        what = "a whole number" if kind.startswith("int") else "true or false"
        return f"{where}got {shown(got)}: must be {what}{_comma(got)}"
    message = re.sub(r"^(Input|String|Value) should", "must", fault["msg"]).replace("valid string", "text")
    message = message.replace("greater than or equal to", "at least").replace(
        "less than or equal to", "at most"
    )
    return f"{where}got {shown(got)}: {message}"


def _meant_kind(tag: str, names: Sequence[str], top: type[Model]) -> str:
    """Return a hint about an unknown `kind`: a similar kind, a sensor model, or the section that has this kind."""
    if "mox" in names and (model := nearest(tag, MOX_MODELS, cutoff=0.8)):
        return f"did you mean kind: mox, model: {model}? "
    text = hint(tag, names)
    there = [] if text or top is Model else kinds_at(tag.casefold(), top)
    return f"{tag.casefold()} is a kind of {' or '.join(there)}; " if there else text


def _lost_kind(steps: Sequence[int | str], data: Data) -> str:
    """Return a hint for a section without a key `kind`: a key such as "kind:mox" or "type" that was meant as `kind`."""
    section = _at(data, steps)
    for key, value in section.items() if isinstance(section, dict) else ():
        if key.startswith("kind:"):
            return f"put a space after the colon of '{visible(key, LONGEST_VALUE)}'; "
        if key in ("type", "name", "class") and isinstance(value, str):
            return f"write kind: {visible(value, LONGEST_VALUE)}, not {key}; "
    return ""


def _unknown_key(message: str, context: dict, steps: Sequence[int | str], top: type[Model]) -> str:
    """Return the message about an unknown key, with the sections that do have a key of this name, or another hint."""
    key, allowed = context["key"], context["allowed"].split(", ")
    close = meant_key(key, allowed, cutoff=0.8)
    there = [] if close or top is Model else homes(key, steps, top)
    if there:
        text = f"it is a key of {' or '.join(there[:2])}"
    elif ":" in key:
        text = "put a space after the colon"
    elif key[-1:] in ")]":
        text = "write lists in brackets, such as [1, 2]"
    else:
        text = "" if meant_key(key, allowed) else advice(key, allowed)
    return f"unknown key '{key}'; {text}; allowed: {', '.join(allowed)}" if text else message


def _keys_there(steps: Sequence[int | str], got: object, top: type[Model]) -> str:
    """Return a hint for a section whose value `got` is no mapping: the kinds or keys that the section may have."""
    models = sections_at(steps, top)
    kinds = [own_kind(model) for model in models if own_kind(model)]
    if kinds:
        meant = nearest(got, kinds) if isinstance(got, str) else ""
        if meant:
            return f"; did you mean {{kind: {meant}}}?"
        more = advice(got, kinds)
        return f"; start with kind: {', '.join(kinds)}" + f" ({more})" * bool(more)
    if len(models) != 1 or models[0] is top:
        return ""
    return f"; its keys are {', '.join(models[0].model_fields)}"


def _as_list(got: object, key: Facts | None) -> str:
    """Return a hint on how to write a list, for a value `got` that should be one; key: facts about its key."""
    if isinstance(got, str | dict) and key is not None and "quantit" in key.type:
        return f"; write it in brackets, such as [1, 2]: a {key.type}{_axes(key)}"
    if isinstance(got, dict):
        return "; start each item with '- '"
    return "; write [] for none" if got is None else "; write it in brackets: [...]"


def _axes(key: Facts) -> str:
    """Return the axes of a list of coordinates, such as ": x and y", as its type or meaning says; otherwise ""."""
    if key.type.endswith("one per axis") or "in 3-D along z" in key.meaning:
        return ": x, y and in 3-D z"
    return ": x and y" if re.search(r"\bx and y\b", key.meaning) else ""


def _comma(got: object) -> str:
    """Return a hint for a text with a decimal comma, such as "0,5"; "" for any other value."""
    match = re.match(r"\s*([-+]?\d+),(\d+)", got) if isinstance(got, str) else None
    return f"; write decimals with a point, thousands without a comma: {match[1]}.{match[2]}" if match else ""


def _at(data: Data, steps: Sequence[int | str]) -> Any:
    """Return the value found in `data` by following the keys and list indices `steps`."""
    value: Any = data
    for step in steps:
        value = value[step]
    return value


def _facts(steps: Sequence[int | str], data: Data, top: type[Model]) -> Facts | None:
    """Return the facts about the key at a path, for the section's kind in `data`; None if ambiguous."""
    path = list(steps)
    while path and isinstance(path[-1], int):
        path.pop()
    if not path:
        return None
    section, key = _at(data, path[:-1]), str(path[-1])
    kind = section.get("kind") if isinstance(section, dict) else None
    models = [model for model in sections_at(path[:-1], top) if key in model.model_fields]
    candidates = {facts(model, key) for model in models if own_kind(model) in ("", kind)}
    return candidates.pop() if len(candidates) == 1 else None


def _walk(location: tuple[int | str, ...], data: Data, absent: bool = False) -> list[int | str]:
    """Return the keys and indices of an error in the YAML data: pydantic's location without names of union members.

    absent: whether the last step is a key that is missing from the data.
    """
    steps: list[int | str] = []
    place: Any = data
    known = None  # the section whose kind was the previous step
    for n, step in enumerate(location):
        if isinstance(place, dict):
            if place.get("kind") == step and place is not known:
                known = place  # a section may have a key of the same name
                continue
            if step not in place and not (absent and n == len(location) - 1):
                continue  # the model's name
            place = place.get(step)
        elif isinstance(place, (list, tuple)) and isinstance(step, int):
            place = place[step] if step < len(place) else None
        else:
            continue
        steps.append(step)
    return steps
