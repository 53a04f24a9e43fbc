"""Command line of the validation: ``python -m taichi_plume.validation [NAMES]``.

The command solves cases with known answers, judges their errors and repeats published experiments. Exit code 0: all
results are as expected; 1: a result is not; 2: unknown case.
"""

import difflib
import json
import re
from collections.abc import Sequence
from dataclasses import KW_ONLY, asdict, dataclass
from math import isfinite
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated

from rich.text import Text

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of
from taichi_plume.engine.choice import Arch
from taichi_plume.execution.signals import leave
from taichi_plume.files.disk import written_whole
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say, terminal

if TYPE_CHECKING:
    from rich.console import Console

    from taichi_plume.validation.case import Case, Keys
    from taichi_plume.validation.experiment import Experiment
    from taichi_plume.validation.report import Pictures

VERDICTS = {True: ("met", "green"), False: ("NOT MET", "bold red"), None: ("", "")}


@dataclass(frozen=True)
class Options:
    """Solve cases with known answers, repeat published experiments, and judge the results, in some minutes.

    names: cases, by default all. trials: number of trials of every experiment, by default set by each experiment. list:
    list the cases and exit. out: write report.html and report.json there. json: print the report as JSON. arch: where
    to compute; auto takes a GPU if there is one.
    """

    names: Annotated[Sequence[str], "NAMES ..."] = ()
    _: KW_ONLY
    trials: Annotated[int | None, "N"] = None
    list: bool = False
    out: Annotated[Path | None, "DIR"] = None
    json: bool = False
    arch: Arch = "cpu"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the validation with these command-line arguments and return the exit code."""
    given = vars(parser_of("validation", Options).parse_args(argv))
    debug, args = given.pop("debug"), Options(**given)
    return exit_code(lambda: _validate(args), debug=debug, out=args.out)


def _validate(args: Options) -> int:
    from taichi_plume.validation.cases import CASES

    lines = []
    if args.trials is not None and args.trials < 1:
        lines.append(f"--trials: got {args.trials}; must be 1 or more")
    for name in args.names:
        if name in CASES:
            continue
        close = difflib.get_close_matches(name, CASES, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(CASES)}"
        lines.append(f"no case '{name}'; {hint}")
    if lines:
        raise InputError(*lines)
    cases: list[Case | Experiment] = [
        case for name, case in CASES.items() if not args.names or name in args.names
    ]
    if args.list:
        _print_list(cases)
        return 0
    from taichi_plume.engine import program
    from taichi_plume.grid.blas import one_blas_thread
    from taichi_plume.validation.report import page

    backend = program.start(args.arch)
    if args.out:
        args.out.mkdir(parents=True, exist_ok=True)
    report, pictures = one_blas_thread(_examine)(cases, args, backend)
    text = json.dumps(report, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    if args.out:
        for name, content in (("report.json", text), ("report.html", page(report, pictures))):
            with written_whole(args.out / name) as fresh:
                fresh.write_text(content, encoding="utf-8")
    if args.json:
        say(*text.splitlines(), longest=None)
    return 0 if report["passed"] else 1


def _examine(
    cases: list["Case | Experiment"], args: Options, backend: str
) -> "tuple[Keys, dict[str, Pictures]]":
    """Solve the cases at fine resolutions and print each; return the report, and the pictures by case.

    A case that raises an error counts as failed, one whose data are missing as skipped.
    """
    import platform
    from importlib.metadata import version

    from taichi_plume import __version__
    from taichi_plume.engine.choice import chosen
    from taichi_plume.validation.case import Case

    begin, waiting = perf_counter(), terminal(error=True)
    console = terminal(soft_wrap=True, quiet=args.json)
    if any(isinstance(case, Case) for case in cases):
        console.print(_line("error", "at resolution", "order", "expected", ("verdict", "")), style="bold")
    results, pictures = [], {}
    for case in cases:
        with waiting.status(f"{case.name}, {_size(case, args.trials)}"):
            result, pictures[case.name] = _result(case, args)
            results.append(result)
        _print_result(results[-1], console)
    wall = round(perf_counter() - begin, 1)
    failed = [result["name"] for result in results if not result["passed"]]
    skipped = [result["name"] for result in results if result["skipped"]]
    verdict = f"not met: {', '.join(failed)}" if failed else "all as expected"
    verdict += f"; skipped: {', '.join(skipped)}" if skipped else ""
    console.print(f"\n{len(cases)} cases in {wall:.0f} s on {backend}: {verdict}")
    report = {
        "passed": not failed,
        "versions": {
            "taichi_plume": __version__,
            chosen(): version(chosen()),
            "python": platform.python_version(),
        },
        "backend": backend,
        "wall_s": wall,
        "cases": results,
    }
    return report, pictures


def _size(case: "Case | Experiment", trials: int | None) -> str:
    from taichi_plume.validation.case import Case

    return " ".join(map(str, case.fine)) if isinstance(case, Case) else f"{trials or case.trials} trials"


def _result(case: "Case | Experiment", args: Options) -> "tuple[Keys, Pictures]":
    from taichi_plume.validation.case import Case
    from taichi_plume.validation.published_data import MissingDataError
    from taichi_plume.validation.report import plain

    begin, skipped = perf_counter(), False
    table, verdicts, pictures, message = {}, [], {}, ""
    try:
        if isinstance(case, Case):
            table, verdicts, pictures = _norms(case, args.arch)
        else:
            table, verdicts, pictures = _rows(case, args.trials or case.trials, args.arch)
    except MissingDataError as error:
        message, skipped = f"skipped: {error}", True
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
    result = {
        "name": case.name,
        "about": case.about,
        "reference": case.reference,
        "evidence": case.evidence,
        "discussion": case.discussion,
        "passed": skipped or (not message and all(met is not False for met in verdicts)),
        "skipped": skipped,
        "message": message,
        "wall_s": round(perf_counter() - begin, 1),
        **table,
        "pictures": plain(pictures),
    }
    return result, pictures


def _norms(case: "Case", arch: str) -> "tuple[Keys, list[bool | None], Pictures]":
    """Return the norms of a solved case, their verdicts and the pictures. Compared values are no errors of an order."""
    from taichi_plume.validation.case import examine
    from taichi_plume.validation.trust import comparisons

    findings, curves = examine(case, case.fine, arch)
    values = [part.values for part in comparisons(case)]
    norms = [
        {
            "norm": finding.norm,
            "errors": {str(n): _number(error) for n, error in finding.errors.items()},
            "order": None if any(re.match(name, finding.norm) for name in values) else _number(finding.order),
            "expected": str(finding.expected) if finding.expected else None,
            "met": finding.met,
        }
        for finding in findings
    ]
    return {"norms": norms}, [finding.met for finding in findings], curves


def _rows(experiment: "Experiment", trials: int, arch: str) -> "tuple[Keys, list[bool | None], Pictures]":
    """Return the rows of an experiment, their verdicts and the pictures."""
    from taichi_plume.validation.experiment import examine

    rows, pictures = examine(experiment, trials, arch)
    table = [
        {
            "condition": row.condition,
            "quantity": row.quantity,
            **{name: _number(value) for name, value in asdict(row.found).items()},
            "published": row.published,
            "expected": str(row.expected) if row.expected else None,
            "met": row.met,
        }
        for row in rows
    ]
    return {"rows": table}, [row.met for row in rows], pictures


def _number(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None


# ---------------------------------------------------------------- printed output


def _print_list(cases: list["Case | Experiment"]) -> None:
    console = terminal(soft_wrap=True)
    for case in cases:
        size = _size(case, None)
        console.print(f"{case.name:24}  {case.evidence:9}  {size:10}  {case.about} ({case.reference})")


def _print_result(result: "Keys", console: "Console") -> None:
    from taichi_plume.validation.report import mean_with_interval

    title = f"  {result['evidence']}: {result['about']} ({result['reference']}), {result['wall_s']:.0f} s"
    console.print(Text.assemble((result["name"], "bold"), title))
    for row in result.get("norms", ()):
        errors = "  ".join(
            f"{n}: {'-' if error is None else format(error, '.2e')}" for n, error in row["errors"].items()
        )
        order = "" if row["order"] is None else f"{row['order']:.2f}"
        console.print(_line(row["norm"], errors, order, row["expected"] or "", VERDICTS[row["met"]]))
    last = None
    for row in result.get("rows", ()):
        if row["condition"] != last:
            console.print(f"  {row['condition']}", style="italic")
            last = row["condition"]
        published = f"published: {row['published']}" if row["published"] else ""
        line = f"    {row['quantity']:26}  {mean_with_interval(row):43}  {published:35}  {row['expected'] or '':15}  "
        console.print(Text.assemble(line, VERDICTS[row["met"]]))
    if result["skipped"]:
        console.print(Text(f"  {result['message']}", "yellow"))
    elif result["message"]:
        console.print(Text.assemble("  ", VERDICTS[False], f": {result['message']}"))


def _line(norm: str, errors: str, order: str, expected: str, verdict: tuple[str, str]) -> Text:
    return Text.assemble(f"  {norm:34}  {errors:43}  {order:>5}  {expected:28}  ", verdict)


if __name__ == "__main__":
    leave(main())
