"""``python -m taichi_plume.maps READINGS --kind time_series --size 4 3 --out DIR`` makes a gas map of readings.

READINGS is a run, the robots.parquet of a run, a bag of ROS or a CSV file (see `readings`). The map is given as in a
scenario, such as ``--map '{kind: time_series, alpha: 0.9, cell: 10 cm}'``; ``--kind gmrf --help`` lists the parameters
of a kind. The readings go through the mapping methods that robots use online; by default all readings of the log count.
`recorded_maps` has the files in DIR. ``taichi_plume.maps(...)`` is the same from Python.
"""

import argparse
import sys
from collections.abc import Sequence

from taichi_plume.api.maps import maps
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.map_options import arguments, bag_options, named_columns
from taichi_plume.guard.terminal import say
from taichi_plume.results.recorded_maps import FILES
from taichi_plume.scenario.maps import Map


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""

    def parse_and_make() -> int:
        args, model = arguments(sys.argv[1:] if argv is None else argv)
        return exit_code(lambda: _make(args, model), "interrupted before the map was made", out=args.out)

    return exit_code(parse_and_make)


def _make(args: argparse.Namespace, model: Map) -> int:
    gas_map = maps(
        args.readings, model, size=args.size, origin=args.origin, trial=args.trial, group=args.group,
        sources=args.source, bag=bag_options(args), columns=named_columns(args.columns), missing=args.missing,
        background=args.background, out=args.out, force=args.force,
    )  # fmt: skip
    say(
        f"{args.readings}: {gas_map.readings.facts.text}",
        *gas_map.readings.topics,
        *gas_map.lines,
        f"{args.out}: {', '.join(FILES)}",
    )
    return 0
