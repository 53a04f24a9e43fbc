"""Gas, temperature and wind in the recording: pictures on planes, a gas volume in 3-D, and wind arrows."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from taichi_plume.grid import fields
from taichi_plume.record import drawing, legends, planes, scene
from taichi_plume.record.placement import Stage, picture, placed
from taichi_plume.record.planes import Plane, Raster
from taichi_plume.record.scales import Quantity
from taichi_plume.record.stream import Stream
from taichi_plume.time_loop import TimeLoop

SPLIT = 2  # samples per cell and axis of a gas with details below the cell size
ARROW = 0.9  # length of the arrow in the key, over the distance between arrows
KEY = 0.95  # fraction of the arrows that are shorter than the key's arrow
SHORTEST = 0.04  # fraction of the key's arrow: shorter arrows are not drawn
SLOWEST = 1e-3  # m/s: the least speed of the key's arrow
THIN = 0.038  # radius of arrows, over the distance between them
ARROW_COLOR = (165, 180, 200, 180)
HALVES = (np.arange(256) / 255).astype(np.float16)
DENSITY = 3.5  # optical density of the volume across the arena's height, at least a quarter of its length


class Pictures:
    """Recorded pictures of gas and temperature on planes and, in 3-D, of the gas as a volume.

    A byte of a picture is the largest value of the cells that its pixel covers. The static values `quantity`, `unit`,
    `low`, `high`, `scale`, `plane`, `axes`, `cell` and `origin` of an entity describe its pictures.
    """

    def __init__(
        self,
        stream: Stream,
        sim: TimeLoop,
        stage: Stage,
        seen: Sequence[Plane],
        quantities: Sequence[Quantity],
    ):
        self.stream, self.quantities, self.seen = stream, quantities, seen
        grid = sim.grid
        self.rasters: dict[str, list[Raster]] = {}
        self.sampled: dict[str, list[np.ndarray | None]] = {}
        """Sampling points of each raster; None for a raster of cells."""
        self.centers: np.ndarray | None = None
        for quantity in quantities:
            rasters = self.rasters[quantity.entity] = []
            sampled = self.sampled[quantity.entity] = []
            for plane in (plane for plane in seen if quantity.on(plane)):
                at_points = quantity.points is not None and not plane.over_height
                split = (SPLIT, quantity.details) if at_points else ()
                rasters.append(Raster(plane, grid, sim.air.solid, *split))
                sampled.append(rasters[-1].points if at_points else None)
                stream.log_still(_still(quantity, rasters[-1], stage))
        self.voxels: tuple[int, ...] | None = None
        if grid.dim == 3 and sim.scenario.recording.volume and quantities:
            self.voxels = planes.voxels(grid.shape)
            size = [length / n for length, n in zip(grid.extent, self.voxels, strict=True)]
            volume = rr.Volume3D.from_fields(
                voxel_size=size,
                value_range=[0.0, 1.0],
                gamma=2.0,
                optical_density=DENSITY / max(grid.extent[2], stage.length / 4),
                colormap="inferno",
            )
            stream.log_still([("gas/volume", volume)])

    def show(self, sim: TimeLoop) -> None:
        """Send the present pictures of all quantities on all planes, and the gas volume, to the recording."""
        for quantity in self.quantities:
            cells: np.ndarray | None = None
            volume = self.voxels is not None and quantity.entity == "gas"
            places = self.sampled[quantity.entity]
            if volume or any(points is None for points in places):
                cells = self._cells(sim, quantity)
            slices: list[np.ndarray] = []  # sampled at points: finer than the layers of cells
            for raster, points in zip(self.rasters[quantity.entity], places, strict=True):
                if points is not None and quantity.points is not None:
                    pixels = raster.of_samples(quantity.points(sim, points))
                    slices += [pixels] if raster.plane.letters == "xy" else []
                else:
                    assert cells is not None
                    pixels = raster.of_cells(cells)
                    for other in slices:
                        pixels = np.maximum(pixels, planes.largest(other, pixels.shape))
                data = drawing.rows(quantity.scale.bytes(pixels))
                self.stream.picture(sim.t, f"{quantity.entity}/{raster.plane.name}", data)
            if volume and cells is not None:
                self._show_volume(sim, quantity, cells)

    def _cells(self, sim: TimeLoop, quantity: Quantity) -> np.ndarray:
        """Return a quantity's values in all cells; sampled at the cell centres if it is known at points only."""
        cells = quantity.cells(sim)
        if cells is None:
            assert quantity.points is not None
            if self.centers is None:
                self.centers = sim.grid.centers().astype(np.float32)
            cells = quantity.points(sim, self.centers)
        return cells

    def _show_volume(self, sim: TimeLoop, quantity: Quantity, cells: np.ndarray) -> None:
        assert self.voxels is not None
        voxels = quantity.scale.bytes(planes.largest(cells, self.voxels))  # fewer values pack better
        volume = rr.Volume3D.from_fields(values=HALVES[np.ascontiguousarray(voxels.transpose(2, 1, 0))])
        self.stream.log(sim.t, "gas/volume", volume)


