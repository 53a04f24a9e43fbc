"""Update the results on the validation page: ``python docs/validation/make.py [NAMES]``.

The command solves the cases of `python -m taichi_plume.validation --list`, each in its own process, and stores their
results in results.json, from which the page is made. All cases together take hours; `--limit 60` skips cases that take
longer than a minute. `--reports FOLDER` reads a report that `python -m taichi_plume.validation --out FOLDER` wrote,
here or on a faster machine. Cases that are not solved, or lack data of others, keep their stored results.
`--speed [CHECKOUTS]` measures the time of a step per cell of this or other checkouts in turn instead, and stores it in
speed.json by the version of the checkout.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RESULTS = HERE / "results.json"
SPEEDS = HERE / "speed.json"
BENCHMARK = "taichi_plume.validation.benchmark"
STEPS = ("arena_3d", "arena_2d")  # benchmark cases whose speed is stored
PICTURES = 15  # most plots stored per case


def main() -> int:
    """Run the command; return 1 if a case exceeds the time limit or fails, else 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAMES", help="cases (default: all)")
    parser.add_argument("--limit", type=float, metavar="S", help="time limit per case [s]")
    parser.add_argument("--trials", metavar="N", help="trials of each experiment (default: as in the case)")
    parser.add_argument(
        "--reports", type=Path, nargs="+", default=[], metavar="FOLDER", help="folders of finished reports"
    )
    parser.add_argument(
        "--speed", type=Path, nargs="*", metavar="CHECKOUT", help="measure steps of checkouts"
    )
    args = parser.parse_args()
    if args.speed is not None:
        return speed(args.speed or [ROOT])
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
        print(f"not updated: {', '.join(late)}")
    return 1 if late else 0


def speed(checkouts: list[Path], turns: int = 3) -> int:
    """Store the least time of a step per cell [ns] of each checkout, and the largest bandwidth, of several turns."""
    rows: dict[Path, list[dict[str, Any]]] = {path.resolve(): [] for path in checkouts}
    for path in list(rows) * turns:
        rows[path] += json.loads(_python(path, "-m", BENCHMARK, *STEPS, "--json", "--seconds", "2"))
    releases = {one["version"]: one for one in json.loads(SPEEDS.read_text())} if SPEEDS.exists() else {}
    for path, turned in rows.items():
        version = _python(path, "-c", "import taichi_plume; print(taichi_plume.__version__)").split()[-1]
        commit, day = _output(["git", "log", "-1", "--format=%h %cs"], path).split()
        origin = {"version": version, "date": day, "commit": commit, "cores": os.cpu_count()}
        least = {
            name: 1e3 / max(row["Mcell_steps_per_s"] for row in turned if row["case"] == name)
            for name in STEPS
        }
        releases[version] = origin | {
            "bandwidth": round(max(row["bandwidth"] for row in turned), 1),
            "ns": {name: round(ns, 1) for name, ns in least.items()},
        }
    lines = ",\n".join(json.dumps(releases[version]) for version in sorted(releases))
    SPEEDS.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
    return 0


def _python(checkout: Path, *arguments: str) -> str:
    """Return what Python prints with the package of a checkout."""
    return _output([sys.executable, *arguments], checkout)


def _output(command: list[str], folder: Path) -> str:
    env = os.environ | {"PYTHONPATH": str(folder)}
    return subprocess.run(command, cwd=folder, env=env, check=True, stdout=subprocess.PIPE, text=True).stdout


def names() -> list[str]:
    """Return the names of all cases."""
    sys.path.insert(0, str(ROOT))
    from taichi_plume.validation.cases import CASES

    return list(CASES)


def stored() -> dict[str, Any]:
    """Return the stored results of each case."""
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}


def take(report: Path) -> None:
    """Store the results of a report, with date, versions and commit."""
    content = json.loads(report.read_text(encoding="utf-8"))
    commit = ["git", "rev-parse", "--short=12", "HEAD"]
    origin = {
        "date": date.fromtimestamp(report.stat().st_mtime).isoformat(),
        "versions": content["versions"],
        "backend": content["backend"],
        "commit": subprocess.run(commit, cwd=ROOT, capture_output=True, text=True).stdout.strip() or None,
    }
    results = stored()
    for case in content["cases"]:
        if case["skipped"]:
            continue
        pictures = dict(list(case.get("pictures", {}).items())[:PICTURES])
        results[case["name"]] = case | origin | {"pictures": pictures}
    lines = (
        f"{json.dumps(name)}: {json.dumps(results[name], ensure_ascii=False)}" for name in sorted(results)
    )
    RESULTS.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
