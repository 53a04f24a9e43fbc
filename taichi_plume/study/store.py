"""Folder of a study: records of finished runs, a Parquet file per task. Files are written atomically.

study.yaml and base.yaml are copies of the user's files; plan.parquet lists the runs of the plan. ``parts/`` holds the
records of the tasks: a row per run, with the trials as a list. ``kept/`` and ``failed/`` hold files of single runs. One
process at a time writes to the folder; other processes may read.
"""

import json
import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self

import pyarrow as pa
import pyarrow.parquet as pq

from taichi_plume.files import disk, own_folder, run_folder
from taichi_plume.files.tables import plain
from taichi_plume.guard.opening import content_of, read_regular, unopenable
from taichi_plume.study import columns
from taichi_plume.study.messages import AirRecord, Cost, Record, Request, Row, Task

if TYPE_CHECKING:
    from taichi_plume.scenario.scenario import Scenario
    from taichi_plume.study.plan import Plan

KIND = "study"  # study.json marks the folder of a study
PARTS, AIRS, KEPT_FOLDER, FAILED = "parts", "airs", "kept", "failed"
PLAN = "plan.parquet"
FORMAT = "taichi_plume study 1"
LARGEST_TEXT = 1 << 24  # most bytes of a copied file
DONE = ("completed", "stopped")

_PART = re.compile(r"\d{6,}\.parquet")
_SCORES = pa.struct([(field.name, field.type) for field in columns.TRIAL])
_COST = pa.struct([(field.name, field.type) for field in columns.COST if field.name != "run"])
_SCHEMA = pa.schema(
    [
        ("run", pa.string()),
        ("status", pa.string()),
        ("message", pa.string()),
        ("told", pa.string()),  # JSON: values that all trials of the run share, such as those of the axes
        ("trials", pa.list_(_SCORES)),
        ("outcomes", pa.map_(pa.string(), pa.float64())),
        ("cost", _COST),
    ],
    {"format": FORMAT},
)
_NAMES = frozenset(field.name for field in _SCORES)


class StoreError(ValueError):
    """Error of a study's folder; the message is one line and begins with the path."""


class Latest(NamedTuple):
    """The valid record of a run: file (part), row in the file, and status."""

    part: Path
    row: int
    status: str


