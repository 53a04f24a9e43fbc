"""A scenario as YAML for people: numbers with units of a sensible scale, all keys or those that the user wrote."""

import io
from typing import Any

import yaml

from taichi_plume.scenario.facts import quantity_unit
from taichi_plume.scenario.quantities import with_unit
from taichi_plume.scenario.vocabulary import Model

LONGEST = 108  # characters of a line, unless a single value is longer
FOLDED = 200  # characters that an item of a list may take and still be written in flow style, in two lines


def readable(part: Model, own: bool = False) -> dict[str, Any]:
    """Keys and values of a section as YAML has them; own: only the keys that were set in the file or by an override.

    A null is written where it was set, or where the default is another value.
    """
    found = {}
    for key, field in sorted(type(part).model_fields.items(), key=lambda one: one[0] != "kind"):
        value = vars(part)[key]
        if key in part.model_fields_set if own else value is not None or field.default is not None:
            found[key] = _plain(value, quantity_unit(type(part), key), own)
    return found


def _plain(value: Any, unit: str, own: bool) -> Any:
    if isinstance(value, Model):
        return readable(value, own)
    if isinstance(value, tuple | list):
        return [_plain(one, unit, own) for one in value]
    if isinstance(value, dict):
        return {key: _plain(one, unit, own) for key, one in value.items()}
    if isinstance(value, float):
        return with_unit(value, unit) if unit else float(f"{value:.15g}")
    return value


def own_keys(scenario: Model) -> str:
    """The keys that the user wrote, as YAML in which a collection takes a line or two where it fits."""
    node = _Dumper(io.StringIO(), sort_keys=False).represent_data(readable(scenario, own=True))
    _fold(node, 0)
    node.flow_style = False
    return yaml.serialize(node, Dumper=_Dumper, allow_unicode=True, width=LONGEST)


def all_keys(scenario: Model) -> str:
    """All keys with their values, as YAML with a key in each line."""
    node = _Dumper(io.StringIO(), sort_keys=False).represent_data(readable(scenario))
    _unfold(node)
    return yaml.serialize(node, Dumper=_Dumper, allow_unicode=True, width=LONGEST)


def _unfold(node: yaml.Node) -> None:
    """Set lists of numbers and names to be written in one line, and all else in several."""
    if isinstance(node, yaml.CollectionNode):
        parts = (
            [one for pair in node.value for one in pair] if isinstance(node, yaml.MappingNode) else node.value
        )
        for one in parts:
            _unfold(one)
        node.flow_style = not any(isinstance(one, yaml.CollectionNode) for one in parts)
        node.flow_style &= isinstance(node, yaml.SequenceNode) or not parts


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        """Write a value that is there twice out twice."""
        return True

    def write_plain(self, text: str, split: bool = True) -> None:
        """Break no line within a number and its unit."""
        super().write_plain(text, False)


def _fold(node: yaml.Node, column: int, most: int = LONGEST) -> int:
    """Choose the collections that fit in one line from a column on. Return the width of the node in characters."""
    if isinstance(node, yaml.ScalarNode):
        return len(node.value) + 2
    assert isinstance(node, yaml.CollectionNode)
    if isinstance(node, yaml.MappingNode):
        widths = [len(key.value) + 2 + _fold(value, column + 2 + len(key.value)) for key, value in node.value]
    else:
        widths = [_fold(one, column + 2, FOLDED) for one in node.value]
    flat = all(isinstance(one, yaml.ScalarNode) for one in node.value)
    width = sum(widths) + 2
    node.flow_style = flat or column + width <= most
    return width
