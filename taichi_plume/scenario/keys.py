"""All keys of a scenario by path, such as ``wind.openings[].speed``: for reference pages, hints and printed help.

In all functions `top` is the section at the root of the paths: a scenario, or a study.
"""

import difflib
import json
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import takewhile

from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import LONGEST_VALUE, say, visible
from taichi_plume.scenario.key_facts import Facts, facts, models_in, own_kind, purpose
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.suggestions import nearest
from taichi_plume.scenario.vocabulary import Model


@dataclass(frozen=True)
class Key:
    """A key at one path of a scenario. kinds: kinds of the section that have this key; empty if all have it."""

    path: str
    name: str
    kinds: tuple[str, ...]
    facts: Facts


@dataclass
class Place:
    """Path at which a scenario has a section, perhaps of several kinds; empty for the scenario itself.

    models: possible section classes, each with its kinds or, without any, those of the enclosing section. within: kinds
    of the enclosing section that have this path; empty if all have it. same_as: path that documents the same sections.
    """

    path: str
    models: dict[type[Model], list[str]] = field(default_factory=dict)
    within: list[str] = field(default_factory=list)
    same_as: str = ""

    @property
    def kinds(self) -> dict[str, type[Model]]:
        """Possible section classes at this path, by the name of their kind."""
        return {own_kind(model): model for model in self.models if own_kind(model)}

    @property
    def keys(self) -> list[Key]:
        """Keys of all kinds of section at this path, without `kind`; a key that differs between kinds is repeated."""
        kinds_of: dict[tuple[str, Facts], list[str]] = {}
        for model, kinds in self.models.items():
            for name in model.model_fields:
                if name != "kind" or not own_kind(model):
                    kinds_of.setdefault((name, facts(model, name)), []).extend(kinds)
        every = [kind for kinds in self.models.values() for kind in kinds]
        many = len(self.models) > 1
        return [
            Key(
                f"{self.path}.{name}".lstrip("."),
                name,
                tuple(dict.fromkeys(kinds)) if many and set(kinds) != set(every) else (),
                described,
            )
            for (name, described), kinds in kinds_of.items()
        ]


@cache
def places(top: type[Model] = Scenario) -> Mapping[str, Place]:
    """Return all sections by path, from the top inward. Of equal sections only the outermost is documented."""
    whole = Place("", {top: []})
    found, seen, level = {"": whole}, {top}, [whole]
    while level:
        below: dict[str, Place] = {}
        for place in level:
            _add_below(place, below)
        for place in below.values():
            if place.models.keys() <= seen:
                place.same_as = next(
                    other.path for other in found.values() if place.models.keys() <= other.models.keys()
                )
            elif (item := below.get(place.path.removesuffix("[]"), place)) is not place:
                if place.models.keys() <= item.models.keys():  # one section, or a list of such
                    place.same_as = item.path
        found |= below
        level = [place for place in below.values() if not place.same_as]
        seen |= {model for place in level for model in place.models}
    return found


def _add_below(place: Place, below: dict[str, Place]) -> None:
    """Add to `below`, by path, the sections that lie directly inside the section `place`."""
    for model, kinds in place.models.items():
        for name, key in model.model_fields.items():
            for part, depth in models_in(key):
                path = f"{place.path}.{name}".lstrip(".") + "[]" * depth
                inner = below.setdefault(path, Place(path))
                labels = [own_kind(part)] if own_kind(part) else kinds
                inner.models.setdefault(part, []).extend(x for x in labels if x not in inner.models[part])
                if len(place.models) > 1:
                    inner.within.extend(kind for kind in kinds if kind not in inner.within)


def flat(path: str) -> str:
    """Return a path without list indices: both ``a.0.b`` and ``a[].b`` give ``a.b``."""
    return re.sub(r"\[\d*\]|\.\d+(?=\.|$)", "", path.strip())


def all_keys(top: type[Model] = Scenario) -> Iterator[Key]:
    """Yield every key of every section once; repeated sections are left out."""
    for place in places(top).values():
        if not place.same_as:
            yield from place.keys


def look_up(text: str, top: type[Model] = Scenario) -> tuple[list[Place], list[Key]]:
    """Return the sections and keys whose path equals or ends with a text; failing that, sections of such a kind."""
    path = flat(text)
    for place in places(top).values():
        if place.same_as and f"{path}.".startswith(f"{flat(place.path)}."):
            path = flat(place.same_as) + path[len(flat(place.path)) :]
    sections = [place for place in places(top).values() if place.path and not place.same_as]
    for fits in (lambda key: key == path, lambda key: key.endswith(f".{path}")):
        matches = {flat(place.path): place for place in sections if fits(flat(place.path))}
        keys = [key for key in all_keys(top) if fits(flat(key.path)) and flat(key.path) not in matches]
        if matches or keys:
            return list(matches.values()), keys
    return [place for place in sections if path in place.kinds], []


def sections_at(steps: Sequence[int | str], top: type[Model] = Scenario) -> list[type[Model]]:
    """Return the classes of the sections that may stand at a path of keys, also as items of a list there."""
    models = [top]
    for step in steps:
        if isinstance(step, str) and not step.isdecimal():
            fields = [model.model_fields[step] for model in models if step in model.model_fields]
            models = list(dict.fromkeys(part for field in fields for part, _ in models_in(field)))
    return models


