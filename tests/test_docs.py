"""The pages: their links lead somewhere, their blocks run, and what is built refers to no other host.

How blocks of a page are read, in README.md and docs/**/*.md:

- ``yaml`` with a `domain` is a whole scenario. One that begins with "# part of a scenario" is put into a small one, in
  3-D where it says so; if it "needs your files", only its keys are checked. One that begins with "# wrong: PATH" is
  put in likewise and must be refused, in the words of the ``text`` block that follows. A file with `base` is a study.
  There, ", ..., " stands for any part of a list.
- a ``{code-block}`` with a `:caption:` is a file of that name, which the other blocks of the page find.
- ``python`` blocks of a page are run one after the other, in a folder with those files; a ``pycon`` block is a doctest.
- of lines ``python -m taichi_plume.NAME`` the options are looked up in its ``--help``.

Notebooks of docs/notebooks are executed by the build of the site.

Scenarios of docs/coming-from are loaded by test_coming_from.py, which makes the foreign files that they read.
"""

import ast
import contextlib
import copy
import doctest
import importlib
import io
import json
import os
import re
import shlex
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

import taichi_plume
from taichi_plume.__main__ import main
from taichi_plume.assembly.preparation import load
from taichi_plume.scenario.keys import all_keys
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.studies.plan import load_plan

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
MADE = (  # by the build
    *("reference", "tutorials", "gallery/runs", "_build"),
    *("validation/trust.md", "validation/tables.md", "validation/repeated.md"),
)
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"] + [
    path
    for path in sorted(DOCS.rglob("*.md"))
    if not any(path.relative_to(DOCS).is_relative_to(made) for made in MADE)
]
FOREIGN = DOCS / "coming-from"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
IMPORTED = {
    "gymnasium",
    "matplotlib",
    "numpy",
    "pandas",
    "taichi_plume",
    "xarray",
    "yaml",
} | sys.stdlib_module_names
SUBPACKAGES = {"envs"}
"""Public packages within taichi_plume."""
FENCE = re.compile(r"^(`{3,})(.*)\n((?:.*\n)*?)\1$", re.MULTILINE)
LINK = re.compile(r"(?<!`)\[[^\]`]*(?:`[^`]*`[^\]`]*)*\]\(([^)\s]+)\)")
COMMAND = re.compile(r"^(?:python -m taichi_plume[. ]|taichi-plume )(\w+)((?:.|\\\n)*)$", re.MULTILINE)

ELLIPSIS = ", ..., "
SMALL = """
duration: 10 s
domain: {size: [5 m, 4 m], spacing: 20 cm, depth: 0.5 m}
wind:
  kind: cfd
  openings: [{kind: inlet, face: x-, speed: 0.5 m/s}, {kind: outlet, face: x+}]
gas:
  kind: eulerian
  species: ethanol
  sources: [{position: [0.8, 2.1], rate: 20 mg/s}]
"""
SMALL_3D = {
    "domain": {"size": [5, 4, 2], "spacing": 0.2},
    "gas": {"kind": "eulerian", "sources": [{"position": [0.8, 2.1, 0.2], "rate": "20 mg/s"}]},
}


class Block(NamedTuple):
    """A fenced block of a page: the language, the file that it is, or "", and its text."""

    page: Path
    line: int
    language: str
    file: str
    text: str


@cache
def blocks(page: Path) -> list[Block]:
    """The blocks of a page, in order."""
    text, found = page.read_text(encoding="utf-8"), []
    for match in FENCE.finditer(text):
        info, body, file = match[2].strip(), match[3], ""
        directive = re.fullmatch(r"\{code-block\} *(\w+)", info)
        if directive:
            info = directive[1]
            options = re.match(r"(?::\w+:.*\n)*\n?", body)
            assert options
            caption = re.search(r"^:caption: *(.+)$", options[0], re.MULTILINE)
            file, body = (caption[1].strip() if caption else ""), body[options.end() :]
        found.append(Block(page, text[: match.start()].count("\n") + 1, info, file, body))
    return found


