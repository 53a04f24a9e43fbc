"""The models' pages name every kind that a scenario can have, and the states that the algorithms have."""

import ast
import re
from pathlib import Path

import pytest

from taichi_plume.scenario.scenario import Scenario

ROOT = Path(__file__).resolve().parents[1]
SCHEMA = Scenario.model_json_schema()
DEFINITIONS = SCHEMA["$defs"]
MODELS = {
    "air.md": (
        "CfdWind",
        "SyntheticWind",
        "UniformWind",
        "FrozenWind",
        "PlaybackWind",
        "ImportedWind",
        "OwnWind",
    ),
    "gas.md": (
        "EulerianGas",
        "PuffGas",
        "GaussianPlumeGas",
        "MeanderingGas",
        "GaussianPuffGas",
        "ContinuousGas",
        "OwnGas",
    ),
    "sensors.md": (
        "MoxSensor",
        "PidSensor",
        "TdlasSensor",
        "IdealGasSensor",
        "Anemometer",
        "Odometry",
        "Camera",
    ),
}
"""Sections of a scenario by the page that tells of them."""


def page(name: str) -> str:
    return (ROOT / "docs/models" / name).read_text(encoding="utf-8")


def kinds(model: str) -> list[str]:
    kind = DEFINITIONS[model]["properties"]["kind"]
    return [kind["const"]] if "const" in kind else kind["enum"]


@pytest.mark.parametrize(("name", "models"), MODELS.items())
def test_a_page_names_the_kinds_of_its_sections(name, models):
    text = page(name)
    missing = [kind for model in models for kind in kinds(model) if not re.search(rf"\b{kind}\b", text)]
    assert missing == [], f"docs/models/{name}: describe each"


@pytest.mark.parametrize(
    ("name", "schema", "pattern"),
    [
        ("algorithms.md", DEFINITIONS["Group"]["properties"]["algorithm"], "`kind: {}`"),
        ("maps.md", SCHEMA["properties"]["maps"]["items"], "{{kind: {},"),
    ],
)
def test_every_algorithm_and_map_is_described(name, schema, pattern):
    text, kinds = page(name), list(schema["discriminator"]["mapping"])
    assert len(kinds) > 3
    missing = [kind for kind in kinds if pattern.format(kind) not in text]
    assert missing == [], f"docs/models/{name}: describe each, as {pattern.format('KIND')}"


def test_the_states_are_those_of_the_algorithms():
    text = page("algorithms.md")
    reported = {name for row in re.findall(r"^\| ([A-Z_, ]+) \|", text, re.M) for name in row.split(", ")}
    known = set()
    for file in (ROOT / "agents").glob("*.py"):
        for names in re.findall(r"STATE_NAMES: .* = \(([^)]*)\)", file.read_text(encoding="utf-8")):
            known |= set(re.findall(r'"(\w+)"', names))
    assert len(known) > 15
    assert reported - known == set()
    missing = [name for name in known if not re.search(rf"\b{name}\b", text)]
    assert missing == [], "docs/models/algorithms.md: describe each state"


INCLUDED = re.compile(r"```{literalinclude} (\S+)\n:pyobject: (\S+)")


def names_in(file: Path) -> set[str]:
    """Its functions and classes, and `Class.method`."""
    found = set()
    for one in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(one, ast.FunctionDef | ast.ClassDef):
            found.add(one.name)
        if isinstance(one, ast.ClassDef):
            found |= {f"{one.name}.{part.name}" for part in one.body if isinstance(part, ast.FunctionDef)}
    return found


def test_the_code_that_pages_show_is_there():
    """Else only the site's build, which is slow, would tell."""
    pages = sorted((ROOT / "docs").rglob("*.md"))
    shown = [(one, *match) for one in pages for match in INCLUDED.findall(one.read_text(encoding="utf-8"))]
    assert len(shown) > 60
    assert [(one.name, name) for one, file, name in shown if name not in names_in(one.parent / file)] == []
