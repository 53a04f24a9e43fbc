"""Pictures and wind of a run in planes: from pictures.zarr, else from its film fields.zarr, as datasets."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.files import pictures_file
from taichi_plume.files.film import BACKGROUND, Film, FilmError
from taichi_plume.files.run_folder import RunFolderError

if TYPE_CHECKING:
    import xarray

    from taichi_plume.observed.quantities import Quantity
    from taichi_plume.observed.views import View
    from taichi_plume.results.run import Run

ALL_TIMES = (-np.inf, np.inf)


def has_pictures(run: "Run") -> bool:
    """Return whether the run has a file from which pictures can be read."""
    return run.has(pictures_file.NAME) or run.has("fields.zarr")


def pictures(
    run: "Run",
    names: Sequence[str] | None = None,
    between: tuple[float, float] = ALL_TIMES,
    spacing: float = 0.0,
) -> "xarray.Dataset":
    """Return pictures such as "gas_slice" in memory, by default all, between two times [s], `spacing` [s] apart.

    Names that the run lacks are left out. Raises RunFolderError if it has neither pictures nor fields.
    """
    if run.has(pictures_file.NAME):
        data = run.pictures
        data = data[[name for name in map(str, data.data_vars) if names is None or name in names]]
        return data.isel(time=chosen(data.time.values, between, spacing)).load()
    seen = [view for view in film_views(run) if names is None or view.name in names]
    return _of_film(run, seen, chosen(run.fields.time.values, between, spacing))


def picture_names(run: "Run") -> list[str]:
    """Return the names of the run's pictures, such as "gas_slice"."""
    if run.has(pictures_file.NAME):
        return list(map(str, run.pictures.data_vars))
    return [view.name for view in film_views(run)]


def span(run: "Run") -> tuple[float, float] | None:
    """Return the times [s] of the first and the last picture of a run; None without pictures."""
    times = (run.pictures if run.has(pictures_file.NAME) else run.fields).time.values
    return (float(times[0]), float(times[-1])) if len(times) else None


def wind(
    run: "Run", plane: str, between: tuple[float, float] = ALL_TIMES, spacing: float = 0.0
) -> "xarray.Dataset | None":
    """Return the wind [m/s] at the arrows of a plane, variables such as u_slice; None if the run has none there."""
    if run.has(pictures_file.NAME):
        data = run.winds
        data = data[[name for name in map(str, data.data_vars) if name.partition("_")[2] == plane]]
        if not data.data_vars:
            return None
        return data.isel(time=chosen(data.time.values, between, spacing)).load()
    from taichi_plume.observed.planes import Lattice, planes
    from taichi_plume.observed.quantities import Quantity, Rounded
    from taichi_plume.observed.scales import Scale
    from taichi_plume.observed.views import View, layout

    film, scenario = Film(run.folder / "fields.zarr"), run.scenario
    here = {each.name: each for each in planes(scenario, scenario.domain.extent)}.get(plane)
    frames = chosen(film.times, between, spacing)
    if not film.wind or here is None or not frames:
        return None
    air = Quantity(
        "wind", "velocity of the air", "m s-1", Scale(0.0, 1.0, "linear"), "", lambda _: None, None, Rounded(),
        components=tuple("uvw"[: len(film.shape)]),
    )  # fmt: skip
    view, lattice = View(air, here, 1.0), Lattice(here, scenario.domain.extent)
    form = layout([view], {view.name: lattice})
    velocity = np.stack([film.velocity(float(film.times[n]))(lattice.points) for n in frames])
    return form.dataset(
        [velocity[..., k].swapaxes(1, 2) for k in range(velocity.shape[-1])], film.times[frames]
    )


def chosen(times: np.ndarray, between: tuple[float, float], spacing: float) -> list[int]:
    """Return the indices of the times between two times [s], at least `spacing` [s] apart."""
    found: list[int] = []
    for n in np.flatnonzero((times >= between[0] - 1e-9) & (times <= between[1] + 1e-9)).tolist():
        if not found or times[n] >= times[found[-1]] + spacing - 1e-6:
            found.append(n)
    return found


# ---------------------------------------------------------------- of a film


def film_views(run: "Run") -> list["View"]:
    """Return the views that a run's film can show, on the planes of its recording."""
    from taichi_plume.observed.planes import planes
    from taichi_plume.observed.views import View

    scenario = run.scenario
    seen = planes(scenario, scenario.domain.extent)
    return [View(each, plane, 1.0) for each in _quantities(run) for plane in seen if each.on(plane)]


