"""Shards of a study: the parts of its runs that machines execute which share nothing but the study's folder.

The partition depends on the plan and on the number of shards alone. Runs of one air stay together. An air with more
runs than an even share, ceil(runs / shards), is cut into pieces of that size. The pieces go to the shards in the order
of falling size, each to the shard with the fewest runs: the greedy rule of R. L. Graham, SIAM J. Appl. Math. 17 (1969)
416, doi 10.1137/0117039.

Shards agree by files in the study's folder, which are created exclusively or renamed, as network file systems support:

    shards.json                    number of shards and hash of the plan, by the first shard
    .lock-K-of-N                   lock of a shard; its time of change is the shard's heartbeat
    airs/AIR.claim-0, -1, ...      name of the shard that solves an air; the last claim counts

A shard whose heart has not beaten for a while loses its claims. Ages are differences of the file system's own times.
"""

import hashlib
import json
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from taichi_plume.files import disk
from taichi_plume.files.own_folder import LOCK
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import open_regular, read_regular
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.studies.air_plan import shared_airs
from taichi_plume.studies.messages import Request

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Plan

MOST_SHARDS = 4096
MOST_DIGITS = 18  # of a whole number; `int` refuses thousands
MOST_LISTED = 20  # shards with missing runs that are listed
SHARDS = "shards.json"
LOG = "workers.log"  # output of workers and, with --scheduler, of Dask
BEAT_S, STALE_S = 5.0, 60.0  # between heartbeats; without one a shard counts as killed
LARGEST_TEXT = 1 << 16  # bytes of the files of shards


class Shard(NamedTuple):
    """A shard of a study. number: from 1 to `count`."""

    number: int
    count: int

    def __str__(self) -> str:
        return f"{self.number}-of-{self.count}"

    @property
    def lock(self) -> str:
        """Name of the shard's lock file."""
        return f"{LOCK}-{self}"


def shard_of(given: object, environment: Mapping[str, str] = os.environ) -> Shard:
    """Return the shard that "k/n" or the pair (k, n) gives; True: that of a SLURM job array. Raises InputError."""
    if given is True:
        return _of_array(environment)
    k, n = given if isinstance(given, tuple | list) and len(given) == 2 else (given, None)
    if isinstance(given, str) and given.count("/") == 1:
        k, n = (int(text) if _is_whole(text) else text for text in given.split("/"))
    whole = type(k) is int and type(n) is int
    if not (whole and 1 <= k <= n <= MOST_SHARDS):  # pyright: ignore[reportOperatorIssue]
        shown = visible(given, LONGEST_VALUE)
        allowed = f"k/n with whole numbers 1 <= k <= n <= {MOST_SHARDS:,}"
        raise InputError(f"shard: got {shown}; allowed is {allowed}")
    return Shard(k, n)  # pyright: ignore[reportArgumentType]


def _of_array(environment: Mapping[str, str]) -> Shard:
    """Return the shard of a task of a SLURM job array. Raises InputError."""
    found = {}
    for name, default in (("ID", None), ("COUNT", None), ("MIN", "1"), ("STEP", "1")):
        key = f"SLURM_ARRAY_TASK_{name}"
        text = environment.get(key, default)
        if text is None:
            raise InputError(f"shard: {key} is not set: this is no job array of SLURM; give k/n, such as 3/7")
        if not _is_whole(text) or (name == "STEP" and not int(text)):
            raise InputError(f"shard: {key}: got {visible(text, LONGEST_VALUE)}; allowed are whole numbers")
        found[name] = int(text)
    if found["COUNT"] > MOST_SHARDS:
        raise InputError(
            f"shard: SLURM_ARRAY_TASK_COUNT: got {found['COUNT']:,}; at most {MOST_SHARDS:,} are allowed"
        )
    steps, rest = divmod(found["ID"] - found["MIN"], found["STEP"])
    if rest or not 0 <= steps < found["COUNT"]:
        tasks = f"{found['COUNT']} tasks from {found['MIN']} in steps of {found['STEP']}"
        raise InputError(f"shard: SLURM_ARRAY_TASK_ID: got {found['ID']}, of {tasks}; give k/n, such as 3/7")
    return Shard(steps + 1, found["COUNT"])


