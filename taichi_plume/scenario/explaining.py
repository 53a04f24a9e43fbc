"""Printed help about a vocabulary: its schema, for editors, and the meaning of a key or section."""

import json
import os
import shutil
import sys
import textwrap
from collections.abc import Iterator

from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import LONGEST_VALUE, say, visible
from taichi_plume.scenario.facts import purpose
from taichi_plume.scenario.keys import Key, Place, look_up, near
from taichi_plume.scenario.vocabulary import Model

WIDEST = 100  # columns of a text that is read


def print_schema(top: type[Model]) -> int:
    """Print the JSON schema of files with that section at their top; returns a command's exit code."""
    return _print(json.dumps(top.model_json_schema(), indent=2))


def print_key(text: str, top: type[Model]) -> int:
    """Print what keys or sections of that path, name or kind mean; returns a command's exit code.

    Raises InputError if there is no such key.
    """
    sections, keys = look_up(text, top)
    if not sections and not keys:
        close = near(text, top)
        meant = f"did you mean {' or '.join(close)}? " if close else ""
        raise InputError(f"no key '{visible(text, LONGEST_VALUE)}'; {meant}--schema prints all")
    wide = min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns)
    kind = text if all(text in one.kinds for one in sections) else ""
    blocks = [_of_section(one, kind, wide) for one in sections] + [_of_key(one, wide) for one in keys]
    return _print("\n\n".join("\n".join(block) for block in blocks))


def _print(text: str) -> int:
    try:
        say(*text.splitlines(), longest=None, flush=True)
    except BrokenPipeError:  # a reader such as `head` may leave early; Python flushes again at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _of_key(key: Key, wide: int) -> Iterator[str]:
    """All that is told of a key."""
    yield key.path + (f"   (kind: {', '.join(key.kinds)})" if key.kinds else "")
    yield from _filled(key.facts.meaning, wide, 2)
    yield from _filled(key.facts.figures, wide, 2)
    if "quantit" in key.facts.type:
        yield f"  (a quantity is a number in {key.facts.unit or 'SI units'}, or a text with another unit)"


def _of_section(place: Place, kind: str, wide: int) -> Iterator[str]:
    """Lines about a section: its purpose, and of each key the meaning, unit and default; kind: of this one only."""
    yield place.path + (f"   (in a section of kind {', '.join(place.within)})" if place.within else "")
    models = [model for name, model in place.kinds.items() if kind in ("", name)]
    for model in models or list(place.models):
        its = next((name for name, one in place.kinds.items() if one is model), "")
        yield from _filled((f"kind: {its} - " if its else "") + purpose(model), wide, 2)
    for key in place.keys:
        if not kind or not key.kinds or kind in key.kinds:
            of = f" ({', '.join(key.kinds)})" if key.kinds and not kind else ""
            default = f"default: {key.facts.default}" if key.facts.default else "has to be given"
            yield from _filled(f"{key.name}{of}: {key.facts.brief}; {default}", wide, 4)


def _filled(text: str, wide: int, indent: int) -> list[str]:
    return textwrap.wrap(text, wide, initial_indent=" " * indent, subsequent_indent=" " * (indent + 2))
