"""Concentration of gas over time at a position, interpolated from the fields or the pictures of a run."""

from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.files.film import BACKGROUND
from taichi_plume.guard.input_error import InputError
from taichi_plume.results.pictures import renamed, require_pictures

if TYPE_CHECKING:
    import xarray as xr

    from taichi_plume.results.run import Run

ROUNDING = 1e-5  # relative error of gas in fields.zarr


def gas_at(run: "Run", x: float, y: float, z: float | None = None) -> "xr.Dataset":
    """Return the concentration of each gas [ppm] over time at a position [m]; z: of 3-D runs.

    It is linear between the centres of the cells, or pixels, that hold air, as the robots and probes of a run measure
    it, with the background, which fields and pictures do not contain. The attributes `relative_precision` and
    `absolute_precision` [ppm] add up. A pixel of several cells is the largest of these.
    """
    extent = run.scenario.domain.extent
    place = [x, y] if z is None else [x, y, z]
    if len(place) != len(extent):
        raise InputError(
            f"z: got {z}; a {len(extent)}-D run has the coordinates {', '.join('xyz'[: len(extent)])}"
        )
    for axis, value, size in zip("xyz", place, extent, strict=False):
        if not 0.0 <= value <= size:
            raise InputError(f"{axis}: got {value} m; the room is from 0 to {size:g} m")
    found = _of_fields(run) if run.has("fields.zarr") else _of_pictures(run, place)
    at = dict(zip("xyz", map(float, place), strict=False))
    air = found.get("air")
    names = [name for name in map(str, found.data_vars) if name != "air"]
    result = found[names].map(lambda values: _linear(values, at, air), keep_attrs=True)
    for name in names:
        about = dict(found[name].attrs)
        if background := about.pop(BACKGROUND, 0.0):
            result[name] += background
            about["long_name"] = about["long_name"].replace("above", "with")
        result[name].attrs = about
    return result.assign_coords(at)


def _of_fields(run: "Run") -> "xr.Dataset":
    """Return the gases in the cells of a film, and the fraction of air of the cells."""
    fields, cell = run.fields, run.scenario.domain.spacing
    names = [str(name) for name in fields.data_vars if str(name).endswith("_ppm")]
    if not names:
        raise InputError(
            f"{run.folder}: its fields have no gas; add gas to `fields.quantities` in the scenario"
        )
    if fields.air.ndim != run.scenario.domain.dim:
        raise InputError(f"{run.folder}: its fields have {fields.air.ndim} axes, its scenario another number")
    data = fields[[*names, "air"]].copy()
    for name in names:
        data[name].attrs |= {
            "relative_precision": ROUNDING,
            "absolute_precision": 0.0,
            "cell": [cell] * fields.air.ndim,
        }
    return data


def _of_pictures(run: "Run", place: list[float]) -> "xr.Dataset":
    """Return the pictures of each gas on the first recorded plane through a position."""
    import xarray as xr

    require_pictures(run)
    spacing, found = run.scenario.domain.spacing, {}
    for values in run.pictures.data_vars.values():
        about = values.attrs
        normal = next((d for d in range(len(place)) if "xyz"[d] not in about["axes"]), None)
        through = normal is None or abs(place[normal] - about.get("level", np.inf)) <= spacing / 2
        if "species" in about and through:
            found.setdefault(f"{about['species']}_ppm", values)
    if not found:
        raise InputError(
            f"{run.folder}: no recorded plane goes through {tuple(place)} m; `fields: {{rate: 2}}` in the scenario "
            "records all cells"
        )
    return xr.Dataset({name: renamed(values) for name, values in found.items()})


def _linear(values: "xr.DataArray", at: dict[str, float], air: "xr.DataArray | None") -> "xr.DataArray":
    """Return values at a position, linear between the centres of cells that hold air; by default those not NaN."""
    import xarray as xr

    axes = [str(dim) for dim in values.dims if dim != "time"]
    weight: xr.DataArray | float = 1.0
    for axis, cell in zip(axes, values.attrs["cell"][::-1], strict=True):
        near = values[axis]
        inside = min(max(at[axis], float(near.min())), float(near.max()))
        values = values.sel({axis: slice(inside - cell * (1 + 1e-6), inside + cell * (1 + 1e-6))})
        weight = weight * (1 - abs(values[axis] - inside) / cell).clip(0.0)
    values = values.astype(np.float64)
    weight = weight * (
        values.notnull() if air is None else air.sel({axis: values[axis] for axis in axes}) > 0
    )
    return ((values.fillna(0.0) * weight).sum(axes) / weight.sum(axes)).astype(np.float32)
