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
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser, say

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_plume.record.recording_reader import Arrows, Picture
    from taichi_plume.report.plume import PlumeView
    from taichi_plume.results.run import Run

VIEWS = {"above": "slice", "slice": "slice", "column": "column", "section": "section", "side": "section"}
"""Views, and their names in recordings."""
SUFFIXES = (".png", ".pdf", ".svg", ".jpg")
FILMS = (".gif", ".mp4")
DPI = 160
LETTERS = 1.35  # over those of a page
PICTURE_WIDTH, FILM_WIDTH = 1600, 960  # pixels
MOST_FRAMES = 150  # of a film, unless asked for more
LARGEST = 8000  # pixels


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    return exit_code(lambda: _draw(args), out=args.film or args.out)


def _draw(args: argparse.Namespace) -> int:
    from taichi_plume.results.run import Run

    run = Run(args.run, lenient=True, allow_outside=args.allow_outside)
    for lack in run.lacks:
        say(f"note: {lack}", error=True)
    if args.film is not None:
        _film(run, args)
    if args.film is None or args.at is not None or args.out is not None:
        _still(run, args)
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
    option(parser, "--frames", whole_number(1, 10_000), "N", f"of a film (default: at most {MOST_FRAMES})")
    option(parser, "--fps", whole_number(1, 50), "N", "frames per second (default: 12)", default=12)
    width = f"(default: {PICTURE_WIDTH}, of a film {FILM_WIDTH})"
    option(parser, "--width", whole_number(200, LARGEST), "PIXELS", width)
    flag(parser, "--no-wind", "without the arrows of the wind")
    add(parser, "--allow-outside", help=OTHER_MAPS)
    args = parser.parse_args(argv)
    if args.out is not None and args.out.suffix.lower() not in SUFFIXES:
        parser.error(f"argument --out: {args.out} must end in {', '.join(SUFFIXES)}")
    if args.film is not None and args.film.suffix.lower() not in FILMS:
        parser.error(f"argument --film: {args.film} must end in .gif or .mp4")
    return args


def _still(run: "Run", args: argparse.Namespace) -> None:
    """Draw a picture of the run at the time of --at (default: the end) and write the image file."""
    period, end = max(1.0 / _rate(run, "rate"), run.scenario.tick), _end(run)
    at = end if args.at is None else args.at
    picture = _picture(run, args, (at - 1.5 * period, at))
    if not len(picture.times) or at > end + period:
        raise _outside(run, picture.name, at)
    figure, view = _figure(run, picture, args, args.width or PICTURE_WIDTH)
    _show(view, picture, at, run.planes.arrows(_plane(picture), (at - 1.5 / _rate(run, "wind_rate"), at)))
    name = next((view for view, plane in VIEWS.items() if picture.view == plane), picture.view)
    out = args.out or Path(f"{run.folder.resolve().name}-{name}-{at:g}s.png")
    from taichi_plume.files.disk import written_whole
    from taichi_plume.report.theme import styled

    with styled(), written_whole(out) as fresh:
        figure.savefig(fresh, format=out.suffix[1:].lower())
    say(f"{out}: {picture.name.replace('_', ' ')} at t = {picture.times[-1]:.4g} s")


def _film(run: "Run", args: argparse.Namespace) -> None:
    """Draw an animation of the run from --begin to --end and write the file."""
    import numpy as np

    from taichi_plume.report.films import film
    from taichi_plume.report.theme import styled

    begin = max(run.begin, 0.0) if args.begin is None else args.begin
    end = _end(run) if args.end is None else args.end
    if not begin < end:
        what = f"a film from {begin:g} to {end:g} s is empty; choose another --begin and --end"
        raise InputError(f"{run.folder}: {what}")
    count = args.frames or MOST_FRAMES
    picture = _picture(run, args, (begin, end), 0.0 if args.frames else (end - begin) / count)
    if not len(picture.times):
        raise _outside(run, picture.name, begin)
    chosen = list(range(len(picture.times)))
    if len(chosen) > count:
        chosen = np.linspace(0, len(chosen) - 1, count).round().astype(int).tolist()
    figure, view = _figure(run, picture, args, args.width or FILM_WIDTH)
    between = (begin - 1.5 / _rate(run, "wind_rate"), end)
    arrows = run.planes.arrows(_plane(picture), between, (end - begin) / count)

    def show(n: int) -> None:
        _show(view, picture, float(picture.times[n]), arrows, n)

    with styled():
        film(figure, view.moving, args.film, args.fps, chosen, show)
    first, last = picture.times[chosen[0]], picture.times[chosen[-1]]
    say(f"{args.film}: {len(chosen)} frames, t = {first:.4g} to {last:.4g} s")


def _show(view: "PlumeView", picture: "Picture", t: float, arrows: "Arrows | None", n: int = -1) -> None:
    view.show(t, picture.data[n], arrows)
    view.clock.set_text(f"t = {t:.1f} s")


def _figure(
    run: "Run", picture: "Picture", args: argparse.Namespace, width: int
) -> "tuple[Figure, PlumeView]":
    """Return a figure, `width` pixels wide, and the view that draws the plume in the figure."""
    from taichi_plume.report.plume import figure_of
    from taichi_plume.report.theme import LETTERS as SIZES
    from taichi_plume.report.theme import styled

    dpi = DPI * width / PICTURE_WIDTH
    larger = {key: LETTERS * size for key, size in SIZES.items()}
    with styled(larger | {"xtick.labelsize": 11, "ytick.labelsize": 11}):
        return figure_of(run, picture, run.tracks, PICTURE_WIDTH / DPI, dpi, LETTERS, not args.no_wind)


# ---------------------------------------------------------------- recorded pictures


def _picture(
    run: "Run", args: argparse.Namespace, between: tuple[float, float], spacing: float = 0.0
) -> "Picture":
    """Read the recorded gas pictures of one view between two times [s]. Raises InputError if the run has none."""
    views = [VIEWS.get(args.view, args.view)] if args.view else ["column", "slice"]
    names = [f"{args.of}_{view}" for view in views]
    pictures = run.planes.read(names, between, spacing)
    if not pictures:
        there = ", ".join(run.planes.names()) or "none"
        raise InputError(f"{run.folder}: has no pictures of {' or '.join(names)}, but of {there}")
    return pictures[next(name for name in names if name in pictures)]


def _rate(run: "Run", key: str) -> float:
    """Return the number of recorded pictures per simulated second; key: `rate` for gas, `wind_rate` for wind."""
    fields = run.scenario.fields
    if fields is None or run.has("recording.rrd"):
        return vars(run.scenario.recording)[key]
    return fields.rate


def _plane(picture: "Picture") -> str:
    """Return the name of the plane whose recorded wind is drawn into a picture of gas."""
    return picture.view if picture.axes != "xy" else "slice"


def _end(run: "Run") -> float:
    """Return the simulated end time of a run [s]; of an unfinished run, the last recorded time."""
    simulated = run.result.get("simulated_s")
    if isinstance(simulated, int | float) and not run.unfinished:
        return run.begin + float(simulated)
    return max([*(float(track.t[-1]) for track in run.tracks), *(run.planes.span() or ())], default=run.begin)


def _outside(run: "Run", name: str, at: float) -> InputError:
    times = run.planes.span([name])
    there = "none" if times is None else f"from {times[0]:g} to {times[1]:g} s"
    return InputError(f"{run.folder}: t = {at:g} s is outside the run, whose pictures are {there}")
