"""Readable YAML of a scenario: numbers with handy units; all keys, or only those that the user set."""

import io
from typing import Any, TypeVar

import yaml

from taichi_plume.quantities import parse, with_unit
from taichi_plume.scenario.key_facts import quantity_unit
from taichi_plume.scenario.vocabulary import Model

ModelT = TypeVar("ModelT", bound=Model)
LONGEST = 108  # characters of a line, unless a single value is longer
FOLDED = 200  # characters that an item of a list may take and still be written in flow style, in two lines


def readable(part: Model, own: bool = False, exact: bool = False) -> dict[str, object]:
    """Return keys and values of a section as YAML types; own: only the keys set in the file or by an override.

    exact: write all digits of numbers, so that they read back as equal; otherwise numbers have at most 15 digits.
    An explicit null is written if the user set the key to null, or the default is another value.
    """
    data: dict[str, object] = {}
    for key, field in sorted(type(part).model_fields.items(), key=lambda item: item[0] != "kind"):
        value = vars(part)[key]
        if key in part.model_fields_set if own else value is not None or field.default is not None:
            data[key] = _plain(value, quantity_unit(type(part), key), own, exact)
    return data


def _plain(value: object, unit: str, own: bool, exact: bool) -> object:
    """Return a value in the types of YAML; numbers become texts with a handy unit if `unit` is not empty."""
    if isinstance(value, Model):
        return readable(value, own, exact)
    if isinstance(value, tuple | list):
        return [_plain(item, unit, own, exact) for item in value]
    if isinstance(value, dict):
        return {key: _plain(item, unit, own, exact) for key, item in value.items()}
    if not isinstance(value, float) or (exact and not unit):
        return value
    if not unit:
        return float(f"{value:.15g}")
    text = with_unit(value, unit)
    return value if exact and parse(text, unit) != value else text


def own_keys(scenario: Model, exact: bool = False) -> str:
    """Return YAML of the keys that the user set; lists and mappings that fit take one line. exact: see `readable`."""
    node = _Dumper(io.StringIO(), sort_keys=False).represent_data(readable(scenario, True, exact))
    _fold(node, 0)
    node.flow_style = False
    return yaml.serialize(node, Dumper=_Dumper, allow_unicode=True, width=LONGEST)


def all_keys(scenario: Model, exact: bool = False) -> str:
    """Return YAML of all keys of a scenario with their values, defaults included, one key per line.

    exact: see `readable`.
    """
    return yaml.dump(
        readable(scenario, exact=exact),
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=None,
        allow_unicode=True,
        width=LONGEST,
    )


def without_defaults(scenario: ModelT) -> ModelT:
    """Return a copy of a scenario in which those keys count as set by the user whose values are not the default."""

    def visit(part: object) -> None:
        for item in part if isinstance(part, tuple | list) else ():
            visit(item)
        for key, field in type(part).model_fields.items() if isinstance(part, Model) else ():
            value = vars(part)[key]
            visit(value)
            if (
                key != "kind"
                and not field.is_required()
                and value == field.get_default(call_default_factory=True, validated_data={})
            ):
                part.model_fields_set.discard(key)  # type: ignore[union-attr]

    copy = scenario.model_copy(deep=True)
    visit(copy)
    return copy


class _Dumper(yaml.SafeDumper):
    def represent_mapping(self, tag: str, mapping: Any, flow_style: bool | None = None) -> yaml.MappingNode:
        """Write each key of a mapping on a line of its own; only lists of numbers and names go on one line."""
        return super().represent_mapping(tag, mapping, flow_style=not mapping)

    def ignore_aliases(self, data: object) -> bool:
        """Write repeated values in full, without YAML anchors and aliases."""
        return True

    def write_plain(self, text: str, split: bool = True) -> None:
        """Write a text without breaking it, so that a number and its unit stay on one line."""
        super().write_plain(text, False)


def _fold(node: yaml.Node, column: int, most: int = LONGEST) -> int:
    """Set YAML collections that fit into one line from a column on to flow style. Return their width in characters."""
    if isinstance(node, yaml.ScalarNode):
        return len(node.value) + 2
    assert isinstance(node, yaml.CollectionNode)
    if isinstance(node, yaml.MappingNode):
        widths = [len(key.value) + 2 + _fold(value, column + 2 + len(key.value)) for key, value in node.value]
    else:
        widths = [_fold(part, column + 2, FOLDED) for part in node.value]
    flat = all(isinstance(part, yaml.ScalarNode) for part in node.value)
    width = sum(widths) + 2
    node.flow_style = flat or column + width <= most
    return width
