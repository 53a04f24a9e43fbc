"""Every key of the vocabulary by its path, such as ``wind.openings[].speed``, for the reference and `--explain`.

In all functions `top` is the section that the paths begin in: a scenario, unless it is of another kind of file.
"""

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import takewhile

from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.facts import Facts, facts, models_in, own_kind
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.suggestions import nearest
from taichi_plume.scenario.vocabulary import Model


@dataclass(frozen=True)
class Key:
    """A key at its place. kinds: of the sections there that have it so; empty where all have."""

    path: str
    name: str
    kinds: tuple[str, ...]
    facts: Facts


@dataclass
class Place:
    """Where a section, or one of several kinds of sections, may be; `path` is empty for the scenario itself.

    models: what may be there, each with its kinds or, where it is of none, those of the sections around it. within:
    the kinds of the section around it that have it; empty where all have. same_as: the path at which the same
    sections are told of already.
    """

    path: str
    models: dict[type[Model], list[str]] = field(default_factory=dict)
    within: list[str] = field(default_factory=list)
    same_as: str = ""

    @property
    def kinds(self) -> dict[str, type[Model]]:
        """The kinds that a section there may be of, by their names."""
        return {own_kind(model): model for model in self.models if own_kind(model)}

    @property
    def keys(self) -> list[Key]:
        """Those of all kinds; a key that differs between them is there more than once. Kinds themselves are none."""
        found: dict[tuple[str, Facts], list[str]] = {}
        for model, kinds in self.models.items():
            for name in model.model_fields:
                if name != "kind" or not own_kind(model):
                    found.setdefault((name, facts(model, name)), []).extend(kinds)
        every = [kind for kinds in self.models.values() for kind in kinds]
        many = len(self.models) > 1
        return [
            Key(
                f"{self.path}.{name}".lstrip("."),
                name,
                tuple(dict.fromkeys(kinds)) if many and set(kinds) != set(every) else (),
                its,
            )
            for (name, its), kinds in found.items()
        ]


@cache
def places(top: type[Model] = Scenario) -> Mapping[str, Place]:
    """All places by their paths, from the top inward; of the same sections only the outermost are gone into."""
    whole = Place("", {top: []})
    found, told, level = {"": whole}, {top}, [whole]
    while level:
        below: dict[str, Place] = {}
        for place in level:
            _add_below(place, below)
        for place in below.values():
            if place.models.keys() <= told:
                place.same_as = next(
                    other.path for other in found.values() if place.models.keys() <= other.models.keys()
                )
            elif (one := below.get(place.path.removesuffix("[]"), place)) is not place:
                if place.models.keys() <= one.models.keys():  # one section, or a list of such
                    place.same_as = one.path
        found |= below
        level = [place for place in below.values() if not place.same_as]
        told |= {model for place in level for model in place.models}
    return found


def _add_below(place: Place, below: dict[str, Place]) -> None:
    """Enter the places of the sections in those of `place`."""
    for model, kinds in place.models.items():
        for name, key in model.model_fields.items():
            for part, depth in models_in(key):
                path = f"{place.path}.{name}".lstrip(".") + "[]" * depth
                one = below.setdefault(path, Place(path))
                labels = [own_kind(part)] if own_kind(part) else kinds
                one.models.setdefault(part, []).extend(x for x in labels if x not in one.models[part])
                if len(place.models) > 1:
                    one.within.extend(kind for kind in kinds if kind not in one.within)


def flat(path: str) -> str:
    """A path without places in lists: ``wind.openings.0.speed`` and ``wind.openings[].speed`` are the same."""
    return re.sub(r"\[\d*\]|\.\d+(?=\.|$)", "", path.strip())


def all_keys(top: type[Model] = Scenario) -> Iterator[Key]:
    """Every key of every place, once."""
    for place in places(top).values():
        if not place.same_as:
            yield from place.keys


def look_up(text: str, top: type[Model] = Scenario) -> tuple[list[Place], list[Key]]:
    """The sections and keys of that path, or of those that end with it; a kind's name stands for the sections it is in.

    Where there are none both are empty.
    """
    path = flat(text)
    for place in places(top).values():
        if place.same_as and f"{path}.".startswith(f"{flat(place.path)}."):
            path = flat(place.same_as) + path[len(flat(place.path)) :]
    sections = [one for one in places(top).values() if one.path and not one.same_as]
    for fits in (lambda one: one == path, lambda one: one.endswith(f".{path}")):
        found = {flat(one.path): one for one in sections if fits(flat(one.path))}
        keys = [one for one in all_keys(top) if fits(flat(one.path)) and flat(one.path) not in found]
        if found or keys:
            return list(found.values()), keys
    return [one for one in sections if path in one.kinds], []


def sections_at(steps: Sequence[int | str], top: type[Model] = Scenario) -> list[type[Model]]:
    """Sections of all kinds that may be at a path, alone or in a list; empty if no section can be there."""
    found = [top]
    for step in steps:
        if isinstance(step, str) and not step.isdecimal():
            fields = [model.model_fields[step] for model in found if step in model.model_fields]
            found = list(dict.fromkeys(part for one in fields for part, _ in models_in(one)))
    return found


def misspelt(steps: Sequence[str], top: type[Model] = Scenario) -> str | None:
    """Message about the first step of a path that is a key of no section there; None if there is no such step."""
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
    """Sections that have a key of that name, by their paths and kinds: those nearest to the path `of` first."""
    found = []
    for place in places(top).values():
        models = [model for model in place.models if name in model.model_fields]
        if models and not place.same_as:
            kinds = [own_kind(model) for model in models if own_kind(model)]
            few = ", ".join([*kinds[:4], *["..."][: len(kinds) > 4]])
            some = f" (kind: {few})" if kinds and len(models) < len(place.models) else ""
            found.append(((place.path or "the top of the file") + some, _shared(place.path, of)))
    return [path for path, _ in sorted(found, key=lambda one: -one[1])]


def kinds_at(name: str, top: type[Model] = Scenario) -> list[str]:
    """Paths of the sections that may be of the kind of that name."""
    return [place.path for place in places(top).values() if name in place.kinds and not place.same_as]


def _shared(path: str, steps: Sequence[int | str]) -> int:
    """Number of steps that two paths share from the start."""
    pairs = zip(flat(path).split("."), [step for step in steps if isinstance(step, str)], strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def near(text: str, top: type[Model] = Scenario) -> list[str]:
    """Paths, names and kinds that are written much like it."""
    known = [flat(key.path) for key in all_keys(top)]
    kinds = [kind for place in places(top).values() for kind in place.kinds]
    path = flat(text)
    names = dict.fromkeys([*(one.rpartition(".")[2] for one in known), *kinds])
    close = difflib.get_close_matches(path, known, n=3, cutoff=0.75)
    last = path.rpartition(".")[2]
    return close or difflib.get_close_matches(last, names, n=3)
