"""The command line of `maps`: its options, and what it tells of the kinds of maps."""

import argparse
import difflib
import json
import sys
import textwrap
from collections.abc import Sequence
from math import inf, isfinite
from pathlib import Path
from typing import NoReturn, get_args

from pydantic_core import PydanticCustomError

from taichi_plume.cli.options import add as shared
from taichi_plume.cli.options import whole_number
from taichi_plume.files.bag_readings import UNITS, BagOptions
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser
from taichi_plume.scenario.facts import facts, purpose
from taichi_plume.scenario.loading import load_part
from taichi_plume.scenario.maps import Map
from taichi_plume.scenario.metal_oxides import MOX_MODELS
from taichi_plume.scenario.quantities import parse

LARGEST_FLOOR = 1e4  # m
DEFAULT = "time_series"
KINDS = {get_args(one.model_fields["kind"].annotation)[0]: one for one in get_args(get_args(Map)[0])}


class _Parser(Parser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; --help tells more")


def arguments(argv: Sequence[str]) -> tuple[argparse.Namespace, Map]:
    """Options and the model of the map. Raises InputError."""
    told = _Parser(add_help=False, allow_abbrev=False)
    told.add_argument("--map", metavar="MAP", action="append", default=[])
    told.add_argument("--kind", metavar="KIND")
    told.add_argument("-h", "--help", action="store_true")
    args, _ = told.parse_known_args(argv)
    if len(args.map) + (args.kind is not None) > 1:
        raise InputError("--map and --kind: tell of one map; give one of them, once")
    where, text = (
        ("--map", args.map[0]) if args.map else ("--kind", f"{{kind: {json.dumps(args.kind or DEFAULT)}}}")
    )
    model = load_part(text, where, Map)
    parser = _options(_kinds() if not (args.map or args.kind) else _parameters(model))
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
    """All of them; end: of the help."""
    parser = _Parser(
        prog="python -m taichi_plume.maps",
        description="Make a gas map of recorded readings.",
        usage="%(prog)s READINGS --size LX LY --out DIR [--map MAP] [options]",
        epilog=end,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add(
        "readings",
        type=Path,
        metavar="READINGS",
        help="robots.parquet of a run, a bag of ROS (a folder, .mcap, .db3, .bag), or a CSV with t, x, y, reading",
    )
    add("--map", help="as in a scenario, such as '{kind: time_series, alpha: 0.9, cell: 10 cm}'")
    add("--kind", help=f"short for --map '{{kind: KIND}}' (default: {DEFAULT})")
    add("--size", type=_side, nargs=2, required=True, metavar=("LX", "LY"), help="of the floor [m]")
    add("--origin", type=_length, nargs=2, default=(0.0, 0.0), metavar=("X", "Y"),
        help="lower corner of the floor [m], from which the map's own places count (default: 0 0)")  # fmt: skip
    shared(parser, "--out", required=True, help="where the map goes")
    shared(parser, "--force", help="replace an earlier map in --out")
    add("--trial", type=whole_number(0, 10**6), metavar="N", help="of several (default: the first)")
    add("--group", metavar="NAME", help="of several, in a bag a robot (default: all robots of the trial)")
    add("--source", type=_length, nargs=2, action="append", metavar=("X", "Y"),
        help="a source [m], to score the peak; may be repeated")  # fmt: skip
    _of_bags(parser.add_argument_group("of bags"))
    return parser


def _of_bags(group: argparse._ArgumentGroup) -> None:
    add, topic = group.add_argument, {"metavar": "TOPIC", "action": "append", "default": []}
    add("--topic", **topic, help="of gas; repeat it for several robots (default: all of the type)")
    add("--pose", **topic, help="where the robot is, for each --topic (default: by frames, or its neighbour)")
    add("--wind", **topic, help="of wind, for each --topic (default: its neighbour, if there is any)")
    add("--frame", default="map", metavar="NAME", help="that the map is in (default: map)")
    add("--sensor", type=whole_number(0, 1000), metavar="N", help="which of a GasSensorArray, from 0 on")
    add(
        "--units",
        choices=tuple(UNITS),
        help="of gas, whatever messages tell; plain numbers are ppm by default",
    )
    add(
        "--model",
        choices=tuple(MOX_MODELS),
        help="whose law makes ppm of ohm (default: as the messages tell)",
    )
    add("--air", type=_ohm, metavar="OHM", help="resistance in clean air (default: as the messages tell)")
    add("--upwind", action="store_true", help="Anemometer messages tell where the wind comes from")


def wanted(args: argparse.Namespace) -> BagOptions:
    """What of a bag is read."""
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
    )


def _kinds() -> str:
    """The kinds of maps, each with what it is."""
    lines = [_item(kind, purpose(model)) for kind, model in KINDS.items()]
    whole = "unless its parameters say for how long readings count, as those of online maps do."
    return "\n".join(
        ["kinds of maps; --kind KIND --help tells the parameters of one:", *lines, "", _whole_log(whole)]
    )


def _parameters(model: Map) -> str:
    """The parameters of a kind of map, each with its meaning and default."""
    lines = [f"parameters of a {model.kind} map, --map '{{kind: {model.kind}, NAME: VALUE, ...}}':"]
    for name, field in type(model).model_fields.items():
        if name != "kind":
            default = "" if field.default is None else f" (default: {json.dumps(field.default)})"
            if name in model.times:
                default = " (default: such that nothing of the log is forgotten)"
            its = facts(type(model), name)
            unit = f" [{its.unit}]" if its.unit else ""
            lines.append(_item(name, its.meaning + unit + default))
    if model.times:
        how = " ".join((model.of_log.__doc__ or "").split())
        lines += ["", _whole_log(f"unless {' or '.join(model.times)} is given. {how}")]
    return "\n".join(lines)


def _whole_log(text: str) -> str:
    return textwrap.fill(f"The map is of the whole log {text}", 100)


def _item(name: str, text: str) -> str:
    return textwrap.fill(f"{name:<20}  {text}", 100, initial_indent="  ", subsequent_indent=" " * 24)


def _length(text: str) -> float:
    """A length of the command line [m], with or without a unit."""
    try:
        value = parse(text, "m")
    except PydanticCustomError as error:
        raise argparse.ArgumentTypeError(f"got '{text}': {error.message()}") from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"got '{text}': must be a finite number")
    return value


def _ohm(text: str) -> float:
    """A resistance of the command line [ohm], with or without a unit."""
    try:
        value = parse(text, "ohm")
    except PydanticCustomError as error:
        raise argparse.ArgumentTypeError(f"got '{text}': {error.message()}") from None
    if not 0.0 < value < inf:
        raise argparse.ArgumentTypeError(f"got '{text}': must be a finite number above 0")
    return value


def _side(text: str) -> float:
    value = _length(text)
    if not 0.0 < value <= LARGEST_FLOOR:
        raise argparse.ArgumentTypeError(f"got '{text}': must be above 0 and at most {LARGEST_FLOOR:g} m")
    return value
