"""Pictures and wind arrows of a run that has fields.zarr and no recording, as the recording would have them."""

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
    """The gas of all species, on the planes that a recording would show.

    names, between, spacing: as `reading.read` has them. Raises RunFolderError.
    """
    factor = {f"gas_{one.vapour.name}": one.vapour.ppm_per_density for _, one in scenario.gases}
    gases = [name for name in film.gas if name in factor]
    if not gases:
        return {}
    low, high = scenario.recording.range_ppm
    scale = Scale(low, high, "log")
    try:
        grid, solid = Grid.of(scenario.domain), film.still("air") <= 0.0
        if film.shape != grid.shape:
            raise FilmError(
                f"{film.path}: has {film.shape} cells, its scenario {grid.shape}: it is of another run"
            )
        rasters = {f"gas_{plane.name}": Raster(plane, grid, solid) for plane in planes(scenario, grid.extent)}
        rasters = {name: one for name, one in rasters.items() if names is None or name in names}
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
    """The wind in a plane of that name, as long as the air is fast. Raises RunFolderError."""
    extent = scenario.domain.extent
    here = next((one for one in planes(scenario, extent) if one.name == plane), None)
    frames = _frames(film, between, spacing) if film.wind and here is not None else []
    if here is None or not frames:
        return Arrows(np.zeros(0), [], [])
    flat, step = arrow_places([extent[d] for d in here.axes])
    points = here.within(flat)
    try:
        found = [film.velocity(float(film.times[n]))(points) for n in frames]
    except FilmError as error:
        raise RunFolderError(str(error)) from None
    return _drawn(here, points, found, step, film.times[frames])


def _drawn(
    plane: Plane, points: np.ndarray, found: list[np.ndarray], step: float, times: np.ndarray
) -> Arrows:
    """Arrows centred on points (n, dim): the fastest 5 % are longer than the distance between them."""
    along = list(plane.axes)
    speed = np.concatenate([np.linalg.norm(one[:, along], axis=-1) for one in found])
    top = max(float(np.nanquantile(speed, 0.95)), 1e-3)
    middle = np.zeros((len(points), 3))
    middle[:, : points.shape[1]] = points
    ways = []
    for one in found:
        way = np.zeros((len(points), 3))
        way[:, along] = one[:, along] * (1.2 * step / top)
        ways.append(way)
    return Arrows(times, [middle - way / 2 for way in ways], ways)


def _frames(film: Film, between: tuple[float, float], spacing: float) -> list[int]:
    """Numbers of the frames that are in time, and apart."""
    found: list[int] = []
    for n, t in enumerate(film.times):
        if between[0] - 1e-9 <= t <= between[1] + 1e-9:
            if not found or t >= film.times[found[-1]] + spacing - 1e-6:
                found.append(n)
    return found
