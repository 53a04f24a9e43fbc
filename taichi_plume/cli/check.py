"""Output of ``--check``: keys of the file, derived quantities, unlikely settings, the size, and the scene.

The output is one YAML document that can be run: everything besides the keys is a comment.
"""

import shutil
import sys
import textwrap
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import yaml

from taichi_plume.assembly.preparation import Prepared
from taichi_plume.files.disk import written_whole
from taichi_plume.files.run_folder import CHECK
from taichi_plume.guard.safe_open import open_regular
from taichi_plume.guard.terminal import say
from taichi_plume.scenario.key_facts import facts
from taichi_plume.scenario.readable_yaml import all_keys, own_keys
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.size import amounts, derived, estimate
from taichi_plume.scenario.vocabulary import Model

COLUMN = 34  # of explanations, unless the line is longer
WIDTH = 120  # columns where the output is no terminal
NARROWEST = 60
NAMES = 9  # columns of the names of derived quantities
PNG = b"\x89PNG\r\n\x1a\n"


def print_check(prepared: Prepared, out: Path | None = None, whole: bool = False) -> None:
    """Print a scenario's keys, derived quantities, unlikely settings and expected size; draw the scene as a PNG.

    out: the run's folder, for the PNG; whole: print all keys with defaults and meanings, instead of the user's keys.
    """
    scenario = prepared.scenario
    wide = shutil.get_terminal_size((WIDTH, 24)).columns if sys.stdout.isatty() else WIDTH
    text = explained(scenario, max(wide, NARROWEST)) + "\n" if whole else own_keys(scenario)
    say(*text.split("\n"), longest=None)
    for name, line in derived(scenario):
        say(f"# {name:<{NAMES}} {line}")
    for where, known in prepared.resources.facts.items():
        say(f"# {'read':<{NAMES}} {where}: {known.text}")
    for n, warning in enumerate(prepared.resources.warnings, 1):
        say(f"# unlikely {n}: {warning}")
    say(f"# {'size':<{NAMES}} {amounts(estimate(scenario))}")
    path = out / CHECK if out is not None else Path("runs") / f"{scenario.name}-{CHECK}"
    fault = draw_scene(prepared, path)
    drawn = path if fault is None else f"not drawn, {path}: {fault}"
    say(f"# {'scene':<{NAMES}} {drawn}")
    every = "" if whole else "all keys and defaults: --all; "
    say(f"# {'more':<{NAMES}} {every}one key: python -m taichi_plume.scenario --explain KEY", flush=True)
    if fault is not None:
        say(f"note: {path}: {fault}", error=True)


def explained(scenario: Scenario, wide: int = WIDTH) -> str:
    """Return the resolved scenario as YAML, each key explained at its first occurrence.

    Lines have at most `wide` characters, unless a value is longer.
    """
    text = all_keys(scenario)
    keys = {line: (name, brief, lines) for line, name, brief, lines in _keys(_tree(text), scenario)}
    known = {("", "")}
    rows: list[str] = []
    for number, line in enumerate(text.splitlines()):
        name, brief, lines = keys.get(number, ("", "", 1))
        if name and line == f"{name}:":
            rows.append("")  # before each part of the scenario
        beside = f"{line:<{COLUMN}}  # {brief}"
        if not brief or (name, brief) in known:
            rows.append(line)
        elif lines == 1 and len(beside) <= wide:
            rows.append(beside)
        else:
            start = " " * (len(line) - len(line.lstrip())) + "# "
            rows += textwrap.wrap(
                brief, wide, initial_indent=start, subsequent_indent=start, break_on_hyphens=False
            )
            rows.append(line)
        known.add((name, brief))
    return "\n".join(rows)


def _tree(text: str) -> yaml.Node:
    node = yaml.compose(text, yaml.SafeLoader)
    assert node is not None
    return node


def _keys(node: yaml.Node, part: object) -> Iterator[tuple[int, str, str, int]]:
    """Yield (line, name, explanation, number of lines) of each key below a YAML node; part: its scenario section."""
    if isinstance(part, tuple):
        for child, item in zip(node.value, part, strict=True):
            if isinstance(item, Model):
                yield from _keys(child, item)
    elif isinstance(part, Model):
        for key, value in node.value:
            line = key.start_mark.line
            inside = isinstance(value, yaml.CollectionNode) and value.flow_style is False
            lines = 1 if inside else value.end_mark.line - line + 1
            yield line, key.value, facts(type(part), key.value).brief, lines
            yield from _keys(value, vars(part)[key.value])


def draw_scene(prepared: Prepared, path: Path) -> str | None:
    """Draw the scene into a PNG file and return None, or the reason of a failure. A file that is no PNG is kept."""
    try:
        if path.exists() and not _is_png(path):
            return "is no picture, and stays as it is"
        path.parent.mkdir(parents=True, exist_ok=True)
        from taichi_plume.report.scene import save_check  # importing matplotlib takes a second

        with written_whole(path) as fresh:
            save_check(prepared, fresh)
    except OSError as error:
        return f"cannot be written: {error.strerror or error}"
    except ImportError as error:  # a check does not fail because of the picture
        return f"cannot be drawn: {error}"
    return None


def _is_png(path: Path) -> bool:
    with suppress(OSError), open_regular(path) as file:
        return file.read(len(PNG)) == PNG
    return False
