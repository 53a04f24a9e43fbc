"""Options of a command, from the signature and the docstring of its call: `simulate`, `study`, `maps` ...

A parameter of the call is an argument of the command, a parameter by keyword an option: ``--allow-code`` for
`allow_code`, ``--no-report`` for a `report` that is True by default. The help is the text after ``report:`` in the
docstring, up to the next parameter or the end of the paragraph; ``--no-report`` puts "do not" before the text.

``Annotated[int, "N"]`` names the value in the help, ``Annotated[float, "--from T"]`` also the option; "--size LX LY"
takes two values, and an option with "..." may be repeated. "[K/N]" may be left out, which passes True. Texts become
int, Path or a word of a Literal. Other types, and types in quotes, reach the call as texts, unless a third entry of
Annotated is a function that reads them. The call checks them, and the limits of numbers. What the user leaves out is
not passed to the call.
"""

import inspect
import re
from argparse import SUPPRESS, Action, ArgumentParser, ArgumentTypeError, Namespace, _ActionsContainer
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.engine.choice import ENGINES, VARIABLE, EngineChoiceError, choose
from taichi_plume.guard.terminal import Parser, say

Call = Callable[..., Any]


class EngineOption(Action):
    """Option that chooses the engine as soon as it is read, since imports of the engine follow the choice."""

    def __call__(self, parser: ArgumentParser, namespace: Namespace, name: Any, *_: Any) -> None:
        try:
            choose(name)
        except EngineChoiceError as error:
            parser.error(str(error))


def parser_of(name: str, *calls: Call, leave_out: Collection[str] = (), **keywords: Any) -> Parser:
    """Return the parser of command `name` with the options of calls; the first call describes the command.

    leave_out: parameters that are no options. A call with `arch` has ``--engine``, one with `progress` ``--quiet``.
    """
    keywords = {"description": meanings(calls[0])[""], "argument_default": SUPPRESS} | keywords
    parser = Parser(prog=f"taichi-plume {name}", **keywords)
    names: set[str] = set()
    for call in calls:
        add_options(parser, call, {"progress", *leave_out} | names)
        names |= inspect.signature(call).parameters.keys()
    if "arch" in names:
        what = f"library that compiles kernels (default: {VARIABLE} of the environment, or taichi)"
        parser.add_argument("--engine", action=EngineOption, choices=tuple(ENGINES), help=what)
    if "progress" in names:
        quiet = "print errors only"
        parser.add_argument("--quiet", dest="progress", action="store_false", help=quiet)
    where = "show where an unexpected error came from"
    parser.add_argument("--debug", action="store_true", default=False, help=where)
    return parser


def add_options(parser: _ActionsContainer, call: Call, leave_out: Collection[str] = ()) -> None:
    """Add the parameters of a call to a parser, except those in `leave_out`."""
    helps = meanings(call)
    for name, parameter in inspect.signature(call).parameters.items():
        if name not in leave_out and parameter.kind is not parameter.VAR_KEYWORD:
            kind, usage, *types = _annotations(parameter)
            option, *values = usage.split() if usage.startswith("-") else ("", *usage.split())
            if parameter.kind is parameter.KEYWORD_ONLY and not option:
                option = f"--{name.replace('_', '-')}"
            keywords: dict[str, Any] = _value(kind, name, values, parameter.default, *types)
            keywords["help"] = helps.get(name, "")
            if keywords.get("action") == "store_false":
                option = option.replace("--", "--no-", 1)
                keywords["help"] = f"do not {keywords['help']}"
            elif not {"action", "const"} & keywords.keys() and isinstance(
                parameter.default, int | float | str
            ):
                keywords["help"] += f" (default: {parameter.default})"
            keywords["help"] = keywords["help"].replace("%", "%%")
            if option:
                keywords |= {"dest": name, "required": parameter.default is parameter.empty}
                parser.add_argument(option, **keywords)
            else:
                if parameter.default is not parameter.empty:
                    keywords["nargs"] = "*" if keywords.pop("action", None) else "?"
                    if (
                        keywords["nargs"] == "?"
                    ):  # argparse would read SUPPRESS as a value of the option's type
                        keywords["default"] = parameter.default
                parser.add_argument(name, **keywords)


def _annotations(parameter: inspect.Parameter) -> tuple[Any, ...]:
    """Return the type of a parameter, its option and values in the help, and the function that reads texts, if any."""
    kind = parameter.annotation
    return get_args(kind) if get_origin(kind) is Annotated else (kind, "")


def _value(
    kind: Any, name: str, values: list[str], default: object, read: Call | None = None
) -> dict[str, Any]:
    """Return the keywords of `add_argument` for the values of an option. values: their names in the help."""
    kinds = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    if bool in kinds and not values:
        return {"action": "store_false" if default is True else "store_true"}
    keywords: dict[str, Any] = {}
    if values[-1:] == ["..."]:
        values.pop()
        keywords["action"] = "append"
    words = [word for part in kinds if get_origin(part) is Literal for word in get_args(part)]
    if words:
        return keywords | {"choices": words}
    if len(values) > 1:
        keywords["nargs"] = len(values)
    elif values and values[0].startswith("["):
        keywords |= {"nargs": "?", "const": True}
        values = [values[0].strip("[]")]
    keywords["metavar"] = tuple(values) if len(values) > 1 else (values or [name.upper()])[0]
    return keywords | {"type": read or next((known for known in (int, Path) if known in kinds), str)}


def meanings(call: Call) -> dict[str, str]:
    """Return the text of each parameter in the docstring of a call, and under "" the first sentence."""
    doc = inspect.cleandoc(call.__doc__ or "")
    some = "|".join(inspect.signature(call).parameters)
    heads = rf"(?:^|(?<=[.;:]\s))((?:(?:{some}), )*(?:{some})):\s"
    texts = {"": re.split(r"(?<=\.)\s", doc)[0]}
    for paragraph in doc.split("\n\n"):
        _, *parts = re.split(heads, " ".join(paragraph.split()))
        for names, text in zip(parts[::2], parts[1::2], strict=True):
            text = re.sub(
                rf"`({some})`", lambda name: f"--{name[1]}", text.strip().rstrip(";").removesuffix(".")
            )
            text = text.replace("`", "")
            texts |= dict.fromkeys(names.split(", "), text)
    return texts


def port_number(text: str) -> int:
    """Return the number of a port in a text. Raises ArgumentTypeError."""
    if not (text.isascii() and text.isdigit() and int(text[:6]) <= 65535):
        raise ArgumentTypeError(f"takes a whole number from 0 to 65535, not {text}")
    return int(text)


def command(name: str, call: Call, argv: Sequence[str]) -> int:
    """Parse the command line `argv`, call `call`, print the files that the call has written; return the exit code."""
    given = vars(parser_of(name, call).parse_args(argv))
    debug, out = given.pop("debug"), given.get("out", given.get("run"))

    def work() -> int:
        result = call(**given)
        if isinstance(result, bool):
            return int(not result)
        if isinstance(result, dict):
            say(*(f"{file}: {text}" for file, text in result.items()))
        else:
            for file in result if isinstance(result, list) else [result]:
                size = sum(part.stat().st_size for part in (file, *file.rglob("*")) if part.is_file())
                say(f"{file}: {size / 1e3:,.0f} kB")
        return 0

    return exit_code(work, "interrupted", debug, out)