def _quantities(run: "Run") -> Iterator["Quantity"]:
    """Yield the quantities in a film's cells: the sum of the gases, and others as they are."""
    from taichi_plume.observed.quantities import ABOVE, Quantity, Rounded
    from taichi_plume.observed.scales import Scale

    data, recording = run.fields, run.scenario.recording
    gases = [name for name in map(str, data.data_vars) if name.endswith("_ppm")]
    make: Any = partial(Quantity, points=None, precision=Rounded())
    if gases:
        name = " + ".join(gas.removesuffix("_ppm") for gas in gases)
        name += ABOVE * any(BACKGROUND in data[gas].attrs for gas in gases)
        scale = Scale(*recording.range_ppm, "log")
        yield make("gas", name, "ppm", scale, "inferno", lambda frame: sum(frame[gas] for gas in gases))
    for name in map(str, data.data_vars):
        of = data[name]
        if name in ("air", "u", "v", "w", *gases) or name.startswith("gas_") or "time" not in of.dims:
            continue
        ends = recording.range_kelvin if of.units == "K" else None
        if ends is None:
            values = of.isel(time=[0, -1]).where(data.air > 0)
            ends = (float(values.min()), max(float(values.max()), float(values.min()) + 1e-3))
        scale = Scale(*ends, "linear")
        yield make(
            name, name, of.units, scale, "turbo", lambda frame, name=name: frame[name], has_column=False
        )


def _of_film(run: "Run", seen: "list[View]", frames: Sequence[int]) -> "xarray.Dataset":
    from taichi_plume.grid.grid import Grid
    from taichi_plume.observed.planes import Raster
    from taichi_plume.observed.views import layout

    grid, data = Grid.of(run.scenario.domain), run.fields
    axes = "xyz"[: grid.dim]
    air = data.air.transpose(*axes).values
    if air.shape != grid.shape:
        raise FilmError(
            f"{run.folder / 'fields.zarr'}: has {air.shape} cells, its scenario {grid.shape}: of another run"
        )
    samples = {view.name: Raster(view.plane, grid, air <= 0.0) for view in seen}
    needed = [name for name in map(str, data.data_vars) if "time" in data[name].dims]
    values: dict[str, list[np.ndarray]] = {view.name: [] for view in seen}
    for n in frames if seen else ():
        frame = {name: data[name].isel(time=n).transpose(*axes) for name in needed}
        cells = {view.quantity: np.asarray(view.quantity.cells(frame), np.float32) for view in seen}  # type: ignore[arg-type]
        for view in seen:
            values[view.name].append(samples[view.name].of_cells(cells[view.quantity]).T)
    form = layout(seen, samples)
    empty = [np.empty((0, *each.shape), np.float32) for each in form.variables]
    stacks = [np.stack(values[each.name]) if frames else empty[k] for k, each in enumerate(form.variables)]
    return form.dataset(stacks, data.time.values[list(frames)])


def gas_slices(run: "Run", gas: str | None = None) -> "xarray.Dataset":
    """Return the first horizontal pictures of each gas as NAME_ppm over (time, y, x), of the pixels of one gas.

    gas: the species whose pixels count, by default the first. Raises RunFolderError if no gas is recorded by itself.
    """
    import xarray

    found: dict[str, xarray.DataArray] = {}
    for values in run.pictures.data_vars.values():
        if "species" in values.attrs and values.attrs["axes"] == "xy" and values.attrs["view"] != "column":
            found.setdefault(values.attrs["species"], renamed(values))
    if not found:
        raise RunFolderError(f"{run.folder}: its pictures show no gas in a horizontal plane")
    shape = found.get(gas or "", next(iter(found.values()))).shape
    return xarray.Dataset({f"{name}_ppm": of for name, of in found.items() if of.shape == shape})


def renamed(values: "xarray.DataArray") -> "xarray.DataArray":
    """Return a picture whose axes have the names x, y and z."""
    return values.rename({dim: dim[0] for dim in map(str, values.dims) if dim != "time" and len(dim) > 1})


def require_pictures(run: "Run") -> None:
    """Raise RunFolderError if a run has neither pictures nor fields; say how an old recording is converted."""
    if has_pictures(run):
        return
    if run.has("recording.rrd"):
        raise RunFolderError(
            f"{run.folder}: was recorded by version 0.1, with pictures in recording.rrd alone; "
            f"`taichi-plume export {run.folder} --to pictures` adds {pictures_file.NAME}"
        )
    raise RunFolderError(
        f"{run.folder}: has neither {pictures_file.NAME} nor fields.zarr, from which pictures are made"
    )
