"""Makes the report of a run again from its files: ``python -m taichi_plume.report RUN``."""

from collections.abc import Sequence
from pathlib import Path

from taichi_plume.guard.terminal import Parser, say, visible


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = Parser(
        prog="python -m taichi_plume.report",
        description="Make report.html of a run again, from the files in its folder alone.",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="the run's folder")
    parser.add_argument(
        "--allow-outside",
        action="store_true",
        help="read maps and meshes outside the run's folder that are not those of the run",
    )
    args = parser.parse_args(argv)
    from taichi_plume.files.run_folder import RunFolderError
    from taichi_plume.report.page import write
    from taichi_plume.results.run import Run

    try:
        path = write(Run(args.run, lenient=True, allow_outside=args.allow_outside))
    except RunFolderError as error:
        say(visible(error), error=True)
        return 2
    except OSError as error:
        say(visible(f"{args.run}: the report cannot be written: {error.strerror or error}"), error=True)
        return 2
    say(visible(f"{path}: {path.stat().st_size / 1e3:,.0f} kB"))
    return 0
