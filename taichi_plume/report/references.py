"""References: papers behind the algorithms, gas maps, gases and winds of a run, as plain text and as BibTeX.

The papers are in references.bib. The modules' docstrings cite the same papers beside the equations.
"""

import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

from taichi_plume.scenario.scenario import Scenario

LONGEST_VERSION = 40  # characters


class Paper(NamedTuple):
    """Paper of references.bib. entry: its BibTeX text; fields: its fields in plain text by name, "" if missing.

    uses: remark on each kind that rests on the paper, by names such as "gas map gmrf".
    """

    key: str
    entry: str
    fields: dict[str, str]
    uses: dict[str, str]

    @property
    def text(self) -> str:
        """The reference as a line of plain text, without a full stop."""
        author, title, journal, book, year, volume, pages, doi, arxiv = self.fields.values()
        families = [name.partition(",")[0] for name in author.split(" and ")]
        if families[-1] == "others":
            names = f"{', '.join(families[:-1])} et al."
        else:
            names = " & ".join(filter(None, (", ".join(families[:-1]), families[-1])))
        where = f"{journal or book} {volume}".rstrip() + (f" ({year})" if year not in book else "")
        where += pages and (f" {pages}" if journal else f", {pages}")
        quoted, doi, arxiv = title and f'"{title}"', doi and f"doi:{doi}", arxiv and f"arXiv:{arxiv}"
        return ", ".join(filter(None, (names, quoted, where, doi, arxiv)))


FIELDS = ("author", "title", "journal", "booktitle", "year", "volume", "pages", "doi", "eprint")


@cache
def library() -> list[Paper]:
    """Return the papers of references.bib."""
    text = Path(__file__).with_name("references.bib").read_text(encoding="utf-8")
    papers = []
    for entry, key, body in re.findall(r"^(@\w+\{(\w+),\n(.*?)^\})", text, re.MULTILINE | re.DOTALL):
        given = dict(re.findall(r"^  (\w+) = \{(.*)\},$", body, re.MULTILINE))
        used = (use.partition(": ") for use in given["used"].split("; "))
        fields = {name: re.sub(r"[{}\\]", "", given.get(name, "")).replace("--", "-") for name in FIELDS}
        entry = re.sub(r"  used = .*\n", "", entry)
        papers.append(Paper(key, entry, fields, {kind: remark for kind, _, remark in used}))
    return papers


def used(scenario: Scenario) -> dict[str, list[Paper]]:
    """Return the papers of each search algorithm, gas map, gas and wind of a scenario that is based on papers."""
    kinds = [f"search algorithm {group.algorithm.kind}" for group in scenario.robots]
    kinds += [f"gas map {gas_map.kind}" for gas_map in scenario.maps]
    kinds += [*(f"gas {gas.kind}" for _, gas in scenario.gases), f"wind {scenario.wind.kind}"]
    names = (kind.replace("_", " ") for kind in kinds)
    found = {name: [paper for paper in library() if name in paper.uses] for name in names}
    return {name: papers for name, papers in found.items() if papers}


def papers(scenario: Scenario) -> list[tuple[str, str]]:
    """Return (name, references in plain text) of each part of a scenario that is based on papers."""
    rows = []
    for name, several in used(scenario).items():
        lines = (f"{paper.uses[name]}: {paper.text}." for paper in several)
        rows.append((name, " ".join(line.removeprefix(": ") for line in lines)))
    return rows


def bibtex(scenario: Scenario, version: str) -> str:
    """Return BibTeX entries of taichi_plume and of the papers that a scenario uses, each below a comment on its use."""
    notes: dict[str, list[str]] = {}
    for name, several in used(scenario).items():
        for paper in several:
            notes.setdefault(paper.key, []).append(f"{name}: {paper.uses[name]}".removesuffix(": "))
    cited = sorted((paper for paper in library() if paper.key in notes), key=lambda paper: paper.key)
    entries = [f"% {'; '.join(notes[paper.key])}\n{paper.entry}" for paper in cited]
    return "\n\n".join([software(version), *entries])


def software(version: str) -> str:
    """Return the BibTeX entry of a version of taichi_plume, with the data of CITATION.cff."""
    version = re.sub(r"[^A-Za-z0-9.+-]", "", version)[:LONGEST_VERSION]
    return (
        "@misc{taichi_plume,\n  author = {{The developers of taichi\\_plume}},\n"
        "  title = {{taichi\\_plume: air flow, odour plumes, robots with gas sensors and gas maps from one file}},\n"
        f"  note = {{Version {version}}},\n}}"
    )
