"""Pictures and wind arrows of a run made from its film fields.zarr, in the form of the viewer's recording."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taichi_plume.files.film import BACKGROUND, Film, FilmError
from taichi_plume.grid.grid import Grid
from taichi_plume.record.drawing import Scale, arrow_places
from taichi_plume.record.planes import Plane, Raster, planes
from taichi_plume.record.recording_reader import ALL_TIMES, Arrows, Picture
from taichi_plume.record.scales import ABOVE
from taichi_plume.scenario.scenario import Scenario


class FilmPictures:
    """Pictures of the summed gas, and wind arrows, on planes through the film's grid.

    Planes and methods are those of `recording_reader.RecordedPictures`. The constructor and every method may raise
    FilmError.
    """

    def __init__(self, path: Path, scenario: Scenario):
        self.film, self.scenario = Film(path), scenario
        self.planes = {plane.name: plane for plane in planes(scenario, scenario.domain.extent)}

    def names(self) -> list[str]:
        return list(self.read(None, (np.inf, np.inf)))

    def span(self, names: Sequence[str] | None = None) -> tuple[float, float]:
        return float(self.film.times[0]), float(self.film.times[-1])

    def read(
        self,
        names: Sequence[str] | None = None,
        between: tuple[float, float] = ALL_TIMES,
        spacing: float = 0.0,
    ) -> dict[str, Picture]:
        film, scenario = self.film, self.scenario
        factor = {f"gas_{gas.vapour.name}": gas.vapour.ppm_per_density for _, gas in scenario.gases}
        gases = [name for name in film.gas if name in factor]
        if not gases:
            return {}
        low, high = scenario.recording.range_ppm
        scale = Scale(low, high, "log")
        grid, solid = Grid.of(scenario.domain), film.still("air") <= 0.0
        if film.shape != grid.shape:
            raise FilmError(f"{film.path}: has {film.shape} cells, its scenario {grid.shape}: of another run")
        shown = {f"gas_{name}": plane for name, plane in self.planes.items()}
        rasters = {
            name: Raster(plane, grid, solid)
            for name, plane in shown.items()
            if names is None or name in names
        }
        frames = self._frames(between, spacing)
        data: dict[str, list[np.ndarray]] = {name: [] for name in rasters}
        for n in frames:
            ppm = sum(factor[name] * values for name, values in film.frame(n, gases).items())
            for name, raster in rasters.items():
                data[name].append(scale.bytes(raster.of_cells(np.asarray(ppm))).T)
        quantity = " + ".join(name.removeprefix("gas_") for name in gases)
        if any(BACKGROUND in film.arrays[name].attrs for name in gases):
            quantity += ABOVE
        return {
            name: Picture(
                name, raster.plane.name, quantity, "ppm", low, high, True, raster.plane.text, raster.plane.letters,
                (raster.cell, raster.cell), raster.origin, film.times[frames],
                np.array(data[name], np.uint8).reshape(-1, *raster.shape[::-1]),
            )
            for name, raster in rasters.items()
        }  # fmt: skip

    def arrows(self, plane: str, between: tuple[float, float] = ALL_TIMES, spacing: float = 0.0) -> Arrows:
        """Return wind arrows in a plane, proportional to the air speed, for frames between two times [s]."""
        here = self.planes.get(plane)
        frames = self._frames(between, spacing) if self.film.wind and here is not None else []
        if here is None or not frames:
            return Arrows(np.zeros(0), [], [])
        points, step = places_of(here, self.scenario)
        velocities = [self.film.velocity(float(self.film.times[n]))(points) for n in frames]
        return arrows_of(here, points, velocities, step, self.film.times[frames])

    def _frames(self, between: tuple[float, float], spacing: float) -> list[int]:
        """Return the numbers of the film's frames between two times [s], at least `spacing` [s] apart."""
        times, numbers = self.film.times, []
        for n in np.flatnonzero((times >= between[0] - 1e-9) & (times <= between[1] + 1e-9)).tolist():
            if not numbers or times[n] >= times[numbers[-1]] + spacing - 1e-6:
                numbers.append(n)
        return numbers


def places_of(plane: Plane, scenario: Scenario) -> tuple[np.ndarray, float]:
    """Return the positions of a plane's wind arrows, (n, dim) [m], and the distance between them [m]."""
    flat, step = arrow_places([scenario.domain.extent[d] for d in plane.axes])
    return plane.within(flat), step


def arrows_of(
    plane: Plane, points: np.ndarray, velocities: list[np.ndarray], step: float, times: np.ndarray
) -> Arrows:
    """Return wind arrows at points (n, dim) in a plane; the speed's 95 % quantile is drawn 1.2 `step` [m] long."""
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
