"""Folder of a study: records of finished runs, a Parquet file per batch of runs. Files are written atomically.

study.yaml and base.yaml are copies of the user's files; plan.parquet lists the runs of the plan. ``parts/`` holds the
records of the batches: a row per run, with the trials as a list. ``kept/`` and ``failed/`` hold files of single runs.
One process at a time writes to the folder; other processes may read.
"""

import json
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self

import pyarrow as pa

from taichi_plume.files import disk, own_folder, parquet, run_folder
from taichi_plume.files.tables import plain
from taichi_plume.guard.safe_open import read_regular
from taichi_plume.scenario.loading import ScenarioError, scenario_of
from taichi_plume.studies import columns, tables
from taichi_plume.studies.messages import AirRecord, Cost, Record, Request, Task

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Plan

KIND = "study"  # study.json marks the folder of a study
PARTS, AIRS, KEPT_FOLDER, FAILED = "parts", "airs", "kept", "failed"
FORMAT = "taichi_plume study 1"
LARGEST_RECORD = 1 << 24  # most bytes of the record of an air
DONE = ("completed", "stopped")

_PART = re.compile(r"\d{6,}\.parquet")
_SCORES = pa.struct([(field.name, field.type) for field in columns.TRIAL])
_COST = pa.struct([(field.name, field.type) for field in columns.COST if field.name != "run"])
_SCHEMA = pa.schema(
    [
        ("run", pa.string()),
        ("status", pa.string()),
        ("message", pa.string()),
        ("trials", pa.list_(_SCORES)),
        ("outcomes", pa.map_(pa.string(), pa.float64())),
        ("cost", _COST),
    ],
    {"format": FORMAT},
)


class StoreError(ValueError):
    """Error of a study's folder; the message is one line and begins with the path."""


class Store:
    """Records of runs in the folder of a parameter study. Readers need no lock.

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
        """Unlock the study's folder, if this process has locked it."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    # ------------------------------------------------------------ beginning

    def begin(self, plan: "Plan", force: bool = False) -> None:
        """Lock the study's folder and prepare it for the runs of a plan. Existing records of the plan's runs stay.

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
            for name, text in plan.texts.items():
                self._keep(name, text)
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
        refusal = own_folder.refusal(self.folder, KIND)
        if refusal:
            raise StoreError(refusal)

    def _drop_others(self, planned: set[str], force: bool) -> None:
        """Raise StoreError if the folder holds runs that are not in `planned`; with `force` delete these runs."""
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
                tables.write(part, rest)
            else:
                part.unlink()
        for run in others:
            for folder in (KEPT_FOLDER, FAILED):
                disk.discard(self.folder / folder / run)

    def _tidy(self) -> None:
        """Delete unfinished files and films that a killed process left in the study's folder."""
        for folder in (self.folder, self.parts, self.airs):
            for left in disk.left_in(folder):
                left.unlink()
        for film in self.airs.glob("*.zarr.*.part"):
            disk.discard(film)

    def _keep(self, name: str, content: bytes) -> None:
        held = self.folder / name
        if held.is_file() and read_regular(held) != content:
            for film in self.airs.glob("*.zarr"):  # the changed study's runs may last longer
                disk.discard(film)
        with disk.written_whole(held) as fresh:
            fresh.write_bytes(content)

    # ------------------------------------------------------------ adding

    def add(self, records: Sequence[Record]) -> None:
        """Write the records of a batch of runs to the folder as a new Parquet file. Raises OSError."""
        if not records:
            return
        tables.write(self.parts / f"{self._next:06d}.parquet", table_of(records))
        self._next += 1

    def add_air(self, record: AirRecord) -> None:
        """Write the record of an air (flow and gas that several runs share), solved or failed. Raises OSError."""
        with disk.written_whole(self.airs / f"{record.air}.json") as fresh:
            fresh.write_text(json.dumps(record._asdict()), encoding="utf-8")

    def film(self, air: str) -> Path:
        """Return the path of the complete film of an air, the recorded flow and gas that several runs share."""
        return self.airs / f"{air}.zarr"

    # ------------------------------------------------------------ reading

    def table(self, names: Sequence[str] = _SCHEMA.names) -> pa.Table:
        """Return a table with one record per run: the last finished one, else the last failed one. Raises StoreError.

        names: columns to read, at least `run` and `status`.
        """
        parts = [_read(part, names) for part in self._files()]
        table = pa.concat_tables([_SCHEMA.empty_table().select(names), *parts])
        runs, statuses = table["run"].to_pylist(), table["status"].to_pylist()
        rows: dict[str, int] = {}
        for row, (run, status) in enumerate(zip(runs, statuses, strict=True)):
            if run not in rows or status in DONE or statuses[rows[run]] not in DONE:
                rows[run] = row
        return table.take(pa.array(sorted(rows.values()), pa.int64()))

    def statuses(self) -> dict[str, str]:
        """Return the status (completed, stopped or failed) of each recorded run, by run id. Raises StoreError."""
        table = self.table(("run", "status"))
        return dict(zip(table["run"].to_pylist(), table["status"].to_pylist(), strict=True))

    def records(self) -> list[Record]:
        """Return one record per run: the last finished one, else the last failed one. Raises StoreError."""
        return [
            Record(**row | {"outcomes": dict(row["outcomes"]), "cost": Cost(**row["cost"])})
            for row in self.table().to_pylist()
        ]

    def air_records(self) -> list[AirRecord]:
        """Return the records of airs (flow and gas that runs share), sorted by file name. Raises StoreError."""
        records = []
        for file in sorted(self.airs.glob("*.json")):
            try:
                records.append(AirRecord(**json.loads(read_regular(file, LARGEST_RECORD))))
            except (OSError, ValueError, TypeError, RecursionError):
                raise StoreError(f"{file}: is damaged; remove it") from None
        return records

    def _files(self) -> list[Path]:
        """Return the Parquet files of run records, oldest first. Raises StoreError if there are other files."""
        if not self.parts.is_dir():
            return []
        files = sorted(self.parts.iterdir(), key=lambda file: (len(file.name), file.name))
        files = [file for file in files if not file.name.startswith(".")]  # being written
        for file in files:
            if not _PART.fullmatch(file.name):
                raise StoreError(f"{file}: was not written by a study; remove it")
        return files


