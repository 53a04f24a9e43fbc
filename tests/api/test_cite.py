"""BibTeX of the papers that runs and scenarios use, read by a small parser of its own."""

import re
from pathlib import Path

import made_run
import pytest
import yaml

import taichi_plume as tp
from taichi_plume.report import references

ROOT = Path(__file__).parent.parent.parent
UNTITLED = {"fung1992", "metais1992"}  # a DOI names them
PLACES = {"article": "journal", "inproceedings": "booktitle", "incollection": "booktitle", "misc": "note"}


def group(text: str, start: int) -> int:
    """The index after the group of braces that begins at `start`."""
    depth = 0
    for place in range(start, len(text)):
        escaped = place and text[place - 1] == "\\"
        depth += (text[place] == "{" and not escaped) - (text[place] == "}" and not escaped)
        if not depth:
            return place + 1
    raise AssertionError("a brace is not closed")


def parsed(text: str) -> dict[str, tuple[str, dict[str, str]]]:
    """Type and fields of each entry by key. Fields are in braces; outside entries only comments stand."""
    entries: dict[str, tuple[str, dict[str, str]]] = {}
    place = 0
    for head in re.finditer(r"@(\w+)\{([\w]+),", text):
        assert all(line.startswith("%") for line in text[place : head.start()].split("\n") if line)
        assert "@" not in text[place : head.start()]
        place = group(text, head.start() + len(head[1]) + 1)
        body, fields = text[head.end() : place - 1], {}
        while match := re.match(r"\s*(\w+) = (?=\{)", body):
            end = group(body, match.end())
            assert match[1] not in fields
            fields[match[1]] = body[match.end() + 1 : end - 1]
            assert body[end] == ","
            body = body[end + 1 :]
        assert not body.strip()
        assert head[2] not in entries
        entries[head[2]] = head[1], fields
    assert not text[place:].strip()
    return entries


def valid(text: str) -> dict[str, tuple[str, dict[str, str]]]:
    entries = parsed(text)
    for key, (kind, fields) in entries.items():
        needed = {"author", "title", PLACES[kind]} | ({"year"} if kind != "misc" else set())
        assert needed - fields.keys() <= ({"title"} if key in UNTITLED and "doi" in fields else set())
        for value in fields.values():
            assert not re.search(r"(?<!\\)[&%#_$]", value), value
    return entries


def dois(text: str) -> list[str]:
    """The DOIs of plain text."""
    return [doi.rstrip(".,") for doi in re.findall(r"doi:(\S+)", text)]


@pytest.mark.parametrize(
    ("scenario", "keys"),
    [
        (
            "casting_room",
            "lochmatter2009tracking turduev2014 monroy2016 lilienthal2009 asadi2011 reggente2009",
        ),
        ("playback", "cabrita2010 lochmatter2009tracking"),
        ({"robots.0.algorithm.kind": "infotaxis"}, "vergassola2007"),
        ({"robots.0.algorithm.kind": "particle_filter"}, "li2011 kitagawa1996 gordon1993"),
        (
            "quiet_room",
            "lochmatter2009tracking fung1992 bridson2007 metais1992 sreenivasan1995",
        ),
        ({"robots.0.algorithm": {"kind": "random_walk"}}, ""),
    ],
    ids=str,
)
def test_entries_are_those_of_the_kinds_that_are_used(scenario, keys):
    if isinstance(scenario, dict):
        algorithm = scenario.get("robots.0.algorithm.kind")
        changes = {"robots.0.algorithm": {"kind": algorithm}} if algorithm else scenario
        scenario = tp.load_scenario("plumesim_casting", changes)
    text = tp.cite(scenario)
    entries = valid(text)
    assert entries.keys() == {"taichi_plume", *keys.split()}
    rows = references.papers(tp.load_scenario(scenario))
    assert {doi for _, row in rows for doi in dois(row)} == {
        fields["doi"] for _, fields in entries.values() if "doi" in fields
    }


def test_all_papers_are_valid_entries():
    text = (ROOT / "taichi_plume/report/references.bib").read_text(encoding="utf-8")
    entries = valid(text)
    assert len(entries) == text.count("\n@") > 30
    assert "used" not in valid("\n\n".join(paper.entry for paper in references.library()))["li2014"][1]
    for paper in references.library():
        _, fields = entries[paper.key]
        assert fields["year"] in paper.key
        assert dois(paper.text) == ([fields["doi"]] if "doi" in fields else [])
        assert fields["author"].split(",")[0].split(" and ")[0] in paper.text


def test_the_entry_of_the_program_is_that_of_the_citation_file():
    cff = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    _, fields = valid(references.software("1.2.3"))["taichi_plume"]
    plain = {name: re.sub(r"[{}\\]", "", value) for name, value in fields.items()}
    (author,) = cff["authors"]
    assert plain == {"author": author["name"], "title": cff["title"], "note": "Version 1.2.3"}


@pytest.mark.parametrize("end", ["", "} @misc{other,"])
def test_a_run_and_its_folder_are_cited_with_their_version(tmp_path, end):
    model = made_run.scenario()
    version = tp.__version__.rpartition(".dev")[0] + ".7" + end
    folder = made_run.made(
        tmp_path / "run", model, recording=False, content=made_run.result(model, version=version)
    )
    text = tp.cite(tp.open_run(folder))
    assert text == tp.cite(folder) == tp.cite(str(folder))
    entries = valid(text)
    assert entries["taichi_plume"][1]["note"].startswith(f"Version {version.removesuffix(end)}")
    assert entries.keys() == valid(tp.cite(model)).keys()


def test_what_cannot_be_cited_is_refused(tmp_path):
    with pytest.raises(tp.InputError):
        tp.cite("no_such_example")
    with pytest.raises(tp.InputError):
        tp.cite(3)  # type: ignore[arg-type]
