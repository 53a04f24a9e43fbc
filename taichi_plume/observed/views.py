"""Views: what a run shows, declared once as a quantity on a plane or in a volume, and its rate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taichi_plume.observed.planes import VOLUME, Lattice, Plane, Raster, plane_of, planes
from taichi_plume.observed.quantities import Quantity, quantities, wind
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.outputs import Output
from taichi_plume.time_loop import TimeLoop

if TYPE_CHECKING:
    import xarray

SPLIT = 2  # samples per cell and axis of a gas with details below the cell size
PLANES = {"slice": "in a plane", "column": "maximum over the height", "section": "in a vertical plane"}


@dataclass(frozen=True)
class View:
    """View of a simulation: a quantity on a plane, at `rate` pictures per simulated second.

    stored: whether its values are stored, besides being shown.
    """

    quantity: Quantity
    plane: Plane
    rate: float
    stored: bool = True
    output: str = ""
    """Name of the view's own output; empty for views of the recording."""

    @property
    def name(self) -> str:
        """Name of the view's pictures, such as gas_0_section_2."""
        return f"{self.quantity.key}_{self.plane.name}"

    @property
    def part(self) -> str:
        """Group of the view in a store: that of its output; of the recording "" for scalars, "wind" for vectors."""
        return self.output or (self.quantity.key if self.quantity.components else "")


def views(sim: TimeLoop) -> list[View]:
    """Return the views that the scenario's `recording` section declares."""
    recording = sim.scenario.recording
    seen = planes(sim.scenario, sim.grid.extent)
    shown = quantities(sim)
    found = [View(each, plane, recording.rate) for each in shown for plane in seen if each.on(plane)]
    if sim.grid.dim == 3 and recording.volume:
        found += [View(each, VOLUME, recording.rate, False) for each in shown if each.has_volume]
    of_air = wind(sim)
    with_arrows = [plane for plane in seen if not plane.over_height]
    return [*found, *(View(of_air, plane, recording.wind_rate) for plane in with_arrows)]


def output_views(sim: TimeLoop) -> list[View]:
    """Return the views of the scenario's `outputs`. Raises ScenarioError if the run has no such quantity."""
    return [output_view(sim, each, f"outputs[{n}]") for n, each in enumerate(sim.scenario.outputs)]


def output_view(sim: TimeLoop, output: Output, where: str) -> View:
    """Return the view of an output. where: key in messages. Raises ScenarioError if the run has no such quantity."""
    known = {each.key: each for each in (*quantities(sim), wind(sim))}
    if output.quantity not in known:
        raise ScenarioError([f"{where}.quantity: got '{output.quantity}'; this run has {', '.join(known)}"])
    quantity, plane = known[output.quantity], plane_of(output, sim.grid.extent)
    if not quantity.on(plane) or (quantity.components and plane.over_height):
        raise ScenarioError(
            [f"{where}.plane: {quantity.key} has no maximum over the height; use xy, xz or yz"]
        )
    return View(quantity, plane, output.rate, output=output.name)


def samples_of(view: View, sim: TimeLoop) -> Raster | Lattice:
    """Return the pixels of a view on the simulation's grid; of a vector the positions of its arrows."""
    quantity, plane = view.quantity, view.plane
    if quantity.components and plane.name != "cells":
        return Lattice(plane, sim.grid.extent)
    finer = quantity.points is not None and not (plane.over_height or len(plane.axes) == sim.grid.dim == 3)
    split = (SPLIT, quantity.details) if finer and plane.name != "cells" else ()
    return Raster(plane, sim.grid, sim.air.solid, *split)


