"""Completions of a scenario's text: keys and values that may stand at a place, from the models of the scenario."""

import re
from typing import Any, NamedTuple

import yaml

from taichi_plume.draw.document import LOADER, data_of, parent_of
from taichi_plume.draw.forms import kinds_at, rows
from taichi_plume.guard.yaml_text import LineError
from taichi_plume.scenario.changes import path_of
from taichi_plume.scenario.key_facts import first_sentence, purpose

HERE = "\ue000"  # stands for the word that is being typed
WORD = r"[\w.]*"


class Completion(NamedTuple):
    """Word that may stand at a place. unit: of a key's value; meaning: a sentence."""

    word: str
    unit: str
    meaning: str


def completions(text: str, index: int) -> list[Completion]:
    """Return what may stand in a text in place of the word that ends at a character: keys, or values of a key.

    Keys that the section has already are left out. An incomplete text is read as far as the word.
    """
    begin = index - _length(WORD, text[:index][::-1])
    before, after = text[:begin], text[index + _length(WORD + ":?", text[index:]) :]
    is_key = not before.rstrip(" ").endswith(":")
    word = f"{HERE}: 0" if is_key else HERE
    for whole in (f"{before}{word}{after}", f"{before}{word}{_closing(before)}"):
        try:
            data = data_of(whole)
        except LineError:
            continue
        path = _path(data)
        if path is not None:
            return _keys(data, parent_of(path)[0]) if is_key else _values(data, path)
    return []


def _length(pattern: str, text: str) -> int:
    """Return the length of what matches at the start of a text."""
    found = re.match(pattern, text)
    return found.end() if found else 0


def _keys(data: Any, section: str) -> list[Completion]:
    return [
        Completion(f"{row.key}: ", row.about.unit, first_sentence(row.meaning))
        for row in rows(data, section)
        if not row.value
    ]


def _values(data: Any, path: str) -> list[Completion]:
    section, key = parent_of(path)
    if key == "kind" and (kinds := kinds_at(data, section)):
        return [Completion(name, "", first_sentence(purpose(model))) for name, model in kinds.items()]
    choices = [(row, name) for row in rows(data, section) if row.key == key for name in row.about.choices]
    return [Completion(name, row.about.unit, first_sentence(row.meaning)) for row, name in choices]


def _closing(before: str) -> str:
    """Return the brackets that are open at the end of a text, closed."""
    found: list[str] = []
    try:
        for token in yaml.scan(before, LOADER):
            if isinstance(token, yaml.FlowMappingStartToken):
                found.append("}")
            elif isinstance(token, yaml.FlowSequenceStartToken):
                found.append("]")
            elif isinstance(token, yaml.FlowMappingEndToken | yaml.FlowSequenceEndToken):
                found.pop()
    except (yaml.YAMLError, IndexError):
        pass
    return "".join(reversed(found))


def _path(data: Any, *above: str) -> str | None:
    """Return the path of the key or value `HERE`; None if the data lack it, as in a comment."""
    children = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in children:
        if HERE in (key, value):
            return path_of([*above, str(key)])
        found = _path(value, *above, str(key))
        if found is not None:
            return found
    return None
