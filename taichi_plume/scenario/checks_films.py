"""Films that are played back, and what is asked of them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import Playback


def problems(scenario: Scenario, folder: Path, shapes: list[Shape | None]) -> Iterator[str]:
    """Films that are played back: whole, of the same domain and obstacles, with what is asked of them."""
    for part, path, model in [("wind", "wind", scenario.wind), *(("gas", *gas) for gas in scenario.gases)]:
        if not isinstance(model, Playback):
            continue
        from taichi_plume.files.film import Film, FilmError, completed  # zarr is for runs that need it

        try:
            film = Film(folder / model.file)
            if part == "gas":
                completed(scenario, folder)
            air = film.still("air")
            for n in {0, len(film.times) - 1}:
                film.frame(n, film.wind if part == "wind" else film.gas)
        except FilmError as error:
            yield f"{path}.file: {error}"
            continue
        held = [name for name, variables in (("wind", film.wind), ("gas", film.gas)) if variables]
        if part not in held:
            yield (
                f"{path}.file: {film.path}: holds no {part}, only {', '.join(held) or 'nothing'}; record it "
                f"with fields.quantities: [{part}]"
            )
        elif faults := list(_another_domain(scenario, film, part)):
            yield from faults
        elif None not in shapes:
            grid = Grid.of(scenario.domain, film.periodic)
            here = air_of([s for s in shapes if s], grid, air > 0)
            differing = int((np.abs(here.volume - air) > 0.01).sum())
            if differing:
                yield (
                    f"obstacles: {differing} cells are not as in {film.path}, which {part} plays back; "
                    "give the obstacles of the recorded run"
                )
        if model.start > film.times[-1] and not model.loop:
            yield (
                f"{path}.start: {model.start:g} s is after the last frame of {film.path}; "
                f"it has {film.times[0]:g} to {film.times[-1]:g} s"
            )


def _another_domain(scenario: Scenario, film: Any, part: str) -> Iterator[str]:
    domain = scenario.domain
    if domain.shape != film.shape or abs(domain.spacing - film.dx) > 1e-6 * film.dx:
        size = ", ".join(f"{n * film.dx:.6g}" for n in film.shape)
        yield (
            f"domain: {_cells(domain.shape, domain.spacing)}, but {film.path}, which {part} plays back, has "
            f"{_cells(film.shape, film.dx)}; use size: [{size}], spacing: {film.dx:g}"
        )
    elif part == "gas" and domain.dim == 2 and abs(domain.depth - film.depth) > 1e-6 * film.depth:
        yield (
            f"domain.depth: {domain.depth:g} m, but the gas of {film.path} was recorded in {film.depth:g} m; "
            f"use depth: {film.depth:g}"
        )


def _cells(shape: tuple[int, ...], dx: float) -> str:
    return f"{' x '.join(map(str, shape))} cells of {dx:g} m"
