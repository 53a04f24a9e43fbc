"""The reference of the documentation tells of every key, and what its examples say can be run."""

import re
import sys
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from test_descriptions import PATHS

from taichi_plume.assembly.preparation import load
from taichi_plume.scenario.keys import all_keys, flat, places
from taichi_plume.studies.study_keys import Study
from tests.fuzz import formats

ROOT = Path(__file__).parent.parent
sys.path.append(str(ROOT / "docs" / "_ext"))
pytest.importorskip("docutils", reason="pip install -e .[docs]")
reference = import_module("scenario_reference")

EXAMPLES = yaml.safe_load(reference.EXAMPLES.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def text() -> dict[str, str]:
    """The pages by name."""
    return reference.pages()


@pytest.fixture(scope="module")
def whole(text) -> str:
    """All pages."""
    return "\n".join(text.values())


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """A folder with a file of each format that examples name."""
    folder = tmp_path_factory.mktemp("files")
    formats.make(folder)
    return folder


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name != "base"])
def test_an_example_is_valid_and_of_its_kind(name, files):
    path, kind = name.split(" ")
    data = yaml.safe_load(EXAMPLES["base"]) | yaml.safe_load(EXAMPLES[name])
    (files / "example.yaml").write_text(yaml.safe_dump(data))
    scenario = load(files / "example.yaml").scenario
    found = [scenario]
    for step in path.split("."):
        parts = [getattr(section, step.removesuffix("[]"), None) for section in found]
        found = [part for part in parts if part is not None]
        found = [item for part in found for item in part] if step.endswith("[]") else found
    assert kind in {one.kind for one in found}  # type: ignore[attr-defined]


def test_the_scenario_that_examples_begin_from(files):
    (files / "example.yaml").write_text(EXAMPLES["base"])
    assert load(files / "example.yaml").resources.warnings == []


def test_every_kind_has_an_example():
    kinds = set(reference.kinds())
    assert len(kinds) > 60
    assert kinds - EXAMPLES.keys() == set(), "docs/_ext/scenario_examples.yaml: add an example of each"
    assert EXAMPLES.keys() - kinds == {"base"}, "docs/_ext/scenario_examples.yaml: no such kinds"


def test_a_missing_example_is_named_with_its_file(tmp_path, monkeypatch):
    name = "robots[].algorithm casting"
    fewer = {key: value for key, value in EXAMPLES.items() if key != name}
    (tmp_path / reference.EXAMPLES.name).write_text(yaml.safe_dump(fewer), encoding="utf-8")
    monkeypatch.setattr(reference, "EXAMPLES", tmp_path / reference.EXAMPLES.name)
    with pytest.raises(reference.MissingExampleError) as error:
        reference.pages()
    assert "scenario_examples.yaml" in str(error.value)
    assert name in str(error.value)


def test_every_key_of_the_vocabulary_is_on_a_page(whole):
    reported = {flat(re.sub(r" \(.*", "", one)) for one in re.findall(r"^\.\. key:: (.*)$", whole, re.M)}
    alike = {flat(path): flat(one.same_as) for path, one in places().items() if one.same_as}
    for path in PATHS:
        path = flat(path)
        for there, here in alike.items():
            if path.startswith(f"{there}."):
                path = here + path.removeprefix(there)
        section, _, name = path.rpartition(".")
        kinds = name == "kind" and any(flat(one.path) == section and one.kinds for one in places().values())
        assert path in reported or kinds, path


def test_every_key_of_a_study_is_on_its_page(text):
    for key in all_keys(Study):
        name = key.path.replace("[]", ".NAME")
        at = text["study"].index(f"\n``{name}``\n   ")
        assert reference.escaped(key.facts.meaning) in text["study"][at:]
    assert "share_air" in text["study"]
    assert "   study\n" in text["index"] + "\n"


def test_each_key_is_reported_once_with_all_that_is_known_of_it(text, whole):
    names = re.findall(r"^\.\. key:: (.*)$", whole, re.M)
    assert len(names) == len(set(names)) == len(list(all_keys()))
    page = text["openings"].replace("\\", "")
    at = page.index(".. key:: wind.openings[].turbulence_intensity\n")
    entry = page[at : page.index(".. key::", at + 1)]
    assert "Standard deviation of each velocity component over the mean speed" in entry
    assert "*number* · 0 to 1 · default: ``0`` · of kind ``fan``, ``inlet``, ``honeycomb``" in entry
    assert ".. key:: wind.openings[].speed (inlet)" in page


def test_texts_are_escaped_and_every_section_has_a_page():
    assert reference.escaped("a*b_c |u| <x> `code_` d") == r"a\*b\_c \|u\| \<x\> ``code_`` d"
    assert reference.escaped("a ` b") == r"a \` b"
    pages = {"wind.gusts": "wind", "wind.openings[].curve": "openings", "something_new.part": "scenario"}
    assert {section: reference.page_of(section) for section in pages} == pages
