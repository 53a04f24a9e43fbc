"""``taichi-plume scenario --schema`` prints the JSON schema of scenarios; ``--explain KEY`` explains a key."""

from collections.abc import Sequence
from typing import Annotated

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of
from taichi_plume.scenario.keys import print_key, print_schema
from taichi_plume.scenario.scenario import Scenario


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = parser_of("scenario", scenario)
    given = vars(parser.parse_args(argv))
    debug = given.pop("debug")
    if len(given) != 1:
        parser.error("give one of --schema, --explain KEY")
    return exit_code(lambda: scenario(**given), debug=debug)


def scenario(*, schema: bool = False, explain: Annotated[str | None, "KEY"] = None) -> int:
    """Print the keys of a scenario.

    schema: print the JSON schema, for editors. explain: explain a key (its name, or its path such as
    wind.openings.speed), a section or a kind such as casting.
    """
    return print_key(explain, Scenario) if explain is not None else print_schema(Scenario)
