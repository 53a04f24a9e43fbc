"""Picture of a running simulation: gas or temperature of now, wind and robots."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from taichi_plume.grid.sampler import Sampler
from taichi_plume.grid.shapes import Shape
from taichi_plume.guard.input_error import InputError
from taichi_plume.record.drawing import Scale
from taichi_plume.record.planes import Plane, Raster, planes
from taichi_plume.record.recording_reader import Arrows, Picture
from taichi_plume.report import theme
from taichi_plume.report.pictures import PICTURE_WIDTH, VIEWS, framed, show_at
from taichi_plume.report.plume import Present
from taichi_plume.results.film_pictures import arrows_of, places_of
from taichi_plume.results.tracks import Track
from taichi_plume.time_loop import TimeLoop


def figure(
    sim: TimeLoop,
    shapes: Sequence[Shape],
    values: np.ndarray,
    of: str,
    view: str | None,
    wind: bool,
    tracks: Sequence[Track],
    place: theme.Place,
) -> Figure:
    """Return a figure of values in all cells, (*grid.shape) [ppm], or [K] of "temperature", with wind and robots.

    view: see `pictures.VIEWS`; place: axes to draw into, or size of the figure. Raises InputError if there is no such
    view or quantity.
    """
    if of not in ("gas", "temperature"):
        raise InputError(f"of: got {of!r}; allowed are gas, temperature")
    there = {plane.name: plane for plane in planes(sim.scenario, sim.grid.extent)}
    name = VIEWS.get(view, view) if view else "column" if "column" in there else "slice"
    if name not in there:
        raise InputError(f"view: got {view!r}; allowed are {', '.join(there)}")
    plane = there[name]
    raster = Raster(plane, sim.grid, sim.air.solid)
    pixels = raster.of_cells(values)
    scale = Scale(*sim.scenario.recording.range_ppm, "log")
    if of == "temperature":
        air = values[~sim.air.solid]
        scale = Scale(float(air.min()), max(float(air.max()), float(air.min()) + 1e-3), "linear")
    quantity = "temperature" if of == "temperature" else " + ".join(gas.name for gas in sim.gas.species)
    picture = Picture(
        f"{of}_{name}", name, quantity, "K" if of == "temperature" else "ppm", scale.low, scale.high,
        scale.kind == "log", plane.text, plane.letters, (raster.cell, raster.cell), raster.origin,
        np.array([sim.t]), scale.bytes(pixels).T[None],
    )  # fmt: skip
    drawn, shown = framed(Present(sim.scenario, shapes), picture, tracks, PICTURE_WIDTH // 2, wind, place)
    arrows = _wind(sim, plane if plane.letters != "xy" else there["slice"]) if wind else None
    with theme.styled():
        show_at(shown, picture, sim.t, arrows)
    return drawn


def _wind(sim: TimeLoop, plane: Plane) -> Arrows:
    points, step = places_of(plane, sim.scenario)
    velocity = Sampler(points, sim.wind, sim.gas, [], sim.air.solid, sim.grid).sample(sim.t)[: sim.grid.dim]
    return arrows_of(plane, points, [velocity.T], step, np.array([sim.t]))
