"""``python -m taichi_plume.scenario --schema`` prints the JSON schema of scenarios, for editors."""

import json
import signal
import sys
from collections.abc import Sequence

from taichi_plume.guard.terminal import Parser, say
from taichi_plume.scenario.scenario import Scenario


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = Parser(prog="python -m taichi_plume.scenario", description="Tell the vocabulary of scenarios.")
    parser.add_argument(
        "--schema", action="store_true", required=True, help="print the JSON schema, for editors"
    )
    parser.parse_args(argv)
    if hasattr(signal, "SIGPIPE"):  # Windows has none
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # a reader such as `head` may leave early
    say(json.dumps(Scenario.model_json_schema(), indent=2), longest=None)
    return 0


if __name__ == "__main__":
    sys.exit(main())
