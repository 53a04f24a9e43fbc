"""Folder of a study: records of finished runs, a Parquet file per batch of runs. Files are written atomically.

study.yaml and base.yaml are copies of the user's files; plan.parquet lists the runs of the plan. ``parts/`` holds the
records of the batches: a row per run, with the trials as a list. ``kept/`` and ``failed/`` hold files of single runs.
One process at a time writes to the folder, or one for each shard (`studies/shards.py`); other processes may read.
"""

import json
import re
import shutil
import time
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self

import pyarrow as pa

from taichi_plume.files import disk, own_folder, parquet, run_folder
from taichi_plume.files.tables import plain
from taichi_plume.guard.safe_open import open_regular, read_regular
from taichi_plume.scenario.loading import ScenarioError, scenario_of
from taichi_plume.studies import columns, tables
from taichi_plume.studies.messages import AirRecord, Cost, Record, Request, Task
from taichi_plume.studies.shards import LOG, SHARDS, STALE_S, Claims, Heart, Shard, agreed, locks, log_of

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Plan

KIND = "study"  # study.json marks the folder of a study
PARTS, AIRS, KEPT_FOLDER, FAILED = "parts", "airs", "kept", "failed"
FORMAT = "taichi_plume study 1"
LARGEST_RECORD = 1 << 24  # most bytes of the record of an air
DONE = ("completed", "stopped")
WAIT_S = 0.5  # between looks whether a merge has ended

