"""Legends of a recording: colour bars and keys of arrows, as rerun archetypes, since the viewer has no legends."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from taichi_plume.observed.planes import Plane
from taichi_plume.observed.quantities import Quantity
from taichi_plume.observed.scales import Scale
from taichi_plume.record import drawing
from taichi_plume.record.placement import Stage, label, picture, placed
from taichi_plume.record.scene import TEXT, Entities
from taichi_plume.scoring.beliefs import believers
from taichi_plume.time_loop import TimeLoop

WEIGHTS = Scale(10.0, 1e6, "log")
RATIOS = Scale(0.01, 100.0, "log")  # estimate over truth
MAPS = Plane("map", (0, 1), None, None, "")
TOP, TICKS, TITLE = 0.03, 0.064, 0.109
"""Distances of the bar, its ticks and its title below a picture, over the arena's length."""


def legends(sim: TimeLoop, stage: Stage, seen: Sequence[Plane], quantities: Sequence[Quantity]) -> Entities:
    """Yield the colour bars of all pictures in a recording: gas, temperature, gas maps and belief maps."""
    for quantity in quantities:
        for plane in seen:
            if not quantity.on(plane):
                continue
            title = ", ".join(part for part in (quantity.title, plane.text) if part)
            entity = f"{quantity.entity}/{plane.name}"
            yield from _bar(entity, title, quantity.scale.marks(), quantity.colormap, plane, stage)
    if sim.maps:
        gas = Scale(*sim.scenario.recording.range_ppm, "log").marks()
        ratios = [(at, f"{text} x") for at, text in RATIOS.marks()]
        viridis = drawing.VIRIDIS
        yield from _bar("estimate", "the robots' estimate [ppm]", gas, viridis, MAPS, stage)
        yield from _bar("truth", "true mean since the start [ppm]", gas, viridis, MAPS, stage)
        yield from _bar("weight", "weight of the estimate", WEIGHTS.marks(), drawing.EMBER, MAPS, stage)
        yield from _bar("error", "estimate over true mean", ratios, drawing.BLUE_RED, MAPS, stage)
    if believers(sim):
        marks = drawing.DENSITIES.marks()
        yield from _bar("belief", "probability of a source [1/m²]", marks, drawing.EMBER, MAPS, stage)


def _bar(
    name: str,
    title: str,
    scale: list[tuple[float, str]],
    colors: str | Sequence[Sequence[int]],
    plane: Plane,
    stage: Stage,
) -> Entities:
    """Yield a labelled colour bar below a plane. scale: ticks (0 to 1, text); colors: colormap's name, or palette."""
    length = stage.extent[plane.axes[0]]
    left, right = (0.05 * length, 0.95 * length) if plane is MAPS else (0.26 * length, 0.97 * length)
    width = right - left
    pixel = width / 256
    thick = max(1, round(0.022 * stage.length / pixel))
    bottom = -TOP * stage.length - thick * pixel
    ramp = np.tile(np.arange(256, dtype=np.uint8)[:, None], (1, thick))
    if isinstance(colors, str):
        how = {"data": drawing.rows(ramp), "colormap": colors}
    else:
        how = {"color": True, "data": drawing.rows(drawing.painted(ramp / 255.0, colors)), "colormap": None}
    yield f"legend/{name}/bar", picture(plane, (256, thick), pixel, (left, bottom), stage, **how)
    below = -TICKS * stage.length
    ticks = rr.Points3D(
        placed(plane, [[left + at * width, below] for at, _ in scale], stage),
        radii=rr.Radius.ui_points(1.0),
        colors=TEXT,
        labels=[text for _, text in scale],
        show_labels=True,
    )
    yield f"legend/{name}/ticks", ticks
    middle = placed(plane, [[left + width / 2, -TITLE * stage.length]], stage)[0]
    yield f"legend/{name}/title", label(title, middle, TEXT)


def arrow_key(
    plane: Plane, text: str, length: float, color: tuple[int, ...], radius: float, stage: Stage
) -> Entities:
    """Yield the key of wind arrows below a plane, left of the colour bar: an arrow of given length [m] and a text."""
    left = 0.08 * stage.extent[plane.axes[0]] - length / 2
    ends = placed(plane, [[left, -0.042 * stage.length], [left + length, -0.042 * stage.length]], stage)
    arrow = rr.Arrows3D(origins=ends[:1], vectors=ends[1:] - ends[:1], colors=color, radii=radius)
    yield f"legend/wind/{plane.name}/arrow", arrow
    middle = placed(plane, [[left + length / 2, -TICKS * stage.length]], stage)[0]
    yield f"legend/wind/{plane.name}/text", label(text, middle, TEXT)
