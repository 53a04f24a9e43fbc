"""Command line of `maps`: its options, and the help on the kinds of maps."""

import argparse
import difflib
import json
import re
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, get_args

from taichi_plume.cli.options import add, flag, option, whole_number
from taichi_plume.files.bag_readings import BagOptions, Units
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser
from taichi_plume.scenario import si
from taichi_plume.scenario.key_facts import facts, purpose
from taichi_plume.scenario.loading import ScenarioError, load_part
from taichi_plume.scenario.maps import Map
from taichi_plume.scenario.metal_oxides import MOX_MODELS

DEFAULT = "time_series"
KINDS = {get_args(model.model_fields["kind"].annotation)[0]: model for model in get_args(get_args(Map)[0])}


class _Parser(Parser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see --help")


def arguments(argv: Sequence[str]) -> tuple[argparse.Namespace, Map]:
    """Parse the command line of `maps`; return the options and the section of the chosen gas map. Raises InputError."""
    first = _Parser(add_help=False, allow_abbrev=False)
    option(first, "--map", str, "MAP", "", action="append", default=[])
    option(first, "--kind", str, "KIND", "")
    first.add_argument("-h", "--help", action="store_true")
    args, _ = first.parse_known_args(argv)
    if len(args.map) + (args.kind is not None) > 1:
        raise InputError("--map and --kind: there is one map; give one of these options, once")
    short = f"{{kind: {json.dumps(args.kind or DEFAULT)}}}"
    model = load_part(args.map[0], "--map", Map) if args.map else load_part(short, "--kind", Map)
    parser = _options(_parameters(model) if args.map or args.kind else _kinds())
    if args.help:
        parser.print_help()
        sys.exit(0)
    args, unknown = parser.parse_known_args(argv)
    if unknown:
        names = [name for action in parser._actions for name in action.option_strings if name[:2] == "--"]
        close = difflib.get_close_matches(unknown[0].partition("=")[0], names, n=1)
        meant = f"did you mean '{close[0]}'? " if close else ""
        raise InputError(f"unexpected '{unknown[0]}'; {meant}options: {', '.join(names)}")
    return args, model


def _options(end: str) -> _Parser:
    """Return the parser of all options of `maps`. end: last part of the help text."""
    parser = _Parser(
        prog="python -m taichi_plume.maps",
        description="Make a gas map of recorded readings.",
        usage="%(prog)s READINGS [--size LX LY] --out DIR [--map MAP] [options]",
        epilog=end,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    what = "a run or its robots.parquet, a bag of ROS (a folder, .mcap, .db3, .bag), or a CSV with t, x, y, reading"
    parser.add_argument("readings", type=Path, metavar="READINGS", help=what)
    parser.add_argument("--map", help="as in a scenario: '{kind: time_series, alpha: 0.9, cell: 10 cm}'")
    parser.add_argument("--kind", help=f"short for --map '{{kind: KIND}}' (default: {DEFAULT})")
    sides = {"type": _quantity(si.Length), "nargs": 2, "metavar": ("LX", "LY")}
    parser.add_argument("--size", **sides, help="of the floor [m] (default: that of the run)")
    place = {"type": _quantity(si.Coordinate), "nargs": 2, "metavar": ("X", "Y")}
    what = "lower corner of the floor [m], from which the map's own places count (default: 0 0)"
    parser.add_argument("--origin", **place, default=(0.0, 0.0), help=what)
    add(parser, "--out", required=True, help="the map's folder")
    add(parser, "--force", help="rename the folder of an earlier map to OUT.old")
    option(parser, "--trial", whole_number(0, 10**6), "N", "number of the trial (default: the first)")
    option(parser, "--group", str, "NAME", "group, in a bag a robot (default: all robots of the trial)")
    what = "a source [m], to score the peak; may be repeated (default: those of the run)"
    parser.add_argument("--source", **place, action="append", help=what)
    what = "reading in clean air [ppm], above which the map counts (default: that of the run, or 0)"
    option(parser, "--background", _quantity(si.Concentration), "PPM", what)
    of_tables = parser.add_argument_group("of tables")
    what = (
        "columns of the table: t=stamp [ms],x=px,y=py,reading=CO2 [ppb] (default: as the header names them)"
    )
    option(of_tables, "--columns", str, "KEY=NAME,...", what, action="append", default=[])
    what = "number that means no reading, besides NaN, -999 and -9999; may be repeated"
    option(of_tables, "--missing", float, "NUMBER", what, action="append", default=[])
    _of_bags(parser.add_argument_group("of bags"))
    return parser


def _of_bags(group: argparse._ArgumentGroup) -> None:
    for name, what in {
        "--topic": "of gas; repeat it for several robots (default: all of the type)",
        "--pose": "pose of the robot, or a frame, for each --topic (default: that with poses around most readings)",
        "--wind": "of wind, for each --topic (default: its neighbour, if there is any)",
    }.items():
        option(group, name, str, "TOPIC", what, action="append", default=[])
    what = "a number in messages of any type, such as /enose.data[0]; may be repeated"
    option(group, "--reading", str, "FIELD", what, action="append", default=[])
    option(group, "--frame", str, "NAME", "frame of positions (default: map, or else that of the poses)")
    option(group, "--sensor", whole_number(0, 1000), "N", "index in a GasSensorArray, from 0 on")
    what = "of gas, instead of the unit of the messages; plain numbers are ppm by default"
    group.add_argument("--units", choices=get_args(Units), help=what)
    what = "sensor whose law converts ohm to ppm (default: as in the messages)"
    group.add_argument("--model", choices=tuple(MOX_MODELS), help=what)
    what = "resistance in clean air (default: as in the messages)"
    option(group, "--air", _quantity(si.Resistance), "OHM", what)
    flag(group, "--upwind", "Anemometer messages give the direction that the wind comes from")


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


def bag_options(args: argparse.Namespace) -> BagOptions:
    """Return the topics, frames, sensor and units by which a ROS bag is read, from the parsed command line."""
    return BagOptions(
        tuple(args.topic),
        tuple(args.pose),
        tuple(args.wind),
        args.frame,
        args.sensor,
        args.units,
        args.model,
        args.air,
        args.upwind,
        reading=tuple(args.reading),
    )


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


def _quantity(kind: Any) -> Callable[[str], float]:
    """Return an argparse type for quantities of a kind (length, resistance, ...), given with or without a unit."""

    def read(text: str) -> float:
        try:
            return load_part(text, "value", kind)
        except ScenarioError as error:
            raise argparse.ArgumentTypeError(str(error).removeprefix("value: ")) from None

    return read
