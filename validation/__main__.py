"""The command: ``python -m taichi_plume.validation [NAMES]`` solves cases with known answers and judges the errors.

Exit code 0: all as expected; 1: one is not; 2: no such case.
"""

import argparse
import difflib
import json
import os
import sys
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.text import Text

if TYPE_CHECKING:
    from taichi_plume.validation.case import Case, Curve

VERDICTS = {True: ("met", "green"), False: ("NOT MET", "bold red"), None: ("", "")}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
    from taichi_plume.validation.cases import CASES

    unknown = [name for name in args.names if name not in CASES]
    for name in unknown:
        close = difflib.get_close_matches(name, CASES, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(CASES)}"
        print(f"no case '{name}'; {hint}", file=sys.stderr)
    if unknown:
        return 2
    cases = [case for name, case in CASES.items() if not args.names or name in args.names]
    if args.list:
        _print_list(cases)
        return 0
    from taichi_plume import kernels
    from taichi_plume.validation.report import page

    try:
        backend = kernels.start(args.arch)
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return 2
    try:
        if args.out:
            args.out.mkdir(parents=True, exist_ok=True)
        report, curves = _examine(cases, args, backend)
        text = json.dumps(report, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
        if args.out:
            (args.out / "report.json").write_text(text, encoding="utf-8")
            (args.out / "report.html").write_text(page(report, curves), encoding="utf-8")
    except OSError as error:
        print(f"the report could not be written: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    if args.json:
        print(text, end="")
    return 0 if report["passed"] else 1


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m taichi_plume.validation",
        description="Solve cases with known answers and judge the errors; all of them take some minutes.",
    )
    parser.add_argument("names", nargs="*", metavar="NAMES", help="cases (default: all)")
    parser.add_argument("--list", action="store_true", help="only tell what there is")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write report.html and report.json there")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    parser.add_argument(
        "--arch",
        choices=("auto", "cpu", "cuda", "vulkan", "metal"),
        default="cpu",
        help="where to compute; auto takes a GPU if there is one (default: cpu)",
    )
    return parser.parse_args(argv)


def _examine(
    cases: list["Case"], args: argparse.Namespace, backend: str
) -> tuple[dict[str, Any], dict[str, dict[str, "Curve"]]]:
    """Solve the cases finely and tell of each. One that cannot be solved counts as failed, and the others go on.

    Returns the report, and the curves of each case.
    """
    import platform

    import taichi as ti

    from taichi_plume import __version__

    begin, waiting = perf_counter(), Console(stderr=True)
    console = Console(highlight=False, soft_wrap=True, quiet=args.json)
    console.print(_line("error", "at resolution", "order", "expected", ("verdict", "")), style="bold")
    results, curves = [], {}
    for case in cases:
        with waiting.status(f"{case.name} at {', '.join(map(str, case.fine))}"):
            found, curves[case.name] = _result(case, args.arch)
            results.append(found)
        _print_result(results[-1], console)
    wall = round(perf_counter() - begin, 1)
    failed = [result["name"] for result in results if not result["passed"]]
    verdict = f"not met: {', '.join(failed)}" if failed else "all as expected"
    console.print(f"\n{len(cases)} cases in {wall:.0f} s on {backend}: {verdict}")
    report = {
        "passed": not failed,
        "versions": {
            "taichi_plume": __version__,
            "taichi": ".".join(map(str, ti.__version__)),
            "python": platform.python_version(),
        },
        "backend": backend,
        "wall_s": wall,
        "cases": results,
    }
    return report, curves


def _result(case: "Case", arch: str) -> tuple[dict[str, Any], dict[str, "Curve"]]:
    from taichi_plume.validation.case import examine

    begin = perf_counter()
    findings, curves, message = [], {}, ""
    try:
        findings, curves = examine(case, case.fine, arch)
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
    result = {
        "name": case.name,
        "about": case.about,
        "reference": case.reference,
        "passed": not message and all(finding.met is not False for finding in findings),
        "message": message,
        "wall_s": round(perf_counter() - begin, 1),
        "norms": [
            {
                "norm": finding.norm,
                "errors": {str(n): _number(error) for n, error in finding.errors.items()},
                "order": _number(finding.order),
                "expected": str(finding.expected) if finding.expected else None,
                "met": finding.met,
            }
            for finding in findings
        ],
    }
    return result, curves


def _number(value: float) -> float | None:
    return value if isfinite(value) else None


# ---------------------------------------------------------------- for a person


def _print_list(cases: list["Case"]) -> None:
    console = Console(highlight=False, soft_wrap=True)
    for case in cases:
        sizes = " ".join(map(str, case.fine))
        console.print(f"{case.name:16}  {sizes:9}  {case.about} ({case.reference})", markup=False)


def _print_result(result: dict[str, Any], console: Console) -> None:
    title = f"  {result['about']} ({result['reference']}), {result['wall_s']:.0f} s"
    console.print(Text.assemble((result["name"], "bold"), title))
    for row in result["norms"]:
        errors = "  ".join(
            f"{n}: {'-' if error is None else format(error, '.2e')}" for n, error in row["errors"].items()
        )
        order = "" if row["order"] is None else f"{row['order']:.2f}"
        console.print(_line(row["norm"], errors, order, row["expected"] or "", VERDICTS[row["met"]]))
    if result["message"]:
        console.print(Text.assemble("  ", VERDICTS[False], f": {result['message']}"))


def _line(norm: str, errors: str, order: str, expected: str, verdict: tuple[str, str]) -> Text:
    return Text.assemble(f"  {norm:28}  {errors:43}  {order:>5}  {expected:28}  ", verdict)


if __name__ == "__main__":
    sys.exit(main())