def of(*languages: str) -> list[Any]:
    """The blocks of all pages in one of these languages."""
    return [
        pytest.param(block, id=f"{block.page.relative_to(ROOT)}:{block.line}")
        for page in PAGES
        for block in blocks(page)
        if block.language in languages and FOREIGN not in page.parents
    ]


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def anchors(page: Path) -> set[str]:
    """What headings of a page are called in links."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    return {
        re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")
        for heading in re.findall(r"^#+ +(.+)$", text, re.MULTILINE)
    }


@cache
def cells(notebook: Path, kind: str) -> list[str]:
    """Texts of the cells of a notebook; kind: "code" or "markdown"."""
    stored = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in stored if cell["cell_type"] == kind]


@pytest.mark.parametrize("page", PAGES + NOTEBOOKS, ids=name)
def test_links_lead_somewhere(page):
    """Those within the project; of what the build makes the folder's name counts."""
    notebook = page.suffix == ".ipynb"
    text = "\n".join(cells(page, "markdown")) if notebook else page.read_text(encoding="utf-8")
    text = FENCE.sub("", text)
    for link in LINK.findall(text):
        if re.match(r"[a-z]+:", link):
            assert link.startswith("https://"), link
            continue
        target, _, anchor = link.partition("#")
        path = (page.parent / target).resolve() if target else page
        inside = path.relative_to(ROOT).parts  # fails where it leaves the project
        if inside[0] == "docs" and any(Path(*inside[1:]).is_relative_to(made) for made in MADE):
            continue
        assert path.exists(), f"{link} is not there"
        if anchor and path.suffix == ".md":
            assert anchor in anchors(path), f"{link}: no such heading"


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=name)
def test_notebooks_are_stored_without_outputs(notebook):
    """The build makes the outputs. Metadata may name the language, but no machine."""
    stored = json.loads(notebook.read_text(encoding="utf-8"))
    assert stored["metadata"].keys() == {"kernelspec", "language_info"}
    for cell in stored["cells"]:
        assert not cell["metadata"]
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None
    lines = "\n".join(cells(notebook, "markdown") + cells(notebook, "code")).splitlines()
    assert max(map(len, lines)) <= 120


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=name)
def test_notebooks_use_public_names(notebook):
    assert not private_names("\n".join(cells(notebook, "code")))


def private_names(code: str) -> set[str]:
    """Names of taichi_plume in the code that are not public, and packages that the docs do not install."""
    tree, found = ast.parse(code), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.module
            modules = [node.module]
            if node.module == taichi_plume.__name__:
                modules = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "tp":
            modules = [f"taichi_plume.{node.attr}"]
        else:
            continue
        for module in modules:
            package, _, member = module.partition(".")
            if package not in IMPORTED:
                found.add(package)
            elif package == taichi_plume.__name__ and member not in {"", *taichi_plume.__all__, *SUBPACKAGES}:
                found.add(module)
    return found


def test_private_names_are_noticed():
    code = "import taichi_plume as tp, torch\nfrom taichi_plume.grid import kernels\ntp.time_loop, tp.Own, tp.envs"
    assert private_names(code) == {"torch", "taichi_plume.grid", "taichi_plume.time_loop"}


def saved(tmp_path: Path, block: Block) -> Path:
    """A yaml block as a scenario, put into the small one where it is a part, with the files of its page beside it."""
    lay_files(tmp_path, block.page)
    path = tmp_path / (block.file or "scenario.yaml")
    first = block.text.partition("\n")[0]
    if first.startswith(("# part of a scenario", "# wrong: ")):
        whole = yaml.safe_load(SMALL)
        if "3-D" in first:
            whole.update(copy.deepcopy(SMALL_3D))
        path.write_text(yaml.safe_dump(whole | yaml.safe_load(block.text)))
    else:
        assert re.search(r"^domain:", block.text, re.MULTILINE), (
            'neither whole nor marked "# part of a scenario"'
        )
        path.write_text(block.text)
    return path


def lay_files(folder: Path, page: Path) -> None:
    """The files of a page, and the configs."""
    for block in blocks(page):
        if block.file:
            (folder / block.file).write_text(block.text)
    (folder / "configs").symlink_to(ROOT / "configs")


@pytest.mark.parametrize("block", of("yaml"))
def test_scenarios_are_right(block, tmp_path):
    """Each is accepted, or refused as the page says."""
    if re.search(r"^base:", block.text, re.MULTILINE):
        lay_files(tmp_path, block.page)
        assert load_plan(tmp_path / block.file, allow_outside=True).requests
        return
    path = saved(tmp_path, block)
    first = block.text.partition("\n")[0]
    if first.startswith("# wrong: "):
        place = blocks(block.page).index(block)
        reported = blocks(block.page)[place + 1]
        assert reported.language == "text"
        with pytest.raises(ScenarioError) as refused:
            load(path)
        expected = re.escape(f"{path}: {reported.text.strip()}".replace("FOLDER", str(tmp_path)))
        assert re.fullmatch(expected.replace(re.escape(ELLIPSIS), ", .*?, "), str(refused.value))
        assert reported.text.startswith(first.removeprefix("# wrong: "))
        return
    faults: list[str] = []
    try:
        load(path)
    except ScenarioError as error:
        faults = error.faults
    if "needs your files" in first or makes_files(block.page):
        faults = [fault for fault in faults if not re.search(r"[Nn]o such file|does not exist", fault)]
    assert not faults


