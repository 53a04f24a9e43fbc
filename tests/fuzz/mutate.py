"""Mutants of scenarios: changes of the YAML tree, of raw values in it, and of its text."""

import copy
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import yaml

from taichi_plume.scenario.scenario import Scenario
from tests.fuzz.values import NUMBERS, RAW, TEXTS, UNITS

_TOKEN = "raw7value"  # stands for a raw value until the tree has been written


def _known() -> tuple[list[dict[str, Any]], list[str], dict[str, list[str]]]:
    """The sections of the vocabulary, all of its keys, and its named choices by key, from its JSON schema."""
    schema = Scenario.model_json_schema()
    sections = [one for one in [schema, *schema["$defs"].values()] if "properties" in one]
    choices: dict[str, list[str]] = {}
    for one in sections:
        for key, value in one["properties"].items():
            for part in [value, *value.get("anyOf", [])]:
                names = [*part.get("enum", []), *([part["const"]] if "const" in part else [])]
                choices.setdefault(key, []).extend(name for name in names if isinstance(name, str))
    choices = {key: sorted(set(names)) for key, names in choices.items() if names}
    return sections, sorted({key for one in sections for key in one["properties"]}), choices


SECTIONS, KEYS, CHOICES = _known()


class Mutator:
    """Makes mutants of scenarios, {name: text}. Mutant n of a seed is always the same.

    whole: the same scenarios with every default written out, so that each number has its turn.
    """

    def __init__(self, texts: dict[str, str], whole: dict[str, dict[str, Any]], seed: int):
        self.texts, self.whole, self.seed = texts, whole, seed
        self.trees = {name: yaml.safe_load(text) for name, text in texts.items()}
        self.names = sorted(texts)

    def base(self, n: int) -> str:
        """The name of what mutant n comes from."""
        self.rng = np.random.default_rng([self.seed, n])
        return self._one(self.names)

    def mutant(self, n: int) -> tuple[str, str]:
        """The name of what mutant n comes from, and its text."""
        name = self.base(n)
        if self.rng.random() < 0.15:
            text = self.texts[name]
            for _ in range(1 + self.rng.geometric(0.6)):
                text = self._text(text)
            return name, text
        tree: Any = copy.deepcopy((self.trees if self.rng.random() < 0.6 else self.whole)[name])
        self.raw: list[str] = []
        mild = self.rng.random() < 0.4  # numbers alone, close to what they were: many are accepted
        for _ in range(self.rng.geometric(0.45)):
            change = Mutator._mild if mild else self._one(CHANGES)
            change(self, tree)
        return name, self._written(tree)

    def _written(self, tree: Any) -> str:
        text = yaml.safe_dump(tree, sort_keys=False, allow_unicode=bool(self.rng.random() < 0.5), width=200)
        for n, raw in enumerate(self.raw):
            text = text.replace(f"{_TOKEN}{n}q", raw)
        return text

    # ------------------------------------------------------------ choices

    def _one(self, items: Any) -> Any:
        return items[int(self.rng.integers(len(items)))]

    def _places(self, tree: Any, wanted: Callable[[Any], bool] = lambda _: True) -> list[tuple[Any, Any]]:
        """Containers and keys of all values of the tree that are wanted."""
        found, rest, seen = [], [tree], set()
        while rest:
            node = rest.pop()
            if id(node) in seen or len(found) > 5000:
                continue
            seen.add(id(node))
            pairs = (
                node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
            )
            for key, value in pairs:
                if wanted(value):
                    found.append((node, key))
                rest.append(value)
        return found

    def _place(self, tree: Any, wanted: Callable[[Any], bool] = lambda _: True) -> tuple[Any, Any] | None:
        places = self._places(tree, wanted)
        return self._one(places) if places else None

    def _number(self) -> Any:
        if self.rng.random() < 0.4:
            return self._one(NUMBERS)
        number = float(f"{10 ** self.rng.uniform(-6, 6) * self._one([1, 1, 1, -1]):.3g}")
        return int(number) if self.rng.random() < 0.3 else number

    def _value(self) -> Any:
        kind = self.rng.integers(9)
        if kind == 0:
            return self._one([None, True, False, [], {}, [[]], {"a": 1}, [1, 2, 3], [None], {"kind": "none"}])
        if kind == 1:
            return self._one(TEXTS)
        if kind == 2:
            self.raw.append(self._one(RAW))
            return f"{_TOKEN}{len(self.raw) - 1}q"
        if kind == 3:
            return f"{self._number()} {self._one(UNITS)}"
        if kind == 4:
            return [self._number() for _ in range(self.rng.integers(1, 5))]
        if kind == 5:
            return self._one(self._one(list(CHOICES.values())))
        return self._number()

    # ------------------------------------------------------------ changes of the tree

    def _mild(self, tree: Any) -> None:
        """Another number, or another choice, where there is one."""
        place = self._place(tree, lambda value: isinstance(value, (int, float, str)) and value is not True)
        if place is None:
            return
        node, key = place
        old = node[key]
        if isinstance(old, str):
            number = re.fullmatch(r"([-+.\de]+)( .*)", old)
            if number:
                node[key] = f"{float(number[1]) * self._factor():.4g}{number[2]}"
            elif key in CHOICES:
                node[key] = self._one(CHOICES[key])
        elif isinstance(old, int) and not isinstance(old, bool):
            node[key] = (
                max(0, old + int(self.rng.integers(-1, 3))) if self.rng.random() < 0.8 else self._number()
            )
        elif isinstance(old, float):
            node[key] = float(f"{old * self._factor():.5g}")

    def _factor(self) -> float:
        return float(self.rng.uniform(0.7, 1.4) if self.rng.random() < 0.6 else 10 ** self.rng.uniform(-4, 4))

    def _delete(self, tree: Any) -> None:
        if place := self._place(tree):
            del place[0][place[1]]

    def _rename(self, tree: Any) -> None:
        if place := self._place(tree):
            node, key = place
            if isinstance(node, dict) and isinstance(key, str):
                name = self._one(
                    [key[:-1], key + "s", key.upper(), self._one(KEYS), self._one(TEXTS), f"{key} "]
                )
                node[name] = node.pop(key)

    def _replace(self, tree: Any) -> None:
        if place := self._place(tree):
            place[0][place[1]] = self._value()

    def _renumber(self, tree: Any) -> None:
        if place := self._place(tree, lambda value: isinstance(value, (int, float))):
            place[0][place[1]] = self._number()

    def _reunit(self, tree: Any) -> None:
        if place := self._place(tree, lambda value: isinstance(value, (int, float, str))):
            place[0][place[1]] = f"{self._number()} {self._one(UNITS)}"

    def _resize(self, tree: Any) -> None:
        if place := self._place(tree, lambda value: isinstance(value, list) and bool(value)):
            items = place[0][place[1]]
            what = self.rng.integers(4)
            if what == 0:
                items.pop(int(self.rng.integers(len(items))))
            elif what == 1:
                items.extend(copy.deepcopy(items) * self._one([1, 1, 1, 2, 30]))
            elif what == 2:
                items.append(self._value())
            else:
                self.rng.shuffle(items)

    def _rekind(self, tree: Any) -> None:
        place = self._place(tree, lambda value: isinstance(value, str))
        places = [(node, key) for node, key in self._places(tree) if key in CHOICES]
        if places and (place := self._one(places)):
            node, key = place
            node[key] = self._one(CHOICES[key])

    def _splice(self, tree: Any) -> None:
        """A part of another scenario, at the same key or anywhere."""
        other = self.trees[self._one(self.names)]
        source = self._place(other, lambda value: isinstance(value, (dict, list)))
        same = [place for place in self._places(tree) if source and place[1] == source[1]]
        target = self._one(same) if same and self.rng.random() < 0.8 else self._place(tree)
        if source and target:
            target[0][target[1]] = copy.deepcopy(source[0][source[1]])

    def _section(self, tree: Any) -> None:
        """A whole section of another scenario."""
        other = self.trees[self._one(self.names)]
        key = self._one(sorted(other))
        tree[key] = copy.deepcopy(other[key])

    def _move(self, tree: Any) -> None:
        one, other = self._place(tree), self._place(tree)
        if one and other:
            value = copy.deepcopy(one[0][one[1]])
            if self.rng.random() < 0.5:
                one[0][one[1]] = copy.deepcopy(other[0][other[1]])
            other[0][other[1]] = value

    def _add(self, tree: Any) -> None:
        """A key that the section knows, or any, with a number or another value."""
        place = self._place(tree, lambda value: isinstance(value, dict))
        node = place[0][place[1]] if place and self.rng.random() < 0.85 else tree
        fitting = [one["properties"] for one in SECTIONS if self._fits(one, node)]
        key = self._one(sorted(self._one(fitting))) if fitting else self._one(KEYS)
        node[key] = self._one(CHOICES[key]) if key in CHOICES and self.rng.random() < 0.7 else self._value()

    @staticmethod
    def _fits(section: dict[str, Any], node: dict) -> bool:
        known = section["properties"]
        kind = known.get("kind", {}).get("const")
        return node.get("kind") == kind and all(key in known for key in node)

    # ------------------------------------------------------------ changes of the text

    def _text(self, text: str) -> str:
        lines = text.splitlines(keepends=True) or [""]
        at, to = (int(self.rng.integers(len(lines))) for _ in range(2))
        place = int(self.rng.integers(len(text) + 1))
        what = self.rng.integers(9)
        if what == 0:
            del lines[at]
        elif what == 1:
            lines.insert(to, lines[at])
        elif what == 2:
            lines[at], lines[to] = lines[to], lines[at]
        elif what == 3:
            lines[at] = " " * int(self.rng.integers(4)) + lines[at].lstrip(" ")
        elif what == 4:
            return text[:place]
        elif what == 5:
            return text[:place] + self._one([*RAW, *TEXTS]) + text[place:]
        elif what == 6:
            return text[:place] + chr(int(self.rng.integers(1, 256))) + text[place + 1 :]
        elif what == 7:
            values = list(re.finditer(r": ([^\n,}\]]+)", text))
            if values:
                value = self._one(values)
                return f"{text[: value.start(1)]}{self._one(RAW)}{text[value.end(1) :]}"
        else:
            numbers = list(re.finditer(r"[-\d.]+", text))
            if numbers:
                number = self._one(numbers)
                return f"{text[: number.start()]}{self._number()}{text[number.end() :]}"
        return "".join(lines)


CHANGES = [
    *(
        Mutator._delete,
        Mutator._rename,
        Mutator._replace,
        Mutator._renumber,
        Mutator._reunit,
        Mutator._resize,
    ),
    *(Mutator._rekind, Mutator._splice, Mutator._section, Mutator._move, Mutator._add, Mutator._mild),
    *(Mutator._add, Mutator._renumber),  # twice: they reach most
]
