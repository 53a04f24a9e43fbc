"""``taichi-plume maps READINGS --kind time_series --size 4 3 --out DIR`` makes a gas map of readings, as `maps` does.

The map is given as in a scenario, such as ``--map '{kind: time_series, alpha: 0.9, cell: 10 cm}'``; ``--kind gmrf
--help`` lists the parameters of a kind. The readings go through the mapping methods that robots use online; by default
all readings of the log count. `recorded_maps` has the files in DIR.
"""

import json
import re
import sys
import textwrap
from argparse import SUPPRESS, RawDescriptionHelpFormatter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, get_args

from taichi_plume.api.maps import BAG_KEYS, maps
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add_options, parser_of
from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser, say
from taichi_plume.results.recorded_maps import FILES
from taichi_plume.scenario.key_facts import facts, purpose
from taichi_plume.scenario.loading import load_part
from taichi_plume.scenario.maps import Map

DEFAULT = "time_series"
KINDS = {get_args(model.model_fields["kind"].annotation)[0]: model for model in get_args(get_args(Map)[0])}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)

    def parse_and_make() -> int:
        model, is_chosen = _map_of(arguments)
        end = _parameters(model) if is_chosen else _kinds()
        style: dict[str, Any] = {"formatter_class": RawDescriptionHelpFormatter, "allow_abbrev": False}
        parser = parser_of("maps", _command, maps, leave_out=("bag",), epilog=end, **style)
        add_options(parser.add_argument_group("of bags"), BagOptions, ("lenient",))
        given = vars(parser.parse_args(arguments))
        debug = given.pop("debug")
        interrupted = "interrupted before the map was made"
        return exit_code(lambda: _make(model, given), interrupted, debug, given["out"])

    return exit_code(parse_and_make)


def _command(
    *,
    map: Annotated[str, "MAP"] = DEFAULT,
    kind: Annotated[str, "KIND"] = DEFAULT,
    out: Annotated[Path, "--out DIR"],
) -> None:
    """Make a gas map of recorded readings.

    map: as in a scenario: '{kind: time_series, alpha: 0.9, cell: 10 cm}'. kind: short for --map '{kind: KIND}'. out:
    the map's folder.
    """


def _map_of(arguments: Sequence[str]) -> tuple[Map, bool]:
    """Return the gas map of a command line, and whether the user has chosen it. Raises InputError."""
    first = Parser(prog="taichi-plume maps", add_help=False, allow_abbrev=False, argument_default=SUPPRESS)
    first.add_argument("--map", action="append", default=[])
    first.add_argument("--kind", action="append", default=[])
    args, _ = first.parse_known_args(arguments)
    if len(args.map) + len(args.kind) > 1:
        raise InputError("--map and --kind: there is one map; give one of these options, once")
    if args.map:
        return load_part(args.map[0], "--map", Map), True
    short = f"{{kind: {json.dumps((args.kind or [DEFAULT])[0])}}}"
    return load_part(short, "--kind", Map), bool(args.kind)


def _make(model: Map, given: dict[str, Any]) -> int:
    """Make the map, write its files, and print what was read and found."""
    bag = {key: given.pop(key) for key in BAG_KEYS if key in given}
    options = {key: value for key, value in given.items() if key not in ("map", "kind", "columns")}
    gas_map = maps(map=model, bag=bag, columns=named_columns(given.get("columns", ())), **options)
    say(
        f"{given['readings']}: {gas_map.readings.facts.text}",
        *gas_map.readings.topics,
        *gas_map.lines,
        f"{given['out']}: {', '.join(FILES)}",
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


def _kinds() -> str:
    """Return the help text on all kinds of gas maps."""
    lines = [_item(kind, purpose(model)) for kind, model in KINDS.items()]
    whole = _whole_log("unless its parameters limit the age of readings, as those of online maps do.")
    return "\n".join(["kinds of maps; --kind KIND --help lists the parameters of one:", *lines, "", whole])


def _parameters(model: Map) -> str:
    """Return the help text on the parameters of the gas map's kind."""
    lines = [f"parameters of a {model.kind} map, --map '{{kind: {model.kind}, NAME: VALUE, ...}}':"]
    for name, field in type(model).model_fields.items():
        if name not in ("kind", "robot"):
            default = "" if field.default is None else f" (default: {json.dumps(field.default)})"
            if name in model.times:
                default = " (default: such that nothing of the log is forgotten)"
            key = facts(type(model), name)
            unit = f" [{key.unit}]" if key.unit else ""
            lines.append(_item(name, key.meaning + unit + default))
    if model.times:
        how = " ".join((model.of_log.__doc__ or "").split())
        lines += ["", _whole_log(f"unless {' or '.join(model.times)} is given. {how}")]
    return "\n".join(lines)


def _whole_log(text: str) -> str:
    return textwrap.fill(f"The map is of the whole log {text}", 100)


def _item(name: str, text: str) -> str:
    return textwrap.fill(f"{name:<20}  {text}", 100, initial_indent="  ", subsequent_indent=" " * 24)
