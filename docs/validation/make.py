"""Renew what the validation's page shows: ``python docs/validation/make.py [NAMES]``.

Solves the cases of `python -m taichi_plume.validation --list`, each in a process of its own, and keeps what came of
them in results.json, of which the page is made. All of them take an hour or more: `--limit 60` leaves those alone that
take longer than a minute. `--reports FOLDER` takes over a report that `python -m taichi_plume.validation --out FOLDER`
has written, here or on a faster machine. A case that is not renewed keeps what is known of it.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RESULTS = HERE / "results.json"
PICTURES = 15  # of a case, that are kept


def main() -> int:
    """Run the command line; 1 where a case could not be solved in time."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAMES", help="cases (default: all)")
    parser.add_argument("--limit", type=float, metavar="S", help="longest time of a case [s]")
    parser.add_argument("--trials", metavar="N", help="of every experiment (default: its own)")
    parser.add_argument(
        "--reports", type=Path, nargs="+", default=[], metavar="FOLDER", help="take these over"
    )
    args = parser.parse_args()
    late = []
    for folder in args.reports:
        take(folder / "report.json")
    for name in (args.names or names()) if args.names or not args.reports else []:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "taichi_plume.validation", name, "--out", folder]
            try:
                subprocess.run(
                    command + (["--trials", args.trials] if args.trials else []), cwd=ROOT, timeout=args.limit
                )
                take(Path(folder) / "report.json")
            except (subprocess.TimeoutExpired, FileNotFoundError):
                late.append(name)
    if late:
        print(f"as before: {', '.join(late)}")
    return 1 if late else 0


def names() -> list[str]:
    """Of all cases."""
    sys.path.insert(0, str(ROOT))
    from taichi_plume.validation.cases import CASES

    return list(CASES)


def known() -> dict[str, Any]:
    """What is known of each case."""
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}


def take(report: Path) -> None:
    """Keep what a report tells, beside when, and by which version and commit."""
    told = json.loads(report.read_text(encoding="utf-8"))
    commit = ["git", "rev-parse", "--short=12", "HEAD"]
    made = {
        "date": date.fromtimestamp(report.stat().st_mtime).isoformat(),
        "versions": told["versions"],
        "backend": told["backend"],
        "commit": subprocess.run(commit, cwd=ROOT, capture_output=True, text=True).stdout.strip() or None,
    }
    results = known()
    for case in told["cases"]:
        shown = dict(list(case.get("pictures", {}).items())[:PICTURES])
        results[case["name"]] = case | made | {"pictures": shown}
    lines = (
        f"{json.dumps(name)}: {json.dumps(results[name], ensure_ascii=False)}" for name in sorted(results)
    )
    RESULTS.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