def makes_files(page: Path) -> bool:
    """Whether its Python, which another test runs, makes files for its scenarios."""
    return any(block.language == "python" and "open(" in block.text for block in blocks(page))


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [p for p in PAGES if any(b.language == "python" for b in blocks(p))], ids=name
)
def test_python_runs(page, tmp_path):
    """In one process per page, as a reader would paste it."""
    lay_files(tmp_path, page)
    script = "\n".join(block.text for block in blocks(page) if block.language == "python" and not block.file)
    (tmp_path / "page.py").write_text(script)
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}", "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, "page.py"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("block", of("pycon"))
def test_doctests_hold(block, monkeypatch):
    """Blocks with >>>, typed in the folder of a clone."""
    monkeypatch.chdir(ROOT)
    test = doctest.DocTestParser().get_doctest(block.text, {}, name(block.page), None, block.line)
    assert not doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test).failed


COMMANDS = [
    pytest.param(module, options, id=f"{name(block.page)}:{block.line} {module}")
    for page in PAGES
    for block in blocks(page)
    if block.language in ("", "bash", "sh", "console")
    for module, options in COMMAND.findall(block.text.replace("\\\n", " "))
]


@cache
def help_of(module: str) -> str:
    """Return the help of a command."""
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as shown:
        patch.setenv("COLUMNS", "200")
        with pytest.raises(SystemExit) as ended:
            main([module, "--help"])
    assert not ended.value.code
    return shown.getvalue()


@pytest.mark.parametrize(("module", "options"), COMMANDS)
def test_commands_have_these_options(module, options):
    """By their names, as the command's help has them."""
    reported = help_of(module)
    for word in shlex.split(re.sub(r"[\[\]]", " ", options), comments=True):
        if word.startswith("--"):
            assert re.search(rf"{re.escape(word.partition('=')[0])}\b", reported), word


@pytest.mark.parametrize(
    ("tex", "numbers"),
    [(r"\tfrac56 - f", ["5", "6"]), (r"x^23", ["2", "3"]), (r"\frac{12}{3}", ["12", "3"]), ("21 °", ["21"])],
)
def test_digits_in_formulas_are_read_as_in_tex(tex, numbers, monkeypatch):
    """After a fraction or a power, one by one."""
    nodes = pytest.importorskip("docutils.nodes", reason="pip install -e .[docs]")
    pytest.importorskip("sphinx", reason="pip install -e .[docs]")
    monkeypatch.syspath_prepend(str(DOCS / "_ext"))
    made = importlib.import_module("mathml").made(nodes.math(tex, tex), False)
    assert re.findall(r"<mn>(.*?)</mn>", made) == numbers


class References(HTMLParser):
    """What a page loads by itself: scripts, styles, pictures, fonts, frames; not links for readers to follow."""

    LOADS = frozenset(
        {"script", "link", "img", "iframe", "source", "video", "audio", "object", "embed", "use"}
    )

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note its addresses; a `link` that names the page's own place or a licence loads nothing."""
        values = dict(attrs)
        if tag in self.LOADS and values.get("rel") not in ("canonical", "license", "author"):
            self.loaded += [values[key] or "" for key in ("src", "href", "data", "srcset") if key in values]


def foreign(folder: Path) -> list[str]:
    """What the pages and styles of a folder load from other hosts."""
    found = []
    for path in folder.rglob("*.html"):
        reader = References()
        reader.feed(path.read_text(encoding="utf-8"))
        found += [f"{path}: {one}" for one in reader.loaded if re.match(r"(\w+:)?//", one)]
    for path in folder.rglob("*.css"):
        text = path.read_text(encoding="utf-8")
        found += [
            f"{path}: {one}" for one in re.findall(r"(?:@import|url\()\s*[\"']?((?:\w+:)?//[^\"')]+)", text)
        ]
    return found


def test_another_host_is_noticed(tmp_path):
    (tmp_path / "index.html").write_text(
        '<a href="https://example.org/read">read</a><script src="https://example.org/a.js"></script>'
        '<link rel="stylesheet" href="//example.org/a.css"><img src="here.png">'
    )
    (tmp_path / "style.css").write_text("body { background: url(https://example.org/b.png) }")
    assert [one.rpartition(": ")[2] for one in foreign(tmp_path)] == [
        "https://example.org/a.js",
        "//example.org/a.css",
        "https://example.org/b.png",
    ]


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_or_another_host(tmp_path):
    """From nothing, its tutorials executed."""
    pytest.importorskip("sphinx", reason="pip install -e .[docs]")
    built = tmp_path / "html"
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-E", "-b", "html", "docs", str(built)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    assert not foreign(built)
    assert len(list(built.rglob("*.html"))) > 20
    script = (built / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(script.removeprefix("Search.setIndex(").removesuffix(")"))
    (kind,) = (number for number, (*_, title) in index["objnames"].items() if title == "scenario key")
    keys = {
        f"{path}.{name}".lstrip(".")
        for path, several in index["objects"].items()
        for _, number, *_, name in several
        if str(number) == kind
    }
    assert len(keys) == len(list(all_keys()))  # each key can be searched for
