"""``python -m taichi_plume.picture RUN --at 20 --out x.png`` draws pictures and films of a run, for talks and papers.

A picture shows the recorded gas with its scale over the scene, and the wind and the robots of that moment. The data
come from recording.rrd or, without a recording, from fields.zarr; nothing is computed again.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import OTHER_MAPS, add, flag, number, option, whole_number
from taichi_plume.guard.terminal import Parser, say

if TYPE_CHECKING:
    from taichi_plume.report.pictures import Shown
    from taichi_plume.results.run import Run

SUFFIXES = (".png", ".pdf", ".svg", ".jpg")
FILMS = (".gif", ".mp4")
LARGEST = 8000  # pixels


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    return exit_code(lambda: _draw(args), out=args.film or args.out)


def _draw(args: argparse.Namespace) -> int:
    from taichi_plume.report.pictures import Shown
    from taichi_plume.results.run import Run

    shown = Shown(args.view, args.of, args.width, not args.no_wind)
    run = Run(args.run, lenient=True, allow_outside=args.allow_outside)
    for lack in run.lacks:
        say(f"note: {lack}", error=True)
    if args.film is not None:
        _film(run, args, shown)
    if args.film is None or args.at is not None or args.out is not None:
        _still(run, args, shown)
    return 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.picture",
        description="Draw a moment of a run, or a film of it, for a talk or a paper.",
    )
    add(parser, "run")
    option(parser, "--at", number, "S", "simulated time in seconds (default: the end)")
    add(parser, "--out", metavar="FILE", help=f"{', '.join(SUFFIXES)} (default: RUN-VIEW-AT.png, here)")
    option(parser, "--film", Path, "FILE", "make a film: .gif, or .mp4 with ffmpeg")
    view = (
        "above: at the height of the slice; column: maximum over the height, from above; section or side: the "
        "vertical plane through the source; or another plane of the recording, such as section_2 (default: column in "
        "3-D, else above)"
    )
    parser.add_argument("--view", help=view)
    option(parser, "--of", str, "QUANTITY", "gas, temperature, ... (default: gas)", default="gas")
    option(parser, "--begin", number, "S", "of a film (default: the start of the robots)")
    option(parser, "--end", number, "S", "of a film (default: the end)")
    option(parser, "--frames", whole_number(1, 10_000), "N", "of a film (default: at most 150)")
    option(parser, "--fps", whole_number(1, 50), "N", "frames per second (default: 12)", default=12)
    width = "(default: 1600, of a film 960)"
    option(parser, "--width", whole_number(200, LARGEST), "PIXELS", width)
    flag(parser, "--no-wind", "without the arrows of the wind")
    add(parser, "--allow-outside", help=OTHER_MAPS)
    args = parser.parse_args(argv)
    if args.out is not None and args.out.suffix.lower() not in SUFFIXES:
        parser.error(f"argument --out: {args.out} must end in {', '.join(SUFFIXES)}")
    if args.film is not None and args.film.suffix.lower() not in FILMS:
        parser.error(f"argument --film: {args.film} must end in .gif or .mp4")
    return args


def _still(run: "Run", args: argparse.Namespace, shown: "Shown") -> None:
    """Draw a picture of the run at the time of --at (default: the end) and write the image file."""
    from taichi_plume.files.disk import written_whole
    from taichi_plume.report.pictures import VIEWS, still

    figure, picture, at = still(run, args.at, shown)
    name = next((view for view, plane in VIEWS.items() if picture.view == plane), picture.view)
    out = args.out or Path(f"{run.folder.resolve().name}-{name}-{at:g}s.png")
    with written_whole(out) as fresh:
        figure.savefig(fresh, format=out.suffix[1:].lower())
    say(f"{out}: {str(picture.name).replace('_', ' ')} at t = {float(picture.time[-1]):.4g} s")


def _film(run: "Run", args: argparse.Namespace, shown: "Shown") -> None:
    """Draw an animation of the run from --begin to --end and write the file."""
    from taichi_plume.report.pictures import make_film

    times = make_film(run, args.film, shown, args.begin, args.end, args.frames, args.fps)
    say(f"{args.film}: {len(times)} frames, t = {times[0]:.4g} to {times[-1]:.4g} s")
