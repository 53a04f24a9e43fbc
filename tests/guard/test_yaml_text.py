"""The YAML reader: the work is bounded by limits on what a text expands to, and every fault is one line."""

import random
from pathlib import Path

import pytest

from taichi_plume.guard import yaml_text
from taichi_plume.guard.yaml_text import LineError, parse

CONFIGS = sorted((Path(__file__).parents[2] / "configs").rglob("*.yaml"))


def bomb(first: str, level: str) -> str:
    """Nine levels, each with eight copies of the one above: 8^8 values."""
    copies = ["[{}]".format(", ".join([f"*a{n}"] * 8)) for n in range(8)]
    lines = [f"a{n}: &a{n} {level.replace('COPIES', above)}" for n, above in enumerate(copies, 1)]
    return "\n".join([f"a0: &a0 {first}", *lines])


@pytest.mark.parametrize(
    "text",
    [
        bomb("[1, 2]", "COPIES"),
        bomb("{x: 1}", "{<<: COPIES}"),
        bomb("{x: 1}", "{y: {<<: COPIES}, <<: COPIES}"),
        bomb("{x: 1}", "{!!merge m: COPIES}"),
    ],
    ids=["aliases", "merges", "both", "tagged"],
)
def test_aliases_and_merge_keys_are_counted_as_expanded(text):
    with pytest.raises(LineError, match=r"line \d+, column \d+: aliases expand to more than 100,000 values"):
        parse(text)


def test_merge_keys_are_merged():
    assert parse("a: &a {x: 1, y: 2}\nb: {<<: [*a, {z: 4}], y: 3}")["b"] == {"x": 1, "y": 3, "z": 4}


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ("!!bool 3", "'3' is no bool"),
        ("!!int x", "'x' is no int"),
        ("!!int ''", "'' is no int"),
        ("!!float .", "'.' is no float"),
        ("!!float ''", "'' is no float"),
        ("!!int [1]", "expected a scalar node"),
        ("!!map [1]", "expected a mapping node"),
        ("!!seq {a: 1}", "expected a sequence node"),
        ("{<<: 3}", "expected a mapping or list of mappings"),
        (":".join(["1"] * 400) + ".5", "is no float"),
        ("9" * 9000, "a number of 9,000 characters; at most 1,000"),
        ("!!timestamp 7", "'7' is no timestamp"),
        ("!!timestamp [7]", "!!timestamp"),
        ("!!binary '%'", "!!binary"),
        ("!!set {a, b}", "!!set"),
        ("!!omap [a: 1]", "!!omap"),
        ("!!pairs [a: 1]", "!!pairs"),
        ("!!python/object/apply:os.system [ls]", "!!python/object/apply:os.system"),
        ('"\\UFFFFFFFF"', "not YAML"),
        ("0x_", "'0x_' is no int"),
    ],
)
@pytest.mark.parametrize("dates", [False, True])
def test_what_does_not_fit_is_one_line(value, shown, dates):
    if "timestamp 7" in value:
        shown = "is a date" if not dates else None
    if shown is None:
        assert parse(f"a: {value}", dates=dates) == {"a": "7"}
        return
    with pytest.raises(LineError) as caught:
        parse(f"a: {value}", dates=dates)
    assert shown in str(caught.value)
    assert len(str(caught.value)) < 400
    assert str(caught.value).isprintable()


def test_files_of_other_programs():
    assert parse("a: 2024-05-01", dates=True) == {"a": "2024-05-01"}


def test_a_text_is_the_same_without_libyaml(monkeypatch):
    """Damaged texts too: data and messages are those of PyYAML's own parser."""
    pytest.importorskip("yaml.cyaml", reason="PyYAML has been built without libyaml")
    rng = random.Random(5)

    def outcome(text):
        try:
            return repr(parse(text))
        except LineError as fault:
            return str(fault)

    texts, accepted = [file.read_text() for file in CONFIGS], 0
    for _ in range(400):
        lines = rng.choice(texts).split("\n")
        start = rng.randrange(len(lines))
        text = "\n".join(lines[start : start + rng.randrange(1, 14)])
        for _ in range(rng.randrange(3)):
            at = rng.randrange(len(text) + 1)
            text = text[:at] + rng.choice("[]{}:,-#&*!|>'\"%@` \n\t?0x_.~<=\u2028\x85\r\ufeff") + text[at:]
        found = outcome(text)
        accepted += not found.startswith(("line ", "not YAML"))
        with monkeypatch.context() as patch:
            patch.setattr(yaml_text, "_QUICK", None)
            assert outcome(text) == found
    assert 100 < accepted < 400