class Store:
    """Records of a study's runs in a folder. Readers need no lock.

    `begin` locks the folder for this process until `close` or the end of the context.
    """

    def __init__(self, folder: Path):
        self.folder, self.parts, self.airs = folder, folder / PARTS, folder / AIRS
        self._next = 0
        self._lock: own_folder.FolderLock | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Unlock the folder."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    # ------------------------------------------------------------ beginning

    def begin(self, plan: "Plan", force: bool = False) -> None:
        """Lock the folder for the runs of a plan. Existing records of the plan's runs stay.

        force: remove runs that are not in the plan. Raises StoreError, also if another process has locked the folder,
        and OSError if the disk is full.
        """
        self._hold()
        try:
            self._drop_others({request.run for request in plan.requests}, force)
            own_folder.mark(self.folder, KIND)
            for folder in (self.parts, self.airs):
                folder.mkdir(exist_ok=True)
            self._tidy()
            for name, source in (
                ("study.yaml", plan.file),
                ("base.yaml", plan.file.parent / plan.study.base),
            ):
                self._copy(source, name)
            from taichi_plume.study import tables

            tables.write_plan(self.folder, plan)
            self._next = 1 + max((int(file.stem) for file in self._files()), default=-1)
        except BaseException:
            self.close()
            raise

    def _hold(self) -> None:
        import filelock

        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock = own_folder.FolderLock(self.folder, self._require_ours)
        except filelock.Timeout:
            raise StoreError(f"{self.folder}: another study is running there") from None
        except StoreError:
            raise
        except (OSError, ValueError, NotImplementedError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else error
            raise StoreError(f"{self.folder}: cannot be written to: {reason}") from None

    def _require_ours(self) -> None:
        """Raise StoreError if the folder holds links or files that do not belong to a study."""
        other = own_folder.other_in(self.folder, KIND)
        if other is not None:
            raise StoreError(
                f"{self.folder}: is not empty, and holds no study ({other}); choose another --out"
            )
        link = own_folder.link_in(self.folder)
        if link is not None:
            raise StoreError(f"{self.folder / link}: is a link, which a study does not write to; remove it")

    def _drop_others(self, planned: set[str], force: bool) -> None:
        """Raise StoreError if the folder holds runs that are not planned; with `force` remove these runs."""
        others = sorted(self.statuses().keys() - planned)
        if not others:
            return
        if not force:
            raise StoreError(
                f"{self.folder}: holds {len(others):,} run{'s' * (len(others) > 1)} that this study does not have "
                f"({others[0]}{' ...' * (len(others) > 1)}): it is another study's folder, or the base, an axis, an "
                "input file or the version has changed; choose another --out, or add --force to remove these runs"
            )
        for part in self._files():
            table = _read(part)
            rest = table.filter(pa.array([run in planned for run in table["run"].to_pylist()], pa.bool_()))
            if len(rest) == len(table):
                continue
            if len(rest):
                with disk.written_whole(part) as fresh:
                    pq.write_table(rest, fresh, compression="zstd", write_page_checksum=True)
            else:
                part.unlink()
        for run in others:
            for folder in (KEPT_FOLDER, FAILED):
                shutil.rmtree(self.folder / folder / run, ignore_errors=True)

    def _tidy(self) -> None:
        """Remove unfinished files of an earlier process that was killed."""
        for folder in (self.folder, self.parts, self.airs):
            for left in disk.left_in(folder):
                left.unlink()
        for film in self.airs.glob("*.zarr.*.part"):
            shutil.rmtree(film, ignore_errors=True)

    def _copy(self, source: Path, name: str) -> None:
        content = content_of(source, LARGEST_TEXT, StoreError)
        held = self.folder / name
        if held.is_file() and held.read_bytes() != content:
            for film in self.airs.glob("*.zarr"):  # the changed study's runs may last longer
                shutil.rmtree(film, ignore_errors=True)
        with disk.written_whole(held) as fresh:
            fresh.write_bytes(content)

    # ------------------------------------------------------------ adding

    def add(self, records: Sequence[Record]) -> None:
        """Write the records of a task as a new part. Raises OSError."""
        if not records:
            return
        rows = [_row(record) for record in records]
        table = pa.Table.from_pylist(rows, schema=_SCHEMA)
        part = self.parts / f"{self._next:06d}.parquet"
        disk.require_room(part, table.nbytes)
        with disk.written_whole(part) as fresh:
            pq.write_table(table, fresh, compression="zstd", write_page_checksum=True)
        self._next += 1

    def add_air(self, record: AirRecord) -> None:
        """Write the record of a solved or failed air. Raises OSError."""
        with disk.written_whole(self.airs / f"{record.air}.json") as fresh:
            fresh.write_text(json.dumps(record._asdict()), encoding="utf-8")

    def film(self, air: str) -> Path:
        """Return the path of the complete film of an air."""
        return self.airs / f"{air}.zarr"

    # ------------------------------------------------------------ reading

    def latest(self) -> dict[str, Latest]:
        """Return the valid record of each run: the last finished one, else the last failed one."""
        rows: dict[str, Latest] = {}
        for part in self._files():
            table = _read(part, ["run", "status"])
            pairs = zip(table["run"].to_pylist(), table["status"].to_pylist(), strict=True)
            for n, (run, status) in enumerate(pairs):
                if run not in rows or status in DONE or rows[run].status not in DONE:
                    rows[run] = Latest(part, n, status)
        return rows

    def statuses(self) -> dict[str, str]:
        """Return the status of each recorded run: completed, stopped or failed. Raises StoreError."""
        return {run: row.status for run, row in self.latest().items()}

    def records(self) -> Iterator[Record]:
        """Yield the valid record of each recorded run. Raises StoreError."""
        rows = self.latest()
        for part in self._files():
            for n, row in enumerate(_read(part).to_pylist()):
                if row["run"] in rows and rows[row["run"]][:2] == (part, n):
                    yield _record(part, row)

    def air_records(self) -> list[AirRecord]:
        """Return the records of the filmed airs, sorted by id. Raises StoreError."""
        records = []
        for file in sorted(self.airs.glob("*.json")):
            try:
                records.append(AirRecord(**json.loads(read_regular(file, LARGEST_TEXT))))
            except (OSError, ValueError, TypeError, RecursionError):
                raise StoreError(f"{file}: is damaged; remove it") from None
        return records

    def _files(self) -> list[Path]:
        """Return the files of the parts in the order of writing. Raises StoreError if there are other files."""
        if not self.parts.is_dir():
            return []
        files = sorted(self.parts.iterdir(), key=lambda file: (len(file.name), file.name))
        files = [file for file in files if not file.name.startswith(".")]  # being written
        for file in files:
            if not _PART.fullmatch(file.name):
                raise StoreError(f"{file}: was not written by a study; remove it")
        return files


def _read(part: Path, columns: list[str] | None = None) -> pa.Table:
    """Read the rows of a part. Raises StoreError."""
    fault = unopenable(part)
    if fault:
        raise StoreError(f"{part}: {fault}")
    try:
        with pq.ParquetFile(part, page_checksum_verification=True) as file:
            if not file.schema_arrow.equals(_SCHEMA):
                raise StoreError(f"{part}: was not written by a study of this version; remove it")
            return file.read(columns)
    except (pa.ArrowException, OSError, ValueError, LookupError) as error:
        if isinstance(error, StoreError):
            raise
        reason = plain(str(error))
        raise StoreError(
            f"{part}: cannot be read: {reason}; remove it, then its runs are executed again"
        ) from None


def _row(record: Record) -> Row:
    common = {name: value for row in record.trials[:1] for name, value in row.items() if name not in _NAMES}
    for row in record.trials:
        if (
            any(row.get(name) != value for name, value in common.items())
            or row.keys() - common.keys() - _NAMES
        ):
            raise ValueError(f"run {record.run}: its trials differ in more than scores")
    trials = [{name: row.get(name) for name in _NAMES} for row in record.trials]
    return record._asdict() | {
        "told": json.dumps(common),
        "trials": trials,
        "outcomes": list(record.outcomes.items()),
        "cost": record.cost._asdict(),
    }


def _record(part: Path, row: Row) -> Record:
    try:
        common = json.loads(row["told"])
        trials = [common | scores for scores in row["trials"]]
        cost = Cost(**row["cost"])
        return Record(row["run"], row["status"], row["message"], trials, dict(row["outcomes"]), cost)
    except (ValueError, TypeError, LookupError, RecursionError):
        raise StoreError(f"{part}: is damaged; remove it, then its runs are executed again") from None


# ---------------------------------------------------------------- failed runs; without Taichi


def leave_failed(task: Task, request: Request, scenario: "Scenario | None", message: str) -> None:
    """Write the scenario and the message of a failed run, so that users can repeat the run. Raises OSError."""
    folder = task.options.out / FAILED / request.run
    folder.mkdir(parents=True, exist_ok=True)
    if scenario is not None:
        run_folder.write_scenario(folder, scenario, task.folder.resolve(), "cpu")
    with disk.written_whole(folder / "message.txt") as fresh:
        fresh.write_text(message + "\n", encoding="utf-8")


def forget_failed(task: Task, request: Request) -> None:
    """Remove the files of an earlier attempt that failed."""
    shutil.rmtree(task.options.out / FAILED / request.run, ignore_errors=True)
