"""``python -m taichi_plume.scenario --schema`` prints the JSON schema; ``--explain KEY`` explains a key."""

from collections.abc import Sequence

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.guard.terminal import Parser
from taichi_plume.scenario.keys import print_key, print_schema
from taichi_plume.scenario.scenario import Scenario


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = Parser(prog="python -m taichi_plume.scenario", description="The keys of a scenario.")
    asked = parser.add_mutually_exclusive_group(required=True)
    asked.add_argument("--schema", action="store_true", help="print the JSON schema, for editors")
    meaning = "explain a key (its name, or its path such as wind.openings.speed), a section or a kind such as casting"
    asked.add_argument("--explain", metavar="KEY", help=meaning)
    args = parser.parse_args(argv)
    return exit_code(lambda: print_schema(Scenario) if args.schema else print_key(args.explain, Scenario))
