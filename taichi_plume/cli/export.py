"""``python -m taichi_plume.export RUN --to FORMAT`` writes a run's data for other programs; see results/export.py.

Exit code 0: done; 1: the data could not be written; 2: there is no such run, or it has no such data; 130: interrupted.
"""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import OTHER_MAPS, add, from_zero, option, positive, whole_number
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser, say

if TYPE_CHECKING:
    from taichi_plume.results.run import Run

DEFAULT = {
    "vtkhdf": "fields.vtkhdf", "netcdf": "fields.nc", "csv": "", "mcap": "bag", "gaden": "gaden",
    "plumesim": "network.pslog", "pictures": "pictures.zarr",
}  # fmt: skip
"""Formats, and the names of their files in the run's folder."""
SOURCES = {"film": "netcdf", "recording": "netcdf", "probes": "plumesim", "robots": "plumesim"}
"""Sources of an export, and the format of each."""
OPTIONS = {
    "trial": ("mcap", "plumesim"), "begin": ("mcap",), "points": ("mcap",), "least": ("mcap",),
    "full_scale": ("plumesim",), "cell": ("plumesim",),
}  # fmt: skip
"""Options with a value that only some formats take."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    out = args.out or args.run / DEFAULT[args.to]
    return exit_code(lambda: _export(args, out), f"interrupted, nothing was written to {out}", out=out)


def _export(args: Namespace, out: Path) -> int:
    from taichi_plume.results.export import export, export_log
    from taichi_plume.results.network_log import Choice
    from taichi_plume.results.run import Run, open_run

    if args.out is None and out != args.run and out.is_symlink():
        raise InputError(f"{out}: is a link, to which nothing is written; choose --out")
    run = Run(args.run, lenient=True) if args.to == "pictures" else open_run(args.run)
    if args.to == "mcap":
        files = _bag(run, args, out)
    elif args.to == "plumesim":
        files = export_log(run, Choice(source=args.source, **_given(args)), out, args.force)
    else:
        files = export(run, args.to, out, args.source, args.force)
    for file in files:
        size = sum(part.stat().st_size for part in (file, *file.rglob("*")) if part.is_file())
        say(f"{file}: {size / 1e6:,.3g} MB")
    return 0


def _given(args: Namespace) -> dict[str, Any]:
    """Return the options with a value that were given, by name."""
    return {name: vars(args)[name] for name in OPTIONS if vars(args)[name] is not None}


def _bag(run: "Run", args: Namespace, out: Path) -> list[Path]:
    """Write a ROS 2 bag of a run to `out` and return the files written. Raises InputError and OSError."""
    try:
        import rosbags  # noqa: F401
    except ImportError:
        raise InputError('bags need rosbags: pip install "taichi_plume[ros]"') from None
    from taichi_plume.results.bag_of_run import Choice, write

    choice = Choice(**_given(args), allow_outside=args.allow_outside)
    return write(run, out, choice, args.force)


def _arguments(argv: Sequence[str] | None) -> Namespace:
    description = "Write a run's data for other programs."
    parser = Parser(prog="python -m taichi_plume.export", description=description)
    add(parser, "run")
    formats = (
        "vtkhdf: the film for ParaView and pyvista; netcdf: fields after CF; csv: the tables; "
        "mcap: a bag of ROS 2; gaden: the film for GADEN's player; plumesim: a log of probes, or of robots that stand; "
        "pictures: numbers from the colours in recording.rrd of an earlier version"
    )
    parser.add_argument("--to", required=True, choices=tuple(DEFAULT), help=formats)
    what = "the file, of csv, mcap and gaden a folder (default: in the run's folder)"
    add(parser, "--out", metavar="OUT", help=what)
    what = (
        "source of netcdf (default: the film, else the pictures of the recording), "
        "or of plumesim (default: the probes, else the robots)"
    )
    parser.add_argument("--from", dest="source", choices=tuple(SOURCES), help=what)
    option(
        parser, "--trial", whole_number(0, 10**6), "N", "number of the trial of mcap, plumesim (default: 0)"
    )
    add(parser, "--force", help="replace what is there")
    bag = parser.add_argument_group("of a bag")
    option(
        bag, "--begin", from_zero, "SECONDS", "ROS time of the run's start, such as a Unix time (default: 0)"
    )
    what = "most points in a cloud of gas; more cells are averaged in blocks (default: 20000)"
    option(bag, "--points", whole_number(1, 10**7), "N", what)
    option(bag, "--least", from_zero, "PPM", "less gas is no point of a cloud (default: 0.1)")
    add(bag, "--allow-outside", help=OTHER_MAPS)
    log = parser.add_argument_group("of a log of PlumeSim")
    option(log, "--full-scale", positive, "PPM", "concentration that is 100 percent (default: 100)")
    what = "distance up to which a node counts (default: the largest to a nearest neighbour)"
    option(log, "--cell", positive, "METRES", what)
    args = parser.parse_args(argv)
    for name, formats in OPTIONS.items():
        if vars(args)[name] is not None and args.to not in formats:
            parser.error(f"--{name.replace('_', '-')} is only for --to {', '.join(formats)}")
    if args.source is not None and args.to != SOURCES[args.source]:
        parser.error(f"--from {args.source} is only for --to {SOURCES[args.source]}")
    return args
