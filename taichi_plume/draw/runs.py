"""A run: the command in a process of its own, which outlives page and server, or a folder of an earlier run."""

import json
import os
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.draw.document import data_of
from taichi_plume.draw.objects import Scene, named, names, scene
from taichi_plume.execution.latest_instant import Instant, read
from taichi_plume.execution.summary import ending, robots_found
from taichi_plume.files import disk
from taichi_plume.files.disk import written_whole
from taichi_plume.files.own_folder import is_locked
from taichi_plume.files.run_folder import KILLED, read_json
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import read_regular
from taichi_plume.guard.terminal import visible
from taichi_plume.guard.yaml_text import LineError
from taichi_plume.scenario.loading import read_scenario
from taichi_plume.scenario.readable_yaml import own_keys, without_defaults

if TYPE_CHECKING:
    from taichi_plume.draw.past import Past

MOST_LINES = 12  # of the command's output that are shown
MOST_CHANGES = 3  # keys, in the list
LISTED = 10  # runs, beside those that are pinned
LABEL = "draw.json"  # name and pin of a run, in its folder
LONGEST_NAME = 60  # characters, of the name of a run
MOST_BYTES = 1 << 27  # of the pictures of a run that goes on


class Run:
    """A run, of the session or of an earlier one. number: from 1; folder: of its files; before: the previous run.

    made_by: name of the file that a folder has from its start on.
    text: by default that of the folder's scenario, without defaults; scene: objects of the text, for all pages.
    """

    made_by = "result.json"

    def __init__(
        self,
        number: int,
        folder: Path,
        text: str | None = None,
        before: "Run | None" = None,
        scene: Scene | None = None,
    ):
        self.number, self.folder, self.before = number, folder, before
        self._text, self._scene = text, scene
        self.discarded = False
        self.notes: Path | None = None
        self.scenario: Path | None = None  # a copy of the text for the run alone
        self._inputs: list[Path] = []
        self.process: subprocess.Popen[bytes] | None = None
        self.begun = time.monotonic()
        self.wall: float | None = None
        self.stopping = False
        self.sight: Instant | None = None
        self._moment: tuple[float, float, Instant] | None = None
        self._sights: list[Instant] = []  # of a run that goes on, without trails and readings
        self._result: Mapping[str, Any] | None = None
        self._unwritten = False  # the label

    @cached_property
    def text(self) -> str:
        """Text of the scenario; empty if it cannot be read."""
        if self._text is not None:
            return self._text
        try:
            return own_keys(without_defaults(read_scenario(self.folder / "scenario.yaml")), exact=True)
        except (InputError, LineError, OSError):
            return ""

    @cached_property
    def scene(self) -> Scene:
        """Objects of the text."""
        return self._scene or scene(self.text, self.folder, False)

    @cached_property
    def changes(self) -> str:
        """Differences from the previous run in words."""
        try:
            return changes(self.before.text, self.text) if self.before is not None else ""
        except LineError:  # a room of repeats that is no YAML
            return ""

    @property
    def begun_here(self) -> bool:
        """Whether the run was started in this session."""
        return self._text is not None

    @cached_property
    def label(self) -> tuple[str, bool]:
        """Name that a user has given to the run, or "", and whether the run is pinned."""
        content = read_json(self.folder / LABEL)
        return visible(str(content.get("name", "")), LONGEST_NAME), content.get("pinned") is True

    @property
    def name(self) -> str:
        """Name that a user has given to the run, else that of its folder."""
        return self.label[0] or self.folder.name

    @property
    def pinned(self) -> bool:
        """Whether the run stays in the list, and is not removed."""
        return self.label[1]

    def mark(self, name: str, pinned: bool) -> None:
        """Give the run a name and pin it, or not, by a file in its folder once this is there. Raises InputError."""
        self.label, self._unwritten = (visible(name.strip(), LONGEST_NAME), pinned), True
        self._write_label()

    def _write_label(self) -> None:
        """Write the label, unless it is written, or the folder of the run is not made yet: a run takes an empty one."""
        if not self._unwritten or not (self.folder / self.made_by).is_file() or self.folder.is_symlink():
            return
        name, pinned = self.label
        try:
            with written_whole(self.folder / LABEL) as fresh:
                fresh.write_text(json.dumps({"name": name, "pinned": pinned}) + "\n", encoding="utf-8")
        except OSError as error:
            raise InputError(f"{self.folder.name}: its name is not kept: {error.strerror or error}") from None
        self._unwritten = False

    @property
    def elsewhere(self) -> bool:
        """Whether another program is writing the run, which was not started in this session."""
        return not self.begun_here and self.result.get("status") == "running" and is_locked(self.folder)

    @property
    def alive(self) -> bool:
        """Whether the run's process has not ended."""
        return self.process is not None and self.process.poll() is None

    @property
    def state(self) -> str:
        """State in a word: starting, compiling, warm-up, running, stopping, or how the run ended."""
        if self.alive:
            return "stopping" if self.stopping else self.phase
        status = str(self.result.get("status") or "failed")
        if status in ("running", KILLED):  # the file of a run that was killed still says "running"
            return "running" if self.elsewhere else "interrupted"
        return status

    @property
    def words(self) -> str:
        """State in words: "source found" or "ended early" of a run that ended before its duration."""
        return "running elsewhere" if self.elsewhere else ending({**self.result, "status": self.state})

    @property
    def why(self) -> str:
        """Reason in a line why the run has ended, "" without one: of a failure, its error."""
        if self.alive:
            return ""
        message, state = str(self.result.get("message") or ""), self.state
        if not message and state == "interrupted" and self.past is not None:
            message = f"computed until {self.recorded[1]:.1f} of {self.past.run.scenario.duration:g} s"
        lines = [line for line in self.output if not line.startswith("note:")] if state == "failed" else []
        return visible(message) or next(iter(lines), "")

    @property
    def result(self) -> Mapping[str, Any]:
        """Content of the run's result.json; empty if there is none. Read once after the end."""
        if self._result is not None:
            return self._result
        content = read_json(self.folder / "result.json")
        if self.wall is not None or (not self.begun_here and content.get("status") != "running"):
            self._result = content
        return content

    @property
    def output(self) -> list[str]:
        """Last lines that the command has printed."""
        if self.notes is None:
            return []
        try:
            text = read_regular(self.notes / "output.txt").decode(errors="replace")
        except OSError:
            return []
        return [visible(line) for line in text.splitlines() if line.strip()][-MOST_LINES:]

    @property
    def phase(self) -> str:
        """Phase of the run that goes on: starting, compiling, warm-up or running."""
        return self.sight.phase if self.sight is not None else "starting"

    @property
    def done(self) -> float:
        """Completed fraction."""
        return self.sight.done if self.sight is not None else 0.0

    @property
    def clock(self) -> str:
        """Progress in words, such as "3.2 of 10 s"."""
        return f"{self.sight.t:.1f} of {self.sight.end:g} s" if self.sight is not None else ""

    @property
    def left(self) -> float | None:
        """Wall-clock time left [s], by the speed so far; None before it is known, and after the end."""
        sight = self.sight
        if sight is None or not self.alive or sight.phase == "compiling" or sight.speed <= 0:
            return None
        return max(0.0, (sight.end - sight.t) / sight.speed)

    def start(self, folder: Path, root: Path, flags: list[str]) -> None:
        """Start the command in a session of its own: neither Ctrl-C nor the end of the server reaches it.

        folder: of the files that the text names; root: in which the command works. Raises InputError.
        """
        self.notes = Path(tempfile.mkdtemp(prefix="taichi_plume-draw-"))
        self.scenario = folder / f".{self.folder.name}.run-{secrets.token_hex(4)}.yaml"
        command, texts = self._command(self.scenario)
        self._inputs = list(texts)
        command = [sys.executable, "-m", *command, *flags]
        own: dict[str, Any] = {"start_new_session": True}
        if os.name == "nt":
            own = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}  # pyright: ignore[reportAttributeAccessIssue]
        try:
            for file, text in texts.items():
                with written_whole(file) as fresh:
                    fresh.write_bytes(text.encode("utf-8"))
            with (self.notes / "output.txt").open("wb") as file:
                self.process = subprocess.Popen(
                    command, cwd=root, stdin=subprocess.DEVNULL, stdout=file, stderr=file, **own
                )
        except OSError as error:
            self._remove_inputs()
            raise InputError(f"{error.filename or self.scenario}: {error.strerror or error}") from None

    def _command(self, scenario: Path) -> tuple[list[str], dict[Path, str]]:
        """Return module and arguments of the command, and the texts of the files that only this command reads."""
        assert self.notes is not None
        watch = ["--watch", str(self.notes / "watch.npz")]
        return ["taichi_plume.run", str(scenario), "--out", str(self.folder), *watch], {scenario: self.text}

    def _remove_inputs(self) -> None:
        for file in self._inputs:
            file.unlink(missing_ok=True)

    def stop(self) -> None:
        """Ask the run to end, as Ctrl-C does: its files are completed, and it can be resumed."""
        if self.process is not None and self.alive:
            self.stopping = True
            with suppress(OSError):
                self.process.send_signal(signal.SIGINT if os.name != "nt" else signal.CTRL_BREAK_EVENT)  # pyright: ignore[reportAttributeAccessIssue]

    def poll(self) -> None:
        """Read the state of the run; after its end, remove the copy of its text."""
        sight = read(self.notes / "watch.npz") if self.notes is not None else None
        if sight is not None and (self.sight is None or sight.t != self.sight.t):
            self.see(sight)
        with suppress(InputError):  # tried again
            self._write_label()
        if not self.alive and self.wall is None:
            self.wall = time.monotonic() - self.begun
            if self.sight is not None and self.past is not None:
                self.sight = self.sight._replace(pictures=self.sight.pictures | self.past.maps)
            self._remove_inputs()

    def see(self, sight: Instant) -> None:
        """Take the latest state; earlier ones stay to be looked at, every other one once they are too many."""
        self.sight = sight
        self._sights.append(sight._replace(trails=(), readings=sight.readings[:0]))
        if len(self._sights) * sum(of.values.nbytes for of in sight.pictures.values()) > MOST_BYTES:
            del self._sights[1::2]

    @property
    def recorded(self) -> tuple[float, float]:
        """First and last time [s] of which the run shows moments; equal if there is none."""
        if self.alive or (self._sights and self.wall is None):
            return (self._sights[0].t, self._sights[-1].t) if self._sights else (0.0, 0.0)
        times = self.past.times if self.past is not None else np.empty(0)
        return (float(times[0]), float(times[-1])) if len(times) else (0.0, 0.0)

    @property
    def past(self) -> "Past | None":
        """Recorded moments of the run, which has ended; None without such a record."""
        return None if self.elsewhere else self._past

    @cached_property
    def _past(self) -> "Past | None":
        from taichi_plume.draw.past import Past  # imports xarray

        try:
            return Past(self.folder)
        except InputError:
            return None

    def moment(self, t: float) -> Instant | None:
        """Return the run at a time [s]: the last moment known until then; None without one."""
        if not self.alive and not (self._sights and self.wall is None):
            return self.past.at(t) if self.past is not None else None
        live, n = self.sight, bisect_right(self._sights, t + 1e-6, key=lambda each: each.t)
        if live is None or not self._sights:
            return None
        if self._moment is None or self._moment[:2] != (t, live.t):
            until = int(np.searchsorted(live.readings[:, 0], t, side="right"))
            trails = [way[:, :until] for way in live.trails]
            seen = self._sights[max(0, n - 1)]._replace(readings=live.readings, trails=trails)
            self._moment = t, live.t, seen
        return self._moment[2]

    def close(self) -> None:
        """Remove the notes of an ended run; a run that is alive still writes them."""
        if not self.alive:
            self.poll()
            if self.notes is not None:
                disk.discard(self.notes)

    def found(self, full: bool = False) -> list[str]:
        """Return how many robots of each group found a source, such as "team: 1 of 2 robots, the first in 8 s".

        full: as a sentence.
        """
        try:
            return [] if self.alive else list(_found(self.result, full))
        except (AttributeError, LookupError, TypeError, ValueError):  # result.json is of another program
            return []

    def row(self) -> dict[str, str]:
        """Return the run's row in the list of runs: texts by column."""
        result = self.result
        wall = self.wall if self.begun_here else result.get("wall_s")
        simulated = result.get("simulated_s") if not self.alive else None
        return {
            "run": str(self.number),
            "name": "★ " * self.pinned + self.name,
            "state": self.words,
            "found": "; ".join(self.found()),
            "changed": self.changes,
            "simulated": f"{simulated:.0f} s" if isinstance(simulated, int | float) else "",
            "took": f"{wall:.0f} s" if isinstance(wall, int | float) else "",
        }


