"""``python -m taichi_plume.statistics RUN|FILM`` computes statistics of a plume: mean, rms, intermittency, whiffs.

``taichi_plume.statistics(...)`` is the same from Python.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, flag, number, option, positive
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser, say


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    return exit_code(lambda: _analyse(args), out=args.out or args.source)


def _analyse(args: argparse.Namespace) -> int:
    from taichi_plume.api.statistics import statistics

    plume = statistics(
        args.source, gas=args.gas, probe=args.probe, threshold=args.threshold, start=args.start, bounds=args.range,
        sensors=args.sensor,
    )  # fmt: skip
    out = args.out or _folder(args.source)
    if args.out is None and out.is_symlink():
        raise InputError(f"{out}: is a link, to which nothing is written; choose --out")
    paths = plume.write(out, page=not args.no_page)
    say(*(f"{subject}: {words}" for subject, words in plume.rows))
    say(f"{paths[-1]}: {paths[-1].stat().st_size / 1e3:,.0f} kB")
    return 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.statistics",
        description="Statistics of a plume's fluctuations, from a run's probes or from a film: mean and rms, "
        "intermittency, whiffs and blanks, spectra, lengths, and which whiffs gas sensors keep.",
    )
    source = "the folder of a run with probes or fields, or a film"
    parser.add_argument("source", type=Path, metavar="RUN|FILM", help=source)
    option(parser, "--gas", str, "NAME", "species (default: the first)")
    option(parser, "--probe", str, "NAME", "only this probe")
    threshold = "more than this is gas (default: a tenth of the mean at the point with the most gas)"
    option(parser, "--threshold", positive, "PPM", threshold)
    option(parser, "--from", number, "T", "leave out samples before this simulated time [s]", dest="start")
    durations = "durations [s] between which the power law is fitted (default: chosen from the data)"
    parser.add_argument("--range", type=positive, nargs=2, metavar=("A", "B"), help=durations)
    sensor = "another gas sensor, such as '{kind: pid, rise_time: 20 ms, decay_time: 20 ms, period: 10 ms}'"
    option(parser, "--sensor", str, "YAML", sensor, action="append", default=[])
    add(parser, "--out", help="(default: RUN/statistics, or FILM with -statistics instead of .zarr)")
    flag(parser, "--no-page", "write no statistics.html")
    return parser.parse_args(argv)


def _folder(source: Path) -> Path:
    if (source / "zarr.json").exists():
        source = source if source.name else source.resolve()  # "." has no name
        return source.with_name(f"{source.stem}-statistics")
    return source / "statistics"
