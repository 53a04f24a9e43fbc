"""The files that a scenario names, and which of them lie outside its folder."""

import os
import re
from collections.abc import Collection, Iterator
from glob import escape, glob
from pathlib import Path

from taichi_plume.grid.map_files import SUFFIXES, image_of
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.checks import every
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.vocabulary import InputFile, marked

NUMBER = re.compile(r"%[0-9]*[dg]")  # stands for a number in the name of several files


def input_files(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Every file that is named: the path of its key, such as ``obstacles[0].file``, and its name there.

    A key that takes several names has a path for each, such as ``task.films[0]``.
    """
    for where, section in every(scenario):
        for key in type(section).model_fields:
            named = vars(section)[key] if marked(type(section), key, InputFile) else None
            if isinstance(named, tuple):
                yield from ((f"{where}.{key}[{n}]", name) for n, name in enumerate(named))
            elif named:
                yield f"{where}.{key}", named


def input_paths(scenario: Scenario, file: Path) -> list[Path]:
    """What a scenario reads, and its own `file`; a film is a folder."""
    return [file, *(path for _, name in input_files(scenario) for path in files_of(file.parent, name))]


def files_of(folder: Path, name: str) -> list[Path]:
    """What a name of a scenario in `folder` stands for: a file or a film, or all files with a number in their names.

    The picture of a map is one too.
    """
    files = [Path(path) for path in _written(os.path.join(folder, name))]
    pictures = [image_of(file) for file in files if file.suffix in SUFFIXES]
    return [*files, *(picture for picture in pictures if picture is not None)]


def _written(path: str) -> list[str]:
    """The files that a path stands for, if it stands for several; else itself."""
    if not NUMBER.search(path):
        return [path]
    return sorted(glob("*".join(map(escape, NUMBER.split(path)))))


def outside(folder: Path, name: str) -> bool:
    """Whether a file of that name lies outside `folder`, once links are followed; or one of several, with %d or %g."""
    path = os.path.join(folder, name)
    try:
        home = os.path.realpath(folder)
        return not all(Path(os.path.realpath(one)).is_relative_to(home) for one in (path, *_written(path)))
    except ValueError:  # a zero byte, a lone surrogate: there is no such file
        return False


def strangers(scenario: Scenario, folder: Path, named: Collection[str] = ()) -> list[str]:
    """A line for each file outside of `folder`.

    named: paths of keys that the user gave himself, with all below them; they are not told.
    """
    return [
        f"{where}: {visible(name, LONGEST_VALUE)} lies outside the scenario's folder; "
        "if it is what you want to be read, add --allow-outside (in Python: allow_outside=True)"
        for where, name in input_files(scenario)
        if outside(folder, name)
        and not any(where == one or where.startswith((f"{one}.", f"{one}[")) for one in named)
    ]
