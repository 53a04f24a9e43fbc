"""``taichi-plume statistics RUN|FILM`` prints statistics of a plume and writes their files, see `statistics`."""

from collections.abc import Sequence
from pathlib import Path

from taichi_plume.api.statistics import statistics
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    given = vars(parser_of("statistics", statistics).parse_args(argv))
    debug, out = given.pop("debug"), given.get("out", given["source"])
    return exit_code(lambda: _analyse(**given), debug=debug, out=out)


def _analyse(source: str, out: Path | None = None, page: bool = True, **options: object) -> int:
    plume = statistics(source, **options)  # type: ignore
    folder = out or _folder(Path(source))
    if out is None and folder.is_symlink():
        raise InputError(f"{folder}: is a link, to which nothing is written; choose --out")
    paths = plume.write(folder, page)
    say(*(f"{subject}: {words}" for subject, words in plume.rows))
    say(f"{paths[-1]}: {paths[-1].stat().st_size / 1e3:,.0f} kB")
    return 0


def _folder(source: Path) -> Path:
    if (source / "zarr.json").exists():
        source = source if source.name else source.resolve()  # "." has no name
        return source.with_name(f"{source.stem}-statistics")
    return source / "statistics"
