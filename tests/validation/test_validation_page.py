"""The documentation's page of the validation: what it makes of the results that are kept."""

import json
import re
import shutil
from pathlib import Path

import pytest
from scripts import loaded

from taichi_plume.validation.case import EVIDENCE
from taichi_plume.validation.cases import CASES

DOCS = Path(__file__).resolve().parents[2] / "docs"
RESULTS = json.loads((DOCS / "validation/results.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def extension():
    return loaded(DOCS / "_ext/validation_page.py")


def result(name: str, **changes) -> dict:
    """As make.py keeps one."""
    norm = {
        "norm": "u | rms",
        "errors": {"8": 0.04, "16": 0.01},
        "order": 2.0,
        "expected": "order >= 1.9",
        "met": True,
    }
    made = {"date": "2026-01-02", "commit": "abc", "versions": {"taichi_plume": "1.2"}, "backend": "cpu"}
    stored = {"name": name, "about": "a flow", "passed": True, "message": "", "norms": [norm], "pictures": {}}
    return stored | made | changes


def row_of(page: str, name: str) -> list[str]:
    (row,) = [line for line in page.splitlines() if f"(`{name}`)" in line]
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]


def glance(page: str) -> dict[str, list[str]]:
    """Names of the cases that are met, not met and not run, by kind of evidence."""
    table = page.partition("## At a glance")[2].partition("## ")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines() if "**: " in line]
    return {row[0].split("**")[1]: row[1:] for row in rows}


def test_the_table_at_a_glance_has_every_case_once(extension):
    page = extension.page(extension.cases(), RESULTS)
    rows = glance(page)
    assert set(rows) == set(EVIDENCE)
    shown = {name: kind for kind, cells in rows.items() for name in re.findall(r"`(\w+)`", " ".join(cells))}
    assert shown == {name: case.evidence for name, case in CASES.items()}
    assert sum(len(re.findall("`", " ".join(cells))) for cells in rows.values()) == 2 * len(CASES)
    met, missed, _ = zip(*rows.values(), strict=True)
    for cells, passed in ((met, True), (missed, False)):
        judged = {name for name, stored in RESULTS.items() if stored["passed"] is passed}
        assert set(re.findall(r"`(\w+)`", " ".join(cells))) == judged


def test_every_case_belongs_to_one_group(extension):
    found = {
        name: [title for title, _, pattern in extension.GROUPS if re.match(pattern, name)] for name in CASES
    }
    assert {name: titles for name, titles in found.items() if len(titles) != 1} == {}


def test_what_is_kept_is_of_cases_that_there_are():
    assert set(RESULTS) - set(CASES) == set()
    assert len(RESULTS) > 50


def test_a_row_tells_what_was_wanted_and_measured(extension):
    page = extension.page(
        {"duct_1": extension.Known("a duct", "series", "exact")}, {"duct_1": result("duct_1")}
    )
    cells = row_of(page, "duct_1")
    assert cells[2:] == ["exact", r"u \| rms: order ≥ 1.9", "0.01 at 16, order 2.00", "met"]
    assert "all is met" in page


def test_what_failed_or_was_not_run_is_said(extension):
    missed = result("duct_1")
    missed["norms"] = [missed["norms"][0] | {"met": False}]
    cases = {name: extension.Known("a duct", "series", "exact") for name in ("duct_1", "duct_6", "pipe")}
    broken = result("pipe", passed=False, message="RuntimeError: no <steady> state")
    cases["pipe"] = cases["pipe"]._replace(evidence="measured")
    page = extension.page(cases, {"duct_1": missed | {"passed": False}, "pipe": broken})
    assert "Of 3 cases, 2 have been run" in page
    assert "not all is met by `duct_1`, `pipe`" in page
    assert row_of(page, "duct_1")[-1] == "**not met**"
    assert row_of(page, "duct_6")[2:] == ["exact", "", "", "not run"]
    assert row_of(page, "pipe")[2:5] == ["measured", "", r"RuntimeError: no \<steady\> state"]
    assert glance(page) == {
        "exact": ["", "1: `duct_1`", "1: `duct_6`"],
        "law": ["", "", ""],
        "measured": ["", "1: `pipe`", ""],
        "published": ["", "", ""],
    }


def test_each_judgement_has_its_row_and_a_doi_is_a_short_link(extension):
    stored = result("pipe")
    stored["norms"] = [
        stored["norms"][0] | {"norm": norm, "met": met}
        for norm, met in (("u", True), ("p", None), ("q", False))
    ]
    page = extension.page(
        {"pipe": extension.Known("a pipe", "X 1996, case <2>, doi:10.1007/978-3_39", "law")}, {"pipe": stored}
    )
    first, second = [line for line in page.splitlines() if line.endswith(("met |", "met** |"))]
    assert first.startswith(
        r"| a pipe (`pipe`) | X 1996, case \<2\>, [doi](https://doi.org/10.1007/978-3_39) | law | u: "
    )
    assert second.startswith("|  |  |  | q: ")


def test_a_paper_is_described_at_length(extension):
    """Its paragraphs, what was published beside what was found, and the rest for who wants it."""
    row = {"condition": "casting", "quantity": "time", "mean": 40.0, "low": 35.0, "high": 45.0, "n": 20}
    rows = [
        row | {"airs": 8, "published": "38 s", "expected": "<= 60", "met": True},
        row | {"quantity": "bumps", "airs": None, "published": "", "expected": None, "met": None},
    ]
    stored = result("dapso_arena", rows=rows, norms=[], wall_s=90.0)
    known = extension.Known("teams", "a paper", "published", "It is <so>.\n\n# Not always.")
    page = extension.repeated({"dapso_arena": known, "annex20": known}, {"dapso_arena": stored})
    first, rest = page.split("<details>")
    assert "*teams* (a paper; evidence: published)" in first
    assert "\nIt is \\<so\\>.\n\n\\# Not always.\n" in first
    assert "| casting | time | 40 (35 to 45), n = 20 in 8 airs | 38 s | ≤ 60 | met |" in first
    assert "bumps" not in first
    assert "| casting | bumps |" in rest
    assert rest.endswith("Not run for this page.\n")


def test_results_that_are_kept_can_all_be_shown(extension, tmp_path):
    few = {name: RESULTS[name] for name in ("cylinder", "plumesim_casting")}
    (tmp_path / "results.json").write_text(json.dumps(few), encoding="utf-8")
    shutil.copy(DOCS / "validation/speed.json", tmp_path)
    extension.write(tmp_path)
    assert (tmp_path / "plots/cylinder.svg").read_text(encoding="utf-8").rstrip().endswith("</svg>")
    page = extension.page(extension.cases(), RESULTS)
    assert page.count("\n| ") >= len(CASES)
    drawn = set(re.findall(r"plots/(\w+)\.svg", page))
    assert drawn == {name for name, stored in RESULTS.items() if extension._panels(stored)}
