"""Reference of all keys of scenarios and studies, written from the models before Sphinx reads its sources.

Pages are reStructuredText under ``reference/`` of the sources: one per part of a scenario, with the kinds of its
sections, an example of each, and every key with its type, unit, limits, default and meaning. A key is a Sphinx object
(role ``key``), so that the index and the search lead to it.
"""

import inspect
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import yaml
from docutils import nodes

from taichi_plume.scenario.keys import Key, Place, places
from taichi_plume.scenario.vocabulary import Model
from taichi_plume.studies.study_keys import Study

if TYPE_CHECKING:
    from sphinx.application import Sphinx

EXAMPLES = Path(__file__).with_name("scenario_examples.yaml")
STUDY = Path(__file__).parents[2] / "configs" / "studies" / "wind_speeds.yaml"
PAGES = {
    "scenario": ("The scenario", [""]),
    "domain": ("Room and grid", ["domain", "arena"]),
    "wind": ("Wind", ["wind"]),
    "openings": ("Openings", ["wind.openings[]"]),
    "screens": ("Screens", ["wind.screens[]"]),
    "buoyancy": ("Warm air and heavy gas", ["wind.buoyancy"]),
    "obstacles": ("Obstacles", ["obstacles[]"]),
    "gas": ("Gas", ["gas"]),
    "sources": ("Sources", ["gas.sources[]", "gas.releases[]", "gas.species"]),
    "robots": ("Robots", ["robots[]"]),
    "algorithms": ("Search algorithms", ["robots[].algorithm"]),
    "sensors": ("Sensors", ["robots[].sensors"]),
    "maps": ("Gas maps", ["maps[]"]),
    "outputs": (
        "Outputs of a run",
        ["recording", "forces", "probes", "fields", "plumesim_log", "checkpoint"],
    ),
}
"""Title and paths of each page; a page includes everything below its paths that no other page names."""


def page_of(path: str) -> str:
    """Return the page that describes a place."""
    fits = [
        (len(prefix), page)
        for page, (_, prefixes) in PAGES.items()
        for prefix in prefixes
        if not prefix or path == prefix or path.startswith((f"{prefix}.", f"{prefix}["))
    ]
    return max(fits)[1]


class MissingExampleError(LookupError):
    """Error: kinds of a scenario have no example; the message names the file and the entries to add."""


def kinds() -> list[str]:
    """Return "PATH KIND" of each kind that a section of a scenario can have: the keys of the examples."""
    return [
        f"{place.path} {kind}" for place in places().values() if not place.same_as for kind in place.kinds
    ]


def pages() -> dict[str, str]:
    """Return the text of every page, by its name. Raises MissingExampleError."""
    examples = yaml.safe_load(EXAMPLES.read_text(encoding="utf-8"))
    missing = [kind for kind in kinds() if kind not in examples]
    if missing:
        raise MissingExampleError(f"docs/_ext/{EXAMPLES.name}: add an example of {', '.join(missing)}")
    found = {name: [*_title(title, "=")] for name, (title, _) in PAGES.items()}
    for path, place in places().items():
        found[page_of(path)] += _place(place, examples)
    index = [*_title("Scenario keys", "="), *_introduction(examples["base"])]
    found |= {"index": index, "study": list(_study())}
    return {name: "\n".join(lines) for name, lines in found.items()}


def _study() -> Iterator[str]:
    """Yield the page of a study's keys, which are no Sphinx objects, as some have names of scenario keys."""
    yield from _title("Study keys", "=")
    yield from _purpose(Study)
    yield from (
        "Such as ``configs/studies/wind_speeds.yaml``:",
        "",
        *_code(STUDY.read_text(encoding="utf-8")),
    )
    for place in places(Study).values():
        if place.path:
            yield from _title(place.path.replace("[]", ".NAME"), "-")
            for model in place.models:
                yield from _purpose(model)
        for key in place.keys:
            name = key.path.replace("[]", ".NAME")
            yield from (f".. index:: single: {key.name}; {name} (study)", "", f"``{name}``")
            yield from (f"   {escaped(key.facts.meaning)}", "", f"   {_figures(key)}", "")


def _introduction(base: str) -> Iterator[str]:
    """Yield the index page."""
    yield from (
        "A scenario is a YAML file of these parts. All units are SI; a *quantity* is a number in the unit given "
        "here, or a text with another unit, such as ``20 cm``, ``10 mg/s`` or ``2 min``. A key with *list* in its type "
        "takes several values in brackets, ``[]`` in a path stands for any element, and ``--set robots.0.count=6`` "
        "changes one value. ``python -m taichi_plume.scenario --explain KEY`` prints the same in a terminal, "
        "``--check`` explains a whole scenario, and ``--schema`` prints a JSON schema for editors.",
        "",
        "Examples replace or add parts of this scenario:",
        "",
        *_code(base),
        ".. toctree::",
        "   :maxdepth: 1",
        "",
        *(f"   {name}" for name in (*PAGES, "study")),
        "",
    )


