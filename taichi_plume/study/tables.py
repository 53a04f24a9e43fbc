"""The tables of a study's folder, written: `plan.parquet`, `runs.parquet`, `costs.parquet`, and `trials`, which lie in
folders by the values of axes that have few.

Each is made beside its place and renamed into it. All but the costs are equal to the bit however the runs came: they
are sorted by the plan's number and hold nothing of when, where and in which order that was. The costs come last, and
tell what all were made of: so a reader knows whether the tables are those of what the folder holds
(`study/results.py`).
"""

import hashlib
import json
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq

from taichi_plume.files import disk
from taichi_plume.study import table_rows
from taichi_plume.study.messages import Record

PLAN, RUNS, TRIALS, COSTS, PARTS = "plan.parquet", "runs.parquet", "trials", "costs.parquet", "parts"
MADE_OF, HELD = b"made_of", b"trials"
MOST_FOLDERS = 1000
ROW_GROUP = 50_000


def write_plan(folder: Path, plan: Any) -> None:
    """Write `plan.parquet`: a row for each run that a Plan (study/plan.py) asks for. Raises OSError."""
    _write(folder / PLAN, table_rows.planned(plan).table)


def read_plan(folder: Path) -> table_rows.Planned:
    """The plan of a folder, as `write_plan` left it. Raises OSError, ValueError, LookupError."""
    table = read(folder / PLAN)
    return table_rows.Planned(table, json.loads(table.schema.metadata[b"study"]))


def publish(folder: Path, records: Iterable[Record]) -> None:
    """Write the tables of the plan that lies in a folder, and of what came of its runs, in any order.

    Where they are there already, made of the same, nothing is done. Raises OSError.
    """
    made_of = state(folder)
    if held(folder, made_of) is not None:
        return
    plan = read_plan(folder)
    made = table_rows.tables(plan, records, made_of)
    (folder / COSTS).unlink(missing_ok=True)  # until it is there again, no reader takes the others for whole
    _write(folder / RUNS, made.runs)
    _write_trials(folder, table_rows.by_folders(plan, MOST_FOLDERS), made.trials)
    _write(folder / COSTS, made.costs)


def state(folder: Path) -> str:
    """A hash of what tables are made of: the plan, and names and sizes of what tasks have brought."""
    told = hashlib.sha256((folder / PLAN).read_bytes())
    for name, size in sorted((one.name, one.stat().st_size) for one in (folder / PARTS).glob("*.parquet")):
        told.update(f"{name} {size}\n".encode())
    return told.hexdigest()


def held(folder: Path, made_of: str) -> int | None:
    """How many trials the tables of a folder hold; None where they are not there, or not made of that state."""
    try:
        told = pq.read_schema(folder / COSTS).metadata or {}
    except (OSError, pa.ArrowException):
        return None
    there = (folder / RUNS).is_file() and (folder / TRIALS).is_dir()
    return int(told[HELD]) if there and told.get(MADE_OF) == made_of.encode() else None


def _write_trials(folder: Path, names: tuple[str, ...], trials: pa.Table) -> None:
    """Write the trials in folders by these axes, all of them before any is seen."""
    fresh, old = folder / f"{TRIALS}.new", folder / f"{TRIALS}.old"
    for left in (fresh, old):
        shutil.rmtree(left, ignore_errors=True)
    for values, table in table_rows.parts(trials, names):
        keys = (
            f"by_{quote(name, safe='')}={_key(value)}" for name, value in zip(names, values, strict=False)
        )
        place = fresh.joinpath(*keys)
        place.mkdir(parents=True)
        _write(place / "part-0.parquet", table)
    if (folder / TRIALS).exists():
        (folder / TRIALS).rename(old)
    fresh.rename(folder / TRIALS)
    shutil.rmtree(old, ignore_errors=True)


def _key(value: Any) -> str:
    """A value as the name of a folder, as Hive writes it; numbers and truths as Python does."""
    return quote(str(value), safe=" ") or "__HIVE_DEFAULT_PARTITION__"


def _write(path: Path, table: pa.Table) -> None:
    disk.require_room(path, table.nbytes)
    kept = {"compression": "zstd", "write_page_checksum": True}
    with disk.written_whole(path) as fresh, pq.ParquetWriter(fresh, table.schema, **kept) as writer:
        writer.write_table(table, ROW_GROUP)


def read(path: Path) -> pa.Table:
    """A table, or all files of a folder of them, in their order. Raises OSError, ValueError (of Arrow too)."""
    files = sorted(path.rglob("*.parquet")) if path.is_dir() else [path]
    tables = []
    for file in files:
        with pq.ParquetFile(file, page_checksum_verification=True) as one:
            tables.append(one.read())
    return pa.concat_tables(tables).combine_chunks()
