"""Input files that a scenario names, and checks that they lie inside the scenario's folder."""

import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from glob import escape, glob
from pathlib import Path

from taichi_plume.grid.map_files import SUFFIXES, image_of
from taichi_plume.guard.safe_open import OUTSIDE, inside
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.checks import every
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import INPUT_FILE, Model, marked

NUMBER = re.compile(r"%[0-9]*[dg]")  # stands for a number in the name of several files


@cache
def _names(model: type[Model]) -> tuple[str, ...]:
    """Return the keys of a section that name input files."""
    return tuple(key for key in model.model_fields if marked(model, key, INPUT_FILE))


def input_files(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield each input file of a scenario: the path of its key, such as ``obstacles[0].file``, and the file name.

    A key with several names has a path for each, such as ``task.films[0]``.
    """
    for where, section in every(scenario):
        for key in _names(type(section)):
            named = vars(section)[key]
            if isinstance(named, tuple):
                yield from ((f"{where}.{key}[{n}]", name) for n, name in enumerate(named))
            elif named:
                yield f"{where}.{key}", named


def input_paths(scenario: Scenario, file: Path, opened: Mapping[str, Sequence[Path]]) -> list[Path]:
    """Return the files to read for a scenario: its own `file`, then all input files (a recorded film is a folder).

    opened: files that were opened for each section, by its path.
    """
    named = [
        path for where, name in input_files(scenario) for path in read_for(where, name, file.parent, opened)
    ]
    return list(dict.fromkeys([file, *opened.get("gaden", ()), *named]))


def read_for(where: str, name: str, folder: Path, opened: Mapping[str, Sequence[Path]]) -> list[Path]:
    """Return the files that are read for the key `where` with the file name `name`; opened: as in `input_paths`.

    If only some files of a folder were opened, as of an OpenFOAM case, these are returned instead of the folder.
    """
    known = opened.get(where.rpartition(".")[0], ())
    return list(
        dict.fromkeys([*(path for path in files_of(folder, name) if not known or path.is_file()), *known])
    )


def files_of(folder: Path, name: str) -> list[Path]:
    """Return the files of a name in `folder`: one, all that fit a %d or %g in it, and the pictures of maps."""
    files = [Path(path) for path in _written(os.path.join(folder, name))]
    pictures = [image_of(file) for file in files if file.suffix in SUFFIXES]
    return [*files, *(picture for picture in pictures if picture is not None)]


def _written(path: str) -> list[str]:
    """Return the existing files that fit a path with a number such as %03d; the path itself if it has no number."""
    if not NUMBER.search(path):
        return [path]
    return sorted(glob("*".join(map(escape, NUMBER.split(path)))))


def outside(folder: Path, name: str) -> bool:
    """Return whether a file of this name, which may contain %d or %g, lies outside `folder` after following links."""
    path = os.path.join(folder, name)
    return not all(inside(file, folder) for file in (path, *_written(path)))


def strangers(scenario: Scenario, folder: Path, named: Collection[str] = ()) -> list[str]:
    """Return an error for each input file outside `folder`; files that these name are checked by guard/safe_open.py.

    named: paths of keys that the user gave explicitly; files of these keys, and of keys below them, are allowed.
    """
    return [
        f"{where}: {visible(name, LONGEST_VALUE)} {OUTSIDE}"
        for where, name in input_files(scenario)
        if outside(folder, name) and not given(where, named)
    ]


def given(where: str, named: Collection[str]) -> bool:
    """Return whether the path of a key, such as ``wind.files``, is in `named` or lies below a path in `named`."""
    return any(where == path or where.startswith((f"{path}.", f"{path}[")) for path in named)