def _still(quantity: Quantity, raster: Raster, stage: Stage) -> scene.Entities:
    """Yield the static data of a picture in a recording: its place in the scene, and the meaning of its bytes."""
    plane, scale = raster.plane, quantity.scale
    entity = f"{quantity.entity}/{plane.name}"
    how = {"colormap": quantity.colormap, "opacity": 0.95}
    yield entity, picture(plane, raster.shape, raster.cell, raster.origin, stage, **how)
    values = {"quantity": quantity.name, "unit": quantity.unit, "low": scale.low, "high": scale.high}
    values |= {"scale": scale.kind, "plane": plane.text, "axes": plane.letters}
    yield entity, rr.AnyValues(**values, cell=raster.cell, origin=list(raster.origin))


class Arrows:
    """Recorded wind arrows on the first horizontal slice and on vertical sections; an arrow's length shows the speed.

    top: speed [m/s] of the key's arrow, the largest so far; nearly all arrows are shorter.
    """

    STATE = ("top",)

    def __init__(self, stream: Stream, sim: TimeLoop, stage: Stage, seen: Sequence[Plane]):
        self.stream, self.stage, self.top = stream, stage, 0.0
        extent = sim.grid.extent
        self.planes = [plane for plane in seen if plane.name == "slice" or plane.letters != "xy"]
        self.places, self.steps = [], []
        for plane in self.planes:
            places, step = drawing.arrow_places([extent[d] for d in plane.axes])
            self.places.append(plane.within(places))
            self.steps.append(step)
            style = rr.Arrows3D.from_fields(colors=ARROW_COLOR, radii=THIN * step)
            stream.log_still([(f"wind/{plane.name}", style)])
        self.points = np.concatenate(self.places).astype(np.float32)

    def show(self, sim: TimeLoop) -> None:
        """Send the present wind as arrows centred on fixed points, and a new key if the speed has grown."""
        velocity = fields.velocity_at(sim.wind, self.points, sim.t)
        speed = np.linalg.norm(velocity, axis=-1)
        known = speed[np.isfinite(speed)]
        fast = max(SLOWEST, float(np.quantile(known, KEY))) if len(known) else SLOWEST
        if fast > self.top:
            self.top = drawing.rounded_up(fast)
            for plane, step in zip(self.planes, self.steps, strict=True):
                text = f"{self.top:g} m/s"
                key = legends.arrow_key(plane, text, ARROW * step, ARROW_COLOR, THIN * step, self.stage)
                for entity, archetype in key:
                    self.stream.log(sim.t, entity, archetype)
        ends = np.cumsum([len(places) for places in self.places])[:-1]
        parts = zip(self.planes, self.places, np.split(velocity, ends), self.steps, strict=True)
        for plane, places, part, step in parts:
            self._show(sim, plane, places, part, step)

    def _show(
        self, sim: TimeLoop, plane: Plane, places: np.ndarray, velocity: np.ndarray, step: float
    ) -> None:
        along = list(plane.axes)
        vectors = np.zeros((len(places), 3))
        vectors[:, along] = velocity[:, along] * (ARROW * step / self.top)
        length = np.linalg.norm(vectors, axis=-1)
        drawn = length > SHORTEST * ARROW * step
        vectors = vectors[drawn]
        origins = placed(plane, places[drawn][:, along], self.stage, 6) - vectors / 2
        arrows = rr.Arrows3D.from_fields(origins=origins, vectors=vectors)
        self.stream.log(sim.t, f"wind/{plane.name}", arrows)
