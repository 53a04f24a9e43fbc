"""A room run with several seeds: a small study, whose means have confidence intervals over flow realisations."""

import signal
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from taichi_plume.draw.document import data_of
from taichi_plume.draw.runs import Run
from taichi_plume.files.own_folder import is_locked
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.yaml_text import LineError, read_text

COUNT = 5  # seeds
BASE, STUDY = "base.yaml", "study.yaml"
AXES = {"seed", "seeds"}  # of such a study
IN_ROOM = "gas_in_room_kg"


class Progress(NamedTuple):
    """State of a study. done, runs: numbers of its runs; failed: messages of failed ones.

    short, full: a text for each group of robots, and the sentences of its estimates, of the runs that are done.
    """

    done: int = 0
    runs: int = COUNT
    failed: tuple[str, ...] = ()
    short: tuple[str, ...] = ()
    full: tuple[str, ...] = ()


class Repeats(Run):
    """Runs of a room with several seeds, by the command `study` in a process of its own; folder: of the study."""

    made_by = "study.json"

    @cached_property
    def text(self) -> str:
        """Text of the room, as it was typed; empty if it cannot be read."""
        try:
            return self._text if self._text is not None else read_text(self.folder / BASE)
        except (LineError, OSError):
            return ""

    @cached_property
    def changes(self) -> str:
        """Seeds in words."""
        seeds = seeds_of(self.text)
        return f"seeds {seeds[0]} to {seeds[-1]}"

    @property
    def _past(self) -> None:  # pyright: ignore[reportIncompatibleVariableOverride]
        return None  # a study keeps tables alone

    def _command(self, scenario: Path) -> tuple[list[str], dict[Path, str]]:
        data, study = data_of(self.text), scenario.with_suffix(".study.yaml")
        keys = ["seed"] + ["air_seed"] * (data.get("air_seed") is not None)
        axis = {"key": "seed"} if len(keys) == 1 else {"keys": keys}
        content: dict[str, Any] = {
            "name": self.folder.name,
            "base": scenario.name,
            "axes": {"seed" if len(keys) == 1 else "seeds": {**axis, "values": seeds_of(self.text)}},
        }
        if not data.get("robots"):
            content["outcomes"] = {IN_ROOM: "gas.in_domain_kg"}
        texts = {scenario: self.text, study: yaml.safe_dump(content, sort_keys=False)}
        return ["taichi_plume.study", str(study), "--out", str(self.folder)], texts

    @property
    def progress(self) -> Progress:
        """State of the study, read again once further runs are done."""
        try:
            key = sorted(file.name for file in (self.folder / "parts").iterdir() if file.suffix == ".parquet")
        except OSError:
            key = []
        key = [*key, str(self.alive)]
        if key != self.__dict__.get("_key"):
            self._key, self._progress = key, _progress(self.folder, not self.alive)
        return self._progress

    @property
    def result(self) -> dict[str, Any]:
        """Status and message, as result.json of a run has them."""
        now = self.progress
        code = self.process.poll() if self.process is not None else None
        if self.alive or (not self.begun_here and is_locked(self.folder)):
            status = "running"
        elif now.failed or code not in (None, 0, 130, -signal.SIGINT, -signal.SIGTERM, -signal.SIGKILL):
            status = "failed"
        else:
            status = "completed" if now.done == now.runs else "interrupted"
        done = f"{now.done} of {now.runs} runs are done"
        if status == "failed":
            done = "; ".join(dict.fromkeys(now.failed))
        return {"status": status, "message": "" if status == "completed" else done}

    @property
    def phase(self) -> str:
        """Phase of the study that goes on: starting or running."""
        return "running" if (self.folder / self.made_by).is_file() else "starting"

    @property
    def done(self) -> float:
        """Completed fraction."""
        return self.progress.done / self.progress.runs

    @property
    def clock(self) -> str:
        """Progress in words."""
        return f"{self.progress.done} of {self.progress.runs} runs"

    def found(self, full: bool = False) -> list[str]:
        """Return success, or the gas in the room, with its interval; full: as sentences, with the time."""
        return list(self.progress.full if full else self.progress.short)


def repeats_in(above: Path) -> list[tuple[float, Path]]:
    """Return times of change and paths of the folders in a folder that hold such a study; no links."""
    found = []
    for folder in above.iterdir() if above.is_dir() and not above.is_symlink() else ():
        file = folder / STUDY
        try:
            if not folder.is_symlink() and file.is_file() and (folder / BASE).is_file():
                axes = data_of(read_text(file)).get("axes")
                if isinstance(axes, dict) and set(axes) <= AXES:
                    found.append((file.stat().st_mtime, folder))
        except (LineError, OSError):
            continue
    return found


def seeds_of(text: str) -> list[int]:
    """Return the seeds of the runs: that of the room, and those that follow."""
    try:
        given = data_of(text).get("seed", 0)
    except LineError:
        given = 0
    first = given if isinstance(given, int) else 0
    return [(first + n) % 2**32 for n in range(COUNT)]


def _progress(folder: Path, ended: bool) -> Progress:
    """Read the state of a study; the sentences once it has ended, as their intervals take a second."""
    from taichi_plume.studies.estimates import SUCCESS, TIME
    from taichi_plume.studies.results import open_study
    from taichi_plume.studies.store import DONE

    try:
        study = open_study(folder)
        runs = study.tables.runs
        statuses, messages = runs["status"].to_pylist(), runs["message"].to_pylist()
        done = sum(status in DONE for status in statuses)
        failed = [line for line, status in zip(messages, statuses, strict=True) if status == "failed"]
        state = Progress(done, len(statuses), tuple(failed))
        if not ended or not done:
            return state
        points, short, full = study.by_points, [], []
        groups = points.table["group"].fillna("").tolist()
        for quantity in points.quantities:
            titles = {IN_ROOM: "gas in the room at the end"}
            title = titles.get(quantity.name, quantity.title)
            for group, estimate in zip(groups, points.estimates[quantity.name], strict=True):
                start = f"{group}: " if group else "no robots; "
                if quantity in (SUCCESS, TIME) or quantity.name in titles:
                    full.append(f"{start}{title} {quantity.words(estimate)}")
                if quantity is SUCCESS or quantity.name in titles:
                    short.append(f"{start}{title} {quantity.cell(estimate)}")
        return state._replace(short=tuple(short), full=tuple(full))
    except InputError:
        return Progress()
