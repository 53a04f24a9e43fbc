"""Completes what a killed run has left: ``python -m taichi_plume.repair RUN``; see `taichi_plume.running.repair`."""

from collections.abc import Sequence
from pathlib import Path

from taichi_plume.files.run_folder import RunFolder, RunFolderError
from taichi_plume.guard.terminal import Parser, say, visible
from taichi_plume.running.repair import complete, verify


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = Parser(
        prog="python -m taichi_plume.repair", description="Complete the files of a run that was killed."
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="the run's folder")
    parser.add_argument(
        "--verify", action="store_true", help="only tell which files are no longer as their run left them"
    )
    parser.add_argument("--no-report", action="store_true", help="write no report.html")
    args = parser.parse_args(argv)
    try:
        if args.verify:
            return verify(args.run)
        with RunFolder.again(args.run) as folder:
            return complete(folder, not args.no_report)
    except RunFolderError as error:
        say(visible(error), error=True)
        return 2