def _read(part: Path, names: Sequence[str] = _SCHEMA.names) -> pa.Table:
    """Read columns of a Parquet file of run records. Raises StoreError if it is damaged or has another format."""
    try:
        with parquet.opened(part) as file:
            known = [field for field in file.schema_arrow if field.name in _SCHEMA.names]
            if not pa.schema(known).equals(_SCHEMA):
                raise StoreError(f"{part}: was not written by a study of this version; remove it")
            return file.read(names, use_threads=False)
    except (pa.ArrowException, OSError, ValueError, LookupError) as error:
        if isinstance(error, StoreError):
            raise
        reason = plain(str(error))
        raise StoreError(
            f"{part}: cannot be read: {reason}; remove it, then its runs are executed again"
        ) from None


def table_of(records: Iterable[Record]) -> pa.Table:
    """Return an Arrow table of run records, in the format of the Parquet files in ``parts/``."""
    rows = [
        record._asdict() | {"outcomes": list(record.outcomes.items()), "cost": record.cost._asdict()}
        for record in records
    ]
    return pa.Table.from_pylist(rows, _SCHEMA)


# ---------------------------------------------------------------- failed runs; without Taichi


def leave_failed(task: Task, request: Request, message: str) -> None:
    """Write scenario (if valid) and message of a failed run into ``failed/``, to be repeated. Raises OSError."""
    folder = task.options.out / FAILED / request.run
    folder.mkdir(parents=True, exist_ok=True)
    with suppress(ScenarioError):
        scenario = scenario_of(task.base, request.changes)
        run_folder.write_scenario(folder, scenario, task.folder.resolve(), "cpu")
    with disk.written_whole(folder / "message.txt") as fresh:
        fresh.write_text(message + "\n", encoding="utf-8")


def forget_failed(task: Task, request: Request) -> None:
    """Delete the files that an earlier, failed attempt of the run left in the study's folder."""
    disk.discard(task.options.out / FAILED / request.run)
