"""What a run's folder tells of it, whole or not: scenario, result, pictures and tracks, each when asked for."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from taichi_plume.files import manifest
from taichi_plume.files.run_folder import HEADER, RunFolderError, is_run, told
from taichi_plume.grid.shapes import ShapeError
from taichi_plume.guard.opening import gate
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.report.tracks import Track, tracks
from taichi_plume.scenario.input_files import files_of, outside
from taichi_plume.scenario.loading import ScenarioError, read_scenario
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.shapes import shape

if TYPE_CHECKING:  # zarr and rerun, where they are needed
    from taichi_plume.files.film import Film
    from taichi_plume.record.reading import Arrows, Picture

RECORDING, FILM, TABLE = "recording.rrd", "fields.zarr", "robots.parquet"
UNFINISHED = ("running", "killed")
"""What result.json says of a run that has not come to its own end."""


class Began(NamedTuple):
    """What the head of a run's scenario.yaml says: the command to run it again, and what it ran with."""

    again: str
    lines: list[str]


@dataclass
class Run:
    """The folder of a run; raises RunFolderError, a line that begins with a path, where something cannot be read.

    shapes: of its obstacles, as far as they may be read. lacks: sentences about what there is not.
    """

    folder: Path
    scenario: Scenario
    result: dict[str, Any]
    began: Began
    shapes: list[Any]
    lacks: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, folder: Path, shapes: Sequence[Any] | None = None, allow_outside: bool = False) -> "Run":
        """The run of a folder. shapes: of its obstacles, where they are known; files outside are read if allowed."""
        if not folder.is_dir():
            raise RunFolderError(f"{folder}: is no folder; give the folder of a run")
        if not is_run(folder):
            raise RunFolderError(f"{folder}: is not the folder of a run")
        file = folder / "scenario.yaml"
        try:
            scenario = read_scenario(file)
        except ScenarioError as error:
            raise RunFolderError(f"{error.faults[0]} (damaged, or of another version)") from None
        result = told(folder / "result.json")
        run = cls(folder, scenario, result, _began(file), [])
        if not result:
            run.lacks.append("result.json is missing or damaged: how the run ended is not known.")
        run.shapes = list(shapes) if shapes is not None else run._shapes(allow_outside)
        return run

    def _shapes(self, allow_outside: bool) -> list[Any]:
        found = []
        if getattr(self.scenario.wind, "occupancy", None) is not None:
            self.lacks.append("What stands in the occupancy grid of the imported wind is not drawn.")
        for n, one in enumerate(self.scenario.obstacles):
            name = getattr(one, "file", None)
            if name and not allow_outside and not self._may_read(name):
                self.lacks.append(
                    f"Obstacle {n} is not drawn: its file {visible(name, LONGEST_VALUE)} lies outside the run's folder "
                    f"and is not the one that {manifest.NAME} names; --allow-outside reads it."
                )
                continue
            try:
                # a file outside that came this far is allowed, or the very file that the run read
                free = allow_outside or (name and outside(self.folder, name))
                with gate(None if free else self.folder):
                    found.append(shape(one, self.scenario.domain, self.folder))
            except ShapeError as error:
                self.lacks.append(f"Obstacle {n} is not drawn: {error}.")
        return found

    def _may_read(self, name: str) -> bool:
        """Return whether a file of the scenario lies in the run's folder, or is unchanged since the run."""

        def was_read(file: Path) -> bool:
            return manifest.is_input(self.folder, file)

        return not outside(self.folder, name) or (
            was_read(self.folder / name)
            and all(map(was_read, files_of(self.folder, name)))  # a map has a picture
        )

    @property
    def status(self) -> str:
        """How it ended, in a word."""
        return str(self.result.get("status", "unknown"))

    @property
    def unfinished(self) -> bool:
        """Whether it runs, or was killed: its files may end anywhere."""
        return self.status in (*UNFINISHED, "unknown")

    @property
    def begin(self) -> float:
        """Simulated time at which it begins [s]."""
        return self.scenario.first_tick * self.scenario.tick

    @property
    def has_recording(self) -> bool:
        """Whether there is one."""
        return (self.folder / RECORDING).exists()

    @property
    def has_film(self) -> bool:
        """Whether there are recorded fields."""
        return (self.folder / FILM).is_dir()

    def pictures(
        self,
        names: Sequence[str] | None = None,
        between: tuple[float, float] = (-inf, inf),
        spacing: float = 0.0,
    ) -> "dict[str, Picture]":
        """Pictures of its recording or, where it has none, of its recorded fields; empty where it has neither."""
        if self.has_recording:
            from taichi_plume.record import reading

            return reading.read(self.folder / RECORDING, names, between, spacing)
        if self.has_film:
            from taichi_plume.report.film_pictures import of_film

            return of_film(self.film, self.scenario, names, between, spacing)
        return {}

    def span(self, names: Sequence[str] | None = None) -> tuple[float, float] | None:
        """First and last time [s] of its pictures of some names, or of all; None where there are none."""
        if self.has_recording:
            from taichi_plume.record import reading

            return reading.span(self.folder / RECORDING, names)
        return (float(self.film.times[0]), float(self.film.times[-1])) if self.has_film else None

    def planes(self) -> list[str]:
        """Names of the pictures that there are."""
        if self.has_recording:
            from taichi_plume.record import reading

            return reading.names(self.folder / RECORDING)
        return list(self.pictures(None, (inf, inf)))

    @cached_property
    def film(self) -> "Film":
        """Its recorded fields."""
        from taichi_plume.files.film import Film, FilmError

        try:
            return Film(self.folder / FILM)
        except FilmError as error:
            raise RunFolderError(str(error)) from None

    def arrows(
        self, plane: str, between: tuple[float, float] = (-inf, inf), spacing: float = 0.0
    ) -> "Arrows | None":
        """The wind in a plane of its recording or of its recorded fields, "slice" or "section"."""
        if self.has_recording:
            from taichi_plume.record import reading

            return reading.arrows(self.folder / RECORDING, plane, between, spacing)
        if self.has_film:
            from taichi_plume.report.film_pictures import arrows_of_film

            return arrows_of_film(self.film, self.scenario, plane, between, spacing)
        return None

    @cached_property
    def tracks(self) -> list[Track]:
        """Of the robots of each group's first trial, as many as can be told apart."""
        return tracks(self.folder / TABLE, self.scenario.robots)


def _began(file: Path) -> Began:
    """The comment on top of a run's scenario.yaml."""
    lines = []
    with file.open(encoding="utf-8", errors="replace") as head:
        for line in head:
            if not line.startswith("#"):
                break
            lines.append(line.removeprefix("#").strip())
    again = lines[0].removeprefix(HEADER.removeprefix("#").strip()).strip() if lines else ""
    return Began(again.removeprefix("Again:").strip(), lines[1:])
