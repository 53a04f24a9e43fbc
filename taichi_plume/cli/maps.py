"""``taichi-plume maps READINGS --map time_series --size 4 3 --out DIR`` makes a gas map of readings, as `maps` does.

The readings go through the mapping methods that robots use online; by default all readings of the log count.
`recorded_maps` has the files in DIR.
"""

import re
import textwrap
from argparse import RawDescriptionHelpFormatter
from collections.abc import Sequence
from typing import Any, get_args

from taichi_plume.api.maps import BAG_KEYS, maps
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add_options, parser_of
from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say
from taichi_plume.results.recorded_maps import FILES
from taichi_plume.scenario.key_facts import purpose
from taichi_plume.scenario.maps import Map

WHOLE_LOG = (
    "The map is of the whole log unless its parameters limit the age of readings, as those of online maps do. "
    "taichi-plume scenario --explain KIND lists the parameters of a kind."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    kinds = {get_args(kind.model_fields["kind"].annotation)[0]: kind for kind in get_args(get_args(Map)[0])}
    lines = [f"  {name:<20}  {purpose(kind)}" for name, kind in kinds.items()]
    lines = [textwrap.fill(line, 100, subsequent_indent=" " * 24) for line in lines]
    end = "\n".join(["kinds of maps:", *lines, "", textwrap.fill(WHOLE_LOG, 100)])
    style: dict[str, Any] = {"formatter_class": RawDescriptionHelpFormatter, "allow_abbrev": False}
    parser = parser_of("maps", maps, leave_out=("bag",), epilog=end, **style)
    add_options(parser.add_argument_group("of bags"), BagOptions, ("lenient",))
    given = vars(parser.parse_args(argv))
    debug = given.pop("debug")
    return exit_code(lambda: _make(given), "interrupted before the map was made", debug, given.get("out"))


def _make(given: dict[str, Any]) -> int:
    """Make the map, write its files, and print what was read and found."""
    bag = {key: given.pop(key) for key in BAG_KEYS if key in given}
    columns = named_columns(given.pop("columns", ()))
    gas_map = maps(bag=bag, columns=columns, **given)
    say(
        f"{given['readings']}: {gas_map.readings.facts.text}",
        *gas_map.readings.topics,
        *gas_map.lines,
        *([f"{given['out']}: {', '.join(FILES)}"] if "out" in given else []),
    )
    return 0


def named_columns(texts: Sequence[str]) -> dict[str, str]:
    """Return the names of columns by key from texts such as "t=stamp [ms],x=px". Raises InputError."""
    known: dict[str, str] = {}
    for text in texts:
        for part in re.split(r",(?=\s*\w+=)", text):
            key, mark, name = part.partition("=")
            if not mark or not key.strip() or not name.strip() or key.strip() in known:
                raise InputError(f"--columns: got '{part}'; give each key once, such as t=stamp,x=px")
            known[key.strip()] = name.strip()
    return known