def misspelt(steps: Sequence[str], top: type[Model] = Scenario) -> str | None:
    """Return an error message about the first unknown key along a path; None if all keys are known."""
    for n, step in enumerate(steps):
        models = sections_at(steps[:n], top)
        known = dict.fromkeys(key for model in models for key in model.model_fields)
        if known and not step.isdecimal() and step not in known:
            close = nearest(step, known)
            meant = f"did you mean '{'.'.join([*steps[:n], close])}'?" if close else f"use {', '.join(known)}"
            above = ".".join(steps[:n])
            return f"unknown key '{visible(step, LONGEST_VALUE)}'{f' in {above}' if above else ''}; {meant}"
    return None


def homes(name: str, of: Sequence[int | str] = (), top: type[Model] = Scenario) -> list[str]:
    """Return the paths and kinds of sections that have a key of this name, those nearest to the path `of` first."""
    paths = []
    for place in places(top).values():
        models = [model for model in place.models if name in model.model_fields]
        if models and not place.same_as:
            kinds = [own_kind(model) for model in models if own_kind(model)]
            names = ", ".join([*kinds[:4], *["..."][: len(kinds) > 4]])
            suffix = f" (kind: {names})" if kinds and len(models) < len(place.models) else ""
            paths.append(((place.path or "the top of the file") + suffix, _shared(place.path, of)))
    return [path for path, _ in sorted(paths, key=lambda item: -item[1])]


def kinds_at(name: str, top: type[Model] = Scenario) -> list[str]:
    """Return the paths of the sections of which a kind has this name."""
    return [place.path for place in places(top).values() if name in place.kinds and not place.same_as]


def _shared(path: str, steps: Sequence[int | str]) -> int:
    """Return how many keys two paths have in common at their start; list indices do not count."""
    pairs = zip(flat(path).split("."), [step for step in steps if isinstance(step, str)], strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def near(text: str, top: type[Model] = Scenario) -> list[str]:
    """Return known key paths, or else key names and kinds, spelled like a text; at most three."""
    known = [flat(key.path) for key in all_keys(top)]
    kinds = [kind for place in places(top).values() for kind in place.kinds]
    path = flat(text)
    names = dict.fromkeys([*(key.rpartition(".")[2] for key in known), *kinds])
    close = difflib.get_close_matches(path, known, n=3, cutoff=0.75)
    last = path.rpartition(".")[2]
    return close or difflib.get_close_matches(last, names, n=3)


WIDEST = 100  # columns of a text that is read


def print_schema(top: type[Model]) -> int:
    """Print the JSON schema of files whose root is the section `top`. Return the exit code 0."""
    return _print(json.dumps(top.model_json_schema(), indent=2))


def print_key(text: str, top: type[Model]) -> int:
    """Print the meaning of the keys and sections with this path, name or kind. Return the exit code 0.

    Raises InputError if there is no such key.
    """
    sections, keys = look_up(text, top)
    if not sections and not keys:
        close = near(text, top)
        meant = f"did you mean {' or '.join(close)}? " if close else ""
        raise InputError(f"no key '{visible(text, LONGEST_VALUE)}'; {meant}--schema prints all")
    wide = min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns)
    kind = text if all(text in place.kinds for place in sections) else ""
    blocks = [_of_section(place, kind, wide) for place in sections] + [_of_key(key, wide) for key in keys]
    return _print("\n\n".join("\n".join(block) for block in blocks))


def _print(text: str) -> int:
    try:
        say(*text.splitlines(), longest=None, flush=True)
    except BrokenPipeError:  # a reader such as `head` may leave early; Python flushes again at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _of_key(key: Key, wide: int) -> Iterator[str]:
    """Yield lines of printed help about a key, at most `wide` characters long."""
    yield key.path + (f"   (kind: {', '.join(key.kinds)})" if key.kinds else "")
    yield from _filled(key.facts.meaning, wide, 2)
    yield from _filled(key.facts.figures, wide, 2)
    if "quantit" in key.facts.type:
        yield f"  (a quantity is a number in {key.facts.unit or 'SI units'}, or a text with another unit)"


def _of_section(place: Place, kind: str, wide: int) -> Iterator[str]:
    """Yield lines of help about a section, or its kind `kind` alone: purpose, then meaning and default of each key."""
    yield place.path + (f"   (in a section of kind {', '.join(place.within)})" if place.within else "")
    models = [model for name, model in place.kinds.items() if kind in ("", name)]
    for model in models or list(place.models):
        label = next((name for name, labelled in place.kinds.items() if labelled is model), "")
        yield from _filled((f"kind: {label} - " if label else "") + purpose(model), wide, 2)
    for key in place.keys:
        if not kind or not key.kinds or kind in key.kinds:
            of = f" ({', '.join(key.kinds)})" if key.kinds and not kind else ""
            default = f"default: {key.facts.default}" if key.facts.default else "has to be given"
            yield from _filled(f"{key.name}{of}: {key.facts.brief}; {default}", wide, 4)


def _filled(text: str, wide: int, indent: int) -> list[str]:
    return textwrap.wrap(text, wide, initial_indent=" " * indent, subsequent_indent=" " * (indent + 2))
