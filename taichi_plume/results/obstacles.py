"""Shapes of a run's obstacles, read only from files that are permitted and unchanged since the run."""

from pathlib import Path

from taichi_plume.files import manifest
from taichi_plume.grid.shapes import Shape, ShapeError
from taichi_plume.guard.safe_open import gate
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.scenario.imported_wind import ImportedWind
from taichi_plume.scenario.input_files import files_of, outside
from taichi_plume.scenario.obstacles import Mesh, WallMap
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.shapes import shape


def shapes_of(folder: Path, scenario: Scenario, allow_outside: bool) -> tuple[list[Shape], list[str]]:
    """Return the shapes of a run's obstacles, and a sentence on each obstacle that could not be read.

    allow_outside: read files outside the run's folder even if they have changed since the run.
    """
    shapes: list[Shape] = []
    lacks: list[str] = []
    if isinstance(scenario.wind, ImportedWind) and scenario.wind.occupancy is not None:
        lacks.append("What stands in the occupancy grid of the imported wind is not drawn.")
    for n, obstacle in enumerate(scenario.obstacles):
        name = obstacle.file if isinstance(obstacle, Mesh | WallMap) else None
        if name and not allow_outside and not _may_read(folder, name):
            lacks.append(
                f"Obstacle {n} is not drawn: its file {visible(name, LONGEST_VALUE)} lies outside the run's folder "
                f"and is not the one that {manifest.NAME} names; --allow-outside reads it."
            )
            continue
        try:
            # a file outside is allowed here, or it is the file that the run read
            free = allow_outside or (name and outside(folder, name))
            with gate(None if free else folder):
                shapes.append(shape(obstacle, scenario.domain, folder))
        except ShapeError as error:
            lacks.append(f"Obstacle {n} is not drawn: {error}.")
    return shapes, lacks


def _may_read(folder: Path, name: str) -> bool:
    """Return whether a file that a scenario names lies in the run's folder, or is unchanged since the run."""
    if not outside(folder, name):
        return True
    if not manifest.is_input(folder, folder / name):
        return False
    return all(manifest.is_input(folder, file) for file in files_of(folder, name))  # a map has a picture
