"""Examples that travel with the package: the scenarios, studies and tasks of `configs/`, the programs of `examples/`,
beside launch files of ROS 2 with layouts of Foxglove.

The first sentence of a file states what the example shows. The time of a run stands in the same comment, as "15 s on a
laptop" or "90 s in real time".
"""

import ast
import filecmp
import os
import re
import shutil
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.suggestions import nearest

ROOTS = Path(__file__).parents[1:3]  # folders that can hold configs and examples: in a wheel, in a checkout
KINDS = {"study": r"^base:", "task": r"^task:", "live": r"\bkind: external\b", "scenario": ""}
"""Kinds of YAML files, each with the regular expression that distinguishes the kind from those after it."""
TIME = re.compile(r"(\d+ (?:s|min)) (?:on a laptop|in real time)")


class Example(NamedTuple):
    """Bundled file. kind: one of KINDS, program or launch; story: first sentence; time: of a run ("15 s"), or ""."""

    name: str
    path: Path
    kind: str
    story: str
    time: str


def names() -> list[str]:
    """Return the names of all examples: paths in `configs/` without .yaml, and the file names of programs."""
    return list(_files())


def path_of(name: str) -> Path:
    """Return the path of an example's file, in a checkout and in a wheel. Raises ScenarioError for an unknown name."""
    files = _files()
    if name not in files:
        from taichi_plume.scenario.loading import ScenarioError  # imports all sections of a scenario

        meant = f"did you mean {close}? " if (close := nearest(name, files)) else ""
        got = f"example: got '{visible(name, LONGEST_VALUE)}'"
        raise ScenarioError([f"{got}; {meant}must be one of {', '.join(files)}"])
    return files[name]


def file_or_example(source: str | Path) -> Path:
    """Return the path of a file that is given by its path, or by the name of an example. Raises ScenarioError."""
    path = Path(source)
    if path.suffix or (os.path.exists(path) and not os.path.isdir(path)):
        return path
    return path if os.path.isdir(path) and str(source) not in names() else path_of(str(source))


def example(name: str) -> Example:
    """Read the kind, story and time of an example. Raises ScenarioError for an unknown name."""
    path = path_of(name)
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        kind = "launch" if path.name.endswith(".launch.py") else "program"
        head = ast.get_docstring(ast.parse(text)) or ""
    else:
        kind = next(kind for kind, pattern in KINDS.items() if re.search(pattern, text, re.MULTILINE))
        head = "\n".join(
            line.removeprefix("#") for line in takewhile(lambda line: line.startswith("#"), text.splitlines())
        )
    head = " ".join(head.split())
    time = TIME.search(head)
    return Example(name, path, kind, re.split(r"\.(?: (?=[A-Z`])|$)", head)[0], time[1] if time else "")


def copied(chosen: Example, out: Path, base: Path | None = None) -> dict[Path, bool]:
    """Copy an example and its input files into a folder; return each path and whether it is new, the example's first.

    base: scenario of a study. Input files that are there already with the same content stay. Raises InputError if
    another file exists.
    """
    from taichi_plume.files.disk import written_whole

    folder = chosen.path.parent
    copies = {out / file.relative_to(folder): file for file in _files_of(chosen, base)}
    main_copy = next(iter(copies))
    same = [path for path in copies if path.is_file() and filecmp.cmp(copies[path], path, shallow=False)]
    existing = [
        str(path) for path in copies if os.path.lexists(path) and (path == main_copy or path not in same)
    ]
    if existing:
        raise InputError(
            f"{', '.join(existing)}: exists, and no file is overwritten; choose another folder by --out DIR"
        )
    for path, file in copies.items():
        if path not in same:
            path.parent.mkdir(parents=True, exist_ok=True)
            with written_whole(path, replace=False) as fresh:
                shutil.copyfile(file, fresh)
    return {path: path not in same for path in copies}


def _files_of(chosen: Example, base: Path | None) -> list[Path]:
    """Return the file of an example, the base scenario of a study, the input files of the scenario, or the layout."""
    from taichi_plume.scenario.input_files import files_of, input_files
    from taichi_plume.scenario.loading import read_scenario

    if chosen.kind == "launch":
        return [chosen.path, chosen.path.with_name(chosen.name.replace(".launch.py", ".foxglove.json"))]
    if chosen.kind == "program":
        return [chosen.path]
    folder, base = chosen.path.parent, base or chosen.path
    inputs = [file for _, name in input_files(read_scenario(base)) for file in files_of(folder, name)]
    return list(dict.fromkeys([chosen.path, base, *inputs]))


def _files() -> dict[str, Path]:
    """Return the file of each example by name; the folders lie beside the package or, in a wheel, inside."""
    root = next(root for root in ROOTS if (root / "configs").is_dir())
    configs = root / "configs"
    files = {path.relative_to(configs).with_suffix("").as_posix(): path for path in configs.rglob("*.yaml")}
    programs = {path.name: path for path in sorted((root / "examples").glob("*.py"))}
    return dict(sorted(files.items())) | programs
