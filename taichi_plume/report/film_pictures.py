"""Pictures and wind arrows of a run that has fields.zarr and no recording, as the recording would have them."""

from collections.abc import Iterator, Sequence

import numpy as np

from taichi_plume.files.film import Film, FilmError
from taichi_plume.files.film_moment import velocity
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.record.drawing import arrow_places, logarithmic
from taichi_plume.record.reading import Arrows, Picture
from taichi_plume.scenario.scenario import Scenario


def of_film(
    film: Film,
    scenario: Scenario,
    names: Sequence[str] | None,
    between: tuple[float, float],
    spacing: float,
) -> dict[str, Picture]:
    """The gas of all species: a slice and, in 3-D, the maximum over the height and a section through the first source.

    names, between, spacing: as `reading.read` has them. Raises RunFolderError.
    """
    factor = {f"gas_{one.vapour.name}": one.vapour.ppm_per_density for _, one in scenario.gases}
    gases = [name for name in film.gas if name in factor]
    if not gases:
        return {}
    low, high = scenario.recording.range_ppm
    planes = {
        name: plane for name, plane in _planes(film, scenario).items() if names is None or name in names
    }
    frames = list(_frames(film, between, spacing))
    data: dict[str, list[np.ndarray]] = {name: [] for name in planes}
    for n in frames:
        ppm = sum(factor[name] * values for name, values in _read(film, n, gases).items())
        for name, (_, _, cut) in planes.items():
            share = np.nan_to_num(logarithmic(cut(ppm), low, high))
            data[name].append((255 * share).round().astype(np.uint8).T)
    quantity = " + ".join(name.removeprefix("gas_") for name in gases)
    return {
        name: Picture(
            name, quantity, "ppm", low, high, True, where, axes, (film.dx, film.dx), (0.0, 0.0),
            film.times[frames], np.array(data[name]),
        )
        for name, (where, axes, _) in planes.items()
        if frames
    }  # fmt: skip


def arrows_of_film(film: Film, scenario: Scenario, between: tuple[float, float], spacing: float) -> Arrows:
    """The wind where the recording shows it. Raises RunFolderError."""
    frames = list(_frames(film, between, spacing)) if film.wind else []
    extent = scenario.domain.extent
    places, step = arrow_places(extent, min(scenario.recording.slice_height, extent[-1]))
    tails, ways = [], []
    for n in frames:
        try:
            found = velocity(film, float(film.times[n]))(places)
        except FilmError as error:
            raise RunFolderError(str(error)) from None
        speed = np.linalg.norm(found, axis=-1, keepdims=True)
        top = scenario.wind.top_speed(scenario) or float(np.nanmax(speed)) or 1.0
        share = np.sqrt(np.minimum(speed / top, 1.0))
        way = np.zeros((len(places), 3))
        way[:, : found.shape[1]] = 0.95 * step * share * found / np.maximum(speed, 1e-12)
        tail = np.zeros((len(places), 3))
        tail[:, : places.shape[1]] = places
        tails.append(tail - way / 2)
        ways.append(way)
    return Arrows(film.times[frames], tails, ways)


def _planes(film: Film, scenario: Scenario) -> dict:
    """Of each picture where it is, its axes, and how it is cut out of the gas (x, y, z)."""
    if len(film.shape) == 2:
        return {"gas_slice": ("", "xy", lambda ppm: ppm)}
    height = min(scenario.recording.slice_height, scenario.domain.extent[2])
    k = min(int(height / film.dx), film.shape[2] - 1)
    planes = {
        "gas_slice": (f"{height:g} m above the floor", "xy", lambda ppm: ppm[:, :, k]),
        "gas_column": ("maximum over the height", "xy", lambda ppm: ppm.max(axis=2)),
    }
    if scenario.sources:
        y = scenario.sources[0][1].position[1]
        j = min(int(y / film.dx), film.shape[1] - 1)
        planes["gas_section"] = (f"y = {y:g} m", "xz", lambda ppm: ppm[:, j])
    return planes


def _frames(film: Film, between: tuple[float, float], spacing: float) -> Iterator[int]:
    latest = -np.inf
    for n, t in enumerate(film.times):
        if between[0] - 1e-9 <= t <= between[1] + 1e-9 and t >= latest + spacing - 1e-6:
            latest = t
            yield n


def _read(film: Film, n: int, names: list[str]) -> dict[str, np.ndarray]:
    try:
        return film.frame(n, names)
    except FilmError as error:
        raise RunFolderError(str(error)) from None
