"""``python -m taichi_plume.export RUN --to vtkhdf|netcdf|csv|mcap|gaden`` writes a run's data for other programs.

Exit code 0: done; 1: the data could not be written; 2: there is no such run, or it has no such data; 130: interrupted.
"""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import OTHER_MAPS, add, from_zero, option, whole_number
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser, say

if TYPE_CHECKING:
    from taichi_plume.results.run import Run

DEFAULT = {"vtkhdf": "fields.vtkhdf", "netcdf": "fields.nc", "csv": "", "mcap": "bag", "gaden": "gaden"}
"""Formats, and the names of their files in the run's folder."""
OF_BAGS = ("trial", "begin", "points", "least")  # options


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    out = args.out or args.run / DEFAULT[args.to]
    return exit_code(lambda: _export(args, out), f"interrupted, nothing was written to {out}", out=out)


def _export(args: Namespace, out: Path) -> int:
    from taichi_plume.results.export import export
    from taichi_plume.results.run import open_run

    if args.out is None and out != args.run and out.is_symlink():
        raise InputError(f"{out}: is a link, to which nothing is written; choose --out")
    run = open_run(args.run)
    files = _bag(run, args, out) if args.to == "mcap" else export(run, args.to, out, args.source, args.force)
    for file in files:
        say(f"{file}: {file.stat().st_size / 1e6:,.3g} MB")
    return 0


def _bag(run: "Run", args: Namespace, out: Path) -> list[Path]:
    """Write a ROS 2 bag of a run to `out` and return the files written. Raises InputError and OSError."""
    try:
        import rosbags  # noqa: F401
    except ImportError:
        raise InputError('bags need rosbags: pip install "taichi_plume[ros]"') from None
    from taichi_plume.results.bag_of_run import Choice, write

    given = {name: vars(args)[name] for name in OF_BAGS if vars(args)[name] is not None}
    choice = Choice(**given, allow_outside=args.allow_outside)
    return write(run, out, choice, args.force)


def _arguments(argv: Sequence[str] | None) -> Namespace:
    description = "Write a run's data for other programs."
    parser = Parser(prog="python -m taichi_plume.export", description=description)
    add(parser, "run")
    formats = (
        "vtkhdf: the film for ParaView and pyvista; netcdf: fields after CF; csv: the tables; "
        "mcap: a bag of ROS 2; gaden: the film for GADEN's player"
    )
    parser.add_argument("--to", required=True, choices=tuple(DEFAULT), help=formats)
    what = "the file, of csv, mcap and gaden a folder (default: in the run's folder)"
    add(parser, "--out", metavar="OUT", help=what)
    what = "source of netcdf (default: the film, else the decoded colours of the recording)"
    parser.add_argument("--from", dest="source", choices=("film", "recording"), help=what)
    add(parser, "--force", help="replace what is there")
    bag = parser.add_argument_group("of a bag")
    option(bag, "--trial", whole_number(0, 10**6), "N", "number of the trial (default: 0)")
    option(
        bag, "--begin", from_zero, "SECONDS", "ROS time of the run's start, such as a Unix time (default: 0)"
    )
    what = "most points in a cloud of gas; more cells are averaged in blocks (default: 20000)"
    option(bag, "--points", whole_number(1, 10**7), "N", what)
    option(bag, "--least", from_zero, "PPM", "less gas is no point of a cloud (default: 0.1)")
    add(bag, "--allow-outside", help=OTHER_MAPS)
    args = parser.parse_args(argv)
    for name in OF_BAGS:
        if vars(args)[name] is not None and args.to != "mcap":
            parser.error(f"--{name} is only for bags, --to mcap")
    if args.source is not None and args.to != "netcdf":
        parser.error("--from is only for --to netcdf")
    return args
