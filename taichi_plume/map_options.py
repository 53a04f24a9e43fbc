"""The command line of `maps`: its options, and those that the model of a map has."""

import argparse
import difflib
from collections.abc import Iterable, Sequence
from math import isfinite
from pathlib import Path
from typing import NoReturn, get_args

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from taichi_plume.files.readings import ReadingsError
from taichi_plume.scenario.loading import explain
from taichi_plume.scenario.maps import Map
from taichi_plume.scenario.quantities import parse

LARGEST_FLOOR = 1e4  # m


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ReadingsError(f"{message}; --help tells more")


def arguments(argv: Sequence[str]) -> tuple[argparse.Namespace, Map]:
    """Options and the model of the map, whose parameters are options as well. Raises ReadingsError."""
    kinds = {get_args(one.model_fields["kind"].annotation)[0]: one for one in get_args(get_args(Map)[0])}
    first = _Parser(add_help=False, allow_abbrev=False)
    first.add_argument("--kind", default="time_series")
    kind = first.parse_known_args(argv)[0].kind
    if kind not in kinds:
        raise ReadingsError(
            f"--kind: unknown kind '{kind}'; {_meant(kind, kinds)}known kinds: {', '.join(kinds)}"
        )
    parser = _Parser(
        prog="python -m taichi_plume.maps",
        description="Make a gas map of recorded readings.",
        usage="%(prog)s READINGS --size LX LY --out DIR [--kind KIND] [options]",
        allow_abbrev=False,
    )
    add = parser.add_argument
    add(
        "readings",
        type=Path,
        metavar="READINGS",
        help="robots.parquet of a run, or a CSV with t, x, y, reading",
    )
    add("--kind", help=f"of the map: {', '.join(kinds)} (default: time_series)")
    add("--size", type=_side, nargs=2, required=True, metavar=("LX", "LY"), help="of the floor [m]")
    add("--out", type=Path, required=True, metavar="DIR", help="where the map goes")
    add("--force", action="store_true", help="overwrite an earlier map in --out")
    add("--trial", type=int, metavar="N", help="of several (default: the first)")
    add("--group", metavar="NAME", help="of several (default: all robots of the trial)")
    add("--source", type=_length, nargs=2, action="append", metavar=("X", "Y"),
        help="a source [m], to score the peak; may be repeated")  # fmt: skip
    parameters = parser.add_argument_group(f"parameters of a {kind} map")
    fields = {name: field for name, field in kinds[kind].model_fields.items() if name != "kind"}
    for name, field in fields.items():
        text = " ".join((field.description or "").split()).replace("%", "%%")
        default = "" if field.default is None else f" (default: {field.default})"
        option = "--" + name.replace("_", "-")
        if field.annotation is bool:
            parameters.add_argument(
                option, dest=f"map_{name}", action=argparse.BooleanOptionalAction, help=text
            )
        else:
            parameters.add_argument(option, dest=f"map_{name}", metavar="VALUE", help=text + default)
    args, unknown = parser.parse_known_args(argv)
    if unknown:
        names = [name for action in parser._actions for name in action.option_strings if name[:2] == "--"]
        raise ReadingsError(
            f"unexpected '{unknown[0]}'; {_meant(unknown[0], names)}options: {', '.join(names)}"
        )
    given = {name: getattr(args, f"map_{name}") for name in fields}
    data = {"kind": kind} | {name: value for name, value in given.items() if value is not None}
    data |= {name: None for name, value in data.items() if value == "null"}
    try:
        return args, kinds[kind].model_validate(data)
    except ValidationError as error:
        raise ReadingsError("; ".join(explain(error, data))) from None


def _meant(got: str, names: Iterable[str]) -> str:
    close = difflib.get_close_matches(got.partition("=")[0], list(names), n=1)
    return f"did you mean '{close[0]}'? " if close else ""


def _length(text: str) -> float:
    """A length of the command line [m], with or without a unit."""
    try:
        value = parse(text, "m")
    except PydanticCustomError as error:
        raise argparse.ArgumentTypeError(f"got '{text}': {error.message()}") from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"got '{text}': must be a finite number")
    return value


def _side(text: str) -> float:
    value = _length(text)
    if not 0.0 < value <= LARGEST_FLOOR:
        raise argparse.ArgumentTypeError(f"got '{text}': must be above 0 and at most {LARGEST_FLOOR:g} m")
    return value