def _found(result: Mapping[str, Any], full: bool) -> Iterator[str]:
    """Yield the line of each group that searches; see `Run.found`."""
    for group in result.get("groups") or []:
        if group.get("per_trial") and not group["no_search"]:
            seconds = group["summary"]["time_s"]["mean"]
            verb = " found the source" if full else ""
            first = f", the first in {seconds:.0f} s" if seconds is not None else ""
            yield f"{group['name']}: {robots_found(group)}{verb}{first}"


def runs_in(above: Path) -> list[tuple[float, Path]]:
    """Return times of change and paths of the folders in a folder that hold a run; no links."""
    found = []
    for folder in above.iterdir() if above.is_dir() and not above.is_symlink() else ():
        file = folder / "result.json"
        if not folder.is_symlink() and file.is_file() and (folder / "scenario.yaml").is_file():
            found.append((file.stat().st_mtime, folder))
    return found


def changes(before: str, after: str) -> str:
    """Return in words which keys differ between two texts, such as "seed: 1 → 2"."""
    old, new = dict(_leaves(data_of(before))), dict(_leaves(data_of(after)))
    paths = [
        path for path in [*new, *(path for path in old if path not in new)] if old.get(path) != new.get(path)
    ]
    by_path = names(data_of(before)) | names(data_of(after))
    words = [
        f"{named(path, by_path)}: {old.get(path, '—')} → {new.get(path, '—')}"
        for path in paths[:MOST_CHANGES]
    ]
    more = len(paths) - MOST_CHANGES
    return visible("; ".join(words + [f"{more} more"] * (more > 0)), 160)


def _leaves(value: object, path: str = "") -> Iterator[tuple[str, object]]:
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _leaves(part, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        for n, part in enumerate(value):
            yield from _leaves(part, f"{path}[{n}]")
    else:
        yield path, value