class Variable(NamedTuple):
    """Variable of a dataset of pictures. dims, shape: without time, slowest first; component: of a vector, or None."""

    name: str
    view: View
    component: int | None
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    attributes: dict[str, object]

    def values(self, pictures: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the variable's values, (*shape), of the pictures that an `Observer` has taken."""
        values = pictures[self.view.name]
        return (values if self.component is None else values[self.component]).T


class Layout(NamedTuple):
    """Variables of a dataset of pictures, and its coordinates: positions of the pixels' centres and attributes."""

    variables: list[Variable]
    coordinates: dict[str, tuple[np.ndarray, dict[str, str]]]

    def dataset(self, values: Sequence[np.ndarray], times: "np.ndarray | float") -> "xarray.Dataset":
        """Return a dataset of the variables' values, with a first axis of the times [s] unless there is one time."""
        import xarray

        moving = () if np.ndim(times) == 0 else ("time",)
        coordinates: dict[str, tuple] = {name: (name, *of) for name, of in self.coordinates.items()}
        coordinates["time"] = (moving, times, {"units": "s", "long_name": "simulated time", "axis": "T"})
        pairs = zip(self.variables, values, strict=True)
        data = {each.name: ((*moving, *each.dims), of, each.attributes) for each, of in pairs}
        return xarray.Dataset(data, coordinates, {"Conventions": "CF-1.11"})


def layout(seen: Sequence[View], samples: Mapping[str, Raster | Lattice]) -> Layout:
    """Return the variables and coordinates of views: `gas_slice` (y, x) and so on.

    Where the pixels of views differ, the axes of the later view have the name of its plane, or its own: `z_section`.
    """
    coordinates: dict[str, tuple[np.ndarray, dict[str, str]]] = {}
    variables = []
    for view in seen:
        sample, dims = samples[view.name], []
        for n, (letter, count, cell) in enumerate(
            zip(view.plane.letters, sample.shape, sample.cell, strict=True)
        ):
            along = sample.origin[n] + (np.arange(count) + 0.5) * cell
            for dim in (letter, f"{letter}_{view.plane.name}", f"{letter}_{view.name}"):
                if dim not in coordinates or np.array_equal(coordinates[dim][0], along):
                    break
            about = {
                "units": "m",
                "long_name": f"middle of the pixels along {letter}",
                "axis": letter.upper(),
            }
            coordinates.setdefault(dim, (along, about))
            dims.append(dim)
        shape = tuple(sample.shape)[::-1]
        about = _attributes(view, sample)
        if not view.quantity.components:
            name = view.name if view.plane.name != "cells" else view.quantity.in_cells or view.quantity.key
            variables.append(Variable(name, view, None, tuple(dims[::-1]), shape, about))
        for k, letter in enumerate(view.quantity.components):
            name = f"{letter}_{view.plane.name}" if view.plane.name != "cells" else letter
            along = {"long_name": about["long_name"].replace("air", f"air along {'xyz'[k]}", 1)}
            variables.append(Variable(name, view, k, tuple(dims[::-1]), shape, about | along))
    return Layout(variables, coordinates)


def _attributes(view: View, sample: Raster | Lattice) -> dict[str, object]:
    """Return the CF attributes of a view's variables: meaning, unit, plane, colours."""
    quantity, plane = view.quantity, view.plane
    where = plane.text or PLANES.get(plane.name, "")
    about: dict[str, object] = {
        "long_name": f"{quantity.name}, {where}" if where else quantity.meaning or quantity.name,
        "units": quantity.unit,
        "quantity": quantity.name,
        **quantity.attributes,
    }
    if plane.name == "cells":
        return about
    if isinstance(sample, Raster) and sample.shape != sample.samples:
        about["cell_methods"] = "area: maximum"
    about |= {
        "view": plane.name,
        "plane": plane.text,
        "axes": plane.letters,
        "cell": list(map(float, sample.cell)),
    }
    if plane.normal is not None and plane.level is not None:
        about["level"] = float(plane.level)
    if not quantity.components:
        scale = quantity.scale
        about |= {"colors_from": scale.low, "colors_to": scale.high, "colors": scale.kind}
    return about