def _place(place: Place, examples: dict[str, str]) -> Iterator[str]:
    """Yield the description of a section, or of all its kinds."""
    if place.path:
        yield from _title(place.path, "-")
    if place.within:
        yield from (f"In a section ``{place.path.rpartition('.')[0]}`` of kind {_names(place.within)}.", "")
    if place.same_as:
        kinds, page = _names(place.kinds), page_of(place.same_as)
        yield from (f"Takes all keys of ``{place.same_as}``, see :doc:`{page}`. Its kinds: {kinds}.", "")
        return
    for model in place.models:
        if not place.kinds:
            yield from _purpose(model)
    for kind, model in place.kinds.items():
        yield from _title(f"{kind}", "~")
        yield from _purpose(model)
        yield from _code(examples[f"{place.path} {kind}"])
        keys = [key for key in place.keys if not key.kinds or kind in key.kinds]
        if keys:
            yield from (f"Keys: {', '.join(f':key:`{key.name} <{title_of(key)}>`' for key in keys)}", "")
    if place.keys and place.kinds:
        yield from _title(f"Keys of {place.path}", "~")
    elif not place.keys:
        yield from (f"``{place.path}`` has no keys.", "")
    for key in place.keys:
        yield from _key(key)


def title_of(key: Key) -> str:
    """Return the title of a key: its path, and its kinds if other kinds have a different key."""
    alike = [
        one for one in places()[key.path.removesuffix(key.name).rstrip(".")].keys if one.name == key.name
    ]
    return f"{key.path} ({', '.join(key.kinds)})" if len(alike) > 1 else key.path


def _key(key: Key) -> Iterator[str]:
    """Yield the description of a key."""
    yield from (f".. index:: single: {key.name}; {key.path}", "", f".. key:: {title_of(key)}", "")
    yield from (f"   {escaped(key.facts.meaning)}", "", f"   {_figures(key)}", "")


def _figures(key: Key) -> str:
    """Return type, unit, limits, default and kinds in a line."""
    fact = key.facts
    parts = [f"*{escaped(fact.type)}*" + (f" in {escaped(fact.unit)}" if fact.unit else ""), fact.limits]
    parts += [f"default: ``{fact.default}``" if fact.default else "required"]
    parts += [f"of kind {_names(key.kinds)}"] if key.kinds else []
    return " · ".join(filter(None, parts))


def _purpose(model: type[Model]) -> Iterator[str]:
    """Yield the docstring of a section."""
    for paragraph in inspect.cleandoc(model.__doc__ or "").split("\n\n"):
        yield from (escaped(" ".join(paragraph.split())), "")


def _title(text: str, under: str) -> Iterator[str]:
    """Yield an underlined title."""
    text = escaped(text)
    yield from ("", text, under * (len(text) + 2), "")


def _code(text: str) -> Iterator[str]:
    """Yield a block of YAML."""
    yield from (".. code-block:: yaml", "", *(f"   {line}" for line in text.rstrip().splitlines()), "")


def _names(kinds: Iterable[str]) -> str:
    """Return names of kinds as code."""
    return ", ".join(f"``{kind}``" for kind in kinds)


def escaped(text: str) -> str:
    """Return a text for reStructuredText in which only pairs of backticks, which mark code, have a meaning."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        parts = [text]
    plain = [re.sub(r"([\\*_|<>`])", r"\\\1", part) for part in parts[::2]]
    code = [f"``{part}``" for part in parts[1::2]]
    return plain[0] + "".join(a + b for a, b in zip(code, plain[1:], strict=True))


def _signature(env: object, text: str, node: nodes.Element) -> str:
    """Show a key by its name, after the path to it."""
    path, _, kinds = text.partition(" (")
    before, dot, name = path.rpartition(".")
    node += nodes.inline("", before + dot, classes=["key-path"])
    node += nodes.strong("", name)
    if kinds:
        node += nodes.inline("", f" ({kinds}")
    return text


def write(app: "Sphinx") -> None:
    """Write the pages that have changed: Sphinx reads newer files again."""
    folder = Path(app.srcdir) / "reference"
    folder.mkdir(exist_ok=True)
    new = {f"{name}.rst": text for name, text in pages().items()}
    for file in folder.glob("*.rst"):
        if file.name not in new:
            file.unlink()
    for name, text in new.items():
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def setup(app: "Sphinx") -> dict[str, bool]:
    """Register the extension in Sphinx."""
    app.add_object_type("key", "key", "single: %s", parse_node=_signature, objname="scenario key")
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
