"""Pictures and films of a run, for talks and papers: ``python -m taichi_plume.picture RUN --at 20 --out x.png``.

They show the gas as it was recorded, with its scale, over the scene, and the wind and the robots of that moment. Taken
from recording.rrd or, where a run has none, from fields.zarr; nothing is computed again.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import OTHER_MAPS, add, number, whole_number
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser, say

if TYPE_CHECKING:
    from taichi_plume.record.reading import Picture
    from taichi_plume.results.run import Run

VIEWS = {"above": "slice", "slice": "slice", "column": "column", "section": "section", "side": "section"}
"""What the views are called in recordings."""
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
    parser.add_argument("--at", type=number, metavar="S", help="simulated time in seconds (default: the end)")
    add(parser, "--out", metavar="FILE", help=f"{', '.join(SUFFIXES)} (default: RUN-VIEW-AT.png, here)")
    parser.add_argument("--film", type=Path, metavar="FILE", help="make a film: .gif, or .mp4 with ffmpeg")
    parser.add_argument(
        "--view",
        help="above: at the height of the slice; column: maximum over the height, from above; section or side: the "
        "vertical plane through the source; or another plane of the recording, such as section_2 (default: column in "
        "3-D, else above)",
    )
    parser.add_argument(
        "--of", default="gas", metavar="QUANTITY", help="gas, temperature, ... (default: gas)"
    )
    parser.add_argument(
        "--begin", type=number, metavar="S", help="of a film (default: the start of the robots)"
    )
    parser.add_argument("--end", type=number, metavar="S", help="of a film (default: the end)")
    parser.add_argument(
        "--frames",
        type=whole_number(1, 10_000),
        metavar="N",
        help=f"of a film (default: at most {MOST_FRAMES})",
    )
    parser.add_argument(
        "--fps", type=whole_number(1, 50), default=12, metavar="N", help="frames per second (default: 12)"
    )
    parser.add_argument(
        "--width",
        type=whole_number(200, LARGEST),
        metavar="PIXELS",
        help=f"(default: {PICTURE_WIDTH}, of a film {FILM_WIDTH})",
    )
    parser.add_argument("--no-wind", action="store_true", help="without the arrows of the wind")
    add(parser, "--allow-outside", help=OTHER_MAPS)
    args = parser.parse_args(argv)
    if args.out is not None and args.out.suffix.lower() not in SUFFIXES:
        parser.error(f"argument --out: {args.out} must end in {', '.join(SUFFIXES)}")
    if args.film is not None and args.film.suffix.lower() not in FILMS:
        parser.error(f"argument --film: {args.film} must end in .gif or .mp4")
    return args


def _still(run: "Run", args: argparse.Namespace) -> None:
    """Draw one moment."""
    period = _period(run)
    end = _end(run)
    at = end if args.at is None else args.at
    one = _picture(run, args, (at - 1.5 * period, at))
    if not len(one.times) or at > end + period:
        raise _outside(run, one.name, at)
    figure, view = _figure(run, one, args, args.width or PICTURE_WIDTH)
    _show(view, one, at, run.planes.arrows(_plane(one), (at - 1.5 / _wind_rate(run), at)))
    what = next((view for view, name in VIEWS.items() if one.view == name), one.view)
    out = args.out or Path(f"{run.folder.resolve().name}-{what}-{at:g}s.png")
    _save(figure, out)
    say(f"{out}: {one.name.replace('_', ' ')} at t = {one.times[-1]:.4g} s")


def _film(run: "Run", args: argparse.Namespace) -> None:
    """Draw one moment after another."""
    import numpy as np

    from taichi_plume.report.films import film
    from taichi_plume.report.look import styled

    begin = max(run.begin, 0.0) if args.begin is None else args.begin
    end = _end(run) if args.end is None else args.end
    if not begin < end:
        raise _error(run, f"a film from {begin:g} to {end:g} s is none; choose another --begin and --end")
    count = args.frames or MOST_FRAMES
    one = _picture(run, args, (begin, end), 0.0 if args.frames else (end - begin) / count)
    if not len(one.times):
        raise _outside(run, one.name, begin)
    chosen = list(range(len(one.times)))
    if len(chosen) > count:
        chosen = np.linspace(0, len(chosen) - 1, count).round().astype(int).tolist()
    figure, view = _figure(run, one, args, args.width or FILM_WIDTH)
    arrows = run.planes.arrows(_plane(one), (begin - 1.5 / _wind_rate(run), end), (end - begin) / count)
    with styled():
        film(
            figure,
            view.moving,
            args.film,
            args.fps,
            chosen,
            lambda n: _show(view, one, float(one.times[n]), arrows, n),
        )
    first, last = one.times[chosen[0]], one.times[chosen[-1]]
    say(f"{args.film}: {len(chosen)} frames, t = {first:.4g} to {last:.4g} s")


def _show(view: Any, one: "Picture", t: float, arrows: Any, n: int = -1) -> None:
    view.show(t, one.data[n], arrows)
    view.clock.set_text(f"t = {t:.1f} s")


def _figure(run: "Run", one: "Picture", args: argparse.Namespace, width: int) -> Any:
    """A figure so many pixels wide, and its view."""
    from taichi_plume.report.look import LETTERS as SIZES
    from taichi_plume.report.look import styled
    from taichi_plume.report.plume import figure_of

    dpi = DPI * width / PICTURE_WIDTH
    larger = {key: LETTERS * size for key, size in SIZES.items()}
    with styled(larger | {"xtick.labelsize": 11, "ytick.labelsize": 11}):
        return figure_of(run, one, run.tracks, PICTURE_WIDTH / DPI, dpi, LETTERS, not args.no_wind)


def _save(figure: Any, out: Path) -> None:
    from taichi_plume.files.disk import written_whole
    from taichi_plume.report.look import styled

    with styled(), written_whole(out) as fresh:
        figure.savefig(fresh, format=out.suffix[1:].lower())


# ---------------------------------------------------------------- what there is of a run


def _picture(
    run: "Run", args: argparse.Namespace, between: tuple[float, float], spacing: float = 0.0
) -> "Picture":
    """The pictures of the view that is asked for, of some time. Raises InputError."""
    if not (run.planes.has_recording or run.planes.has_film):
        raise _error(run, "has neither recording.rrd nor fields.zarr, from which pictures are made")
    wanted = (
        [f"{args.of}_{VIEWS.get(args.view, args.view)}"]
        if args.view
        else [f"{args.of}_column", f"{args.of}_slice"]
    )
    found = run.planes.read(wanted, between, spacing)
    if not found:
        there = ", ".join(run.planes.names()) or "none"
        raise _error(run, f"has no pictures of {' or '.join(wanted)}, but of {there}")
    return found[next(name for name in wanted if name in found)]


def _period(run: "Run") -> float:
    """Simulated time between its pictures [s]."""
    fields = run.scenario.fields
    rate = run.scenario.recording.rate if run.planes.has_recording or fields is None else fields.rate
    return max(1.0 / rate, run.scenario.tick)


def _wind_rate(run: "Run") -> float:
    fields = run.scenario.fields
    return run.scenario.recording.wind_rate if run.planes.has_recording or fields is None else fields.rate


def _plane(one: "Picture") -> str:
    """The plane in which the wind is shown beside a picture."""
    return one.view if one.axes != "xy" else "slice"


def _end(run: "Run") -> float:
    """When it ended, or how far it was when last heard of [s]."""
    simulated = run.result.get("simulated_s")
    if isinstance(simulated, int | float) and not run.unfinished:
        return run.begin + float(simulated)
    return max([*(float(track.t[-1]) for track in run.tracks), *(run.planes.span() or ())], default=run.begin)


def _outside(run: "Run", name: str, at: float) -> Exception:
    times = run.planes.span([name])
    there = "none" if times is None else f"from {times[0]:g} to {times[1]:g} s"
    return _error(run, f"t = {at:g} s is outside the run, whose pictures are {there}")


def _error(run: "Run", what: str) -> Exception:
    return InputError(f"{run.folder}: {what}")
