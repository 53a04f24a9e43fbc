"""``python -m taichi_plume.scenario --schema`` prints the JSON schema; ``--explain KEY`` tells of a key."""

import json
import os
import shutil
import sys
import textwrap
from collections.abc import Iterator, Sequence

from taichi_plume.guard.terminal import LONGEST_VALUE, Parser, say, visible
from taichi_plume.scenario.facts import first_sentence
from taichi_plume.scenario.keys import Key, Place, look_up, near
from taichi_plume.scenario.meanings import purpose
from taichi_plume.scenario.scenario import Scenario

WIDEST = 100  # columns of a text that is read


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = Parser(prog="python -m taichi_plume.scenario", description="What a scenario may say.")
    asked = parser.add_mutually_exclusive_group(required=True)
    asked.add_argument("--schema", action="store_true", help="print the JSON schema, for editors")
    asked.add_argument(
        "--explain",
        metavar="KEY",
        help="tell of a key, by its path such as wind.openings.speed or its name; of a section such as robots; of a "
        "kind such as casting",
    )
    args = parser.parse_args(argv)
    if args.schema:
        return _print(json.dumps(Scenario.model_json_schema(), indent=2))
    sections, keys = look_up(args.explain)
    if not sections and not keys:
        close = near(args.explain)
        meant = f"did you mean {' or '.join(close)}? " if close else ""
        say(f"no key '{visible(args.explain, LONGEST_VALUE)}'; {meant}--schema prints all", error=True)
        return 2
    wide = min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns)
    kind = args.explain if all(args.explain in one.kinds for one in sections) else ""
    blocks = [_of_section(one, kind, wide) for one in sections] + [_of_key(one, wide) for one in keys]
    return _print("\n\n".join("\n".join(block) for block in blocks))


def _print(text: str) -> int:
    try:
        say(text, longest=None, flush=True)
    except BrokenPipeError:  # a reader such as `head` may leave early; Python flushes again at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _of_key(key: Key, wide: int) -> Iterator[str]:
    """All that is told of a key."""
    yield key.path + (f"   (kind: {', '.join(key.kinds)})" if key.kinds else "")
    yield from _filled(key.facts.meaning, wide, 2)
    yield from _filled(key.facts.figures, wide, 2)
    if "quantit" in key.facts.type:
        yield f"  (a quantity is a number in {key.facts.unit or 'SI units'}, or a text with another unit)"


def _of_section(place: Place, kind: str, wide: int) -> Iterator[str]:
    """What a section is, and what its keys are in a sentence each; kind: of these only."""
    yield place.path + (f"   (in a section of kind {', '.join(place.within)})" if place.within else "")
    models = [model for name, model in place.kinds.items() if kind in ("", name)]
    for model in models or list(place.models):
        its = next((name for name, one in place.kinds.items() if one is model), "")
        yield from _filled((f"kind: {its} - " if its else "") + purpose(model), wide, 2)
    for key in place.keys:
        if not kind or not key.kinds or kind in key.kinds:
            of = f" ({', '.join(key.kinds)})" if key.kinds and not kind else ""
            yield from _filled(f"{key.name}{of}: {first_sentence(key.facts.meaning)}", wide, 4)


def _filled(text: str, wide: int, indent: int) -> list[str]:
    return textwrap.wrap(text, wide, initial_indent=" " * indent, subsequent_indent=" " * (indent + 2))


if __name__ == "__main__":
    sys.exit(main())
