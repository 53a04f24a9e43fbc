"""``python -m taichi_plume.statistics RUN|FILM`` computes statistics of a plume: mean, rms, intermittency, whiffs."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, flag, number, option, positive
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser, say

if TYPE_CHECKING:
    from taichi_plume.fluctuations.result import Statistics
    from taichi_plume.scenario.sensors import GasSensor


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    return exit_code(lambda: _analyse(args), out=args.out or args.source)


def _analyse(args: argparse.Namespace) -> int:
    sensors = [_sensor(text) for text in args.sensor]
    from taichi_plume.fluctuations import computation

    plume = computation.of(
        args.source, args.gas, args.probe, args.threshold, args.start,
        None if args.range is None else tuple(args.range), sensors,
    )  # fmt: skip
    out = args.out or _folder(args.source)
    if args.out is None and out.is_symlink():
        raise InputError(f"{out}: is a link, to which nothing is written; choose --out")
    paths = plume.write(out)
    if not args.no_page:
        from taichi_plume.fluctuations import page

        paths.append(page.write(plume, out))
    _print(plume)
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
    args = parser.parse_args(argv)
    if args.range is not None and not args.range[0] < args.range[1]:
        parser.error("argument --range: A must be less than B")
    return args


def _sensor(text: str) -> "GasSensor":
    from typing import Annotated

    from pydantic import Field

    from taichi_plume.scenario.loading import load_part
    from taichi_plume.scenario.sensors import IdealGasSensor, MoxSensor, PidSensor

    kind = Annotated[MoxSensor | PidSensor | IdealGasSensor, Field(discriminator="kind")]
    return load_part(text, "--sensor", kind)


def _folder(source: Path) -> Path:
    if (source / "zarr.json").exists():
        source = source if source.name else source.resolve()  # "." has no name
        return source.with_name(f"{source.stem}-statistics")
    return source / "statistics"


def _print(plume: "Statistics") -> None:
    """Print the main statistics of a plume: samples, threshold, power laws, whiffs that sensors keep, notes."""
    points = sum(len(part.probe.places) for part in plume.probes)
    say(
        f"{plume.gas}: {points:,} points, {plume.samples:,} samples from {plume.begin:.4g} to {plume.end:.4g} s; "
        f"threshold {plume.threshold:.3g} ppm ({plume.why})"
    )
    for part in plume.probes:
        for kind in part.kinds:
            if law := kind.law:
                say(
                    f"{part.probe.name}: {len(kind.all.lasted):,} {kind.name}, p(T) ~ T^-a with a = {law.value:.2f} "
                    f"(95 %: {law.low:.2f} to {law.high:.2f}) from {law.first:.3g} to {law.last:.3g} s; turbulence: 1.5"
                )
    if plume.smelt:
        slow, fast = plume.smelt.sensors[:2]
        say(
            f"of {slow.whiffs:,} whiff{'s' * (slow.whiffs != 1)} a metal oxide of 12 s keeps {slow.share:.0%}, "
            f"a detector of 50 ms {fast.share:.0%}"
        )
    say(*(f"note: {note}" for note in plume.notes))