def _is_whole(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= MOST_DIGITS


# ---------------------------------------------------------------- partition


class Part(NamedTuple):
    """Runs of a shard, in the plan's order. common: ids of the airs that the shard shares with other shards."""

    requests: tuple[Request, ...]
    common: frozenset[str]


def parts_of(plan: "Plan", count: int) -> list[Part]:
    """Return the runs of each of `count` shards of a plan."""
    shared = shared_airs(plan, plan.requests)
    units: dict[str, list[Request]] = {}  # by air, or by run
    for request in plan.requests:
        units.setdefault(request.air if request.air in shared else request.run, []).append(request)
    share = ceil(len(plan.requests) / count)
    pieces = [unit[n : n + share] for unit in units.values() for n in range(0, len(unit), share)]
    parts: list[list[Request]] = [[] for _ in range(count)]
    for piece in sorted(pieces, key=len, reverse=True):
        min(parts, key=len).extend(piece)
    cut = {air for air, unit in units.items() if len(unit) > share}
    return [
        Part(
            tuple(sorted(part, key=lambda request: request.number)),
            frozenset(cut & {request.air for request in part}),
        )
        for part in parts
    ]


def shards_with(plan: "Plan", count: int, missing: Sequence[Request]) -> list[str]:
    """Return a line with the shards that have missing runs, such as 2/7 (12 runs), 5/7 (1 run); none if none has."""
    runs = {request.run for request in missing}
    counts = [sum(request.run in runs for request in part.requests) for part in parts_of(plan, count)]
    lack = [f"{k}/{count} ({n:,} run{'s' * (n > 1)})" for k, n in enumerate(counts, 1) if n]
    more = f" and {len(lack) - MOST_LISTED} more" * (len(lack) > MOST_LISTED)
    return [f"shards with missing runs: {', '.join(lack[:MOST_LISTED])}{more}"] if lack else []


# ---------------------------------------------------------------- in the study's folder


def agreed(folder: Path, plan: "Plan", count: int | None = None) -> int | None:
    """Return the number of shards in a study's folder, None if it has none; with `count`, begin such shards.

    Raises ValueError, whose message is a line, if the folder has shards of another plan or another number of shards;
    and OSError.
    """
    file, ours = folder / SHARDS, {"shards": count, "plan": _digest(plan)}
    if count is not None and not file.exists():
        with suppress(FileExistsError), disk.written_whole(file, replace=False) as fresh:
            fresh.write_text(json.dumps(ours) + "\n", encoding="utf-8")
    try:
        held = json.loads(read_regular(file, LARGEST_TEXT))
        shards, digest = int(held["shards"]), held["plan"]
    except FileNotFoundError:
        return None
    except (ValueError, TypeError, LookupError, RecursionError):
        raise ValueError(f"{file}: is damaged; remove it") from None
    if digest != ours["plan"]:
        raise ValueError(
            f"{folder}: holds shards of another study: the study, its base, an input file or the version has changed; "
            f"choose another --out, or remove {file} when no shard runs"
        )
    if count not in (None, shards):
        raise ValueError(f"{folder}: is made in {shards} shards, got k/{count}; give k/{shards}")
    return shards


def _digest(plan: "Plan") -> str:
    texts = {name: hashlib.sha256(text).hexdigest() for name, text in plan.texts.items()}
    content = json.dumps([texts, [request.run for request in plan.requests]], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


class Heart:
    """Heartbeat of a process that writes to a study's folder: the time of change of its lock file `lock`."""

    def __init__(self, lock: Path):
        self.lock = lock
        self._beaten = float("-inf")
        self.beat()

    def beat(self) -> None:
        """Change the time of the lock file, unless the time is recent. Raises OSError."""
        if time.monotonic() - self._beaten > BEAT_S:
            os.utime(self.lock)
            self._beaten = time.monotonic()

    def stop(self) -> None:
        """Show that the process has ended."""
        with suppress(OSError):
            os.utime(self.lock, (0, 0))

    def alive(self, lock: Path) -> bool:
        """Return whether the process of another lock file has shown a heartbeat of late."""
        now = _beaten(self.lock) + time.monotonic() - self._beaten  # the file system's time
        return _beaten(lock) > now - STALE_S


def _beaten(lock: Path) -> float:
    """Return the time of the last heartbeat at a lock file; minus infinity without one.

    The file is opened, since network file systems may otherwise return a time of half a minute ago.
    """
    try:
        with open_regular(lock) as file:
            return os.fstat(file.fileno()).st_mtime
    except OSError:
        return float("-inf")


def locks(folder: Path) -> list[str]:
    """Return the names of the lock files of all shards in a study's folder."""
    return sorted(file.name for file in folder.glob(f"{LOCK}-*-of-*"))


def log_of(lock: str) -> str:
    """Return the name of the log of the workers of the process that has a lock file of this name."""
    return LOG if lock == LOCK else f"workers.{lock.removeprefix(f'{LOCK}-')}.log"


class Claims:
    """Claims of a shard on the solution of the airs that the shard shares with other shards.

    folder: of the study; common: ids of these airs; heart: of the shard's process.
    """

    def __init__(self, folder: Path, shard: Shard, common: frozenset[str], heart: Heart):
        self.folder, self.airs, self.heart = folder, folder / "airs", heart
        self.shard, self.common = shard, common

    def solver(self, air: str) -> str | None:
        """Return the name of the other shard that solves an air; None if no running shard does."""
        owner = self._last(air)[1]
        return owner if owner not in ("", str(self.shard)) and self._alive(owner) else None

    def claim(self, air: str) -> bool:
        """Claim the solution of an air; return whether the shard has the claim. Take over a killed shard's claim."""
        if air not in self.common:
            return True
        number, owner = self._last(air)
        if owner == str(self.shard):
            return True  # from before the shard was killed
        if owner and self._alive(owner):
            return False
        try:
            with disk.written_whole(self.airs / f"{air}.claim-{number + 1}", replace=False) as fresh:
                fresh.write_text(str(self.shard))
        except FileExistsError:
            return False
        return True

    def owns(self, air: str) -> bool:
        """Return whether no other shard has claimed the solution of an air since."""
        return air not in self.common or self._last(air)[1] == str(self.shard)

    def _alive(self, owner: str) -> bool:
        return self.heart.alive(self.folder / f"{LOCK}-{owner}")

    def _last(self, air: str) -> tuple[int, str]:
        """Return number and owner of the last claim on an air; (-1, "") without a claim."""
        ends = (file.name.rpartition("-")[2] for file in self.airs.glob(f"{air}.claim-*"))
        number = max((int(end) for end in ends if end.isdigit()), default=-1)
        try:
            return number, read_regular(self.airs / f"{air}.claim-{number}", LARGEST_TEXT).decode()
        except (OSError, ValueError):  # there is none, or it was just removed
            return -1, ""
