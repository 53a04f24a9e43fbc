"""Concentration of gas over time at a position, interpolated from the results of a run."""

from math import log
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.files.film import BACKGROUND
from taichi_plume.guard.input_error import InputError
from taichi_plume.record.planes import planes
from taichi_plume.record.scales import ABOVE

if TYPE_CHECKING:
    import xarray as xr

    from taichi_plume.results.run import Run

ROUNDING = 1e-5  # relative error of gas in fields.zarr


def gas_at(run: "Run", x: float, y: float, z: float | None = None) -> "xr.Dataset":
    """Return the concentration of each gas [ppm] over time at a position [m]; z: of 3-D runs.

    It is linear between the centres of the cells that hold air, as the robots and probes of a run measure it, with the
    background, which fields and pictures do not contain.
    Concentrations from pictures are of all gases together. They are 0 below the range of the colours and NaN above. The
    attributes `relative_precision` and `absolute_precision` [ppm] add up; beside obstacles pictures are less precise.
    """
    place = _place(run, x, y, z)
    return _of_fields(run, place) if run.has("fields.zarr") else _of_pictures(run, place)


def _place(run: "Run", x: float, y: float, z: float | None) -> list[float]:
    """Return the position as a list of coordinates. Raises InputError if it is not in the room."""
    extent = run.scenario.domain.extent
    place = [x, y] if z is None else [x, y, z]
    if len(place) != len(extent):
        raise InputError(
            f"z: got {z}; a {len(extent)}-D run has the coordinates {', '.join('xyz'[: len(extent)])}"
        )
    for axis, value, size in zip("xyz", place, extent, strict=False):
        if not 0.0 <= value <= size:
            raise InputError(f"{axis}: got {value} m; the room is from 0 to {size:g} m")
    return [float(value) for value in place]


def _of_fields(run: "Run", place: list[float]) -> "xr.Dataset":
    fields = run.fields
    names = [str(name) for name in fields.data_vars if str(name).endswith("_ppm")]
    if not names:
        raise InputError(
            f"{run.folder}: its fields have no gas; add gas to `fields.quantities` in the scenario"
        )
    data = fields[[*names, "air"]]
    spacing = run.scenario.domain.spacing
    for axis, value in zip("xyz", place, strict=False):  # the two cells beside it along each axis
        data = data.sel({axis: slice(value - spacing * (1 + 1e-6), value + spacing * (1 + 1e-6))})
    weight = (data.air > 0).astype(float)
    for axis, value in zip("xyz", place, strict=False):
        along = data[axis]
        inside = value if along.size < 2 else min(max(value, float(along.min())), float(along.max()))
        weight = weight * (1 - abs(along - inside) / spacing).clip(0.0)
    air = data.drop_vars("air")
    result = (air.fillna(0.0) * weight).sum(["x", "y", "z"][: len(place)]) / weight.sum()
    for name in names:
        attributes = fields[name].attrs | {"relative_precision": ROUNDING, "absolute_precision": 0.0}
        if ppm := attributes.pop(BACKGROUND, 0.0):
            result[name] += ppm
            attributes["long_name"] = attributes["long_name"].replace("above", "with")
        result[name].attrs = attributes
    return result.assign_coords(dict(zip("xyz", place, strict=False)))


def _of_pictures(run: "Run", place: list[float]) -> "xr.Dataset":
    import xarray as xr

    spacing = run.scenario.domain.spacing
    through = [
        plane
        for plane in planes(run.scenario, run.scenario.domain.extent)
        if plane.normal is None
        or (plane.level is not None and abs(place[plane.normal] - plane.level) <= spacing / 2)
    ]
    if not through:
        raise InputError(
            f"{run.folder}: no recorded plane goes through {tuple(place)} m; `fields: {{rate: 2}}` in the scenario "
            "records all cells"
        )
    plane = through[0]
    pictures = run.planes.read([f"gas_{plane.name}"])
    if not pictures:
        raise InputError(f"{run.folder}: the recording has no pictures of the gas")
    (picture,) = pictures.values()
    values = picture.levels[picture.data].astype(np.float64)
    values[picture.data == 255] = np.nan
    values += sum(run.scenario.backgrounds.values())
    centres = {"u": picture.coordinates(0), "v": picture.coordinates(1)}
    data = xr.DataArray(values, dims=("time", "v", "u"), coords={"time": picture.times, **centres})
    for axis, name in zip(plane.axes, "uv", strict=True):
        inside = min(max(place[axis], centres[name][0]), centres[name][-1])
        data = data.interp({name: inside}).drop_vars(name)
    data = data.astype(np.float32)
    levels = log(picture.high / picture.low) if picture.logarithmic else picture.high - picture.low
    step = levels / 255
    data.attrs = {
        "units": picture.unit,
        "long_name": f"{picture.quantity.removesuffix(ABOVE)}, decoded from the colours of the recording",
        "recorded_from": picture.low,
        "recorded_to": picture.high,
        "relative_precision": step / 2 if picture.logarithmic else 0.0,
        "absolute_precision": picture.low if picture.logarithmic else step / 2,
    }
    time = {"units": "s", "long_name": "simulated time", "axis": "T"}
    result = data.to_dataset(name="gas_ppm").assign_coords(dict(zip("xyz", place, strict=False)))
    result.time.attrs = time
    return result