_PART = re.compile(r"(\d{6,})(\.\d+-of-\d+)?\.parquet")  # of a shard, if the second group is there
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

    `begin` locks the folder for this process until `close` or the end of the context. shard: the shard of the study
    that the process executes; the lock is the shard's then. common: ids of airs that other shards need as well.
    """

    def __init__(self, folder: Path, shard: Shard | None = None, common: Collection[str] = ()):
        self.folder, self.parts, self.airs = folder, folder / PARTS, folder / AIRS
        self.shard, self.common = shard, frozenset(common)
        self.claims: Claims | None = None
        self._next = 0
        self._lock: own_folder.FolderLock | None = None
        self._heart: Heart | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Unlock the study's folder, if this process has locked it."""
        if self._lock is not None:
            if self._heart is not None:
                self._heart.stop()
            self._lock.release()
            self._lock = self._heart = None

    # ------------------------------------------------------------ beginning

    def begin(self, plan: "Plan", force: bool = False) -> None:
        """Lock the study's folder and prepare it for the runs of a plan. Existing records of the plan's runs stay.

        force: remove runs that are not in the plan. A shard waits while its study is merged. Raises StoreError, also if
        another process has locked the folder, and OSError if the disk is full.
        """
        heart, end = self._hold(), time.monotonic() + STALE_S
        while self.shard and self.running(heart, [own_folder.LOCK]) and time.monotonic() < end:
            self.close()  # a merge is probably running, which may delete the locks of shards
            time.sleep(WAIT_S)
            heart = self._hold()
        try:
            if self.shard is not None:
                self._require_alone(heart, [own_folder.LOCK])
                _agreed(self.folder, plan)
            else:
                self._require_alone(heart, locks(self.folder))
            self._drop_others({request.run for request in plan.requests}, force)
            if self.shard is not None:
                _agreed(self.folder, plan, self.shard.count)
                self.claims = Claims(self.folder, self.shard, self.common, heart)
            own_folder.mark(self.folder, KIND)
            for folder in (self.parts, self.airs):
                folder.mkdir(exist_ok=True)
            self._tidy()
            for name, text in plan.texts.items():
                self._keep(name, text)
            tables.write_plan(self.folder, plan)
            self._next = self._free()
            if self.shard is None:
                self._end_shards()
        except BaseException:
            self.close()
            raise

    def merge(self, plan: "Plan") -> int | None:
        """Lock the study's folder to merge its shards; return their number, None if there are none any more.

        If all runs are recorded and no shard runs, rewrite the records of all shards as one file, and delete what else
        shards leave. Raises StoreError, also if the folder holds another study, and OSError.
        """
        if not (self.folder / tables.PLAN).is_file():
            raise StoreError(f"{self.folder}: is not the folder of a study")
        heart = self._hold()
        count = _agreed(self.folder, plan)
        if not _same_plan(self.folder, plan):
            raise StoreError(
                f"{self.folder}: holds another study, or the study, its base or the version has changed"
            )
        if count is None or self.running(heart, locks(self.folder)):
            return count
        table, files = self.table(), self._files()
        if {request.run for request in plan.requests} <= set(table["run"].to_pylist()):
            tables.write(self.parts / f"{self._free():06d}.parquet", table)
            for file in (*files, *(file for file in self.airs.iterdir() if file.suffix != ".json")):
                disk.discard(file)
                heart.beat()
            self._end_shards()
        return count

    def _end_shards(self) -> None:
        """Delete the files by which shards agree, and put their logs together."""
        names = locks(self.folder)
        logs = [log for name in names if (log := self.folder / log_of(name)).is_file()]
        filled = [log for log in logs if log.stat().st_size]
        if filled:
            with disk.written_whole(self.folder / LOG) as fresh, fresh.open("wb") as whole:
                for log in filter(Path.is_file, [self.folder / LOG, *filled]):
                    with open_regular(log) as part:
                        shutil.copyfileobj(part, whole)
        for file in [*logs, *(self.folder / name for name in names), self.folder / SHARDS]:
            disk.discard(file)

    def running(self, heart: Heart, names: Iterable[str]) -> list[str]:
        """Return the names of the lock files of processes that write to the folder, among `names`."""
        return [name for name in names if heart.alive(self.folder / name)]

    def _require_alone(self, heart: Heart, names: Iterable[str]) -> None:
        """Raise StoreError if a process that has one of these lock files writes to the folder."""
        running = self.running(heart, names)
        if running:
            shards = [name.removeprefix(f"{own_folder.LOCK}-") for name in running if name != own_folder.LOCK]
            who = f"shards ({', '.join(sorted(shards)[:3])}) are" if shards else "a study without shards is"
            raise StoreError(
                f"{self.folder}: {who} running there, or killed within the last {STALE_S:.0f} s; try again later"
            )

    def _hold(self) -> Heart:
        import filelock

        name = own_folder.LOCK if self.shard is None else self.shard.lock
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if self.shard is not None:  # first of all, since other shards may begin at the same moment
                self._require_ours()
                own_folder.mark(self.folder, KIND)
            self._lock = own_folder.FolderLock(self.folder, self._require_ours, name)
            self._heart = Heart(self.folder / name)
            return self._heart
        except filelock.Timeout:
            what = "another study" if self.shard is None else f"shard {self.shard}"
            raise StoreError(f"{self.folder}: {what} is running there") from None
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
            without_shard = "" if self.shard is None else ", without --shard,"
            raise StoreError(
                f"{self.folder}: holds {len(others):,} run{'s' * (len(others) > 1)} that this study does not have "
                f"({others[0]}{' ...' * (len(others) > 1)}): it is another study's folder, or the base, an axis, an "
                f"input file or the version has changed; choose another --out, or add --force{without_shard} to remove "
                "these runs"
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
        if self.shard is not None:  # other files may be those of other shards
            for left in disk.left_in(self.parts):
                if f".{self.shard}.parquet." in left.name:
                    left.unlink()
            return
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
        disk.write_changed(held, content)

    def _free(self) -> int:
        """Return a number above those of all files of records."""
        return 1 + max((_number(file) for file in self._files()), default=-1)

    # ------------------------------------------------------------ adding

    def add(self, records: Sequence[Record]) -> None:
        """Write the records of a batch of runs to the folder as a new Parquet file. Raises OSError."""
        if not records:
            return
        of_shard = "" if self.shard is None else f".{self.shard}"
        tables.write(self.parts / f"{self._next:06d}{of_shard}.parquet", table_of(records))
        self._next += 1

    def add_air(self, record: AirRecord) -> None:
        """Write the record of an air (flow and gas that several runs share), solved or failed. Raises OSError."""
        with disk.written_whole(self.airs / f"{record.air}.json") as fresh:
            fresh.write_text(json.dumps(record._asdict()), encoding="utf-8")

    def failure(self, air: str) -> str:
        """Return why another shard could not solve an air; "" if none has failed. Raises StoreError."""
        file = self.airs / f"{air}.json"
        shared = self.claims is not None and air in self.claims.common
        record = _air_record(file) if shared else None
        return record.message if record is not None else ""

    def forget_failures(self, airs: Collection[str]) -> None:
        """Delete the records of failed airs among `airs`, which are solved again. Raises StoreError."""
        for record in self.air_records():
            if record.message and record.air in airs:
                disk.discard(self.airs / f"{record.air}.json")

    def beat(self) -> None:
        """Show other machines that this process writes to the folder."""
        if self._heart is not None:
            self._heart.beat()

    def forget_air(self, air: str) -> None:
        """Delete the film of an air, and the claims of shards on the air."""
        disk.discard(self.film(air))
        for claim in self.airs.glob(f"{air}.claim-*"):
            disk.discard(claim)

    def film(self, air: str) -> Path:
        """Return the path of the complete film of an air, the recorded flow and gas that several runs share."""
        return self.airs / f"{air}.zarr"

    # ------------------------------------------------------------ reading

    def table(self, names: Sequence[str] = _SCHEMA.names) -> pa.Table:
        """Return a table with one record per run: the last finished one, else the last failed one. Raises StoreError.

        names: columns to read, at least `run` and `status`.
        """
        files = self._files()
        try:
            parts = [_read(part, names) for part in files]
        except StoreError:
            if all(part.exists() for part in files):
                raise
            return self.table(names)  # a merge has replaced the files meanwhile
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
        records = (_air_record(file) for file in sorted(self.airs.glob("*.json")))
        return [record for record in records if record is not None]

    def _files(self) -> list[Path]:
        """Return the Parquet files of run records, oldest first. Raises StoreError if there are other files."""
        if not self.parts.is_dir():
            return []
        files = [file for file in self.parts.iterdir() if not file.name.startswith(".")]  # being written
        for file in files:
            if not _PART.fullmatch(file.name):
                raise StoreError(f"{file}: was not written by a study; remove it")
        return sorted(files, key=lambda file: (_number(file), file.name))


def _number(part: Path) -> int:
    return int(part.name.partition(".")[0])


def _air_record(file: Path) -> AirRecord | None:
    """Return the record of an air; None if there is none, as another shard may just have deleted it."""
    try:
        return AirRecord(**json.loads(read_regular(file, LARGEST_RECORD)))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, RecursionError):
        raise StoreError(f"{file}: is damaged; remove it") from None


def _same_plan(folder: Path, plan: "Plan") -> bool:
    """Return whether a study's folder holds the runs of this plan."""
    try:
        held = tables.read_plan(folder).table
    except (pa.ArrowException, OSError, ValueError, LookupError):
        return False
    return held.equals(tables.planned(plan).table, check_metadata=True)


def _agreed(folder: Path, plan: "Plan", count: int | None = None) -> int | None:
    try:
        return agreed(folder, plan, count)
    except ValueError as error:
        raise StoreError(str(error)) from None


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
