"""Edits of a text: they change one value, and no other character."""

import difflib
from pathlib import Path

import pytest

from taichi_plume.draw.document import EditError, add, data_of, delete, duplicate, set_value, value_at
from taichi_plume.draw.history import History

ROOT = Path(__file__).parents[2]
CONFIGS = sorted(
    [*(ROOT / "configs").rglob("*.yaml"), *(ROOT / "taichi_plume/contests/scenarios").glob("*.yaml")]
)
TEXT = """\
# a room
domain: {size: [4 m, 3 m], spacing: 5 cm}  # coarse
wind:
  kind: cfd
  openings:   # two
    - {kind: inlet, face: x-, speed: 0.5}  # the door
    - {kind: outlet,
       face: x+}
obstacles:
- kind: box      # a table
  # its middle
  center: [1, 2]
  size: [0.5, 0.5]
- {kind: sphere, center: [3, 1], radius: 20 cm}
heat:
robots: []
"""


DOMAIN, DOOR = TEXT.splitlines()[1], TEXT.splitlines()[5]


def changed_lines(old: str, new: str) -> list[str]:
    lines = difflib.unified_diff(old.splitlines(), new.splitlines(), n=0, lineterm="")
    return [line for line in lines if not line.startswith(("---", "+++", "@@"))]


@pytest.mark.parametrize(
    ("edit", "lines"),
    [
        (
            lambda: set_value(TEXT, "domain.size[0]", "4.5 m"),
            [f"-{DOMAIN}", f"+{DOMAIN.replace('4 m', '4.5 m')}"],
        ),
        (lambda: set_value(TEXT, "obstacles[0].center[1]", 2.5), ["-  center: [1, 2]", "+  center: [1, 2.5]"]),
        (lambda: set_value(TEXT, "obstacles[0].yaw_deg", 30), ["+  yaw_deg: 30"]),
        (lambda: set_value(TEXT, "heat.kind", "warm"), ["-heat:", "+heat: {kind: warm}"]),
        (
            lambda: set_value(TEXT, "wind.openings[0].size", [1]),
            [f"-{DOOR}", f"+{DOOR.replace('0.5', '0.5, size: [1]')}"],
        ),
        (lambda: set_value(TEXT, "seed", 3), ["+seed: 3"]),
        (lambda: set_value(TEXT, "gas.species", "a, b: c"), ["+gas: {species: 'a, b: c'}"]),
        (lambda: add(TEXT, "robots", {"count": 1}), ["-robots: []", "+robots:", "+  - {count: 1}"]),
        (lambda: add(TEXT, "wind.openings", {"kind": "fan"}), ["+    - {kind: fan}"]),
        (lambda: add(TEXT, "wind.screens", {"kind": "honeycomb"}), ["+  screens:", "+    - {kind: honeycomb}"]),
        (lambda: add(TEXT, "obstacles", {"kind": "box"}), ["+- {kind: box}"]),
        (lambda: delete(TEXT, "obstacles[1]"), ["-- {kind: sphere, center: [3, 1], radius: 20 cm}"]),
        (lambda: delete(TEXT, "wind.openings[1]"), ["-    - {kind: outlet,", "-       face: x+}"]),
        (lambda: delete(TEXT, "domain.spacing"), [f"-{DOMAIN}", f"+{DOMAIN.replace(', spacing: 5 cm', '')}"]),
        (lambda: delete(TEXT, "heat"), ["-heat:"]),
        (lambda: duplicate(TEXT, "obstacles[1]"), ["+- {kind: sphere, center: [3, 1], radius: 20 cm}"]),
        (
            lambda: duplicate(TEXT, "obstacles[0]"),
            ["+- kind: box      # a table", "+  # its middle", "+  center: [1, 2]", "+  size: [0.5, 0.5]"],
        ),
    ],
)  # fmt: skip
def test_only_lines_of_the_value_change(edit, lines):
    assert sorted(changed_lines(TEXT, edit())) == sorted(lines)


def test_the_first_key_of_an_item_can_go():
    assert data_of(delete(TEXT, "obstacles[0].kind"))["obstacles"][0] == {
        "center": [1, 2],
        "size": [0.5, 0.5],
    }


def test_the_last_item_leaves_an_empty_list():
    text = "a:\n  - {b: 1}  # why\nc: 2\n"
    assert data_of(delete(text, "a[0]")) == {"a": [], "c": 2}


@pytest.mark.parametrize("path", ["domain.size[7]", "obstacles.first", "domain.spacing.x"])
def test_a_path_that_does_not_fit_is_refused(path):
    with pytest.raises(EditError):
        set_value(TEXT, path, 1)


def test_values_that_an_alias_shares_are_not_edited():
    text = "a: &room [1, 2]\nb: *room\n"
    with pytest.raises(EditError, match="text itself"):
        set_value(text, "b[0]", 3)


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_value_of_the_shipped_files_can_be_set_and_deleted(path):
    """Each edit changes the data as expected (`document` verifies it) and leaves all comments."""
    text = path.read_text()
    comments = text.count("#")
    for where in leaves(data_of(text)):
        for edited in (set_value(text, where, 7), delete(text, where)):
            assert edited.count("#") == comments
        assert value_at(data_of(set_value(text, where, 7)), where) == 7


def leaves(value, path=""):
    """Yield paths of scalars: of every section the first two keys, which stand at all kinds of positions."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else []
    for key, part in list(parts)[:2]:
        inner = f"{path}[{key}]" if isinstance(key, int) else f"{path}.{key}".lstrip(".")
        yield from leaves(part, inner)
        if not isinstance(part, dict | list):
            yield inner


def test_history_returns_to_each_text():
    history = History("a")
    for text in "bcd":
        history.put(text)
    assert [history.undo() for _ in range(4)] == ["c", "b", "a", "a"]
    assert [history.redo() for _ in range(2)] == ["b", "c"]
    history.put("e")
    assert not history.can_redo
    assert [history.undo() for _ in range(2)] == ["c", "b"]
