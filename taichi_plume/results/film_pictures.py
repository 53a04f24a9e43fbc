"""Pictures and wind arrows of a run from fields.zarr, in the same form as from a recording."""

from collections.abc import Sequence

import numpy as np

from taichi_plume.files.film import Film, FilmError
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.grid.grid import Grid
from taichi_plume.record.drawing import Scale, arrow_places
from taichi_plume.record.planes import Plane, Raster, planes
from taichi_plume.record.reading import Arrows, Picture
from taichi_plume.scenario.scenario import Scenario


def of_film(
    film: Film,
    scenario: Scenario,
    names: Sequence[str] | None,
    between: tuple[float, float],
    spacing: float,
) -> dict[str, Picture]:
    """Return the gas of all species on the planes that a recording would show.

    names, between, spacing: as of `reading.read`. Raises RunFolderError.
    """
    factor = {f"gas_{gas.vapour.name}": gas.vapour.ppm_per_density for _, gas in scenario.gases}
    gases = [name for name in film.gas if name in factor]
    if not gases:
        return {}
    low, high = scenario.recording.range_ppm
    scale = Scale(low, high, "log")
    try:
        grid, solid = Grid.of(scenario.domain), film.still("air") <= 0.0
        if film.shape != grid.shape:
            raise FilmError(f"{film.path}: has {film.shape} cells, its scenario {grid.shape}: of another run")
        shown = {f"gas_{plane.name}": plane for plane in planes(scenario, grid.extent)}
        rasters = {
            name: Raster(plane, grid, solid)
            for name, plane in shown.items()
            if names is None or name in names
        }
        frames = _frames(film, between, spacing)
        data: dict[str, list[np.ndarray]] = {name: [] for name in rasters}
        for n in frames:
            ppm = sum(factor[name] * values for name, values in film.frame(n, gases).items())
            for name, raster in rasters.items():
                data[name].append(scale.bytes(raster.of_cells(np.asarray(ppm))).T)
    except FilmError as error:
        raise RunFolderError(str(error)) from None
    quantity = " + ".join(name.removeprefix("gas_") for name in gases)
    return {
        name: Picture(
            name, raster.plane.name, quantity, "ppm", low, high, True, raster.plane.text, raster.plane.letters,
            (raster.cell, raster.cell), raster.origin, film.times[frames],
            np.array(data[name], np.uint8).reshape(-1, *raster.shape[::-1]),
        )
        for name, raster in rasters.items()
    }  # fmt: skip


def arrows_of_film(
    film: Film, scenario: Scenario, plane: str, between: tuple[float, float], spacing: float
) -> Arrows:
    """Return the wind in a named plane, with arrows as long as the air is fast. Raises RunFolderError."""
    extent = scenario.domain.extent
    here = next((shown for shown in planes(scenario, extent) if shown.name == plane), None)
    frames = _frames(film, between, spacing) if film.wind and here is not None else []
    if here is None or not frames:
        return Arrows(np.zeros(0), [], [])
    flat, step = arrow_places([extent[d] for d in here.axes])
    points = here.within(flat)
    try:
        velocities = [film.velocity(float(film.times[n]))(points) for n in frames]
    except FilmError as error:
        raise RunFolderError(str(error)) from None
    return _drawn(here, points, velocities, step, film.times[frames])


def _drawn(
    plane: Plane, points: np.ndarray, velocities: list[np.ndarray], step: float, times: np.ndarray
) -> Arrows:
    """Return arrows centred on points (n, dim); the fastest 5 % are longer than the distance between points."""
    along = list(plane.axes)
    speed = np.concatenate([np.linalg.norm(velocity[:, along], axis=-1) for velocity in velocities])
    top = max(float(np.nanquantile(speed, 0.95)), 1e-3)
    middle = np.zeros((len(points), 3))
    middle[:, : points.shape[1]] = points
    arrows = []
    for velocity in velocities:
        arrow = np.zeros((len(points), 3))
        arrow[:, along] = velocity[:, along] * (1.2 * step / top)
        arrows.append(arrow)
    return Arrows(times, [middle - arrow / 2 for arrow in arrows], arrows)


def _frames(film: Film, between: tuple[float, float], spacing: float) -> list[int]:
    """Return the numbers of the frames between two times [s] that are `spacing` [s] apart."""
    numbers: list[int] = []
    for n, t in enumerate(film.times):
        if between[0] - 1e-9 <= t <= between[1] + 1e-9:
            if not numbers or t >= film.times[numbers[-1]] + spacing - 1e-6:
                numbers.append(n)
    return numbers
