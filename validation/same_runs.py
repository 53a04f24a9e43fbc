"""Check that two checkouts compute the same results, to the bit.

    python -m taichi_plume.validation.same_runs OLD NEW [--seconds S] [--only NAME ...] [--keep DIR]

The command runs every scenario in `configs/` that exists in both checkouts, shortened to S seconds of warm-up and S of
robots. It compares every column of `robots.parquet` and every number of the mass budget, and reports the name, first
time and size of differences. Exit code 0: no differences, 1: a difference or a failed run.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from taichi_plume.guard.terminal import Parser, say


def main(argv: Sequence[str] | None = None) -> int:
    """Compare two checkouts with these command-line arguments and return the exit code."""
    parser = Parser(prog="python -m taichi_plume.validation.same_runs")
    parser.add_argument("checkouts", nargs=2, type=Path, metavar="FOLDER")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--only", nargs="*", help="names of scenarios")
    parser.add_argument("--keep", type=Path, help="keep runs here, and reuse runs found here")
    args = parser.parse_args(argv)
    old, new = args.checkouts
    names = sorted(
        path.stem for path in (old / "configs").glob("*.yaml") if (new / "configs" / path.name).exists()
    )
    different = 0
    with tempfile.TemporaryDirectory() as folder:
        keep = args.keep or Path(folder)
        for name in args.only or names:
            before = _run(old, name, args.seconds, keep / "old")
            faults = list(differences(before, _run(new, name, args.seconds, keep / "new")))
            different += bool(faults)
            say(f"{name}: {'; '.join(faults) if faults else 'the same'}", flush=True)
    return int(different > 0)


def _run(checkout: Path, name: str, seconds: float, keep: Path) -> Path:
    """Run a shortened scenario with the code of a checkout, unless done before; return the run folder."""
    out = keep.resolve() / name
    if (out / "result.json").exists():
        return out
    config = checkout.resolve() / "configs" / f"{name}.yaml"
    command = [sys.executable, "-m", "taichi_plume.run", str(config), "--out", str(out), "--quiet", "--force"]
    for key, value in shortened(yaml.safe_load(config.read_text()), seconds).items():
        command += ["--set", f"{key}={json.dumps(value)}"]
    command.append("--no-recording")
    subprocess.run(command, cwd=checkout, check=False)
    return out


def shortened(data: dict[str, Any], seconds: float) -> dict[str, Any]:
    """Return the changed keys that shorten a scenario, and its warm-up if any, to `seconds` each."""
    shorter: dict[str, Any] = {"duration": seconds}
    if not str(data.get("warm_up", "0")).startswith("0"):
        shorter["warm_up"] = seconds
    if "after" in data["wind"]:  # a frozen wind has to be frozen before the end
        shorter |= {"wind.after": seconds, "wind.average": None}
    return shorter


def differences(old: Path, new: Path, keys: Sequence[str] = ("status", "steps", "gas")) -> Iterator[str]:
    """Yield a line for each difference of two run folders, in these keys of the result and in the robots' table."""
    results = []
    for run in (old, new):
        file = run / "result.json"
        if not file.exists():
            yield f"{run} has no result"
            return
        results.append(json.loads(file.read_text()))
    for key in keys:
        if results[0][key] != results[1][key]:
            yield f"{key}: {results[0][key]} became {results[1][key]}"
    tables = [run / "robots.parquet" for run in (old, new)]
    if tables[0].exists() != tables[1].exists():
        yield "only one has robots"
    elif tables[0].exists():
        yield from _of_tables(*(pq.read_table(table) for table in tables))


def _of_tables(old: pa.Table, new: pa.Table) -> Iterator[str]:
    if old.column_names != new.column_names or old.num_rows != new.num_rows:
        yield f"robots: {old.num_rows} rows of {old.column_names} became {new.num_rows} of {new.column_names}"
        return
    t = old["t"].to_numpy()
    for name in old.column_names:
        a, b = (table[name].combine_chunks() for table in (old, new))
        if pa.types.is_dictionary(a.type):
            a, b = (np.array(column.to_pylist()) for column in (a, b))
            same = a == b
        else:
            a, b = (column.to_numpy(zero_copy_only=False) for column in (a, b))
            same = (a == b) | (np.isnan(a.astype(float)) & np.isnan(b.astype(float)))
        if not same.all():
            apart = "" if a.dtype.kind not in "fi" else f", by up to {np.nanmax(np.abs(a - b)):.3g}"
            yield f"{name} differs in {int((~same).sum())} of {len(same)} rows, first at t = {t[~same][0]:g} s{apart}"


if __name__ == "__main__":
    sys.exit(main())
