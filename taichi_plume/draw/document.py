"""Edits of a YAML text that change only the characters of one value: comments, order and spelling of all else stay.

A round trip through an object model, as by ruamel.yaml, breaks lines of long lists in another way. Here the marks of
PyYAML's nodes say where a value stands, and each edit is verified: the new text has exactly the expected data.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import lru_cache
from math import inf
from typing import Any

import yaml

from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.yaml_text import LARGEST_FILE, LineError, parse
from taichi_plume.scenario.changes import Data, changed, path_of, steps_of

Steps = Sequence[str]
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml, ten times as fast, where PyYAML has it
_ONLY = "only the text itself can be edited there (aliases, or an unusual layout)"


class EditError(InputError):
    """Error: an edit is impossible; the text stays as it was."""


@lru_cache(8)
def data_of(text: str) -> Data:
    """Return keys and values of a YAML text, not to be changed; of an empty text, none. Raises LineError."""
    if len(text.encode("utf-8", "surrogatepass")) > LARGEST_FILE:
        raise LineError(
            f"the text is larger than {LARGEST_FILE >> 20} MiB, the most that a scenario may have"
        )
    data = parse(text)
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise LineError("must be a mapping (key: value)")
    return data


def value_at(data: Mapping[str, Any], path: str) -> Any:
    """Return the value at a path such as ``obstacles[0].center``; None if there is none."""
    place: Any = data
    for step in steps_of(path) if path else ():
        if isinstance(place, list) and step.isdecimal() and int(step) < len(place):
            place = place[int(step)]
        else:
            place = place.get(step) if isinstance(place, dict) else None
    return place


def parent_of(path: str) -> tuple[str, str]:
    """Return the path of the section that contains a path, and the last step: a key or an index."""
    *above, last = steps_of(path)
    return path_of(above), last


def line_of(text: str, path: str, fault: str = "") -> int:
    """Return the line of a path in a text, from 0: that of the innermost step which the text has.

    fault: error which says "line N" where the text is no YAML.
    """
    found = re.match(r"line (\d+)\b", fault)
    if found:
        return int(found[1]) - 1
    try:
        node, key = _chain(text, steps_of(path) if path else ())[-1]
    except yaml.YAMLError:
        return 0
    place = key or node
    return place.start_mark.line if place is not None else 0


def set_value(text: str, path: str, value: object) -> str:
    """Return the text with another value at a path; missing keys and sections are added. Raises EditError."""
    return set_values(text, {path: value})


def set_values(text: str, values: Mapping[str, object]) -> str:
    """Return the text with other values at paths; missing keys and sections are added. Raises EditError."""

    def edit() -> str:
        new = text
        for path, value in values.items():
            new = _set(new, steps_of(path), value)
        return new

    return _edited(text, lambda data: changed(data, values), edit) if values else text


def add(text: str, path: str, item: object) -> str:
    """Return the text with a further item at the end of the list at a path, which may be missing. Raises EditError."""

    def expected(data: Data) -> Data:
        return changed(data, {path: [*(value_at(data, path) or []), item]})

    return _edited(text, expected, lambda: _add(text, path, item))


def delete(text: str, path: str) -> str:
    """Return the text without the key or list item at a path. Raises EditError."""
    above, last = parent_of(path)

    def expected(data: Data) -> Data:
        data = deepcopy(data)
        place = value_at(data, above)
        del place[int(last) if isinstance(place, list) else last]
        return data

    return _edited(text, expected, lambda: _delete(text, steps_of(path)))


def duplicate(text: str, path: str) -> str:
    """Return the text with a copy of the list item at a path, spelled alike, after its list. Raises EditError."""
    above, last = parent_of(path)

    def expected(data: Data) -> Data:
        items = value_at(data, above)
        return changed(data, {above: [*items, items[int(last)]]})

    def copied() -> str:
        *_, (items, _), (item, _) = _chain(text, steps_of(path))
        start, end = item.start_mark.index, _end(items.value[-1])
        if items.flow_style:
            return f"{text[:end]}, {text[start : _end(item)]}{text[end:]}"
        return _after_line(text, end, text[text.rfind("\n", 0, start) + 1 : _end(item)])

    return _edited(text, expected, copied)


def _edited(text: str, expected: Any, edit: Any) -> str:
    """Return the result of an edit if it has the expected data. Raises EditError."""
    try:
        data = expected(data_of(text))
        new = edit()
        if data_of(new) == data:
            return new
    except LineError as fault:
        raise EditError(str(fault)) from None
    except (yaml.YAMLError, LookupError, TypeError, ValueError, AttributeError):
        pass
    raise EditError(_ONLY)


# ---------------------------------------------------------------- characters


def flow(value: object) -> str:
    """Return a value as YAML on one line, as it may stand within brackets."""
    dumped = yaml.safe_dump([value], default_flow_style=True, width=inf, allow_unicode=True, sort_keys=False)
    return dumped.strip()[1:-1]


@lru_cache(2)
def _tree(text: str) -> yaml.Node | None:
    return yaml.compose(text, LOADER)


def _chain(text: str, steps: Steps) -> list[tuple[yaml.Node, yaml.Node | None]]:
    """Return (value node, key node) of each existing step along a path, from the root; items have no key node."""
    node: Any = _tree(text)
    chain: list[tuple[yaml.Node, yaml.Node | None]] = [(node, None)]
    for step in steps:
        if isinstance(node, yaml.SequenceNode) and step.isdecimal() and int(step) < len(node.value):
            node, key = node.value[int(step)], None
        elif isinstance(node, yaml.MappingNode):
            pair = next(((value, key) for key, value in node.value if key.value == step), None)
            if pair is None:
                break
            node, key = pair
        else:
            break
        chain.append((node, key))
    return chain


def _end(node: yaml.Node) -> int:
    """Return the index after the last character of a node; PyYAML's block collections end at the next token."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return node.end_mark.index


