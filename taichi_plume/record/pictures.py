"""Gas, temperature and wind in the recording: pictures on planes, a gas volume in 3-D, and wind arrows."""

import numpy as np
import rerun as rr

from taichi_plume.observed.observer import Observer
from taichi_plume.observed.observer import Pictures as Observed
from taichi_plume.observed.planes import VOLUME, Lattice, Plane, Raster
from taichi_plume.observed.scales import rounded_up
from taichi_plume.observed.views import View
from taichi_plume.record import drawing, legends, scene
from taichi_plume.record.placement import Stage, picture, placed
from taichi_plume.record.stream import Stream
from taichi_plume.time_loop import TimeLoop

ARROW = 0.9  # length of the arrow in the key, over the distance between arrows
KEY = 0.95  # fraction of the arrows that are shorter than the key's arrow
SHORTEST = 0.04  # fraction of the key's arrow: shorter arrows are not drawn
SLOWEST = 1e-3  # m/s: the least speed of the key's arrow
THIN = 0.038  # radius of arrows, over the distance between them
ARROW_COLOR = (165, 180, 200, 180)
HALVES = (np.arange(256) / 255).astype(np.float16)
DENSITY = 3.5  # optical density of the volume across the arena's height, at least a quarter of its length


class Pictures:
    """Pictures of scalars on planes in the recording and, in 3-D, of the gas as a volume.

    The static values `quantity`, `unit`, `low`, `high`, `scale` and `plane` of an entity describe its pictures.
    """

    def __init__(self, stream: Stream, sim: TimeLoop, stage: Stage, observer: Observer):
        self.stream, self.views = (
            stream,
            [view for view in recorded(observer) if not view.quantity.components],
        )
        for view in self.views:
            sample = observer.samples[view.name]
            if view.plane == VOLUME:
                volume = rr.Volume3D.from_fields(
                    voxel_size=sample.cell,
                    value_range=[0.0, 1.0],
                    gamma=2.0,
                    optical_density=DENSITY / max(sim.grid.extent[2], stage.length / 4),
                    colormap="inferno",
                )
                stream.log_still([(_entity(view), volume)])
            else:
                stream.log_still(_still(view, sample, stage))

    def show(self, sim: TimeLoop, pictures: Observed) -> None:
        """Send the pictures of an instant to the recording."""
        for view in self.views:
            if view.name not in pictures:
                continue
            pixels = view.quantity.scale.bytes(pictures[view.name])
            if view.plane == VOLUME:
                values = HALVES[np.ascontiguousarray(pixels.transpose(2, 1, 0))]
                self.stream.log(sim.t, _entity(view), rr.Volume3D.from_fields(values=values))
            else:
                self.stream.picture(sim.t, _entity(view), drawing.rows(pixels))


def recorded(observer: Observer) -> list[View]:
    """Return the views of an observer that belong to the recording."""
    return [view for view in observer.views if not view.output]


def _entity(view: View) -> str:
    return f"{view.quantity.entity}/{view.plane.name}"


def _still(view: View, sample: Raster | Lattice, stage: Stage) -> scene.Entities:
    """Yield the static data of a picture in a recording: its place in the scene, and the meaning of its bytes."""
    quantity, scale = view.quantity, view.quantity.scale
    how = {"colormap": quantity.colormap, "opacity": 0.95}
    yield _entity(view), picture(view.plane, sample.shape, sample.cell[0], sample.origin, stage, **how)
    values = {"quantity": quantity.name, "unit": quantity.unit, "low": scale.low, "high": scale.high}
    yield _entity(view), rr.AnyValues(**values, scale=scale.kind, plane=view.plane.text)


class Arrows:
    """Recorded wind arrows on horizontal slices and vertical sections; an arrow's length shows the speed.

    top: speed [m/s] of the key's arrow, the largest so far; nearly all arrows are shorter.
    """

    STATE = ("top",)

    def __init__(self, stream: Stream, stage: Stage, observer: Observer):
        self.stream, self.stage, self.top = stream, stage, 0.0
        self.views = [view for view in recorded(observer) if view.quantity.components]
        self.planes = [view.plane for view in self.views]
        self.places, self.steps = [], []
        self.gathered: dict[str, list[tuple[float, np.ndarray, np.ndarray]]] = {}
        """Time, origins and vectors of the arrows since the last `send`, by the entity."""
        for view in self.views:
            lattice = observer.samples[view.name]
            assert isinstance(lattice, Lattice)
            self.places.append(lattice.points.reshape(-1, lattice.points.shape[-1]))
            self.steps.append(lattice.step)
            style = rr.Arrows3D.from_fields(colors=ARROW_COLOR, radii=THIN * lattice.step)
            stream.log_still([(f"wind/{view.plane.name}", style)])

    def show(self, sim: TimeLoop, pictures: Observed) -> None:
        """Gather the wind as arrows centred on fixed points; send a new key if the speed has grown."""
        if self.views[0].name not in pictures:
            return
        parts = [pictures[view.name].reshape(sim.grid.dim, -1).T for view in self.views]
        speed = np.linalg.norm(np.concatenate(parts), axis=-1)
        known = speed[np.isfinite(speed)]
        fast = max(SLOWEST, float(np.quantile(known, KEY))) if len(known) else SLOWEST
        if fast > self.top:
            self.top = rounded_up(fast)
            for plane, step in zip(self.planes, self.steps, strict=True):
                text = f"{self.top:g} m/s"
                key = legends.arrow_key(plane, text, ARROW * step, ARROW_COLOR, THIN * step, self.stage)
                for entity, archetype in key:
                    self.stream.log(sim.t, entity, archetype)
        for plane, places, part, step in zip(self.planes, self.places, parts, self.steps, strict=True):
            arrows = self._arrows(plane, places, part, step)
            self.gathered.setdefault(f"wind/{plane.name}", []).append((sim.t, *arrows))

    def send(self) -> None:
        """Send the gathered arrows in columns: logging an instant alone takes ten times as long."""
        for entity, instants in self.gathered.items():
            times, origins, vectors = zip(*instants, strict=True)
            together = rr.Arrows3D.columns(origins=np.concatenate(origins), vectors=np.concatenate(vectors))
            self.stream.send(entity, times, together.partition([len(each) for each in vectors]))
        self.gathered.clear()

    def _arrows(
        self, plane: Plane, places: np.ndarray, velocity: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return origins and vectors of the arrows that are long enough to be drawn, (n, 3) [m]."""
        along = list(plane.axes)
        vectors = np.zeros((len(places), 3))
        vectors[:, along] = velocity[:, along] * (ARROW * step / self.top)
        length = np.linalg.norm(vectors, axis=-1)
        drawn = length > SHORTEST * ARROW * step
        vectors = vectors[drawn]
        return placed(plane, places[drawn][:, along], self.stage, 6) - vectors / 2, vectors