def _after_line(text: str, index: int, line: str) -> str:
    """Return the text with a line inserted below the line of a character; comments behind the character stay there."""
    if text[:index].endswith("\n"):
        return f"{text[:index]}{line}\n{text[index:]}"
    stop = text.find("\n", index)
    stop = len(text) if stop < 0 else stop
    return f"{text[:stop]}\n{line}{text[stop:]}"


def _set(text: str, steps: Steps, value: object) -> str:
    chain = _chain(text, steps)
    node, key = chain[-1]
    missing = steps[len(chain) - 1 :]
    for step in reversed(missing[1:]):
        value = {step: value}
    if node is None:
        return f"{text}{missing[0]}: {flow(value)}\n"
    if not missing:
        return _replaced(text, node, key, flow(value))
    if isinstance(node, yaml.MappingNode):
        return _with_key(text, node, missing[0], f" {flow(value)}")
    return _replaced(text, node, key, flow({missing[0]: value}))


def _replaced(text: str, node: yaml.Node, key: yaml.Node | None, new: str) -> str:
    start, end = node.start_mark.index, _end(node)
    if key is not None and (start == end or (isinstance(node, yaml.CollectionNode) and not node.flow_style)):
        start = text.index(":", key.end_mark.index) + 1  # an empty value, or a section on the lines below
        new = f" {new}"
        end = max(start, end)
    return text[:start] + new + text[end:]


def _with_key(text: str, node: yaml.MappingNode, key: str, value: str) -> str:
    """Return the text with a further key in a mapping; value: characters after the colon."""
    if not node.value:
        return _replaced(text, node, None, f"{{{key}:{value}}}")
    end = _end(node.value[-1][1])
    if node.flow_style:
        return f"{text[:end]}, {key}:{value}{text[end:]}"
    return _after_line(text, end, " " * node.value[0][0].start_mark.column + f"{key}:{value}")


def _add(text: str, path: str, item: object) -> str:
    steps = steps_of(path)
    chain = _chain(text, steps)
    node, key = chain[-1]
    new, missing = flow(item), steps[len(chain) - 1 :]
    if isinstance(node, yaml.SequenceNode) and node.value and not missing:
        if node.flow_style:
            end = _end(node.value[-1])
            return f"{text[:end]}, {new}{text[end:]}"
        return _after_line(text, _end(node), " " * node.start_mark.column + f"- {new}")
    lines = all(not above.flow_style for above, _ in chain[:-1] if above is not None)
    if not missing and lines and key is not None:  # an empty list becomes one with an item per line
        return _replaced(text, node, key, f"\n{' ' * (key.start_mark.column + 2)}- {new}").replace(
            ": \n", ":\n"
        )
    if len(missing) == 1 and isinstance(node, yaml.MappingNode) and not node.flow_style and node.value:
        indent = " " * (node.value[0][0].start_mark.column + 2)
        return _with_key(text, node, missing[0], f"\n{indent}- {new}")
    return _set(text, steps, [item])


def _delete(text: str, steps: Steps) -> str:
    *_, (parent, key_of_parent), (node, key) = _chain(text, steps)
    spans = list(_spans(parent))
    number = next(n for n, (first, last) in enumerate(spans) if last is node and first in (key, node))
    start, end = spans[number][0].start_mark.index, _end(node)
    if len(spans) == 1:
        return _replaced(text, parent, key_of_parent, "[]" if isinstance(parent, yaml.SequenceNode) else "{}")
    if parent.flow_style:
        if number:
            return text[: _end(spans[number - 1][1])] + text[end:]
        return text[:start] + text[spans[1][0].start_mark.index :]
    if isinstance(parent, yaml.SequenceNode):
        start = text.rindex("-", 0, start)
    line = text.rfind("\n", 0, start) + 1
    if text[line:start].strip():  # the first key of an item stands behind its dash
        following = spans[number + 1][0].start_mark.index
        return text[:start] + text[following:]
    stop = text.find("\n", end) if not text[:end].endswith("\n") else end - 1
    return text[:line] + (text[stop + 1 :] if stop >= 0 else "")


def _spans(parent: Any) -> Iterator[tuple[yaml.Node, yaml.Node]]:
    """Yield first and last node of each child: key and value, or twice the item."""
    for child in parent.value:
        yield child if isinstance(child, tuple) else (child, child)
